# SPDX-License-Identifier: Apache-2.0
"""Lay out a proposal: displacement and set-points at each sample, within the limits of the cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.planning.family import Segment, Step, Turn
from cfd_pneumatic.planning.limits import Limits, Sensing

_STEPS_PER_METRE = 1e9  # in a metre: displacements are written to the nanometre

_LEVEL_DECIMALS = 2  # decimals of a set-point [Pa]


@dataclass(frozen=True)
class Proposal:
    """
    Proposed motion of the piston and set-points of the regulators.

    Attributes
    ----------
    times
        Times of the samples, from 0 on, shape (n,) [s].
    displacement, velocity, acceleration
        Motion of the piston, +x grows cylinder A, shape (n,) [m, m/s, m/s^2].
    setpoints
        Gauge set-points of A and B that act from the previous sample to each sample, shape (n, 2) [Pa].
    segments
        Name of each segment and index of the sample before it, in order.

    """

    times: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    setpoints: Array
    segments: tuple[tuple[str, int], ...]

    @property
    def held(self) -> Array:
        """Set-points that hold from each sample on, shape (n, 2), gauge [Pa]."""
        return np.concatenate([self.setpoints[1:], self.setpoints[-1:]])

    def table(self) -> str:
        """Return the proposal as the table that a robot follows and `rig_node` plays."""
        columns = (self.times, self.displacement, self.velocity, *self.held.T)
        rows = (','.join(map(repr, row)) for row in zip(*(column.tolist() for column in columns)))
        return '\n'.join([','.join(SCHEDULE_COLUMNS), *rows]) + '\n'


class Drawing:
    """
    Lay out segments in succession, sample by sample.

    Parameters
    ----------
    limits, sensing
        Limits and sampling of the cell.
    homes
        Gauge set-points of A and B at the begin and end of each segment [Pa].
    settling
        Time in which a pressure settles [s].

    """

    def __init__(self, limits: Limits, sensing: Sensing, homes: tuple[float, float], settling: float) -> None:
        self._limits = limits
        self._period = sensing.period
        self._homes = homes
        self._settling = settling
        self._most_speed = limits.speed - 2.0 / _STEPS_PER_METRE / sensing.period  # minus the rounding error

    def duration(self, segment: Segment) -> int:
        """Return the number of samples of a segment."""
        return sum(len(motion) for motion, _ in self._lay_out(segment.steps))

    @property
    def opening(self) -> int:
        """Number of samples of the initial rest, without the first sample."""
        return self._samples(self._settling)

    def draw(self, segments: Sequence[Segment]) -> Proposal:
        """Return the proposal of an initial rest and segments in succession."""
        motion = [np.zeros((1 + self.opening, 3))]
        levels = [np.tile(self._level(0.0, 0.0), (len(motion[0]), 1))]
        marks: list[tuple[str, int]] = []
        count = len(motion[0])
        for segment in segments:
            marks.append((segment.name, count - 1))
            for step_motion, level in self._lay_out(segment.steps):
                motion.append(step_motion)
                levels.append(np.tile(level, (len(step_motion), 1)))
                count += len(step_motion)
        x, v, a = np.concatenate(motion).T
        return Proposal(np.round(self._period * np.arange(count), 9), x, v, a, np.concatenate(levels), tuple(marks))

    def _lay_out(self, steps: Sequence[Step]) -> list[tuple[Array, Array]]:
        """Return motion, shape (n, 3), and set-points of each step, beginning at home."""
        position, level = 0.0, self._level(0.0, 0.0)
        laid_out = []
        for step in steps:
            parts = []
            if isinstance(step, Turn):
                level = self._level(step.cylinder_a, step.cylinder_b)
            else:
                end = float(_rounded_towards_zero(step.to * self._limits.stroke))
                parts.append(self._move(position, end, step.speed))
                position = end
            parts.append(np.tile([position, 0.0, 0.0], (self._samples(step.rest * self._settling), 1)))
            laid_out.append((np.concatenate(parts), level))
        return laid_out

    def _samples(self, duration: float) -> int:
        return math.ceil(duration / self._period - 1e-9)

    def _level(self, share_a: float, share_b: float) -> Array:
        """Return gauge set-points at shares of the way from home to the farther end of the range [Pa]."""
        low, high = self._limits.pressures
        levels = []
        for home, share in zip(self._homes, (share_a, share_b)):
            far = high if high - home >= home - low else low
            levels.append(min(max(round(home + share * (far - home), _LEVEL_DECIMALS), low), high))
        return np.array(levels)

    def _move(self, start: float, end: float, share: float) -> Array:
        """Return position, speed and acceleration at the samples of a move, shape (n, 3)."""
        distance = abs(end - start)
        if distance == 0.0:
            return np.empty((0, 3))
        glide = _Glide.within_limits(distance, share * self._most_speed, self._limits.acceleration)
        times = self._period * np.arange(1.0, self._samples(glide.duration) + 1.0)
        travelled, speed, acceleration = glide.motion(times)
        direction = math.copysign(1.0, end - start)
        x = _rounded_towards_zero(start + direction * travelled)
        x = np.clip(x, min(start, end), max(start, end))
        x[-1] = end
        return np.column_stack([x, _rounded_towards_zero(direction * speed), direction * acceleration])


def _rounded_towards_zero(values: Array | float) -> Array:
    """Return values rounded to nanometres towards zero, so that no value exceeds a limit."""
    return np.asarray(np.trunc(np.asarray(values) * _STEPS_PER_METRE) / _STEPS_PER_METRE)


@dataclass(frozen=True)
class _Glide:
    """A move from rest to rest; the speed rises and falls as half a cosine."""

    distance: float
    speed: float
    ramp: float

    @classmethod
    def within_limits(cls, distance: float, speed: float, acceleration: float) -> _Glide:
        """Return the quickest glide within limits of speed and acceleration."""
        reached = min(speed, math.sqrt(2.0 * acceleration * distance / math.pi))
        return cls(distance, reached, 0.5 * math.pi * reached / acceleration)

    @property
    def duration(self) -> float:
        return self.distance / self.speed + self.ramp

    def motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Return distance, speed and acceleration at times from the begin of the glide."""
        elapsed = np.clip(times, 0.0, self.duration)
        remaining = self.duration - elapsed
        begins, ends = elapsed < self.ramp, remaining < self.ramp
        near = np.minimum(np.where(begins, elapsed, remaining), self.ramp)
        phase = np.pi * near / self.ramp
        ramped = 0.5 * self.speed * (near - self.ramp / np.pi * np.sin(phase))
        travelled = np.where(
            begins, ramped, np.where(ends, self.distance - ramped, self.speed * (elapsed - 0.5 * self.ramp))
        )
        speed = np.where(begins | ends, 0.5 * self.speed * (1.0 - np.cos(phase)), self.speed)
        push = 0.5 * np.pi * self.speed / self.ramp * np.sin(phase)
        return travelled, speed, np.where(begins, push, np.where(ends, -push, 0.0))
