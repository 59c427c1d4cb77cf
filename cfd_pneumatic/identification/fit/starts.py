"""What effects draw the starting values of their parameters from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.extension import Extension
from cfd_pneumatic.model.effects import Data

Array = NDArray[np.float64]

_FASTEST_SUPPLY = 3.0  # highest frequency of a supply's variation [Hz]
_MOST_FREQUENCIES = 100  # that are looked at closely
_FEWEST_ORDINATES = 1024
_LEAST_FLOW = 10.0  # that a limit may be drawn from [Pa/s]
_LONGEST_LAG = 0.2  # [s]
_BIN = 0.05  # over which residuals are averaged, short beside the fastest period [s]


def starting_data(
    experiments: Sequence[Experiment], fitted: Extension, simulated: Sequence[Array], ambient_pressure: float
) -> Data:
    """
    Return what is known of the experiments and of a model fitted to them, and of the pressures that it simulates [Pa].

    =====================  ============================================================
    `k_x` [Pa/m], `k_sv`, `k_v` [1/s], `tau` [s]  gains as fitted
    `residual` [Pa]        root mean square of the residual
    `gauge` [Pa]           median gauge pressure
    `highest_pressure` [Pa]  absolute
    `x_low`, `x_high` [m]  range of the displacement
    `speed` [m/s]          root mean square of the piston's, while it moves
    `lag` [s]              by which the measured pressure comes later than the simulated one
    `period`, `duration` [s]  between samples, and of the longest experiment
    `largest_charge`, `largest_exhaust` [Pa/s]  what the valves' flow reaches
    `slow_frequency` [Hz]  strongest period of the residual below 3 Hz
    =====================  ============================================================
    """
    k_x, k_sv, k_v, tau = (float(gain) for gain in fitted.gains)
    residuals = [one.pressure - pressure for one, pressure in zip(experiments, simulated)]
    pressures = np.concatenate([one.pressure for one in experiments])
    displacement = np.concatenate([one.displacement for one in experiments])
    errors = np.concatenate(
        [
            one.setpoint[one.samples] + offset - pressure
            for one, offset, pressure in zip(experiments, fitted.offsets, simulated)
        ]
    )
    longest = max(range(len(experiments)), key=lambda index: float(np.ptp(experiments[index].sample_times)))
    return {
        'k_x': k_x,
        'k_sv': k_sv,
        'k_v': k_v,
        'tau': tau,
        'residual': float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))),
        'gauge': max(float(np.median(pressures)) - ambient_pressure, 1e3),
        'highest_pressure': float(np.max(pressures)),
        'x_low': float(np.min(displacement)),
        'x_high': float(np.max(displacement)),
        'speed': _speed(experiments[longest]),
        'lag': _lag(experiments[longest], simulated[longest]),
        'period': min(float(np.median(np.diff(one.sample_times))) for one in experiments),
        'duration': float(np.ptp(experiments[longest].sample_times)),
        'largest_charge': max(k_sv * float(np.max(errors)), _LEAST_FLOW),
        'largest_exhaust': max(-k_v * float(np.min(errors)), _LEAST_FLOW),
        'slow_frequency': _strongest_frequency(experiments[longest].sample_times, residuals[longest]),
    }


def _strongest_frequency(times: Array, residual: Array) -> float:
    """Return the frequency [Hz], of those a supply's variation may have, that explains most of the residual."""
    slowest = 1.0 / max(float(np.ptp(times)), 1e-9)
    if slowest >= _FASTEST_SUPPLY:
        return _FASTEST_SUPPLY
    bins = ((times - times[0]) / _BIN).astype(np.intp)
    present, rank = np.unique(bins, return_inverse=True)
    counts = np.bincount(rank)
    centres = np.bincount(rank, times) / counts
    means = np.bincount(rank, residual - np.mean(residual)) / counts
    # the periodogram finds where to look, four times as fine as lines are wide
    filled = np.zeros(int(present[-1]) + 1)
    filled[present] = means
    length = max(4 * filled.size, _FEWEST_ORDINATES)
    frequencies = np.fft.rfftfreq(length, _BIN)
    power = np.abs(np.fft.rfft(filled, length)) ** 2
    within = np.flatnonzero((frequencies >= slowest) & (frequencies <= _FASTEST_SUPPLY))
    tallest = frequencies[within[np.argsort(power[within])[-_MOST_FREQUENCIES:]]]
    return float(tallest[int(np.argmax([_explained(centres, means, one) for one in tallest]))])


def _explained(times: Array, values: Array, frequency: float) -> float:
    """Return how much of the sum of squares a sine and a level explain."""
    angle = 2.0 * np.pi * frequency * times
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(times), np.sin(angle), np.cos(angle)]))
    return float(np.sum((basis.T @ values) ** 2))


def _speed(experiment: Experiment) -> float:
    """Return the root mean square of the piston's speed while it moves [m/s]."""
    speed = np.abs(np.gradient(experiment.displacement, experiment.times))
    return max(float(np.sqrt(np.mean(speed[speed >= np.median(speed)] ** 2))), 1e-5)


def _lag(experiment: Experiment, simulated: Array) -> float:
    """Return by how much the measured pressure comes later than the simulated one, by their correlation [s]."""
    times = experiment.sample_times
    period = float(np.median(np.diff(times)))
    reach = min(int(_LONGEST_LAG / period), times.size // 4)
    measured = experiment.pressure - np.mean(experiment.pressure)
    expected = simulated - np.mean(simulated)
    inner = measured[reach : measured.size - reach]
    likeness = fftconvolve(expected, inner[::-1], mode='valid')  # by samples that the simulated one is taken later
    total = np.concatenate([[0.0], np.cumsum(expected**2)])
    mismatch = total[inner.size :] - total[: -inner.size] - 2.0 * likeness
    return float(reach - int(np.argmin(mismatch))) * period
