# SPDX-License-Identifier: Apache-2.0
"""Features of a residual and a motion: strongest frequency, lags, speed."""

from __future__ import annotations

from collections.abc import Sequence

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
    STEP_RESPONSE_TIME,
)


def strongest_frequency(times: Array, residual: Array) -> float:
    """Return the frequency [Hz] within the range of a supply's variation that explains most of the residual."""
    slowest = 1.0 / max(float(np.ptp(times)), LEAST_DURATION)
    if slowest >= HIGHEST_SUPPLY_FREQUENCY:
        return HIGHEST_SUPPLY_FREQUENCY
    bins = ((times - times[0]) / AVERAGING_TIME).astype(np.intp)
    present, rank = np.unique(bins, return_inverse=True)
    counts = np.bincount(rank)
    centres = np.bincount(rank, times) / counts
    means = np.bincount(rank, residual - np.mean(residual)) / counts
    # the periodogram, four times as fine as lines are wide, preselects frequencies
    filled = np.zeros(int(present[-1]) + 1)
    filled[present] = means
    length = max(4 * filled.size, FEWEST_ORDINATES)
    frequencies = np.fft.rfftfreq(length, AVERAGING_TIME)
    power = np.abs(np.fft.rfft(filled, length)) ** 2
    in_range = np.flatnonzero((frequencies >= slowest) & (frequencies <= HIGHEST_SUPPLY_FREQUENCY))
    tallest = np.asarray(frequencies[in_range[np.argsort(power[in_range])[-MOST_FREQUENCIES:]]], dtype=np.float64)
    return float(tallest[int(np.argmax(_explained(centres, means, tallest)))])


def _explained(times: Array, values: Array, frequencies: Array) -> Array:
    """Return the sum of squares about the mean that a sine of each frequency explains, shape (frequencies,)."""
    angle = 2.0 * np.pi * np.outer(frequencies, times)
    sine, cosine = (wave - np.mean(wave, axis=1, keepdims=True) for wave in (np.sin(angle), np.cos(angle)))
    cosine -= sine * (np.sum(sine * cosine, axis=1) / np.sum(sine**2, axis=1))[:, None]
    return np.asarray(sum((wave @ values) ** 2 / np.sum(wave**2, axis=1) for wave in (sine, cosine)))


def speed_in_motion(times: Array, displacement: Array) -> float:
    """Return the root mean square of the piston's speed while it moves [m/s]."""
    speed = np.abs(np.gradient(displacement, times))
    return max(float(np.sqrt(np.mean(speed[speed >= np.median(speed)] ** 2))), LEAST_SPEED)


def _sliding_products(long: Array, short: Array) -> Array:
    """Return the inner products of a short series with a long series at each offset, shape (offsets,)."""
    size = 2 ** (long.size - 1).bit_length()
    product = np.fft.rfft(long, size) * np.conj(np.fft.rfft(short, size))
    return np.fft.irfft(product, size)[: long.size - short.size + 1]


def lag_between(times: Array, measured: Array, simulated: Array) -> float:
    """Return the delay of a measured behind a simulated signal with the least squared difference [s]."""
    period = float(np.median(np.diff(times)))
    reach = min(int(LARGEST_LAG / period), times.size // 4)
    centred_measured = measured - np.mean(measured)
    centred_simulated = simulated - np.mean(simulated)
    inner = centred_measured[reach : measured.size - reach]
    products = _sliding_products(centred_simulated, inner)  # by the offset of the simulated signal in samples
    total = np.concatenate([[0.0], np.cumsum(centred_simulated**2)])
    mismatch = total[inner.size :] - total[: -inner.size] - 2.0 * products
    return float(reach - int(np.argmin(mismatch))) * period


def lag_after_steps(times: Sequence[Array], setpoints: Sequence[Array], residuals: Sequence[Array]) -> float:
    """
    Return the delay of the pressure behind the model after steps of the set-point [s]; 0 without steps or delay.

    The integral of the residual after a step is minus the step times the delay, for any linear response.

    Parameters
    ----------
    times, setpoints, residuals
        Sample times [s], set-points [Pa], and measured minus simulated pressure [Pa] of each recording, shape (m,).

    """
    products = squares = 0.0
    for sample_times, setpoint, residual in zip(times, setpoints, residuals):
        changes = np.flatnonzero(np.diff(setpoint)) + 1
        integral = np.append(0.0, np.cumsum(residual[1:] * np.diff(sample_times)))
        ends = np.minimum(
            np.append(changes[1:], residual.size) - 1,
            np.searchsorted(sample_times, sample_times[changes] + STEP_RESPONSE_TIME, side='right') - 1,
        )
        heights = setpoint[changes] - setpoint[changes - 1]
        products -= float(heights @ (integral[ends] - integral[changes - 1]))
        squares += float(heights @ heights)
    return max(products, 0.0) / squares if squares > 0.0 else 0.0
