"""
The displacement that the piston really made, from the one that was measured.

The measured displacement's own noise reaches the simulated pressure multiplied by K_x, as large on measured data as the
pressure sensor's noise. It is smoothed here as an integrated Wiener process (white acceleration) seen in white noise:
the smoothing spline whose stiffness is the maximum-likelihood one, so that a slow stroke is smoothed over many samples
and a step of the gauge block, many times larger than the noise, over none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize_scalar

Array = NDArray[np.float64]

_LOG_RATIO = (-12.0, 12.0)  # decades of acceleration density over noise variance, in units of the mean sample time
_MOST_PIECES = 8  # of one sample step


@dataclass(frozen=True)
class Motion:
    """
    A smoothed displacement.

    Attributes
    ----------
    times
        Sample times, shape (n,) [s].
    displacement, rate
        Smoothed displacement and its rate, shape (n,) [m, m/s].
    std
        Standard error of the displacement, shape (n,) [m].
    noise
        Standard deviation of the measured displacement's noise [m].

    """

    times: Array
    displacement: Array
    rate: Array
    std: Array
    noise: float

    def knots(self) -> Array:
        """
        Return times between which a straight line follows the displacement to within its noise [s].

        These are the sample times and, where the motion bends in between (a step of a few samples), evenly spaced ones
        inside a sample step. Between samples the smoothing spline is the cubic with both ends' displacement and rate.
        """
        steps = np.diff(self.times)
        bend = np.abs(np.diff(self.rate)) * steps / 8.0  # of a cubic off its chord, at most
        pieces = np.ones(steps.size, dtype=np.intp)
        if self.noise > 0.0:
            pieces = np.minimum(np.ceil(np.sqrt(bend / self.noise)), _MOST_PIECES).astype(np.intp)
            pieces = np.maximum(pieces, 1)
        step_of = np.repeat(np.arange(steps.size), pieces)
        rank = np.arange(step_of.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        return np.append(self.times[step_of] + steps[step_of] * rank / pieces[step_of], self.times[-1])

    def at(self, times: Array) -> Array:
        """Return the smoothing spline's displacement at times within the recording, shape (n,) [m]."""
        spline = CubicHermiteSpline(self.times, self.displacement, self.rate)
        return np.asarray(spline(times), dtype=np.float64)


@njit(cache=True, error_model='numpy')
def _filter(steps, measured, ratio, mean, covariance):
    """
    Kalman filter of the integrated Wiener process; noise variance 1, acceleration density `ratio`.

    Writes the filtered (x, x') and its covariance (xx, xv, vv) for each sample; returns the sum of log innovation
    variances and of squared normalised innovations, the first two samples (which fix the state) left out.
    """
    n = measured.size
    h = steps[0]
    mean[0, 0] = measured[0]
    mean[0, 1] = (measured[1] - measured[0]) / h
    covariance[0, 0] = 1.0
    covariance[0, 1] = -1.0 / h
    covariance[0, 2] = 2.0 / (h * h) + ratio * h / 3.0
    log_sum = 0.0
    square_sum = 0.0
    for i in range(1, n):
        h = steps[i - 1]
        x = mean[i - 1, 0] + h * mean[i - 1, 1]
        v = mean[i - 1, 1]
        xv = covariance[i - 1, 1] + h * covariance[i - 1, 2]
        xx = covariance[i - 1, 0] + h * (covariance[i - 1, 1] + xv) + ratio * h * h * h / 3.0
        xv += ratio * h * h / 2.0
        vv = covariance[i - 1, 2] + ratio * h
        if i == 1:  # the velocity was made from this sample: it tells nothing new
            mean[1, 0] = measured[1]
            mean[1, 1] = v
            covariance[1, 0] = 1.0
            covariance[1, 1] = 1.0 / h
            covariance[1, 2] = 2.0 / (h * h) + ratio * h / 3.0
            continue
        innovation = measured[i] - x
        variance = xx + 1.0
        log_sum += math.log(variance)
        square_sum += innovation * innovation / variance
        gain_x = xx / variance
        gain_v = xv / variance
        mean[i, 0] = x + gain_x * innovation
        mean[i, 1] = v + gain_v * innovation
        covariance[i, 0] = xx - gain_x * xx
        covariance[i, 1] = xv - gain_x * xv
        covariance[i, 2] = vv - gain_v * xv
    return log_sum, square_sum


@njit(cache=True, error_model='numpy')
def _smooth(steps, ratio, mean, covariance):
    """Rauch-Tung-Striebel pass: turn filtered means and covariances into smoothed ones, in place."""
    n = mean.shape[0]
    for i in range(n - 2, -1, -1):
        h = steps[i]
        xx, xv, vv = covariance[i, 0], covariance[i, 1], covariance[i, 2]
        ahead_xv = xv + h * vv
        ahead_xx = xx + h * (xv + ahead_xv) + ratio * h * h * h / 3.0
        cross_xx = xx + h * xv  # covariance of (x, v) now with (x, v) ahead
        cross_vx = ahead_xv
        ahead_xv = ahead_xv + ratio * h * h / 2.0
        ahead_vv = vv + ratio * h
        determinant = ahead_xx * ahead_vv - ahead_xv * ahead_xv
        g11 = (cross_xx * ahead_vv - xv * ahead_xv) / determinant
        g12 = (xv * ahead_xx - cross_xx * ahead_xv) / determinant
        g21 = (cross_vx * ahead_vv - vv * ahead_xv) / determinant
        g22 = (vv * ahead_xx - cross_vx * ahead_xv) / determinant
        dx = mean[i + 1, 0] - (mean[i, 0] + h * mean[i, 1])
        dv = mean[i + 1, 1] - mean[i, 1]
        mean[i, 0] += g11 * dx + g12 * dv
        mean[i, 1] += g21 * dx + g22 * dv
        dxx = covariance[i + 1, 0] - ahead_xx
        dxv = covariance[i + 1, 1] - ahead_xv
        dvv = covariance[i + 1, 2] - ahead_vv
        covariance[i, 0] = xx + g11 * (g11 * dxx + g12 * dxv) + g12 * (g11 * dxv + g12 * dvv)
        covariance[i, 1] = xv + g21 * (g11 * dxx + g12 * dxv) + g22 * (g11 * dxv + g12 * dvv)
        covariance[i, 2] = vv + g21 * (g21 * dxx + g22 * dxv) + g22 * (g21 * dxv + g22 * dvv)


def smooth_motion(times: Array, measured: Array) -> Motion:
    """
    Return the smoothed displacement.

    Parameters
    ----------
    times
        Increasing, shape (n,), n at least 4 [s].
    measured
        Measured displacement, shape (n,) [m].

    """
    # in units of the mean step and of the displacement's spread, so that the search sees numbers about one
    unit = float(np.mean(np.diff(times)))
    scale = float(np.std(measured)) or 1.0
    steps = np.diff(times) / unit
    values = (measured - measured[0]) / scale
    mean = np.empty((values.size, 2))
    covariance = np.empty((values.size, 3))
    degrees = values.size - 2

    def deviance(log_ratio: float) -> float:
        log_sum, square_sum = _filter(steps, values, 10.0**log_ratio, mean, covariance)
        return log_sum + degrees * math.log(max(square_sum, 1e-300))

    best = float(minimize_scalar(deviance, bounds=_LOG_RATIO, method='bounded', options={'xatol': 0.02}).x)
    _, square_sum = _filter(steps, values, 10.0**best, mean, covariance)
    _smooth(steps, 10.0**best, mean, covariance)
    noise = scale * math.sqrt(square_sum / degrees)
    return Motion(
        times=times,
        displacement=measured[0] + scale * mean[:, 0],
        rate=scale / unit * mean[:, 1],
        std=noise * np.sqrt(np.maximum(covariance[:, 0], 0.0)),
        noise=noise,
    )
