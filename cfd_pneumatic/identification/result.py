# SPDX-License-Identifier: Apache-2.0
"""What an identification comes to: one result for each measured channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.identification.channels import Channel, Estimate, Quantity
from cfd_pneumatic.identification.conclusion import Conclusion, PartError
from cfd_pneumatic.identification.data import PARTS, Experiment, Options, Split
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.residual import Noise
from cfd_pneumatic.notices import Notice
from cfd_pneumatic.recording import Recording, Signal


@dataclass(frozen=True)
class OperatingPoint:
    """A fit at one set-point, gauge [Pa]."""

    setpoint: float
    fit: Fit


@dataclass(frozen=True, eq=False)
class Comparison:
    """
    One recording: what was measured, and what the model makes of it without and with the effects.

    Attributes
    ----------
    channel
        What was measured.
    recording
        Index of the recording.
    experiment
        The recording made ready for the model.
    before, after
        Simulated without and with effects at its samples, shape (m,) [SI].

    """

    channel: Channel
    recording: int
    experiment: Experiment
    before: Array
    after: Array

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.experiment.recording

    @property
    def times(self) -> Array:
        """Of the samples, shape (m,) [s]."""
        return self.experiment.sample_times

    @property
    def inputs(self) -> Mapping[str, Array]:
        """What drives the model, by its name for people, at the samples, each of shape (m,) [SI]."""
        return self.channel.shown(self.experiment)

    def residual(self, which: int) -> Array:
        """Return measured less simulated, without (0) or with effects (1), shape (m,) [SI]."""
        return self.experiment.measured - (self.before, self.after)[which]

    def stamps(self, signal: Signal) -> Array:
        """Return the stamps of the samples in the signal that they come from, a run of it, shape (m,) [s]."""
        measured = self.experiment.measured
        for first in range(len(signal) - measured.size + 1):
            run = slice(first, first + measured.size)
            if np.array_equal(signal.values[run], measured):
                return signal.times[run]
        return self.times


@dataclass(frozen=True)
class ChannelResult:
    """
    What was found on one channel.

    Attributes
    ----------
    channel
        What was measured.
    fit
        One joint fit without effects, to train and validation together.
    schedule
        Fits at each set-point with `Options.per_setpoint`; otherwise the joint fit at the mean set-point. Empty where
        nothing is scheduled.
    comparisons
        One for each recording that holds the channel; without effects by the schedule, or the joint fit.
    before, after
        Error without and with effects on each part that has samples, by its name.
    span
        Span p99 - p1 of what was measured, mean over recordings [SI].
    noise
        Of the channel.
    notes
        Set-points that were left out, for people to read.
    found
        The fit with the effects that were found; `fit` itself where there are none.
    conclusion
        What closing the loop comes to; None where it wasn't asked for.

    """

    channel: Channel
    fit: Fit
    schedule: tuple[OperatingPoint, ...]
    comparisons: tuple[Comparison, ...]
    before: Mapping[str, PartError]
    after: Mapping[str, PartError]
    span: float
    noise: Noise
    notes: tuple[str, ...]
    found: Fit
    conclusion: Conclusion | None

    @property
    def name(self) -> str:
        """Of the channel: `cylinder_a`, `cylinder_b`, `force`."""
        return self.channel.name

    @property
    def quantity(self) -> Quantity:
        """What was measured."""
        return self.channel.quantity

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """The recordings made ready for the model."""
        return tuple(one.experiment for one in self.comparisons)

    @property
    def findings(self) -> Conclusion:
        """What closing the loop comes to; the loop was closed."""
        assert self.conclusion is not None
        return self.conclusion

    def doubted(self) -> ChannelResult:
        """Return it with its conclusion in doubt."""
        return self if self.conclusion is None else replace(self, conclusion=replace(self.conclusion, has_warning=True))

    @property
    def judged_on(self) -> str:
        """The part on which before and after are compared: the test part, or all samples where there is none."""
        return 'test' if 'test' in self.before else 'all'

    def judged(self, comparison: Comparison) -> NDArray[np.bool_]:
        """Return which samples of a recording before and after are compared on, shape (m,)."""
        part = comparison.experiment.part
        return part == PARTS.index('test') if self.judged_on == 'test' else np.ones(part.size, np.bool_)

    @property
    def added(self) -> tuple[str, ...]:
        """What the reported model has beside the paper's linear one: a core, effects."""
        return tuple(self.found.model.parts)

    @property
    def gains(self) -> tuple[Estimate, ...]:
        """Parameters of the model itself, fitted with the effects."""
        return tuple(estimate for estimate in self.found.estimates if '.' not in estimate.name)

    def parameters(self, effect: str) -> dict[str, Estimate]:
        """Return the parameters of a core or an effect by their names."""
        names = {estimate.name: estimate for estimate in self.found.estimates}
        own = [one.name for one in self.channel.effects[effect].parameters]
        return {name: names[f'{effect}.{name}'] for name in own if f'{effect}.{name}' in names}

    def tested(self, which: int) -> list[Array]:
        """Return the residuals without (0) or with effects (1) as they are tested: weighted, before the test part."""
        simulated = [(one.before, one.after)[which] for one in self.comparisons]
        weights = (self.fit, self.found)[which].likelihood.precisions(simulated)
        return [(one.residual(which) * weight)[one.experiment.counts] for one, weight in zip(self.comparisons, weights)]

    def rmse(self, which: int) -> float:
        """Return the error without (0) or with effects (1), on the part on which they are compared [SI]."""
        errors = (self.before, self.after)[which]
        if 'test' in errors:
            return errors['test'].rmse
        return self.rms(which)

    def rms(self, which: int) -> float:
        """Return the error without (0) or with effects (1) on all samples [SI]."""
        return rms(np.concatenate([one.residual(which) for one in self.comparisons]))


@dataclass(frozen=True)
class Geometry:
    """
    How pressures make the contact force, as far as it was identified or given.

    Attributes
    ----------
    area
        Of either piston [m^2]; None where nobody knows.
    factor
        Contact force over piston force that the area goes with [-]; None where nobody knows.
    note
        Why the area is not the recordings' own, or not known, for people to read; None where there is nothing to say.

    """

    area: float | None = None
    factor: float | None = None
    note: str | None = None


@dataclass(frozen=True)
class Identification:
    """
    The result for all channels.

    Attributes
    ----------
    recordings
        What was recorded.
    without_waves
        The same, without waves of the displacement that no pressure follows: what was identified.
    splits
        Where each recording was cut.
    no_test
        Why there is no test part, or None.
    channels
        Results by `cylinder_a`, `cylinder_b`, `force`.
    unidentified
        Why a channel that was recorded could not be identified, by its name.
    options
        How it was identified.
    notices
        Mistakes that recordings and results look like, and what was assumed.

    """

    recordings: tuple[Recording, ...]
    without_waves: tuple[Recording, ...]
    splits: tuple[Split, ...]
    no_test: str | None
    channels: Mapping[str, ChannelResult]
    unidentified: Mapping[str, str]
    options: Options
    notices: tuple[Notice, ...] = ()

    @property
    def ambient_pressure(self) -> float:
        """What gauge pressures are counted from [Pa]."""
        return self.options.ambient_pressure

    @property
    def cylinders(self) -> Mapping[str, ChannelResult]:
        """The results of the cylinders."""
        return {name: result for name, result in self.channels.items() if name in CYLINDERS}

    @property
    def closed(self) -> tuple[ChannelResult, ...]:
        """The results of the channels on which the loop was closed, cylinders first."""
        return tuple(result for result in self.channels.values() if result.conclusion is not None)

    @property
    def geometry(self) -> Geometry:
        """What makes the contact force: as fitted, or as given."""
        force = self.channels.get('force')
        if force is None:
            note = 'as given' if self.options.area is not None else self.unidentified.get('force')
            return Geometry(self.options.area, self.options.geometric_factor, note)
        area, factor = force.found.model.parameters.tolist()
        return Geometry(area, factor, force.found.estimates[0].reason)
