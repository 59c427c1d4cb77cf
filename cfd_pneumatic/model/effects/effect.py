# SPDX-License-Identifier: Apache-2.0
"""
What an effect is: a small file that says its name, its parameters and where it enters the model.

A module of this package that defines `EFFECT` is an effect; nothing else has to know of it. It enters the model through
functions with names from `FUNCTIONS`, compiled by `inlined`. Each takes the value that it changes and returns the
changed one; then come the `Moment`, the effect's own states (`EFFECT.states` of them) and its own parameters, in their
order.

An effect with states says what they follow (`EFFECT.follows`): the flow, the rate of the chamber, or the signal; and it
gives their rates, ``evolve(moment, value, *states, *parameters)``. One that follows the error or the displacement is a
play: its single state becomes what its function returns, at the end of a step.

Where much stays the same from one sample to the next, as the set-point and the piston's speed do, an effect may give
``hold(moment, *parameters)``, too. Its other functions then take what that returns (`EFFECT.held` numbers) and not the
parameters.

The functions are compiled for lanes (`model.lanes`), eight cylinders at once: they calculate with them as with numbers,
but do not branch on them. `where` chooses instead, `some` tells what no lane needs, and `model.lanewise` has powers and
other functions of lanes.

An effect on the contact force has the function ``force`` and no other of these, and is compiled for numbers. It takes
the force that the tool would feel without it [N], along +x, then the `ForceMoment`, states and parameters. Its states
follow the `motion`: they become what ``slide(travel, *states, *parameters)`` returns after `travel` metres straight on,
however many these are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from cfd_pneumatic.lazy import lazy_property

FUNCTIONS = {
    'displacement': 'displacement of a sample [m], which the chamber follows in a straight line from the last one',
    'setpoint': 'set-point p_d [Pa]',
    'error': 'valve error p_d - p_f [Pa]',
    'flow': "pressure rate that the valve's flow makes [Pa/s]",
    'density': "the chamber's volume where the gains hold over its own [-]",
    'velocity_gain': 'K_x [Pa/m]',
    'chamber': 'rate of the outlet pressure [Pa/s]',
    'outlet': 'pressure that the aspirator tube senses [Pa]; a last argument is the flow [Pa/s]',
    'time_constant': 'tau [s]',
    'signal': 'pressure that the sensor reads [Pa]',
    'force': 'contact force [N]',
}
"""What an effect may change, by the name of the function that does."""

DELAYS = 'delay / lag / regulator bandwidth'
OFFSETS = 'leakage / droop / set-point offset'
STIFFNESS = 'dead volume / polytropic exponent'
PLAYS = 'dead band / hysteresis / lost motion'
FRICTIONS = 'friction'
LOADS = 'weight / offset of the force sensor'
"""Families, within which a recording may not tell one effect from another."""


class Moment(NamedTuple):
    """Where the cylinder is: what an effect's function may look at."""

    time: float
    """Since the start [s]."""

    x: float
    """Displacement that grows the chamber [m]."""

    rate: float
    """Speed at which it does [m/s]."""

    p: float
    """Outlet pressure, absolute [Pa]."""

    setpoint: float
    """Set-point p_d as it was given, absolute [Pa]."""

    ambient: float
    """Ambient pressure [Pa]."""

    swept: float = 0.0
    """Pressure rate that the piston's motion takes, K_x times its speed [Pa/s]; not for what changes either of them."""

    k_x: float = 0.0
    """K_x as the model has it, before any effect [Pa/m]."""

    p_f: float = 0.0
    """Sensed pressure, absolute [Pa]."""

    sensing: float = 0.0
    """Rate of the sensed pressure, equation (8) [Pa/s]; for what changes the chamber's alone."""

    dense: float = 1.0
    """The chamber's volume where the gains hold over its own: so much more does air change its pressure [-]."""


class ForceMoment(NamedTuple):
    """Where the piston is: what the function of an effect on the force may look at."""

    time: float
    """Since the start [s]."""

    x: float
    """Displacement; +x grows cylinder A [m]."""

    rate: float
    """Speed [m/s]."""

    acceleration: float
    """Acceleration [m/s^2]."""

    p: float
    """Pressure in cylinder A, absolute [Pa]."""

    opposing: float
    """Pressure in cylinder B, or ambient where there is none, absolute [Pa]."""

    ambient: float
    """Ambient pressure [Pa]."""


@dataclass(frozen=True)
class EffectParameter:
    """
    One parameter of an effect.

    Attributes
    ----------
    name, unit, description
        What it is.
    lower, upper
        Bounds of its search [unit].
    null
        Value at which the model is the baseline, or what stands for it while another parameter makes it so [unit].
    logarithmic
        Whether it is searched in its logarithm.
    choice
        Whether its starting values are all there is: it is not searched.
    of_pressure
        Whether it is a dependence on pressure, which recordings at one pressure don't tell: there it stays null.
    is_supply
        Whether it is the pressure that the cylinder is fed from: no search goes below what was recorded.
    on_stroke
        Whether it is a `place` on the stroke or a `length` of it: no search leaves what was recorded.
    least
        What no search goes below, where that is not `lower` [unit].
    spread
        By how much devices are known to differ from `null`: a standard deviation [unit; none where it is searched in
        its logarithm].

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
"""What starting values are drawn from: see `data` of the channels in `identification.channels`."""


@dataclass(frozen=True)
class Effect:
    """
    A physical effect that the paper's model lacks.

    Attributes
    ----------
    name
        Standard name, as in parameter files.
    description
        One line.
    parameters
        In the order in which its functions take them.
    states
        Number of states of its own.
    held
        How many numbers its function `hold` returns, once for each sample: its other functions take them, and not its
        parameters.
    follows
        What its states follow: `flow`, `chamber`, `signal`, or for a play `error` or `displacement`; for an effect on
        the force `motion`.
    rests_at_pressure
        Whether its first state rests at the set-point, and not at zero.
    moves_rest
        Whether the cylinder rests off the set-point, at a pressure of its own, so that it has to settle first.
    rests_anywhere
        Whether the cylinder may rest off the set-point, so that its first pressure has to be fitted.
    late
        What comes late by its one parameter [s], `reading` or `displacement`: recordings are looked up at another time.
    looks_ahead
        Whether the displacement runs ahead by its first parameter [s], at its rate: that rate's noise comes with it.
    quickens
        Returns how many times faster than the gains say the cylinder may be, from an absolute pressure [Pa], a
        displacement [m], K_x [Pa/m] and its parameters.
    fastest
        Returns the inverse of its fastest time constant [1/s], where it has one, from a speed [m/s] and its
        parameters.
    of_time
        Whether it is one of the time alone: how long a recording is tells it, whatever is done in it.
    constant
        Whether it does the same all the time, as a wrong scale does at one pressure.
    as_constant
        Returns the parameters of its weakest form that may make a given constant, where it has one.
    core
        Whether it is a core: what a search begins with, and not what it looks for.
    generic
        Whether it is drawn from data where no effect that is known explains them.
    covers
        Of a core, effects that are in it.
    rank
        Among effects that change the same value the lower comes first.
    shown_by
        What to record to see it, for people.
    shown_at
        How often to sample to see it, at least [Hz].
    equations
        What it does to the model, lines of LaTeX; its parameters stand there by their names.
    seen_against
        Beside what the residual of a model without it shows it: `time`, `frequency`, `displacement`, `speed`,
        `acceleration`, `pressure`, `pressure rate` or `valve error`.
    families
        Those within which it may be taken for another effect.
    starts
        Returns starting points of a search from what is known of the data, each with a value for every parameter; none
        of what a search draws itself.

    """

    name: str
    description: str
    parameters: tuple[EffectParameter, ...]
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
    late: Literal['', 'reading', 'displacement'] = ''
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
        """What to record to see it, and how often to sample, for people."""
        return f'{self.shown_by}, sampled at {self.shown_at:g} Hz or more' if self.shown_at else self.shown_by

    @lazy_property
    def null(self) -> tuple[float, ...]:
        """Parameter values at which the model is the baseline."""
        return tuple(parameter.null for parameter in self.parameters)

    @property
    def strengths(self) -> tuple[int, ...]:
        """Indices of the parameters that say how strong it is: the first, and those of its unit and null."""
        first = self.parameters[0]
        return tuple(
            index
            for index, parameter in enumerate(self.parameters)
            if (parameter.unit, parameter.null) == (first.unit, first.null)
        )

    def ends_at_bound(self, values: Sequence[float]) -> bool:
        """Return whether a search for parameters with such values ended at a bound, where the effect does something."""
        return any(
            value != one.null and not one.choice and any(math.isclose(value, bound) for bound in (one.lower, one.upper))
            for one, value in zip(self.parameters, values)
        )

    def of_strength(self, parameters: Sequence[float], share: float) -> tuple[float, ...]:
        """
        Return parameters with a share of their strength, the others as they are.

        What counts from its null is that much nearer to it; a limit, whose null is its upper bound, is as much wider.
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
