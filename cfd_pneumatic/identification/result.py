# SPDX-License-Identifier: Apache-2.0
"""Define the result of an identification, with a result for each measured channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.identification.changes import Change, Drift
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
    Measured and simulated samples of a channel in one recording.

    Attributes
    ----------
    channel
        The channel.
    recording
        Index of the recording.
    experiment
        The recording prepared for the model.
    before, after
        Simulated without and with effects at the samples, shape (m,) [SI].

    """

    channel: Channel
    recording: int
    experiment: Experiment
    before: Array
    after: Array

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.experiment.recording

    @property
    def times(self) -> Array:
        """Times of the samples, shape (m,) [s]."""
        return self.experiment.sample_times

    @property
    def inputs(self) -> Mapping[str, Array]:
        """Inputs of the model at the samples, by name for people, each of shape (m,) [SI]."""
        return self.channel.shown(self.experiment)

    def residual(self, which: int) -> Array:
        """Return measured minus simulated, without (0) or with effects (1), shape (m,) [SI]."""
        return self.experiment.measured - (self.before, self.after)[which]

    def stamps(self, signal: Signal) -> Array:
        """Return the stamps of the samples in the recorded signal that contains the samples, shape (m,) [s]."""
        measured = self.experiment.measured
        for first in range(len(signal) - measured.size + 1):
            run = slice(first, first + measured.size)
            if np.array_equal(signal.values[run], measured):
                return signal.times[run]
        return self.times


@dataclass(frozen=True)
class ChannelResult:
    """
    Result of the identification of a channel.

    Attributes
    ----------
    channel
        The channel.
    fit
        Joint fit without effects, to the train and validation parts together.
    schedule
        Fits at each set-point with `Options.per_setpoint`; otherwise the joint fit at the mean set-point. Empty if
        the channel has no set-point.
    comparisons
        One for each recording with the channel; without effects by the schedule, or the joint fit.
    before, after
        Error without and with effects, by name of each part that has samples.
    span
        Measured span p99 - p1, mean over recordings [SI].
    noise
        Noise of the channel.
    notes
        Set-points that are not in the schedule, for people.
    found
        The fit with the effects of the search; `fit` itself if the search found none.
    conclusion
        Conclusion of the closed loop; None if `Options.close_loop` is false.

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
        """Name of the channel: `cylinder_a`, `cylinder_b`, `force`."""
        return self.channel.name

    @property
    def quantity(self) -> Quantity:
        """The measured quantity."""
        return self.channel.quantity

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """The recordings prepared for the model."""
        return tuple(comparison.experiment for comparison in self.comparisons)

    @property
    def findings(self) -> Conclusion:
        """The conclusion of a result with a closed loop."""
        assert self.conclusion is not None
        return self.conclusion

    def doubted(self) -> ChannelResult:
        """Return the result with a conclusion that is marked as uncertain because of the input data."""
        return self if self.conclusion is None else replace(self, conclusion=replace(self.conclusion, has_warning=True))

    @property
    def judged_on(self) -> str:
        """The part on which before and after are compared: `test`, or `all` without a test part."""
        return 'test' if 'test' in self.before else 'all'

    def judged(self, comparison: Comparison) -> NDArray[np.bool_]:
        """Return the mask of the samples on which before and after are compared, shape (m,)."""
        part = comparison.experiment.part
        return part == PARTS.index('test') if self.judged_on == 'test' else np.ones(part.size, np.bool_)

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the core and the effects that the reported model adds to the paper's linear model."""
        return tuple(self.found.model.parts)

    @property
    def gains(self) -> tuple[Estimate, ...]:
        """Parameters of the model itself, fitted with the effects."""
        return tuple(estimate for estimate in self.found.estimates if '.' not in estimate.name)

    def parameters(self, effect: str) -> dict[str, Estimate]:
        """Return the estimated parameters of a core or an effect, by name."""
        estimates = {estimate.name: estimate for estimate in self.found.estimates}
        names = [parameter.name for parameter in self.channel.effects[effect].parameters]
        return {name: estimates[f'{effect}.{name}'] for name in names if f'{effect}.{name}' in estimates}

    def tested(self, which: int) -> list[Array]:
        """Return the weighted residuals of train and validation, without (0) or with effects (1)."""
        simulated = [(comparison.before, comparison.after)[which] for comparison in self.comparisons]
        weights = (self.fit, self.found)[which].likelihood.precisions(simulated)
        return [
            (comparison.residual(which) * weight)[comparison.experiment.counts]
            for comparison, weight in zip(self.comparisons, weights)
        ]

    def rmse(self, which: int) -> float:
        """Return the error without (0) or with effects (1) on the test part, or on all samples without one [SI]."""
        errors = (self.before, self.after)[which]
        if 'test' in errors:
            return errors['test'].rmse
        return self.rms(which)

    def rms(self, which: int) -> float:
        """Return the error without (0) or with effects (1) on all samples [SI]."""
        return rms(np.concatenate([comparison.residual(which) for comparison in self.comparisons]))


@dataclass(frozen=True)
class Geometry:
    """
    Conversion of pressures to contact force, as identified or given.

    Attributes
    ----------
    area
        Area of each piston [m^2]; None if unknown.
    factor
        Ratio of contact force to piston force that was used with the area [-]; None if unknown.
    note
        Reason why the area was not identified, for people; None if the area was identified.

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
        The recordings.
    without_waves
        The identified recordings: without the sensor ripple of the displacement.
    splits
        Parts of each recording.
    no_test
        Reason for a missing test part, or None.
    channels
        Results by `cylinder_a`, `cylinder_b`, `force`.
    unidentified
        Reason why a recorded channel could not be identified, by name of the channel.
    options
        Options of the identification.
    notices
        Warnings about likely input errors, and notes about assumptions.
    is_interrupted
        Whether the user ended the search; the result is the best answer until then.
    changes
        Changes of the device during a recording. The results for all channels are those of the recordings after the
        change, and each change has the results before it.
    drifts
        Slow drifts of a sensor or a set-point: bent drifts, which were removed before the fit, and straight drifts,
        which the effect `set_point_drift` describes.

    """

    recordings: tuple[Recording, ...]
    without_waves: tuple[Recording, ...]
    splits: tuple[Split, ...]
    no_test: str | None
    channels: Mapping[str, ChannelResult]
    unidentified: Mapping[str, str]
    options: Options
    notices: tuple[Notice, ...] = ()
    is_interrupted: bool = False
    changes: tuple[Change, ...] = ()
    drifts: tuple[Drift, ...] = ()

    @property
    def ambient_pressure(self) -> float:
        """Ambient pressure, the zero of gauge pressures [Pa]."""
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
        """Area and geometric factor of the contact force, as fitted or as given."""
        force = self.channels.get('force')
        if force is None:
            note = 'as given' if self.options.area is not None else self.unidentified.get('force')
            return Geometry(self.options.area, self.options.geometric_factor, note)
        area, factor = force.found.model.parameters.tolist()
        return Geometry(area, factor, force.found.estimates[0].reason)
