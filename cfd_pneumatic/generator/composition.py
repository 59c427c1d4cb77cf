# SPDX-License-Identifier: Apache-2.0
"""The text of the extended model's kernel: every effect behind a switch, put together by a template."""

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


def composed() -> str:
    """Return the kernel's text."""
    effects = [_described(name, PLACES[name], 'y{}') for name in PRESSURE_PARTS]
    force_effects = [_described(name, FORCE_PLACES[name], 'state[{}]') for name in FORCE_PARTS]
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
        resting=_resting(effects),
        last_lag=max(effect['rank'] for effect in effects if effect['follows'] == 'signal'),
        force_states=FORCE_STATES,
        fingerprint=_fingerprint(),
    )


def _described(name: str, place: Place, state: str) -> dict[str, Any]:
    """Return what the template says of an effect; `state` is how a state with a number is written."""
    states = place.state_indices
    own = [state.format(index) for index in states]
    effect, row = MODULES[name].EFFECT, name.upper()
    parameters, held = len(effect.parameters), effect.held
    own.append(f'*floats(a, {place.parameters.start}, {parameters})')
    return {
        'name': name,
        'switch': place.switch,
        'own': ', '.join(own),
        'states': ', '.join(own[: len(states)]),
        'first_state': place.states.start,
        'follows': effect.follows,
        'rests_at_pressure': effect.rests_at_pressure,
        'state_indices': list(states),
        'parameters': parameters,
        'held': held,
        'row': row,
        'own_row': f'{row}_HELD' if held else row,
        'own_rows': held or parameters,
        'rank': effect.rank,
        'integrated': hasattr(MODULES[name], 'evolve'),
        'compiled': any(hasattr(MODULES[name], function) for function in FUNCTIONS),
    }


def _resting(effects: Sequence[Mapping[str, Any]]) -> dict[int, str]:
    """Return what each state is at rest, as the template writes it."""
    resting = dict.fromkeys(range(PRESSURES), 'pressure')
    for effect in effects:
        for rank, index in enumerate(effect['state_indices']):
            at_pressure = rank == 0 and effect['rests_at_pressure']
            at_displacement = effect['follows'] == 'displacement'
            resting[index] = 'pressure' if at_pressure else 'x' if at_displacement else '0.0'
    return resting


def _fingerprint() -> str:
    """Return what changes with all that is compiled in: Numba's files are made anew when the kernel's text changes."""
    text = ''.join(inspect.getsource(module) for module in (*MODULES.values(), knots, flow_function, lanes, lanewise))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
