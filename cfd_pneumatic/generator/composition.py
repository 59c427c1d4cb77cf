# SPDX-License-Identifier: Apache-2.0
"""The source of the extended model's kernel, in which a template puts every effect behind a switch."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from cfd_pneumatic.model import flow_function, lanes, lanewise
from cfd_pneumatic.model.effects import FORCE_PARTS, FUNCTIONS, MODULES, PRESSURE_PARTS, knots
from cfd_pneumatic.model.places import FORCE_PLACES, FORCE_STATES, PARAMETERS, PLACES, PRESSURES, STATES, Place

_TEMPLATES = Path(__file__).parent
_RESTS_AT = {'displacement': 'x', 'setpoint': 'target'}  # first state at rest, by the value that the states follow


def composed_source() -> str:
    """Return the source of the kernel."""
    effects = [_effect_variables(name, PLACES[name], 'y{}') for name in PRESSURE_PARTS]
    force_effects = [_effect_variables(name, FORCE_PLACES[name], 'state[{}]') for name in FORCE_PARTS]
    templates = Environment(loader=FileSystemLoader(_TEMPLATES), undefined=StrictUndefined, keep_trailing_newline=True)

    def having(function: str) -> list[dict[str, Any]]:
        return [effect for effect in effects if hasattr(MODULES[effect['name']], function)]

    return templates.get_template('kernel.py.jinja').render(
        effects=effects,
        force_effects=force_effects,
        having=having,
        of_states=lambda letter: [f'{letter}{index}' for index in range(STATES)],
        states=STATES,
        parameters=PARAMETERS,
        resting=_rest_values(effects),
        last_lag=max(effect['rank'] for effect in effects if effect['follows'] == 'signal'),
        force_states=FORCE_STATES,
        fingerprint=_fingerprint(),
    )


def _effect_variables(name: str, place: Place, state: str) -> dict[str, Any]:
    """Return the template's variables of an effect; `state` is the format of a state by its number."""
    states = place.state_indices
    arguments = [state.format(index) for index in states]
    effect, row = MODULES[name].EFFECT, name.upper()
    parameters, held = len(effect.parameters), effect.held
    arguments.append(f'*load_floats(a, {place.parameters.start}, {parameters})')
    return {
        'name': name,
        'switch': place.switch,
        'arguments': ', '.join(arguments),
        'states': ', '.join(arguments[: len(states)]),
        'first_state': place.states.start,
        'follows': effect.follows,
        'rests_at_pressure': effect.rests_at_pressure,
        'state_indices': list(states),
        'parameters': parameters,
        'held': held,
        'row': row,
        'argument_row': f'{row}_HELD' if held else row,
        'argument_count': held or parameters,
        'rank': effect.rank,
        'integrated': hasattr(MODULES[name], 'evolve'),
        'compiled': any(hasattr(MODULES[name], function) for function in FUNCTIONS),
    }


def _rest_values(effects: Sequence[Mapping[str, Any]]) -> dict[int, str]:
    """Return the source of each state's value at rest, by the state's index."""
    resting = dict.fromkeys(range(PRESSURES), 'pressure')
    for effect in effects:
        first = 'pressure' if effect['rests_at_pressure'] else _RESTS_AT.get(effect['follows'], '0.0')
        for rank, index in enumerate(effect['state_indices']):
            resting[index] = first if rank == 0 else '0.0'
    return resting


def _fingerprint() -> str:
    """Return a hash of all inlined sources; Numba compiles the kernel again when its source changes."""
    text = ''.join(inspect.getsource(module) for module in (*MODULES.values(), knots, flow_function, lanes, lanewise))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
