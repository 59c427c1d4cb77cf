# SPDX-License-Identifier: Apache-2.0
"""
The displacement that the piston really made, from the one that was measured.

The measured displacement's own noise reaches the simulated pressure multiplied by K_x, as large on measured data as the
pressure sensor's noise. It is smoothed here as a Wiener process integrated twice (white acceleration) or three times
(white jerk), seen in white noise: the cubic or quintic smoothing spline (Wecker and Ansley, 1983) whose stiffness is
the maximum-likelihood one. Which of the two it is the likelihood tells, too: a piston that follows a surface moves so
smoothly that white acceleration would leave it no noise.

A step of the gauge block between long rests is neither: one stiffness for all would smear the step or follow the noise
of the rests. Where what drives the motion is sudden beside the rest of the recording it gets a density of its own, if
that makes the samples likelier by more than the numbers spent on it (Schwarz, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.smoother import Samples, likeliest
from cfd_pneumatic.identification.data.split import stroke_times
from cfd_pneumatic.identification.data.stamps import overlapping, regular_clock
from cfd_pneumatic.identification.data.thresholds import (
    FEWEST_SAMPLES,
    GRID_PIECE,
    LARGEST_BEND_OF_NOISE,
    LARGEST_BEND_OF_STROKE,
    LARGEST_DISPLACEMENT,
    LEAST_MOTION,
    LONGEST_PERIOD,
    LONGEST_SMOOTHED_WHOLE,
    MOST_LINES_PER_STEP,
    SMOOTHING_MARGIN,
    SMOOTHING_WINDOW,
    TRAVEL_STRIDE,
)
from cfd_pneumatic.identification.data.value_range import check_range
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.runtime import map_in_threads

_ORDERS = (2, 3)  # how often white noise is integrated to give the displacement


@dataclass(frozen=True)
class Motion:
    """
    A smoothed displacement.

    Attributes
    ----------
    times
        Sample times, shape (n,) [s].
    displacement, rate, acceleration
        Smoothed displacement and its derivatives, shape (n,) [m, m/s, m/s^2]; where the acceleration jumps, the one
        before.
    reach
        Largest displacement less the smallest [m].
    noise
        Standard deviation of the measured displacement's noise [m].
    uncertainty
        Root mean square of the smoothed displacement's standard errors [m].
    rate_uncertainty
        Likewise of its rate [m/s].
    order
        2 where the motion is likelier one of white acceleration, 3 where one of white jerk.
    deviance
        Minus twice the logarithm of the likelihood of the samples, or of the liveliest window of many, up to a
        constant; smaller where the times suit the samples better.
    stamps
        The samples' stamps as recorded, shape (n,) [s]; `times` are when they were taken.

    """

    times: Array
    displacement: Array
    rate: Array
    acceleration: Array
    reach: float
    noise: float
    uncertainty: float
    rate_uncertainty: float
    order: int
    deviance: float
    stamps: Array

    def on_clock(self, stamps: Array) -> Array:
        """Return when something was that is stamped as the samples are, shape (n,) [s]."""
        if self.stamps is self.times:
            return stamps
        return stamps + np.interp(stamps, self.stamps, self.times - self.stamps)

    def clock_of(self, stamps: Array) -> Array:
        """Return when samples of another signal were taken [s]: with the displacement's, or by a clock of their own."""
        if self.stamps is self.times:
            return stamps
        at = np.minimum(np.searchsorted(self.stamps, stamps), self.stamps.size - 1)
        if np.array_equal(self.stamps[at], stamps):
            return self.on_clock(stamps)
        clock = regular_clock(stamps)
        return stamps if clock is None else clock

    def during(self, times: Array) -> slice:
        """Return which of increasing times lie between the first and the last sample [s]."""
        begin, end = np.searchsorted(times, [self.times[0], np.nextafter(self.times[-1], np.inf)]).tolist()
        return slice(begin, end)

    def on_grid(self, sampled: Array, others: Array) -> tuple[Array, Array]:
        """
        Return the grid of a model and the displacement on it, each of shape (n,) [s, m].

        It ends with the last of the times at which something was sampled, and holds the knots of the motion, too.
        """
        grids, displacements = [], []
        begin = float(np.nextafter(self.times[0], -np.inf))
        for first in range(0, self.times.size - 1, GRID_PIECE):  # splines take several times the room of their samples
            piece = self.part(slice(first, first + GRID_PIECE + 1))
            end = min(float(piece.times[-1]), float(sampled[-1]))
            knots = np.unique(np.concatenate([piece.knots(), _after(begin, end, sampled), _after(begin, end, others)]))
            grids.append(_after(begin, end, knots))
            displacements.append(piece.at(grids[-1]))
            begin = end
        return np.concatenate(grids), np.concatenate(displacements)

    def part(self, samples: slice) -> Motion:
        """Return the motion at some neighbouring samples."""
        times = self.times[samples]
        return replace(
            self,
            times=times,
            displacement=self.displacement[samples],
            rate=self.rate[samples],
            acceleration=self.acceleration[samples],
            stamps=times if self.stamps is self.times else self.stamps[samples],
        )

    def knots(self) -> Array:
        """
        Return times between which a straight line follows the displacement well within its noise [s].

        These are the sample times and, where the motion bends in between (a step of a few samples), evenly spaced ones
        inside a sample step. Bends are off the same way in many samples, and would count where noise averages out. A
        bend of a small share of the stroke is let be, whatever the noise: the displacement at the knots has no part in
        it, so that it moves the pressure between them by that share of what the stroke does, and at them by the even
        smaller part that the regulator makes good within one step.
        """
        steps = np.diff(self.times)
        acceleration = _derivative(self._pieces, 2)
        sharpest = np.maximum(np.abs(acceleration[-1]), np.abs(np.polyval(acceleration, steps)))
        bend = sharpest * steps**2 / 8.0
        tolerance = max(LARGEST_BEND_OF_NOISE * self.noise, LARGEST_BEND_OF_STROKE * self.reach)
        pieces = np.ones(steps.size, dtype=np.intp)
        if tolerance > 0.0:
            pieces = np.clip(np.ceil(np.sqrt(bend / tolerance)), 1, MOST_LINES_PER_STEP).astype(np.intp)
        step_of = np.repeat(np.arange(steps.size), pieces)
        rank = np.arange(step_of.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        return np.append(self.times[step_of] + steps[step_of] * rank / pieces[step_of], self.times[-1])

    def at(self, times: Array) -> Array:
        """Return the smoothing spline's displacement at times within the recording, shape (n,) [m]."""
        return self._spline(times, 0)

    def rate_at(self, times: Array) -> Array:
        """Return the smoothing spline's rate at times within the recording, shape (n,) [m/s]."""
        return self._spline(times, 1)

    def acceleration_at(self, times: Array) -> Array:
        """Return the smoothing spline's acceleration at times within the recording, shape (n,) [m/s^2]."""
        return self._spline(times, 2)

    def _spline(self, times: Array, order: int) -> Array:
        """Return a derivative of what to expect between samples."""
        at = np.clip(np.searchsorted(self.times, times, side='right') - 1, 0, self.times.size - 2)
        since = times - self.times[at]
        value = np.zeros(np.shape(times))
        for coefficient in _derivative(self._pieces, order):
            value = value * since + coefficient[at]
        return value

    @lazy_property
    def _pieces(self) -> list[Array]:
        """
        The coefficients of what to expect in each step between samples, the highest power's first, each (n - 1,).

        For white acceleration cubics with both ends' displacement and rate; for white jerk quintics with their
        acceleration as well.
        """
        h = np.diff(self.times)
        x, v, a = self.displacement[:-1], self.rate[:-1], self.acceleration[:-1]
        if self.order == 2:
            mean, ahead = np.diff(self.displacement) / h, self.rate[1:]
            return [(v + ahead - 2.0 * mean) / h**2, (3.0 * mean - 2.0 * v - ahead) / h, v, x]
        off_x = np.diff(self.displacement) - h * (v + 0.5 * h * a)
        off_v = h * (np.diff(self.rate) - h * a)
        off_a = h**2 * np.diff(self.acceleration)
        return [
            (6.0 * off_x - 3.0 * off_v + 0.5 * off_a) / h**5,
            (-15.0 * off_x + 7.0 * off_v - off_a) / h**4,
            (10.0 * off_x - 4.0 * off_v + 0.5 * off_a) / h**3,
            0.5 * a,
            v,
            x,
        ]


def _derivative(pieces: Sequence[Array], order: int) -> list[Array]:
    """Return the coefficients of a derivative of polynomials, the highest power's first."""
    power = len(pieces) - 1
    return [math.perm(power - rank, order) * one for rank, one in enumerate(pieces[: power + 1 - order])]


def smooth_motion(stamps: Array, measured: Array) -> Motion:
    """
    Return the smoothed displacement.

    Where the stamps jitter about a regular clock, the samples were taken by either: the motion is smooth against one of
    them.

    Parameters
    ----------
    stamps
        Increasing, shape (n,), n at least 5 [s].
    measured
        Measured displacement, shape (n,) [m].

    """
    clock = regular_clock(stamps)
    if stamps.size <= LONGEST_SMOOTHED_WHOLE:
        return _likeliest_motion(stamps, clock, measured)
    windows = list(overlapping(stamps.size, SMOOTHING_WINDOW, SMOOTHING_MARGIN))
    liveliest = max((window for _, window in windows), key=partial(_travel, measured))
    known = _likeliest_motion(stamps[liveliest], None if clock is None else clock[liveliest], measured[liveliest])
    times = stamps if clock is None or known.stamps is known.times else clock
    return _joined(times, stamps, measured, windows, known)


def _likeliest_motion(stamps: Array, clock: Array | None, measured: Array) -> Motion:
    """Return the smoothed displacement by the stamps or by a clock, if there is one."""
    if clock is None:
        return _smoothed(stamps, measured)
    as_stamped, by_clock = map_in_threads(lambda times: _smoothed(times, measured), [stamps, clock])
    return replace(by_clock, stamps=stamps) if by_clock.deviance <= as_stamped.deviance else as_stamped


def _travel(measured: Array, window: slice) -> float:
    return float(np.sum(np.abs(np.diff(measured[window][::TRAVEL_STRIDE]))))


def _joined(
    times: Array, stamps: Array, measured: Array, windows: Sequence[tuple[slice, slice]], known: Motion
) -> Motion:
    """Return what is smoothed in windows, of which one is known."""
    size = times.size
    found = replace(
        known, times=times, stamps=stamps, displacement=np.empty(size), rate=np.empty(size), acceleration=np.empty(size)
    )

    def smooth(place: tuple[slice, slice]) -> tuple[float, float]:
        own, window = place
        motion = _smoothed(times[window], measured[window], (known.order,))
        inner = motion.part(slice(own.start - window.start, own.stop - window.start))
        found.displacement[own], found.rate[own] = inner.displacement, inner.rate
        found.acceleration[own] = inner.acceleration
        return motion.uncertainty, motion.rate_uncertainty

    uncertainty, of_rate = np.sqrt(np.mean(np.square(map_in_threads(smooth, windows)), axis=0)).tolist()
    return replace(found, reach=float(np.ptp(found.displacement)), uncertainty=uncertainty, rate_uncertainty=of_rate)


def _after(begin: float, end: float, times: Array) -> Array:
    """Return those of increasing times that lie after one and up to another [s]."""
    first, last = np.searchsorted(times, [begin, end], side='right')
    return times[first:last]


def _smoothed(times: Array, measured: Array, orders: Sequence[int] = _ORDERS) -> Motion:
    # in units of the mean step and of the displacement's spread, so that the search sees numbers about one
    unit = float(np.mean(np.diff(times)))
    scale = float(np.std(measured)) or 1.0
    steps, values = np.diff(times) / unit, (measured - measured[0]) / scale
    found = map_in_threads(lambda order: likeliest(order, Samples.of(steps, values)), orders)
    best = min(found, key=lambda smoother: smoother.deviance)
    mean, variance = best.smooth()
    noise = scale * best.noise
    spread = np.sqrt(np.mean(np.clip(variance, 0.0, [1.0, np.inf]), axis=0)).tolist()
    displacement = measured[0] + scale * mean[:, 0]
    return Motion(
        times=times,
        displacement=displacement,
        rate=scale / unit * mean[:, 1],
        acceleration=scale / unit**2 * mean[:, 2],
        reach=float(np.ptp(displacement)),
        noise=noise,
        uncertainty=noise * spread[0],
        rate_uncertainty=noise / unit * spread[1],
        order=best.order,
        deviance=best.deviance,
        stamps=times,
    )


def observed_motion(recording: Recording) -> tuple[Motion, Array]:
    """
    Return the smoothed displacement and the times at which its strokes begin and end.

    Of a piston at rest these are the times at which a set-point changes, and the end.

    Raises
    ------
    InputError
        If the recording is too short, nothing moves and no set-point changes, or its numbers are no displacements.

    """
    signal = recording.displacement
    if signal.times.size < FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: {signal.times.size} displacement samples are too few to identify anything: '
            f'record at least {FEWEST_SAMPLES}'
        )
    period = float(np.median(np.diff(signal.times)))
    if period > LONGEST_PERIOD:
        raise InputError(
            f'{recording.name}: a sample every {period:.3g} s tells nothing of a pressure, which settles in seconds: '
            'record at least two a second'
        )
    check_range(f'{recording.name}: the displacement', signal.values, LARGEST_DISPLACEMENT, 'm')
    if recording.rests:
        return _resting(signal), np.append(_changes(recording), signal.times[-1])
    motion = smooth_motion(signal.times, signal.values)
    strokes = stroke_times(motion.times, motion.displacement, motion.noise)
    travel = float(np.ptp(signal.values))
    if strokes.size == 0 or travel <= LEAST_MOTION * motion.noise:
        raise InputError(
            f'{recording.name}: the piston does not move (range {travel * 1e3:.3g} mm, '
            f'noise {motion.noise * 1e3:.3g} mm): record strokes of the piston, or leave the displacement out of the '
            'mapping where it rests on purpose'
        )
    return motion, strokes


def _changes(recording: Recording) -> Array:
    """Return when a set-point changes while the pressure of a piston at rest is known [s]."""
    changed = [one.setpoint.times[1:] for one in recording.cylinders.values() if one.setpoint is not None]
    first, last = recording.displacement.times[[0, -1]].tolist()
    changes = _after(first, last, np.unique(np.concatenate([np.empty(0), *changed])))
    if not changes.size:
        raise InputError(
            f'{recording.name}: no displacement was recorded, and no set-point changes: record strokes of the piston, '
            'or steps of the set-point; what a pressure tells that falls behind a shut valve, `leak_test` says'
        )
    return changes


def _resting(signal: Signal) -> Motion:
    """Return a displacement that never changes."""
    still = np.zeros(len(signal))
    return Motion(
        times=signal.times,
        displacement=still,
        rate=still,
        acceleration=still,
        reach=0.0,
        noise=0.0,
        uncertainty=0.0,
        rate_uncertainty=0.0,
        order=2,
        deviance=0.0,
        stamps=signal.times,
    )
