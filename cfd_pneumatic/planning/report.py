# SPDX-License-Identifier: Apache-2.0
"""A plan for people and for programs: tables for the terminal, JSON, and a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cfd_pneumatic.convention import CYLINDERS, SCHEDULE_COLUMNS
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.planning.names import PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE
from cfd_pneumatic.planning.prediction import EffectPrediction, ParameterPrediction, Planned
from cfd_pneumatic.svg import Curve, Panel, chart
from cfd_pneumatic.terminal import table

SCHEMA = 1

_COLOURS = {'blue': '#0a5fc2', 'orange': '#c2500f'}


_is_plan = marked(r'\A\{\s*"schema": \d+,\s*"duration_s": ')
_begins_at_rest = marked(rf'\A{",".join(SCHEDULE_COLUMNS)}\n0\.0,0\.0,0\.0,')


def _is_schedule(path: Path) -> bool:
    """Return whether a table is a plan's: people write such tables, too, but not beside a plan."""
    return _begins_at_rest(path) and _is_plan(path.with_name(PLAN_FILE))


_PICTURED = 'the schedule, '

FILES = ResultFiles(
    {PICTURE_FILE: marked(f'\\A<svg [^>]*aria-label="{_PICTURED}'), PLAN_FILE: _is_plan, SCHEDULE_FILE: _is_schedule}
)
"""How the files of a plan are recognised."""


def write_plan(plan: Planned, folder: Path, *, overwrite: bool = False) -> list[Path]:
    """
    Write the schedule, the plan as JSON and the picture into a folder, made if need be.

    Parameters
    ----------
    plan, folder
        What, and where to.
    overwrite
        Whether files of these names are replaced that this program did not write.

    Raises
    ------
    InputError
        If the folder can't be written, or a file in it is not to be replaced.

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
    """Print what is to be done and what it will tell."""
    proposal = plan.proposal
    console.print(
        f'{proposal.times[-1]:.1f} s in {plan.rounds} round{"s" if plan.rounds > 1 else ""}, each of: '
        f'{"; ".join(_counted(plan))}.'
    )
    console.print(_parameter_table(plan.parameters))
    for channel, effects in groupby(plan.effects, key=lambda one: one.channel):
        console.print(_effect_table(channel, list(effects)))


def _counted(plan: Planned) -> list[str]:
    """Return the segments of a round, neighbours of one kind together."""
    counted = [(name, len(list(same))) for name, same in groupby(plan.segments, key=lambda one: one.name)]
    return [name if count == 1 else f'{count} times {name}' for name, count in counted]


def _parameter_table(parameters: Sequence[ParameterPrediction]) -> Table:
    headings = ('channel', 'parameter', 'value', 'standard error', '% of value', 'unit')
    title = 'predicted standard errors (Cramer-Rao, white noise)'
    made = table(title, *headings, words=('channel', 'parameter', 'unit'))
    for one in parameters:
        if one.std is None or not one.identifiable:
            made.add_row(one.channel, one.name, f'{one.value:.4g}', 'not identifiable', '', one.unit)
        else:
            share = f'{100.0 * one.std / abs(one.value):.2g}'
            made.add_row(one.channel, one.name, f'{one.value:.4g}', f'{one.std:.2g}', share, one.unit)
    return made


def _effect_table(channel: str, effects: Sequence[EffectPrediction]) -> Table:
    headings = ('effect', 'shows', 'from', 'not to be told from', 'most alike, share of its own beside it')
    made = table(f'{channel}: effects that would show', *headings, words=headings)
    for one in effects:
        nearest = '' if one.nearest is None else f'{one.nearest[0]}: {100.0 * one.nearest[1]:.0f} %'
        rivals = ', '.join(one.alternatives)
        made.add_row(one.effect, 'yes' if one.shows else 'no', smallest_words(one), rivals, nearest)
    return made


def smallest_words(one: EffectPrediction) -> str:
    """Return the strength at which an effect just shows."""
    if not one.smallest:
        return '' if one.smallest is None else 'any strength'
    units = {parameter.name: parameter.unit for parameter in EFFECTS[one.effect].parameters}
    return ', '.join(f'{name} {value:.2g} {units[name]}' for name, value in one.smallest.items())


def plan_data(plan: Planned) -> dict[str, Any]:
    """Return a plan as JSON types, numbers in SI units."""
    proposal = plan.proposal
    return {
        'schema': SCHEMA,
        'duration_s': float(proposal.times[-1]),
        'rounds': plan.rounds,
        'segments': [{'from_s': float(proposal.times[at]), 'what': name} for name, at in proposal.segments],
        'parameters': [
            {
                'channel': one.channel,
                'name': one.name,
                'unit': one.unit,
                'value': one.value,
                'std': one.std,
                'identifiable': one.identifiable,
            }
            for one in plan.parameters
        ],
        'effects': [
            {
                'channel': one.channel,
                'effect': one.effect,
                'shows': one.shows,
                'from': one.smallest,
                'not_told_from': list(one.alternatives),
                'most_alike': None if one.nearest is None else one.nearest[0],
                'own_share_beside_it': None if one.nearest is None else one.nearest[1],
            }
            for one in plan.effects
        ],
    }


def picture(plan: Planned) -> str:
    """Return the first round as an SVG: displacement and set-points over time."""
    proposal = plan.proposal
    count = len(plan.segments)
    end = proposal.segments[count][1] + 1 if len(proposal.segments) > count else proposal.times.size
    times = proposal.times[:end]
    changes = np.repeat(times, 2)[1:]
    held = [
        Curve(changes, np.repeat(1e-3 * level, 2)[:-1], colour, 1.6)
        for level, colour in zip(proposal.held[:end].T, _COLOURS.values())
    ]
    named = ', '.join(f'{name} {word}' for name, word in zip(CYLINDERS, _COLOURS))
    panels = (
        Panel('displacement [mm]', 150, [Curve(times, 1e3 * proposal.displacement[:end], 'currentColor')]),
        Panel(f'set-point, gauge [kPa]: {named}', 150, held),
    )
    marks = [float(proposal.times[at]) for _, at in proposal.segments[:count]]
    what = f'one round of {plan.rounds}' if plan.rounds > 1 else 'all of it'
    return chart(
        panels, 1000, (float(times[0]), float(times[-1])), f'time [s], {what}', f'{_PICTURED}{what}', marks=marks
    )
