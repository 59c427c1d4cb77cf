"""A plan for people and for programs: tables for the terminal, JSON, and a picture."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from rich.console import Console
from rich.table import Table

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.model.effects import EFFECTS
from cfd_pneumatic.planning.plan import EffectPrediction, ParameterPrediction, Plan

SCHEMA = 1


def print_plan(plan: Plan, console: Console) -> None:
    """Print what is to be done and what it will tell."""
    proposal = plan.proposal
    console.print(
        f'{proposal.times[-1]:.1f} s in {plan.rounds} round{"s" if plan.rounds > 1 else ""}, each of: '
        f'{"; ".join(_counted(plan))}.',
        highlight=False,
    )
    console.print(_parameter_table(plan.parameters))
    for channel, effects in groupby(plan.effects, key=lambda one: one.channel):
        console.print(_effect_table(channel, list(effects)))


def _counted(plan: Plan) -> list[str]:
    """Return the segments of a round, neighbours of one kind together."""
    counted = [(name, len(list(same))) for name, same in groupby(plan.segments, key=lambda one: one.name)]
    return [name if count == 1 else f'{count} times {name}' for name, count in counted]


def _parameter_table(parameters: Sequence[ParameterPrediction]) -> Table:
    table = Table(title='predicted standard errors (Cramer-Rao, white noise)', title_justify='left')
    for heading in ('channel', 'parameter', 'value', 'standard error', '% of value', 'unit'):
        table.add_column(heading, justify='left' if heading in ('channel', 'parameter', 'unit') else 'right')
    for one in parameters:
        if one.std is None or not one.identifiable:
            table.add_row(one.channel, one.name, f'{one.value:.4g}', 'not identifiable', '', one.unit)
        else:
            share = f'{100.0 * one.std / abs(one.value):.2g}'
            table.add_row(one.channel, one.name, f'{one.value:.4g}', f'{one.std:.2g}', share, one.unit)
    return table


def _effect_table(channel: str, effects: Sequence[EffectPrediction]) -> Table:
    table = Table(title=f'{channel}: effects that would show', title_justify='left')
    for heading in ('effect', 'shows', 'from', 'not to be told from', 'most alike, share of its own beside it'):
        table.add_column(heading)
    for one in effects:
        nearest = '' if one.nearest is None else f'{one.nearest[0]}: {100.0 * one.nearest[1]:.0f} %'
        rivals = ', '.join(one.alternatives)
        table.add_row(one.effect, 'yes' if one.shows else 'no', smallest_words(one), rivals, nearest)
    return table


def smallest_words(one: EffectPrediction) -> str:
    """Return the strength at which an effect just shows."""
    if not one.smallest:
        return '' if one.smallest is None else 'any strength'
    units = {parameter.name: parameter.unit for parameter in EFFECTS[one.effect].parameters}
    return ', '.join(f'{name} {value:.2g} {units[name]}' for name, value in one.smallest.items())


def plan_data(plan: Plan) -> dict[str, Any]:
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


def plan_text(plan: Plan) -> str:
    """Return `plan_data` as strict JSON."""
    return json.dumps(plan_data(plan), indent=2, allow_nan=False) + '\n'


def picture(plan: Plan) -> bytes:
    """Return the first round as an SVG: displacement and set-points over time."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    proposal = plan.proposal
    count = len(plan.segments)
    end = proposal.segments[count][1] + 1 if len(proposal.segments) > count else proposal.times.size
    times = proposal.times[:end]
    with matplotlib.rc_context({'svg.hashsalt': 'plan', 'font.size': 9}):
        figure = Figure(figsize=(10.0, 4.5), layout='constrained')
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.plot(times, 1e3 * proposal.displacement[:end], color='black', linewidth=1.0)
        upper.set_ylabel('displacement, mm')
        for name, level, style in zip(CYLINDERS, proposal.held[:end].T, ('-', '--')):
            lower.step(times, 1e-3 * level, style, where='post', linewidth=1.0, label=name)
        lower.set_ylabel('set-point, kPa gauge')
        lower.set_xlabel('time, s')
        lower.legend(loc='upper right')
        for axes in (upper, lower):
            axes.grid(alpha=0.3)
            for _, at in proposal.segments[:count]:
                axes.axvline(proposal.times[at], color='grey', linewidth=0.5, alpha=0.5)
        upper.set_title(f'one round of {plan.rounds}' if plan.rounds > 1 else 'all of it', loc='left')
        drawn = io.BytesIO()
        FigureCanvasSVG(figure).print_svg(drawn, metadata={'Date': None})
    return drawn.getvalue()
