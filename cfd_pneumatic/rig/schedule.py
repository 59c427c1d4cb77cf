# SPDX-License-Identifier: Apache-2.0
"""
Schedules of a test: the motion of the piston and the set-points of the regulators.

There are the paper's test, strokes out and back, and a tool that follows a surface. `schedule_names` has their names.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig.stroke import Stroke
from cfd_pneumatic.units import INCH, PSI

MIL = 1e-3 * INCH
"""A thousandth of an inch [m]."""

SAMPLING_PERIOD = 2e-3
"""The paper's sampling period [s]."""

LONGEST = 1200.0
"""Longest schedule [s]; playing it at once takes 0.8 GB."""

_HIGHEST = 1.0  # amplitude of a surface; no piston has such a travel [m]

LONGEST_KNOT = 2e-4
"""Longest time between knots of a motion [s]; a stop within a millisecond needs several knots."""

Motion = Callable[[Array], 'tuple[Array, Array]']
"""Function from times [s] to positions [m] and velocities [m/s]."""


class SetPoints(NamedTuple):
    """Set-points of the regulators from a time on."""

    time: float
    """Time since the start of the schedule [s]."""

    cylinder_a: float
    """Set pressure of cylinder A, gauge [Pa]."""

    cylinder_b: float
    """Set pressure of cylinder B, gauge [Pa]."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """
    A motion and set-points for a number of samples, `sampling_period` apart from time 0 on.

    The piston is at rest until the first sample, so that the initial state is known.
    """

    name: str
    sampling_period: float
    """Time between samples [s]."""

    knots_per_sample: int
    """Knots of the motion in a sampling period; the motion is cubic in between."""

    positions: Array
    """Displacement at the end of each knot's interval [m], (samples * knots_per_sample,)."""

    velocities: Array
    """Velocity at the end of each knot's interval [m/s], of the same shape."""

    setpoints: Array
    """Set pressures of A and B until each sample, gauge [Pa], (samples, 2)."""

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.setpoints)

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return (self.samples - 1) * self.sampling_period

    def with_return(self, settling: float = 1.0) -> Schedule:
        """
        Return the schedule with a return to its start, so that it can be repeated on the same rig.

        The set-points return to the first set-points, and the piston returns in the first half of `settling` [s].
        """
        samples = max(round(settling / self.sampling_period), 2)
        knots = samples * self.knots_per_sample
        duration = samples * self.sampling_period
        first, last = float(self.positions[0]), float(self.positions[-1])
        back = Stroke(0.0, last, first, 0.5 * duration, release=0.1 * duration, impact=0.1 * duration)
        positions, velocities = back(np.arange(1.0, knots + 1.0) * (duration / knots))
        return replace(
            self,
            positions=np.concatenate([self.positions, positions]),
            velocities=np.concatenate([self.velocities, velocities]),
            setpoints=np.concatenate([self.setpoints, np.tile(self.setpoints[0], (samples, 1))]),
        )


def lay_out(name: str, motion: Motion, setpoints: list[SetPoints], samples: int, sampling_period: float) -> Schedule:
    """
    Return a schedule with a number of samples, `sampling_period` [s] apart.

    The set-points are in order of time. The first set-point acted long before the start; each further set-point acts
    from the sample nearest to its time on.
    """
    if not sampling_period > 0.0 or not math.isfinite(sampling_period):
        raise InputError(f'sampling_period must be a positive number, is {sampling_period:g} s')
    if samples < 2:
        raise InputError(f'schedule {name!r} has {samples} samples, but must have 2 or more: make it longer')
    duration = (samples - 1) * sampling_period
    if duration > LONGEST + sampling_period:
        raise InputError(
            f'schedule {name!r} takes {duration:g} s, at most {LONGEST:g} s: make it shorter and repeat it'
        )
    knots = math.ceil(sampling_period / LONGEST_KNOT * (1.0 - 1e-9))
    times = np.maximum(np.arange(1 - knots, (samples - 1) * knots + 1) * (sampling_period / knots), 0.0)
    positions, velocities = motion(times)
    velocities = np.where(times > 0.0, velocities, 0.0)
    changes = [round(change.time / sampling_period) for change in setpoints[1:]]
    active = np.searchsorted(changes, np.arange(samples) - 1, side='right')
    levels = np.array([[change.cylinder_a, change.cylinder_b] for change in setpoints])
    return Schedule(name, sampling_period, knots, positions, velocities, levels[active])


def paper_step(
    setpoint: float = 5 * PSI,
    amplitude: float = 60 * MIL,
    *,
    setpoint_b: float | None = None,
    sampling_period: float = SAMPLING_PERIOD,
) -> Schedule:
    """
    Return the paper's test: 50 samples at rest, then 300 samples of a step of the displacement.

    A gage block is removed, and the piston moves freely to a mechanical stop.

    Parameters
    ----------
    setpoint
        Set pressure, gauge [Pa].
    amplitude
        Displacement [m]; 60 or 17 mil in the paper. A negative displacement compresses cylinder A.
    setpoint_b
        Set pressure of cylinder B, gauge [Pa]; by default that of A, so that the record tests both equally.
    sampling_period
        Time between samples [s].

    """
    before, after = 50, 300
    level_b = setpoint if setpoint_b is None else setpoint_b
    step = Stroke.flight((before - 1) * sampling_period, 0.0, amplitude)
    return lay_out('paper_step', step, [SetPoints(0.0, setpoint, level_b)], before + after, sampling_period)


def out_and_back(
    setpoint: float = 5 * PSI,
    amplitude: float = 60 * MIL,
    *,
    second_setpoint: float | None = None,
    second_amplitude: float | None = None,
    setpoint_b: float = 5 * PSI,
    repeats: int = 2,
    sampling_period: float = SAMPLING_PERIOD,
) -> Schedule:
    """
    Return strokes out and back at two amplitudes and two set-points.

    Parameters
    ----------
    setpoint, second_setpoint
        Set pressures of cylinder A, gauge [Pa]; the second is 5 psi above the first by default.
    amplitude, second_amplitude
        Displacements [m]; the second is 17/60 of the first by default, as in the paper.
    setpoint_b
        Set pressure of cylinder B throughout, gauge [Pa].
    repeats
        Number of repetitions of all strokes.
    sampling_period
        Time between samples [s].

    """
    rest, settling = 0.3, 0.4
    levels = (setpoint, setpoint + 5 * PSI if second_setpoint is None else second_setpoint)
    amplitudes = (amplitude, amplitude * 17 / 60 if second_amplitude is None else second_amplitude)
    if repeats < 1:
        raise InputError(f'repeats must be 1 or more, is {repeats}')
    strokes: list[Stroke] = []
    setpoints = [SetPoints(0.0, levels[0], setpoint_b)]
    time = 0.1
    for repeat in range(repeats):
        for level in levels:
            if repeat or level is levels[1]:
                setpoints.append(SetPoints(time, level, setpoint_b))
                time += settling
            for reach in amplitudes:
                strokes.append(Stroke.flight(time, 0.0, reach))
                strokes.append(Stroke.flight(time + rest, reach, 0.0))
                time += 2 * rest

    def motion(times: Array) -> tuple[Array, Array]:
        positions, velocities = np.zeros_like(times), np.zeros_like(times)
        for stroke in strokes:
            leg, speed = stroke(times)
            positions += leg - stroke.start
            velocities += speed
        return positions, velocities

    return lay_out('out_and_back', motion, setpoints, round(time / sampling_period) + 1, sampling_period)


def surface_following(
    setpoint: float = 10 * PSI,
    amplitude: float = 0.8e-3,
    *,
    setpoint_steps: float = 2 * PSI,
    setpoint_b: float = 5 * PSI,
    bandwidth: float = 12.0,
    duration: float = 60.0,
    seed: int = 0,
    sampling_period: float = SAMPLING_PERIOD,
) -> Schedule:
    """
    Return the motion of a tool that follows a random surface, with occasional changes of the force.

    Parameters
    ----------
    setpoint
        Mean set pressure of cylinder A, gauge [Pa].
    amplitude
        Standard deviation of the surface [m]; heights are limited to 3.5 standard deviations.
    setpoint_steps
        Half the span of cylinder A's set-points, and the span of cylinder B's [Pa]; 0 for constant set-points.
    setpoint_b
        Mean set pressure of cylinder B, gauge [Pa].
    bandwidth
        Highest frequency in the surface [Hz].
    duration
        Duration [s].
    seed
        Seed of the surface and the set-points.
    sampling_period
        Time between samples [s].

    """
    if not 0.0 < abs(amplitude) <= _HIGHEST:
        raise InputError(f'amplitude must be above 0 m and at most {_HIGHEST:g} m, is {amplitude:g} m')
    if not 2.0 <= duration <= LONGEST:
        raise InputError(f'duration of a surface must be 2 to {LONGEST:g} s, is {duration:g} s')
    rng = np.random.default_rng(seed)
    surface = _random_surface(amplitude, bandwidth, duration, rng)
    setpoints = [SetPoints(0.0, setpoint, setpoint_b)]
    time = rng.uniform(1.0, 4.0)
    while time < duration:
        _, level_a, level_b = setpoints[-1]
        if rng.random() < 0.6:
            level_a = setpoint + setpoint_steps * rng.uniform(-1.0, 1.0)
        else:
            level_b = setpoint_b + 0.5 * setpoint_steps * rng.uniform(-1.0, 1.0)
        setpoints.append(SetPoints(time, level_a, level_b))
        time += rng.uniform(1.0, 4.0)
    return lay_out('surface_following', surface, setpoints, round(duration / sampling_period) + 1, sampling_period)


def _random_surface(amplitude: float, bandwidth: float, duration: float, rng: np.random.Generator) -> Motion:
    """Return a Gaussian, band-limited surface with flat ends and smoothly limited height."""
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    fade, fastest = 0.5, 1e-3
    count = 2 ** math.ceil(math.log2(max(duration / fastest, 2.0)))
    frequencies = np.fft.rfftfreq(count, fastest)
    shape = np.where((frequencies > 0.1) & (frequencies < bandwidth), 1.0 / np.hypot(1.0, frequencies / 3.0), 0.0)
    spectrum = shape * (rng.standard_normal(len(shape)) + 1j * rng.standard_normal(len(shape)))
    heights = np.fft.irfft(spectrum, count)
    slopes = np.fft.irfft(2j * np.pi * frequencies * spectrum, count)
    scale = amplitude / np.std(heights)
    highest = 3.5 * amplitude
    spline = CubicHermiteSpline(fastest * np.arange(count), scale * heights, scale * slopes)

    def motion(times: Array) -> tuple[Array, Array]:
        nearness = np.clip(np.minimum(times, duration - times) / fade, 0.0, 1.0)
        envelope = nearness**3 * (10.0 - 15.0 * nearness + 6.0 * nearness**2)
        growth = 30.0 * (nearness * (1.0 - nearness)) ** 2 / fade * np.where(times < duration / 2, 1.0, -1.0)
        height, slope = spline(times), spline(times, 1)
        raw, rate = envelope * height, envelope * slope + growth * height
        limited = highest * np.tanh(raw / highest)
        return limited, rate * (1.0 - (limited / highest) ** 2)

    return motion
