# SPDX-License-Identifier: Apache-2.0
"""
Estimate the leak and its characteristic from the pressure behind a shut valve.

Without a regulator and without motion the mass balance of the chamber, equation (1) of the paper, contains the leak
alone: dp/dt = -conductance f(p), with the characteristic f. The time between two pressures is an integral of 1 / f, so
that no differential equation has to be solved. The pressure may also settle, because compressed air cools down and a
soft chamber expands. Each characteristic is fitted to the first half of a recording, and the second half selects
between the characteristics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import stdtrit

from cfd_pneumatic.arguments import check_numbers, check_type
from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.fit import CONFIDENCE, information
from cfd_pneumatic.identification.thresholds import (
    DECAY_TOLERANCE,
    FEWEST_DECAY_SAMPLES,
    LARGEST_LAW_ERROR,
    LARGEST_LAW_ERROR_RATIO,
    LARGEST_SETTLING,
    LARGEST_SETTLING_RATIO,
    LARGEST_START_PRESSURE,
    LEAST_DECAY_NOISE,
    LEAST_GAUGE_PRESSURE,
    LEAST_LAW_DISTANCE,
    LEAST_TABULATED_PRESSURE,
    LEAST_TIME_CONSTANT,
    SETTLING_STARTS,
    TABULATED_PRESSURES,
)
from cfd_pneumatic.model import MODULES, Moment
from cfd_pneumatic.recording import Signal

LAWS: Mapping[str, float] = MappingProxyType({'gap': 0.0, 'orifice': 1.0})
"""Characteristics of the effect `leakage`, with the value of the parameter `orifice`."""


@dataclass(frozen=True)
class Leak:
    """
    A leak characteristic, fitted to a decay.

    Attributes
    ----------
    characteristic
        Name in `LAWS`.
    conductance
        Share of the gauge pressure (orifice: of the absolute pressure) lost per second, from the whole recording [1/s].
    interval
        95 % confidence interval of the conductance [1/s].
    start
        Absolute pressure at the start, without the settling part [Pa].
    settling, time_constant
        Amplitude and time constant of the settling [Pa, s]; 0 without settling.
    error
        RMSE on the second half of the fit to the first half [Pa].
    excluded
        Whether the second half contradicts the characteristic.
    simulated
        Pressure at the samples, from the fit to the whole recording, shape (n,) [Pa].

    """

    characteristic: str
    conductance: float
    interval: tuple[float, float]
    start: float
    settling: float
    time_constant: float
    error: float
    excluded: bool
    simulated: Array


@dataclass(frozen=True)
class Decay:
    """
    Result of a leak test.

    Attributes
    ----------
    times, pressure
        Times and absolute pressures of the samples, shape (n,) [s, Pa].
    ambient_pressure
        Absolute ambient pressure [Pa].
    noise
        Standard deviation of the noise from sample to sample [Pa].
    leaks
        Fits of all characteristics, the smallest error first.
    distinguishable_below
        Gauge pressure below which the characteristics are distinguishable, and the time until then [Pa, s]; None if
        they are distinguishable already, or never.

    """

    times: Array
    pressure: Array
    ambient_pressure: float
    noise: float
    leaks: tuple[Leak, ...]
    distinguishable_below: tuple[float, float] | None

    @property
    def best(self) -> Leak:
        """The characteristic with the smallest error."""
        return self.leaks[0]

    @property
    def has_leak(self) -> bool:
        """Whether there is a leak: its confidence interval excludes zero."""
        return self.best.interval[0] > 0.0


def decay_of(signal: Signal, ambient_pressure: float) -> Decay:
    """
    Estimate the leak from a pressure that falls behind a shut valve.

    Parameters
    ----------
    signal
        Absolute pressure from the time at which the valve is shut [Pa].
    ambient_pressure
        Absolute ambient pressure [Pa].

    Raises
    ------
    InputError
        If there are too few samples, or the pressure never changes or is not above ambient.

    """
    check_type('signal', signal, Signal, 'a signal, such as recording.cylinders["cylinder_a"].pressure')
    check_numbers(ambient_pressure=ambient_pressure)
    if len(signal) < FEWEST_DECAY_SAMPLES:
        raise InputError(f'{len(signal)} samples are too few: record at least {FEWEST_DECAY_SAMPLES}')
    times, pressure = signal.times - signal.times[0], np.asarray(signal.values)
    if np.ptp(pressure) == 0.0:
        raise InputError(f'never changes ({pressure[0]:g} Pa): is its sensor connected?')
    gauge = pressure - ambient_pressure
    if float(np.median(gauge)) < LEAST_GAUGE_PRESSURE:
        raise InputError(
            f'is mostly {1e-3 * float(np.median(gauge)):.4g} kPa above ambient: check its reference and its unit, '
            'or use the part before the chamber is empty'
        )
    noise = max(float(np.std(np.diff(pressure))) / math.sqrt(2.0), LEAST_DECAY_NOISE)
    falls = {name: _Fall(name, ambient_pressure, float(np.max(gauge))) for name in LAWS}
    fits = [_fit_first_half(fall, times, pressure) for fall in falls.values()]
    limit = min(LARGEST_LAW_ERROR * noise, LARGEST_LAW_ERROR_RATIO * max(min(fit.error for fit in fits), noise))
    leaks = sorted((_fit_all_samples(fit, times, pressure, limit) for fit in fits), key=lambda leak: leak.error)
    distinguishable_below = None
    if not any(leak.excluded for leak in leaks):
        distinguishable_below = _distinguishable_below(list(falls.values()), leaks[0], noise)
    return Decay(times, pressure, ambient_pressure, noise, tuple(leaks), distinguishable_below)


def rate_of(characteristic: str, pressure: float, ambient_pressure: float) -> float:
    """Return the rate at which the pressure falls by a characteristic, for a conductance of 1 / s [Pa/s]."""
    moment = Moment(time=0.0, x=0.0, rate=0.0, p=pressure, setpoint=pressure, ambient=ambient_pressure)
    return -float(MODULES['leakage'].chamber(0.0, moment, 1.0, LAWS[characteristic]))


class _Fall:
    """
    Tabulated fall of a pressure by a leak characteristic.

    `scaled_times` is the time from the first pressure to each of the falling `pressures`, times the conductance [-].
    """

    def __init__(self, characteristic: str, ambient_pressure: float, highest: float) -> None:
        self.characteristic, self.ambient = characteristic, ambient_pressure
        shares = np.geomspace(LARGEST_START_PRESSURE, LEAST_TABULATED_PRESSURE, TABULATED_PRESSURES)
        self.pressures = ambient_pressure + shares * highest
        self.rates = np.array(
            [rate_of(characteristic, pressure, ambient_pressure) for pressure in self.pressures.tolist()]
        )
        self.scaled_times = cumulative_trapezoid(1.0 / self.rates, -self.pressures, initial=0.0)

    def pressure_at(self, times: Array, start: float, conductance: float) -> Array:
        """Return the pressure at times after the start pressure, shape (n,) [Pa]."""
        begin = np.interp(-start, -self.pressures, self.scaled_times)
        return np.asarray(np.interp(begin + conductance * times, self.scaled_times, self.pressures))


@dataclass(frozen=True)
class _Fit:
    """Fit of a characteristic to the first half: unknowns in search units, and their bounds."""

    fall: _Fall
    unknowns: Array
    lower: Array
    upper: Array
    scale: float
    error: float

    @property
    def settles(self) -> bool:
        return self.unknowns.size > 2

    def simulated(self, times: Array, unknowns: Array) -> Array:
        """Return the pressure for start [scale], conductance [1/duration], settling [scale] and log time constant."""
        duration = float(times[-1])
        start = self.fall.ambient + self.scale * unknowns[0]
        pressure = self.fall.pressure_at(times, start, float(unknowns[1]) / duration)
        if self.settles:
            pressure = pressure + self.scale * unknowns[2] * np.exp(-times / math.exp(unknowns[3]))
        return np.asarray(pressure)


def _fit_first_half(fall: _Fall, times: Array, pressure: Array) -> _Fit:
    """Fit a characteristic to the first half, with settling if the settling reduces the error on the second half."""
    first = times <= 0.5 * times[-1]
    leak_only, settling = (_fit_with_settling(fall, times, pressure, first, settles) for settles in (False, True))
    return settling if settling.error < LARGEST_SETTLING_RATIO * leak_only.error else leak_only


def _fit_with_settling(fall: _Fall, times: Array, pressure: Array, first: NDArray[np.bool_], settles: bool) -> _Fit:
    scale, duration = float(np.max(pressure)) - fall.ambient, float(times[-1])
    period = float(np.median(np.diff(times)))
    lower, upper = np.array([0.0, 0.0]), np.array([LARGEST_START_PRESSURE, np.inf])
    begins = [np.array([float(np.median(pressure[:5]) - fall.ambient) / scale, 1e-2])]
    if settles:
        lower, upper = (
            np.append(lower, [-LARGEST_SETTLING, math.log(LEAST_TIME_CONSTANT * period)]),
            np.append(upper, [LARGEST_SETTLING, math.log(duration)]),
        )
        constants = np.geomspace(10.0 * period, 0.9 * duration, SETTLING_STARTS)
        begins = [np.append(begins[0], [1e-3, math.log(constant)]) for constant in constants]
    blank = _Fit(fall, begins[0], lower, upper, scale, math.inf)
    searched = [_search_unknowns(blank, times, pressure, first, begin) for begin in begins]
    unknowns = np.asarray(min(searched, key=lambda optimum: float(optimum.cost)).x)
    residual = (pressure - blank.simulated(times, unknowns))[~first]
    return _Fit(fall, unknowns, lower, upper, scale, rms(residual))


def _search_unknowns(
    fit: _Fit, times: Array, pressure: Array, counts: NDArray[np.bool_], begin: Array
) -> OptimizeResult:
    """Search the unknowns with the least sum of squares at the samples that count."""

    def residual(unknowns: Array) -> Array:
        return np.asarray((fit.simulated(times, unknowns) - pressure)[counts] / fit.scale)

    return least_squares(
        residual,
        np.clip(begin, fit.lower, fit.upper),
        bounds=(fit.lower, fit.upper),
        x_scale='jac',
        ftol=DECAY_TOLERANCE,
        xtol=DECAY_TOLERANCE,
        gtol=DECAY_TOLERANCE,
    )


def _fit_all_samples(fit: _Fit, times: Array, pressure: Array, largest_error: float) -> Leak:
    """Return the fit of a characteristic to all samples, with its standard errors."""
    optimum = _search_unknowns(fit, times, pressure, np.ones(times.size, np.bool_), fit.unknowns)
    unknowns = np.asarray(optimum.x)
    simulated = fit.simulated(times, unknowns)
    degrees = times.size - unknowns.size
    covariance = information([fit.scale * np.asarray(optimum.jac)], [pressure - simulated]).covariance(degrees)
    duration = float(times[-1])
    std = math.sqrt(max(float(covariance[1, 1]), 0.0)) / duration
    conductance = float(unknowns[1]) / duration
    margin = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * std
    settling = (fit.scale * float(unknowns[2]), math.exp(float(unknowns[3]))) if fit.settles else (0.0, 0.0)
    return Leak(
        characteristic=fit.fall.characteristic,
        conductance=conductance,
        interval=(max(conductance - margin, 0.0), conductance + margin),
        start=fit.fall.ambient + fit.scale * float(unknowns[0]),
        settling=settling[0],
        time_constant=settling[1],
        error=fit.error,
        excluded=fit.error > largest_error,
        simulated=simulated,
    )


def _distinguishable_below(falls: list[_Fall], leak: Leak, noise: float) -> tuple[float, float] | None:
    """Return the gauge pressure at which characteristics with equal initial rates differ, and its time, or None."""
    if leak.interval[0] <= 0.0:
        return None
    leak_fall = next(fall for fall in falls if fall.characteristic == leak.characteristic)
    at_start = partial(np.interp, -leak.start)
    rate = leak.conductance * float(at_start(-leak_fall.pressures, leak_fall.rates))
    begin = float(at_start(-leak_fall.pressures, leak_fall.scaled_times))
    times = (leak_fall.scaled_times[leak_fall.scaled_times > begin] - begin) / leak.conductance
    courses = [
        fall.pressure_at(times, leak.start, rate / float(at_start(-fall.pressures, fall.rates))) for fall in falls
    ]
    differ = np.ptp(courses, axis=0) > LEAST_LAW_DISTANCE * noise
    if not differ.any():
        return None
    first = int(np.argmax(differ))
    return float(courses[falls.index(leak_fall)][first]) - leak_fall.ambient, float(times[first])
