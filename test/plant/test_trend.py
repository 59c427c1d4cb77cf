# SPDX-License-Identifier: Apache-2.0
"""What drifts from bag to bag, and what only seems to."""

from __future__ import annotations

import numpy as np
import pytest

from cfd_pneumatic.plant.trend import CHANCE, trend_of


def test_wear_is_told_with_its_size():
    rng = np.random.default_rng(1)
    places = np.linspace(0.0, 1.0, 20)
    values = 1e-10 * (1.0 + 2.0 * places) + 1e-11 * rng.standard_normal(20)
    values[7] = 1e-8  # a bag that went astray
    found = trend_of(places.tolist(), values.tolist())
    assert found.first == pytest.approx(1e-10, rel=0.2)
    assert found.last == pytest.approx(3e-10, rel=0.1)


def test_what_does_not_drift_seems_to_as_rarely_as_is_said():
    rng = np.random.default_rng(2)
    places = np.linspace(0.0, 1.0, 12).tolist()
    series = rng.standard_normal((10_000, 12)).tolist()
    assert sum(trend_of(places, one) is not None for one in series) <= 10_000 * CHANCE + 4


@pytest.mark.parametrize(
    'values',
    [
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],  # so few may be in order by chance
        [1.0] * 20,
        [None] * 20,
        [None, *[1.0] * 2, None],
        (1.0 + 1e-3 * np.arange(20)).tolist(),  # by 2 % in all
    ],
)
def test_what_is_no_drift(values):
    assert trend_of(range(len(values)), values) is None


def test_bags_without_the_value_are_passed_over():
    found = trend_of(range(20), [None if place % 2 else 5.0 - 0.1 * place for place in range(20)])
    assert (found.first, found.last) == pytest.approx((5.0, 3.2))
