"""Write the extended model's kernel, `cfd_pneumatic/model/composed.py`, from the effects: make kernel."""

from __future__ import annotations

import hashlib
import inspect
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from cfd_pneumatic.model.effects import MODULES
from cfd_pneumatic.model.places import PLACES, STATES

HERE = Path(__file__).parent
KERNEL = HERE.parent / 'cfd_pneumatic' / 'model' / 'composed.py'


def composed() -> str:
    """Return the kernel's text."""
    effects = [_described(name) for name in MODULES]
    templates = Environment(loader=FileSystemLoader(HERE), undefined=StrictUndefined, keep_trailing_newline=True)

    def having(function: str) -> list[dict[str, Any]]:
        return [effect for effect in effects if hasattr(MODULES[effect['name']], function)]

    def states_of(function: str) -> list[int]:
        return sorted({0}.union(*(PLACES[effect['name']].state_indices for effect in having(function))))

    return templates.get_template('kernel.py.jinja').render(
        effects=effects,
        having=having,
        states_of=states_of,
        states=STATES,
        fingerprint=_fingerprint(),
    )


FUNCTIONS = (
    'displacement',
    'setpoint',
    'error',
    'flow',
    'velocity_gain',
    'chamber',
    'outlet',
    'time_constant',
    'signal',
)
"""What an effect may change, by the name of the function that does; see `model.effects.effect`."""


def _described(name: str) -> dict[str, Any]:
    place = PLACES[name]
    states = place.state_indices
    own = [f'y{index}' for index in states]
    own += [f'a[{index}]' for index in range(place.parameters.start, place.parameters.stop)]
    return {
        'name': name,
        'switch': place.switch,
        'own': ', '.join(own),
        'rates': ', '.join(f'dy{index}' for index in states),
        'first_state': place.states.start,
        'follows': MODULES[name].EFFECT.follows,
        'compiled': any(hasattr(MODULES[name], function) for function in FUNCTIONS),
    }


def _fingerprint() -> str:
    """Return what changes with any effect: Numba's files on disk are made anew when the kernel's text changes."""
    text = ''.join(inspect.getsource(module) for module in MODULES.values())
    return hashlib.sha256(text.encode()).hexdigest()[:16]


if __name__ == '__main__':
    KERNEL.write_text(composed(), encoding='utf-8')
