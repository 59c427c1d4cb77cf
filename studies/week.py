"""
A week of a device within minutes, through the callbacks that DDS calls: `make week`.

Samples come at 20 Hz, for some seconds of each hour at 1 kHz, as a rig gives them. Timers are called once for each
second of the device. A node runs as it is, but for an executor: nothing waits.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rich.progress import track
from std_msgs.msg import Float64

from cfd_pneumatic.convention import (
    AMBIENT_PRESSURE,
    CYLINDERS,
    FLUID_PRESSURE,
    JOINT_STATE,
    MEASURED_FORCE,
    PISTON_JOINT,
    PISTON_STATE,
    WRENCH_STAMPED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.nodes.model_node import ModelNode
from cfd_pneumatic.nodes.monitor_node import MonitorNode
from cfd_pneumatic.nodes.sim_node import SimNode
from cfd_pneumatic.recording.bags.form import Form
from cfd_pneumatic.rig import RigRecord, device_named, record, surface_following
from cfd_pneumatic.units import PSI
from studies.documents import table
from studies.processes import seen_of, slope, span
from studies.rig_runs import EPOCH
from studies.ros_environment import isolate

NODES: dict[str, Callable[[], ModelNode]] = {'sim_node': SimNode, 'monitor_node': MonitorNode}
ROUND = 60.0  # at 20 Hz; the way back to where it began comes on top [s]
BURST = 10.0  # at 1 kHz, likewise [s]
HOUR = 3600.0
SECOND = 1_000_000_000  # [ns]


@dataclass
class Passed:
    """
    What has gone through a node.

    Attributes
    ----------
    stamp
        Of the last sample [ns].
    samples
        Of the piston.
    messages
        On all topics.

    """

    stamp: int = EPOCH
    samples: int = 0
    messages: int = 0


class Feed:
    """Calls what a node has subscribed with, as DDS does, and its timers."""

    def __init__(self, node: Node) -> None:
        self._callbacks = {one.topic_name.removeprefix('/'): one.callback for one in node.subscriptions}
        self._timers = [timer.callback for timer in node.timers]
        self._numbers = dict.fromkeys(self._callbacks, 0)
        self._forms = {
            PISTON_STATE: Form(JOINT_STATE, joint=PISTON_JOINT),
            MEASURED_FORCE: Form(WRENCH_STAMPED),
            **{pressure_topic(name): Form(FLUID_PRESSURE) for name in CYLINDERS},
        }
        self._ticked = 0
        self.passed = Passed()

    def _send(self, topic: str, *what: Any) -> None:
        """Send a message, or a stamp [ns] and a number, if somebody hears it."""
        if topic in self._callbacks:
            self._numbers[topic] += 1
            info = {'publication_sequence_number': self._numbers[topic], 'received_timestamp': time.time_ns()}
            message = what[0] if len(what) == 1 else self._forms[topic].filled(*what)
            self._callbacks[topic](message, info)
            self.passed.messages += 1

    def play(self, record: RigRecord, period: float) -> None:
        """Send what a rig recorded with a sampling period [s], behind what was sent before."""
        step = round(period * SECOND)
        held = None
        columns = (record.displacement, record.pressures, record.force, record.setpoints)
        for position, pressures, force, setpoints in zip(*(column.tolist() for column in columns)):
            stamp = self.passed.stamp = self.passed.stamp + step
            if setpoints != held:
                held = setpoints
                for name, setpoint in zip(CYLINDERS, setpoints):
                    self._send(setpoint_topic(name), Float64(data=setpoint - AMBIENT_PRESSURE))
            self._send(PISTON_STATE, stamp, position)
            for name, pressure in zip(CYLINDERS, pressures):
                self._send(pressure_topic(name), stamp, pressure)
            self._send(MEASURED_FORCE, stamp, force)
            self.passed.samples += 1
            if stamp // SECOND != self._ticked:
                self._ticked = stamp // SECOND
                for tick in self._timers:
                    tick()


def hours(feed: Feed, count: int) -> Iterator[int]:
    """Play hours; yield the number of each that is over."""
    slow, fast = 0.05, 0.001
    device = device_named('paper')
    schedules = (
        surface_following(setpoint_b=10.0 * PSI, duration=duration, sampling_period=period, seed=1).with_return()
        for duration, period in ((ROUND, slow), (BURST, fast))
    )
    round_, burst = (record(schedule, device) for schedule in schedules)
    for hour in range(count):
        end = feed.passed.stamp + round(HOUR * SECOND)
        while feed.passed.stamp < end:
            feed.play(round_, slow)
        feed.play(burst, fast)
        yield hour


def week(name: str, days: float) -> list[object]:
    """Return a row of the table: what a node is like after some days."""
    node = NODES[name]()
    feed = Feed(node)
    rows = []
    count = round(24 * days)
    began = time.monotonic()
    with suppress(KeyboardInterrupt):  # then the table tells of the time until then
        for hour in track(hours(feed, count), description=name, total=count, disable=not sys.stderr.isatty()):
            gc.collect()
            rows.append({'at': HOUR * hour, 'pid': 0, 'objects': sys.getallocatedblocks(), **seen_of(os.getpid())})
    passed, counts = feed.passed, node._health.counts
    grown, interval = slope(rows, 'own')
    node.destroy_node()
    spans = [span(rows, key) for key in ('threads', 'descriptors')]
    return [
        f'`{name}`',
        f'{len(rows) / 24:.2g}',
        f'{passed.samples:,} ({passed.messages:,})',
        f'{passed.samples - counts["samples"]:,}',
        f'{counts["resets"]:,}',
        f'{rows[0]["own"] / 1024:.1f} to {rows[-1]["own"] / 1024:.1f}',
        f'{24 * grown:+.1f} ± {24 * interval:.1f}',
        f'{rows[len(rows) // 10]["objects"]:,} to {rows[-1]["objects"]:,}',
        *spans,
        f'{(time.monotonic() - began) / 60.0:.0f}',
    ]


HEADING = (
    'node', 'days', 'samples (messages)', 'unanswered', 'resets', 'own memory [MiB]', 'grows by [KiB/day]',
    'blocks of Python', 'threads', 'descriptors', 'took [min]',
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Let a week pass; print the table."""
    parser = argparse.ArgumentParser(prog='week', description=__doc__)
    parser.add_argument('--days', type=float, default=7.0, help='how many')
    parser.add_argument('--node', choices=NODES, nargs='*', default=list(NODES), help='which')
    options = parser.parse_args(arguments)
    isolate()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # else an interrupt takes the context away
    print(table(HEADING, [week(name, options.days) for name in options.node]))
    return 0


if __name__ == '__main__':
    sys.exit(main())
