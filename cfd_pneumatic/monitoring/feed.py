# SPDX-License-Identifier: Apache-2.0
"""Faults of topics, not of the device: silence, clock jumps, stuck sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.identification import rounding_step, sample_noise
from cfd_pneumatic.messages import NANOSECONDS

_PASSED_SHARE = 0.5  # share of a gap between stamps that must have passed; otherwise the clock has jumped
_STUCK_RUNS = 10  # times the longest run of equal values while learning
_SHORTEST_RUN = 50  # samples
_DITHER_RATIO = 0.5  # noise over the converter's step above which values change even at rest
_LOST_NOISE_SHARE = 0.2  # share of the least noise while learning
_FEWEST_SAMPLES = 10  # samples from which noise can be estimated
_MOTION_LIMIT = 6.0  # standard deviations


@dataclass(frozen=True)
class Fault:
    """
    A fault of a topic.

    Attributes
    ----------
    topic
        Its name.
    kind
        `silent`, `stuck` or `clock`.
    message
        Text for the user.

    """

    topic: str
    kind: str
    message: str


class StampMonitor:
    """
    Checks the stamps of a topic.

    Parameters
    ----------
    topic
        Its name.
    longest
        Longest time between two stamps that is no gap [s].

    """

    def __init__(self, topic: str, longest: float) -> None:
        self._topic = topic
        self._longest = longest
        self.stamp: int | None = None
        self.heard_at: float | None = None

    def check(self, stamp: int, now: float) -> Fault | None:
        """Check a stamp [ns] that was received at a steady time [s]; return its fault, or None."""
        before, last_heard = self.stamp, self.heard_at
        self.stamp, self.heard_at = stamp, now
        if before is None or last_heard is None:
            return None
        elapsed = (stamp - before) / NANOSECONDS
        if 0.0 <= elapsed <= self._longest:
            return None
        if elapsed < 0.0:
            return Fault(self._topic, 'clock', f'the clock of {self._topic} jumped back by {-elapsed:.3g} s')
        if now - last_heard < _PASSED_SHARE * elapsed:
            return Fault(self._topic, 'clock', f'the clock of {self._topic} jumped ahead by {elapsed:.3g} s')
        return Fault(self._topic, 'silent', f'{self._topic} was silent for {elapsed:.3g} s')

    def silence(self, now: float) -> float | None:
        """Return the time since the last message [s]; None before the first message."""
        return None if self.heard_at is None else now - self.heard_at


@dataclass
class UsualBehaviour:
    """
    The usual variation of a sensor's values.

    Attributes
    ----------
    longest_run
        Longest run of equal values [samples].
    least_noise
        Least noise of a block [signal's unit]; infinite without expected values.
    step
        Step of the converter [signal's unit]; 0 if none is visible.
    noise
        Standard deviation of the white noise [signal's unit].

    """

    longest_run: int = 1
    least_noise: float = math.inf
    step: float = 0.0
    noise: float = 0.0

    @property
    def is_dithered(self) -> bool:
        """Whether noise changes the values even at rest."""
        return 0.0 < self.least_noise < math.inf and self.noise > _DITHER_RATIO * self.step


class SensorMonitor:
    """
    Checks whether a sensor is stuck.

    Parameters
    ----------
    topic
        Its name.
    unit
        Unit of its values.

    """

    def __init__(self, topic: str, unit: str) -> None:
        self._topic = topic
        self._unit = unit
        self._usual = UsualBehaviour()
        self._learning = True
        self._values: list[float] = []
        self._differences: list[float] = []
        self.restart()

    def restart(self) -> None:
        """Begin anew after a break; the usual behaviour stays."""
        self._value, self._run = math.nan, 0
        self._lowest, self._highest = math.inf, -math.inf
        self._block: list[float] = []

    def end_learning(self) -> None:
        """End learning; later values are checked."""
        self._learning = False
        if len(self._differences) >= _FEWEST_SAMPLES:
            differences = np.array(self._differences)
            self._usual.step = rounding_step(np.array(self._values))
            self._usual.noise = sample_noise(np.arange(float(differences.size)), differences)
        self._values, self._differences = [], []

    @property
    def is_paused(self) -> bool:
        """Whether the value has been constant for longer than ever while learning."""
        return self._is_constant_for(1)

    def _is_constant_for(self, times: int) -> bool:
        """Return whether the value has been constant for more than `times` the longest run while learning."""
        return not self._learning and self._run > max(times * self._usual.longest_run, _SHORTEST_RUN)

    def check(self, value: float, expected: float | None = None) -> Fault | None:
        """Check a value against the expected value, if known; return its fault, or None."""
        if value == self._value:
            self._run += 1
        else:
            self._value, self._run = value, 1
            self._lowest, self._highest = math.inf, -math.inf
        if expected is not None:
            self._block.append(value - expected)
            self._lowest, self._highest = min(self._lowest, expected), max(self._highest, expected)
        if self._learning:
            self._usual.longest_run = max(self._usual.longest_run, self._run)
            if expected is not None:
                self._values.append(value)
                self._differences.append(value - expected)
            return None
        if self._is_constant_for(_STUCK_RUNS) and (self._usual.is_dithered or self._has_to_move):
            return self._stuck_fault()
        return None

    def _stuck_fault(self) -> Fault:
        return Fault(self._topic, 'stuck', f'{self._topic} is stuck at {self._value:.6g} {self._unit}')

    @property
    def _has_to_move(self) -> bool:
        least = max(_MOTION_LIMIT * self._usual.noise, 2.0 * self._usual.step)
        return self._highest - self._lowest > least > 0.0

    def close_block(self) -> Fault | None:
        """Check the noise since the last block was closed; return its fault, or None."""
        values, self._block = self._block, []
        if len(values) < _FEWEST_SAMPLES:
            return None
        noise = float(np.mean(np.abs(np.diff(values, 2))))
        if self._learning:
            self._usual.least_noise = min(self._usual.least_noise, noise)
        elif self._usual.is_dithered and noise < _LOST_NOISE_SHARE * self._usual.least_noise:
            if self._run >= len(values):
                return self._stuck_fault()
            return Fault(self._topic, 'stuck', f'{self._topic} has lost its usual noise: check for a stuck sensor')
        return None
