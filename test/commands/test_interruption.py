# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C during a search: once for the report with the best answer, twice to end without a report."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from studies.foreign.devices import record
from studies.foreign.tables import FORMATS, write_table


@pytest.fixture(scope='module')
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp('foreign')
    return write_table(record('pi_spool', 4), next(iter(FORMATS)), folder)


def searching(table, output):
    """Start a thorough search; return the process after the search has begun."""
    path, mapping = table
    code = 'from cfd_pneumatic.runtime.start import identify_bag; import sys; sys.exit(identify_bag())'
    options = ('--mapping', str(mapping), '--close-loop', '--thorough', '--progress', 'lines', '--output', str(output))
    process = subprocess.Popen(
        [sys.executable, '-c', code, str(path), *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert any('effects with' in line for line in process.stdout)
    return process


@pytest.mark.timeout(120)
def test_a_first_interrupt_writes_the_report_with_the_best_answer(tmp_path, table):
    process = searching(table, tmp_path / 'out')
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert process.returncode == 0
    assert 'Press Ctrl-C again to end without one' in errors
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())
    assert report['interrupted'] is True
    assert report['cylinders']['cylinder_a']['not_tried']
    assert (tmp_path / 'out' / 'report.html').exists()


@pytest.mark.timeout(120)
def test_a_second_interrupt_ends_without_a_report(tmp_path, table):
    process = searching(table, tmp_path / 'out')
    process.send_signal(signal.SIGINT)
    assert any('Press Ctrl-C again' in line for line in process.stderr)
    process.send_signal(signal.SIGINT)
    process.communicate()
    assert process.returncode == 130
    assert not (tmp_path / 'out').exists()


@pytest.mark.timeout(120)
def test_sigterm_ends_without_a_report(tmp_path, table):
    process = searching(table, tmp_path / 'out')
    process.terminate()
    process.communicate()
    assert process.returncode == 130
    assert not (tmp_path / 'out').exists()
