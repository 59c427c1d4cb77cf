# SPDX-License-Identifier: Apache-2.0
"""A measured channel: a signal, the model that simulates the signal, and the effects that the model may lack."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from cfd_pneumatic.arrays import Array, Indices
from cfd_pneumatic.identification.channels.unknown import Unknown, search_bounds
from cfd_pneumatic.identification.data import Experiment, Motion, Options, Split
from cfd_pneumatic.identification.residual import Noise, Regressors, estimate_noise, rounding_step, sample_noise
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model import CORES, COUNT, KNOTS, Data, Effect
from cfd_pneumatic.recording import Recording, Signal

EVEN = 1e6
"""Crowding width at which knots are evenly spaced [share of the range]."""

NOT_ESTIMATED = 'not determined by the recordings; the data-sheet value is used'
"""Reason why a parameter of a core has no estimate."""

Effects = Mapping[str, tuple[float, ...]]
"""Parameters of each active effect, by name."""


@dataclass(frozen=True)
class Scale:
    """A unit for display, and its value in SI."""

    unit: str
    si: float


@dataclass(frozen=True)
class Quantity:
    """
    The measured quantity, with texts and units for people.

    Attributes
    ----------
    name
        Name of the quantity.
    key
        Suffix of keys in results.
    model
        Name of the model without effects.
    small, paper, large
        Unit of errors, the paper's unit of errors, and the unit of values in figures.

    """

    name: str
    key: str
    model: str
    small: Scale
    paper: Scale
    large: Scale


@dataclass(frozen=True)
class Curve:
    """
    The effect that represents unknown characteristics of a channel, and the characteristics to search.

    Attributes
    ----------
    name
        Name of the effect.
    enters, against
        Places and variables of a characteristic, in the order of the effect's first two parameters.
    asked
        Places to search, by variable.
    memory
        Initial value of the effect's third parameter [its unit].
    memories
        Initial values of the third parameter for some pairs of place and variable.
    both_ways
        Variables with both signs: knots crowd about zero.
    crowds
        Crowding widths about the middle of the range to try for the remaining variables [share of the range].
    whole
        Variables without outliers: the range is all visited values.

    """

    name: str
    enters: tuple[str, ...]
    against: tuple[str, ...]
    asked: Mapping[str, tuple[str, ...]]
    memory: float
    memories: Mapping[tuple[str, str], tuple[float, ...]]
    both_ways: tuple[str, ...]
    crowds: tuple[float, ...] = (EVEN,)
    whole: tuple[str, ...] = ()


@dataclass(frozen=True)
class Estimate:
    """
    A fitted parameter.

    Attributes
    ----------
    name, unit
        `k_x`, or `EFFECT.PARAMETER`.
    value, std
        Estimate and standard error [unit]; None where not identifiable.
    interval
        95 % confidence interval [unit]; None where not identifiable.
    reason
        Why the parameter is not identifiable, or None.

    """

    name: str
    unit: str
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    reason: str | None

    @property
    def identifiable(self) -> bool:
        """Whether the recordings determine the value."""
        return self.reason is None


@dataclass(frozen=True, eq=False)
class Model:
    """
    A channel's model with all its values.

    Attributes
    ----------
    parameters
        Parameters of the model without effects, in the channel's order, shape (base,) [SI].
    effects
        Parameters of each active effect, in the order in which the effects were added.
    recording_values
        Values of each recording, in the order of `Channel.recording_parameters`, shape (recordings, parameters) [SI].
    unknowns
        Number of unknowns of the fit.
    core
        Parameters of the core that replaces the linear core, by name; empty if none does.
    assumed_parameters
        Names of the core's parameters that are held at data-sheet values.

    """

    parameters: Array
    effects: Effects
    recording_values: Array
    unknowns: int = 0
    core: Effects = field(default_factory=dict)
    assumed_parameters: frozenset[str] = frozenset()

    @classmethod
    def of_parts(cls, parameters: Array, parts: Effects, recording_values: Array, unknowns: int = 0) -> Model:
        """Return a model from core and effects in a single mapping."""
        core = {name: values for name, values in parts.items() if name in CORES}
        effects = {name: values for name, values in parts.items() if name not in CORES}
        return cls(parameters, effects, recording_values, unknowns, core)

    @property
    def parts(self) -> Effects:
        """Core and effects: everything simulated in addition to the linear model."""
        return {**self.core, **self.effects}


class Channel(ABC):
    """
    A measured signal and its model.

    A further channel is a subclass in this package with a row in `CHANNELS`.

    Attributes
    ----------
    name
        Name in results: `cylinder_a`, `cylinder_b`, `force`.
    quantity
        Measured quantity.
    topics
        Topics of the signal as measured and as simulated, in a cell's namespace.
    msgtype
        Type of the topics' messages.
    effects
        All cores and effects of the model, in the order of their parameters in a row.
    cores
        Cores that may replace the linear core.
    library
        Effects that a search chooses from.
    curve
        Unknown characteristic, for a remaining error that no effect of the library explains.
    parameters
        Units of the parameters without effects, by their names.
    hints
        What to record so that a parameter becomes identifiable.
    recording_parameters
        Names of the values that each recording has in addition, such as an offset.
    needed
        Whether an identification fails if the channel determines no parameter.
    immaterial
        Share of the signal's range below which errors are ignored, because a simulated signal has no noise.

    """

    name: str
    quantity: Quantity
    topics: tuple[str, str]
    msgtype: str
    effects: Mapping[str, Effect]
    cores: Mapping[str, Effect] = MappingProxyType({})
    library: Mapping[str, Effect]
    curve: Curve
    parameters: Mapping[str, str]
    hints: Mapping[str, str] = MappingProxyType({})
    recording_parameters: tuple[str, ...]
    immaterial: float = 0.0
    needed: bool = False

    # data

    @classmethod
    @abstractmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> Sequence[Channel]:
        """Return the channels of this kind in some recordings."""

    @abstractmethod
    def signal(self, recording: Recording) -> Signal | None:
        """Return the signal in a recording, None if the recording lacks the signal."""

    @abstractmethod
    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """
        Return the experiment of a recording that holds the signal.

        Raises
        ------
        InputError
            If the signal is too short or constant.

        """

    # model

    @abstractmethod
    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return models without effects as starts of a first fit."""

    @abstractmethod
    def simulated_pieces(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """
        Yield simulations of an experiment by several models, in pieces.

        Parameters
        ----------
        experiment
            Inputs of the models.
        effects
            Active core and effects.
        rows
            Row of each model: parameters, parameters of all effects, values of the recording, shape (models, slots).
        count
            Number of first samples to simulate.

        Yields
        ------
        samples, simulated
            Samples of the piece, and the signal there, shape (m, models) [SI].

        """

    def effort(self, experiment: Experiment, effects: Sequence[str], row: Array, models: int, count: int) -> float:
        """Return the effort of a simulation by some models side by side [simulated steps]; `row` as in `linearised`."""
        return math.ceil(models / COUNT) * count

    def linearised(
        self, experiment: Experiment, effects: Sequence[str], row: Array, slots: Indices, steps: Array, count: int
    ) -> Iterator[tuple[slice, Array, Array]]:
        """
        Yield the simulation of an experiment and its derivatives by some slots of the row, in pieces.

        Parameters
        ----------
        experiment, effects, count
            As in `simulated_pieces`.
        row
            Row of the model, shape (slots,).
        slots, steps
            Slots of the derivatives, shape (k,), and small steps in these slots [SI].

        Yields
        ------
        samples, simulated, jacobian
            Samples of the piece, the signal there, shape (m,), and its derivatives, shape (m, k) [SI].

        """
        for samples, simulated in self.simulated_pieces(experiment, effects, stepped(row, slots, steps), count):
            yield samples, simulated[:, 0], differences(simulated, steps)

    @abstractmethod
    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return the unknowns among the parameters without effects and the values of the recordings."""

    @abstractmethod
    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return why parameters of model and effects are held and not searched, by name."""

    @abstractmethod
    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise InputError if a fit without effects determines nothing, or impossible values."""

    def unidentifiable(self, experiments: Sequence[Experiment], effect: str) -> str | None:
        """Return why experiments cannot determine an effect's parameters, regardless of a fit, or None."""
        return None

    def beginnings(self, model: Model, astray: bool) -> list[Model]:
        """Return starts of a fit with a further effect; `astray` if its lack may have biased the model."""
        return [model]

    def limited_for_effects(self, experiments: Sequence[Experiment], model: Model) -> Model:
        """Return a model that was fitted without effects, within the limits of a simulation with effects."""
        return model

    def may_tell(self, experiments: Sequence[Experiment], effect: str, model: Model) -> bool:
        """Return whether experiments may distinguish an effect from a change of the model's parameters."""
        return True

    def may_hide(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether the motion is sampled too slowly to resolve: a curve then may hide a dependence on inputs."""
        return False

    def confounded(
        self,
        experiments: Sequence[Experiment],
        model: Model,
        estimates: Sequence[Estimate],
        residual: Array,
        unexplained_effect: Callable[[str, tuple[float, ...]], Array],
    ) -> Mapping[str, tuple[str, ...]]:
        """
        Return effects of the model that may be other effects with a signature too weak to show, with these effects.

        Parameters
        ----------
        experiments, model, estimates
            Experiments, fitted model and estimates.
        residual
            Residual of the model at the samples that count, shape (n,).
        unexplained_effect
            Returns the part of an effect with some parameters that the model's unknowns cannot reproduce, shape (n,).

        """
        return {}

    def levels(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Return the scheduling pressure of the parameters at the samples of each experiment [Pa]; empty if none."""
        return []

    # residual

    @abstractmethod
    def sensitivity(self, model: Model) -> float:
        """Return the gain from an error of the displacement to the signal [SI/m]."""

    @abstractmethod
    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of an experiment's residual while piston and set-point rest."""

    @abstractmethod
    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return signals that the residual may depend on: inputs, simulated signals, and products."""

    @abstractmethod
    def data(self, experiments: Sequence[Experiment], model: Model, simulated: Sequence[Array]) -> Data:
        """Return the features for the effects' starting values, `residual`, `mean` and `lag` among them."""

    @abstractmethod
    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return the variables of a characteristic at each sample, by the names of `curve.against`."""

    @abstractmethod
    def characteristic_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """
        Return a small height of an unknown curve for each place: like the noise, or 1 % for factors.

        Parameters
        ----------
        experiments, model
            Experiments and model to which a characteristic is added.
        noise
            Approximate size of the model's residual [SI].
        most
            Largest magnitude of each variable, by name [SI].

        """

    def precision(self, experiment: Experiment, simulated: Array) -> Array:
        """Return the inverse standard deviation of each sample, relative to rest, shape (m,) in (0, 1]."""
        return np.ones_like(simulated)

    @abstractmethod
    def shown(self, experiment: Experiment) -> Mapping[str, Array]:
        """Return inputs to show next to the residual, by display name, at the samples, shape (m,)."""

    # derived from the above

    def slots_of(self, effect: str) -> range:
        """Return the slots of an effect's parameters in a row."""
        return self._slots[effect]

    @lazy_property
    def _slots(self) -> dict[str, range]:
        ends = np.cumsum([len(self.parameters), *(len(effect.parameters) for effect in self.effects.values())]).tolist()
        return dict(zip(self.effects, itertools.starmap(range, itertools.pairwise(ends))))

    @lazy_property
    def shared(self) -> int:
        """Number of slots of a row that all experiments share."""
        return len(self.parameters) + sum(len(effect.parameters) for effect in self.effects.values())

    def recording_slots(self, index: int) -> range:
        """Return the slots of a recording's values in a row."""
        first = self.shared + index * len(self.recording_parameters)
        return range(first, first + len(self.recording_parameters))

    def row(self, model: Model) -> Array:
        """Return the row of a model: its parameters, those of all effects (null if off), values of the recordings."""
        parts = model.parts
        effect_values = [parts.get(name, effect.null) for name, effect in self.effects.items()]
        return np.concatenate([model.parameters, *effect_values, model.recording_values.ravel()])

    def model(self, row: Array, parts: Sequence[str], unknowns: int = 0) -> Model:
        """Return the model of a row, with a core and effects."""
        values = {name: tuple(row[list(self.slots_of(name))].tolist()) for name in parts}
        recording_values = row[self.shared :].reshape(-1, len(self.recording_parameters)).copy()
        return Model.of_parts(row[: len(self.parameters)].copy(), values, recording_values, unknowns)

    def candidates(self, model: Model) -> list[str]:
        """Return the effects of the library that a model with its core may lack."""
        covered = {name for core in model.core for name in self.effects[core].covers}
        return [name for name in self.library if name not in covered and name not in model.effects]

    def simulate(self, experiments: Sequence[Experiment], models: Sequence[Model]) -> list[Array]:
        """Simulate each experiment with models of the same core and effects, shape (m, models) [SI]."""
        rows = np.array([self.row(model) for model in models])
        simulated = []
        for experiment in experiments:
            simulated.append(np.empty((experiment.part.size, len(models))))
            for samples, values in self.simulated_pieces(
                experiment, tuple(models[0].parts), self.rows_of_experiment(rows, experiment), experiment.part.size
            ):
                simulated[-1][samples] = values
        return simulated

    def simulated(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Simulate each experiment with a model, shape (m,) [SI]."""
        return [signals[:, 0] for signals in self.simulate(experiments, [model])]

    def rows_of_experiment(self, rows: Array, experiment: Experiment) -> Array:
        """Return the rows of models for an experiment alone, shape (models, slots)."""
        return rows[:, [*range(self.shared), *self.recording_slots(experiment.index)]]

    def unknowns(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return all unknowns of a model with its core and effects."""
        unknowns, held = self.searched(experiments, model), self.held(experiments, model)
        for name, values in model.parts.items():
            effect = self.effects[name]
            highest = max(map(abs, values[-KNOTS:])) if effect.generic else 0.0
            for slot, parameter, value in zip(self.slots_of(name), effect.parameters, values):
                full_name = f'{name}.{parameter.name}'
                if parameter.choice or full_name in held:
                    continue
                lower, upper = search_bounds(parameter, experiments)
                scale = highest or abs(value) or 1e-3 * min(abs(parameter.lower) + abs(parameter.upper), 1.0)
                unknowns.append(
                    Unknown(
                        full_name,
                        parameter.unit,
                        slot,
                        lower,
                        upper,
                        scale,
                        parameter.logarithmic,
                        expected=math.log(parameter.null) if parameter.logarithmic else parameter.null,
                        spread=parameter.spread,
                    )
                )
        return unknowns

    def noise(self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model) -> Noise:
        """
        Estimate the noise of the residual, from rests if there are enough.

        At rest the simulated signal may be wrong by a level and a trend.
        """
        rests: list[Array] = []
        variances, roundings, sizes = [], [], []
        for experiment, values in zip(experiments, simulated):
            residual = experiment.measured - values
            blurred = self.sensitivity(model) * experiment.motion.uncertainty
            variances.append(sample_noise(experiment.sample_times, residual) ** 2 + blurred**2)
            immaterial = self.immaterial * float(np.ptp(experiment.measured))
            roundings.append(rounding_step(experiment.measured) ** 2 / 12.0 + immaterial**2)
            sizes.append(residual.size)
            rests += [run - np.mean(run) for run in self.rests(experiment, residual)]
        white = math.sqrt(float(np.average(variances, weights=sizes)))
        return estimate_noise(rests, white, sum(sizes), math.sqrt(float(np.mean(roundings))))


def stepped(row: Array, slots: Indices, steps: Array) -> Array:
    """Return the row of a model, then rows with a step in each of some slots, shape (1 + k, slots)."""
    rows = np.repeat(row[None], 1 + slots.size, axis=0)
    rows[1 + np.arange(slots.size), slots] += steps
    return rows


def differences(simulated: Array, steps: Array) -> Array:
    """Return derivatives by differences, shape (m, k), from simulations of `stepped` rows, shape (m, 1 + k)."""
    with np.errstate(invalid='ignore', over='ignore'):  # a diverging model may overflow
        return np.asarray((simulated[:, 1:] - simulated[:, :1]) / steps)
