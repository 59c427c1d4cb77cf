# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from generated import SHIFTS, start, write_plant


@pytest.fixture(scope='session')
def small(tmp_path_factory):
    """Three devices, some shifts each."""
    return write_plant(tmp_path_factory.mktemp('small') / 'plant', 3, SHIFTS)


@pytest.fixture(scope='session')
def small_results(small, tmp_path_factory):
    """Return what a run that nothing disturbs writes."""
    folder = tmp_path_factory.mktemp('small') / 'results'
    run = start('plant', '--each', '--jobs', 1, '--output', folder, cwd=small.parent)
    _, complaints = run.communicate()
    assert (run.returncode, complaints) == (0, '')
    return folder
