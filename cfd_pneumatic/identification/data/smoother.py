# SPDX-License-Identifier: Apache-2.0
"""
The likeliest smoothing spline through noisy samples, with a larger drive in sudden steps.

A Kalman filter of white noise, integrated twice or three times, computes the likelihood. The adjoint pass after the
filter computes the spline. Samples are in units of the mean step and of their standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data.thresholds import (
    BANDWIDTH_DECADES,
    BANDWIDTH_TOLERANCE,
    COARSE_BANDWIDTHS,
    LARGEST_BOOST,
    LARGEST_DIGIT_ERROR,
    LEAST_STRAY,
    LEAST_SUDDEN_DRIVE,
    LEAST_VARIANCE,
    MOST_BOOST_ROUNDS,
    USUAL_STEPS,
    USUAL_STEPS_POWER,
)
from cfd_pneumatic.runtime import compiler

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_FIXED = 3  # samples that fix the state of the highest order: the likelihood of an order does not count them


@compiler(error_model='numpy')
def _driven_covariance(order, h):
    """Return the covariance (xx, xv, xa, vv, va, aa) that white noise of density 1 adds to the state over a step h."""
    if order == 2:
        return h * h * h / 3.0, h * h / 2.0, 0.0, h, 0.0, 0.0
    cube = h * h * h
    return cube * h * h / 20.0, cube * h / 8.0, cube / 6.0, cube / 3.0, h * h / 2.0, h


@compiler(error_model='numpy')
def _propagated_covariance(h, xx, xv, xa, vv, va, aa):
    """Return the covariance of a state (x, x', x'') after a step h of constant acceleration."""
    half = 0.5 * h * h
    row_x = xx + h * xv + half * xa
    row_v = xv + h * vv + half * va
    row_a = xa + h * va + half * aa
    va_ahead = va + h * aa
    return (row_x + h * row_v + half * row_a, row_v + h * row_a, row_a, vv + h * va + h * va_ahead, va_ahead, aa)


@compiler(error_model='numpy', nogil=True)
def _filter(order, steps, measured, density, mean, covariance):
    """
    Run a Kalman filter of white noise integrated `order` times; noise variance 1, `density` of each step.

    For order 2 the acceleration is no state: its value, variance and covariances stay zero.

    Writes the filtered (x, x', x'') and its covariance (xx, xv, xa, vv, va, aa) for each sample. The first state, of
    sample order - 1, comes from `write_filtered`. Returns the sums of the log innovation variances and of the squared
    normalised innovations. Both sums omit the same samples for each order.
    """
    log_sum = 0.0
    square_sum = 0.0
    x, v, a = mean[order - 1]
    xx, xv, xa, vv, va, aa = covariance[order - 1]
    for i in range(order, measured.size):
        h = steps[i - 1]
        x += h * v + 0.5 * h * h * a
        v += h * a
        xx, xv, xa, vv, va, aa = _propagated_covariance(h, xx, xv, xa, vv, va, aa)
        q_xx, q_xv, q_xa, q_vv, q_va, q_aa = _driven_covariance(order, h)
        xx += density[i - 1] * q_xx
        xv += density[i - 1] * q_xv
        xa += density[i - 1] * q_xa
        vv += density[i - 1] * q_vv
        va += density[i - 1] * q_va
        aa += density[i - 1] * q_aa
        variance = xx + 1.0
        innovation = measured[i] - x
        if i >= _FIXED:
            log_sum += math.log(variance)
            square_sum += innovation * innovation / variance
        x += xx / variance * innovation
        v += xv / variance * innovation
        a += xa / variance * innovation
        vv -= xv * xv / variance
        va -= xv * xa / variance
        aa -= xa * xa / variance
        xx /= variance
        xv /= variance
        xa /= variance
        mean[i, 0], mean[i, 1], mean[i, 2] = x, v, a
        covariance[i, 0], covariance[i, 1], covariance[i, 2] = xx, xv, xa
        covariance[i, 3], covariance[i, 4], covariance[i, 5] = vv, va, aa
    return log_sum, square_sum


@compiler(error_model='numpy', nogil=True)
def _smooth(order, steps, measured, density, mean, covariance):
    """
    Smooth the filtered means and the covariances' xx and vv in place, down to sample number `order`.

    This is the adjoint pass of Bryson and Frazier (Bierman, 1973), which inverts no covariance. Returns the adjoint
    push (x, v, a) and pull (xx, xv, xa, vv, va, aa) of all samples from number `order` on. With the covariance P of the
    sample before, P push is added to its mean, and P pull P is subtracted from P. For order 2 the acceleration is the
    drive of the motion, which follows from the push of the rate.
    """
    p_x, p_v, p_a = 0.0, 0.0, 0.0
    n_xx, n_xv, n_xa, n_vv, n_va, n_aa = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(measured.size - 1, order - 1, -1):
        h = steps[i - 1]
        k_x, k_v, k_a = covariance[i, 0], covariance[i, 1], covariance[i, 2]  # the filter's gain: its noise is 1
        u_x = n_xx * k_x + n_xv * k_v + n_xa * k_a
        u_v = n_xv * k_x + n_vv * k_v + n_va * k_a
        u_a = n_xa * k_x + n_va * k_v + n_aa * k_a
        pulled = k_x * u_x + k_v * u_v + k_a * u_a
        pushed = k_x * p_x + k_v * p_v + k_a * p_a
        mean[i, 0] += pushed
        mean[i, 1] += covariance[i, 1] * p_x + covariance[i, 3] * p_v + covariance[i, 4] * p_a
        mean[i, 2] += covariance[i, 2] * p_x + covariance[i, 4] * p_v + covariance[i, 5] * p_a
        if order == 2:
            mean[i, 2] = density[i - 1] * p_v
        covariance[i, 0] -= pulled
        r_x, r_v, r_a = covariance[i, 1], covariance[i, 3], covariance[i, 4]
        covariance[i, 3] -= (
            r_x * (n_xx * r_x + n_xv * r_v + n_xa * r_a)
            + r_v * (n_xv * r_x + n_vv * r_v + n_va * r_a)
            + r_a * (n_xa * r_x + n_va * r_v + n_aa * r_a)
        )
        # backwards over the sample
        xx, xv, xa, vv, va, aa = covariance[i - 1]
        x, v, a = mean[i - 1]
        variance = (
            1.0
            + _propagated_covariance(h, xx, xv, xa, vv, va, aa)[0]
            + density[i - 1] * _driven_covariance(order, h)[0]
        )
        p_x += (measured[i] - x - h * v - 0.5 * h * h * a) / variance - pushed
        n_xx += 1.0 / variance - 2.0 * u_x + pulled
        n_xv -= u_v
        n_xa -= u_a
        # backwards over the step: the transition's transpose is the transition of the reversed state
        p_a += h * p_v + 0.5 * h * h * p_x
        p_v += h * p_x
        n_aa, n_va, n_xa, n_vv, n_xv, n_xx = _propagated_covariance(h, n_aa, n_va, n_xa, n_vv, n_xv, n_xx)
    return (p_x, p_v, p_a), (n_xx, n_xv, n_xa, n_vv, n_va, n_aa)


@dataclass(frozen=True)
class Samples:
    """Samples to smooth, and buffers for the filter's means and covariances, shape (n, 3) and (n, 6)."""

    steps: Array
    values: Array
    least_noise: float
    mean: Array
    covariance: Array

    @classmethod
    def from_values(cls, steps: Array, values: Array) -> Samples:
        """Return samples with a lower bound of the noise: rounding, if all values are multiples of a difference."""
        gaps = np.diff(np.unique(values))
        multiples = gaps / np.min(gaps, initial=math.inf)
        rounded = gaps.size > 0 and np.all(np.abs(multiples - np.round(multiples)) < LARGEST_DIGIT_ERROR)
        least_noise = float(np.min(gaps)) / math.sqrt(12.0) if rounded else 0.0
        return cls(steps, values, least_noise, np.empty((values.size, 3)), np.empty((values.size, 6)))


def likeliest_smoother(order: int, samples: Samples) -> Smoother:
    """Return the likeliest smoother of an order, with or without sudden steps."""
    best = Smoother(order, samples, np.ones_like(samples.steps))
    for _ in range(MOST_BOOST_ROUNDS):
        boost = best.sudden_boost()
        if not np.any(boost > 1.0):
            break
        candidate = Smoother(order, samples, boost)
        if candidate.deviance >= best.deviance:
            break
        best = candidate
    return best


def _minimise(function: Callable[[float], float], low: float, high: float, tolerance: float) -> tuple[float, float]:
    """Return the minimum of a unimodal function and its argument, by golden sections."""
    inner = [high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)]
    values = [function(point) for point in inner]
    while high - low > tolerance:
        if values[0] < values[1]:
            high = inner[1]
            inner = [high - _GOLDEN * (high - low), inner[0]]
            values = [function(inner[0]), values[0]]
        else:
            low = inner[0]
            inner = [inner[1], low + _GOLDEN * (high - low)]
            values = [values[1], function(inner[1])]
    return min(zip(values, inner))


class Smoother:
    """
    The smoother of an order with the likeliest bandwidth: `deviance`, and `noise` in the samples' unit.

    The drive has the same density on each step, multiplied by the step's boost.
    """

    def __init__(self, order: int, samples: Samples, boost: Array) -> None:
        self.order = order
        self._samples = samples
        self._boost = boost
        self._degrees = samples.values.size - _FIXED
        coarse = np.linspace(*BANDWIDTH_DECADES, COARSE_BANDWIDTHS)
        nearest = int(np.argmin([self._deviance(log_bandwidth) for log_bandwidth in coarse]))
        bounds = coarse[max(nearest - 1, 0)], coarse[min(nearest + 1, COARSE_BANDWIDTHS - 1)]
        deviance, log_bandwidth = _minimise(self._deviance, *bounds, BANDWIDTH_TOLERANCE)
        penalty = math.log(samples.values.size) * np.count_nonzero(boost > 1.0)
        self.deviance = deviance + penalty
        self._density = self._density_at(log_bandwidth)
        _, self.noise = self._filter(self._density)

    def _density_at(self, log_bandwidth: float) -> Array:
        return 10.0 ** (2 * self.order * log_bandwidth) * self._boost

    def _deviance(self, log_bandwidth: float) -> float:
        deviance, _ = self._filter(self._density_at(log_bandwidth))
        return deviance

    def _filter(self, density: Array) -> tuple[float, float]:
        """Return the deviance, and the likeliest noise [samples' unit]."""
        samples = self._samples
        _InitialStates(self.order, samples.steps, density).write_filtered(
            samples.values, samples.mean, samples.covariance
        )
        log_sum, square_sum = _filter(
            self.order, samples.steps, samples.values, density, samples.mean, samples.covariance
        )
        variance = max(square_sum / self._degrees, samples.least_noise**2)
        misfit = square_sum / variance if variance > 0.0 else 0.0
        return float(log_sum + self._degrees * math.log(max(variance, LEAST_VARIANCE)) + misfit), math.sqrt(variance)

    def smooth(self) -> tuple[Array, Array]:
        """Return the smoothed (x, x', x''), (n, 3), and the variances of x and x' over the noise's variance, (n, 2)."""
        samples = self._samples
        self._filter(self._density)
        push, pull = _smooth(self.order, samples.steps, samples.values, self._density, samples.mean, samples.covariance)
        _InitialStates(self.order, samples.steps, self._density).write_smoothed(
            samples.values, samples.mean, samples.covariance, np.array(push), np.array(pull)
        )
        return samples.mean, samples.covariance[:, [0, 3]]

    def sudden_boost(self) -> Array:
        """
        Return the boost of each step: 1, and more for steps that are driven much harder than most, and adjacent steps.

        A single reading off the adjacent readings, which agree with each other, is a sensor error and no motion.
        """
        mean, _ = self.smooth()
        power = (np.diff(mean[:, self.order - 1]) / self._samples.steps) ** 2
        smallest = np.sort(power)[: max(1, int(USUAL_STEPS * power.size))]
        usual = float(np.mean(smallest)) / USUAL_STEPS_POWER
        boost = np.ones_like(power)
        if usual > 0.0:
            stray = _stray_readings(self._samples.steps, self._samples.values, LEAST_SUDDEN_DRIVE * self.noise)
            is_sudden = (power > LEAST_SUDDEN_DRIVE**2 * usual) & ~_steps_near(stray)
            boost[is_sudden] = np.minimum(power[is_sudden] / usual, LARGEST_BOOST)
        return np.asarray(maximum_filter1d(boost, 3), dtype=np.float64)


def _stray_readings(steps: Array, values: Array, least: float) -> NDArray[np.bool_]:
    """Return which readings are more than `least` off the line through two readings on either side, shape (n,)."""
    times = np.concatenate([[0.0], np.cumsum(steps)])
    around = [0, 1, 3, 4]
    elapsed = sliding_window_view(times, 5)[:, around] - times[2:-2, None]
    adjacent = sliding_window_view(values, 5)[:, around]
    centred = elapsed - elapsed.mean(axis=1, keepdims=True)
    slope = np.sum(centred * adjacent, axis=1) / np.sum(centred**2, axis=1)
    level = adjacent.mean(axis=1) - slope * elapsed.mean(axis=1)
    bend = np.max(np.abs(adjacent - level[:, None] - slope[:, None] * elapsed), axis=1)
    off = np.abs(values[2:-2] - level)
    stray = np.zeros(values.size, dtype=np.bool_)
    stray[2:-2] = (off > least) & (off > LEAST_STRAY * bend)
    return stray


def _steps_near(samples: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which steps are among the two before or the two after a marked sample."""
    near: NDArray[np.bool_] = maximum_filter1d(samples, 4)[1:]
    return near


class _InitialStates:
    """
    States at the first samples, which fix the initial state of the filter; there are as many as the state has parts.

    With s the state at the last of these samples, and S the states at all of them, S = transitions s + d. The drive
    between the samples adds d, with covariance `driven_covariance`.
    """

    def __init__(self, order: int, steps: Array, density: Array) -> None:
        self.order = order
        self._density = density
        self._at_samples = slice(None, None, order)  # the displacements among the states
        times = np.concatenate([[0.0], np.cumsum(steps[: order - 1])])
        self._transitions = np.concatenate([_transition(order, time - times[-1]) for time in times])
        self._driven_covariance = np.zeros((order * order, order * order))
        for step, end in enumerate(times[1:]):
            reach = np.zeros((order * order, order))
            reach[: order * (step + 1)] = np.concatenate([_transition(order, time - end) for time in times[: step + 1]])
            self._driven_covariance += (
                density[step] * reach @ _matrix(_driven_covariance(order, steps[step]), order) @ reach.T
            )
        self._observation = self._transitions[self._at_samples]
        self._spread = self._driven_covariance[self._at_samples, self._at_samples] + np.eye(order)

    def write_filtered(self, measured: Array, mean: Array, covariance: Array) -> None:
        """Write the filtered state of the last of the first samples."""
        last = self.order - 1
        inverse = np.linalg.inv(self._observation)
        mean[last] = 0.0
        mean[last, : self.order] = inverse @ measured[: self.order]
        spread = np.zeros((3, 3))
        spread[: self.order, : self.order] = inverse @ self._spread @ inverse.T
        covariance[last] = spread[np.triu_indices(3)]

    def write_smoothed(self, measured: Array, mean: Array, covariance: Array, push: Array, pull: Array) -> None:
        """Write the smoothed states of the first samples, and the variances of displacements and rates."""
        order = self.order
        filtered = _matrix(covariance[order - 1], order)
        last = mean[order - 1, :order] + filtered @ push[:order]
        last_spread = filtered - filtered @ _matrix(pull, order) @ filtered
        gain = np.linalg.solve(self._spread, self._driven_covariance[self._at_samples]).T
        passed = self._transitions - gain @ self._observation
        mean[:order] = 0.0
        mean[:order, :order] = (passed @ last + gain @ measured[:order]).reshape(order, order)
        if order == 2:
            mean[1, 2] = self._density[0] * push[1]  # as in `_smooth`; there is no drive before the first sample
        spread = (
            passed @ last_spread @ passed.T + self._driven_covariance - gain @ self._driven_covariance[self._at_samples]
        )
        covariance[:order, 0], covariance[:order, 3] = np.diag(spread)[self._at_samples], np.diag(spread)[1::order]


def _transition(order: int, step: float) -> Array:
    """Return the transition matrix of the state over a step."""
    powers = step ** np.arange(order) / np.array([1.0, 1.0, 2.0])[:order]
    return np.array([[powers[j - i] if j >= i else 0.0 for j in range(order)] for i in range(order)])


def _matrix(packed: Sequence[float] | Array, order: int) -> Array:
    """Return the symmetric matrix with the upper triangle (xx, xv, xa, vv, va, aa); for order 2 without xa, va, aa."""
    xx, xv, xa, vv, va, aa = packed
    return np.array([[xx, xv, xa], [xv, vv, va], [xa, va, aa]])[:order, :order]
