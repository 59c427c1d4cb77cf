# SPDX-License-Identifier: Apache-2.0
"""Signal paths from the rig to its sensors: resonant lines, lags, nonlinear sensors, mains hum, force offset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.effects import Effects, Pickup
from cfd_pneumatic.rig.oddities import ForceOddities, Oddities
from cfd_pneumatic.rig.parameters import RigParameters
from cfd_pneumatic.rig.responses import Delay, Response
from cfd_pneumatic.rig.rig import Truth

_OF_A_LINE = ('resonance_frequency', 'resonance_damping', 'sensor_lag')
"""Effects that give a line a state."""

_OF_A_PICKUP = ('displacement_lag', 'displacement_delay')
"""Faults that give a displacement sensor a state."""


def read_force(force: Array, pickup: Pickup, odd: ForceOddities) -> Array:
    """Return the reading of the load cell at a force, without noise [N]."""
    load = force + pickup.force_offset
    return np.asarray(load * (1.0 - odd.bend * np.abs(load)))


class Transmission:
    """
    The signal paths from the rig to its sensors.

    Parameters
    ----------
    parameters
        Parameters of the rig.
    pressures : (2,)
        Absolute pressures at rest [Pa].
    position
        Position at rest [m].

    """

    def __init__(self, parameters: RigParameters, pressures: Array, position: float) -> None:
        self._effects = (Effects(), Effects())
        self._lines: list[list[Response]] = [[], []]
        self._odd = (Oddities(), Oddities())
        self._odd_force = ForceOddities()
        self._ambient = parameters.air.ambient_pressure
        self._pickup = Pickup()
        self._pickups: list[Response | Delay] = []
        self.change(parameters, pressures, position)

    def change(self, parameters: RigParameters, pressures: Array, position: float) -> None:
        """Change the parameters; changed lines and sensors start at rest in the rig's present state."""
        changed = (parameters.effects_a, parameters.effects_b)
        for cylinder, (before, effects) in enumerate(zip(self._effects, changed)):
            if any(getattr(before, name) != getattr(effects, name) for name in _OF_A_LINE):
                self._lines[cylinder] = _line(effects, float(pressures[cylinder]))
        self._effects = changed
        self._odd, self._odd_force = (parameters.odd_a, parameters.odd_b), parameters.odd_force
        pickup = parameters.pickup
        if any(getattr(self._pickup, name) != getattr(pickup, name) for name in _OF_A_PICKUP):
            self._pickups = _pickups(pickup, position)
        self._pickup = pickup

    def carry(self, truth: Truth, period: float) -> Truth:
        """Return the signals at the sensors at the next times, one period apart [s]."""
        at_sensors = truth
        for response in self._pickups:
            at_sensors = replace(at_sensors, displacement=response.respond(at_sensors.displacement, period))
        if self._pickup.force_offset or self._odd_force.bend:
            at_sensors = replace(at_sensors, force=read_force(truth.force, self._pickup, self._odd_force))
        if (
            any(self._lines)
            or any(effects.hum for effects in self._effects)
            or any(odd.kink or odd.tilt for odd in self._odd)
        ):
            pressures = [self._pressure_at_sensor(cylinder, truth, period) for cylinder in (0, 1)]
            at_sensors = replace(at_sensors, pressures=np.column_stack(pressures))
        return at_sensors

    def _pressure_at_sensor(self, cylinder: int, truth: Truth, period: float) -> Array:
        pressure = self._with_sensor_errors(cylinder, truth)
        for response in self._lines[cylinder]:
            pressure = response.respond(pressure, period)
        effects = self._effects[cylinder]
        if not effects.hum:
            return pressure
        return pressure + effects.hum * np.sin(2.0 * np.pi * effects.hum_frequency * truth.times + effects.hum_phase)

    def _with_sensor_errors(self, cylinder: int, truth: Truth) -> Array:
        """Return the pressure with the errors of a nonlinear sensor [Pa]."""
        odd, pressure = self._odd[cylinder], truth.pressures[:, cylinder]
        if not (odd.kink or odd.tilt):
            return pressure
        above = np.maximum(pressure - self._ambient - odd.kink_pressure, 0.0)
        turns = (1.0, -1.0)[cylinder] * truth.displacement / odd.tilt_length
        return np.asarray(pressure + odd.kink * above + odd.tilt * np.sin(2.0 * np.pi * turns))


def _pickups(pickup: Pickup, rest: float) -> list[Response | Delay]:
    """Return the responses of a displacement sensor in series, at rest at a position [m]."""
    responses: list[Response | Delay] = []
    if pickup.displacement_lag:
        responses.append(Response.lag(pickup.displacement_lag, rest))
    if pickup.displacement_delay:
        responses.append(Delay(pickup.displacement_delay, rest))
    return responses


def _line(effects: Effects, rest: float) -> list[Response]:
    """Return the responses of a line and its sensor in series, at rest at a pressure [Pa]."""
    responses = []
    if effects.resonance_frequency:
        responses.append(Response.resonance(effects.resonance_frequency, effects.resonance_damping, rest))
    if effects.sensor_lag:
        responses.append(Response.lag(effects.sensor_lag, rest))
    return responses
