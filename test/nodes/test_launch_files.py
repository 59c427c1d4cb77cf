# SPDX-License-Identifier: Apache-2.0
"""The launch files: what they offer, and two cells of them side by side in a real graph."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from graph import Graph
from patience import allowed
from sensor_msgs.msg import FluidPressure

from cfd_pneumatic.convention import CYLINDERS, MODEL_INPUTS, MONITOR_INPUTS, SIM_INPUTS, pressure_topic, residual_topic

pytest.importorskip('launch_ros', reason='launch_ros is not to be had here')

from launch import LaunchContext, LaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

ROOT = Path(__file__).parents[2]
PROGRAMS = ('sim_node', 'monitor_node', 'rig_node', 'identifier_node')
FILES = sorted(path.name.partition('.')[0] for path in (ROOT / 'launch').glob('*.launch.py'))
LAUNCH = (
    'import sys; from launch import LaunchService; from launch.launch_description_sources import *; '
    'from launch.actions import IncludeLaunchDescription as Include; service = LaunchService(argv=[]); '
    'service.include_launch_description(Include(PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments='
    '[argument.split(":=") for argument in sys.argv[2:]])); sys.exit(service.run())'
)
"""A program: what `ros2 launch FILE ARGUMENT...` does."""


@pytest.fixture(scope='module')
def workspace(tmp_path_factory) -> Path:
    """Return an installation as colcon lays it out, in which launch finds the package of this tree."""
    prefix = tmp_path_factory.mktemp('workspace')
    (prefix / 'share/ament_index/resource_index/packages').mkdir(parents=True)
    (prefix / 'share/ament_index/resource_index/packages/cfd_pneumatic').touch()
    (prefix / 'share/cfd_pneumatic').mkdir()
    for folder in ('launch', 'config'):
        (prefix / 'share/cfd_pneumatic' / folder).symlink_to(ROOT / folder)
    programs = prefix / 'lib/cfd_pneumatic'
    programs.mkdir(parents=True)
    for name in PROGRAMS:
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m cfd_pneumatic.nodes.{name} "$@"\n')
        program.chmod(0o755)
    return prefix


@contextmanager
def launched(workspace: Path, name: str, *arguments: str) -> Iterator[subprocess.Popen]:
    """Launch a file; at the end everything in it has to end as after Ctrl-C."""
    prefixes = os.pathsep.join(filter(None, [str(workspace), os.environ.get('AMENT_PREFIX_PATH')]))
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')]))
    environment = os.environ | {'AMENT_PREFIX_PATH': prefixes, 'PYTHONPATH': paths}
    process = subprocess.Popen(
        [sys.executable, '-c', LAUNCH, str(ROOT / 'launch' / f'{name}.launch.py'), *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        try:
            process.communicate(timeout=allowed())
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise


def described(name: str) -> LaunchDescription:
    source = PythonLaunchDescriptionSource(str(ROOT / 'launch' / f'{name}.launch.py'))
    return source.get_launch_description(LaunchContext())


def nodes_of(graph: Graph) -> set[str]:
    return {f'{space}/{name}' for name, space in graph.node.get_node_names_and_namespaces()}


def heard_by(graph: Graph, name: str, namespace: str) -> set[str]:
    return {topic for topic, _ in graph.node.get_subscriber_names_and_types_by_node(name, namespace)}


@pytest.mark.parametrize('name', FILES)
def test_every_argument_is_described(name):
    arguments = described(name).get_launch_arguments()
    assert {'cell', 'use_sim_time'} <= {argument.name for argument in arguments}
    assert [argument.name for argument in arguments if argument.description == 'no description given'] == []


def test_only_the_parameters_of_a_monitor_have_to_be_given():
    required = {
        (name, argument.name)
        for name in FILES
        for argument in described(name).get_launch_arguments()
        if argument.default_value is None
    }
    assert required == {('monitor', 'parameters')}


def test_two_cells_run_side_by_side(graph, workspace):
    parameters = f'parameters:={ROOT / "config/table_2.yaml"}'  # any that were identified: the device is watched then
    with launched(workspace, 'cell', 'cell:=/cell_7', parameters), launched(workspace, 'cell', 'cell:=/cell_8'):
        wanted = {'/cell_7/device/rig_node', '/cell_7/sim/sim_node', '/cell_7/monitor/monitor_node'}
        wanted |= {'/cell_8/device/rig_node', '/cell_8/sim/sim_node'}
        graph.until(lambda: wanted <= nodes_of(graph))
        answers = [
            graph.listen(FluidPressure, f'{cell}/{topic}')
            for cell, topic in [
                *((cell, f'sim/{pressure_topic(name)}') for cell in ('/cell_7', '/cell_8') for name in CYLINDERS),
                *(('/cell_7', f'monitor/{residual_topic(name)}') for name in CYLINDERS),
            ]
        ]
        graph.until(lambda: all(answers))
        assert {name for name in nodes_of(graph) if name.startswith('/cell_')} == wanted
        for topics, name, role in [(SIM_INPUTS, 'sim_node', 'sim'), (MONITOR_INPUTS, 'monitor_node', 'monitor')]:
            assert {f'/cell_7/device/{topic}' for topic in topics} <= heard_by(graph, name, f'/cell_7/{role}')
        assert graph.get('/cell_7/sim/sim_node', 'cylinder_a.setpoints')[0][1:] == [68947.57]
        assert len(graph.get('/cell_8/sim/sim_node', 'cylinder_a.setpoints')[0]) == 4


def test_a_real_device_may_publish_anywhere(graph, workspace):
    arguments = ('cell:=/cell_9', 'rig:=false', 'device:=/robot_9/tool', 'monitor:=false', 'use_sim_time:=true')
    with launched(workspace, 'cell', *arguments):
        graph.until(lambda: '/cell_9/sim/sim_node' in nodes_of(graph))
        wanted = {f'/robot_9/tool/{topic}' for topic in MODEL_INPUTS}
        graph.until(lambda: wanted <= heard_by(graph, 'sim_node', '/cell_9/sim'))
        assert graph.get('/cell_9/sim/sim_node', 'use_sim_time') == [True]
        assert {name for name in nodes_of(graph) if name.startswith('/cell_9')} == {'/cell_9/sim/sim_node'}


def test_the_identifier_puts_the_simulator_of_its_cell_right(graph, workspace):
    with launched(workspace, 'identify', 'cell:=/cell_6', 'bags:=one.mcap,two.mcap', 'output_dir:=2025'):
        node = '/cell_6/identifier_node'
        assert graph.get(node, 'bags', 'output_dir', 'apply_to', 'close_loop') == [
            ['one.mcap', 'two.mcap'],
            '2025',
            '/cell_6/sim/sim_node',
            False,
        ]
        assert 'one.mcap' in graph.trigger(f'{node}/identify').message


def test_the_identifier_waits_for_bags_where_none_are_given(graph, workspace):
    with launched(workspace, 'identify', 'cell:=/cell_5'):
        assert "parameter 'bags' is empty" in graph.trigger('/cell_5/identifier_node/identify').message


@pytest.mark.parametrize('argument', ['cell', 'device'])
def test_a_relative_namespace_is_refused(workspace, argument):
    with launched(workspace, 'sim', f'{argument}:=cell_7') as process:
        said = process.communicate(timeout=allowed())[0]
    assert f'{argument}:=cell_7 must begin with a slash: use {argument}:=/cell_7' in said
    assert process.returncode != 0
