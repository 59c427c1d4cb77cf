"""
What `sim_node` does with more than it can take, beside subscribers that take nothing: `make overload`.

Samples come at 1 kHz, then at 10 kHz, then at 1 kHz again; each has the time at which it was sent as its stamp. Ten
subscribers to the answers are stopped all the while.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import time
from bisect import bisect
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from cfd_pneumatic.convention import CONTACT_FORCE, DIAGNOSTICS, JOINT_STATE, PISTON_JOINT, PISTON_STATE
from cfd_pneumatic.nodes.health import LOST
from cfd_pneumatic.nodes.messages import OUTPUT_QOS, SAMPLE_QOS
from cfd_pneumatic.recording.bags.form import Form
from studies.documents import table
from studies.processes import Heard, started
from studies.ros_environment import isolate

CELL = '/overload'
DEAF = 10
PHASES = (('as usual', 1_000, 5.0), ('too much', 10_000, 10.0), ('as usual again', 1_000, 10.0))
"""Name, rate [Hz] and length [s]."""
LATE = 0.01  # an answer that comes no later than this is in time [s]
SECOND = 1_000_000_000  # [ns]


def deaf() -> None:
    """Subscribe to the answers, often, and wait to be stopped."""
    rclpy.init()
    node = Node('deaf', namespace=CELL)
    for _ in range(DEAF):
        node.create_subscription(WrenchStamped, CONTACT_FORCE, print, SAMPLE_QOS)
    time.sleep(3600.0)


def flood() -> None:
    """Send samples, phase by phase; print when each begins, and the end [ns]."""
    rclpy.init()
    node = Node('flood', namespace=CELL)
    out = node.create_publisher(JointState, PISTON_STATE, OUTPUT_QOS)
    form = Form(JOINT_STATE, joint=PISTON_JOINT)
    while not out.get_subscription_count():
        time.sleep(0.1)
    due = time.monotonic()
    for _, rate, length in PHASES:
        print(time.time_ns())
        for _ in range(round(rate * length)):
            due += 1.0 / rate
            if (early := due - time.monotonic()) > 0.0:
                time.sleep(early)
            out.publish(form.filled(time.time_ns(), 0.0))
    print(time.time_ns())


class Ear(Node):
    """Hears the answers, and what the node says of itself."""

    def __init__(self) -> None:
        super().__init__('ear', namespace=CELL)
        self.answers: list[tuple[int, int]] = []
        self.said: list[tuple[int, bool, int]] = []
        self.create_subscription(WrenchStamped, CONTACT_FORCE, Heard(self._on_answer), SAMPLE_QOS, raw=True)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._on_diagnostics, OUTPUT_QOS)

    def _on_answer(self, stamp: int, info: Mapping[str, int]) -> None:
        self.answers.append((stamp, info['received_timestamp']))

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        (status,) = array.status
        (lost,) = (int(value.value) for value in status.values if value.key == LOST)
        self.said.append((time.time_ns(), status.level == DiagnosticStatus.OK, lost))


def overload() -> str:
    """Return the table of what happened."""
    rclpy.init()
    ear, executor = Ear(), EventsExecutor()
    executor.add_node(ear)
    sim = started('-m', 'cfd_pneumatic.nodes.sim_node', '--ros-args', '-r', f'__ns:={CELL}')
    listener = started('-c', 'from studies.overload import deaf; deaf()')

    def spin_until(condition: Callable[[], object]) -> None:
        while not condition():
            executor.spin_once(timeout_sec=0.1)

    try:
        spin_until(lambda: ear.count_subscribers(f'{CELL}/{CONTACT_FORCE}') > DEAF and ear.said)
        listener.send_signal(signal.SIGSTOP)
        source = started('-c', 'from studies.overload import flood; flood()', stdout=subprocess.PIPE)
        spin_until(lambda: source.poll() is not None)
    finally:
        listener.kill()
        sim.terminate()
    assert source.stdout is not None
    return _table(ear, [int(line) for line in source.stdout])


def _table(ear: Ear, edges: Sequence[int]) -> str:
    stamps, came = np.array(ear.answers).T
    late = (came - stamps) / SECOND
    rows = []
    for (name, rate, length), (first, last) in zip(PHASES, pairwise(edges)):
        own = late[(stamps >= first) & (stamps < last)]
        said = [one for one in ear.said if first <= one[0] < last]
        rows.append(
            (
                name,
                f'{rate * length:,.0f} at {rate:,} Hz',
                f'{len(own):,}',
                f'{_lost(ear, last) - _lost(ear, first):,}',
                *(f'{1e3 * share:.2f}' for share in np.percentile(own, (50, 99))),
                f'{sum(ok for _, ok, _ in said)} of {len(said)}',
            )
        )
    heading = ('phase', 'sent', 'answered', 'told as lost', 'p50 [ms]', 'p99 [ms]', '`/diagnostics` OK')
    after = bisect(stamps, edges[2])
    tardy = np.flatnonzero(late[after:] > LATE)
    back = stamps[after + tardy[-1]] - edges[2] if len(tardy) else 0
    told = f'The last answer later than {LATE:g} s was to a sample of {back / SECOND:.2f} s after it was too much.'
    return f'{table(heading, rows)}\n\n{told}'


def _lost(ear: Ear, at: float) -> int:
    """Return how many the node had said were lost by a time [ns]."""
    return max((lost for when, _, lost in ear.said if when < at), default=0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Overload the node; print the table."""
    argparse.ArgumentParser(prog='overload', description=__doc__).parse_args(arguments)
    isolate()
    print(overload())
    return 0


if __name__ == '__main__':
    sys.exit(main())
