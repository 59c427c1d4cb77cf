# SPDX-License-Identifier: Apache-2.0
"""`plan.html`: the schedule as a plot, and what a recording of it will show."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np

from cfd_pneumatic import __version__
from cfd_pneumatic.charts import Chart, Curve, Panel, plot_scripts, svg
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.identification import title
from cfd_pneumatic.planning.names import SCHEDULE_FILE
from cfd_pneumatic.planning.prediction import Planned
from cfd_pneumatic.planning.texts import segment_texts, smallest_strength_text
from cfd_pneumatic.reporting import rendered

TEMPLATES = Path(__file__).parent / 'templates'
TEMPLATE = 'plan.html.jinja'

PICTURE_LABEL = 'the schedule, '
"""Begin of the label of the picture."""

_WIDTH = 1000.0  # of the picture [CSS px]
_NAMED_COLOURS = {'blue': '#0a5fc2', 'orange': '#c2500f'}
_PAGE_COLOURS = ('var(--after)', 'var(--before)')


def plan_page(plan: Planned) -> str:
    """Return the page of a plan: schedule, predicted standard errors, and visible effects."""
    shown = {channel: list(effects) for channel, effects in groupby(plan.effects, key=lambda effect: effect.channel)}
    return rendered(
        TEMPLATE,
        TEMPLATES,
        scripts=plot_scripts(),
        version=__version__,
        chart=_chart(plan, _PAGE_COLOURS),
        duration=float(plan.proposal.times[-1]),
        rounds=plan.rounds,
        segments=segment_texts(plan),
        parameters=plan.parameters,
        effects=[(title(channel), effects) for channel, effects in shown.items()],
        strength=smallest_strength_text,
        schedule=SCHEDULE_FILE,
    )


def picture(plan: Planned) -> str:
    """Return the first round as an SVG: displacement and set-points over time."""
    return svg(_chart(plan, tuple(_NAMED_COLOURS.values())), _WIDTH)


def _chart(plan: Planned, colours: tuple[str, ...]) -> Chart:
    """Return the chart of the first round."""
    proposal = plan.proposal
    count = len(plan.segments)
    end = proposal.segments[count][1] + 1 if len(proposal.segments) > count else proposal.times.size
    times = proposal.times[:end]
    changes = np.repeat(times, 2)[1:]
    levels = [
        Curve(changes, np.repeat(1e-3 * level, 2)[:-1], colour, 1.6, name=name.replace('_', ' '))
        for name, level, colour in zip(CYLINDERS, proposal.held[:end].T, colours)
    ]
    named = ', '.join(f'{name} {word}' for name, word in zip(CYLINDERS, _NAMED_COLOURS))
    motion = Curve(times, 1e3 * proposal.displacement[:end], 'currentColor', name='displacement')
    panels = (Panel('displacement [mm]', 150, [motion]), Panel(f'set-point, gauge, {named} [kPa]', 150, levels))
    marks = [float(proposal.times[index]) for _, index in proposal.segments[:count]]
    extent = f'one round of {plan.rounds}' if plan.rounds > 1 else 'all of it'
    span = float(times[0]), float(times[-1])
    return Chart(
        panels,
        span,
        'time [s]',
        f'{PICTURE_LABEL}{extent}',
        f'The schedule, {extent}. Dotted lines: begins of the segments.',
        marks=marks,
    )
