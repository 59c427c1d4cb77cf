# SPDX-License-Identifier: Apache-2.0
"""
The classes that describe an effect: its name, its parameters, and the functions that change the model.

Each module of this package that defines `EFFECT` is an effect; no other file lists effects. An effect changes the model
by functions with names from `FUNCTIONS`, compiled by `inlined`. The first argument of such a function is the value to
change, and the function returns the changed value. The further arguments are the `Moment`, the effect's `EFFECT.states`
states, and its parameters in their order.

The states of an effect follow a value, `EFFECT.follows`: the flow, the rate of the chamber, or the signal. The function
``evolve(moment, value, *states, *parameters)`` returns the rates of the states. An effect that follows the error or the
displacement is a backlash: the result of its function becomes its single state at the end of a step. States that follow
the set-point are exact at any step size: the function ``follow(elapsed, setpoint, *states, *parameters)`` returns the
states after any time [s] at a constant commanded set-point [Pa], at which the first state rests.

An effect may also have a function ``hold(moment, *parameters)``, for values that are constant between two samples, as
the set-point and the piston's speed are. The effect's other functions then take the result of ``hold``, `EFFECT.held`
numbers, in place of the parameters.

The functions are compiled for lanes (`model.lanes`), eight cylinders at once. They calculate with lanes as with
numbers, but must not branch on lanes: `where` chooses between values, and ``if some(...)`` skips what no lane needs.
`model.lanewise` has powers and other functions of lanes.

An effect on the contact force has the function ``force`` only, and is compiled for numbers. Its arguments are the force
without the effect, along +x [N], the `ForceMoment`, states and parameters. Its states follow the `motion`: the function
``slide(travel, *states, *parameters)`` returns the states after any straight travel [m].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from cfd_pneumatic.lazy import lazy_property

FUNCTIONS = {
    'displacement': 'displacement of a sample [m]; the chamber follows it in a straight line from the last sample',
    'setpoint': 'set-point p_d [Pa]',
    'error': 'valve error p_d - p_f [Pa]',
    'flow': "pressure rate of the valves' flow [Pa/s]",
    'density': "reference volume, at which the gains hold, / the chamber's volume [-]",
    'velocity_gain': 'K_x [Pa/m]',
    'chamber': 'rate of the outlet pressure [Pa/s]',
    'outlet': 'pressure that the aspirator tube senses [Pa]; a further argument after the moment is the flow [Pa/s]',
    'time_constant': 'tau [s]',
    'signal': 'pressure that the sensor reads [Pa]',
    'force': 'contact force [N]',
}
"""Values that an effect may change, by the name of the function that changes the value."""

DELAYS = 'delay / lag / regulator bandwidth'
OFFSETS = 'leakage / droop / set-point offset'
STIFFNESS = 'dead volume / polytropic exponent'
PLAYS = 'dead band / hysteresis / lost motion'
FRICTIONS = 'friction'
LOADS = 'weight / offset of the force sensor'
"""Families of effects that a recording may not distinguish."""


class Moment(NamedTuple):
    """Present state of the cylinder, as an argument of an effect's functions."""

    time: float
    """Time since the start [s]."""

    x: float
    """Displacement that grows the chamber [m]."""

    rate: float
    """Speed of the displacement [m/s]."""

    p: float
    """Outlet pressure, absolute [Pa]."""

    setpoint: float
    """Set-point p_d before any effect, absolute [Pa]."""

    ambient: float
    """Ambient pressure [Pa]."""

    swept: float = 0.0
    """Pressure rate of the piston's motion, K_x times the speed [Pa/s]; zero for functions that change K_x or x."""

    k_x: float = 0.0
    """K_x of the model before any effect [Pa/m]."""

    p_f: float = 0.0
    """Sensed pressure, absolute [Pa]."""

    sensing: float = 0.0
    """Rate of the sensed pressure, equation (8) [Pa/s]; only for functions that change the chamber's rate."""

    dense: float = 1.0
    """Reference volume, at which the gains hold, / the chamber's volume: factor of the flow's pressure rate [-]."""


class ForceMoment(NamedTuple):
    """Present state of the device, as an argument of the functions of an effect on the force."""

    time: float
    """Time since the start [s]."""

    x: float
    """Displacement of the piston; +x grows cylinder A [m]."""

    rate: float
    """Speed of the piston [m/s]."""

    acceleration: float
    """Acceleration of the piston [m/s^2]."""

    p: float
    """Pressure in cylinder A, absolute [Pa]."""

    opposing: float
    """Pressure in cylinder B, or ambient pressure without a cylinder B, absolute [Pa]."""

    ambient: float
    """Ambient pressure [Pa]."""


@dataclass(frozen=True)
class EffectParameter:
    """
    A parameter of an effect.

    Attributes
    ----------
    name, unit, description
        Name, SI unit and meaning.
    lower, upper
        Bounds of the search [unit].
    null
        Value at which the effect is absent, or a placeholder while another parameter makes the effect absent [unit].
    logarithmic
        Whether the search varies the logarithm of the parameter.
    choice
        Whether the parameter keeps its starting values and is not searched.
    of_pressure
        Whether the parameter is a dependence on pressure; recordings at one pressure do not identify it and keep null.
    is_supply
        Whether the parameter is the supply pressure; a search does not go below the recorded pressures.
    on_stroke
        `place` for a place on the stroke, `length` for a length of the stroke; a search stays in the recorded stroke.
    least
        Lower bound of the search, if it is not `lower` [unit].
    spread
        Standard deviation of the parameter between devices about `null` [unit; without a unit if logarithmic].

    """

    name: str
    unit: str
    lower: float
    upper: float
    null: float
    description: str
    logarithmic: bool = False
    choice: bool = False
    of_pressure: bool = False
    is_supply: bool = False
    on_stroke: Literal['', 'place', 'length'] = ''
    least: float | None = None
    spread: float = math.inf


Data = Mapping[str, float]
"""Properties of the recordings, for starting values; see `data` of the channels in `identification.channels`."""


@dataclass(frozen=True)
class Effect:
    """
    A physical effect that the paper's model lacks.

    Attributes
    ----------
    name
        Standard name, as in parameter files.
    description
        Meaning, in one line.
    inspect
        What to inspect on the machine if the effect is found.
    parameters
        Parameters in the order of the functions' arguments.
    states
        Number of states.
    held
        Number of results of the function `hold`, which other functions take in place of the parameters.
    follows
        Value that the states follow: `flow`, `chamber`, `signal` or `setpoint`; `error` or `displacement` for a
        backlash; `motion` for an effect on the force.
    rests_at_pressure
        Whether the first state rests at the set-point, and not at zero.
    moves_rest
        Whether the cylinder rests at a pressure that differs from the set-point and has to settle first.
    rests_anywhere
        Whether the cylinder may rest at any pressure near the set-point, so that the first pressure has to be fitted.
    late
        Signal that lags by the only parameter [s], `reading`, `displacement` or `setpoint`; recordings are shifted in
        time.
    looks_ahead
        Whether the displacement is extrapolated by the first parameter [s], which adds noise of the speed.
    quickens
        Returns how many times faster than the gains the cylinder may be, from an absolute pressure [Pa], a
        displacement [m], K_x [Pa/m] and the parameters.
    fastest
        Returns the inverse of the fastest time constant [1/s], from a speed [m/s] and the parameters; None without.
    of_time
        Whether the effect depends on time only; the length of a recording determines how well it is identified.
    constant
        Whether the effect is constant in time, as a wrong scale is at one pressure.
    as_constant
        Returns the parameters of the weakest form of the effect that may cause a given constant; None without.
    core
        Whether the effect is a core, with which a search begins.
    generic
        Whether the effect is a curve that is estimated if no known effect explains the data.
    covers
        Effects that a core includes.
    rank
        Order among effects that change the same value; a lower rank comes first.
    shown_by
        What to record so that the effect is visible, for people.
    shown_at
        Lowest sampling rate at which the effect is visible [Hz].
    equations
        Change of the model, lines of LaTeX with the parameters' names.
    seen_against
        Variable against which the residual of a model without the effect shows it: `time`, `frequency`,
        `displacement`, `speed`, `acceleration`, `pressure`, `pressure rate` or `valve error`.
    families
        Families of effects that a recording may not distinguish from this effect.
    starts
        Returns starting points of a search from properties of the data, each with a value for every parameter; none
        for a curve, which the search proposes itself.

    """

    name: str
    description: str
    parameters: tuple[EffectParameter, ...]
    inspect: str = ''
    starts: Callable[[Data], list[tuple[float, ...]]] = field(default=lambda data: [], repr=False)
    equations: tuple[str, ...] = field(default=(), repr=False)
    seen_against: str = 'time'
    families: tuple[str, ...] = ()
    shown_by: str = ''
    shown_at: float = 0.0
    states: int = 0
    held: int = 0
    follows: str = ''
    rests_at_pressure: bool = False
    moves_rest: bool = False
    rests_anywhere: bool = False
    late: Literal['', 'reading', 'displacement', 'setpoint'] = ''
    looks_ahead: bool = False
    quickens: Callable[..., float] | None = field(default=None, repr=False)
    fastest: Callable[..., float] | None = field(default=None, repr=False)
    of_time: bool = False
    constant: bool = False
    as_constant: Callable[[float], tuple[float, ...]] | None = field(default=None, repr=False)
    core: bool = False
    generic: bool = False
    covers: tuple[str, ...] = ()
    rank: int = 50

    @property
    def advice(self) -> str:
        """What to record so that the effect is visible, and how often to sample, for people."""
        return f'{self.shown_by}, sampled at {self.shown_at:g} Hz or more' if self.shown_at else self.shown_by

    @property
    def is_of_command(self) -> bool:
        """Whether the effect changes when a commanded set-point acts; only steps of recorded set-points show it."""
        return 'setpoint' in (self.late, self.follows)

    @lazy_property
    def null(self) -> tuple[float, ...]:
        """Parameter values at which the effect is absent."""
        return tuple(parameter.null for parameter in self.parameters)

    @property
    def strengths(self) -> tuple[int, ...]:
        """Indices of the parameters that scale the effect: the first, and all with the same unit and null."""
        first = self.parameters[0]
        return tuple(
            index
            for index, parameter in enumerate(self.parameters)
            if (parameter.unit, parameter.null) == (first.unit, first.null)
        )

    def ends_at_bound(self, values: Sequence[float]) -> bool:
        """Return whether a searched parameter is at a bound at which the effect is present."""
        return any(
            value != parameter.null
            and not parameter.choice
            and any(math.isclose(value, bound) for bound in (parameter.lower, parameter.upper))
            for parameter, value in zip(self.parameters, values)
        )

    def of_strength(self, parameters: Sequence[float], share: float) -> tuple[float, ...]:
        """
        Return the parameters of an effect that is weaker by a factor, `share`.

        The distance of a strength from its null is multiplied by the share. A limit, a parameter with its upper bound
        as null, is divided by the share.
        """
        weaker = list(parameters)
        for index in self.strengths:
            parameter, value = self.parameters[index], parameters[index]
            if value == parameter.null:
                continue
            if parameter.null == parameter.upper:
                weaker[index] = min(value / share, parameter.null)
            else:
                weaker[index] = parameter.null + share * (value - parameter.null)
        return tuple(weaker)
