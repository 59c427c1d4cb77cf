# SPDX-License-Identifier: Apache-2.0
"""Report of a leak test: table and sentences for the terminal, JSON for programs, and a picture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from cfd_pneumatic.charts import Chart, Curve, Panel, svg
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.identification import LAWS, Decay, Leak, rate_of
from cfd_pneumatic.terminal import table

SCHEMA = 1
LEAK_FILE = 'leak.json'
PICTURE_FILE = 'leak.svg'

_CAPTION = (
    'Gap: flow proportional to the gauge pressure. Orifice: choked flow, proportional to the absolute pressure.\n'
)
_SETTLING_CAPTION = (
    'Settling: part of the pressure that decays exponentially in addition to the leak, with its time constant.\n'
)
_INTERVAL = '95 % interval'
_EMPTY = 'none'  # text of an empty cell
_FEWEST_DIGITS, _MOST_DIGITS = 3, 9  # of the limits of an interval
_LARGEST_ERROR, _LARGEST_ERROR_RATIO = 2.0, 1.5  # of a model that is not excluded: LARGEST_LAW_ERROR and its ratio
_ZERO = 1e-6  # a conductance below this share of its upper limit is printed as 0
_COLOURS = ('#0a5fc2', '#c2500f')
_WIDTH = 720.0
_END_SAMPLES = 5  # samples at each end, whose median is the pressure there
_CURVE_POINTS = 30  # pressures of a rate curve in the JSON file
_MINUTE = 60.0  # [s]
_LONGEST_MINUTES = 120.0  # longer times are printed in hours


_PICTURE_LABEL = 'pressure decay'

FILES = ResultFiles(
    {
        PICTURE_FILE: marked(f'\\A<svg [^>]*aria-label="{_PICTURE_LABEL}"'),
        LEAK_FILE: marked(r'\A\{\s*"schema": \d+,\s*"cylinders": '),
    }
)
"""Files of a leak test, with the marks that recognise them."""


def write_decays(decays: Mapping[str, Decay], folder: Path, *, overwrite: bool = False) -> list[Path]:
    """
    Write the estimated leaks as JSON, and a picture of the pressures.

    Parameters
    ----------
    decays, folder
        Pressure decays by cylinder, and the folder for the files. A missing folder is created.
    overwrite
        Whether files of these names are replaced even if this program did not write them.

    Raises
    ------
    InputError
        If the folder cannot be written, or a file in it must not be replaced.

    """
    content = {'schema': SCHEMA, 'cylinders': {name: _decay_data(decay) for name, decay in decays.items()}}
    with FILES.made_for(folder, overwrite=overwrite) as staged_folder:
        (staged_folder / LEAK_FILE).write_text(json.dumps(content, indent=1) + '\n', encoding='utf-8')
        (staged_folder / PICTURE_FILE).write_text(_picture(decays), encoding='utf-8')
    return [folder / LEAK_FILE, folder / PICTURE_FILE]


def print_decay(name: str, decay: Decay, console: Console) -> None:
    """Print the leak models fitted to a cylinder's pressure decay, and the conclusion."""
    ends = decay.pressure[:_END_SAMPLES], decay.pressure[-_END_SAMPLES:]
    first, last = (1e-3 * (float(np.median(end)) - decay.ambient_pressure) for end in ends)
    console.print(
        f'{name}: {first:.4g} to {last:.4g} kPa gauge in {decay.times[-1]:.4g} s, noise {decay.noise:.3g} Pa.'
    )
    has_settling = any(leak.settling for leak in decay.leaks)
    headings = ['leak model', 'conductance, 1/s', _INTERVAL, 'error, Pa', 'error / noise', 'result']
    headings[3:3] = ['settling, kPa', 'settling time constant, s'] if has_settling else []
    title = f'{name}: leak models, fitted to the first half and tested on the second half'
    models = table(title, *headings, words=('leak model', 'result'))
    models.columns[headings.index(_INTERVAL)].no_wrap = True
    for leak in decay.leaks:
        conductance = leak.conductance if leak.conductance > _ZERO * leak.interval[1] else 0.0
        cells = [leak.characteristic, f'{conductance:.4g}', _interval_text(*leak.interval)]
        if has_settling:
            settling = f'{1e-3 * leak.settling:.3g}', f'{leak.time_constant:.3g}'
            cells += settling if leak.settling else (_EMPTY, _EMPTY)
        cells += [f'{leak.error:.4g}', f'{leak.error / decay.noise:.2f}', 'excluded' if leak.excluded else 'possible']
        models.add_row(*cells)
    exclusion = f'A model is excluded if its error exceeds {_largest_error(decay):.4g} Pa.'
    models.caption = f'{_CAPTION}{_SETTLING_CAPTION if has_settling else ""}{exclusion}'
    console.print(models)
    for line in _sentences(name, decay):
        console.print(line)


def _interval_text(low: float, high: float) -> str:
    """Return the limits of an interval as text, with enough digits to differ."""
    for digits in range(_FEWEST_DIGITS, _MOST_DIGITS):
        limits = [f'{limit:#.{digits}g}'.rstrip('.') if limit else '0' for limit in (low, high)]
        if limits[0] != limits[1]:
            break
    return ' to '.join(limits)


def _largest_error(decay: Decay) -> float:
    """Return the largest error on the second half of a leak model that is not excluded [Pa]."""
    least = max(min(leak.error for leak in decay.leaks), decay.noise)
    return min(_LARGEST_ERROR * decay.noise, _LARGEST_ERROR_RATIO * least)


def _sentences(name: str, decay: Decay) -> list[str]:
    """Return the conclusions from a cylinder's pressure decay."""
    best, possible = decay.best, [leak.characteristic for leak in decay.leaks if not leak.excluded]
    if not possible:
        return [
            'No leak model describes the second half. The valve may not have been shut all the time. '
            'Give the times of the shut valve with --begin and --end.'
        ]
    lines = []
    if best.settling:
        lines.append(
            f'In addition to the leak, the pressure settles by {1e-3 * best.settling:.3g} kPa. After filling, the air '
            'cools down and a soft chamber expands. Wait longer before the test to measure the leak alone.'
        )
    if not decay.has_leak:
        lines.append(f'No leak is detected. Its conductance is at most {best.interval[1]:.3g} 1/s.')
        return lines
    drop = _MINUTE * best.conductance * rate_of(best.characteristic, best.start, decay.ambient_pressure)
    lines.append(f'At the start the pressure falls by {1e-3 * drop:.3g} kPa per minute.')
    if len(possible) > 1 and decay.distinguishable_below is not None:
        gauge, time = decay.distinguishable_below
        lines.append(
            f'This recording cannot distinguish the possible leak models. Let the pressure fall to '
            f'{1e-3 * gauge:.4g} kPa gauge, for about {_duration(time)}.'
        )
    parameters = {
        'enabled': 'true',
        'conductance': f'{best.conductance:.4g}',
        'orifice': f'{LAWS[best.characteristic]:.1f}',
    }
    lines.append('For sim_node: ' + ' '.join(f'-p {name}.leakage.{key}:={value}' for key, value in parameters.items()))
    return lines


def _duration(seconds: float) -> str:
    """Return a duration as text, in minutes or hours."""
    minutes = seconds / _MINUTE
    return f'{minutes:.0f} min' if minutes < _LONGEST_MINUTES else f'{minutes / 60.0:.1f} h'


def _decay_data(decay: Decay) -> dict[str, Any]:
    return {
        'ambient_pressure_pa': decay.ambient_pressure,
        'duration_s': float(decay.times[-1]),
        'samples': decay.times.size,
        'noise_pa': decay.noise,
        'told': decay.has_leak,
        'laws': [_leak_data(leak, decay) for leak in decay.leaks],
        'tells_below': None
        if decay.distinguishable_below is None
        else dict(zip(('gauge_pa', 'after_s'), decay.distinguishable_below)),
    }


def _leak_data(leak: Leak, decay: Decay) -> dict[str, Any]:
    pressures = np.linspace(float(np.min(leak.simulated)), float(np.max(leak.simulated)), _CURVE_POINTS)
    rates = np.array(
        [rate_of(leak.characteristic, pressure, decay.ambient_pressure) for pressure in pressures.tolist()]
    )
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
    """Return the picture of each pressure with its best leak model, and the residuals."""
    panels = []
    for name, decay in decays.items():
        absolute = decay.pressure, decay.best.simulated
        gauge, simulated = (1e-3 * (pressure - decay.ambient_pressure) for pressure in absolute)
        measured_colour, simulated_colour = _COLOURS
        panels += [
            Panel(
                f'{name}: gauge pressure [kPa]',
                200,
                [
                    Curve(decay.times, gauge, measured_colour, style='dots'),
                    Curve(decay.times, simulated, simulated_colour, 2.0),
                ],
            ),
            Panel(
                f'{name}: residual of the {decay.best.characteristic} model [Pa]',
                90,
                [Curve(decay.times, 1e3 * (gauge - simulated), measured_colour, style='dots')],
                band=decay.noise,
            ),
        ]
    end = max(float(decay.times[-1]) for decay in decays.values())
    return svg(Chart(panels, (0.0, end), 'time [s]', _PICTURE_LABEL, whole=True), _WIDTH)
