# SPDX-License-Identifier: Apache-2.0
"""Time limits of the tests grow with the load."""

from __future__ import annotations

import os
import time

import pytest
from patience import allowed, wait_until


@pytest.fixture
def load(monkeypatch):
    """Return what sets the processes that wait for each core."""
    return lambda each: monkeypatch.setattr(os, 'getloadavg', lambda: (each * os.cpu_count(), 0.0, 0.0))


def test_a_limit_is_longer_on_a_busy_machine_and_never_shorter(load):
    load(0.1)
    assert allowed(10.0) == 10.0
    load(8.0)
    assert allowed(10.0) == pytest.approx(80.0)


def test_a_wait_is_longer_where_the_load_rises_meanwhile(load):
    load(0.1)
    begin = time.monotonic()
    with pytest.raises(AssertionError, match='nothing of the kind'):
        wait_until(lambda: False, seconds=0.05)
    assert wait_until(lambda: time.monotonic() > begin + 0.6, seconds=0.3, meanwhile=lambda: load(100.0))


def test_the_limit_of_each_test_is_such_a_limit(request):
    pytest.importorskip('pytest_timeout', reason='pytest-timeout is not here')
    if request.config.getoption('timeout') is None:
        assert request.node.get_closest_marker('timeout').args[0] >= float(request.config.getini('timeout'))
