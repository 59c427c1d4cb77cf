# SPDX-License-Identifier: Apache-2.0
"""How small the residual could be: the noise that no model can explain."""

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

    Each sample is compared with the straight line through its neighbours (Gasser, Sroka and Jennen-Steinmetz, 1986);
    the largest tenth of the differences is left out, and made up for as in a normal distribution. A long signal is
    looked at in pieces.

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
    left = (times[2:] - times[1:-1]) / (times[2:] - times[:-2])
    right = 1.0 - left
    differences = values[1:-1] - left * values[:-2] - right * values[2:]
    squares = np.sort(differences**2 / (1.0 + left**2 + right**2))
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
        Standard deviation that it gives the residual of the true model [signal's unit].
    coefficients
        Of its autoregression; none where it is white or not known.
    uncertainty
        Standard error of `std`, as a share of it [-].
    known
        Whether std and coefficients are those of rests of piston and set-point; otherwise the noise is taken for white,
        and only what neighbouring samples differ by is counted. So it is where a model leaves more at rest than a
        sensor's noise can be.
    rounded
        Whether most of it is the converter's rounding, which depends on the signal.
    blur
        What the rate of the displacement, as far as it is not known, adds while the piston moves [signal's unit]; no
        part of `std`.

    """

    std: float
    coefficients: Array
    uncertainty: float
    known: bool
    rounded: bool
    blur: float = 0.0


def noise_of(rests: Sequence[Array], white: float, count: int, rounding: float) -> Noise:
    """
    Return the noise of a signal.

    Parameters
    ----------
    rests
        Residuals while nothing moves, the mean of each run taken out. Where a model settles otherwise than the device,
        they are not noise alone: noise has a memory only if the quieter half of the runs, less a parabola, has one.
    white
        Standard deviation that white noise would have, where there are not enough of them or they are white.
    count
        Samples that this was found from.
    rounding
        Standard deviation of the converter's rounding.

    """
    known = sum(rest.size for rest in rests) >= FEWEST_SAMPLES_AT_REST
    remembers = (
        known
        and _quiet(rests) > LEAST_COLOURED_NOISE * white
        and 0.0 < _spread(rests) <= LARGEST_COLOURED_NOISE * white
    )
    coefficients = autoregression(rests) if remembers else np.empty(0)
    if coefficients.size:
        count = sum(rest.size for rest in rests)
    std = _spread(rests) if coefficients.size else white
    uncertainty = 1.0 / math.sqrt(2.0 * count * independent_share(coefficients))
    return Noise(max(std, rounding), coefficients, uncertainty, known, rounding > LEAST_ROUNDING * std)


def rounding_step(values: Array) -> float:
    """Return the step of the converter that a signal's values are multiples of, 0 where there is none to be seen."""
    distinct = np.unique(values)
    if distinct.size < 2 or distinct.size > LARGEST_DISTINCT_SHARE * values.size:
        return 0.0
    steps = np.diff(distinct)
    least = LEAST_ROUNDING_STEP * np.ptp(distinct)
    return float(np.min(steps[steps > least], initial=np.inf)) if np.ptp(distinct) > 0.0 else 0.0


def _quiet(rests: Sequence[Array]) -> float:
    """Return the standard deviation of the quieter half of runs, about a parabola through each."""
    bases = {size: np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 3))[0] for size in {one.size for one in rests}}
    left = [one - bases[one.size] @ (bases[one.size].T @ one) for one in rests]
    squares = sorted(float(one @ one) / max(one.size - 3, 1) for one in left)
    return math.sqrt(float(np.mean(squares[: len(squares) // 2 + 1])))


def _spread(rests: Sequence[Array]) -> float:
    """
    Return the standard deviation of noise in runs, by what samples far apart differ: their means don't matter.

    In short runs of noise with a memory a mean takes much of the noise with it.
    """
    apart = min(INDEPENDENT_DISTANCE, max(rest.size for rest in rests) // 2)
    differences = np.concatenate([rest[apart:] - rest[:-apart] for rest in rests if rest.size > apart])
    return math.sqrt(0.5 * float(np.mean(differences**2)))


def stamp_jitter(times: Array) -> float:
    """
    Return how far stamps may lie from when the samples were taken [s]: the spread of the sampling period over root two.

    Where the sampling itself is irregular this is too much, which costs little: it matters only where the pressure
    changes fast.
    """
    steps = np.diff(times)
    return float(np.median(np.abs(steps - np.median(steps)))) * _NORMAL_PER_MEDIAN / math.sqrt(2.0)
