# SPDX-License-Identifier: Apache-2.0
"""Between the rig and its sensors: lines that ring, sensors that lag or bend, the mains, a load cell's zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.rig.effects import Effects, Pickup
from cfd_pneumatic.rig.oddities import ForceOddities, Oddities
from cfd_pneumatic.rig.parameters import RigParameters
from cfd_pneumatic.rig.rig import Truth

_OF_A_LINE = ('resonance_frequency', 'resonance_damping', 'sensor_lag')
"""Effects that a line has a state for."""

_OF_A_PICKUP = ('displacement_lag', 'displacement_delay')
"""What a displacement sensor has a state for."""


class Response:
    """
    A linear response with unit gain, exact for an input that is straight between its values.

    Parameters
    ----------
    denominator
        Of its transfer function [s^2, s, 1] or [s, 1].
    rest
        Input and output so far.

    """

    def __init__(self, denominator: Sequence[float], rest: float) -> None:
        self._denominator = denominator
        self._rest = rest
        self._filter: tuple[Array, Array, Array] | None = None

    @classmethod
    def lag(cls, time_constant: float, rest: float) -> Response:
        """Return a first-order lag; its time constant in s."""
        return cls((time_constant, 1.0), rest)

    @classmethod
    def resonance(cls, frequency: float, damping: float, rest: float) -> Response:
        """Return a mass on a spring, here of air, by its natural frequency [Hz] and damping ratio."""
        omega = 2.0 * np.pi * frequency
        return cls((1.0 / omega**2, 2.0 * damping / omega, 1.0), rest)

    def to(self, inputs: Array, period: float) -> Array:
        """Return the outputs with the next inputs, which are one period [s] apart, the same each time."""
        from scipy.signal import cont2discrete, lfilter, lfilter_zi  # which take long to import

        if self._filter is None:
            numerator, denominator, _ = cont2discrete(([1.0], self._denominator), period, 'foh')
            self._filter = numerator[0], denominator, lfilter_zi(numerator[0], denominator) * self._rest
        numerator, denominator, state = self._filter
        outputs, state = lfilter(numerator, denominator, inputs, zi=state)
        self._filter = numerator, denominator, state
        return np.asarray(outputs)


class Delay:
    """
    A dead time.

    Parameters
    ----------
    dead_time
        By which the input comes late [s].
    rest
        Input so far.

    """

    def __init__(self, dead_time: float, rest: float) -> None:
        self._dead_time = dead_time
        self._past = np.array([rest])

    def to(self, inputs: Array, period: float) -> Array:
        """Return the outputs with the next inputs, which are one period [s] apart."""
        whole = int(self._dead_time / period)
        share = self._dead_time / period - whole
        missing = max(0, whole + 1 - len(self._past))
        known = np.concatenate([np.full(missing, self._past[0]), self._past, inputs])[-len(inputs) - whole - 1 :]
        self._past = known[len(inputs) :]
        late, later = known[1 : len(inputs) + 1], known[: len(inputs)]
        return np.asarray(late + share * (later - late))


def read_force(force: Array, pickup: Pickup, odd: ForceOddities) -> Array:
    """Return what the load cell makes of a force [N], without its noise."""
    borne = force + pickup.force_offset
    return np.asarray(borne * (1.0 - odd.bend * np.abs(borne)))


class Transmission:
    """
    The way from the rig to its sensors.

    Parameters
    ----------
    parameters
        The rig.
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
        """Become what other parameters make; what differs from before begins at rest where the rig is."""
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
        """Return what arrives at the sensors, at the next times, which are one period [s] apart."""
        arrived = truth
        for response in self._pickups:
            arrived = replace(arrived, displacement=response.to(arrived.displacement, period))
        if self._pickup.force_offset or self._odd_force.bend:
            arrived = replace(arrived, force=read_force(truth.force, self._pickup, self._odd_force))
        if (
            any(self._lines)
            or any(effects.hum for effects in self._effects)
            or any(odd.kink or odd.tilt for odd in self._odd)
        ):
            pressures = [self._arriving(cylinder, truth, period) for cylinder in (0, 1)]
            arrived = replace(arrived, pressures=np.column_stack(pressures))
        return arrived

    def _arriving(self, cylinder: int, truth: Truth, period: float) -> Array:
        pressure = self._read(cylinder, truth)
        for response in self._lines[cylinder]:
            pressure = response.to(pressure, period)
        effects = self._effects[cylinder]
        if not effects.hum:
            return pressure
        return pressure + effects.hum * np.sin(2.0 * np.pi * effects.hum_frequency * truth.times + effects.hum_phase)

    def _read(self, cylinder: int, truth: Truth) -> Array:
        """Return what a sensor that bends and tilts makes of the pressure [Pa]."""
        odd, pressure = self._odd[cylinder], truth.pressures[:, cylinder]
        if not (odd.kink or odd.tilt):
            return pressure
        above = np.maximum(pressure - self._ambient - odd.kink_pressure, 0.0)
        turns = (1.0, -1.0)[cylinder] * truth.displacement / odd.tilt_length
        return np.asarray(pressure + odd.kink * above + odd.tilt * np.sin(2.0 * np.pi * turns))


def _pickups(pickup: Pickup, rest: float) -> list[Response | Delay]:
    """Return the responses of a displacement sensor, which has read a position [m] at rest, one after the other."""
    responses: list[Response | Delay] = []
    if pickup.displacement_lag:
        responses.append(Response.lag(pickup.displacement_lag, rest))
    if pickup.displacement_delay:
        responses.append(Delay(pickup.displacement_delay, rest))
    return responses


def _line(effects: Effects, rest: float) -> list[Response]:
    """Return the responses of a line and its sensor, which has read a pressure [Pa] at rest, one after the other."""
    responses = []
    if effects.resonance_frequency:
        responses.append(Response.resonance(effects.resonance_frequency, effects.resonance_damping, rest))
    if effects.sensor_lag:
        responses.append(Response.lag(effects.sensor_lag, rest))
    return responses
