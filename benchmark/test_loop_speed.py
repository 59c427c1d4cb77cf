# SPDX-License-Identifier: Apache-2.0
"""
Closing the loop on a minute and on a quarter of an hour at 500 Hz, with all cores.

Cylinder A alone, a device of the panel with one effect (seeds of development); the paper's model is fitted beforehand.
"""

from __future__ import annotations

import time
from functools import cache

import pytest

from cfd_pneumatic.identification import ChannelResult, Options, close_loop, identify
from cfd_pneumatic.rig import surface_following
from studies.panel import draw
from studies.panel.rows import CYLINDER, cylinder_a_of

MINUTE, QUARTER = 60.0, 900.0
CASES = [
    ('leakage', 60, MINUTE),
    ('valve_dead_band', 12, MINUTE),
    ('sensor_lag', 3, MINUTE),
    ('heat_transfer', 7, MINUTE),
    ('leakage', 60, QUARTER),
]


@cache
def fitted(effect: str, seed: int, duration: float) -> ChannelResult:
    schedule = 'surface_following' if duration == MINUTE else surface_following(duration=duration, seed=seed)
    return identify([cylinder_a_of(draw(effect, schedule, seed))], Options()).channels[CYLINDER]


@pytest.mark.parametrize(('effect', 'seed', 'duration'), CASES)
def test_close_loop(benchmark, effect, seed, duration):
    benchmark.group = f'close the loop, {duration:.0f} s at 500 Hz'
    known = fitted(effect, seed, duration)
    shares = []

    def closed():
        begin, busy = time.perf_counter(), time.process_time()
        _, conclusion = close_loop(known.fit)
        shares.append((time.process_time() - busy) / (time.perf_counter() - begin))
        return conclusion

    conclusion = benchmark.pedantic(closed, warmup_rounds=1, rounds=3 if duration == MINUTE else 1)
    benchmark.extra_info['cores'] = max(shares[1:])
    assert conclusion.effects == (effect,)
