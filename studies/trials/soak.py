# SPDX-License-Identifier: Apache-2.0
"""
Run all nodes for hours at 1 kHz and measure memory, threads, descriptors and latency: `make soak`.

A rig is the device. A program that is killed every minute sends set-points and commands. The rig is ended every 15
minutes. The clock jumps, parameters change, and the rig gets and loses a leak. A bag is identified; its result is set
on the simulator and reverted. The measurements are in `samples.jsonl`, from which the tables are computed.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cfd_pneumatic.convention import (
    CONTACT_FORCE,
    CYLINDERS,
    DIAGNOSTICS,
    MODEL_INPUTS,
    MONITOR_INPUTS,
    PISTON_AREA,
    PISTON_COMMAND,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.nodes import LOST, OUTPUT_QOS, SAMPLE_QOS, stamp_message
from studies.documents.markdown import table
from studies.tools.processes import WARMING, StampedCallback, slope, span, started, usage_of
from studies.tools.provenance import ROOT
from studies.tools.ros_environment import isolate

CELL = '/soak'
DEVICE, SIM, MONITOR = (f'{CELL}/{name}' for name in ('device', 'sim', 'monitor'))
RIG_NODE, SIM_NODE, MONITOR_NODE = f'{DEVICE}/rig_node', f'{SIM}/sim_node', f'{MONITOR}/monitor_node'
IDENTIFIER_NODE = f'{CELL}/identifier_node'
ANSWERS = {'sim_node': f'{SIM}/{CONTACT_FORCE}', 'monitor_node': f'{MONITOR}/{PREDICTED}{CONTACT_FORCE}'}
RECORDED = (f'{DEVICE}/{PISTON_STATE}', f'{DEVICE}/{pressure_topic(CYLINDERS[0])}', ANSWERS['sim_node'])
LEAK = 'effects_a.leak_conductance=1e-10'
PATIENCE = 120.0  # [s]
ENDING = 10.0  # [s]
KEPT_SAMPLES = 20_000  # that may still be answered


class Program:
    """A running node that can be restarted."""

    def __init__(
        self, name: str, namespace: str, log: IO[bytes], parameters: Mapping[str, Any], *arguments: str
    ) -> None:
        self.name = name
        options = itertools.chain.from_iterable(('-p', f'{key}:={value}') for key, value in parameters.items())
        module = ('-m', f'cfd_pneumatic.nodes.{name}')
        self._start = partial(
            started, *module, '--ros-args', '-r', f'__ns:={namespace}', *options, *arguments, stderr=log
        )
        self.process = self._start()

    def end(self, number: int = signal.SIGTERM) -> int:
        """End the node with a signal; return its exit code."""
        self.process.send_signal(number)
        return self.process.wait(ENDING)

    def restart(self, number: int) -> None:
        """End the node with a signal, and start a new process."""
        self.end(number)
        self.process = self._start()


class Cell(Node):
    """Node that receives samples and answers, and acts as the cell: clock, parameters, services."""

    def __init__(self) -> None:
        super().__init__('cell', namespace=CELL)
        self.executor_ = EventsExecutor()
        self.executor_.add_node(self)
        self._sent: dict[int, int] = {}
        self.late: dict[str, list[int]] = {name: [] for name in ANSWERS}
        self.answers = dict.fromkeys(ANSWERS, 0)
        self.samples = 0
        self.lost: dict[str, int] = {}
        self.levels: Counter[str] = Counter()
        self.offset = 0
        self._callers: dict[str, Client] = {}
        self._time_out = self.create_publisher(Clock, '/clock', 10)
        self._subscribe(JointState, f'{DEVICE}/{PISTON_STATE}', self._on_sample)
        for name, topic in ANSWERS.items():
            self._subscribe(WrenchStamped, topic, partial(self._on_answer, name))
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._on_diagnostics, OUTPUT_QOS)

    def _subscribe(self, message_type: type, topic: str, handle: Callable[[int, Mapping[str, int]], None]) -> None:
        self.create_subscription(message_type, topic, StampedCallback(handle), SAMPLE_QOS, raw=True)

    def _on_sample(self, stamp: int, info: Mapping[str, int]) -> None:
        self.samples += 1
        self._sent[stamp] = info['source_timestamp']
        if len(self._sent) > KEPT_SAMPLES:
            del self._sent[next(iter(self._sent))]

    def _on_answer(self, name: str, stamp: int, info: Mapping[str, int]) -> None:
        self.answers[name] = info['publication_sequence_number']
        if stamp in self._sent:
            self.late[name].append(info['received_timestamp'] - self._sent[stamp])

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            level = ('OK', 'WARN', 'ERROR')[ord(status.level)]
            self.levels[f'{status.name} {level}'] += 1
            self.levels[f'{status.name}, a finding'] += 'looks like' in status.message
            for value in status.values:
                if value.key == LOST:
                    self.lost[status.name] = int(value.value)

    def publish_time(self) -> None:
        message = Clock()
        message.clock = stamp_message(time.time_ns() + self.offset)
        self._time_out.publish(message)

    def call(self, service: type, name: str, request: Any) -> None:
        """Call a service if its server exists, without waiting for the answer."""
        if name not in self._callers:
            self._callers[name] = self.create_client(service, name)
        if self._callers[name].service_is_ready():
            self._callers[name].call_async(request)

    def trigger(self, name: str) -> None:
        self.call(Trigger, name, Trigger.Request())

    def set_on(self, node: str, **values: Any) -> None:
        """Set parameters of a node; two underscores in a name mean a dot."""
        parameters = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()
        ]
        self.call(SetParameters, f'{node}/set_parameters', SetParameters.Request(parameters=parameters))

    def spin(self, seconds: float) -> None:
        self.executor_.spin_once(timeout_sec=seconds)

    def until(self, condition: Callable[[], Any]) -> None:
        limit = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > limit:
                raise RuntimeError(
                    'the nodes did not find each other in time. The machine may be busy. Run the soak again'
                )
            self.publish_time()
            self.spin(0.1)


def operator() -> None:
    """Send set-points and piston commands until killed, and once a sample of the piston with a wrong clock."""
    rclpy.init()
    node = Node('operator', namespace=DEVICE)
    draw = random.Random()
    setpoints = [node.create_publisher(Float64, setpoint_topic(name), OUTPUT_QOS) for name in CYLINDERS]
    command = node.create_publisher(Float64, PISTON_COMMAND, OUTPUT_QOS)
    piston = node.create_publisher(JointState, PISTON_STATE, OUTPUT_QOS)
    for step in itertools.count():
        time.sleep(0.2)
        if step % 5 == 0:
            for out in setpoints:
                out.publish(Float64(data=draw.uniform(6e4, 9e4)))
        command.publish(Float64(data=draw.uniform(-2e-3, 2e-3)))
        if step == 200:
            foreign = JointState(name=['piston'], position=[0.0])
            foreign.header.stamp = stamp_message(time.time_ns())
            piston.publish(foreign)


class Soak:
    """The nodes, the actions on them, and the file of measurements."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._bag = folder / 'to_identify'
        self._draw = random.Random(1)
        if not self._bag.exists():
            record = [sys.executable, '-m', 'cfd_pneumatic.commands.record_rig', 'out_and_back']
            subprocess.run([*record, '--output', self._bag], check=True, stdout=subprocess.DEVNULL)
        self._log = (folder / 'nodes.log').open('wb')
        self._file = (folder / 'samples.jsonl').open('w', encoding='utf-8')
        self._cell = Cell()
        self._operator: subprocess.Popen[bytes] | None = None
        self._leaks = False
        self._identified = False
        self._kills = itertools.cycle((signal.SIGKILL, signal.SIGTERM))
        self._programs: dict[str, Program] = {}

    def _start(self) -> None:
        def start_node(name: str, namespace: str, parameters: Mapping[str, Any], inputs: Sequence[str] = ()) -> None:
            remaps = itertools.chain.from_iterable(('-r', f'{topic}:={DEVICE}/{topic}') for topic in inputs)
            reliable = {f'qos_overrides.{DEVICE}/{topic}.subscription.reliability': 'reliable' for topic in inputs}
            settings = {'use_sim_time': 'true', **reliable, **parameters}
            self._programs[name] = Program(name, namespace, self._log, settings, *remaps)

        folders = {'input_folders': f'[{self._folder}]', 'output_folder': self._folder}
        identify = {
            'bags': f'[{self._bag}]',
            'output_dir': self._folder / 'identified',
            'apply_to': SIM_NODE,
            **folders,
        }
        watch = {'area': PISTON_AREA, 'learning': 30.0, 'diagnosis_window': 20.0}
        record = {'topics': f'[{",".join(RECORDED)}]', 'output': self._folder / 'bag', 'overwrite': 'true'}
        start_node('recorder_node', CELL, record)
        start_node('sim_node', SIM, {'area': PISTON_AREA}, MODEL_INPUTS)
        start_node('monitor_node', MONITOR, watch, MONITOR_INPUTS)
        start_node('identifier_node', CELL, identify)
        self._cell.until(lambda: {SIM_NODE, MONITOR_NODE} <= {name.partition(': ')[0] for name in self._cell.levels})
        start_node('rig_node', DEVICE, {'sample_rate': 1000.0, 'device': 'paper'})
        self._operator = self._start_operator()
        self._cell.until(lambda: all(self._cell.late.values()))

    def _start_operator(self) -> subprocess.Popen[bytes]:
        return started('-c', 'from studies.trials.soak import operator; operator()', stderr=self._log)

    # actions

    def _replace_operator(self) -> None:
        assert self._operator is not None
        self._operator.kill()
        self._operator.wait()
        self._operator = self._start_operator()

    def _replace_rig(self) -> None:
        self._programs['rig_node'].restart(next(self._kills))
        self._leaks = False

    def _jump(self) -> None:
        self._cell.offset = self._draw.randrange(-(10**11), 10**11)

    def _change_parameters(self) -> None:
        tau = self._draw.uniform(5e-3, 3e-2)
        self._cell.set_on(SIM_NODE, cylinder_a__tau=[tau] * 4, axis=self._draw.choice('xyz'))
        self._cell.set_on(MONITOR_NODE, frame_id=f'cfd_{self._draw.randrange(10**6)}', axis=self._draw.choice('xyz'))

    def _change_leak(self) -> None:
        self._leaks = not self._leaks
        self._cell.set_on(RIG_NODE, faults=LEAK if self._leaks else 'none')

    def _identify(self) -> None:
        self._identified = not self._identified
        self._cell.trigger(f'{IDENTIFIER_NODE}/{"identify" if self._identified else "revert"}')

    def _reset(self) -> None:
        self._cell.trigger(f'{SIM_NODE}/reset')
        self._cell.trigger(f'{MONITOR_NODE}/learn')

    # measurements

    def _measure(self, at: float) -> None:
        for name, program in self._programs.items():
            if program.process.poll() is not None:
                raise RuntimeError(
                    f'{name} ended with code {program.process.returncode}. Its messages are in {self._log.name}'
                )
            self._write({'at': at, 'name': name, 'pid': program.process.pid, **usage_of(program.process.pid)})
        pid = self._programs['monitor_node'].process.pid
        for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
            self._write({'at': at, 'name': "monitor_node's diagnoses", 'pid': int(child), **usage_of(int(child))})
        for name, late in self._cell.late.items():
            if late:
                middle, most, longest = np.percentile(late, (50, 99, 100)).tolist()
                self._write({'at': at, 'answers_of': name, 'p50': middle, 'p99': most, 'max': longest, 'of': len(late)})
                late.clear()
        counts = {'lost': self._cell.lost, 'answers': self._cell.answers, 'samples': self._cell.samples}
        self._write({'at': at, **counts, 'levels': self._cell.levels, 'load': os.getloadavg()[0]})

    def _write(self, row: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(row) + '\n')
        self._file.flush()

    def run(self, seconds: float) -> None:
        """Run the nodes with all actions for a time."""
        cell = self._cell
        self._start()
        begin = time.monotonic()
        plan: list[tuple[float, Callable[[], None]]] = [
            (0.05, cell.publish_time),
            (7.0, self._change_parameters),
            (10.0, lambda: self._measure(time.monotonic() - begin)),
            (60.0, self._replace_operator),
            (75.0, self._change_leak),
            (90.0, self._identify),
            (280.0, self._jump),
            (700.0, self._reset),
            (900.0, self._replace_rig),
        ]
        due = [begin + period for period, _ in plan]
        while (now := time.monotonic()) < begin + seconds:
            for index, (period, act) in enumerate(plan):
                if now >= due[index]:
                    act()
                    due[index] = max(due[index] + period, now)
            cell.spin(0.02)
        self._finish(time.monotonic() - begin)

    def _finish(self, at: float) -> None:
        """End all nodes, the recorder last, and write the number of recorded messages."""
        self._measure(at)
        order = ('rig_node', 'sim_node', 'monitor_node', 'identifier_node', 'recorder_node')
        codes = {}
        for name in order:
            self._let_arrive()
            codes[name] = self._programs[name].end()
        with Reader(self._folder / 'bag') as bag:
            recorded = {connection.topic: connection.msgcount for connection in bag.connections}
        self._write({'at': at, 'recorded': recorded, 'published': self._cell.answers, 'codes': codes})

    def _let_arrive(self) -> None:
        """Wait until messages on their way have arrived, before the next node ends."""
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            self._cell.spin(0.05)

    def close(self) -> None:
        """End the processes that still run."""
        operators = [] if self._operator is None else [self._operator]
        for process in (*operators, *(program.process for program in self._programs.values())):
            if process.poll() is None:
                process.kill()
                process.wait()
        self._cell.destroy_node()


def report(path: Path) -> str:
    """Return the tables of what was seen."""
    rows = [json.loads(line) for line in path.read_text(encoding='utf-8').splitlines()]
    last = rows[-1]['at']
    lines = []
    by_name: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if 'pid' in row:
            by_name.setdefault(row['name'], []).append(row)
    for name, samples in by_name.items():
        warm = [row for row in samples if row['at'] > WARMING * last]
        grown, interval = slope([row for row in samples if row['at'] > 0.5 * last], 'own')
        spans = [span(warm, key) for key in KINDS]
        core = np.mean([_core(list(life)) for _, life in itertools.groupby(samples, lambda row: row['pid'])])
        lines.append(
            (
                name,
                f'{warm[0]["own"] / 1024:.1f}',
                f'{warm[-1]["own"] / 1024:.1f}',
                f'{grown / 1024:+.2f} ± {interval / 1024:.2f}',
                *spans,
                f'{core:.0%}',
            )
        )
    memory = table(
        (
            'process',
            'private memory at first [MiB]',
            'at last [MiB]',
            'growth in the second half [MiB/h]',
            *KINDS,
            'of a core',
        ),
        lines,
    )
    lines = []
    for name in ANSWERS:
        samples = [row for row in rows if row.get('answers_of') == name]
        tenth = max(len(samples) // 10, 1)
        lines += [
            (name, period, *(f'{np.median([row[key] for row in part]) * 1e-6:.2f}' for key in ('p50', 'p99', 'max')))
            for period, part in (('first tenth', samples[:tenth]), ('last tenth', samples[-tenth:]))
        ]
    late = table(('answers of', 'period', 'p50 [ms]', 'p99 [ms]', 'longest of 10 s [ms]'), lines)
    counts = [{key: value for key, value in row.items() if key != 'levels'} for row in rows if 'samples' in row][-1]
    end = [row for row in rows if 'recorded' in row]
    loads = [row['load'] for row in rows if 'load' in row]
    return '\n\n'.join(
        [
            f'{last / 3600:.2f} hours; load {np.median(loads):.1f}, at most {max(loads):.1f}',
            memory,
            late,
            json.dumps(counts),
            json.dumps(end),
            json.dumps([row for row in rows if 'levels' in row][-1]['levels'], indent=1),
        ]
    )


KINDS = ('threads', 'descriptors')


def _core(life: Sequence[Mapping[str, Any]]) -> float:
    first, last = life[0], life[-1]
    return (last['processor'] - first['processor']) / max(last['at'] - first['at'], 1.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the soak and print its tables."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument('--hours', type=float, default=2.0, help='duration')
    parser.add_argument('--output', type=Path, default=ROOT / 'build' / 'soak', help='folder of the measurements')
    parser.add_argument('--report', action='store_true', help='print the tables of an earlier run')
    options = parser.parse_args(arguments)
    if not options.report:
        isolate()
        options.output.mkdir(parents=True, exist_ok=True)
        rclpy.init()
        soak = Soak(options.output)
        try:
            soak.run(3600.0 * options.hours)
        finally:
            soak.close()
    print(report(options.output / 'samples.jsonl'))
    return 0


if __name__ == '__main__':
    sys.exit(main())
