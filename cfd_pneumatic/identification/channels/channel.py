# SPDX-License-Identifier: Apache-2.0
"""What a measured channel is: a signal, the model that simulates it, and what may be missing from that model."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from cfd_pneumatic.arrays import Array, Indices
from cfd_pneumatic.identification.channels.unknown import Unknown, bounds_of
from cfd_pneumatic.identification.data import Experiment, Motion, Options, Split
from cfd_pneumatic.identification.residual import Noise, Regressors, estimate_noise, rounding_step, sample_noise
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model import CORES, KNOTS, Data, Effect
from cfd_pneumatic.recording import Recording, Signal

EVEN = 1e6
"""A share about which knots crowd so little that they lie evenly."""

NOT_ESTIMATED = 'the recordings do not tell it: it stands as a data sheet has it'
"""Why a number of a core has no estimate."""

Effects = Mapping[str, tuple[float, ...]]
"""Parameters of each effect that is on, by its name."""


@dataclass(frozen=True)
class Scale:
    """A unit to show numbers in, and what one of it is in SI."""

    unit: str
    si: float


@dataclass(frozen=True)
class Quantity:
    """
    What is measured, for people.

    Attributes
    ----------
    name
        Of the quantity.
    key
        What the names of its numbers end with in data.
    model
        What simulates it without effects.
    small, other, large
        Units of its errors, the paper's unit of its errors, and the unit of its values in figures.

    """

    name: str
    key: str
    model: str
    small: Scale
    other: Scale
    large: Scale


@dataclass(frozen=True)
class Curve:
    """
    What draws the laws that nobody knows of a channel, and which it asks for.

    Attributes
    ----------
    name
        Of the effect.
    enters, against
        Where a law may enter and what it may depend on, by the numbers of the effect's parameters.
    asked
        Where one of each variable is asked for.
    memory
        What the effect's third parameter begins as [its unit].
    memories
        As what else, by where it enters and against what.
    both_ways
        Variables that go both ways: knots crowd about nothing moving.
    crowds
        Shares of the range about its middle within which knots crowd, of the others.
    whole
        Variables without outliers: all that they have visited is their range.

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
    One fitted parameter.

    Attributes
    ----------
    name, unit
        `k_x`, or `EFFECT.PARAMETER`.
    value, std
        Estimate and standard error [unit]; None where not identifiable.
    interval
        95 % confidence interval [unit]; None where not identifiable.
    reason
        Why it is not identifiable, or None.

    """

    name: str
    unit: str
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    reason: str | None

    @property
    def identifiable(self) -> bool:
        """Whether the recordings tell the value."""
        return self.reason is None


@dataclass(frozen=True, eq=False)
class Model:
    """
    A channel's model with values for everything.

    Attributes
    ----------
    parameters
        Of the model without effects, in the channel's order, shape (base,) [SI].
    effects
        Parameters of each effect that is on, in the order in which they were added.
    own
        What each recording has for itself, in the channel's order, shape (recordings, own) [SI].
    unknowns
        How many of them were searched.
    core
        What stands in the linear core's place, by its name with its parameters; empty where nothing does.
    untold
        Names of the core's parameters that are held as a data sheet has them.

    """

    parameters: Array
    effects: Effects
    own: Array
    unknowns: int = 0
    core: Effects = field(default_factory=dict)
    untold: frozenset[str] = frozenset()

    @classmethod
    def of_parts(cls, parameters: Array, parts: Effects, own: Array, unknowns: int = 0) -> Model:
        """Return a model with a core and effects that are given together."""
        core = {name: values for name, values in parts.items() if name in CORES}
        effects = {name: values for name, values in parts.items() if name not in CORES}
        return cls(parameters, effects, own, unknowns, core)

    @property
    def parts(self) -> Effects:
        """The core and the effects: all that is simulated beside the linear model."""
        return {**self.core, **self.effects}


class Channel(ABC):
    """
    A measured signal and its model.

    A further channel is a subclass in this package with a row in `CHANNELS`.

    Attributes
    ----------
    name
        In results: `cylinder_a`, `cylinder_b`, `force`.
    quantity
        What is measured.
    topics
        Topics of the signal as measured and as simulated, in a cell's namespace.
    msgtype
        Type of their messages.
    effects
        Every core and effect that the model knows, in the order in which their parameters stand in a row.
    cores
        What may stand in the linear core's place.
    library
        Effects that a search chooses from.
    curve
        What draws a law where none of these explains what is left.
    parameters
        Units of the parameters without effects, by their names.
    hints
        What to record so that one of them shows.
    own
        Names of what each experiment has for itself.
    needed
        Whether an identification fails where it tells nothing.
    immaterial
        Share of the signal's range below which nothing is looked for: a simulated signal has no noise.

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
    own: tuple[str, ...]
    immaterial: float = 0.0
    needed: bool = False

    # data

    @classmethod
    @abstractmethod
    def found_in(cls, recordings: Sequence[Recording], options: Options) -> Sequence[Channel]:
        """Return the channels of this kind that recordings hold."""

    @abstractmethod
    def signal(self, recording: Recording) -> Signal | None:
        """Return the signal in a recording, None where that does not hold it."""

    @abstractmethod
    def experiment(self, recording: Recording, motion: Motion, split: Split) -> Experiment:
        """
        Return a recording that holds the signal made ready for the model.

        Raises
        ------
        InputError
            If it tells nothing.

        """

    # model

    @abstractmethod
    def starts(self, experiments: Sequence[Experiment]) -> list[Model]:
        """Return models without effects that a first fit may start from."""

    @abstractmethod
    def follow(
        self, experiment: Experiment, effects: Sequence[str], rows: Array, count: int
    ) -> Iterator[tuple[slice, Array]]:
        """
        Yield what models side by side make of an experiment.

        Parameters
        ----------
        experiment
            What drives them.
        effects
            Core and effects that are on.
        rows
            Numbers of each model: parameters, every effect's parameters, the experiment's own, shape (models, slots).
        count
            How many of the first samples to simulate.

        Yields
        ------
        samples, simulated
            Which samples, and the signal at them, shape (m, models) [SI].

        """

    def linearised(
        self, experiment: Experiment, effects: Sequence[str], row: Array, slots: Indices, steps: Array, count: int
    ) -> Iterator[tuple[slice, Array, Array]]:
        """
        Yield what a model makes of an experiment, and its derivatives by some of its numbers.

        Parameters
        ----------
        experiment, effects, count
            As in `follow`.
        row
            The model's numbers, shape (slots,).
        slots, steps
            By which of them, shape (k,), and differences that are small for these [SI].

        Yields
        ------
        samples, simulated, jacobian
            Which samples, the signal at them, shape (m,), and its derivatives, shape (m, k) [SI].

        """
        for samples, simulated in self.follow(experiment, effects, stepped(row, slots, steps), count):
            yield samples, simulated[:, 0], differences(simulated, steps)

    @abstractmethod
    def searched(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return which parameters without effects, and which numbers of the experiments, are searched."""

    @abstractmethod
    def held(self, experiments: Sequence[Experiment], model: Model) -> Mapping[str, str]:
        """Return why parameters of the model, and of its effects, are held and not searched, by their names."""

    @abstractmethod
    def check(
        self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model, estimates: Sequence[Estimate]
    ) -> None:
        """Raise InputError where a fit without effects tells nothing, or nothing that can be."""

    def unidentifiable(self, experiments: Sequence[Experiment], effect: str) -> str | None:
        """Return why experiments cannot tell an effect's parameters, whatever a fit says, or None."""
        return None

    def beginnings(self, model: Model, astray: bool) -> list[Model]:
        """Return where a fit with a further effect may start; the lack of it may have led a model `astray`."""
        return [model]

    def beside_effects(self, experiments: Sequence[Experiment], model: Model) -> Model:
        """Return a model that was fitted without effects where one that has some may be."""
        return model

    def may_tell(self, experiments: Sequence[Experiment], effect: str, model: Model) -> bool:
        """Return whether experiments may tell an effect beside a model from what the model's own parameters do."""
        return True

    def may_hide(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether samples may hide what happens between them: a law then leaves nothing that follows inputs."""
        return False

    def confounded(
        self,
        experiments: Sequence[Experiment],
        model: Model,
        estimates: Sequence[Estimate],
        residual: Array,
        left: Callable[[str, tuple[float, ...]], Array],
    ) -> Mapping[str, tuple[str, ...]]:
        """
        Return effects that others, whose own signature is too weak to show, may pass for, with these.

        Parameters
        ----------
        experiments, model, estimates
            What was measured, what was fitted, and how well.
        residual
            What the model leaves at the samples that count, shape (n,).
        left
            Returns what an effect with some parameters adds that the model's unknowns can't make up for, shape (n,).

        """
        return {}

    def levels(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Return what its parameters are scheduled over, at the samples of each experiment [Pa]; empty: nothing."""
        return []

    # residual

    @abstractmethod
    def sensitivity(self, model: Model) -> float:
        """Return by how much the displacement's error reaches the signal [SI/m]."""

    @abstractmethod
    def rests(self, experiment: Experiment, residual: Array) -> list[Array]:
        """Return the runs of an experiment's residual while piston and set-point rest."""

    @abstractmethod
    def regressors(self, experiment: Experiment, simulated: Array, weight: Array) -> Regressors:
        """Return what the residual may depend on: inputs, what the model makes of them, and their products."""

    @abstractmethod
    def data(self, experiments: Sequence[Experiment], model: Model, simulated: Sequence[Array]) -> Data:
        """Return what effects draw their starting values from; `residual`, `mean` and `lag` are among it."""

    @abstractmethod
    def variables(self, experiment: Experiment, simulated: Array, model: Model) -> Mapping[str, Array]:
        """Return at each sample what a law may depend on, by the names of its `curve`."""

    @abstractmethod
    def law_units(
        self, experiments: Sequence[Experiment], model: Model, noise: float, most: Mapping[str, float]
    ) -> Mapping[str, float]:
        """
        Return heights of laws that are small beside what they act on, by where they enter [SI].

        None is asked for at a place that is not among these.

        Parameters
        ----------
        experiments, model
            Of which, and beside which, one is drawn.
        noise
            About as large as what that leaves [SI].
        most
            How far what a law may depend on goes from zero, by its name [SI].

        """

    def precision(self, experiment: Experiment, simulated: Array) -> Array:
        """Return the inverse of each sample's standard deviation, relative to one at rest, shape (m,) in (0, 1]."""
        return np.ones_like(simulated)

    @abstractmethod
    def shown(self, experiment: Experiment) -> Mapping[str, Array]:
        """Return the inputs to show beside the residual, by their names for people, at the samples, shape (m,)."""

    # what follows from that

    def slots_of(self, effect: str) -> range:
        """Return where an effect's parameters stand in a row."""
        return self._slots[effect]

    @lazy_property
    def _slots(self) -> dict[str, range]:
        ends = np.cumsum([len(self.parameters), *(len(one.parameters) for one in self.effects.values())]).tolist()
        return dict(zip(self.effects, itertools.starmap(range, itertools.pairwise(ends))))

    @lazy_property
    def shared(self) -> int:
        """How many numbers of a row are those of all experiments."""
        return len(self.parameters) + sum(len(one.parameters) for one in self.effects.values())

    def own_slots(self, index: int) -> range:
        """Return where the numbers of one recording stand in a row."""
        first = self.shared + index * len(self.own)
        return range(first, first + len(self.own))

    def row(self, model: Model) -> Array:
        """Return all numbers of a model: its parameters, every effect's (null where it is off), each experiment's."""
        parts = model.parts
        own = [parts.get(name, effect.null) for name, effect in self.effects.items()]
        return np.concatenate([model.parameters, *own, model.own.ravel()])

    def model(self, row: Array, parts: Sequence[str], unknowns: int = 0) -> Model:
        """Return the model that a row stands for, with a core and effects."""
        values = {name: tuple(row[list(self.slots_of(name))].tolist()) for name in parts}
        own = row[self.shared :].reshape(-1, len(self.own)).copy()
        return Model.of_parts(row[: len(self.parameters)].copy(), values, own, unknowns)

    def candidates(self, model: Model) -> list[str]:
        """Return the effects that may be missing beside a model's core and effects."""
        covered = {name for core in model.core for name in self.effects[core].covers}
        return [name for name in self.library if name not in covered and name not in model.effects]

    def simulate(self, experiments: Sequence[Experiment], models: Sequence[Model]) -> list[Array]:
        """Return what models with the same core and effects make of each experiment, shape (m, models) [SI]."""
        rows = np.array([self.row(one) for one in models])
        found = []
        for one in experiments:
            found.append(np.empty((one.part.size, len(models))))
            for samples, values in self.follow(one, tuple(models[0].parts), self.of_one(rows, one), one.part.size):
                found[-1][samples] = values
        return found

    def simulated(self, experiments: Sequence[Experiment], model: Model) -> list[Array]:
        """Return what one model makes of each experiment, shape (m,) [SI]."""
        return [found[:, 0] for found in self.simulate(experiments, [model])]

    def of_one(self, rows: Array, experiment: Experiment) -> Array:
        """Return the numbers that concern one experiment, shape (models, slots)."""
        return rows[:, [*range(self.shared), *self.own_slots(experiment.index)]]

    def unknowns(self, experiments: Sequence[Experiment], model: Model) -> list[Unknown]:
        """Return everything that is searched of a model with its core and effects."""
        found, held = self.searched(experiments, model), self.held(experiments, model)
        for name, values in model.parts.items():
            effect = self.effects[name]
            highest = max(map(abs, values[-KNOTS:])) if effect.generic else 0.0
            for slot, parameter, value in zip(self.slots_of(name), effect.parameters, values):
                full = f'{name}.{parameter.name}'
                if parameter.choice or full in held:
                    continue
                lower, upper = bounds_of(parameter, experiments)
                scale = highest or abs(value) or 1e-3 * min(abs(parameter.lower) + abs(parameter.upper), 1.0)
                found.append(
                    Unknown(
                        full,
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
        return found

    def noise(self, experiments: Sequence[Experiment], simulated: Sequence[Array], model: Model) -> Noise:
        """
        Return the noise of the residual, from the rests where there are enough of them.

        At rest the simulated signal need not be right but for a level and a trend.
        """
        rests: list[Array] = []
        variances, roundings, sizes = [], [], []
        for one, values in zip(experiments, simulated):
            residual = one.measured - values
            blurred = self.sensitivity(model) * one.motion.uncertainty
            variances.append(sample_noise(one.sample_times, residual) ** 2 + blurred**2)
            immaterial = self.immaterial * float(np.ptp(one.measured))
            roundings.append(rounding_step(one.measured) ** 2 / 12.0 + immaterial**2)
            sizes.append(residual.size)
            rests += [run - np.mean(run) for run in self.rests(one, residual)]
        white = math.sqrt(float(np.average(variances, weights=sizes)))
        return estimate_noise(rests, white, sum(sizes), math.sqrt(float(np.mean(roundings))))


def stepped(row: Array, slots: Indices, steps: Array) -> Array:
    """Return numbers of a model, and such with a step in each of some slots, shape (1 + k, slots)."""
    rows = np.repeat(row[None], 1 + slots.size, axis=0)
    rows[1 + np.arange(slots.size), slots] += steps
    return rows


def differences(simulated: Array, steps: Array) -> Array:
    """Return derivatives by differences, shape (m, k), from what a model and such with a step make, (m, 1 + k)."""
    with np.errstate(invalid='ignore', over='ignore'):  # a model that runs away is no worse than one that has
        return np.asarray((simulated[:, 1:] - simulated[:, :1]) / steps)
