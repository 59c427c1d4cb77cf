"""
What an hour's fit and the reading of a bag hold in memory, arrays included, each in a process of its own.

    CFD_PNEUMATIC_MESSAGES=10000000 make benchmark ARGS='-k memory'
"""

from __future__ import annotations

from dataclasses import asdict

import pytest
from growth import cost
from test_reading_speed import MESSAGES

SIZES = {'fit': 3_600_000, 'read_mcap': MESSAGES, 'read_sqlite3': MESSAGES}


@pytest.mark.parametrize('work', SIZES)
def test_memory(benchmark, work):
    benchmark.group = 'measure memory'
    found = benchmark.pedantic(cost, (work, SIZES[work]), rounds=1)
    benchmark.extra_info.update(asdict(found))
    assert found.peak > 0
