# SPDX-License-Identifier: Apache-2.0
"""What all benchmarks share: where their helpers are, lines shown at the end, and what is told of the run."""

from __future__ import annotations

import os
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before NumPy is loaded, as programs have it
sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ('', 'test')]

TABLE = []
LOAD = os.getloadavg()
LIBRARIES = ('numpy', 'numba', 'scipy', 'rosbags', 'casadi', 'ros-jazzy-rclpy', 'distributed')


@pytest.fixture(scope='session')
def table():
    """Return the lines that are shown at the end."""
    return TABLE


def pytest_terminal_summary(terminalreporter):
    for line in TABLE:
        terminalreporter.write_line(line)


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_json(output_json):
    from studies.tools.provenance import commit, machine

    output_json['machine'] = machine()
    output_json['commit'] = commit()
    output_json['libraries'] = dict(_versions())
    output_json['load'] = {'before': LOAD[0], 'after': os.getloadavg()[0]}


def _versions():
    for name in LIBRARIES:
        try:
            yield name, version(name)
        except PackageNotFoundError:
            continue
