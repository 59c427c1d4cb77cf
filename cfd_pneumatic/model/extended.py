# SPDX-License-Identifier: Apache-2.0
"""A cylinder with physical effects beside the paper's equations, at constant gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model.composed import (
    OFFSET_ROW,
    PARAMETER_ROWS,
    S0,
    SIGNAL_ROW,
    SIZE,
    STATE_ROWS,
    follow,
    propagate,
    read,
    rest,
    settle,
    step,
)
from cfd_pneumatic.model.effects import MODULES, PRESSURE_PARTS, Effect
from cfd_pneumatic.model.gain_starts import charging_time, quickest
from cfd_pneumatic.model.lanes import COUNT
from cfd_pneumatic.model.places import FOLLOWED, MEASURED, PLACES, STATES, all_parameters, switches
from cfd_pneumatic.runtime import map_in_threads

STAGE_ROWS = slice(S0 // COUNT, S0 // COUNT + STATES)
"""Rows of the states as effects see them; those that no rate moves have to stand there from the beginning."""

_SETTLED = 8.0  # time constants: to a third of a thousandth
_MARGIN_BELOW, _MARGIN_ABOVE = 0.8, 1.2  # of the set-points: how far pressures stray from them
_LONGEST_SETTLING = 2.0  # [s]
# a live step is as short as its stiffness within such round numbers says, which is seldom asked
_PRESSURE_STEP, _DISPLACEMENT_STEP, _SPEED_STEP = 1e4, 1e-3, 0.1  # [Pa, m, m/s]
_LOWEST, _HIGHEST = 1e4, 1e8  # pressures whose stiffness is asked [Pa]
_BOXES = 64

SLOWEST_CUT = 1.5
"""A step is at most this many of the fastest time constants long [-]."""

MOVING = frozenset(name for name in PRESSURE_PARTS if hasattr(MODULES[name], 'displacement'))
"""Effects that make the chamber follow another displacement than the measured one."""


def check_effects(effects: Mapping[str, Sequence[float]], known: Mapping[str, Effect], kind: str) -> None:
    """
    Check that effects are known, and have as many parameters as belong to them.

    Raises
    ------
    ValueError
        If they are not; `kind` says what they act on.

    """
    for name, own in effects.items():
        if name not in known:
            raise ValueError(f'{name} is no effect on the {kind}; there are: {", ".join(known)}')
        wanted = len(known[name].parameters)
        if len(own) != wanted:
            raise ValueError(f'{name} has {len(own)} parameters where {wanted} belong')


class Movement(NamedTuple):
    """The piston over one step: it moves in a straight line."""

    time: float
    """At the end, since the start [s]."""

    duration: float
    """Of the step [s]."""

    begin: float
    """Displacement at the beginning [m]."""

    end: float
    """Displacement at the end [m]."""

    @property
    def rate(self) -> float:
        """Speed [m/s]."""
        return (self.end - self.begin) / self.duration

    def along(self, direction: float) -> Movement:
        """Return it with the displacement counted in a direction, 1 or -1."""
        return Movement(self.time, self.duration, direction * self.begin, direction * self.end)


@dataclass(frozen=True)
class ExtendedState:
    """
    Where a cylinder with effects is.

    Attributes
    ----------
    effects
        Names of those that are on.
    values
        States in the composed kernel's order: pressures [Pa], those of the effects, displacements [m].
    reading
        What the pressure sensor reads [Pa].

    """

    effects: frozenset[str]
    values: tuple[float, ...]
    reading: float

    @property
    def p(self) -> float:
        """Outlet pressure, absolute [Pa]."""
        return self.values[0]

    @property
    def p_f(self) -> float:
        """Sensed pressure, absolute [Pa]."""
        return self.values[1]


@dataclass(frozen=True)
class ExtendedCylinder:
    """
    Equations (8) and (12) at constant gains, with effects.

    A transport delay is not its matter: who reads the sensor late knows by how much.

    Attributes
    ----------
    gains
        In the order of `SPECS` [SI].
    effects
        Parameters of each effect that is on, by its name.
    ambient_pressure
        Absolute [Pa].

    """

    gains: Sequence[float] | Array
    effects: Mapping[str, Sequence[float]]
    ambient_pressure: float

    def stiffness(self, pressures: Sequence[float], displacements: Sequence[float], speed: float) -> float:
        """
        Return the inverse of the fastest time constant [1/s].

        Parameters
        ----------
        pressures, displacements
            Extremes that are reached [Pa, m].
        speed
            The highest [m/s].

        """
        of_gains, of_effects = quickest(self.gains), [0.0]
        for name, own in self.effects.items():
            effect, quicker = PRESSURE_PARTS[name], 1.0
            if effect.quickens is not None:
                k_x = float(self.gains[0])
                quicker = max(1.0, *(effect.quickens(p, x, k_x, *own) for p in pressures for x in displacements))
            of_gains *= quicker
            if effect.fastest is not None:
                of_effects.append(quicker * effect.fastest(speed, *own))
        return max(of_gains, *of_effects) / SLOWEST_CUT

    @property
    def settling(self) -> float:
        """Time in which the pressure settles at a rest below the set-point, where the regulator charges [s]."""
        return min(_SETTLED * charging_time(self.gains), _LONGEST_SETTLING)

    def begin(self, p: float, p_f: float, x: float, before: ExtendedState | None = None) -> ExtendedState:
        """
        Return the state to step from.

        Parameters
        ----------
        p, p_f
            Pressures [Pa].
        x
            Displacement that grows the chamber [m].
        before
            State up to now, perhaps with other effects: those that stay on go on from it, others start at rest.

        """
        effects = frozenset(self.effects)
        if before is not None and before.effects == effects:
            return before
        numbers = self._numbers()
        rest(x, p, numbers)
        values = _rows(numbers)[STATE_ROWS, 0].copy()
        values[1] = p_f
        if before is not None:
            for name in effects & before.effects:
                own = PLACES[name].states
                values[own] = before.values[own]
        if before is not None and effects & MOVING == before.effects & MOVING:
            for index in (FOLLOWED, MEASURED):
                values[index] = before.values[index]
        else:  # the chamber stands where it does while the piston rests here
            numbers = self._numbers(values)
            follow(0.0, x, 1.0, self.ambient_pressure, numbers, self._on)
            values = _rows(numbers)[STATE_ROWS, 0]
        return ExtendedState(effects, tuple(values.tolist()), p)

    def step(self, state: ExtendedState, movement: Movement, setpoint: float) -> ExtendedState:
        """Return the state after a movement at an absolute set-point [Pa]."""
        numbers = self._numbers(state.values)
        p, held = (min(max(_LOWEST, one), _HIGHEST) for one in (state.p, setpoint))  # they may be no numbers
        stiffness = self._known_stiffness(
            _around(p, held, _PRESSURE_STEP),
            _around(movement.begin, movement.end, _DISPLACEMENT_STEP),
            _around(0.0, abs(movement.rate), _SPEED_STEP)[1],
        )
        step(
            movement.time,
            movement.end,
            movement.duration,
            0.0,
            setpoint,
            self.ambient_pressure,
            stiffness,
            numbers,
            self._on,
        )
        rows = _rows(numbers)
        return ExtendedState(state.effects, tuple(rows[STATE_ROWS, 0].tolist()), float(rows[SIGNAL_ROW, 0]))

    def read(self, state: ExtendedState, time: float) -> float:
        """Return what the pressure sensor reads in a state, at a time [s] since the start [Pa]."""
        numbers = self._numbers(state.values)
        read(time, self.ambient_pressure, numbers, self._on)
        return float(_rows(numbers)[SIGNAL_ROW, 0])

    @lazy_property
    def _on(self) -> int:
        return switches(self.effects)

    @lazy_property
    def _blank(self) -> Array:
        """The kernel's numbers with this cylinder in every lane, in no state."""
        numbers = np.zeros(SIZE)
        _rows(numbers)[PARAMETER_ROWS] = all_parameters(self.gains, self.effects)[:, None]
        return numbers

    def _numbers(self, values: Sequence[float] | Array | None = None) -> Array:
        """Return the kernel's numbers with this cylinder in every lane, in a state."""
        numbers = self._blank.copy()
        if values is not None:
            rows, own = _rows(numbers), np.asarray(values)[:, None]
            rows[STATE_ROWS] = own
            rows[STAGE_ROWS] = own[:STATES]
        return numbers

    @lazy_property
    def _known_stiffness(self) -> Callable[[tuple[float, float], tuple[float, float], float], float]:
        return lru_cache(maxsize=_BOXES)(self.stiffness)

    def simulate(
        self, times: Array, displacement: Array, setpoint: Array, start: float = 0.0, settles: bool = False
    ) -> Array:
        """
        Return what the pressure sensor reads at each sample, shape (n,) [Pa].

        Parameters
        ----------
        times, displacement, setpoint
            As in `Cylinder.simulate`.
        start
            What the pressures lie above the first set-point at the first sample [Pa].
        settles
            Whether it stands still before the first sample until the pressure has settled.

        """
        parameters = all_parameters(self.gains, self.effects)[None]
        stiffness = self.stiffness(*extremes(times, displacement, setpoint))
        alone = SideBySide(self, parameters, np.zeros(1), np.array([start]), float(times[0]), stiffness, settles)
        return alone.follow(times, displacement, setpoint)[:, 0]


def extremes(
    times: Array, displacement: Array, setpoint: Array
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return the extremes of the pressure [Pa] and the displacement [m] in a recording, and the highest speed [m/s]."""
    pressures = _MARGIN_BELOW * float(np.min(setpoint)), _MARGIN_ABOVE * float(np.max(setpoint))
    speed = float(np.max(np.abs(np.diff(displacement) / np.diff(times)), initial=0.0))
    return pressures, (float(np.min(displacement)), float(np.max(displacement))), speed


def _around(one: float, other: float, size: float) -> tuple[float, float]:
    """Return the next multiples of a size below and above two values."""
    return size * floor(min(one, other) / size), size * ceil(max(one, other) / size)


def _rows(numbers: Array) -> Array:
    return numbers.reshape(-1, COUNT)


class SideBySide:
    """
    What the sensors of cylinders with the same effects read along a recording that comes in pieces.

    All are moved alike and cut into the same steps, so that their difference is smooth in their parameters.

    Parameters
    ----------
    cylinder
        Says which effects are on.
    parameters
        Of each cylinder, in the order of `places.all_parameters`, shape (cylinders, parameters).
    offsets
        What each one's set-point lies above the common one, shape (cylinders,) [Pa].
    starts
        What each one's pressures lie above its first set-point at the first sample, shape (cylinders,) [Pa].
    begin
        When their recording began, which effects that follow time count from [s].
    stiffness
        Inverse of the fastest time constant, see `ExtendedCylinder.stiffness` [1/s].
    settles
        Whether they stand still before the first sample until the pressure has settled.

    """

    def __init__(
        self,
        cylinder: ExtendedCylinder,
        parameters: Array,
        offsets: Array,
        starts: Array,
        begin: float,
        stiffness: float,
        settles: bool = False,
    ) -> None:
        self._cylinder = cylinder
        self._parameters = parameters
        self._offsets = offsets
        self._starts = starts
        self._stiffness = stiffness
        self._settles = settles
        self._on = switches(cylinder.effects)
        self._groups: list[Array] = []
        self._begin = begin

    def follow(self, times: Array, displacement: Array, setpoint: Array, acceleration: Array | None = None) -> Array:
        """
        Return the readings at the samples of a piece, shape (n, cylinders) [Pa].

        The arguments are as in `Cylinder.simulate`, and the acceleration on the step to each sample, by default none
        [m/s^2]; a piece begins with the last sample of the one before.
        """
        if not self._groups:
            self._groups = [
                self._resting(first, displacement[0], setpoint[0]) for first in range(0, len(self._parameters), COUNT)
            ]
        readings = np.empty((times.size, len(self._parameters)))
        ambient = self._cylinder.ambient_pressure
        bent = np.zeros(times.size) if acceleration is None else acceleration

        def run(rank: int) -> None:
            own = readings[:, rank * COUNT : (rank + 1) * COUNT]
            numbers = self._groups[rank]
            propagate(
                times, displacement, bent, setpoint, self._begin, ambient, self._stiffness, numbers, self._on, own
            )

        map_in_threads(run, range(len(self._groups)))
        return readings

    def _resting(self, first: int, displacement: float, setpoint: float) -> Array:
        """Return the kernel's numbers with cylinders from one on in its lanes, before the first sample."""
        lanes = np.minimum(first + np.arange(COUNT), len(self._parameters) - 1)  # the last one fills what is left
        numbers = np.zeros(SIZE)
        rows = _rows(numbers)
        rows[PARAMETER_ROWS] = self._parameters[lanes].T
        rows[OFFSET_ROW] = self._offsets[lanes] + self._starts[lanes]
        rest(displacement, setpoint, numbers)
        rows[OFFSET_ROW] = self._offsets[lanes]
        if self._settles:
            cylinder = self._cylinder
            settle(setpoint, cylinder.settling, cylinder.ambient_pressure, self._stiffness, numbers, self._on)
        return numbers
