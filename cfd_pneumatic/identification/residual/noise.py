# SPDX-License-Identifier: Apache-2.0
"""Estimate the noise of a residual, which no model can explain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.linear_prediction import autoregression, independent_share
from cfd_pneumatic.identification.residual.thresholds import (
    FEWEST_SAMPLES_AT_REST,
    INDEPENDENT_DISTANCE,
    KEPT_DIFFERENCES,
    LARGEST_COLOURED_NOISE,
    LARGEST_DISTINCT_SHARE,
    LEAST_COLOURED_NOISE,
    LEAST_ROUNDING,
    LEAST_ROUNDING_STEP,
    NOISE_PIECE,
)

_NORMAL = NormalDist()
_NORMAL_PER_MEDIAN = 1.4826  # standard deviation over median absolute deviation


def sample_noise(times: Array, values: Array) -> float:
    """
    Return the standard deviation of a signal's white noise, in the signal's unit.

    Each sample is compared with the straight line through the adjacent samples (Gasser, Sroka and Jennen-Steinmetz,
    1986). The estimate omits the largest tenth of the differences and is corrected for a normal distribution. A long
    signal is processed in pieces.

    Parameters
    ----------
    times
        Increasing, shape (n,), n at least 3 [s].
    values
        The signal, shape (n,).

    """
    if times.size > 2 * NOISE_PIECE:
        pieces = zip(*(np.array_split(series, times.size // NOISE_PIECE) for series in (times, values)))
        return math.sqrt(float(np.mean([sample_noise(*piece) ** 2 for piece in pieces])))
    weight_before = (times[2:] - times[1:-1]) / (times[2:] - times[:-2])
    weight_after = 1.0 - weight_before
    differences = values[1:-1] - weight_before * values[:-2] - weight_after * values[2:]
    squares = np.sort(differences**2 / (1.0 + weight_before**2 + weight_after**2))
    kept = squares[: max(1, int(KEPT_DIFFERENCES * squares.size))]
    limit = _NORMAL.inv_cdf(0.5 + 0.5 * KEPT_DIFFERENCES)
    density = _NORMAL.pdf(limit)
    share_of_variance = 1.0 - 2.0 * limit * density / KEPT_DIFFERENCES
    return math.sqrt(float(np.mean(kept)) / share_of_variance)


@dataclass(frozen=True)
class Noise:
    """
    The noise of a signal.

    Attributes
    ----------
    std
        Standard deviation of the true model's residual [signal's unit].
    coefficients
        Coefficients of the noise's autoregression; empty if the noise is white or not known.
    uncertainty
        Standard error of `std`, relative to `std` [-].
    known
        Whether std and coefficients come from rests of piston and set-point. Otherwise the noise is assumed to be white
        and estimated from differences of adjacent samples. A residual at rest that is too large does not count.
    rounded
        Whether most of the noise is the converter's rounding, which depends on the signal.
    blur
        Standard deviation that errors of the displacement's rate add in motion [signal's unit]; no part of `std`.

    """

    std: float
    coefficients: Array
    uncertainty: float
    known: bool
    rounded: bool
    blur: float = 0.0


def estimate_noise(rests: Sequence[Array], white: float, count: int, rounding: float) -> Noise:
    """
    Estimate the noise of a signal from its residual at rest.

    Parameters
    ----------
    rests
        Residuals while nothing moves, each run less its mean. If the model settles unlike the device, these are not
        noise alone: noise is coloured only if the quieter half of the runs, each less a parabola, is coloured.
    white
        Standard deviation of the noise if the noise is white, or if there are too few rests.
    count
        Number of samples from which `white` was estimated.
    rounding
        Standard deviation of the converter's rounding.

    """
    known = sum(rest.size for rest in rests) >= FEWEST_SAMPLES_AT_REST
    is_coloured = (
        known
        and _quieter_half_std(rests) > LEAST_COLOURED_NOISE * white
        and 0.0 < _difference_std(rests) <= LARGEST_COLOURED_NOISE * white
    )
    coefficients = autoregression(rests) if is_coloured else np.empty(0)
    if coefficients.size:
        count = sum(rest.size for rest in rests)
    std = _difference_std(rests) if coefficients.size else white
    uncertainty = 1.0 / math.sqrt(2.0 * count * independent_share(coefficients))
    return Noise(max(std, rounding), coefficients, uncertainty, known, rounding > LEAST_ROUNDING * std)


def rounding_step(values: Array) -> float:
    """Return the step of the converter from the distinct values of a signal [signal's unit], 0 if no step shows."""
    distinct = np.unique(values)
    if distinct.size < 2 or distinct.size > LARGEST_DISTINCT_SHARE * values.size:
        return 0.0
    steps = np.diff(distinct)
    least = LEAST_ROUNDING_STEP * np.ptp(distinct)
    return float(np.min(steps[steps > least], initial=np.inf)) if np.ptp(distinct) > 0.0 else 0.0


def _quieter_half_std(rests: Sequence[Array]) -> float:
    """Return the standard deviation of the quieter half of the runs, each less a parabola."""
    bases = {size: np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 3))[0] for size in {run.size for run in rests}}
    remainders = [run - bases[run.size] @ (bases[run.size].T @ run) for run in rests]
    squares = sorted(float(run @ run) / max(run.size - 3, 1) for run in remainders)
    return math.sqrt(float(np.mean(squares[: len(squares) // 2 + 1])))


def _difference_std(rests: Sequence[Array]) -> float:
    """
    Return the standard deviation of noise in runs, from differences of distant samples.

    Differences do not depend on the means of the runs. The mean of a short run of coloured noise holds much of the
    noise.
    """
    distance = min(INDEPENDENT_DISTANCE, max(rest.size for rest in rests) // 2)
    differences = np.concatenate([rest[distance:] - rest[:-distance] for rest in rests if rest.size > distance])
    return math.sqrt(0.5 * float(np.mean(differences**2)))


def stamp_jitter(times: Array) -> float:
    """
    Return the standard deviation of stamps about the times of sampling [s], from the spread of the sampling period.

    The result is too large if the sampling itself is irregular. This costs little, because the jitter matters only
    while the pressure changes fast.
    """
    steps = np.diff(times)
    return float(np.median(np.abs(steps - np.median(steps)))) * _NORMAL_PER_MEDIAN / math.sqrt(2.0)
