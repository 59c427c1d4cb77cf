# SPDX-License-Identifier: Apache-2.0
"""A change of the device during a recording: when, and which parameter or effect differs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from cfd_pneumatic.identification.changes.thresholds import LEAST_STANDARD_ERRORS, MODEL_ERROR
from cfd_pneumatic.identification.channels import Estimate
from cfd_pneumatic.identification.report_texts import number, readable_name, unit


class DeviceState(NamedTuple):
    """A channel before or after a change, identified from this part of the recording alone."""

    gains: tuple[Estimate, ...]
    """Gains of the linear model without effects, which both parts have."""

    offset: float
    """Pressure at rest minus the set-point [Pa]."""

    offset_std: float
    """Standard error of the offset [Pa]."""

    effects: tuple[str, ...]
    """Names of the effects that were found."""

    verdict: str
    """Verdict on this part; empty if the loop was not closed."""

    why: str
    """The verdict in sentences; empty if the loop was not closed."""

    error: float
    """Root mean square of the remaining error [Pa]."""


class Difference(NamedTuple):
    """A quantity that differs before and after a change [unit]."""

    name: str
    unit: str
    before: float
    after: float

    @property
    def text(self) -> str:
        """Return the difference as a clause."""
        verb = 'rose' if self.after > self.before else 'fell'
        return f'{self.name} {verb} from {number(self.before)} to {number(self.after)} {unit(self.unit)}'


@dataclass(frozen=True)
class Change:
    """
    A change of the device during a recording.

    Attributes
    ----------
    channel, recording
        Names of the channel and of the recording that show the change.
    time, interval
        When the device changed, and the 95 % interval [s].
    before, after
        The channel before and after the change.

    """

    channel: str
    recording: str
    time: float
    interval: tuple[float, float]
    before: DeviceState
    after: DeviceState

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Quantities that differ by more than their standard errors and errors of the model, the largest first."""
        gains = [
            difference for before, after in self.gain_pairs if (difference := _difference(before, after)) is not None
        ]
        gains.sort(key=lambda gain: -abs(math.log(gain.after / gain.before)))
        offset = Difference('the pressure at rest above the set-point', 'Pa', self.before.offset, self.after.offset)
        std = math.hypot(self.before.offset_std, self.after.offset_std, MODEL_ERROR * self.after.error)
        is_offset = abs(self.after.offset - self.before.offset) > max(LEAST_STANDARD_ERRORS * std, self.after.error)
        return (*gains, *([offset] if is_offset else []))

    @property
    def gain_pairs(self) -> tuple[tuple[Estimate, Estimate], ...]:
        """Return each gain before and after the change."""
        return tuple(zip(self.before.gains, self.after.gains))

    @property
    def text(self) -> str:
        """Return the change as a sentence: when, and what differs."""
        low, high = self.interval
        clauses = [*(difference.text for difference in self.differences), *self._effect_clauses()]
        if not clauses:
            before, after = number(self.before.error), number(self.after.error)
            clauses = [f'the error of the model changed from {before} to {after} Pa']
        return (
            f'{self.recording}, {self.channel}: the device changed at t = {self.time:.1f} s (95 %: {low:.1f} to '
            f'{high:.1f} s): {", ".join(clauses)}'
        )

    def _effect_clauses(self) -> Iterator[str]:
        """Yield a clause for the effects that only one part has."""
        for state, opposite, part in ((self.before, self.after, 'before'), (self.after, self.before, 'after')):
            only_here = [readable_name(name) for name in state.effects if name not in opposite.effects]
            if only_here:
                yield f'only {part} the change there is {" and ".join(only_here)}'


def _difference(before: Estimate, after: Estimate) -> Difference | None:
    """Return the difference of an estimate; None if it is within the errors or known in neither part."""
    if before.value is None or after.value is None or before.std is None or after.std is None:
        return None
    size = MODEL_ERROR * 0.5 * (abs(before.value) + abs(after.value))
    if abs(after.value - before.value) <= LEAST_STANDARD_ERRORS * math.hypot(before.std, after.std, size):
        return None
    return Difference(before.name, before.unit, before.value, after.value)
