# SPDX-License-Identifier: Apache-2.0
"""
Estimate the motion of the piston from the measured displacement.

The noise of the measured displacement reaches the simulated pressure multiplied by K_x. On measured data this is as
large as the noise of the pressure sensor. The displacement is modelled as white acceleration integrated twice, or white
jerk integrated three times, and measured in white noise. The estimate is a cubic or quintic smoothing spline (Wecker
and Ansley, 1983). Its stiffness and its order have the largest likelihood. A piston that follows a surface needs the
quintic spline: white acceleration would explain its noise as motion.

A step of the gauge block between long rests fits neither model: a common stiffness would smear the step or follow the
noise of the rests. The few steps that are driven much harder get a larger density, if the likelihood gains more than
the additional parameters cost (Schwarz, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.smoother import Samples, likeliest_smoother
from cfd_pneumatic.identification.data.split import stroke_times
from cfd_pneumatic.identification.data.stamps import overlapping_windows, regular_clock
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

_ORDERS = (2, 3)  # integrations from white noise to the displacement


@dataclass(frozen=True)
class Motion:
    """
    A smoothed displacement.

    Attributes
    ----------
    times
        Sample times, shape (n,) [s].
    displacement, rate, acceleration
        Smoothed displacement and its derivatives, shape (n,) [m, m/s, m/s^2]; at a jump of the acceleration, the value
        before the jump.
    reach
        Largest minus smallest displacement [m].
    noise
        Standard deviation of the measured displacement's noise [m].
    uncertainty
        Root mean square of the smoothed displacement's standard errors [m].
    rate_uncertainty
        Root mean square of the smoothed rate's standard errors [m/s].
    order
        2 if white acceleration is likelier, 3 if white jerk is likelier.
    deviance
        Minus twice the log likelihood of the samples, or of the liveliest window of a long recording, up to a constant.
        A smaller deviance means that the times suit the samples better.
    stamps
        Stamps of the samples as recorded, shape (n,) [s]; `times` are the times of sampling.

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
        """Convert stamps by the clock of the displacement to times of sampling, shape (n,) [s]."""
        if self.stamps is self.times:
            return stamps
        return stamps + np.interp(stamps, self.stamps, self.times - self.stamps)

    def clock_of(self, stamps: Array) -> Array:
        """Return when samples of another signal were taken [s], by the displacement's clock or a separate clock."""
        if self.stamps is self.times:
            return stamps
        indices = np.minimum(np.searchsorted(self.stamps, stamps), self.stamps.size - 1)
        if np.array_equal(self.stamps[indices], stamps):
            return self.on_clock(stamps)
        clock = regular_clock(stamps)
        return stamps if clock is None else clock

    def during(self, times: Array) -> slice:
        """Return the slice of increasing times [s] between the first and the last sample."""
        begin, end = np.searchsorted(times, [self.times[0], np.nextafter(self.times[-1], np.inf)]).tolist()
        return slice(begin, end)

    def on_grid(self, sampled: Array, further: Array) -> tuple[Array, Array]:
        """
        Return the grid of a model and the displacement on the grid, each of shape (n,) [s, m].

        The grid holds the sampling times, the further times and the knots of the motion. It ends at the last sampling
        time.
        """
        grids, displacements = [], []
        begin = float(np.nextafter(self.times[0], -np.inf))
        for first in range(
            0, self.times.size - 1, GRID_PIECE
        ):  # splines need several times the memory of their samples
            piece = self.part(slice(first, first + GRID_PIECE + 1))
            end = min(float(piece.times[-1]), float(sampled[-1]))
            knots = np.unique(
                np.concatenate([piece.knots(), _times_within(begin, end, sampled), _times_within(begin, end, further)])
            )
            grids.append(_times_within(begin, end, knots))
            displacements.append(piece.displacement_at(grids[-1]))
            begin = end
        return np.concatenate(grids), np.concatenate(displacements)

    def part(self, samples: slice) -> Motion:
        """Return the motion at some adjacent samples."""
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

        The knots are the sample times and, if the motion bends between samples, evenly spaced times in between. Errors
        of bends have the same sign in many samples: they count although noise averages out. A bend of a small share of
        the stroke is ignored at any noise. It moves the pressure between knots by that share of the stroke's effect.
        The displacement at the knots is exact, so that the pressure there moves even less.
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

    def displacement_at(self, times: Array) -> Array:
        """Return the smoothing spline's displacement at times within the recording, shape (n,) [m]."""
        return self._spline(times, 0)

    def rate_at(self, times: Array) -> Array:
        """Return the smoothing spline's rate at times within the recording, shape (n,) [m/s]."""
        return self._spline(times, 1)

    def acceleration_at(self, times: Array) -> Array:
        """Return the smoothing spline's acceleration at times within the recording, shape (n,) [m/s^2]."""
        return self._spline(times, 2)

    def _spline(self, times: Array, order: int) -> Array:
        """Evaluate a derivative of the smoothing spline at some times."""
        indices = np.clip(np.searchsorted(self.times, times, side='right') - 1, 0, self.times.size - 2)
        elapsed = times - self.times[indices]
        value = np.zeros(np.shape(times))
        for coefficient in _derivative(self._pieces, order):
            value = value * elapsed + coefficient[indices]
        return value

    @lazy_property
    def _pieces(self) -> list[Array]:
        """
        Coefficients of the spline's polynomial in each step between samples, highest power first, each (n - 1,).

        White acceleration gives cubics through displacement and rate at both ends. White jerk gives quintics through
        the accelerations as well.
        """
        h = np.diff(self.times)
        x, v, a = self.displacement[:-1], self.rate[:-1], self.acceleration[:-1]
        if self.order == 2:
            mean_rate, next_rate = np.diff(self.displacement) / h, self.rate[1:]
            return [(v + next_rate - 2.0 * mean_rate) / h**2, (3.0 * mean_rate - 2.0 * v - next_rate) / h, v, x]
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
    """Return the coefficients of a derivative of polynomials, highest power first."""
    power = len(pieces) - 1
    return [
        math.perm(power - rank, order) * coefficient for rank, coefficient in enumerate(pieces[: power + 1 - order])
    ]


def smooth_motion(stamps: Array, measured: Array) -> Motion:
    """
    Return the smoothed displacement.

    If the stamps jitter about a regular clock, the samples were taken at the stamps or by the clock. The motion is
    smoother over the right one of both.

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
    windows = list(overlapping_windows(stamps.size, SMOOTHING_WINDOW, SMOOTHING_MARGIN))
    liveliest = max((window for _, window in windows), key=partial(_travel, measured))
    liveliest_motion = _likeliest_motion(
        stamps[liveliest], None if clock is None else clock[liveliest], measured[liveliest]
    )
    times = stamps if clock is None or liveliest_motion.stamps is liveliest_motion.times else clock
    return _smooth_windows(times, stamps, measured, windows, liveliest_motion)


def exact_motion(times: Array, displacement: Array, rate: Array) -> Motion:
    """
    Return a motion that is known without noise, such as a planned motion.

    Parameters
    ----------
    times
        Increasing, shape (n,) [s].
    displacement, rate
        Displacement and its rate, each of shape (n,) [m, m/s].

    """
    return Motion(
        times=times,
        displacement=displacement,
        rate=rate,
        acceleration=np.gradient(rate, times),
        reach=float(np.ptp(displacement)),
        noise=0.0,
        uncertainty=0.0,
        rate_uncertainty=0.0,
        order=2,
        deviance=0.0,
        stamps=times,
    )


def _likeliest_motion(stamps: Array, clock: Array | None, measured: Array) -> Motion:
    """Return the likelier of the displacements smoothed over the stamps and over a regular clock, if there is one."""
    if clock is None:
        return _smooth(stamps, measured)
    as_stamped, by_clock = map_in_threads(lambda times: _smooth(times, measured), [stamps, clock])
    return replace(by_clock, stamps=stamps) if by_clock.deviance <= as_stamped.deviance else as_stamped


def _travel(measured: Array, window: slice) -> float:
    return float(np.sum(np.abs(np.diff(measured[window][::TRAVEL_STRIDE]))))


def _smooth_windows(
    times: Array, stamps: Array, measured: Array, windows: Sequence[tuple[slice, slice]], liveliest: Motion
) -> Motion:
    """Smooth a long displacement in windows, with the order of the liveliest window."""
    size = times.size
    joined = replace(
        liveliest,
        times=times,
        stamps=stamps,
        displacement=np.empty(size),
        rate=np.empty(size),
        acceleration=np.empty(size),
    )

    def smooth_window(slices: tuple[slice, slice]) -> tuple[float, float]:
        inner, window = slices
        motion = _smooth(times[window], measured[window], (liveliest.order,))
        part = motion.part(slice(inner.start - window.start, inner.stop - window.start))
        joined.displacement[inner], joined.rate[inner] = part.displacement, part.rate
        joined.acceleration[inner] = part.acceleration
        return motion.uncertainty, motion.rate_uncertainty

    uncertainty, rate_uncertainty = np.sqrt(np.mean(np.square(map_in_threads(smooth_window, windows)), axis=0)).tolist()
    return replace(
        joined, reach=float(np.ptp(joined.displacement)), uncertainty=uncertainty, rate_uncertainty=rate_uncertainty
    )


def _times_within(begin: float, end: float, times: Array) -> Array:
    """Return the increasing times after `begin` and up to `end` [s]."""
    first, last = np.searchsorted(times, [begin, end], side='right')
    return times[first:last]


def _smooth(times: Array, measured: Array, orders: Sequence[int] = _ORDERS) -> Motion:
    # the search needs numbers of order 1: the units are the mean step and the displacement's spread
    unit = float(np.mean(np.diff(times)))
    scale = float(np.std(measured)) or 1.0
    steps, values = np.diff(times) / unit, (measured - measured[0]) / scale
    smoothers = map_in_threads(lambda order: likeliest_smoother(order, Samples.from_values(steps, values)), orders)
    best = min(smoothers, key=lambda smoother: smoother.deviance)
    mean, variance = best.smooth()
    noise = scale * best.noise
    standard_errors = np.sqrt(np.mean(np.clip(variance, 0.0, [1.0, np.inf]), axis=0)).tolist()
    displacement = measured[0] + scale * mean[:, 0]
    return Motion(
        times=times,
        displacement=displacement,
        rate=scale / unit * mean[:, 1],
        acceleration=scale / unit**2 * mean[:, 2],
        reach=float(np.ptp(displacement)),
        noise=noise,
        uncertainty=noise * standard_errors[0],
        rate_uncertainty=noise / unit * standard_errors[1],
        order=best.order,
        deviance=best.deviance,
        stamps=times,
    )


def observed_motion(recording: Recording) -> tuple[Motion, Array]:
    """
    Return the smoothed displacement and the times at which strokes begin and end.

    For a piston at rest, return the times at which a set-point changes, and the end.

    Raises
    ------
    InputError
        If the recording is too short, nothing moves and no set-point changes, or the values are no displacements.

    """
    signal = recording.displacement
    if signal.times.size < FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: {signal.times.size} displacement samples are too few to identify a model. '
            f'Record at least {FEWEST_SAMPLES} samples'
        )
    period = float(np.median(np.diff(signal.times)))
    if period > LONGEST_PERIOD:
        raise InputError(
            f'{recording.name}: the displacement has a sample every {period:.3g} s only. A pressure settles in '
            'seconds, between two samples. Record at least two samples per second'
        )
    check_range(f'{recording.name}: the displacement', signal.values, LARGEST_DISPLACEMENT, 'm')
    if recording.rests:
        return _motion_at_rest(signal), np.append(_setpoint_changes(recording), signal.times[-1])
    motion = smooth_motion(signal.times, signal.values)
    strokes = stroke_times(motion.times, motion.displacement, motion.noise)
    span = float(np.ptp(signal.values))
    if strokes.size == 0 or span <= LEAST_MOTION * motion.noise:
        raise InputError(
            f'{recording.name}: the piston does not move (range {span * 1e3:.3g} mm, '
            f'noise {motion.noise * 1e3:.3g} mm). Its parameters show only in motion. Record strokes of the piston, or '
            'leave the displacement out of the mapping if the piston rests on purpose'
        )
    return motion, strokes


def _setpoint_changes(recording: Recording) -> Array:
    """Return the times at which a set-point changes while the pressure of a piston at rest is recorded [s]."""
    change_times = [
        cylinder.setpoint.times[1:] for cylinder in recording.cylinders.values() if cylinder.setpoint is not None
    ]
    first, last = recording.displacement.times[[0, -1]].tolist()
    changes = _times_within(first, last, np.unique(np.concatenate([np.empty(0), *change_times])))
    if not changes.size:
        raise InputError(
            f'{recording.name}: no displacement was recorded, and no set-point changes. Nothing excites the model. '
            'Record strokes of the piston, or steps of the set-point. If the pressure falls behind a shut valve, use '
            '`leak_test`'
        )
    return changes


def _motion_at_rest(signal: Signal) -> Motion:
    """Return the motion of a piston at rest."""
    zeros = np.zeros(len(signal))
    return Motion(
        times=signal.times,
        displacement=zeros,
        rate=zeros,
        acceleration=zeros,
        reach=0.0,
        noise=0.0,
        uncertainty=0.0,
        rate_uncertainty=0.0,
        order=2,
        deviance=0.0,
        stamps=signal.times,
    )
