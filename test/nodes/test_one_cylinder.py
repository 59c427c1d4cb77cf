# SPDX-License-Identifier: Apache-2.0
"""A device with one cylinder, from its bag to the nodes over real DDS: the simulated force is the measured one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graph import MILLISECOND, Graph, SimClient, ros_arguments, unique_namespace
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_STATE,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.nodes.messages import stamp_message
from cfd_pneumatic.nodes.sim_node import SimNode
from cfd_pneumatic.recording import Recording, recording_of, write_recording
from cfd_pneumatic.rig import RigParameters, record, surface_following
from cfd_pneumatic.rig.parameters import with_changes
from cfd_pneumatic.units import PSI

SETPOINT = 15.0 * PSI  # gauge [Pa]
AREA = 9e-4  # [m^2]
GONE = 1e-12  # area of a cylinder that isn't there [m^2]
PLAYED = 100  # samples


def recorded(folder: Path, present: str, linkage: float) -> tuple[Path, Recording]:
    """Return the bag of a rig that has one cylinder, and what is in it."""
    (missing,) = {*CYLINDERS} - {present}
    rig = with_changes(
        RigParameters(), {f'{present}.area': AREA, f'{missing}.area': GONE, 'piston.geometric_factor': linkage}
    )
    schedule = surface_following(setpoint=SETPOINT, setpoint_b=SETPOINT, setpoint_steps=0.0, duration=10.0)
    whole = recording_of(record(schedule, rig), 'one cylinder', 10**18)
    recording = replace(whole, cylinders={present: whole.cylinders[present]})
    write_recording(folder / 'bag', recording)
    return folder / 'bag', recording


@pytest.mark.parametrize(
    ('present', 'linkage', 'told'),
    [
        ('cylinder_a', 1.0, []),
        ('cylinder_a', 1.5, []),
        ('cylinder_a', 1.5, ['--geometric-factor=1.5']),
        ('cylinder_a', 1.5, ['--geometric-factor=1.5', f'--area={AREA}']),
        ('cylinder_b', 1.0, []),
    ],
)
def test_the_simulated_force_is_the_measured_one(
    graph: Graph, tmp_path: Path, present: str, linkage: float, told: list[str]
) -> None:
    bag, recording = recorded(tmp_path, present, linkage)
    assert identify_bag([str(bag), '--output', str(tmp_path), '--progress=none', *told]) == 0
    namespace = unique_namespace()
    arguments = ['--ros-args', '--params-file', str(tmp_path / 'parameters.yaml')]
    with graph.run_here(SimNode(context=graph.context, namespace=namespace, cli_args=arguments)):
        sim = SimClient(graph, namespace, cylinders=[present]).meet()
        assert recording.force is not None
        samples = zip(recording.displacement.times[:PLAYED], recording.displacement.values)
        forces = [sim.sample(10**12 + round(time * 1e9), float(x))[CONTACT_FORCE].x for time, x in samples]
    measured = recording.force.values[:PLAYED]
    assert abs(np.mean(measured)) == pytest.approx(SETPOINT * AREA * linkage, rel=0.02)
    assert np.mean(forces) == pytest.approx(np.mean(measured), rel=0.02)


def test_a_monitor_waits_for_the_one_cylinder_alone(graph: Graph, tmp_path: Path) -> None:
    bag, recording = recorded(tmp_path, 'cylinder_a', 1.0)
    assert identify_bag([str(bag), '--output', str(tmp_path), '--progress=none']) == 0
    namespace = unique_namespace()
    monitor = f'{namespace}/monitor_node'
    piston_out = graph.publisher(JointState, f'{namespace}/{PISTON_STATE}')
    pressure_out = graph.publisher(FluidPressure, f'{namespace}/{pressure_topic("cylinder_a")}')
    setpoint_out = graph.publisher(Float64, f'{namespace}/{setpoint_topic("cylinder_a")}')
    samples = zip(recording.displacement.values.tolist(), recording.cylinders['cylinder_a'].pressure.values.tolist())
    stamp = 10**18

    def publish() -> None:
        nonlocal stamp
        stamp += 2 * MILLISECOND
        setpoint_out.publish(Float64(data=SETPOINT))
        header = JointState().header
        header.stamp = stamp_message(stamp)
        position, pressure = next(samples)
        piston_out.publish(JointState(header=header, name=['piston'], position=[position]))
        pressure_out.publish(FluidPressure(header=header, fluid_pressure=pressure))

    arguments = [*ros_arguments(namespace, {'timeout': 5.0}), '--params-file', str(tmp_path / 'parameters.yaml')]
    with graph.run('monitor_node', arguments):
        graph.until(lambda: piston_out.get_subscription_count() and pressure_out.get_subscription_count())
        graph.next_diagnostics(
            monitor, lambda one: one.name.endswith('feed') and one.message == f'following {PISTON_STATE}', doing=publish
        )
        topics = {topic for topic, _ in graph.node.get_topic_names_and_types() if topic.startswith(namespace)}
        assert not any('cylinder_b' in topic for topic in topics)
        assert f'{namespace}/{MEASURED_FORCE}' in topics
