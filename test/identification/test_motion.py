# SPDX-License-Identifier: Apache-2.0
"""The smoothed displacement: closer to the truth than the measured one, honest about how close."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import step_like
from scipy.special import factorial

from cfd_pneumatic.identification.data import motion as module
from cfd_pneumatic.identification.data import smoother
from cfd_pneumatic.identification.data.motion import smooth_motion
from cfd_pneumatic.identification.residual.noise import sample_noise


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
    assert np.std(error) == pytest.approx(motion.uncertainty, rel=0.35)


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
    curved = np.interp(between, knots, motion.displacement_at(knots)) - piston(between)
    assert np.max(np.abs(straight)) > 1.5e-5
    assert np.max(np.abs(curved)) < 0.4 * np.max(np.abs(straight))
    assert np.all(np.isin(times, knots))
    assert np.all(np.diff(knots) > 0.0)


def test_a_slow_motion_needs_no_knots_between_its_samples():
    times, _, measured = slow_strokes(0)
    np.testing.assert_array_equal(smooth_motion(times, measured).knots(), times)


def surface(times, seed=0):
    """Return displacement [m], rate and acceleration over a surface: sines up to 12 Hz, 1 mm rms."""
    rng = np.random.default_rng(seed)
    frequencies = rng.uniform(0.1, 12.0, 40)
    heights = rng.normal(size=40) / np.hypot(1.0, frequencies / 3.0)
    heights *= 1e-3 / np.sqrt(0.5 * np.sum(heights**2))
    omega = 2.0 * np.pi * frequencies
    phases = omega * times[:, None] + rng.uniform(0.0, 2.0 * np.pi, 40)
    return tuple((heights * omega**i * np.sin(phases + 0.5 * np.pi * i)).sum(axis=1) for i in range(3))


@pytest.mark.parametrize('seed', range(3))
def test_smooths_a_surface_followed_at_500_hz(seed):
    """White acceleration alone finds no noise here: the error stays 1 um, and the grid has eight knots a sample."""
    times = np.arange(10_000) * 0.002
    truth, rate, acceleration = surface(times, seed)
    motion = smooth_motion(times, truth + 1e-6 * np.random.default_rng(seed).normal(size=times.size))
    error = motion.displacement - truth
    assert motion.order == 3
    assert motion.noise == pytest.approx(1e-6, rel=0.1)
    assert np.std(error) < 0.65e-6
    assert np.std(error) == pytest.approx(motion.uncertainty, rel=0.15)
    assert np.std(motion.rate - rate) < 0.01 * np.std(rate)
    assert np.std(motion.rate - rate) == pytest.approx(motion.rate_uncertainty, rel=0.35)
    assert np.std(motion.acceleration - acceleration) < 0.1 * np.std(acceleration)
    assert motion.knots().size < 2.4 * times.size


@pytest.mark.parametrize('order', [2, 3])
def test_standard_errors_are_those_of_a_motion_that_white_noise_drives(order):
    rng, period, noise, fine = np.random.default_rng(order), 2e-3, 1e-6, 50
    course = 0.5 ** (3 - order) * rng.normal(size=20_000 * fine) * (10.0, 600.0)[order - 2]
    for _ in range(order - 1):
        course = np.cumsum(course - course.mean()) * (period / fine)
    rate, truth = course[::fine], np.append(0.0, np.cumsum(course)[:-1] * (period / fine))[::fine]
    times = period * np.arange(truth.size)
    motion = smooth_motion(times, truth + noise * rng.normal(size=truth.size))
    assert np.std(motion.displacement - truth) == pytest.approx(motion.uncertainty, rel=0.1)
    assert np.std(motion.rate - rate) == pytest.approx(motion.rate_uncertainty, rel=0.1)


def test_derivatives_between_samples_are_the_motions():
    times = np.arange(3000) * 0.002
    motion = smooth_motion(times, surface(times)[0] + 1e-6 * np.random.default_rng(0).normal(size=times.size))
    between = times[:-1] + 0.0007
    for found, true in zip((motion.displacement_at, motion.rate_at, motion.acceleration_at), surface(between)):
        np.testing.assert_allclose(found(between), true, atol=0.3 * np.std(true))
    for found, at_samples in (
        (motion.displacement_at, motion.displacement),
        (motion.rate_at, motion.rate),
        (motion.acceleration_at, motion.acceleration),
    ):
        np.testing.assert_allclose(found(times), at_samples, atol=1e-9 * np.ptp(at_samples))


def test_white_acceleration_is_continuous():
    """The smoothing spline is a cubic one: its acceleration on both sides of a sample is what drives the motion."""
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.uniform(0.010, 0.017, 2000))
    truth = np.cumsum(np.cumsum(rng.normal(size=times.size))) * 1e-6
    motion = smooth_motion(times, truth + 4e-5 * rng.normal(size=times.size))
    assert motion.order == 2
    close = {'rtol': 0.0, 'atol': 1e-5 * np.max(np.abs(motion.acceleration))}
    np.testing.assert_allclose(motion.acceleration_at(times), motion.acceleration, **close)
    np.testing.assert_allclose(motion.acceleration_at(times[1:] - 1e-9), motion.acceleration[1:], **close)
    assert abs(motion.acceleration[0]) == 0.0


@pytest.mark.parametrize('noise', [0.0, 1e-9, 5e-7, 5e-6])
@pytest.mark.parametrize('start', [0.0987, 0.2503, 0.6])
def test_a_step_between_rests_is_not_smeared_and_its_rests_are_smoothed(start, noise):
    times = np.arange(350) * 0.002
    truth = step_like(start, 0.012, 1.5e-3)(times)
    raw = noise * np.random.default_rng(7).normal(size=times.size)
    motion = smooth_motion(times, truth + raw)
    assert np.max(np.abs(motion.displacement - truth)) <= np.max(np.abs(raw)) + 1e-15
    if noise > 0.0:
        assert np.std(motion.displacement - truth) < 0.35 * noise
        assert motion.noise == pytest.approx(noise, rel=0.1)
    assert motion.knots().size < 1.3 * times.size


@pytest.mark.parametrize('off', [5e-4, -5e-4, 1e-3])
def test_a_stray_reading_is_no_motion(off):
    """Measured recordings have several, half a millimetre off for one sample of strokes at constant speed."""
    times = slow_strokes(2)[0]
    truth = 0.02 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * times / 7.0))
    measured = truth + 4e-5 * np.random.default_rng(1).normal(size=times.size)
    struck = np.array([160, 300, 1000, 1707])
    measured[struck] += off
    motion = smooth_motion(times, measured)
    assert motion.order == 2
    assert np.max(np.abs(motion.displacement - truth)[struck]) < 0.3 * abs(off)


def test_an_overshoot_of_one_sample_is_motion():
    times = np.arange(350) * 0.002
    truth = step_like(0.0987, 0.012, 1.5e-3)(times)
    truth[56] += 5e-5
    raw = 5e-7 * np.random.default_rng(3).normal(size=350)
    motion = smooth_motion(times, truth + raw)
    assert np.max(np.abs(motion.displacement - truth)) <= np.max(np.abs(raw))


def test_rests_that_read_one_or_two_values_are_not_without_noise():
    times = np.arange(350) * 0.002
    step = 3e-6
    truth = 0.31 * step + step_like(0.2987, 0.012, 499.7 * step)(times)
    read = step * np.round(truth / step + 0.1 * np.random.default_rng(0).normal(size=350))
    motion = smooth_motion(times, read)
    assert np.unique(read[:140]).size == 2
    assert np.ptp(read[160:]) == 0.0
    assert motion.noise >= step / np.sqrt(12.0) * (1.0 - 1e-6)
    assert np.max(np.abs(motion.displacement - truth)) < step
    assert motion.knots().size < 1.3 * times.size


@pytest.mark.parametrize('seed', range(3))
def test_irregular_sampling_with_gaps_is_smoothed_as_well(seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.010, 0.017, 3000) + 0.3 * (rng.random(3000) < 0.003))
    truth = 0.02 * np.cos(2.0 * np.pi * times / 7.0)
    motion = smooth_motion(times, truth + 4e-5 * rng.normal(size=times.size))
    assert motion.times is times
    assert motion.noise == pytest.approx(4e-5, rel=0.06)
    error = motion.displacement - truth
    assert np.std(error) < 0.35 * 4e-5
    assert np.std(error) == pytest.approx(motion.uncertainty, rel=0.35)


@pytest.mark.parametrize('missed', [0.0, 0.02])
def test_a_jittered_clock_is_seen_through(missed):
    rng = np.random.default_rng(4)
    clock = np.arange(10_000) * 0.002
    clock = clock[rng.random(clock.size) >= missed]
    truth = surface(clock)[0]
    stamps = clock + 5e-5 * rng.normal(size=clock.size)
    measured = truth + 1e-6 * rng.normal(size=clock.size)
    motion = smooth_motion(stamps, measured)
    assert np.std(motion.times - clock) < 1e-5
    assert np.std(motion.displacement - truth) < 0.65e-6
    np.testing.assert_allclose(motion.on_clock(stamps), motion.times, atol=1e-12)


@pytest.mark.parametrize('jitter', [0.0, 5e-5])
def test_in_windows_a_motion_is_as_smooth_as_whole(monkeypatch, jitter):
    rng = np.random.default_rng(5)
    clock = np.arange(12_000) * 0.002
    truth = surface(clock)[0]
    measured = truth + 1e-6 * rng.normal(size=clock.size)
    stamps = clock + jitter * rng.normal(size=clock.size)
    whole = smooth_motion(stamps, measured)
    monkeypatch.setattr(module, 'LONGEST_SMOOTHED_WHOLE', 4000)
    monkeypatch.setattr(module, 'SMOOTHING_WINDOW', 4000)
    monkeypatch.setattr(module, 'SMOOTHING_MARGIN', 500)
    windows = smooth_motion(stamps, measured)
    assert windows.order == whole.order
    assert (windows.stamps is windows.times) == (jitter == 0.0)
    assert windows.noise == pytest.approx(1e-6, rel=0.05)
    assert windows.reach == pytest.approx(whole.reach, rel=1e-3)
    assert windows.uncertainty == pytest.approx(whole.uncertainty, rel=0.2)
    assert np.std(windows.displacement - whole.displacement) < 0.5 * whole.uncertainty
    assert np.std(windows.displacement - truth) < 1.1 * np.std(whole.displacement - truth)


def test_pieces_of_a_motion_make_the_whole(monkeypatch):
    times, _, measured = slow_strokes(1)
    motion = smooth_motion(times, measured)
    others = np.linspace(times[0], times[-1], 999)
    whole = motion.on_grid(times[:2500], others)
    assert set(motion.knots()[motion.knots() <= times[2499]]) <= set(whole[0])
    monkeypatch.setattr(module, 'GRID_PIECE', 700)
    pieces = motion.on_grid(times[:2500], others)
    np.testing.assert_array_equal(pieces[0], whole[0])
    np.testing.assert_allclose(pieces[1], whole[1], rtol=0.0, atol=1e-15)


def test_stamps_are_believed_where_the_motion_bears_them_out():
    """Sampled when they say so, however much like a jittering clock's they look."""
    rng = np.random.default_rng(4)
    stamps = np.arange(10_000) * 0.002 + 5e-5 * rng.normal(size=10_000)
    motion = smooth_motion(stamps, surface(stamps)[0] + 1e-6 * rng.normal(size=10_000))
    assert motion.times is stamps
    np.testing.assert_array_equal(motion.on_clock(stamps), stamps)


def dense_regression(order, times, measured, ratio):
    """
    Return smoothed displacement, its variance and the sum of log predicted variances of all samples but three.

    A Gaussian process of covariance ratio x that of the integrated Wiener process, on polynomials of unknown
    coefficients (Rasmussen and Williams 2006, section 2.7). The sum is a difference of two such likelihoods.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    last = order - 1

    def covariance(one, other):
        end = min(one, other)
        inside = 0.5 * (nodes + 1.0) * end
        return 0.5 * end * np.sum(weights * (one - inside) ** last * (other - inside) ** last) / factorial(last) ** 2

    kernel = ratio * np.array([[covariance(one, other) for other in times] for one in times])
    basis = np.vander(times, order, increasing=True)
    total = kernel + np.eye(times.size)

    def log_likelihood(count):
        part = total[:count, :count]
        information = basis[:count].T @ np.linalg.solve(part, basis[:count])
        return np.linalg.slogdet(part)[1] + np.linalg.slogdet(information)[1]

    inverse = np.linalg.inv(total)
    spread = np.linalg.inv(basis.T @ inverse @ basis)
    coefficients = spread @ basis.T @ inverse @ measured
    smoothed = basis @ coefficients + kernel @ inverse @ (measured - basis @ coefficients)
    left = basis - kernel @ inverse @ basis
    variance = np.diag(kernel - kernel @ inverse @ kernel + left @ spread @ left.T)
    return smoothed, variance, log_likelihood(times.size) - log_likelihood(3)


@pytest.mark.parametrize('order', [2, 3])
@pytest.mark.parametrize('ratio', [1e-6, 1e-2, 1.0])
def test_filter_and_smoother_are_the_dense_regression(order, ratio):
    rng = np.random.default_rng(0)
    steps = rng.uniform(0.3, 2.5, 11)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    values = times + 3.0 * rng.normal(size=12)
    smoothed, variance, log_sum = dense_regression(order, times, values, ratio)
    density = np.full(11, ratio)
    mean, covariance = np.empty((12, 3)), np.empty((12, 6))
    initial = smoother._InitialStates(order, steps, density)
    initial.write_filtered(values, mean, covariance)
    found, _ = smoother._filter(order, steps, values, density, mean, covariance)
    push, pull = smoother._smooth(order, steps, values, density, mean, covariance)
    initial.write_smoothed(values, mean, covariance, np.array(push), np.array(pull))
    assert found == pytest.approx(log_sum, abs=1e-8)
    np.testing.assert_allclose(mean[:, 0], smoothed, atol=1e-8)
    np.testing.assert_allclose(covariance[:, 0], variance, rtol=1e-5)


@pytest.mark.parametrize('values', [np.ones(30), np.zeros(30)])
def test_what_does_not_move_is_left_alone(values):
    motion = smooth_motion(np.arange(30) * 0.1, values)
    np.testing.assert_array_equal(motion.displacement, values)
    assert motion.noise == 0.0
    np.testing.assert_array_equal(motion.knots(), motion.times)


@settings(max_examples=settings.default.max_examples // 5)
@given(
    scale=st.floats(1e-6, 1e6),
    shift=st.floats(-1.0, 1.0),
    second=st.floats(1e-3, 1e3),
    begin=st.floats(-100.0, 100.0),
    mirrored=st.booleans(),
    kind=st.sampled_from(['strokes', 'step', 'surface']),
)
def test_units_origins_and_direction_of_time_do_not_matter(scale, shift, second, begin, mirrored, kind):
    times, measured = recording(kind)
    plain = smooth_motion(times, measured)
    direction = -1.0 if mirrored else 1.0
    order = slice(None, None, -1 if mirrored else 1)
    other = smooth_motion(second * (direction * times[order] + begin), scale * (measured[order] + shift))
    assert other.order == plain.order
    assert other.noise == pytest.approx(scale * plain.noise, rel=2e-3)
    close = {'rtol': 0.0, 'atol': 0.02 * plain.noise}
    np.testing.assert_allclose(other.displacement[order] / scale - shift, plain.displacement, **close)
    assert other.uncertainty / scale == pytest.approx(plain.uncertainty, rel=0.02)
    np.testing.assert_allclose(
        direction * other.rate[order] / scale * second, plain.rate, atol=1e-3 * np.max(np.abs(plain.rate))
    )


def recording(kind):
    """Return sample times [s] and measured displacement [m]."""
    if kind == 'strokes':
        times, _, measured = slow_strokes(0)
        return times[:1000], measured[:1000]
    times = np.arange(500) * 0.002
    truth = surface(times)[0] if kind == 'surface' else step_like(0.4987, 0.012, 1.5e-3)(times)
    return times, truth + 1e-6 * np.random.default_rng(1).normal(size=500)


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
