"""The smoothed displacement: closer to the truth than the measured one, honest about how close."""

import numpy as np
import pytest
from reference import step_like

from cfd_pneumatic.identification.motion import smooth_motion
from cfd_pneumatic.identification.noise import sample_noise


def slow_strokes(seed, noise=4e-5):
    """Return irregular times [s], true and measured displacement [m] as on the measured cylinder."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.010, 0.011, 0.012], 3000))
    truth = 0.02 * np.cos(2.0 * np.pi * times / 7.0)
    return times, truth, truth + noise * rng.normal(size=3000)


@pytest.mark.parametrize('seed', range(5))
def test_takes_most_of_the_noise_off_slow_strokes(seed):
    times, truth, measured = slow_strokes(seed)
    motion = smooth_motion(times, measured)
    error = motion.displacement - truth
    assert motion.noise == pytest.approx(4e-5, rel=0.05)
    assert np.std(error) < 0.35 * 4e-5
    assert np.std(error) == pytest.approx(np.sqrt(np.mean(motion.std**2)), rel=0.35)


def test_leaves_a_step_of_few_samples_alone():
    times = np.arange(350) * 0.002
    truth = step_like(0.0987, 0.012, 1.5e-3)(times)
    measured = truth + 5e-7 * np.random.default_rng(0).normal(size=350)
    motion = smooth_motion(times, measured)
    np.testing.assert_allclose(motion.displacement, truth, atol=4e-6)


def test_follows_the_motion_between_samples():
    """A straight line between samples 2 ms apart strays 30 um from a step of 12 ms; K_x makes 20 mpsi of that."""
    piston = step_like(0.0987, 0.012, 1.5e-3)
    times = np.arange(350) * 0.002
    motion = smooth_motion(times, piston(times) + 5e-7 * np.random.default_rng(0).normal(size=350))
    between = times[:-1] + 0.001
    straight = np.interp(between, times, piston(times)) - piston(between)
    knots = motion.knots()
    curved = np.interp(between, knots, motion.at(knots)) - piston(between)
    assert np.max(np.abs(straight)) > 1.5e-5
    assert np.max(np.abs(curved)) < 0.4 * np.max(np.abs(straight))
    assert np.all(np.isin(times, knots))
    assert np.all(np.diff(knots) > 0.0)


def test_a_slow_motion_needs_no_knots_between_its_samples():
    times, _, measured = slow_strokes(0)
    np.testing.assert_array_equal(smooth_motion(times, measured).knots(), times)


def test_does_not_depend_on_units():
    times, _, measured = slow_strokes(3)
    metres = smooth_motion(times, measured)
    inches = smooth_motion(times / 60.0, measured / 0.0254)
    np.testing.assert_allclose(inches.displacement * 0.0254, metres.displacement, atol=1e-9)
    assert inches.noise * 0.0254 == pytest.approx(metres.noise, rel=1e-6)


@pytest.mark.parametrize('seed', range(5))
def test_sample_noise_is_what_was_added(seed):
    times, _, measured = slow_strokes(seed)
    assert sample_noise(times, measured) == pytest.approx(4e-5, rel=0.06)


def test_sample_noise_overlooks_a_transient():
    times = np.arange(350) * 0.002
    signal = step_like(0.0987, 0.012, 1e4)(times) + 50.0 * np.random.default_rng(2).normal(size=350)
    assert sample_noise(times, signal) == pytest.approx(50.0, rel=0.12)
