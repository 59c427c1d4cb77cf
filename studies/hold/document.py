# SPDX-License-Identifier: Apache-2.0
"""Write the document of the study from its rows: requirements, variants, kinds of devices and scenarios."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from cfd_pneumatic.arrays import Array
from studies.documents.markdown import table
from studies.hold.devices import RATE
from studies.hold.rows import CONSTANT, CONTROLLER, FORMULA, HELD, VARIED, WRONG_SCAN, Row
from studies.tools.provenance import machine

FEED_TOLERANCE = 0.1
"""Accepted difference of the predicted and the played fastest feed, relative."""

RMS_TOLERANCE = 0.15
"""Accepted difference of the predicted and the true RMS error, relative."""

SMALL = 0.2
"""RMS error at constant set-points below which a larger held error is accepted [N]."""

MEANINGS = {
    CONSTANT: 'The set-points are constant; the mean force is the wanted force as predicted.',
    HELD: f'`--hold` computes the set-points; {RATE:.0f} of them per second.',
    'held, 50 Hz': 'As `held`, with 50 set-points per second.',
    'held, 20 Hz': 'As `held`, with 20 set-points per second.',
    'late by 5 ms': 'As `held`; each set-point arrives 5 ms late.',
    'late by 10 ms': 'As `held`; each set-point arrives 10 ms late.',
    WRONG_SCAN: 'As `held`, from a surface with a random error of 0.05 mm RMS.',
    FORMULA: 'The constant set-point plus K_x / K times the speed, from the identified gains.',
    CONTROLLER: 'A PI controller of the force with 20 ms dead time, the best of nine tunings for each device.',
}
"""Meaning of each variant, in a sentence."""

SCENARIO_UNITS = {'settling time': 's'}
"""Units of the figures of scenarios, if not N."""


Requirement = tuple[str, str, str, bool | None]
"""A requirement, its limit and the measured figure as texts, and whether the requirement holds; None: not known."""


def document(rows: Sequence[Row], command: str, notes: str) -> str:
    """Return the document in Markdown."""
    measured = [row for row in rows if not row.message]
    refused = sorted({f'device {row.seed}: {row.message}' for row in rows if row.message})
    devices = {row.seed for row in rows}
    minutes = sum(sum(row.seconds.values()) for row in rows) / 60.0
    answers = {None: 'not measured', True: 'yes', False: 'no'}
    requirements = [(*texts, answers[holds]) for *texts, holds in _requirements(rows)]
    sections = [
        '# Prediction and hold of the force along a path',
        f'`force_on_path` predicts the contact force along a path and computes set-points that hold the force. '
        f'{len(devices)} devices on the virtual rig are identified from one minute each. '
        f'The rig then plays {len(rows)} surfaces and gives the true force. '
        'The rig shares no code with the model. Its devices and surfaces were not used in development.',
        f'- Command: `{command}`\n'
        f'- Machine: {machine()}; {minutes:.0f} minutes of work, which two processes share\n'
        f'- Commit: {", ".join(sorted({row.commit for row in rows}))}\n'
        f'- Seeds of devices: {min(devices)} to {max(devices)}; 2000 to 2009 were used in development',
        '## Requirements',
        'A sample is a time on the path, every 2 ms. '
        '*Held / constant* is the RMS of the true force error with `--hold`, divided by that at constant set-points. '
        'The tolerance is 10 % of the force. '
        'A *violation* is a sample with a true error larger than the tolerance plus half of the band. '
        'A violation is *missed* if the prediction reports neither a certain nor a possible violation at this sample.',
        table(['requirement', 'limit', 'measured', 'holds'], requirements),
        *([f'Not measured: {"; ".join(refused)}.'] if refused else []),
        '## Variants',
        f'RMS of the true force error, over {VARIED} surfaces of each device. The ratio refers to constant set-points.',
        table(
            ['variant', 'median [N]', 'median ratio', '90 % quantile', 'meaning'],
            [_variant_line(name, meaning, measured) for name, meaning in MEANINGS.items()],
        ),
        '## Kinds of devices',
        'Inexact makes have valves, tubes or walls that the model describes only approximately. '
        'The command path is the sum of its dead time and lag. *Covered* is the share of samples within the 95 % band.',
        table(
            ['devices', 'number', 'held / constant, median', '90 % quantile', 'covered, constant', 'covered, held'],
            [_kind_line(name, [row for row in measured if chosen(row)]) for name, chosen in KINDS.items()],
        ),
        *_scenario_sections(measured),
        notes,
    ]
    return '\n\n'.join(section for section in sections if section).rstrip() + '\n'


def ratios(rows: Sequence[Row], variant: str = HELD) -> Array:
    """Return the true RMS error of a variant divided by that at constant set-points, of each row."""
    return np.array([row.errors[variant] / row.errors[CONSTANT] for row in rows])


def coverage(rows: Sequence[Row], variant: str) -> float:
    """Return the share of all samples within the band of the prediction for a variant."""
    samples = [row.predicted[variant]['samples'] for row in rows]
    return float(np.average([row.predicted[variant]['covered'] for row in rows], weights=samples)) if rows else math.nan


def _requirements(rows: Sequence[Row]) -> Iterator[Requirement]:
    """Yield the requirements with their figures; a surface that was refused meets none."""
    measured = [row for row in rows if not row.message]
    devices = [[row for row in measured if row.seed == seed] for seed in sorted({row.seed for row in measured})]
    for variant in (CONSTANT, HELD):
        pooled = coverage(measured, variant)
        lowest = min((coverage(found, variant) for found in devices), default=math.nan)
        text = f'samples within the 95 % band, {variant} set-points'
        yield text, '90 to 99 %', f'{100 * pooled:.1f} %', 0.9 <= pooled <= 0.99
        yield f'{text}, lowest device', 'at least 70 %', f'{100 * lowest:.1f} %', lowest >= 0.7
    close = sum(abs(row.predicted[CONSTANT]['rms'] / row.errors[CONSTANT] - 1.0) <= RMS_TOLERANCE for row in measured)
    text = 'predicted RMS error within 15 % of the true RMS error'
    yield text, 'at least 90 %', _share_text(close, len(rows)), close >= 0.9 * len(rows)
    beyond, missed = (int(sum(row.predicted[CONSTANT][key] for row in measured)) for key in ('violations', 'missed'))
    holds = missed <= 0.05 * beyond if beyond else None
    yield 'missed violations', 'at most 5 %', _share_text(missed, beyond), holds
    feeds = [(row.fastest['predicted'], row.fastest['played']) for row in measured if row.fastest]
    played = [(predicted, feed) for predicted, feed in feeds if predicted and feed is not None]
    close = sum(abs(feed / predicted - 1.0) <= FEED_TOLERANCE for predicted, feed in played)
    figure = f'{close} of {len(played)} devices; {len(feeds) - len(played)} more are limited by friction'
    text, holds = 'played fastest feed within 10 % of the predicted one', close == len(played) if played else None
    yield text, 'all', figure, holds
    found = np.concatenate([ratios(measured), np.full(len(rows) - len(measured), math.inf)])
    median, most = float(np.median(found)), float(np.quantile(found, 0.9, method='higher'))
    yield 'held / constant, median', 'at most 0.2', f'{median:.2f}', median <= 0.2
    yield 'held / constant, 90 % quantile', 'at most 0.35', f'{most:.2f}', most <= 0.35
    large = [row for row in measured if row.errors[CONSTANT] > SMALL]
    worse = int(np.sum(ratios(large) > 1.0))
    text = f'surfaces with a larger error held than constant, if constant set-points leave more than {SMALL} N'
    yield text, 'none', f'{worse} of {len(large)}', worse == 0


def _share_text(part: int, whole: int) -> str:
    return f'{100 * part / whole:.1f} % ({part} of {whole})' if whole else 'none of 0'


def _variant_line(name: str, meaning: str, rows: Sequence[Row]) -> tuple[str, ...]:
    played = [row for row in rows if row.surface < VARIED]
    if not played:
        return name, '', '', '', meaning
    found = ratios(played, name)
    median = np.median([row.errors[name] for row in played])
    return name, f'{median:.2f}', f'{np.median(found):.2f}', f'{np.quantile(found, 0.9):.2f}', meaning


def command_path(row: Row) -> float:
    """Return dead time plus lag of the command [s]."""
    return float(row.device['dead_time'] + row.device['lag'])


KINDS: dict[str, Callable[[Row], bool]] = {
    'all': lambda row: True,
    'exact makes': lambda row: row.device['is_exact'],
    'inexact makes': lambda row: not row.device['is_exact'],
    'no command path': lambda row: command_path(row) == 0.0,
    'command path up to 30 ms': lambda row: 0.0 < command_path(row) <= 0.03,
    'command path above 30 ms': lambda row: command_path(row) > 0.03,
    'friction up to 0.5 N': lambda row: row.device['friction'] <= 0.5,
    'friction above 0.5 N': lambda row: row.device['friction'] > 0.5,
    'with a leak': lambda row: bool(row.device['leak']),
    'surfaces with a burr': lambda row: row.path['burr'] > 0.0,
}
"""Kinds of devices and surfaces by name."""


def _kind_line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    devices = str(len({row.seed for row in rows}))
    if not rows:
        return name, devices, '', '', '', ''
    found = ratios(rows)
    covered = [f'{100 * coverage(rows, variant):.1f} %' for variant in (CONSTANT, HELD)]
    return name, devices, f'{np.median(found):.2f}', f'{np.quantile(found, 0.9):.2f}', *covered


def _scenario_sections(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the section of the scenarios, if any was played."""
    played = [row.scenarios for row in rows if row.scenarios]
    if not played:
        return
    yield '## Scenarios'
    yield (
        'Scenarios of [Gadringer et al.](https://doi.org/10.5194/ms-13-361-2022) for the contact force of robots. '
        'A rig whose piston follows positions cannot play the approach to contact. The wanted force is 20 N. '
        'The robot deviates from its path by 0.03 mm RMS, which the plan does not know. '
        'An independent load cell measures the force, as a mean over 20 ms. Each figure is the mean of five runs, '
        f'and the median of {len(played)} devices.'
    )
    for is_step in (False, True):
        names = [name for name in played[0] if name.startswith('step') == is_step]
        figures = list(played[0][names[0]])
        lines = [
            (name, *(f'{np.median([scenarios[name][figure] for scenarios in played]):.2f}' for figure in figures))
            for name in names
        ]
        yield table(['scenario', *(f'{figure} [{SCENARIO_UNITS.get(figure, "N")}]' for figure in figures)], lines)
    yield 'A step has settled when the force stays within 10 % of the step. The regulators get constant set-points.'
