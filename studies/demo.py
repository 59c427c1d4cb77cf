# SPDX-License-Identifier: Apache-2.0
"""
Demonstrate the closed loop: make demo.

A virtual device with a leak, its simulator, a recorder and the identifier run in a ROS 2 graph. The identifier finds
the leak in the recording, and corrects the simulator while device and simulator run on. The demo also identifies a
measured run of a cylinder if the measured data are present.
"""

from __future__ import annotations

import argparse
import itertools
import math
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from sensor_msgs.msg import FluidPressure
from std_srvs.srv import Trigger

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    DIAGNOSTICS,
    MODEL_INPUTS,
    MONITOR_INPUTS,
    pressure_topic,
    setpoint_applied_topic,
)
from cfd_pneumatic.nodes import OUTPUT_QOS, nanoseconds
from cfd_pneumatic.rig import Sensors, out_and_back
from studies.tools.provenance import DATA, ROOT
from studies.tools.ros_environment import isolate

MEASURED_RUN = DATA / 'friction' / 'O-ring257_3bar.csv'
DEVICE, SIM = '/cfd/device', '/cfd/sim'
RECORDED = (
    *(f'{DEVICE}/{topic}' for topic in (*MONITOR_INPUTS, *map(setpoint_applied_topic, CYLINDERS))),
    *(f'{SIM}/{topic}' for topic in (*map(pressure_topic, CYLINDERS), CONTACT_FORCE)),
)
SIMULATOR = f'{SIM}/sim_node'
IDENTIFIER = '/cfd/identifier_node'
PATIENCE = 120.0  # time limit of each step, for a busy machine [s]
ENDING_TIME = 10.0  # time limit for the end of a node [s]
SETTLING = 0.5  # after a change, before the residual is measured [s]

SCHEDULE = out_and_back().with_return()  # repeated

LEAKING = """
import sys
from functools import partial
import numpy as np

from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.nodes.rig_node import RigNode
from studies.panel.specimen import draw_specimen
specimen, _ = draw_specimen(np.random.default_rng(7))
leaking = specimen.with_changes({'effects_a.leak_conductance': 1e-10})
sys.exit(run('rig_node', partial(RigNode, leaking.rig)))
"""
"""Source of a program: `rig_node` with a hole in cylinder A."""


def main() -> int:
    """Run the demo; return its exit code."""
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', help='folder for all outputs')
    output = parser.parse_args().output.resolve()
    isolate()
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    close_the_loop(output)
    identify_measured(output)
    print(f'\nAll outputs are in {output}')
    return 0


def heading(text: str) -> None:
    print(f'\n== {text}', flush=True)


def close_the_loop(output: Path) -> None:
    """Record a device, find the missing effect, correct the simulator, and print the residual before and after."""
    log = output / 'nodes.log'
    with log.open('wb') as errors:
        try:
            before, after = run_graph(output / 'rig_bag', output / 'rig_identified', errors)
        except NodeError as error:
            raise SystemExit(f'demo: {error}. The messages of the nodes are in {log}.') from error
    heading('Measured minus simulated pressure while device and simulator run')
    for name, error_before, error_after in zip(CYLINDERS, before, after):
        noise = Sensors().pressure_noise
        print(f'{name}: {error_before:.0f} Pa before, {error_after:.0f} Pa after (sensor noise: {noise:.0f} Pa)')
    print(f'Open the report in a browser: {output / "rig_identified" / "report.html"}')


def run_graph(bag: Path, results: Path, errors: IO[bytes]) -> tuple[list[float], list[float]]:
    """Return the residual of each cylinder with the paper's model and with the found effects [Pa]."""
    heading('A device with an unknown leak in cylinder A, its simulator and a recorder run')
    with graph(bag, results, errors) as (client, recorder):
        # the recording has to end at rest
        client.until(lambda: len(client.pressures[DEVICE, CYLINDERS[0]]) > 0.98 * SCHEDULE.samples)
        end([recorder])
        print(f'Recorded: {bag}')
        heading("The identifier fits the paper's model to the recording")
        print(client.identify('report.json'))
        began = client.now
        heading('The identifier looks for missing effects')
        client.result_of(client.parameters.set_parameters([Parameter('close_loop', value=True)]))
        print(client.identify('report.html').replace('. ', '.\n'), flush=True)
        return client.residuals(began), client.residuals(client.now)


class NodeError(Exception):
    """A node failed, or did not answer in time."""


class Client(Node):
    """Receive measured and simulated pressures, and call the identifier."""

    def __init__(self) -> None:
        """Subscribe to the pressures and to the diagnostics."""
        super().__init__('demo')
        self.pressures: dict[tuple[str, str], dict[int, float]] = {}
        self.parameters = AsyncParameterClient(self, IDENTIFIER)
        self._identify = self.create_client(Trigger, f'{IDENTIFIER}/identify')
        self._statuses: list[DiagnosticStatus] = []
        self._executor = EventsExecutor()
        self._executor.add_node(self)
        for source, cylinder in itertools.product((DEVICE, SIM), CYLINDERS):
            received = self.pressures[source, cylinder] = {}
            topic = f'{source}/{pressure_topic(cylinder)}'
            self.create_subscription(FluidPressure, topic, partial(store_pressure, received), OUTPUT_QOS)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._store_statuses, 10)

    def _store_statuses(self, array: DiagnosticArray) -> None:
        self._statuses.extend(array.status)

    @property
    def now(self) -> int:
        """The latest stamp of the device [ns]."""
        return next(reversed(self.pressures[DEVICE, CYLINDERS[0]]))

    def until(self, condition: Callable[[], Any]) -> Any:
        """Return what the condition gives as soon as it is true."""
        limit = time.monotonic() + PATIENCE
        while not (result := condition()):
            if time.monotonic() > limit:
                raise NodeError(
                    f'a node did not answer within {PATIENCE:.0f} s. The machine may be busy. Run the demo again'
                )
            self._executor.spin_once(timeout_sec=0.05)
        return result

    def result_of(self, future: Future) -> Any:
        """Wait for a service, and return its result."""
        self.until(future.done)
        return future.result()

    def identify(self, report: str) -> str:
        """Have the recording identified; return the status message of the finished identification."""
        self.until(self._identify.service_is_ready)
        answer = self.result_of(self._identify.call_async(Trigger.Request()))
        if not answer.success:
            raise NodeError(answer.message)
        self._statuses.clear()

        def is_final(status: DiagnosticStatus) -> bool:
            ended = status.level == DiagnosticStatus.ERROR or status.message.endswith(report)
            return ended and status.name.startswith(f'{IDENTIFIER}: ')

        status = self.until(lambda: next(filter(is_final, self._statuses), None))
        if status.level == DiagnosticStatus.ERROR:
            raise NodeError(status.message)
        return str(status.message)

    def residuals(self, since: int) -> list[float]:
        """Return each cylinder's RMS of measured minus simulated over a schedule after a stamp [Pa]."""
        begin = since + round(1e9 * SETTLING)
        last = begin + round(1e9 * SCHEDULE.duration)
        self.until(lambda: self.now > last)
        residuals = []
        for cylinder in CYLINDERS:
            measured, simulated = (self.pressures[source, cylinder] for source in (DEVICE, SIM))
            stamps = [stamp for stamp in measured.keys() & simulated.keys() if begin < stamp <= last]
            errors = [measured[stamp] - simulated[stamp] for stamp in stamps]
            residuals.append(math.sqrt(sum(error**2 for error in errors) / len(errors)))
        return residuals


def store_pressure(received: dict[int, float], message: FluidPressure) -> None:
    received[nanoseconds(message.header.stamp)] = message.fluid_pressure


@contextmanager
def graph(bag: Path, results: Path, errors: IO[bytes]) -> Iterator[tuple[Client, subprocess.Popen[bytes]]]:
    """Run all nodes; the device repeats its schedule when simulator and recorder have subscribed."""
    record = {'output': bag, 'topics': f'[{",".join(RECORDED)}]'}
    folders = {'input_folders': f'[{bag.parent}]', 'output_folder': results.parent}
    identify = {'bags': f'[{bag}]', 'namespace': DEVICE, 'output_dir': results, 'apply_to': SIMULATOR, **folders}
    play = {'schedule': 'out_and_back', 'start_subscribers': 2, 'start_delay': 1.0, 'repeat': 'true'}
    remaps = {topic: f'{DEVICE}/{topic}' for topic in MODEL_INPUTS}
    programs: list[tuple[str, str, str, str, dict[str, Any]]] = [
        ('-m', 'cfd_pneumatic.nodes.recorder_node', '/cfd', '-p', record),
        ('-m', 'cfd_pneumatic.nodes.sim_node', SIM, '-r', remaps),
        ('-m', 'cfd_pneumatic.nodes.identifier_node', '/cfd', '-p', identify),
        ('-c', LEAKING, DEVICE, '-p', play),
    ]
    nodes = []
    for option, program, namespace, flag, settings in programs:
        pairs = itertools.chain.from_iterable((flag, f'{name}:={value}') for name, value in settings.items())
        command = [sys.executable, option, program, '--ros-args', '-r', f'__ns:={namespace}', *pairs]
        # a separate session: an interrupt reaches only the demo, which then ends its nodes
        nodes.append(subprocess.Popen(command, stderr=errors, start_new_session=True))
    rclpy.init()
    client = Client()
    try:
        yield client, nodes[0]
    finally:
        client.destroy_node()
        rclpy.try_shutdown()  # an interrupt has shut rclpy down already
        end(nodes)


def end(nodes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End nodes by an interrupt, as a user does."""
    for node in nodes:
        if node.poll() is None:
            node.send_signal(signal.SIGINT)
    codes = [node.wait(ENDING_TIME) for node in nodes]
    if any(codes):
        raise NodeError('a node failed')


def identify_measured(output: Path) -> None:
    """Identify a measured run, if the measured data are present."""
    heading('A measured recording of a cylinder is identified')
    if MEASURED_RUN.is_file():
        mapping = ROOT / 'config' / 'pneumatic_actuator.yaml'
        run('csv_to_bag', MEASURED_RUN, '--mapping', mapping, '--output', output / 'measured_bag')
        run('identify_bag', output / 'measured_bag', '--output', output / 'measured_identified')
    else:
        print(
            f'Skipped: {MEASURED_RUN} does not exist. '
            'Set CFD_PNEUMATIC_DATA to the folder of the measured data (see README).'
        )


def run(program: str, *arguments: object) -> None:
    """Run an offline program; end the demo if the program fails."""
    ended = subprocess.run(
        [sys.executable, '-m', f'cfd_pneumatic.commands.{program}', *map(str, arguments)], check=False
    )
    if ended.returncode != 0:
        raise SystemExit(ended.returncode)


if __name__ == '__main__':
    sys.exit(main())
