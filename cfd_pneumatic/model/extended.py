# SPDX-License-Identifier: Apache-2.0
"""A cylinder with physical effects in addition to the paper's equations, at constant gains."""

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
    START_ROW,
    STATE_ROWS,
    propagate,
    read_sensor,
    set_to_rest,
    settle,
    start_motion,
    step,
)
from cfd_pneumatic.model.effects import MODULES, PRESSURE_PARTS, Effect
from cfd_pneumatic.model.gain_starts import charging_time, quickest
from cfd_pneumatic.model.lanes import COUNT
from cfd_pneumatic.model.places import FOLLOWED, MEASURED, PLACES, STATES, all_parameters, switches
from cfd_pneumatic.runtime import map_in_threads

STAGE_ROWS = slice(S0 // COUNT, S0 // COUNT + STATES)
"""Rows of the states that effects read. States without a rate must be written here before the first step."""

_SETTLED = 8.0  # time constants: the remaining error is a third of a thousandth
_MARGIN_BELOW, _MARGIN_ABOVE = 0.8, 1.2  # times the set-points: assumed range of the pressures
_LONGEST_SETTLING = 2.0  # [s]
# a step of `ExtendedCylinder` computes its stiffness for a box of such sizes, so that a cached stiffness can be used
_PRESSURE_STEP, _DISPLACEMENT_STEP, _SPEED_STEP = 1e4, 1e-3, 0.1  # [Pa, m, m/s]
_LOWEST, _HIGHEST = 1e4, 1e8  # range of pressures at which the stiffness is computed [Pa]
_BOXES = 64

SLOWEST_CUT = 1.5
"""Longest step, in fastest time constants [-]."""

MOVING = frozenset(name for name in PRESSURE_PARTS if hasattr(MODULES[name], 'displacement'))
"""Effects that change the displacement that the chamber follows."""


def check_effects(effects: Mapping[str, Sequence[float]], known: Mapping[str, Effect], kind: str) -> None:
    """
    Check that effects are known and have the right number of parameters.

    Raises
    ------
    ValueError
        If an effect is unknown or its number of parameters is wrong. The message names `kind`, what effects act on.

    """
    for name, parameters in effects.items():
        if name not in known:
            raise ValueError(f'{name} is not an effect on the {kind}; the effects are: {", ".join(known)}')
        expected = len(known[name].parameters)
        if len(parameters) != expected:
            raise ValueError(f'{name} has {len(parameters)} parameters; expected {expected}')


class Movement(NamedTuple):
    """Movement of the piston over a step, in a straight line."""

    time: float
    """Time at the end of the step, since the start [s]."""

    duration: float
    """Duration of the step [s]."""

    begin: float
    """Displacement at the beginning [m]."""

    end: float
    """Displacement at the end [m]."""

    @property
    def rate(self) -> float:
        """Speed [m/s]."""
        return (self.end - self.begin) / self.duration

    def along(self, direction: float) -> Movement:
        """Return the movement with the displacement counted in a direction, 1 or -1."""
        return Movement(self.time, self.duration, direction * self.begin, direction * self.end)


@dataclass(frozen=True)
class ExtendedState:
    """
    State of a cylinder with effects.

    Attributes
    ----------
    effects
        Names of the effects that are on.
    values
        States in the composed kernel's order: pressures [Pa], those of the effects, displacements [m].
    reading
        Reading of the pressure sensor [Pa].

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

    Delays of the reading and of the set-point are not simulated here: the caller shifts readings and set-points.

    Attributes
    ----------
    gains
        In the order of `SPECS` [SI].
    effects
        Parameters of each effect that is on, by its name.
    ambient_pressure
        Absolute pressure [Pa].

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
            Extremes in the recording [Pa, m].
        speed
            Highest speed [m/s].

        """
        of_gains, of_effects = quickest(self.gains), [0.0]
        for name, parameters in self.effects.items():
            effect, factor = PRESSURE_PARTS[name], 1.0
            if effect.quickens is not None:
                k_x = float(self.gains[0])
                factor = max(1.0, *(effect.quickens(p, x, k_x, *parameters) for p in pressures for x in displacements))
            of_gains *= factor
            if effect.fastest is not None:
                of_effects.append(factor * effect.fastest(speed, *parameters))
        return max(of_gains, *of_effects) / SLOWEST_CUT

    @property
    def settling(self) -> float:
        """Time in which a charging regulator settles at a rest below the set-point [s]."""
        return min(_SETTLED * charging_time(self.gains), _LONGEST_SETTLING)

    def begin(
        self, p: float, p_f: float, x: float, before: ExtendedState | None = None, setpoint: float | None = None
    ) -> ExtendedState:
        """
        Return the state before a step.

        Parameters
        ----------
        p, p_f
            Pressures [Pa].
        x
            Displacement that grows the chamber [m].
        before
            Last state, maybe with different effects: effects that stay on continue from it; new effects start at rest.
        setpoint
            Absolute set-point at which new effects rest [Pa]; by default `p`.

        """
        effects = frozenset(self.effects)
        if before is not None and before.effects == effects:
            return before
        numbers = self._numbers()
        set_to_rest(x, p, numbers)
        values = _rows(numbers)[STATE_ROWS, 0].copy()
        values[1] = p_f
        for name in effects:
            if PRESSURE_PARTS[name].follows == 'setpoint':
                values[PLACES[name].states.start] = p if setpoint is None else setpoint
        if before is not None:
            for name in effects & before.effects:
                states = PLACES[name].states
                values[states] = before.values[states]
        if before is not None and effects & MOVING == before.effects & MOVING:
            for index in (FOLLOWED, MEASURED):
                values[index] = before.values[index]
        else:  # the chamber rests at the displacement that the effects give for a piston at rest
            numbers = self._numbers(values)
            start_motion(0.0, x, 1.0, self.ambient_pressure, numbers, self._on)
            values = _rows(numbers)[STATE_ROWS, 0]
        return ExtendedState(effects, tuple(values.tolist()), p)

    def step(self, state: ExtendedState, movement: Movement, setpoint: float) -> ExtendedState:
        """Return the state after a movement at an absolute set-point [Pa]."""
        numbers = self._numbers(state.values)
        # a diverged pressure may be NaN
        p, limited_setpoint = (min(max(_LOWEST, pressure), _HIGHEST) for pressure in (state.p, setpoint))
        stiffness = self._known_stiffness(
            _around(p, limited_setpoint, _PRESSURE_STEP),
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
        """Return the reading of the pressure sensor in a state [Pa], at a time since the start [s]."""
        numbers = self._numbers(state.values)
        read_sensor(time, self.ambient_pressure, numbers, self._on)
        return float(_rows(numbers)[SIGNAL_ROW, 0])

    @lazy_property
    def _on(self) -> int:
        return switches(self.effects)

    @lazy_property
    def _blank(self) -> Array:
        """The kernel's numbers with this cylinder in every lane and all states zero."""
        numbers = np.zeros(SIZE)
        _rows(numbers)[PARAMETER_ROWS] = all_parameters(self.gains, self.effects)[:, None]
        return numbers

    def _numbers(self, values: Sequence[float] | Array | None = None) -> Array:
        """Return the kernel's numbers with this cylinder in every lane, in the state `values`."""
        numbers = self._blank.copy()
        if values is not None:
            rows, states = _rows(numbers), np.asarray(values)[:, None]
            rows[STATE_ROWS] = states
            rows[STAGE_ROWS] = states[:STATES]
        return numbers

    @lazy_property
    def _known_stiffness(self) -> Callable[[tuple[float, float], tuple[float, float], float], float]:
        return lru_cache(maxsize=_BOXES)(self.stiffness)

    def simulate(
        self, times: Array, displacement: Array, setpoint: Array, start: float = 0.0, settles: bool = False
    ) -> Array:
        """
        Return the reading of the pressure sensor at each sample, shape (n,) [Pa].

        Parameters
        ----------
        times, displacement, setpoint
            As in `Cylinder.simulate`.
        start
            Difference of the pressures and the set-point at the first sample [Pa].
        settles
            Whether the cylinder rests before the first sample until the pressure has settled.

        """
        parameters = all_parameters(self.gains, self.effects)[None]
        stiffness = self.stiffness(*extremes(times, displacement, setpoint))
        cylinder = SideBySide(self, parameters, np.zeros(1), np.array([start]), float(times[0]), stiffness, settles)
        return cylinder.simulate_piece(times, displacement, setpoint)[:, 0]


def extremes(
    times: Array, displacement: Array, setpoint: Array
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return the extremes of the pressure [Pa] and the displacement [m] in a recording, and the highest speed [m/s]."""
    pressures = _MARGIN_BELOW * float(np.min(setpoint)), _MARGIN_ABOVE * float(np.max(setpoint))
    speed = float(np.max(np.abs(np.diff(displacement) / np.diff(times)), initial=0.0))
    return pressures, (float(np.min(displacement)), float(np.max(displacement))), speed


def _around(first: float, second: float, size: float) -> tuple[float, float]:
    """Return the next multiples of a size below and above two values."""
    return size * floor(min(first, second) / size), size * ceil(max(first, second) / size)


def _rows(numbers: Array) -> Array:
    return numbers.reshape(-1, COUNT)


class SideBySide:
    """
    Readings of cylinders with the same effects along a recording that is simulated in pieces.

    All cylinders have the same motion and the same steps, so that their differences are smooth in the parameters.

    Parameters
    ----------
    cylinder
        Cylinder with the effects that are on.
    parameters
        Parameters of each cylinder, in the order of `places.all_parameters`, shape (cylinders, parameters).
    offsets
        Difference of each cylinder's set-point and the common set-point, shape (cylinders,) [Pa].
    starts
        Difference of each cylinder's pressures and its set-point at the first sample, shape (cylinders,) [Pa].
    begin
        Time at which the recording began; effects of time count from it [s].
    stiffness
        Inverse of the fastest time constant, see `ExtendedCylinder.stiffness` [1/s].
    settles
        Whether the cylinders rest before the first sample until the pressure has settled.

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

    def simulate_piece(
        self, times: Array, displacement: Array, setpoint: Array, acceleration: Array | None = None
    ) -> Array:
        """
        Return the readings at the samples of a piece, shape (n, cylinders) [Pa].

        Times, displacement and set-point are as in `Cylinder.simulate`. The acceleration is that on the step to each
        sample [m/s^2], by default zero. A piece begins with the last sample of the piece before.
        """
        if not self._groups:
            self._groups = [
                self._numbers_at_rest(first, displacement[0], setpoint[0])
                for first in range(0, len(self._parameters), COUNT)
            ]
        readings = np.empty((times.size, len(self._parameters)))
        ambient = self._cylinder.ambient_pressure
        accelerations = np.zeros(times.size) if acceleration is None else acceleration

        def simulate_group(rank: int) -> None:
            group_readings = readings[:, rank * COUNT : (rank + 1) * COUNT]
            numbers = self._groups[rank]
            propagate(
                times,
                displacement,
                accelerations,
                setpoint,
                self._begin,
                ambient,
                self._stiffness,
                numbers,
                self._on,
                group_readings,
            )

        map_in_threads(simulate_group, range(len(self._groups)))
        return readings

    def _numbers_at_rest(self, first: int, displacement: float, setpoint: float) -> Array:
        """Return the kernel's numbers before the first sample, with the cylinders from `first` on in the lanes."""
        lanes = np.minimum(first + np.arange(COUNT), len(self._parameters) - 1)  # the last cylinder fills unused lanes
        numbers = np.zeros(SIZE)
        rows = _rows(numbers)
        rows[PARAMETER_ROWS] = self._parameters[lanes].T
        rows[OFFSET_ROW], rows[START_ROW] = self._offsets[lanes], self._starts[lanes]
        set_to_rest(displacement, setpoint, numbers)
        if self._settles:
            cylinder = self._cylinder
            settle(setpoint, cylinder.settling, cylinder.ambient_pressure, self._stiffness, numbers, self._on)
        return numbers
