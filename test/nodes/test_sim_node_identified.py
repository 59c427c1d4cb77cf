# SPDX-License-Identifier: Apache-2.0
"""`sim_node` started with what `identify_bag --close-loop` wrote."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from graph import Graph, SimClient, unique_namespace
from identified import closed

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CONTACT_FORCE, CYLINDERS, pressure_topic
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.model import LiveDevice
from cfd_pneumatic.nodes import sim_node
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
        (experiment,) = result.experiments
        readings = _played(live, experiment.times, experiment.inputs['displacement'], experiment.inputs['setpoint'])
    finally:
        node.destroy_node()
    np.testing.assert_allclose(readings[experiment.samples], result.comparisons[0].after, atol=0.5)


@pytest.mark.parametrize('present', [CYLINDERS, CYLINDERS[:1]])
def test_it_answers_what_the_device_simulates_live(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, present: tuple[str, ...]
) -> None:
    """Over the middleware, sample by sample and set-point by set-point, through a step of the set-point."""
    found = replace(closed(), channels={name: closed().channels[name] for name in present})
    device, file = identified_device(found), tmp_path / PARAMETER_FILE
    device.save(file)
    whole = found.recordings[0]
    step = float(whole.cylinders['cylinder_a'].setpoint.times[1])
    piece = whole.between(step - 0.2, step + 0.3)
    answers = device.simulate(piece, raw=True)
    setpoints = {name: piece.cylinders[name].setpoint for name in present}
    namespace = unique_namespace()
    monkeypatch.setattr(sim_node, '_DIAGNOSTICS_PERIOD', 0.1)
    arguments = ['--ros-args', '--params-file', str(file)]
    with graph.run_here(SimNode(context=graph.context, namespace=namespace, cli_args=arguments)):
        sim = SimClient(graph, namespace, cylinders=present).meet()
        commanded = {}
        for index, (time, position) in enumerate(zip(piece.displacement.times, piece.displacement.values)):
            for rank, name in enumerate(present):
                held = max(np.searchsorted(setpoints[name].times, time - 1e-9) - 1, 0)
                if commanded.get(name) != held:
                    commanded[name] = held
                    level = float(setpoints[name].values[held]) - AMBIENT_PRESSURE
                    sim.setpoint(rank, level)
                    said = f'{level:.1f}'
                    graph.next_diagnostics(sim.node, partial(_says, said))
            heard = sim.sample(piece.epoch + round(time * 1e9), float(position))
            for name in present:
                pressure = answers.cylinders[name].pressure.values
                assert heard[pressure_topic(name)] == pytest.approx(pressure[index], abs=1e-6 * np.ptp(pressure))
            force = answers.force.values
            assert heard[CONTACT_FORCE].x == pytest.approx(force[index], abs=1e-6 * np.ptp(force))
    assert max(commanded.values()) == 1


def _says(value: str, status: DiagnosticStatus) -> bool:
    return value in (entry.value for entry in status.values)


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
