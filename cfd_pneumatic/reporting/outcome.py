"""What closing the loop brought, in one form for a cylinder's pressure and for the contact force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification import CylinderResult, Estimate, Identification, PartError
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.residual.noise import precision
from cfd_pneumatic.identification.search.stepwise import Trial
from cfd_pneumatic.identification.verdict import Conclusion
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.units import POUND_FORCE, PSI

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scale:
    """A unit to show numbers in, and what one of it is in SI."""

    unit: str
    si: float


@dataclass(frozen=True)
class Quantity:
    """
    What was measured and simulated.

    Attributes
    ----------
    name
        For people.
    key
        What the names of its numbers end with in data.
    model
        What simulates it without effects, for people.
    small, other, large
        Units of its errors, the paper's unit of its errors, and the unit of its values in figures.

    """

    name: str
    key: str
    model: str
    small: Scale
    other: Scale
    large: Scale


PRESSURE = Quantity('pressure', 'pa', 'paper’s model', Scale('Pa', 1.0), Scale('mpsi', 1e-3 * PSI), Scale('kPa', 1e3))
FORCE = Quantity(
    'contact force', 'n', 'area times pressure', Scale('N', 1.0), Scale('lbf', POUND_FORCE), Scale('N', 1.0)
)


@dataclass(frozen=True)
class Comparison:
    """
    One recording: what was measured, and what the model makes of it without and with the effects.

    Attributes
    ----------
    recording
        Index of the recording.
    name
        Of the recording.
    times
        Of the samples, shape (m,) [s].
    measured, before, after
        Measured, and simulated without and with effects, shape (m,) [Pa or N].
    part
        Index into `split.PARTS` of each sample, shape (m,).
    weights
        By which the residuals without and with effects are tested, each of shape (m,) [-].
    inputs
        What drives the model, by name, at the samples, each of shape (m,) [SI].

    """

    recording: int
    name: str
    times: Array
    measured: Array
    before: Array
    after: Array
    part: NDArray[np.int8]
    weights: tuple[Array, Array]
    inputs: Mapping[str, Array]

    @property
    def residuals(self) -> tuple[Array, Array]:
        """Measured less simulated, without and with effects, each of shape (m,)."""
        return self.measured - self.before, self.measured - self.after

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Samples that the models were fitted to, and their residuals tested on, shape (m,)."""
        return self.part < PARTS.index('test')

    def stamps(self, signal: Signal) -> Array:
        """Return the stamps of the samples in the signal that they come from, a run of it, shape (m,) [s]."""
        count = self.measured.size
        for first in range(len(signal) - count + 1):
            run = slice(first, first + count)
            if np.array_equal(signal.values[run], self.measured):
                return signal.times[run]
        return self.times


@dataclass(frozen=True)
class Outcome:
    """
    What was found on one cylinder's pressure, or on the force.

    Attributes
    ----------
    name
        `cylinder_a`, `cylinder_b` or `force`.
    quantity
        What was measured.
    findings
        The closure of the loop.
    comparisons
        One for each recording that holds it.
    before, after
        Errors on each part without and with effects [Pa or N].
    span
        Span p99 - p1 of what was measured, mean over recordings [Pa or N].
    noise
        Standard deviation of the noise, None where it is not known [Pa or N].
    paper
        Parameters of the model without effects.

    """

    name: str
    quantity: Quantity
    findings: Conclusion
    comparisons: tuple[Comparison, ...]
    before: Mapping[str, PartError]
    after: Mapping[str, PartError]
    span: float
    noise: float | None
    paper: tuple[Estimate, ...]

    @property
    def judged_on(self) -> str:
        """The part on which before and after are compared: the test part, or all samples where there is none."""
        return 'test' if 'test' in self.before else 'all'

    @property
    def gains(self) -> tuple[Estimate, ...]:
        """Parameters of the model itself, fitted with the effects."""
        return tuple(estimate for estimate in self.findings.estimates if '.' not in estimate.name)

    def parameters(self, effect: str) -> dict[str, Estimate]:
        """Return an effect's parameters by their names."""
        return {
            estimate.name.partition('.')[2]: estimate
            for estimate in self.findings.estimates
            if estimate.name.partition('.')[0] == effect and '.' in estimate.name
        }

    def rmse(self, which: str) -> float:
        """Return the error `before` or `after`, on the part on which they are compared [Pa or N]."""
        errors = np.concatenate([one.residuals[which == 'after'] for one in self.comparisons])
        if self.judged_on == 'test':
            parts = np.concatenate([one.part for one in self.comparisons])
            errors = errors[parts == PARTS.index('test')]
        return float(np.sqrt(np.mean(errors**2)))


def outcomes(identification: Identification) -> list[Outcome]:
    """Return what was found where the loop was closed: cylinders first, then the force."""
    found = [
        _of_cylinder(cylinder, result, _holding(cylinder, identification))
        for cylinder, result in identification.cylinders.items()
        if result.closure is not None
    ]
    force = force_outcome(identification)
    return found if force is None else [*found, force]


def _holding(cylinder: str, identification: Identification) -> list[int]:
    """Return the indices of the recordings that hold a cylinder."""
    return [index for index, recording in enumerate(identification.recordings) if cylinder in recording.cylinders]


def _of_cylinder(cylinder: str, result: CylinderResult, recordings: Sequence[int]) -> Outcome:
    closure = result.closure
    assert closure is not None
    return Outcome(
        name=cylinder,
        quantity=PRESSURE,
        findings=closure,
        comparisons=tuple(
            _of_experiment(index, experiment, before, after)
            for index, experiment, before, after in zip(
                recordings, result.experiments, result.fit.simulated, closure.simulated
            )
        ),
        before=result.before,
        after=result.after,
        span=result.span,
        noise=closure.noise.std,
        paper=result.fit.estimates,
    )


def _of_experiment(index: int, experiment: Experiment, before: Array, after: Array) -> Comparison:
    times = experiment.sample_times
    displacement = experiment.displacement[experiment.samples]
    return Comparison(
        recording=index,
        name=experiment.recording,
        times=times,
        measured=experiment.pressure,
        before=before,
        after=after,
        part=experiment.part,
        weights=(precision(experiment, before), precision(experiment, after)),
        inputs={
            'displacement': displacement,
            'piston speed': np.gradient(displacement, times),
            'set-point': experiment.setpoint[experiment.samples],
        },
    )


def force_outcome(identification: Identification) -> Outcome | None:
    """Return what was found on the force, or None where the loop was not closed on it."""
    closure = getattr(identification, 'force', None)
    if closure is None:
        return None
    spans = [float(np.ptp(np.percentile(experiment.force, [1.0, 99.0]))) for experiment in closure.experiments]
    span = float(np.mean(spans))
    recordings = [index for index, recording in enumerate(identification.recordings) if recording.force is not None]
    return Outcome(
        name='force',
        quantity=FORCE,
        findings=closure,
        comparisons=tuple(
            _of_force_experiment(index, experiment, before, after)
            for index, experiment, before, after in zip(
                recordings, closure.experiments, closure.simulated_before, closure.simulated
            )
        ),
        before=closure.before,
        after=closure.after,
        span=span,
        noise=closure.noise_floor,
        paper=(),
    )


def force_effects(identification: Identification) -> Mapping[str, Sequence[float]]:
    """Return the parameters of the effects on the force that were found, by their names."""
    closure = getattr(identification, 'force', None)
    return {} if closure is None else dict(closure.fit.effects)


def _of_force_experiment(index: int, experiment: Any, before: Array, after: Array) -> Comparison:
    at = experiment.samples
    alike = np.ones_like(before)
    return Comparison(
        recording=index,
        name=experiment.recording,
        times=experiment.sample_times,
        measured=experiment.force,
        before=before,
        after=after,
        part=experiment.part,
        weights=(alike, alike),
        inputs={
            'displacement': experiment.displacement[at],
            'piston speed': experiment.rate[at],
            'pressure difference': experiment.difference,
        },
    )


@dataclass(frozen=True)
class Round:
    """
    One round of the search: each effect tried beside those that were there.

    Attributes
    ----------
    beside
        Effects that were in the model already.
    trials
        In the order of the search's ranking.

    """

    beside: tuple[str, ...]
    trials: tuple[Trial, ...]


def rounds(tried: Sequence[Trial]) -> list[Round]:
    """Return a search's trials by its rounds: a new one begins where an effect is tried again."""
    groups: list[list[Trial]] = []
    for trial in tried:
        if not groups or any(trial.effect == earlier.effect for earlier in groups[-1]):
            groups.append([])
        groups[-1].append(trial)
    found: list[Round] = []
    added: list[str] = []
    for group in groups:
        names = {trial.effect for trial in group}
        found.append(Round(tuple(effect for effect in added if effect not in names), tuple(group)))
        added += [trial.effect for trial in group if trial.accepted]
    return found
