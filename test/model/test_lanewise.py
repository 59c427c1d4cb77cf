# SPDX-License-Identifier: Apache-2.0
"""Lanes are calculated with as floats are, and functions of them agree with the library's."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from cfd_pneumatic.model.lanes import COUNT, load, rows_address, some, store, where
from cfd_pneumatic.model.lanewise import exp, log, power, tanh, wave

EIGHT = st.lists(st.floats(-1e6, 1e6), min_size=COUNT, max_size=COUNT).map(np.array)


def in_lanes(function):
    """Return a function of arrays that has each lane compute one of their numbers."""

    @njit  # on its first call: processes that run other tests load this file, too
    def computed(x, y):
        results = np.empty(x.size)
        for place in range(0, x.size, COUNT):
            store(rows_address(results), place, function(load(rows_address(x), place), load(rows_address(y), place)))
        return results

    def of_arrays(x, y=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), y)
        filled = [np.pad(one, (0, -one.size % COUNT)) for one in (x, y)]
        return computed(*filled)[: x.size]

    return of_arrays


EXP_OF_ONE, LOG_OF_ONE, TANH_OF_ONE = (njit(lambda x, own=own: own(x)) for own in (exp, log, tanh))
EXP = in_lanes(njit(lambda x, _: exp(x)))
LOG = in_lanes(njit(lambda x, _: log(x)))
POWER = in_lanes(power)
TANH = in_lanes(njit(lambda x, _: tanh(x)))
SINE = in_lanes(njit(lambda turns, _: wave(turns)[0]))
TOLD = in_lanes(njit(lambda x, y: 1.0 if some(x > y) else 0.0))
COSINE = in_lanes(njit(lambda turns, _: wave(turns)[1]))


def plain(x, y):
    return -x + 2.0 * y - x * y / (1.0 + abs(y)) + math.sqrt(abs(x)) - min(x, y) + max(x, 3.0) * y


def chosen(x, y):
    return where(x > y, x - y, where(x >= 0.5 * y, 1.0, -y)) + where(x > 1.0, x, 0.0) + where(x <= y, 1.0, 2.0)


@pytest.mark.parametrize('function', [plain, chosen])
@given(x=EIGHT, y=EIGHT)
def test_lanes_are_calculated_with_as_floats_are(function, x, y):
    expected = [function(*pair) for pair in zip(x.tolist(), y.tolist())]
    scale = 1e-15 * (1.0 + np.abs(x)) * (1.0 + np.abs(y))
    assert np.all(np.abs(COMPILED[function](x, y) - expected) <= 10.0 * scale)


@given(x=EIGHT, y=EIGHT)
def test_what_no_lane_needs_can_be_left_out(x, y):
    assert np.all(TOLD(x, y) == float(np.any(x > y)))


COMPILED = {function: in_lanes(njit(function)) for function in (plain, chosen)}


def test_what_is_no_number_stays_so():
    nothing = np.full(COUNT, math.nan)
    for function in (EXP, TANH, in_lanes(njit(lambda x, _: min(max(x, -1.0), 1.0)))):
        assert np.all(np.isnan(function(nothing)))


@given(st.floats(-700.0, 700.0))
def test_exp_is_the_exponential(x):
    np.testing.assert_allclose(EXP([x]), math.exp(x), rtol=1e-15)


def test_exp_of_what_is_out_of_range_is_nothing_or_huge():
    assert np.all(EXP([-math.inf, -1e3]) < 1e-300)
    assert np.all(EXP([1e3, math.inf]) > 1e300)


@given(st.floats(2.3e-308, 1e308))
def test_log_is_the_natural_logarithm(x):
    np.testing.assert_allclose(LOG([x]), math.log(x), rtol=1e-15)


@given(st.floats(1e-6, 1e6), st.floats(-4.0, 4.0))
def test_power_is_a_power(x, y):
    np.testing.assert_allclose(POWER([x], [y]), x**y, rtol=2e-14)


def test_a_number_to_the_power_of_nothing_is_one():
    np.testing.assert_array_equal(POWER([2.0, 1e-9, 0.0, 1e300], np.zeros(4)), 1.0)


def test_nothing_to_a_power_is_nothing():
    assert np.all(POWER([0.0, -0.0, 5e-324], np.ones(3)) < 1e-300)


def test_there_is_no_power_of_a_negative_number():
    assert np.all(np.isnan(POWER([-5e-324, -2.0, -math.inf], np.full(3, 0.5))))


@given(st.floats(1e-3, 1e3))
def test_of_one_number_they_are_what_they_are_of_lanes(x):
    for own, of_one, of_lanes in ((exp, EXP_OF_ONE, EXP), (log, LOG_OF_ONE, LOG), (tanh, TANH_OF_ONE, TANH)):
        np.testing.assert_allclose(of_one(x), of_lanes([x]), rtol=1e-15, atol=1e-15)
        np.testing.assert_allclose(own(x), of_one(x), rtol=1e-14, atol=1e-14)  # as Python calculates


@given(st.floats(-1e3, 1e3))
def test_tanh_is_the_hyperbolic_tangent(x):
    np.testing.assert_allclose(TANH([x]), math.tanh(x), rtol=0.0, atol=1e-15)


def test_tanh_has_no_steps():
    assert np.all(np.diff(TANH(np.linspace(-25.0, 25.0, 5001))) >= -1e-15)


@given(st.integers(-10_000, 10_000), st.floats(-0.5, 0.5))
def test_a_wave_is_sine_and_cosine(whole, part):
    turns = whole + part
    angle = 2.0 * math.pi * (turns - whole)
    np.testing.assert_allclose([SINE([turns]), COSINE([turns])], [[math.sin(angle)], [math.cos(angle)]], atol=1e-13)
