"""Where each effect's switch, parameters and states stand among all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.model.effects import EFFECTS

Array = NDArray[np.float64]

GAINS = 4
"""k_x, k_sv, k_v and tau come first among the parameters."""

PRESSURES = 2
"""p and p_f come first among the states."""


@dataclass(frozen=True)
class Place:
    """Indices of one effect."""

    switch: int
    parameters: slice
    states: slice

    @property
    def state_indices(self) -> range:
        """Indices of the states."""
        return range(self.states.start, self.states.stop)


def _places() -> dict[str, Place]:
    places = {}
    parameter, state = GAINS, PRESSURES
    for switch, (name, effect) in enumerate(EFFECTS.items()):
        parameters = slice(parameter, parameter + len(effect.parameters))
        states = slice(state, state + effect.states)
        places[name] = Place(switch, parameters, states)
        parameter, state = parameters.stop, states.stop
    return places


PLACES = _places()
"""Place of each effect, by name."""

STATES = PRESSURES + sum(effect.states for effect in EFFECTS.values())
"""Number of states."""


def all_parameters(gains: Sequence[float] | Array, effects: Mapping[str, Sequence[float]]) -> Array:
    """Return the four gains [Pa/m, 1/s, 1/s, s] and every effect's parameters, null where it is not among `effects`."""
    own = [effects.get(name, effect.null) for name, effect in EFFECTS.items()]
    return np.concatenate([np.asarray(gains, dtype=np.float64), *own])


def switches(effects: Mapping[str, Sequence[float]]) -> NDArray[np.bool_]:
    """Return which effects are on, shape (effects,)."""
    return np.array([name in effects for name in EFFECTS])
