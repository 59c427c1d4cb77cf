# SPDX-License-Identifier: Apache-2.0
"""
`sim_node` against the same model in a node with a timer and the default executor, in the same run.

    CFD_PNEUMATIC_SECONDS=600 make benchmark ARGS='-k live'

Two cylinders, a piston at 1 kHz and a set-point ten times a second, answers heard in another process. CPU is the
processor time for one sample, of all threads; latency is from sending a sample until its last answer is heard. By
default 10 seconds.
"""

from __future__ import annotations

import os
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from cfd_pneumatic.convention import CYLINDERS
from studies.tools.ros_environment import isolate

pytest.importorskip('rclpy', reason='ROS 2 is not to be had here')
isolate()

import rclpy  # noqa: E402
from live_load import HEADING, RATE, serve, start  # noqa: E402

SECONDS = float(os.environ.get('CFD_PNEUMATIC_SECONDS', 10.0))
STARTS = 5
SIM_NODE = [sys.executable, '-m', 'cfd_pneumatic.nodes.sim_node']
SWITCHED_ON = [('-p', f'{name}.physical_core.enabled:=true') for name in CYLINDERS]
PHYSICAL = [*SIM_NODE, '--ros-args', *chain.from_iterable(SWITCHED_ON)]
PEER = [sys.executable, str(Path(__file__).with_name('live_peer.py'))]


@pytest.fixture(scope='module')
def report(table):
    """Return what takes a row of the table."""
    rclpy.init()
    table += [
        f'live at {RATE} Hz for {SECONDS:g} s; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before',
        HEADING,
    ]
    yield table.append
    rclpy.shutdown()


def timed(benchmark, command):
    """Return how a simulator served; the time of the round itself tells nothing."""
    benchmark.group = f'live at {RATE} Hz for {SECONDS:g} s'
    figures = benchmark.pedantic(serve, (command, SECONDS), rounds=1)
    benchmark.extra_info.update(figures.numbers)
    return figures


def test_sim_node(benchmark, report):
    figures = timed(benchmark, SIM_NODE)
    report(figures.row('sim_node'))
    assert figures.lost == 0


def test_sim_node_with_the_physical_core(benchmark, report):
    figures = timed(benchmark, PHYSICAL)
    report(figures.row('sim_node, physical core'))
    assert figures.lost == 0


def test_timer_and_default_executor(benchmark, report):
    report(timed(benchmark, PEER).row('timer, default executor'))


def test_start(benchmark, report):
    benchmark.group = 'start of sim_node'
    starts = []
    benchmark.pedantic(lambda: starts.append(start(SIM_NODE)), rounds=STARTS, warmup_rounds=1)
    ready, answered = np.transpose(starts[1:])
    benchmark.extra_info.update(ready=ready.tolist(), answered=answered.tolist())
    for what, seconds in (('ready', ready), ('answers', answered)):
        report(f'{STARTS} starts of sim_node, {what}: {np.median(seconds):.2f} s, at most {np.max(seconds):.2f} s')
