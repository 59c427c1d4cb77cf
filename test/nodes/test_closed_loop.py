# SPDX-License-Identifier: Apache-2.0
"""The closed loop in the graph: a device with something wrong, a bag, the identifier, and the simulator put right."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from graph import Graph, environment_with_studies, ros_arguments, unique_namespace
from patience import LONG_PATIENCE, allowed, wait_until
from sensor_msgs.msg import FluidPressure, JointState

from cfd_pneumatic.convention import CYLINDERS, PISTON_STATE, pressure_topic, setpoint_applied_topic, setpoint_topic
from cfd_pneumatic.nodes.messages import nanoseconds
from cfd_pneumatic.recording import recording_of, write_recording
from cfd_pneumatic.rig import Sensors, surface_following
from cfd_pneumatic.rig import record as rig_record
from studies.panel.specimen import draw_specimen

UNDECLARED = {'effects_a.leak_conductance': 1e-10}
"""A hole in cylinder A, which lowers its pressure at rest by 160 to 230 Pa, some 0.4 % of the set-point."""

DEVICE = """
import json, os, sys
from functools import partial
import numpy as np
import pytest
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.rig_node import RigNode
from studies.panel.specimen import draw_specimen
specimen, _ = draw_specimen(np.random.default_rng(int(sys.argv[1])))
specimen = specimen.with_changes(json.loads(sys.argv[2]))
del sys.argv[1:3]
os._exit(run('rig_node', partial(RigNode, specimen.rig)))
"""
"""A program: `rig_node` with a device drawn at random, and something wrong with it."""
DRAWN = 7

SENSORS = Sensors()
NOISE = math.hypot(SENSORS.pressure_noise, SENSORS.step(SENSORS.pressure_range) / math.sqrt(12.0))
"""Of a pressure sensor, converter and all [Pa]."""

DURATION = 2.0
SCHEDULE = surface_following(duration=DURATION).with_return()
RECORDED = 0.98  # of it: the recording has to end at rest
WINDOW = SCHEDULE.duration  # over which the residual is taken [s]
SETTLING = 0.5  # [s]
MOST = 1.3
"""Live residual over noise, where nothing is missing: a little above 1, for a stamp strays by 50 us, in which the
pressure rises by 300 Pa when the set-point steps."""


@contextmanager
def device(namespace: str) -> Iterator[subprocess.Popen]:
    """Run the device, which plays its schedule over and over once simulator, recorder and the test listen."""
    settings = {
        'schedule': 'surface_following',
        'schedule_duration': DURATION,
        'repeat': True,
        'start_subscribers': 3,
        'start_delay': 0.5,
    }
    told = [str(DRAWN), json.dumps(UNDECLARED)]
    program = [sys.executable, '-c', DEVICE, *told, *ros_arguments(namespace, settings)]
    process = subprocess.Popen(program, env=environment_with_studies())
    try:
        yield process
        process.terminate()
        assert process.wait(allowed()) == 0
    finally:
        process.kill()
        process.wait()


class Residual:
    """Measured less simulated pressures, live, by equal stamps."""

    def __init__(self, graph: Graph, measured: str, simulated: str) -> None:
        self.graph = graph
        self._heard = [
            [graph.listen(FluidPressure, f'{source}/{pressure_topic(cylinder)}') for source in (measured, simulated)]
            for cylinder in CYLINDERS
        ]

    @property
    def samples(self) -> int:
        return len(self._heard[0][0])

    @property
    def first(self) -> int:
        """The first stamp [ns]."""
        return nanoseconds(self._heard[0][0][0].header.stamp)

    @property
    def now(self) -> int:
        """The latest stamp [ns]."""
        return max(nanoseconds(messages[-1].header.stamp) for pair in self._heard for messages in pair)

    def over_noise(self, since: int) -> list[float]:
        """Return each cylinder's root mean square soon after a stamp [ns], over the sensor's noise."""
        begin = since + round(1e9 * SETTLING)
        end = begin + round(1e9 * WINDOW)
        self.graph.until(lambda: self.now > end)
        ratios = []
        for pair in self._heard:
            measured, simulated = (
                {nanoseconds(message.header.stamp): message.fluid_pressure for message in messages} for messages in pair
            )
            both = [stamp for stamp in measured.keys() & simulated.keys() if begin < stamp <= end]
            assert len(both) > 0.9 * SCHEDULE.samples
            residual = np.array([measured[stamp] - simulated[stamp] for stamp in both])
            ratios.append(float(np.sqrt(np.mean(residual**2))) / NOISE)
        return ratios


@pytest.mark.slow
def test_the_live_residual_falls_to_the_noise_when_what_the_model_lacks_is_found(graph: Graph, tmp_path: Path) -> None:
    real, simulator, own = unique_namespace(), unique_namespace(), unique_namespace()
    sim, identifier = f'{simulator}/sim_node', f'{own}/identifier_node'
    inputs = {topic: f'{real}/{topic}' for topic in (PISTON_STATE, *map(setpoint_topic, CYLINDERS))}
    topics = [
        f'{real}/{topic}'
        for cylinder in CYLINDERS
        for topic in (setpoint_topic(cylinder), setpoint_applied_topic(cylinder), pressure_topic(cylinder))
    ]
    earlier, bag, output = tmp_path / 'earlier', tmp_path / 'bag', tmp_path / 'identified'
    specimen = draw_specimen(np.random.default_rng(DRAWN))[0].with_changes(UNDECLARED)
    write_recording(earlier, recording_of(rig_record(SCHEDULE, specimen.rig, seed=1), epoch=10**18))
    folders = {'input_folders': f'[{tmp_path}]', 'output_folder': tmp_path}
    identify = {**folders, 'bags': f'[{earlier}]', 'output_dir': output, 'apply_to': sim}
    record = {'output': bag, 'topics': f'[{real}/{PISTON_STATE},{",".join(topics)}]'}

    def identified(report: str) -> DiagnosticStatus:
        """Return the status that says that the parameters are set and names the report."""
        assert graph.trigger(f'{identifier}/identify').success
        status = DiagnosticStatus()

        def report_it() -> None:
            nonlocal status
            status = graph.next_diagnostics(identifier, lambda _: True)
            assert status.level == DiagnosticStatus.OK, status.message

        def is_done() -> bool:
            words = status.message
            return words.startswith(f'parameters set on {sim}.') and words.endswith(str(output / report))

        wait_until(is_done, seconds=LONG_PATIENCE, meanwhile=report_it, found=lambda: status.message)
        return status

    residual = Residual(graph, real, simulator)
    with (
        graph.run('sim_node', ros_arguments(simulator, remaps=inputs)),
        graph.run('identifier_node', ros_arguments(own, identify)),
        graph.run('recorder_node', ros_arguments(parameters=record)) as recorder,
        device(real) as rig,
    ):
        graph.get(sim, 'area')  # it has started
        identified('report.json')
        graph.listen(JointState, f'{real}/{PISTON_STATE}')
        graph.until(lambda: residual.samples > RECORDED * SCHEDULE.samples or rig.poll() is not None)
        assert rig.poll() is None
        recorder.stop()
        before_a, before_b = residual.over_noise(residual.first)
        assert graph.set_atomically(identifier, bags=[str(bag)], close_loop=True).successful
        status = identified('report.html')
        after_a, after_b = residual.over_noise(residual.now)
    print(f'live residual over noise: A {before_a:.2f}, then {after_a:.2f}; B {before_b:.2f}, then {after_b:.2f}')
    a, b = (json.loads((output / 'report.json').read_text())['cylinders'][cylinder] for cylinder in CYLINDERS)
    assert (a['verdict'], a['effects']) == ('effect_added', ['leakage'])
    assert (b['verdict'], b['effects']) == ('no_missing_effect', [])
    assert 'Cylinder A: Missing effect: leakage' in status.message
    assert 'Cylinder B: ' in status.message
    assert before_a > 3.0
    assert max(after_a, before_b, after_b) < MOST
