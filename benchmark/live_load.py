# SPDX-License-Identifier: Apache-2.0
"""
A piston at 1 kHz for a live simulator in another process, and what becomes of its answers.

Stamps are the time at which a sample was published; an answer carries the stamp of its sample, so that its delay is
known when it is heard. Messages are packed and unpacked as bytes, which leaves most of a core to the simulator.
"""

from __future__ import annotations

import math
import os
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

try:
    from rclpy.experimental import EventsExecutor as Executor
except ImportError:
    Executor = SingleThreadedExecutor

RATE = 1000  # [Hz]
ANSWERS = {'cylinder_a/pressure': FluidPressure, 'cylinder_b/pressure': FluidPressure, 'contact_force': WrenchStamped}
QUEUE = QoSProfile(depth=10_000)
PATIENCE = 60.0  # [s]
LINGER = 0.5  # how long answers may take [s]
SETPOINT_EVERY = 100  # samples
SECOND = 1_000_000_000
STAMP = struct.Struct('<iI')
STAMP_AT = 4  # behind the four bytes that say how a message is encoded


@dataclass(frozen=True)
class Figures:
    """
    How a simulator served.

    Attributes
    ----------
    answered
        When its first answer was heard, after its start [s]; DDS may take up to 3 s of it to let the two meet.
    ready
        When it said that it was ready [s].
    work
        Its processor time for a sample, all threads [s].
    delays
        From sending a sample to hearing the last of its answers, of those that were answered [s].
    sent
        Samples.

    """

    answered: float
    ready: float
    work: float
    delays: np.ndarray
    sent: int

    @property
    def lost(self) -> int:
        """Samples that were not answered on every topic."""
        return self.sent - self.delays.size

    @property
    def numbers(self) -> dict[str, float]:
        """What there is to tell, in SI units; `core` is the share of a core."""
        middle, late = np.percentile(self.delays, (50, 99))
        return {
            'seconds': self.sent / RATE,
            'sent': self.sent,
            'lost': self.lost,
            'core': self.work * RATE,
            'latency_p50': float(middle),
            'latency_p99': float(late),
            'ready': self.ready,
            'answered': self.answered,
        }

    def row(self, name: str) -> str:
        """Return it as a row of a table."""
        told = self.numbers
        return (
            f'{name:<28} {self.lost:>5} of {self.sent:<7} {self.work * 1e6:>7.0f} us {told["core"]:>7.1%} '
            f'{told["latency_p50"] * 1e3:>8.3f} ms {told["latency_p99"] * 1e3:>8.3f} ms '
            f'{self.ready:>7.2f} s {self.answered:>7.2f} s'
        )


HEADING = f'{"":<28} {"unanswered":>16} {"CPU":>10} {"core":>7} {"p50":>11} {"p99":>11} {"ready":>9} {"answers":>9}'


class Load:
    """Plays the device to a simulator in a namespace."""

    def __init__(self, namespace: str) -> None:
        self._node = Node('load', namespace=namespace)
        self._executor = Executor()
        self._executor.add_node(self._node)
        self._piston = self._node.create_publisher(JointState, 'piston_state', QUEUE)
        self._setpoint = self._node.create_publisher(Float64, 'cylinder_a/setpoint', QUEUE)
        self.heard: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in ANSWERS}
        for topic, message_type in ANSWERS.items():
            self._node.create_subscription(message_type, topic, self._hear(topic), QUEUE, raw=True)
        self._sample = bytearray(serialize_message(JointState(name=['piston'], position=[0.5])))
        self._position_at = bytes(self._sample).index(struct.pack('<d', 0.5))
        self._over = threading.Event()
        self._listener = threading.Thread(target=self._listen)
        self._listener.start()

    def _hear(self, topic):
        heard = self.heard[topic]
        return lambda message: heard.append((time.time_ns(), message))

    def _listen(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self._over.set()
        self._listener.join()
        self._executor.shutdown()
        self._node.destroy_node()

    def send(self, count: int) -> list[int]:
        """Send samples at their rate; return their stamps [ns]."""
        stamps = []
        begin = time.monotonic()
        for index in range(count):
            time.sleep(max(0.0, begin + index / RATE - time.monotonic()))
            if index % SETPOINT_EVERY == 0:
                self._setpoint.publish(Float64(data=68_948.0 + 500.0 * (index // SETPOINT_EVERY % 5)))
            struct.pack_into('<d', self._sample, self._position_at, 1e-3 * math.sin(0.01 * index))
            stamp = time.time_ns()
            STAMP.pack_into(self._sample, STAMP_AT, *divmod(stamp, SECOND))
            self._piston.publish(bytes(self._sample))
            stamps.append(stamp)
        return stamps

    def until_answered(self) -> None:
        """Send until there are answers on all topics."""
        limit = time.monotonic() + PATIENCE
        while not all(self.heard.values()):
            if time.monotonic() > limit:
                raise RuntimeError('the simulator does not answer')
            self.send(5)


def delays(stamps: list[int], heard: dict[str, list[tuple[int, bytes]]]) -> np.ndarray:
    """Return for each sample that was answered on all topics how long that took [s]."""
    answered = []
    for messages in heard.values():
        times = {}
        for received, message in messages:
            seconds, rest = STAMP.unpack_from(message, STAMP_AT)
            times.setdefault(seconds * SECOND + rest, received)
        answered.append(times)
    whole = [stamp for stamp in stamps if all(stamp in times for times in answered)]
    return np.array([max(times[stamp] for times in answered) - stamp for stamp in whole]) * 1e-9


class Simulator:
    """A simulator that runs."""

    def __init__(self, command: list[str], namespace: str) -> None:
        self._begin = time.monotonic()
        self._process = subprocess.Popen(
            [*command, '--ros-args', '-r', f'__ns:={namespace}'], stderr=subprocess.PIPE, text=True
        )
        self.ready = math.nan
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stderr:
            if ']: ready for' in line:
                self.ready = self.age

    @property
    def age(self) -> float:
        """Time since its start [s]."""
        return time.monotonic() - self._begin

    @property
    def processor_time(self) -> float:
        """What all its threads have used [s]."""
        fields = Path(f'/proc/{self._process.pid}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()
        self._reader.join()


@contextmanager
def running(command: list[str]) -> Iterator[tuple[Load, Simulator]]:
    """Yield a piston and a simulator that has answered it; `command` starts it."""
    namespace = '/live'
    load = Load(namespace)
    simulator = Simulator(command, namespace)
    try:
        load.until_answered()
        yield load, simulator
    finally:
        simulator.stop()
        load.close()


def start(command: list[str]) -> tuple[float, float]:
    """Return when a simulator said that it was ready, and when its first answers were heard, after its start [s]."""
    with running(command) as (_, simulator):
        return simulator.ready, simulator.age


def serve(command: list[str], seconds: float) -> Figures:
    """Return how a simulator serves a piston for a time [s]; `command` starts it."""
    with running(command) as (load, simulator):
        answered = simulator.age
        load.send(RATE)  # both have settled then
        before = simulator.processor_time
        stamps = load.send(round(seconds * RATE))
        time.sleep(LINGER)
        work = (simulator.processor_time - before) / len(stamps)
        return Figures(answered, simulator.ready, work, delays(stamps, load.heard), len(stamps))
