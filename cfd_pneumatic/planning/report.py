# SPDX-License-Identifier: Apache-2.0
"""Report a plan: tables for the terminal, JSON for programs, and files for people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.planning.names import PAGE_FILE, PICTURE_FILE, PLAN_FILE, SCHEDULE_FILE
from cfd_pneumatic.planning.page import PICTURE_LABEL, picture, plan_page
from cfd_pneumatic.planning.prediction import EffectPrediction, ParameterPrediction, Planned
from cfd_pneumatic.planning.texts import segment_texts, smallest_strength_text
from cfd_pneumatic.reporting import is_page
from cfd_pneumatic.terminal import table

SCHEMA = 1

_EFFECT_HEADINGS = (
    'effect',
    'detectable\nat the\nstarting\nstrength',
    'detectable from',
    'not distin-\nguishable from',
    'most similar effect',
    'share that\ndiffers',
)
_STARTING_STRENGTH = 'Starting strength of an effect: the strength at which the search of identify_bag begins.'

_is_plan = marked(r'\A\{\s*"schema": \d+,\s*"duration_s": ')
_begins_at_rest = marked(rf'\A{",".join(SCHEDULE_COLUMNS)}\n0\.0,0\.0,0\.0,')


def _is_schedule(path: Path) -> bool:
    """Return whether a table belongs to a plan: a table by the user is not next to a plan."""
    return _begins_at_rest(path) and _is_plan(path.with_name(PLAN_FILE))


FILES = ResultFiles(
    {
        PICTURE_FILE: marked(f'\\A<svg [^>]*aria-label="{PICTURE_LABEL}'),
        PAGE_FILE: is_page,
        PLAN_FILE: _is_plan,
        SCHEDULE_FILE: _is_schedule,
    }
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
        PAGE_FILE: plan_page(plan),
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
    rounds, subject = ('1 round', 'The round') if plan.rounds == 1 else (f'{plan.rounds} rounds', 'Each round')
    console.print(
        f'The schedule has {rounds} and takes {proposal.times[-1]:.1f} s. {subject}: {"; ".join(segment_texts(plan))}. '
        'Percent: shares of the stroke and of the pressure range.'
    )
    console.print(_parameter_table(plan.parameters))
    if plan.effects:
        console.print(_STARTING_STRENGTH)
    for channel, effects in groupby(plan.effects, key=lambda prediction: prediction.channel):
        console.print(_effect_table(channel, list(effects)))


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
    rows = table(f'{channel}: detectable effects', *_EFFECT_HEADINGS, words=_EFFECT_HEADINGS[:-1])
    for column in rows.columns:
        column.no_wrap = column.header != 'detectable from'
    for prediction in effects:
        nearest = prediction.nearest
        similar, share = ('', '') if nearest is None else (nearest[0], f'{100.0 * nearest[1]:.0f} %')
        rivals = ',\n'.join(prediction.alternatives)
        shows = 'yes' if prediction.shows else 'no'
        rows.add_row(prediction.effect, shows, smallest_strength_text(prediction), rivals, similar, share)
    return rows


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
