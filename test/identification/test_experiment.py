# SPDX-License-Identifier: Apache-2.0
"""An experiment in pieces, and the part of it that is worth a first look."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from drawn import CHANNEL
from hypothesis import given
from hypothesis import strategies as st

from cfd_pneumatic.identification.data import experiment as module
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.fit import fit_model
from cfd_pneumatic.model import Cylinder, OperatingPoints

AMBIENT = 101_325.0
GAINS = np.array([4.33e6, 104.0, 19.4, 0.0105])


def made(times, displacement, samples, pressure=None):
    size = len(samples)
    return Experiment(
        recording='made',
        times=times,
        inputs={'displacement': displacement, 'setpoint': np.full(times.size, AMBIENT + 34e3)},
        samples=np.asarray(samples),
        measured=np.arange(size, dtype=float) if pressure is None else pressure[samples],
        part=np.zeros(size, dtype=np.int8),
        starts_at_rest=True,
        motion=None,
    )


@given(st.lists(st.integers(0, 60), min_size=1, max_size=40, unique=True).map(sorted), st.integers(1, 7))
def test_blocks_hold_each_sample_once_and_every_step_up_to_the_last(samples, size):
    times = np.arange(61.0)
    one = made(times, 0.0 * times, samples)
    before, module.BLOCK_SAMPLES = module.BLOCK_SAMPLES, size
    try:
        blocks = list(one.blocks())
    finally:
        module.BLOCK_SAMPLES = before
    at = np.concatenate([block.times[block.sample_indices] for block in blocks])
    np.testing.assert_array_equal(at, times[samples])
    np.testing.assert_array_equal(np.concatenate([one.measured[block.samples] for block in blocks]), one.measured)
    assert blocks[0].times[0] == 0.0
    for block, following in pairwise(blocks):
        assert following.times[0] == block.times[-1], 'a block begins with the last grid time of the one before'
    assert blocks[-1].times[-1] == samples[-1]


def test_few_lines_from_sample_to_sample_are_a_parabola():
    lines = 3
    times = 1e-3 * np.arange(61.0)
    accelerations = np.repeat(np.linspace(-5.0, 8.0, 20), lines)
    since = np.arange(60) % lines * 1e-3
    displacement = np.append(0.5 * accelerations * since * (since - lines * 1e-3), 0.0)
    one = made(times, displacement, np.arange(0, 61, lines))
    found = one.parabolic
    np.testing.assert_array_equal(found.times, one.sample_times)
    np.testing.assert_array_equal(found.sample_times, one.sample_times)
    mean_of_lines = 1.0 - 1.0 / lines**2  # of the parabola's
    np.testing.assert_allclose(found.inputs['acceleration'][1:], mean_of_lines * accelerations[::lines], rtol=1e-9)
    np.testing.assert_allclose(found.inputs['displacement'], 0.0, atol=1e-18)
    assert found.parabolic is None, 'no line goes'


def test_a_parabola_ends_where_a_set_point_changes_and_where_the_piston_is_sudden():
    times = 1e-3 * np.arange(61.0)
    setpoint = np.where(times > 0.0315, 1e5, 2e5)  # on the step that ends there
    samples = [*range(0, 40, 3), *range(48, 61, 3)]
    one = made(times, strokes(times, times < 0.03), samples)
    found = replace(one, inputs={**one.inputs, 'setpoint': setpoint}).parabolic
    np.testing.assert_array_equal(found.times, times[sorted({*samples, 31, *range(39, 49)})])
    np.testing.assert_array_equal(found.inputs['setpoint'], np.where(found.times > 0.0315, 1e5, 2e5))
    lines = np.concatenate([[False], np.diff(found.times) < 1.5e-3])
    np.testing.assert_array_equal(found.inputs['acceleration'][lines], 0.0)


def strokes(times, lively):
    """Return strokes of a tenth of a millimetre, so many times longer where they are `lively`."""
    return 1e-4 * (1.0 + 9.0 * lively) * np.sin(3.0 * times)


def test_the_liveliest_part_is_one_that_counts():
    times = 0.01 * np.arange(10_001)
    one = made(
        times, strokes(times, 1.0 * ((times > 30.0) & (times < 40.0)) + 2.0 * (times > 80.0)), np.arange(0, 10_001, 2)
    )
    counts = one.sample_times < 60.0
    one = replace(one, chosen=counts)
    samples = one.liveliest(1000)
    part = one.stretch(samples)
    assert 999 <= part.times.size <= 1001
    np.testing.assert_array_equal(part.measured, one.measured[samples])
    np.testing.assert_array_equal(part.sample_times, one.sample_times[samples])
    assert 27.0 <= part.times[0] <= 33.0
    assert one.stretch(replace(one, chosen=counts | True).liveliest(1000)).times[0] > 79.0
    assert one.stretch(one.liveliest(20_000)) is one


def test_a_long_recording_that_is_lively_only_where_nothing_counts_is_fitted():
    times = 0.002 * np.arange(150_001)
    displacement = strokes(times, times > 200.0)
    pressure = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT).simulate(
        times, displacement, np.full(times.size, AMBIENT + 34e3)
    )
    one = made(times, displacement, np.arange(times.size), pressure + np.random.default_rng(0).normal(size=times.size))
    found = fit_model(CHANNEL, [replace(one, chosen=times < 180.0)])
    np.testing.assert_allclose(found.model.parameters[:3], GAINS[:3], rtol=0.02)
