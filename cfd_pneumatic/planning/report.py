# SPDX-License-Identifier: Apache-2.0
"""Report a plan: tables for the terminal, JSON for programs, and a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cfd_pneumatic.charts import Chart, Curve, Panel, svg
from cfd_pneumatic.convention import CYLINDERS, SCHEDULE_COLUMNS
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.planning.names import PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE
from cfd_pneumatic.planning.prediction import EffectPrediction, ParameterPrediction, Planned
from cfd_pneumatic.terminal import table

_WIDTH = 1000.0  # of the picture [CSS px]
SCHEMA = 1

_COLOURS = {'blue': '#0a5fc2', 'orange': '#c2500f'}


_is_plan = marked(r'\A\{\s*"schema": \d+,\s*"duration_s": ')
_begins_at_rest = marked(rf'\A{",".join(SCHEDULE_COLUMNS)}\n0\.0,0\.0,0\.0,')


def _is_schedule(path: Path) -> bool:
    """Return whether a table belongs to a plan: a table by the user is not next to a plan."""
    return _begins_at_rest(path) and _is_plan(path.with_name(PLAN_FILE))


_PICTURED = 'the schedule, '

FILES = ResultFiles(
    {PICTURE_FILE: marked(f'\\A<svg [^>]*aria-label="{_PICTURED}'), PLAN_FILE: _is_plan, SCHEDULE_FILE: _is_schedule}
)
"""Marks by which the files of a plan are recognised."""


def write_plan(plan: Planned, folder: Path, *, overwrite: bool = False) -> list[Path]:
    """
    Write the schedule, the plan as JSON and the picture into a folder, which is created if necessary.

    Parameters
    ----------
    plan, folder
        The plan, and the output folder.
    overwrite
        Whether to replace files of these names that this program did not write.

    Raises
    ------
    InputError
        If the folder cannot be written, or an existing file must not be replaced.

    """
    contents = {
        PICTURE_FILE: picture(plan),
        PLAN_FILE: json.dumps(plan_data(plan), indent=2, allow_nan=False) + '\n',
        SCHEDULE_FILE: plan.proposal.table(),
    }
    with FILES.made_for(folder, overwrite=overwrite) as made:
        for name, content in contents.items():
            (made / name).write_text(content, encoding='utf-8')
    return [folder / name for name in contents]


def print_plan(plan: Planned, console: Console) -> None:
    """Print the schedule and the predictions."""
    proposal = plan.proposal
    console.print(
        f'{proposal.times[-1]:.1f} s in {plan.rounds} round{"s" if plan.rounds > 1 else ""}, each of: '
        f'{"; ".join(_counted(plan))}.'
    )
    console.print(_parameter_table(plan.parameters))
    for channel, effects in groupby(plan.effects, key=lambda prediction: prediction.channel):
        console.print(_effect_table(channel, list(effects)))


def _counted(plan: Planned) -> list[str]:
    """Return the names of the segments of a round, with a count for equal adjacent segments."""
    groups = groupby(plan.segments, key=lambda segment: segment.name)
    counted = [(name, len(list(segments))) for name, segments in groups]
    return [name if count == 1 else f'{count} times {name}' for name, count in counted]


def _parameter_table(parameters: Sequence[ParameterPrediction]) -> Table:
    headings = ('channel', 'parameter', 'value', 'standard error', '% of value', 'unit')
    title = 'predicted standard errors (Cramer-Rao, white noise)'
    rows = table(title, *headings, words=('channel', 'parameter', 'unit'))
    for parameter in parameters:
        channel, name, value, std = parameter.channel, parameter.name, parameter.value, parameter.std
        if std is None or not parameter.identifiable:
            rows.add_row(channel, name, f'{value:.4g}', 'not identifiable', '', parameter.unit)
        else:
            share = f'{100.0 * std / abs(value):.2g}'
            rows.add_row(channel, name, f'{value:.4g}', f'{std:.2g}', share, parameter.unit)
    return rows


def _effect_table(channel: str, effects: Sequence[EffectPrediction]) -> Table:
    headings = ('effect', 'detectable', 'from', 'not distinguishable from', 'most similar, share that differs')
    rows = table(f'{channel}: detectable effects', *headings, words=headings)
    for prediction in effects:
        nearest = prediction.nearest
        similar = '' if nearest is None else f'{nearest[0]}: {100.0 * nearest[1]:.0f} %'
        rivals = ', '.join(prediction.alternatives)
        shows = 'yes' if prediction.shows else 'no'
        rows.add_row(prediction.effect, shows, smallest_strength_text(prediction), rivals, similar)
    return rows


def smallest_strength_text(prediction: EffectPrediction) -> str:
    """Return the strength from which an effect is detectable, as text."""
    if not prediction.smallest:
        return '' if prediction.smallest is None else 'any strength'
    units = {parameter.name: parameter.unit for parameter in EFFECTS[prediction.effect].parameters}
    return ', '.join(f'{name} {value:.2g} {units[name]}' for name, value in prediction.smallest.items())


def plan_data(plan: Planned) -> dict[str, Any]:
    """Return a plan as JSON types, numbers in SI units."""
    proposal = plan.proposal
    return {
        'schema': SCHEMA,
        'duration_s': float(proposal.times[-1]),
        'rounds': plan.rounds,
        'segments': [{'from_s': float(proposal.times[index]), 'what': name} for name, index in proposal.segments],
        'parameters': [
            {
                'channel': prediction.channel,
                'name': prediction.name,
                'unit': prediction.unit,
                'value': prediction.value,
                'std': prediction.std,
                'identifiable': prediction.identifiable,
            }
            for prediction in plan.parameters
        ],
        'effects': [
            {
                'channel': prediction.channel,
                'effect': prediction.effect,
                'shows': prediction.shows,
                'from': prediction.smallest,
                'not_told_from': list(prediction.alternatives),
                'most_alike': None if prediction.nearest is None else prediction.nearest[0],
                'own_share_beside_it': None if prediction.nearest is None else prediction.nearest[1],
            }
            for prediction in plan.effects
        ],
    }


def picture(plan: Planned) -> str:
    """Return the first round as an SVG: displacement and set-points over time."""
    proposal = plan.proposal
    count = len(plan.segments)
    end = proposal.segments[count][1] + 1 if len(proposal.segments) > count else proposal.times.size
    times = proposal.times[:end]
    changes = np.repeat(times, 2)[1:]
    levels = [
        Curve(changes, np.repeat(1e-3 * level, 2)[:-1], colour, 1.6)
        for level, colour in zip(proposal.held[:end].T, _COLOURS.values())
    ]
    named = ', '.join(f'{name} {word}' for name, word in zip(CYLINDERS, _COLOURS))
    panels = (
        Panel('displacement [mm]', 150, [Curve(times, 1e3 * proposal.displacement[:end], 'currentColor')]),
        Panel(f'set-point, gauge [kPa]: {named}', 150, levels),
    )
    marks = [float(proposal.times[index]) for _, index in proposal.segments[:count]]
    extent = f'one round of {plan.rounds}' if plan.rounds > 1 else 'all of it'
    span = float(times[0]), float(times[-1])
    return svg(Chart(panels, span, f'time [s], {extent}', f'{_PICTURED}{extent}', marks=marks), _WIDTH)
