"""`monitor_node` beside the rig in a graph: how late its predictions are, and whether one is missing."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from studies.ros_environment import isolate

isolate()

import rclpy  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.experimental import EventsExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import FluidPressure, JointState  # noqa: E402

from cfd_pneumatic.convention import PISTON_STATE, PREDICTED, pressure_topic  # noqa: E402
from cfd_pneumatic.device.identified import identified_device  # noqa: E402
from cfd_pneumatic.identification import identify  # noqa: E402
from cfd_pneumatic.recording import recording_of  # noqa: E402
from cfd_pneumatic.rig import record, surface_following  # noqa: E402

NAMESPACE = '/figures'  # of the device, and of the monitor
LEARNING = 20.0
QUEUE = QoSProfile(depth=20_000)


class Ear(Node):
    """Hears the device and the monitor, and when."""

    def __init__(self) -> None:
        """Listen."""
        super().__init__('ear', namespace=NAMESPACE)
        self._events = EventsExecutor()
        self._events.add_node(self)
        self.piston: dict[int, float] = {}
        self.predicted: dict[int, float] = {}
        self.learned = False
        predicted = PREDICTED + pressure_topic('cylinder_b')
        self.create_subscription(JointState, PISTON_STATE, partial(note, self.piston), QUEUE)
        self.create_subscription(FluidPressure, predicted, partial(note, self.predicted), QUEUE)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, QUEUE)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.learned |= any('agrees' in status.message for status in array.status)

    def until(self, done: Callable[[], bool]) -> None:
        """Hear until something is done."""
        while not done():
            self._events.spin_once(timeout_sec=0.1)

    def spin(self, seconds: float) -> tuple[float, float]:
        """Hear for a while; return its begin and end."""
        begin = time.monotonic()
        self.until(lambda: time.monotonic() > begin + seconds)
        return begin, time.monotonic()

    def figures(self, begin: float, end: float) -> dict[str, float]:
        """Return what was heard of the samples that came between two times."""
        stamps = [stamp for stamp, at in self.piston.items() if begin <= at < end]
        late = [1e3 * (self.predicted[stamp] - self.piston[stamp]) for stamp in stamps if stamp in self.predicted]
        p50, p99, most = np.quantile(late, [0.5, 0.99, 1.0]).tolist()
        return {'samples': len(stamps), 'lost': len(stamps) - len(late), 'p50': p50, 'p99': p99, 'max': most}


def note(heard: dict[int, float], message: JointState | FluidPressure) -> None:
    """Note when a message came, by its stamp."""
    heard[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec] = time.monotonic()


def start(node: str, *arguments: str, **parameters: object) -> subprocess.Popen:
    """Start a node beside the others."""
    settings = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    program = [sys.executable, '-m', f'cfd_pneumatic.nodes.{node}', '--ros-args', '-r', f'__ns:={NAMESPACE}']
    return subprocess.Popen([*program, *arguments, *settings], stderr=subprocess.DEVNULL)


def latencies(seconds: float) -> dict[str, dict[str, float]]:
    """Return how late predictions are [ms] while nothing is diagnosed, and while the loop is being closed."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'parameters.yaml'
        got = record(surface_following(duration=20.0, seed=1), seed=1)
        file.write_text(identified_device(identify([recording_of(got)])).text)
        rclpy.init()
        ear = Ear()
        nodes = [
            start('monitor_node', '--params-file', str(file), learning=LEARNING, diagnosis_window=60.0),
            start('rig_node', schedule='surface_following', repeat='true', start_subscribers=2, start_delay=1.0),
        ]
        try:
            ear.until(lambda: bool(ear.predicted))
            ear.spin(2.0)
            idle = ear.spin(LEARNING - 5.0)
            ear.until(lambda: ear.learned)
            ear.spin(3.0)  # the loop over the healthy device has begun, and takes a minute for this rig
            busy = ear.spin(seconds)
            ear.spin(1.0)
            return {'nothing to diagnose': ear.figures(*idle), 'while the loop is being closed': ear.figures(*busy)}
        finally:
            for node in nodes:
                node.terminate()
                node.wait()
            rclpy.shutdown()
