"""`monitor_node` beside the rig in a graph: how late its predictions are, and whether one is missing."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from patrol import recording_of
from ros_environment import isolate

isolate()

import rclpy  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.experimental import EventsExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import FluidPressure, JointState  # noqa: E402

from cfd_pneumatic.convention import (  # noqa: E402
    CYLINDERS,
    MEASURED_FORCE,
    PISTON_STATE,
    PREDICTED,
    pressure_topic,
    setpoint_topic,
)
from cfd_pneumatic.identification import identify  # noqa: E402
from cfd_pneumatic.reporting import parameter_file  # noqa: E402
from cfd_pneumatic.rig import record, surface_following  # noqa: E402

DEVICE, MONITOR = '/figures/device', '/figures/monitor'
LEARNING = 20.0
QUEUE = QoSProfile(depth=20_000)
MEASURED = (PISTON_STATE, *map(setpoint_topic, CYLINDERS), *map(pressure_topic, CYLINDERS), MEASURED_FORCE)


class Ear:
    """Hears the device and the monitor, and when."""

    def __init__(self) -> None:
        self.node = Node('ear')
        self.executor = EventsExecutor()
        self.executor.add_node(self.node)
        self.heard: dict[str, dict[int, float]] = {'piston': {}, 'predicted': {}}
        self.said: dict[str, str] = {}
        predicted = f'{MONITOR}/{PREDICTED}{pressure_topic("cylinder_b")}'
        self._listen(JointState, f'{DEVICE}/{PISTON_STATE}', self.heard['piston'])
        self._listen(FluidPressure, predicted, self.heard['predicted'])
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, QUEUE)

    def _listen(self, kind: type, topic: str, heard: dict[int, float]) -> None:
        def note(message: JointState | FluidPressure) -> None:
            heard[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec] = time.monotonic()

        self.node.create_subscription(kind, topic, note, QUEUE)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.said.update({status.name: status.message for status in array.status})

    def learned(self) -> bool:
        """Tell whether the monitor has ended learning."""
        return any('agrees' in message for message in self.said.values())

    def spin(self, seconds: float) -> None:
        """Hear for a while."""
        limit = time.monotonic() + seconds
        while (left := limit - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=min(left, 0.1))

    def figures(self, begin: float, end: float) -> dict[str, float]:
        """Return what was heard of the samples that came between two times."""
        piston, predicted = self.heard['piston'], self.heard['predicted']
        stamps = [stamp for stamp, at in piston.items() if begin <= at < end]
        late = np.array([1e3 * (predicted[stamp] - piston[stamp]) for stamp in stamps if stamp in predicted])
        return {
            'samples': len(stamps),
            'lost': len(stamps) - late.size,
            'p50': float(np.quantile(late, 0.5)),
            'p99': float(np.quantile(late, 0.99)),
            'max': float(np.max(late)),
        }


def latencies(seconds: float) -> dict[str, dict[str, float]]:
    """Return how late predictions are [ms] while nothing is diagnosed, and while the loop is being closed."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'parameters.yaml'
        got = record(surface_following(duration=20.0, seed=1), seed=1)
        file.write_text(parameter_file(identify([recording_of(got)])))
        remaps = [argument for topic in MEASURED for argument in ('-r', f'{topic}:={DEVICE}/{topic}')]
        rig = ['rig_node', '--ros-args', '-r', f'__ns:={DEVICE}', '-p', 'schedule:=surface_following']
        rig += ['-p', 'repeat:=true', '-p', 'start_subscribers:=2', '-p', 'start_delay:=1.0']
        monitor = ['monitor_node', '--ros-args', '-r', f'__ns:={MONITOR}', '--params-file', str(file), *remaps]
        monitor += ['-p', f'learning:={LEARNING}', '-p', 'diagnosis_window:=60.0']
        rclpy.init()
        ear = Ear()
        nodes = [
            subprocess.Popen(
                [sys.executable, '-m', f'cfd_pneumatic.nodes.{module}', *arguments], stderr=subprocess.DEVNULL
            )
            for module, *arguments in (monitor, rig)
        ]
        try:
            while not ear.heard['predicted']:
                ear.spin(0.5)
            ear.spin(2.0)
            begin = time.monotonic()
            ear.spin(LEARNING - 5.0)
            idle = begin, time.monotonic()
            while not ear.learned():
                ear.spin(0.5)
            ear.spin(3.0)  # the loop over the healthy device has begun, and takes a minute for this rig
            begin = time.monotonic()
            ear.spin(seconds)
            busy = begin, time.monotonic()
            ear.spin(1.0)
            return {
                'nothing to diagnose': ear.figures(*idle),
                'while the loop is being closed': ear.figures(*busy),
            }
        finally:
            for node in nodes:
                node.terminate()
                node.wait()
            rclpy.shutdown()
