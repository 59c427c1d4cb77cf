# SPDX-License-Identifier: Apache-2.0
"""What a residual and a motion are like: period, lag, speed."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.residual.thresholds import (
    AVERAGING_TIME,
    FEWEST_ORDINATES,
    HIGHEST_SUPPLY_FREQUENCY,
    LARGEST_LAG,
    LEAST_DURATION,
    LEAST_SPEED,
    MOST_FREQUENCIES,
)


def strongest_frequency(times: Array, residual: Array) -> float:
    """Return the frequency [Hz], of those a supply's variation may have, that explains most of the residual."""
    slowest = 1.0 / max(float(np.ptp(times)), LEAST_DURATION)
    if slowest >= HIGHEST_SUPPLY_FREQUENCY:
        return HIGHEST_SUPPLY_FREQUENCY
    bins = ((times - times[0]) / AVERAGING_TIME).astype(np.intp)
    present, rank = np.unique(bins, return_inverse=True)
    counts = np.bincount(rank)
    centres = np.bincount(rank, times) / counts
    means = np.bincount(rank, residual - np.mean(residual)) / counts
    # the periodogram finds where to look, four times as fine as lines are wide
    filled = np.zeros(int(present[-1]) + 1)
    filled[present] = means
    length = max(4 * filled.size, FEWEST_ORDINATES)
    frequencies = np.fft.rfftfreq(length, AVERAGING_TIME)
    power = np.abs(np.fft.rfft(filled, length)) ** 2
    within = np.flatnonzero((frequencies >= slowest) & (frequencies <= HIGHEST_SUPPLY_FREQUENCY))
    tallest = np.asarray(frequencies[within[np.argsort(power[within])[-MOST_FREQUENCIES:]]], dtype=np.float64)
    return float(tallest[int(np.argmax(_explained(centres, means, tallest)))])


def _explained(times: Array, values: Array, frequencies: Array) -> Array:
    """Return how much of the sum of squares about the mean a sine of each frequency explains, shape (frequencies,)."""
    angle = 2.0 * np.pi * np.outer(frequencies, times)
    sine, cosine = (wave - np.mean(wave, axis=1, keepdims=True) for wave in (np.sin(angle), np.cos(angle)))
    cosine -= sine * (np.sum(sine * cosine, axis=1) / np.sum(sine**2, axis=1))[:, None]
    return np.asarray(sum((wave @ values) ** 2 / np.sum(wave**2, axis=1) for wave in (sine, cosine)))


def speed_of(times: Array, displacement: Array) -> float:
    """Return the root mean square of the piston's speed while it moves [m/s]."""
    speed = np.abs(np.gradient(displacement, times))
    return max(float(np.sqrt(np.mean(speed[speed >= np.median(speed)] ** 2))), LEAST_SPEED)


def _correlation(long: Array, short: Array) -> Array:
    """Return the sums of products of a series with a shorter one, laid beside it at each of its samples."""
    size = 2 ** (long.size - 1).bit_length()
    product = np.fft.rfft(long, size) * np.conj(np.fft.rfft(short, size))
    return np.fft.irfft(product, size)[: long.size - short.size + 1]


def lag_of(times: Array, measured: Array, simulated: Array) -> float:
    """Return by how much a measured signal comes later than a simulated one, by their correlation [s]."""
    period = float(np.median(np.diff(times)))
    reach = min(int(LARGEST_LAG / period), times.size // 4)
    centred = measured - np.mean(measured)
    expected = simulated - np.mean(simulated)
    inner = centred[reach : measured.size - reach]
    likeness = _correlation(expected, inner)  # by samples that the simulated one is taken later
    total = np.concatenate([[0.0], np.cumsum(expected**2)])
    mismatch = total[inner.size :] - total[: -inner.size] - 2.0 * likeness
    return float(reach - int(np.argmin(mismatch))) * period
