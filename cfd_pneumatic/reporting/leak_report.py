# SPDX-License-Identifier: Apache-2.0
"""What a pressure decay tells, for people and for programs: a table and sentences, JSON, a picture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.identification import LAWS, Decay, Leak, rate_of
from cfd_pneumatic.svg import Curve, Panel, chart
from cfd_pneumatic.terminal import table

SCHEMA = 1
LEAK_FILE = 'leak.json'
PICTURE_FILE = 'leak.svg'

_CAPTION = 'gap: flow as the gauge pressure; orifice: as the absolute pressure, choked'
_ZERO = 1e-6  # times the interval's end: what is smaller is none
_COLOURS = ('#0a5fc2', '#c2500f')
_WIDTH = 720.0
_ENDS = 5  # samples
_PRESSURES = 30  # at which the rate is told
_MINUTE = 60.0  # [s]
_LONG = 120.0  # minutes, from which on hours are said


_PICTURED = 'pressure decay'

FILES = ResultFiles(
    {
        PICTURE_FILE: marked(f'\\A<svg [^>]*aria-label="{_PICTURED}"'),
        LEAK_FILE: marked(r'\A\{\s*"schema": \d+,\s*"cylinders": '),
    }
)
"""How the files of a leak test are recognised."""


def write_decays(decays: Mapping[str, Decay], folder: Path, *, overwrite: bool = False) -> list[Path]:
    """
    Write what decays tell as JSON, and a picture, into a folder, made if need be.

    Parameters
    ----------
    decays, folder
        What, and where to.
    overwrite
        Whether files of these names are replaced that this program did not write.

    Raises
    ------
    InputError
        If the folder can't be written, or a file in it is not to be replaced.

    """
    content = {'schema': SCHEMA, 'cylinders': {name: _data(decay) for name, decay in decays.items()}}
    with FILES.made_for(folder, overwrite=overwrite) as made:
        (made / LEAK_FILE).write_text(json.dumps(content, indent=1) + '\n', encoding='utf-8')
        (made / PICTURE_FILE).write_text(_picture(decays), encoding='utf-8')
    return [folder / LEAK_FILE, folder / PICTURE_FILE]


def print_decay(name: str, decay: Decay, console: Console) -> None:
    """Print the laws of one cylinder's decay, and what they come to."""
    ends = decay.pressure[:_ENDS], decay.pressure[-_ENDS:]
    first, last = (1e-3 * (float(np.median(end)) - decay.ambient_pressure) for end in ends)
    console.print(
        f'{name}: {first:.4g} to {last:.4g} kPa gauge in {decay.times[-1]:.4g} s, noise {decay.noise:.3g} Pa.'
    )
    settles = any(leak.settling for leak in decay.leaks)
    headings = ['law', 'conductance, 1/s', '95 % interval', 'error, Pa', 'over the noise', 'is it']
    headings[3:3] = ['settles by, kPa', 'within, s'] if settles else []
    title = f'{name}: laws, fitted to the first half and judged by the second'
    laws = table(title, *headings, words=('law', 'is it'))
    for leak in decay.leaks:
        conductance = leak.conductance if leak.conductance > _ZERO * leak.interval[1] else 0.0
        cells = [leak.characteristic, f'{conductance:.4g}', ' to '.join(f'{one:.3g}' for one in leak.interval)]
        if settles:
            settled = f'{1e-3 * leak.settling:.3g}', f'{leak.time_constant:.3g}'
            cells += settled if leak.settling else ('', '')
        cells += [f'{leak.error:.4g}', f'{leak.error / decay.noise:.2f}', 'excluded' if leak.excluded else 'possible']
        laws.add_row(*cells)
    laws.caption = _CAPTION
    console.print(laws)
    for line in _sentences(name, decay):
        console.print(line)


def _sentences(name: str, decay: Decay) -> list[str]:
    """Return what the laws come to."""
    best, possible = decay.best, [leak.characteristic for leak in decay.leaks if not leak.excluded]
    if not possible:
        return [
            'None of these laws describes the second half: is the valve shut all the time? --begin and --end say when.'
        ]
    lines = []
    if best.settling:
        lines.append(
            f'Beside a leak the pressure settles by {1e-3 * best.settling:.3g} kPa: air cools down after a chamber was '
            'filled, and a soft chamber gives way. Wait before the test, and only the leak is left.'
        )
    if not decay.has_leak:
        lines.append(f'A leak is not told: its conductance is at most {best.interval[1]:.3g} 1/s.')
        return lines
    lost = _MINUTE * best.conductance * rate_of(best.characteristic, best.start, decay.ambient_pressure)
    lines.append(f'At the start the pressure falls by {1e-3 * lost:.3g} kPa per minute.')
    if len(possible) > 1 and decay.distinguishable_below is not None:
        gauge, time = decay.distinguishable_below
        lines.append(
            f'Which law it is this fall does not tell: let it fall to {1e-3 * gauge:.4g} kPa gauge, '
            f'for about {_long(time)}.'
        )
    given = {'enabled': 'true', 'conductance': f'{best.conductance:.4g}', 'orifice': f'{LAWS[best.characteristic]:.1f}'}
    lines.append('For sim_node: ' + ' '.join(f'-p {name}.leakage.{key}:={value}' for key, value in given.items()))
    return lines


def _long(seconds: float) -> str:
    """Return a time in a unit that suits it."""
    minutes = seconds / _MINUTE
    return f'{minutes:.0f} min' if minutes < _LONG else f'{minutes / 60.0:.1f} h'


def _data(decay: Decay) -> dict[str, Any]:
    return {
        'ambient_pressure_pa': decay.ambient_pressure,
        'duration_s': float(decay.times[-1]),
        'samples': decay.times.size,
        'noise_pa': decay.noise,
        'told': decay.has_leak,
        'laws': [_law_data(leak, decay) for leak in decay.leaks],
        'tells_below': None
        if decay.distinguishable_below is None
        else dict(zip(('gauge_pa', 'after_s'), decay.distinguishable_below)),
    }


def _law_data(leak: Leak, decay: Decay) -> dict[str, Any]:
    pressures = np.linspace(float(np.min(leak.simulated)), float(np.max(leak.simulated)), _PRESSURES)
    rates = np.array([rate_of(leak.characteristic, one, decay.ambient_pressure) for one in pressures.tolist()])
    return {
        'law': leak.characteristic,
        'excluded': leak.excluded,
        'conductance': leak.conductance,
        'interval': list(leak.interval),
        'start_pa': leak.start,
        'settling_pa': leak.settling,
        'settling_time_constant_s': leak.time_constant,
        'error_pa': leak.error,
        'over_noise': leak.error / decay.noise,
        'curve': {
            'gauge_pa': (pressures - decay.ambient_pressure).tolist(),
            'rate_pa_per_s': (leak.conductance * rates).tolist(),
            'low': (leak.interval[0] * rates).tolist(),
            'high': (leak.interval[1] * rates).tolist(),
        },
    }


def _picture(decays: Mapping[str, Decay]) -> str:
    """Return each pressure with the law that errs least, and what that leaves."""
    panels = []
    for name, decay in decays.items():
        gauge, simulated = (1e-3 * (one - decay.ambient_pressure) for one in (decay.pressure, decay.best.simulated))
        measured, law = _COLOURS
        panels += [
            Panel(
                f'{name}: gauge pressure [kPa]',
                200,
                [Curve(decay.times, gauge, measured, dots=True), Curve(decay.times, simulated, law, 2.0)],
            ),
            Panel(
                f'{name}: what the {decay.best.characteristic} leaves [Pa]',
                90,
                [Curve(decay.times, 1e3 * (gauge - simulated), measured, dots=True)],
                band=decay.noise,
            ),
        ]
    end = max(float(decay.times[-1]) for decay in decays.values())
    return chart(panels, _WIDTH, (0.0, end), 'time [s]', _PICTURED, whole=True)
