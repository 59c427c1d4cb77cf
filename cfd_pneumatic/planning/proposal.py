# SPDX-License-Identifier: Apache-2.0
"""A proposal: displacement and set-points at each sample, laid out within the limits of the cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.planning.family import Segment, Step, Turn
from cfd_pneumatic.planning.limits import Limits, Sensing

_GRAINS = 1e9  # in a metre: displacements are written to the nanometre

_FINEST_LEVEL = 2  # decimals of a set-point [Pa]


@dataclass(frozen=True)
class Proposal:
    """
    What the piston and the regulators are to do.

    Attributes
    ----------
    times
        Of the samples, from 0 on, shape (n,) [s].
    displacement, velocity, acceleration
        +x grows cylinder A, shape (n,) [m, m/s, m/s^2].
    setpoints
        Gauge set-points of the cylinders A and B that act up to each sample, since the one before, shape (n, 2) [Pa].
    segments
        What it is made of, in order: name and the sample before it.

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
        """Return it as the table that a robot follows and `rig_node` plays."""
        columns = (self.times, self.displacement, self.velocity, *self.held.T)
        rows = (','.join(map(repr, row)) for row in zip(*(column.tolist() for column in columns)))
        return '\n'.join([','.join(SCHEDULE_COLUMNS), *rows]) + '\n'


class Drawing:
    """
    Lays out segments one after the other, sample by sample.

    Parameters
    ----------
    limits, sensing
        What the cell allows, and how it is sampled.
    homes
        Gauge set-points of the cylinders A and B to begin and end each segment with [Pa].
    settling
        Time in which a pressure settles [s].

    """

    def __init__(self, limits: Limits, sensing: Sensing, homes: tuple[float, float], settling: float) -> None:
        self._limits = limits
        self._period = sensing.period
        self._homes = homes
        self._settling = settling
        self._most_speed = limits.speed - 2.0 / _GRAINS / sensing.period  # what writing nanometres may add

    def duration(self, segment: Segment) -> int:
        """Return how many samples a segment takes."""
        return sum(len(one) for one, _ in self._drawn(segment.steps))

    @property
    def opening(self) -> int:
        """How many samples the rest takes that everything begins with, beside the first one."""
        return self._samples(self._settling)

    def draw(self, segments: Sequence[Segment]) -> Proposal:
        """Return segments one after the other, behind a rest."""
        motion = [np.zeros((1 + self.opening, 3))]
        levels = [np.tile(self._level(0.0, 0.0), (len(motion[0]), 1))]
        marks: list[tuple[str, int]] = []
        count = len(motion[0])
        for segment in segments:
            marks.append((segment.name, count - 1))
            for moved, level in self._drawn(segment.steps):
                motion.append(moved)
                levels.append(np.tile(level, (len(moved), 1)))
                count += len(moved)
        x, v, a = np.concatenate(motion).T
        return Proposal(np.round(self._period * np.arange(count), 9), x, v, a, np.concatenate(levels), tuple(marks))

    def _drawn(self, steps: Sequence[Step]) -> list[tuple[Array, Array]]:
        """Return motion, shape (n, 3), and set-points of each step from home on."""
        at, level = 0.0, self._level(0.0, 0.0)
        drawn = []
        for step in steps:
            parts = []
            if isinstance(step, Turn):
                level = self._level(step.cylinder_a, step.cylinder_b)
            else:
                to = float(_towards_zero(step.to * self._limits.stroke))
                parts.append(self._moved(at, to, step.speed))
                at = to
            parts.append(np.tile([at, 0.0, 0.0], (self._samples(step.rest * self._settling), 1)))
            drawn.append((np.concatenate(parts), level))
        return drawn

    def _samples(self, duration: float) -> int:
        return math.ceil(duration / self._period - 1e-9)

    def _level(self, share_a: float, share_b: float) -> Array:
        """Return gauge set-points some share of the way from home to the farther end of the range [Pa]."""
        low, high = self._limits.pressures
        levels = []
        for home, share in zip(self._homes, (share_a, share_b)):
            far = high if high - home >= home - low else low
            levels.append(min(max(round(home + share * (far - home), _FINEST_LEVEL), low), high))
        return np.array(levels)

    def _moved(self, start: float, end: float, share: float) -> Array:
        """Return position, speed and acceleration at the samples of a move, shape (n, 3)."""
        distance = abs(end - start)
        if distance == 0.0:
            return np.empty((0, 3))
        move = _Glide.within(distance, share * self._most_speed, self._limits.acceleration)
        times = self._period * np.arange(1.0, self._samples(move.duration) + 1.0)
        travelled, speed, acceleration = move.at(times)
        direction = math.copysign(1.0, end - start)
        x = _towards_zero(start + direction * travelled)
        x = np.clip(x, min(start, end), max(start, end))
        x[-1] = end
        return np.column_stack([x, _towards_zero(direction * speed), direction * acceleration])


def _towards_zero(values: Array | float) -> Array:
    """Return values as they are written: never beyond a limit."""
    return np.asarray(np.trunc(np.asarray(values) * _GRAINS) / _GRAINS)


@dataclass(frozen=True)
class _Glide:
    """A move from rest to rest whose speed rises and falls as half a cosine."""

    distance: float
    speed: float
    ramp: float

    @classmethod
    def within(cls, distance: float, speed: float, acceleration: float) -> _Glide:
        """Return the quickest within a speed and an acceleration."""
        reached = min(speed, math.sqrt(2.0 * acceleration * distance / math.pi))
        return cls(distance, reached, 0.5 * math.pi * reached / acceleration)

    @property
    def duration(self) -> float:
        return self.distance / self.speed + self.ramp

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return distance, speed and acceleration at times since its beginning."""
        since = np.clip(times, 0.0, self.duration)
        left = self.duration - since
        begins, ends = since < self.ramp, left < self.ramp
        near = np.minimum(np.where(begins, since, left), self.ramp)
        phase = np.pi * near / self.ramp
        ramped = 0.5 * self.speed * (near - self.ramp / np.pi * np.sin(phase))
        travelled = np.where(
            begins, ramped, np.where(ends, self.distance - ramped, self.speed * (since - 0.5 * self.ramp))
        )
        speed = np.where(begins | ends, 0.5 * self.speed * (1.0 - np.cos(phase)), self.speed)
        push = 0.5 * np.pi * self.speed / self.ramp * np.sin(phase)
        return travelled, speed, np.where(begins, push, np.where(ends, -push, 0.0))
