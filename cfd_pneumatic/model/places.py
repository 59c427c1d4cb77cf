# SPDX-License-Identifier: Apache-2.0
"""
Indices of each effect's switch, parameters and states in the kernels' arrays.

Effects on the pressure and on the force are counted separately, because they act in different kernels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model.effects import FORCE_PARTS, PRESSURE_PARTS, Effect
from cfd_pneumatic.model.parameters import SPECS

GAINS = len(SPECS)
"""Number of gains, which come first among the parameters."""

PRESSURES = 2
"""Number of pressures, p and p_f, which come first among the states."""


@dataclass(frozen=True)
class Place:
    """The bit that switches an effect on, and the indices of its parameters and states."""

    switch: int
    parameters: slice
    states: slice

    @property
    def state_indices(self) -> range:
        """Indices of the states."""
        return range(self.states.start, self.states.stop)


def _places(effects: Mapping[str, Effect], parameter: int, state: int) -> dict[str, Place]:
    """Return the place of each effect; parameters and states of the first effect begin at the given indices."""
    places = {}
    for rank, (name, effect) in enumerate(effects.items()):
        parameters = slice(parameter, parameter + len(effect.parameters))
        states = slice(state, state + effect.states)
        places[name] = Place(1 << rank, parameters, states)
        parameter, state = parameters.stop, states.stop
    return places


PLACES = _places(PRESSURE_PARTS, GAINS, PRESSURES)
"""Place of each effect on the pressure, by name."""

STATES = PRESSURES + sum(effect.states for effect in PRESSURE_PARTS.values())
"""Number of states of the pressure."""

FOLLOWED = STATES
"""Index, after the states, of the displacement that the chamber followed last [m]."""

MEASURED = STATES + 1
"""Index of the displacement measured last [m]."""

PARAMETERS = GAINS + sum(len(effect.parameters) for effect in PRESSURE_PARTS.values())
"""Number of parameters: the gains, and those of the effects on the pressure."""

FORCE_PLACES = _places(FORCE_PARTS, 0, 0)
"""Place of each effect on the force, by name."""

FORCE_STATES = sum(effect.states for effect in FORCE_PARTS.values())
"""Number of states of the force."""


_NULL = np.concatenate([np.zeros(GAINS), *(effect.null for effect in PRESSURE_PARTS.values())])
_FORCE_NULL = np.concatenate([np.empty(0), *(effect.null for effect in FORCE_PARTS.values())])


def all_parameters(gains: Sequence[float] | Array, effects: Mapping[str, Sequence[float]]) -> Array:
    """
    Return the gains and the parameters of every effect on the pressure.

    The parameters of an effect that is not in `effects` are null.
    """
    values = _NULL.copy()
    values[:GAINS] = gains
    for name, parameters in effects.items():
        values[PLACES[name].parameters] = parameters
    return values


def switches(effects: Mapping[str, Sequence[float]]) -> int:
    """Return the switches of effects on the pressure, a bit for each."""
    return sum(PLACES[name].switch for name in effects)


def all_force_parameters(effects: Mapping[str, Sequence[float]]) -> Array:
    """Return the parameters of every effect on the force; those of an effect not in `effects` are null."""
    values = _FORCE_NULL.copy()
    for name, parameters in effects.items():
        values[FORCE_PLACES[name].parameters] = parameters
    return values


def force_switches(effects: Mapping[str, Sequence[float]]) -> int:
    """Return the switches of effects on the force, a bit for each."""
    return sum(FORCE_PLACES[name].switch for name in effects)
