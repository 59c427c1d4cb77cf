# SPDX-License-Identifier: Apache-2.0
"""A pressure-regulated cylinder, simulated sample by sample or over a whole recording."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model.effects import PRESSURE_PARTS
from cfd_pneumatic.model.extended import ExtendedCylinder, ExtendedState, Movement, check_effects
from cfd_pneumatic.model.parameters import OperatingPoints
from cfd_pneumatic.model.propagation import CARRIED, SENSITIVITIES, advance, interpolate_gains, propagate

_SETPOINTS = 32  # of all cylinders: number of set-points for which cylinders with effects are cached


class Readings(NamedTuple):
    """Undelayed readings of the last samples, as far back as a transport delay reaches."""

    times: tuple[float, ...]
    """Times since the start [s]."""

    readings: tuple[float, ...]
    """Absolute pressures [Pa]."""

    def interpolate(self, time: float) -> float:
        """Interpolate the reading at a time [Pa]; before the first sample the first reading holds."""
        after = bisect_right(self.times, time)
        if after == 0:
            return self.readings[0]
        if after == len(self.times):
            return self.readings[-1]
        share = (time - self.times[after - 1]) / (self.times[after] - self.times[after - 1])
        return (1.0 - share) * self.readings[after - 1] + share * self.readings[after]

    def with_sample(self, time: float, reading: float) -> Readings:
        """Return the readings with another sample."""
        return Readings((*self.times, time), (*self.readings, reading))

    def needed_from(self, time: float) -> Readings:
        """Return the readings without samples that are not needed to interpolate from a time [s] on."""
        first = max(bisect_right(self.times, time) - 1, 0)
        return Readings(self.times[first:], self.readings[first:])


class Commands(NamedTuple):
    """Commanded set-points of the last samples, as far back as a set-point delay reaches."""

    begins: tuple[float, ...]
    """Times since the start from which each set-point was commanded [s]."""

    setpoints: tuple[float, ...]
    """Absolute set-points [Pa]."""

    def with_command(self, time: float, setpoint: float) -> Commands:
        """Return the commands with the set-point that is commanded from a time [s] on [Pa]."""
        if setpoint == self.setpoints[-1]:
            return self
        return Commands((*self.begins, time), (*self.setpoints, setpoint))

    def needed_from(self, time: float) -> Commands:
        """Return the commands without set-points that were replaced before a time [s]."""
        first = self._index(time)
        return Commands(self.begins[first:], self.setpoints[first:])

    def delayed(self, delay: float, movement: Movement) -> Iterator[tuple[Movement, float]]:
        """Yield the pieces of a movement at the commands of `delay` seconds before; the first command was always on."""
        time, end = movement.time - movement.duration, movement.time
        x, rate = movement.begin, movement.rate
        index = self._index(time - delay)
        while time < end:
            following = self.begins[index + 1] + delay if index + 1 < len(self.begins) else end
            until = min(following, end)
            until_x = movement.end if until == end else movement.begin + rate * (until - end + movement.duration)
            if until > time:
                yield Movement(until, until - time, x, until_x), self.setpoints[index]
            time, x, index = max(time, until), until_x, index + 1

    def _index(self, time: float) -> int:
        """Return the index of the set-point that was commanded at a time [s]."""
        return max(bisect_right(self.begins, time) - 1, 0)


class CylinderState(NamedTuple):
    """
    State of a cylinder.

    Attributes
    ----------
    p, p_f
        Outlet pressure and sensed pressure, absolute [Pa].
    extended
        State of the extended model, while an effect is on.
    track
        Undelayed readings, while the effect of a transport delay is on.
    delayed
        Delayed reading, while the effect of a transport delay is on [Pa].
    commands
        Commanded set-points, while the effect of a set-point delay is on.

    """

    p: float
    p_f: float
    extended: ExtendedState | None = None
    track: Readings | None = None
    delayed: float | None = None
    commands: Commands | None = None

    @classmethod
    def at_rest(cls, setpoint: float) -> CylinderState:
        """Return the equilibrium p = p_f = p_d at an absolute set-point [Pa]."""
        return cls(setpoint, setpoint)

    @property
    def is_finite(self) -> bool:
        """Whether all numbers are finite; strong effects can make the state diverge."""
        values = (self.p, self.p_f) if self.extended is None else (*self.extended.values, self.extended.reading)
        return all(map(math.isfinite, (*values, self.reading)))

    @property
    def reading(self) -> float:
        """The reading of the pressure sensor, absolute [Pa]: p, unless an effect changes the reading."""
        if self.delayed is not None:
            return self.delayed
        return self.p if self.extended is None else self.extended.reading


@dataclass(frozen=True)
class Cylinder:
    """
    A cylinder and its regulator: equations (8) and (12) with scheduled gains, and physical effects.

    The equations are solved exactly without effects, and by Runge-Kutta of fourth order with effects.

    Attributes
    ----------
    parameters
        Gains over the gauge set-point.
    ambient_pressure
        Zero of gauge set-points, absolute [Pa].
    effects
        Parameters of each effect that is on, by its name.
    setpoint_offset
        Difference between the regulated pressure at rest and the set-point [Pa].

    Raises
    ------
    ValueError
        If an effect is not an effect on the pressure, or has a wrong number of parameters.

    """

    parameters: OperatingPoints
    ambient_pressure: float
    effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    setpoint_offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the effects."""
        check_effects(self.effects, PRESSURE_PARTS, 'pressure')

    @lazy_property
    def _effects(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        return tuple((name, tuple(parameters)) for name, parameters in self.effects.items())

    @lazy_property
    def delay(self) -> float | None:
        """Delay of the reading by an effect [s], None without such an effect; a negative delay looks ahead."""
        return self._delay_of('reading')

    @lazy_property
    def setpoint_delay(self) -> float | None:
        """Delay of the set-point by an effect [s], None without such an effect."""
        return self._delay_of('setpoint')

    def _delay_of(self, signal: str) -> float | None:
        return next(
            (parameters[0] for name, parameters in self.effects.items() if PRESSURE_PARTS[name].late == signal), None
        )

    def at_rest(self, setpoint: float, x: float) -> CylinderState:
        """Return the equilibrium at an absolute set-point [Pa], the piston resting at a displacement [m]."""
        commands = None if self.setpoint_delay is None else Commands((-math.inf,), (setpoint,))
        setpoint += self.setpoint_offset
        state = CylinderState.at_rest(setpoint)
        if not self.effects:
            return state
        cylinder = self._cylinder_at(setpoint)
        begin = cylinder.begin(state.p, state.p_f, x)
        return state._replace(extended=replace(begin, reading=cylinder.read(begin, 0.0)), commands=commands)

    def step(self, state: CylinderState, movement: Movement, setpoint: float) -> CylinderState:
        """
        Return the state after a movement.

        Pressures are continuous; an effect that was not on in `state` starts at rest. A transport delay returns an
        earlier reading, linear between samples, and the first reading until the delay is over. A negative delay
        extrapolates the reading linearly from this step. A set-point delay splits the movement where an earlier
        set-point begins to act; before the first step of `state` the set-point was constant.

        Parameters
        ----------
        state
            State before the movement.
        movement
            Movement of the piston; +x grows the chamber.
        setpoint
            Absolute set-point during the movement [Pa].

        """
        if not self.effects:
            setpoint += self.setpoint_offset
            gains = self._gains_at(setpoint)
            return CylinderState(*advance(state.p, state.p_f, movement.duration, movement.rate, setpoint, *gains))
        began = movement.time - movement.duration
        commands, pieces = None, [(movement, setpoint)]
        if self.setpoint_delay is not None:
            commands = (state.commands or Commands((-math.inf,), (setpoint,))).with_command(began, setpoint)
            pieces = list(commands.delayed(self.setpoint_delay, movement))
            commands = commands.needed_from(movement.time - self.setpoint_delay)
        acting = pieces[0][1] + self.setpoint_offset
        cylinder = self._cylinder_at(acting)
        begin = end = cylinder.begin(state.p, state.p_f, movement.begin, state.extended, acting)
        for piece, level in pieces:
            acting = level + self.setpoint_offset
            end = self._cylinder_at(acting).step(end, piece, acting)
        after = CylinderState(end.p, end.p_f, end, commands=commands)
        if self.delay is None:
            return after
        return _with_delayed_reading(after, self.delay, movement, cylinder.read(begin, began), state.track)

    def _gains_at(self, setpoint: float) -> tuple[float, ...]:
        """Return the gains at an absolute set-point [Pa]."""
        gains: tuple[float, ...] = interpolate_gains(self.parameters.table, setpoint - self.ambient_pressure)
        return gains

    def _cylinder_at(self, setpoint: float) -> ExtendedCylinder:
        """Return the cylinder with effects and the gains at an absolute set-point [Pa]."""
        return _extended(self._gains_at(setpoint), self._effects, self.ambient_pressure)

    def simulate(self, times: Array, displacement: Array, setpoint: Array, state: CylinderState | None = None) -> Array:
        """
        Return the reading of the pressure sensor at each sample, shape (n,) [Pa].

        The result equals that of `step` sample by sample, to rounding.

        Parameters
        ----------
        times
            Increasing, shape (n,) [s].
        displacement
            Displacement that grows the chamber, linear between samples, shape (n,) [m].
        setpoint
            Absolute set-point, shape (n,) [Pa]; entry i acts on the step that ends at sample i.
        state
            State at the first sample; by default at rest at the first set-point.

        """
        start = state or self.at_rest(setpoint[0], displacement[0])
        if self.effects:
            return self._simulate_with_effects(times, displacement, setpoint, start)
        pressure = np.empty_like(times)
        propagate(
            times,
            displacement,
            setpoint + self.setpoint_offset,
            self.parameters.table,
            self.ambient_pressure,
            np.array([start.p, start.p_f]),
            pressure,
        )
        return pressure

    def _simulate_with_effects(self, times: Array, displacement: Array, setpoint: Array, state: CylinderState) -> Array:
        readings = np.empty_like(times)
        readings[0] = state.reading
        for i in range(1, times.size):
            movement = Movement(times[i] - times[0], times[i] - times[i - 1], displacement[i - 1], displacement[i])
            state = self.step(state, movement, setpoint[i])
            readings[i] = state.reading
        return readings


@lru_cache(maxsize=_SETPOINTS)
def _extended(
    gains: tuple[float, ...], effects: tuple[tuple[str, tuple[float, ...]], ...], ambient_pressure: float
) -> ExtendedCylinder:
    """Return a cylinder with effects at constant gains; cylinders of the last set-points are cached."""
    return ExtendedCylinder(gains, dict(effects), ambient_pressure)


def _with_delayed_reading(
    state: CylinderState, delay: float, movement: Movement, before: float, track: Readings | None
) -> CylinderState:
    """
    Return a state after a movement with the reading delayed by `delay` [s].

    The undelayed reading is `before` at the beginning of the movement [Pa]; `track` has earlier readings.
    """
    if delay < 0.0:
        slope = (state.reading - before) / movement.duration
        return state._replace(delayed=state.reading - delay * slope)
    past = track or Readings((movement.time - movement.duration,), (before,))
    past = past.with_sample(movement.time, state.reading)
    shown_time = movement.time - delay
    return state._replace(track=past.needed_from(shown_time), delayed=past.interpolate(shown_time))


class Course:
    """
    Outlet pressure and its derivatives along a recording that is simulated in pieces, at constant gains.

    Parameters
    ----------
    gains
        In the order of `SPECS`, shape (gains,) [SI].
    pressure
        Outlet and sensed pressure at the first sample [Pa].

    """

    def __init__(self, gains: Array, pressure: float) -> None:
        self._table = np.zeros((1, 1 + len(gains)))
        self._table[0, 1:] = gains
        self._state = np.array([pressure, pressure])
        self._carried = np.zeros((2, CARRIED))
        self._carried[:, -1] = 1.0

    def simulate_piece(
        self, times: Array, displacement: Array, setpoint: Array, *, slopes: bool = True
    ) -> tuple[Array, Array]:
        """
        Simulate a piece: return the pressure at its samples, shape (n,) [Pa], and derivatives, shape (n, 6) or (0, 6).

        Parameters
        ----------
        times, displacement, setpoint
            As in `Cylinder.simulate`; a piece begins with the last sample of the piece before.
        slopes
            Whether derivatives are computed, for this piece and later pieces.

        The columns are the derivatives by the gains, by a shift of the set-point, and by a shift of both pressures
        against the set-point at the first sample.
        """
        pressure = np.empty_like(times)
        jacobian = np.empty((times.size if slopes else 0, len(SENSITIVITIES)))
        derivatives = (self._carried, jacobian) if slopes else ()
        propagate(times, displacement, setpoint, self._table, 0.0, self._state, pressure, *derivatives)
        return pressure, jacobian
