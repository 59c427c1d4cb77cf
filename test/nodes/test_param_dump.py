# SPDX-License-Identifier: Apache-2.0
"""`ros2 param dump` and `ros2 param load`: what a node had, it has again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from graph import Graph, ros_arguments, unique_namespace
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python

CHANGES = {
    'cylinder_a__setpoints': [3e4, 6e4],
    'cylinder_a__k_x': [4e6, 5e6],
    'cylinder_a__k_sv': [100.0, 150.0],
    'cylinder_a__k_v': [19.0, 30.0],
    'cylinder_a__tau': [0.01, 0.012],
    'cylinder_b__leakage__enabled': True,
    'axis': 'y',
    'hardware_id': 'on',
}
"""Other lengths than the defaults have, and texts that YAML takes for a switch."""


def dumped(graph: Graph, node: str) -> dict[str, Any]:
    """Return all parameters of a node, as `ros2 param dump` asks for them."""
    names = graph.call(ListParameters, f'{node}/list_parameters', ListParameters.Request()).result.names
    values = graph.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values
    found = {name: parameter_value_to_python(value) for name, value in zip(names, values) if 'qos' not in name}
    return {name: value if isinstance(value, (str, bool, float, int)) else list(value) for name, value in found.items()}


@pytest.mark.parametrize('module', ['sim_node', 'monitor_node'])
def test_a_dump_is_taken_at_the_start_and_by_a_running_node(graph: Graph, tmp_path: Path, module: str) -> None:
    one, other, third = (f'{unique_namespace()}' for _ in range(3))
    with graph.run(module, ros_arguments(one)), graph.run(module, ros_arguments(third)):
        assert graph.set_atomically(f'{one}/{module}', **CHANGES).successful
        before = dumped(graph, f'{one}/{module}')
        node = f'{third}/{module}'
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in before.items()]
        request = SetParameters.Request(parameters=parameters)
        results = graph.call(SetParameters, f'{node}/set_parameters', request).results
        assert [(item.name, result.reason) for item, result in zip(parameters, results) if not result.successful] == []
        assert dumped(graph, node) == before
    file = tmp_path / 'dump.yaml'
    file.write_text(yaml.dump({'/**': {'ros__parameters': before}}))
    with graph.run(module, [*ros_arguments(other), '--params-file', str(file)]):
        again = dumped(graph, f'{other}/{module}')
    assert again == before


def test_what_does_not_go_together_is_set_one_by_one(graph: Graph) -> None:
    namespace = unique_namespace()
    node = f'{namespace}/sim_node'
    with graph.run('sim_node', ros_arguments(namespace)):
        parameters = [
            Parameter(name, value=value).to_parameter_msg()
            for name, value in (('max_gap', 2.0), ('timeout', -1.0), ('nobody', 1.0))
        ]
        results = graph.call(
            SetParameters, f'{node}/set_parameters', SetParameters.Request(parameters=parameters)
        ).results
        assert [one.successful for one in results] == [True, False, False]
        assert graph.get(node, 'max_gap') == [2.0]


@pytest.mark.parametrize('module', ['sim_node', 'monitor_node'])
def test_a_dump_that_is_loaded_changes_nothing(graph: Graph, module: str) -> None:
    """With the types that rclpy makes of a file, in which 1e-06 is a text."""
    node = f'{unique_namespace()}/{module}'
    with graph.run(module, ros_arguments(node.rpartition('/')[0])):
        assert graph.set_atomically(
            node, identified_displacement=[-1e-5, 2e-3], contact_force__seal_play=1e-6
        ).successful
        names = graph.call(ListParameters, f'{node}/list_parameters', ListParameters.Request()).result.names
        values = graph.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values
        texts = [
            str(one if isinstance(one, (str, bool, float, int)) else list(one))
            for one in map(parameter_value_to_python, values)
        ]
        assert '1e-06' in texts
        loaded = [get_parameter_value(text) for text in texts]
        parameters = [ParameterMessage(name=name, value=value) for name, value in zip(names, loaded)]
        request = SetParameters.Request(parameters=parameters)
        results = graph.call(SetParameters, f'{node}/set_parameters', request).results
        assert [result.reason for result in results if not result.successful] == []
        assert graph.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values == values


def test_a_read_only_parameter_is_refused_alone(graph: Graph) -> None:
    """The others are set at once: set-points and gains of another length would be refused one by one."""
    node = f'{unique_namespace()}/sim_node'
    with graph.run('sim_node', ros_arguments(node.rpartition('/')[0])):
        wanted = {'cylinder_a.initial_setpoint': 1e3, 'nobody': 1.0}
        wanted |= {name.replace('__', '.'): value for name, value in CHANGES.items()}
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in wanted.items()]
        request = SetParameters.Request(parameters=parameters)
        results = graph.call(SetParameters, f'{node}/set_parameters', request).results
        refused = [name for name, result in zip(wanted, results) if not result.successful]
        assert refused == ['cylinder_a.initial_setpoint', 'nobody']
        assert list(graph.get(node, 'cylinder_a.k_x')[0]) == CHANGES['cylinder_a__k_x']
