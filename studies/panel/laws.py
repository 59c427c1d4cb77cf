# SPDX-License-Identifier: Apache-2.0
"""
How often a law that is in no library is drawn where it enters: `make benchmark-laws`.

Laws of the rig (`studies/panel/strange.py`), on devices of the paper's law and with all of their physics, whoever looks
for them knows none; and effects of the library that is searched without them. A law is *visible* where a device without
it leaves 1.15 times as much as the true one, and *remains* where the better core, fitted anew, still leaves 1.1 times
as much.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from itertools import chain, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cfd_pneumatic.arrays import rms
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import PARTS, Options, close_loop, identify, readable_name, with_core
from cfd_pneumatic.recording import recording_of
from studies.documents.markdown import table
from studies.panel import (
    CLASSES,
    LIBRARY,
    MAKES,
    STRANGE,
    STRANGE_FORCE,
    baseline_rmse,
    draw,
    force_baseline_rmse,
    force_oracle_residual,
    force_oracle_rmse,
    oracle_residual,
    oracle_rmse,
)
from studies.panel.law_curves import nearness
from studies.panel.rows import CYLINDER, VISIBLE, cylinder_a_of
from studies.panel.scores import share
from studies.tools.processes import side_by_side
from studies.tools.provenance import ROOT, commit

FORCE = 'force'

LAWS = {CYLINDER: tuple(name for name in CLASSES if name not in STRANGE_FORCE), FORCE: STRANGE_FORCE}
"""Those of the pressure, and of the force; a healthy device is asked for both."""

LEFT_OUT = {
    'leakage': {('chamber', 'p'), ('flow', 'p'), ('set_point', 'p')},
    'positional_leakage': {('chamber', 'x'), ('set_point', 'x')},
    'valve_dead_band': {('flow', 'error'), ('set_point', 'error')},
    'nonlinear_valve': {('flow', 'error'), ('set_point', 'error')},
    'flow_saturation': {('flow', 'error'), ('flow', 'flow'), ('set_point', 'error')},
    'operating_point': {('gain', 'p'), ('flow', 'p'), ('stiffness', 'p')},
    'volume_variation': {('gain', 'x'), ('flow', 'x'), ('stiffness', 'x')},
    'set_point_drift': {('set_point', 'time')},
    'droop': {('set_point', 'flow'), ('set_point', 'error'), ('flow', 'flow')},
}
"""Effects of the library that are laws: where each enters, and against what, as far as recordings can tell."""

MEMORIES = tuple(name for name in LIBRARY if name not in LEFT_OUT)
"""Those with a memory, and a supply that swings as a hum does: no law of what is measured is either."""

FIRST_SEED = 17005
"""Of the report; 0 to 999 are for developing, 7000 to 17004 were reported."""

REMAINS = 1.1
"""Error of the better core without a law, against the true device's, from which a law remains [-]."""

NEAR = 0.05
"""Error of a curve, as a share of its range, that is asked for [-]."""

SCHEDULES = ('out_and_back', 'surface_following')


class Job(NamedTuple):
    """One recording; without a law it is of a healthy device."""

    law: str
    channel: str
    whole: bool
    schedule: str
    seed: int


def measure(job: Job) -> dict[str, Any]:
    """Draw a recording, identify it, and return what came of it; an effect of the library is looked for without it."""
    make = list(MAKES)[job.seed % len(MAKES)] if job.whole else None
    on_force = job.channel == FORCE
    healthy, true = (force_baseline_rmse, force_oracle_rmse) if on_force else (baseline_rmse, oracle_rmse)
    row: dict[str, Any] = {**job._asdict()}
    try:
        drawn = draw(job.law or None, job.schedule, job.seed, make=make)
        row['visible'] = healthy(drawn) / true(drawn)
        recording = recording_of(drawn.recording) if on_force else cylinder_a_of(drawn)
        began = time.perf_counter()
        identification = identify([recording], Options(close_loop=False))
        result = identification.channels[job.channel]
        result.channel.library = {name: own for name, own in result.channel.library.items() if name != job.law}
        found, conclusion = close_loop(result.fit)
        seconds = time.perf_counter() - began
        cores = [result.fit, with_core(result.fit)]
    except InputError as error:
        return {'visible': 0.0, **row, 'verdict': 'refused', 'why': str(error)}
    except Exception as error:  # counted as a failure: one recording must not end the run
        return {'visible': math.inf, **row, 'verdict': 'refused', 'why': f'{type(error).__name__}: {error}'}
    (experiment,) = result.experiments
    judged = experiment.part == PARTS.index('test')
    of_oracle = identification.splits[0].part_of(recording.displacement.times) == PARTS.index('test')
    left = rms((force_oracle_residual if on_force else oracle_residual)(drawn)[of_oracle])
    law = conclusion.unknown
    near = nearness(law, job.law, drawn) if law is not None and job.law else None
    return {
        **row,
        'verdict': conclusion.verdict,
        'effects': conclusion.effects,
        'places': [] if law is None else [(law.enters, law.against), *law.alternatives],
        'formulas': [] if law is None else [one.text for one in law.formulas],
        'near': None if near is None else near._asdict(),
        'after': rms((experiment.measured - found.simulated[0])[judged]) / left,
        'remains': min(rms((experiment.measured - one.simulated[0])[judged]) for one in cores) / left,
        'seconds': seconds,
    }


def is_right(row: dict[str, Any]) -> bool:
    """Return whether the place and the variable are among those that were named."""
    named = {('chamber' if enters.startswith('leak') else enters, against) for enters, against in row.get('places', ())}
    return bool(named & {**CLASSES, **LEFT_OUT}.get(row['law'], set()))


def _is_called_static(row: dict[str, Any]) -> bool:
    """Return whether a law was found that has no memory: one of the lagged flow has."""
    return row['verdict'] == 'shape_found' and row['places'][0][1] != 'flow'


def _is_explained(row: dict[str, Any]) -> bool:
    """Return whether effects of the library leave hardly more than the true device, and so are preferred."""
    return row['verdict'] == 'effect_added' and bool(row['after'] <= REMAINS)


def report(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of what came of recordings."""
    lines = []
    shown = [row for row in rows if row['law'] and row['visible'] > VISIBLE]
    seen = [row for row in shown if row['law'] not in MEMORIES]
    remaining = [row for row in seen if row.get('remains', np.inf) > REMAINS]
    groups = [(name, [row for row in shown if row['law'] == name]) for name in (*chain(*LAWS.values()), *LIBRARY)]
    groups = [(name, own) for name, own in groups if own]
    groups += [
        (
            f'all of {readable_name(channel)}, {what}',
            [row for row in seen if (row['channel'], row['whole']) == (channel, whole)],
        )
        for channel, (what, whole) in product(LAWS, KINDS)
    ]
    groups += [
        ('effects of the library, without memory', [row for row in seen if row['law'] in LEFT_OUT]),
        ('effects of the library, with memory', [row for row in shown if row['law'] in MEMORIES]),
        ('all without memory', seen),
        ('of these, that remain', remaining),
        ('of these, that effects of the library do not explain', [row for row in remaining if not _is_explained(row)]),
    ]
    for name, own in groups:
        lines.append(
            (
                name,
                share(own, lambda row: row['verdict'] == 'shape_found'),
                share(own, is_right),
                share(own, lambda row: row.get('after', np.inf) <= 1.1),
                share(own, lambda row: row['verdict'] == 'effect_added'),
            )
        )
    heading = (
        'law',
        'drawn',
        'where and against what right',
        'error at most 1.1 of the true device’s',
        'named otherwise',
    )
    curves = [row['near'] for row in seen if row.get('near') and is_right(row)]
    covered, points = (sum(near[name] for near in curves) for name in ('covered', 'points'))
    near = share(curves, lambda one: one['error'] <= NEAR)
    clean = share([row for row in rows if not row['law']], lambda row: row['verdict'] == 'shape_found')
    static = share([row for row in shown if row['law'] in MEMORIES], _is_called_static)
    longest = max((row.get('seconds', 0.0) for row in rows), default=0.0)
    return (
        f'{table(heading, lines)}\n\nCurves in the law’s own place that are within {100 * NEAR:.0f} % of its range: '
        f'{near}; their bands cover it at {covered} of {points} visited points. Drawn of healthy devices: {clean}. '
        f'Effects with a memory called a law without one: {static}. '
        f'The longest took {longest:.0f} s. {commit()}.'
    )


KINDS = (('the paper’s law', False), ('all of their physics', True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(prog='laws', description=__doc__.split('\n\n')[0])
    parser.add_argument('--seeds', type=int, default=6, help='recordings of each law, schedule and kind of device')
    parser.add_argument('--first', type=int, default=FIRST_SEED, help='seed')
    known = (*chain(*LAWS.values()), '')
    parser.add_argument('--laws', nargs='+', choices=known, default=known, help='which; empty: healthy')
    parser.add_argument('--left-out', action='store_true', help='effects of the library instead, without them')
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'laws.jsonl', help='file of what came of each')
    options = parser.parse_args(arguments)
    assert set(chain(*LAWS.values())) == STRANGE.keys()
    asked = [(law, channel) for channel, own in LAWS.items() for law in (*own, '') if law in options.laws]
    if options.left_out:
        asked = [(name, CYLINDER) for name in LIBRARY]
    jobs = [
        Job(law, channel, whole, schedule, options.first + seed)
        for seed, (law, channel), (_, whole), schedule in product(range(options.seeds), asked, KINDS, SCHEDULES)
    ]
    rows = []
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    with options.rows.open('w') as stream:
        for row in side_by_side(measure, jobs, 'recordings', options.jobs):
            rows.append(row)
            stream.write(json.dumps(row) + '\n')
            stream.flush()
    print(report(rows))
    return 0


if __name__ == '__main__':
    sys.exit(main())
