# SPDX-License-Identifier: Apache-2.0
"""
A pressure that falls behind a shut valve: how much leaks, and by which law.

Without a regulator and without motion the chamber's mass balance is left, equation (1) of the paper with a leak for its
valves: dp/dt = -conductance law(p). How long the pressure takes from one value to another is then an integral over
1 / law, so that no equation has to be solved step by step. Beside a leak the pressure may settle: air that was
compressed cools down, and a soft chamber gives way. The first half of a recording is fitted, the second tells the laws
apart.
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
"""Laws of the effect `leakage`, by what its parameter `orifice` is."""


@dataclass(frozen=True)
class Leak:
    """
    One law, fitted to a decay.

    Attributes
    ----------
    law
        One of `LAWS`.
    conductance
        Share of the gauge pressure (orifice: of the absolute) lost in a second, of the whole recording [1/s].
    interval
        Its 95 % interval [1/s].
    start
        Absolute pressure at the start that leaks away, without what settles [Pa].
    settling, time_constant
        By how much the pressure settles beside the leak, and its time constant [Pa, s]; 0 where it need not.
    error
        Of what was fitted to the first half, on the second [Pa].
    excluded
        Whether the second half speaks against the law.
    simulated
        Pressure at the samples, of the whole recording's fit, shape (n,) [Pa].

    """

    law: str
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
    What a decay tells.

    Attributes
    ----------
    times, pressure
        Of the samples, shape (n,) [s], absolute [Pa].
    ambient_pressure
        Absolute [Pa].
    noise
        From sample to sample [Pa].
    leaks
        Every law, the one that errs least first.
    tells_below
        Gauge pressure to which it would have to fall until the laws can be told apart, and the time that takes
        [Pa, s]; None where the laws are told apart already, or never are.

    """

    times: Array
    pressure: Array
    ambient_pressure: float
    noise: float
    leaks: tuple[Leak, ...]
    tells_below: tuple[float, float] | None

    @property
    def best(self) -> Leak:
        """The law that errs least."""
        return self.leaks[0]

    @property
    def told(self) -> bool:
        """Whether there is a leak at all: zero lies outside of its interval."""
        return self.best.interval[0] > 0.0


def decay_of(signal: Signal, ambient_pressure: float) -> Decay:
    """
    Return what a pressure tells that falls behind a shut valve.

    Parameters
    ----------
    signal
        Absolute pressure [Pa], from when the valve is shut.
    ambient_pressure
        Absolute [Pa].

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
            'or take the part before the chamber is empty'
        )
    noise = max(float(np.std(np.diff(pressure))) / math.sqrt(2.0), LEAST_DECAY_NOISE)
    falls = {law: _Fall(law, ambient_pressure, float(np.max(gauge))) for law in LAWS}
    fits = [_fitted(fall, times, pressure) for fall in falls.values()]
    limit = min(LARGEST_LAW_ERROR * noise, LARGEST_LAW_ERROR_RATIO * max(min(one.error for one in fits), noise))
    leaks = sorted((_summed_up(one, times, pressure, limit) for one in fits), key=lambda one: one.error)
    apart = None
    if not any(one.excluded for one in leaks):
        apart = _told_below(list(falls.values()), leaks[0], noise)
    return Decay(times, pressure, ambient_pressure, noise, tuple(leaks), apart)


def rate_of(law: str, pressure: float, ambient_pressure: float) -> float:
    """Return how fast the pressure falls by a law of the library, for a conductance of 1 / s [Pa/s]."""
    moment = Moment(time=0.0, x=0.0, rate=0.0, p=pressure, setpoint=pressure, ambient=ambient_pressure)
    return -float(MODULES['leakage'].chamber(0.0, moment, 1.0, LAWS[law]))


class _Fall:
    """
    How a pressure falls by a law.

    `took` is the time to each of the falling `pressures` from the first one, times the conductance [-].
    """

    def __init__(self, law: str, ambient_pressure: float, highest: float) -> None:
        self.law, self.ambient = law, ambient_pressure
        shares = np.geomspace(LARGEST_START_PRESSURE, LEAST_TABULATED_PRESSURE, TABULATED_PRESSURES)
        self.pressures = ambient_pressure + shares * highest
        self.rates = np.array([rate_of(law, one, ambient_pressure) for one in self.pressures.tolist()])
        self.took = cumulative_trapezoid(1.0 / self.rates, -self.pressures, initial=0.0)

    def at(self, times: Array, start: float, conductance: float) -> Array:
        """Return the pressure at times, shape (n,) [Pa]."""
        began = np.interp(-start, -self.pressures, self.took)
        return np.asarray(np.interp(began + conductance * times, self.took, self.pressures))


@dataclass(frozen=True)
class _Fit:
    """What was fitted to the first half: the law, unknowns as they are searched, and their bounds."""

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
        """Return the pressure by start [scale], conductance [1/duration], settling [scale] and log time constant."""
        duration = float(times[-1])
        start = self.fall.ambient + self.scale * unknowns[0]
        found = self.fall.at(times, start, float(unknowns[1]) / duration)
        if self.settles:
            found = found + self.scale * unknowns[2] * np.exp(-times / math.exp(unknowns[3]))
        return np.asarray(found)


def _fitted(fall: _Fall, times: Array, pressure: Array) -> _Fit:
    """Return a law fitted to the first half, with settling where the second half is the better for it."""
    first = times <= 0.5 * times[-1]
    alone, settling = (_fit_of(fall, times, pressure, first, settles) for settles in (False, True))
    return settling if settling.error < LARGEST_SETTLING_RATIO * alone.error else alone


def _fit_of(fall: _Fall, times: Array, pressure: Array, first: NDArray[np.bool_], settles: bool) -> _Fit:
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
        begins = [np.append(begins[0], [1e-3, math.log(one)]) for one in constants]
    blank = _Fit(fall, begins[0], lower, upper, scale, math.inf)
    searched = [_searched(blank, times, pressure, first, begin) for begin in begins]
    unknowns = np.asarray(min(searched, key=lambda one: float(one.cost)).x)
    left = (pressure - blank.simulated(times, unknowns))[~first]
    return _Fit(fall, unknowns, lower, upper, scale, rms(left))


def _searched(fit: _Fit, times: Array, pressure: Array, counts: NDArray[np.bool_], begin: Array) -> OptimizeResult:
    """Return the unknowns that make the sum of squares at samples that count least."""

    def left(unknowns: Array) -> Array:
        return np.asarray((fit.simulated(times, unknowns) - pressure)[counts] / fit.scale)

    return least_squares(
        left,
        np.clip(begin, fit.lower, fit.upper),
        bounds=(fit.lower, fit.upper),
        x_scale='jac',
        ftol=DECAY_TOLERANCE,
        xtol=DECAY_TOLERANCE,
        gtol=DECAY_TOLERANCE,
    )


def _summed_up(fit: _Fit, times: Array, pressure: Array, largest_error: float) -> Leak:
    """Return a law fitted to all samples."""
    found = _searched(fit, times, pressure, np.ones(times.size, np.bool_), fit.unknowns)
    unknowns = np.asarray(found.x)
    simulated = fit.simulated(times, unknowns)
    degrees = times.size - unknowns.size
    covariance = information([fit.scale * np.asarray(found.jac)], [pressure - simulated]).covariance(degrees)
    duration = float(times[-1])
    std = math.sqrt(max(float(covariance[1, 1]), 0.0)) / duration
    conductance = float(unknowns[1]) / duration
    reach = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * std
    settling = (fit.scale * float(unknowns[2]), math.exp(float(unknowns[3]))) if fit.settles else (0.0, 0.0)
    return Leak(
        law=fit.fall.law,
        conductance=conductance,
        interval=(max(conductance - reach, 0.0), conductance + reach),
        start=fit.fall.ambient + fit.scale * float(unknowns[0]),
        settling=settling[0],
        time_constant=settling[1],
        error=fit.error,
        excluded=fit.error > largest_error,
        simulated=simulated,
    )


def _told_below(falls: list[_Fall], leak: Leak, noise: float) -> tuple[float, float] | None:
    """Return the gauge pressure at which laws that begin alike differ, and when that is; None where they never do."""
    if leak.interval[0] <= 0.0:
        return None
    own = next(fall for fall in falls if fall.law == leak.law)
    at_start = partial(np.interp, -leak.start)
    rate = leak.conductance * float(at_start(-own.pressures, own.rates))
    began = float(at_start(-own.pressures, own.took))
    times = (own.took[own.took > began] - began) / leak.conductance
    courses = [fall.at(times, leak.start, rate / float(at_start(-fall.pressures, fall.rates))) for fall in falls]
    apart = np.ptp(courses, axis=0) > LEAST_LAW_DISTANCE * noise
    if not apart.any():
        return None
    first = int(np.argmax(apart))
    return float(courses[falls.index(own)][first]) - own.ambient, float(times[first])
