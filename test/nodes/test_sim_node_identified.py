"""`sim_node` started with what `identify_bag --close-loop` wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from graph import Graph, unique_namespace
from identified import closed

from cfd_pneumatic.model import LiveDevice
from cfd_pneumatic.nodes.sim_node import SimNode
from cfd_pneumatic.reporting import PARAMETER_FILE, write_report


def test_it_simulates_the_pressure_of_the_report(graph: Graph, tmp_path: Path) -> None:
    """The node's own device, sample by sample, as `piston_state` would drive it."""
    write_report(closed(), tmp_path)
    arguments = ['--ros-args', '--params-file', str(tmp_path / PARAMETER_FILE)]
    node = SimNode(context=graph.context, namespace=unique_namespace(), cli_args=arguments)
    try:
        assert node.get_parameter('cylinder_a.droop.enabled').value is True
        live = node._live
        result = closed().cylinders['cylinder_a']
        (experiment,), (offset, _) = result.experiments, result.found.model.own[0]
        inputs = experiment.inputs
        readings = _played(live, experiment.times, inputs['displacement'], inputs['setpoint'] + offset)
    finally:
        node.destroy_node()
    np.testing.assert_allclose(readings[experiment.samples], result.comparisons[0].after, atol=0.5)


def test_it_runs_with_a_parameter_file_of_0_1_0(graph: Graph) -> None:
    arguments = ['--ros-args', '--params-file', str(Path(__file__).parents[1] / 'parameters_0_1_0.yaml')]
    node = SimNode(context=graph.context, namespace=unique_namespace(), cli_args=arguments)
    try:
        assert node.get_parameter('cylinder_a.droop.slope').value == 0.0013775011810227419
        assert node.get_parameter('cylinder_b.k_sv').value == [144.77469052713832]
        assert node.get_parameter('contact_force.seal_friction.enabled').value is True
        assert node.get_parameter('area').value == 0.0012
    finally:
        node.destroy_node()


def _played(live: LiveDevice, times: np.ndarray, displacement: np.ndarray, setpoint: np.ndarray) -> np.ndarray:
    """Return what cylinder A's sensor reads at some times [Pa]; stamps are whole nanoseconds."""
    readings = []
    for time, position, level in zip(times.tolist(), displacement.tolist(), setpoint.tolist()):
        live.sample(10**18 + round(time * 1e9), position, (level, level))
        assert live.committed is not None
        readings.append(live.committed.state.a.reading)
    return np.array(readings)
