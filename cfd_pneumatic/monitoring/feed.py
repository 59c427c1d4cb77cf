# SPDX-License-Identifier: Apache-2.0
"""What may be wrong with a topic, as against the device: it is silent, its clock jumps, its sensor is stuck."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.identification import rounding_step, sample_noise
from cfd_pneumatic.messages import NANOSECONDS

_AHEAD = 0.5  # share of a gap between stamps that has to have passed, or the clock has jumped
_LONGER = 10  # times the longest run of equal values that was seen
_SHORTEST_RUN = 50  # samples
_DITHERED = 0.5  # noise over the converter's step from which on a value does not stay the same, even at rest
_NOISELESS = 0.2  # share of the least noise that was seen
_FEWEST = 10  # samples in which noise can be told
_MOVED = 6.0  # standard deviations


@dataclass(frozen=True)
class Fault:
    """
    Something wrong with a topic.

    Attributes
    ----------
    topic
        Its name.
    kind
        `silent`, `stuck` or `clock`.
    why
        What is wrong, in words.

    """

    topic: str
    kind: str
    why: str


class Clock:
    """
    The stamps of a topic.

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
        self.heard: float | None = None

    def take(self, stamp: int, now: float) -> Fault | None:
        """Take a stamp [ns] that was heard at a steady time [s]; return what is wrong with it."""
        before, heard = self.stamp, self.heard
        self.stamp, self.heard = stamp, now
        if before is None or heard is None:
            return None
        elapsed = (stamp - before) / NANOSECONDS
        if 0.0 <= elapsed <= self._longest:
            return None
        if elapsed < 0.0:
            return Fault(self._topic, 'clock', f'the clock of {self._topic} jumped back by {-elapsed:.3g} s')
        if now - heard < _AHEAD * elapsed:
            return Fault(self._topic, 'clock', f'the clock of {self._topic} jumped ahead by {elapsed:.3g} s')
        return Fault(self._topic, 'silent', f'{self._topic} was silent for {elapsed:.3g} s')

    def silence(self, now: float) -> float | None:
        """Return for how long nothing has been heard [s]; None where nothing ever was."""
        return None if self.heard is None else now - self.heard


@dataclass
class Habits:
    """
    How lively a sensor usually is; its noise is told from what is expected of it.

    Attributes
    ----------
    longest_run
        Longest run of equal values [samples].
    least_noise
        Least noise of a block [signal's unit]; infinite where nothing was expected.
    step
        The converter's [signal's unit]; 0 where there is none to be seen.
    noise
        Standard deviation of the white noise [signal's unit].

    """

    longest_run: int = 1
    least_noise: float = math.inf
    step: float = 0.0
    noise: float = 0.0

    @property
    def dithered(self) -> bool:
        """Whether the noise keeps the reading from standing still, even at rest."""
        return 0.0 < self.least_noise < math.inf and self.noise > _DITHERED * self.step


class Sensor:
    """
    The values of a topic: whether they are alive as they usually are.

    Parameters
    ----------
    topic
        Its name.
    unit
        Of its values.

    """

    def __init__(self, topic: str, unit: str) -> None:
        self._topic = topic
        self._unit = unit
        self._habits = Habits()
        self._learning = True
        self._values: list[float] = []
        self._differences: list[float] = []
        self.restart()

    def restart(self) -> None:
        """Begin anew behind a break; habits stay."""
        self._value, self._run = math.nan, 0
        self._lowest, self._highest = math.inf, -math.inf
        self._block: list[float] = []

    def learned(self) -> None:
        """End learning: from now on values are judged."""
        self._learning = False
        if len(self._differences) >= _FEWEST:
            differences = np.array(self._differences)
            self._habits.step = rounding_step(np.array(self._values))
            self._habits.noise = sample_noise(np.arange(float(differences.size)), differences)
        self._values, self._differences = [], []

    @property
    def paused(self) -> bool:
        """Whether the value has stood still for longer than it ever did while the sensor was sound."""
        return self._stands(1)

    def _stands(self, times: int) -> bool:
        """Return whether the value has stood still for so many times as long as it ever did."""
        return not self._learning and self._run > max(times * self._habits.longest_run, _SHORTEST_RUN)

    def take(self, value: float, expected: float | None = None) -> Fault | None:
        """Take a value, and the one that was expected where there is one; return what is wrong with it."""
        if value == self._value:
            self._run += 1
        else:
            self._value, self._run = value, 1
            self._lowest, self._highest = math.inf, -math.inf
        if expected is not None:
            self._block.append(value - expected)
            self._lowest, self._highest = min(self._lowest, expected), max(self._highest, expected)
        if self._learning:
            self._habits.longest_run = max(self._habits.longest_run, self._run)
            if expected is not None:
                self._values.append(value)
                self._differences.append(value - expected)
            return None
        if self._stands(_LONGER) and (self._habits.dithered or self._should_have_moved):
            return self._stuck()
        return None

    def _stuck(self) -> Fault:
        return Fault(self._topic, 'stuck', f'{self._topic} is stuck at {self._value:.6g} {self._unit}')

    @property
    def _should_have_moved(self) -> bool:
        least = max(_MOVED * self._habits.noise, 2.0 * self._habits.step)
        return self._highest - self._lowest > least > 0.0

    def close_block(self) -> Fault | None:
        """Judge the noise of the values since the last block was closed."""
        values, self._block = self._block, []
        if len(values) < _FEWEST:
            return None
        noise = float(np.mean(np.abs(np.diff(values, 2))))
        if self._learning:
            self._habits.least_noise = min(self._habits.least_noise, noise)
        elif self._habits.dithered and noise < _NOISELESS * self._habits.least_noise:
            if self._run >= len(values):
                return self._stuck()
            return Fault(self._topic, 'stuck', f'{self._topic} has lost its usual noise: is its sensor stuck?')
        return None
