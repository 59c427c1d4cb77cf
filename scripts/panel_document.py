"""What came of the panel, in Markdown, and its confusion matrices."""

from __future__ import annotations

import collections
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from documents import NOTES, table
from panel_rows import FIRST_SEED, KINDS, SCHEDULES, VISIBLE, Row
from panel_scores import FLOOR_TOLERANCE, GROUPS, RIGHT, answer, found_both, goals, listed, share

from cfd_pneumatic.rig.panel import FOREIGN, LIBRARY, NOISES, ON_FORCE


def document(rows: Sequence[Row], how: Mapping[str, str], picture: str | None, notes: str) -> str:
    """Return the document in Markdown."""
    drawn = [row for row in rows if row.verdict != 'not_drawn']
    sections = [
        '# The panel of effects\n\n'
        'How often the loop names the effect that is in a recording which it knows nothing else of. Written by '
        f'`{how["command"]}`; what stands under "{NOTES.strip("# ")}" at the end is kept.',
        _how_section(rows, drawn, how),
        _goals_section(drawn),
    ]
    if picture is not None and any(row.kind in ('effects', 'foreign') for row in drawn):
        sections.append(f'![confusion matrices]({picture})')
    for schedule in SCHEDULES:
        sections += _confusion_section([row for row in drawn if row.schedule == schedule], schedule)
    sections += [
        *_unknown_section([row for row in drawn if row.kind == 'foreign'], 'foreign', 'Effects outside the library'),
        *_unknown_section(
            [row for row in drawn if row.kind == 'leave_one_out'], 'leave_one_out', 'The true effect not in the library'
        ),
        *_clean_section([row for row in drawn if row.kind == 'clean']),
        *_pairs_section([row for row in drawn if row.kind == 'pairs']),
        *_force_section([row for row in drawn if row.kind in ('force', 'clean_force')]),
        _errors_section(drawn),
        _listed_section(),
        *_refused_section(drawn),
        notes or NOTES,
    ]
    return '\n\n'.join(sections).rstrip() + '\n'


def _how_section(rows: Sequence[Row], drawn: Sequence[Row], how: Mapping[str, str]) -> str:
    lines = []
    for kind in KINDS:
        some = [row for row in drawn if row.kind == kind]
        if some:
            counts = collections.Counter(row.schedule for row in some)
            seeds = [row.seed for row in some]
            lines.append([f'`{kind}`', f'{min(seeds)} to {max(seeds)}', *(counts[one] for one in SCHEDULES), len(some)])
    versions = collections.Counter((row.commit, row.code) for row in drawn)
    measured_by = '; '.join(
        f'commit {name} (program text {code}): {count} recordings' for (name, code), count in versions.items()
    )
    left_out = sum(row.verdict == 'not_drawn' for row in rows)
    excluded = (
        f' {left_out} pairs whose effects are one and the same part of the rig were left out.' if left_out else ''
    )
    return (
        '## How it was measured\n\n'
        f'- Command: `{how["command"]}`\n'
        f'- Machine: {how["machine"]}\n'
        f'- Measured by {measured_by or "nothing yet"}\n'
        f'- {len(drawn)} recordings.{excluded}\n\n'
        + table(['kind', 'seeds', *(f'`{one}`' for one in SCHEDULES), 'recordings'], lines)
        + '\n\nThe seed draws the device, the schedule, the strength and the noise; seeds below '
        f'{FIRST_SEED} were used while developing. The *oracle floor* is the RMSE that the true device, driven by the '
        "measured displacement, leaves on the same samples. A draw is *visible* where the paper's model, refitted, "
        f'leaves more than {VISIBLE} of it. Shares have 95 % intervals (Wilson).'
    )


def _goals_section(rows: Sequence[Row]) -> str:
    lines = [
        [goal.what, goal.wanted, goal.measured, goal.recordings, 'yes' if goal.met else '**no**']
        for goal in goals(rows)
    ]
    return '## Goals\n\n' + table(['goal', 'wanted', 'measured', 'recordings', 'met'], lines)


def _confusion_section(rows: Sequence[Row], schedule: str) -> list[str]:
    lines = []
    for effect in LIBRARY:
        some = [row for row in rows if row.kind == 'effects' and row.effects == (effect,)]
        if some:
            lines.append(_confusion_line(f'`{effect}`', some))
    every = [row for row in rows if row.kind == 'effects']
    if not every:
        return []
    lines.append(_confusion_line('**all**', every))
    return [
        f'## `{schedule}`: effect by answer\n\n'
        'By the first name among visible draws. *Nobody could see*: draws of which no method could tell, and the names '
        'that some got all the same. *Listed alternative*: the effect is named as one of those that the recording '
        "can't tell from the first name, and the pair is listed below. *No name*: none missing / `unexplained` / "
        'refused. *Before* and *after*: RMSE on the test part over the oracle floor, median / 90th '
        'percentile of visible draws.\n\n' + table(['effect', *ANSWERED], lines)
    ]


ANSWERED = (
    'draws',
    'nobody could see',
    'visible',
    'right',
    'listed alternative',
    'other',
    'no name',
    'named instead',
    'more than the one',
    '`unexplained` beside a name',
    'before',
    'after',
)
"""Columns of `_confusion_line` behind the first."""


def _confusion_line(label: str, rows: Sequence[Row]) -> list[object]:
    hidden = [row for row in rows if not row.visible]
    seen = [row for row in rows if row.visible]
    answers = collections.Counter(answer(row) for row in seen)
    silent = collections.Counter(row.verdict for row in seen if not row.named)
    others = [row for row in seen if answer(row) in ('unlisted alternative', 'wrong name')]
    false = [row for row in hidden if answer(row) not in (*RIGHT, 'no name')]
    named = [row for row in seen if row.named]
    return [
        label,
        len(rows),
        str(len(hidden)) + (f' ({_names(false)})' if false else ''),
        len(seen),
        answers['right'],
        answers['listed alternative'],
        len(others),
        ' / '.join(str(silent[verdict]) for verdict in ('no_missing_effect', 'unexplained', 'refused')),
        _names(others),
        sum(len(row.named) > 1 for row in named),
        sum(row.verdict == 'unexplained' for row in named),
        _spread(row.before_test for row in seen),
        _spread(row.after_test for row in seen),
    ]


def _names(rows: Iterable[Row]) -> str:
    counts = collections.Counter(row.named[0] for row in rows)
    return ', '.join(f'{name} {count}' for name, count in counts.most_common())


def _spread(values: Iterable[float]) -> str:
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return '-'
    return f'{np.median(finite):.2f} / {np.quantile(finite, 0.9):.2f}'


def _unknown_section(rows: Sequence[Row], kind: str, title: str) -> list[str]:
    """Return how recordings were answered whose effect the library doesn't have."""
    if not rows:
        return []
    lines = []
    for schedule, name in itertools.product(SCHEDULES, FOREIGN if kind == 'foreign' else LIBRARY):
        some = [row for row in rows if row.schedule == schedule and row.effects == (name,)]
        if some:
            lines.append(_unknown_line([f'`{schedule}`', f'`{name}`'], some))
    for schedule in SCHEDULES:
        some = [row for row in rows if row.schedule == schedule]
        if some:
            lines.append(_unknown_line([f'`{schedule}`', '**all**'], some))
    lines.append(_unknown_line(['all', '**all**'], rows))
    header = ['schedule', 'effect', 'draws', 'nobody could see', 'visible', 'unexplained', 'share']
    header += ['of these beside a name', 'none missing', 'named', 'of these a listed rival', 'after']
    return [
        f'## {title}\n\nThe right answer is `unexplained`. *Named*: `effect_added`, among visible draws; a *listed '
        'rival* is one that is listed below as not to be separated from the true one by data.\n\n'
        + table(header, lines)
    ]


def _unknown_line(label: Sequence[str], rows: Sequence[Row]) -> list[object]:
    seen = [row for row in rows if row.visible]
    added = [row for row in seen if row.verdict == 'effect_added']
    unexplained = share(seen, lambda row: row.verdict == 'unexplained')
    return [
        *label,
        len(rows),
        len(rows) - len(seen),
        len(seen),
        unexplained.count,
        unexplained,
        sum(row.verdict == 'unexplained' and bool(row.named) for row in seen),
        sum(row.verdict == 'no_missing_effect' for row in seen),
        f'{len(added)}' + (f': {_names(added)}' if added else ''),
        sum(listed(row.named[0], row.effects[0]) for row in added),
        _spread(row.after_test for row in seen),
    ]


def _clean_section(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    lines = []
    for noise, schedule in itertools.product(NOISES, (*SCHEDULES, None)):
        some = [row for row in rows if row.effects == (noise,) and schedule in (None, row.schedule)]
        if some:
            named = [row for row in some if row.named]
            lines.append(
                [
                    noise,
                    f'`{schedule}`' if schedule else '**all**',
                    len(some),
                    len(named),
                    share(some, lambda row: bool(row.named)),
                    _names(named),
                    sum(row.verdict == 'unexplained' for row in some),
                    _spread(row.after_test for row in some),
                ]
            )
    header = [
        'noise',
        'schedule',
        'recordings',
        'with a name',
        'share',
        'names',
        '`unexplained`',
        'error over the floor',
    ]
    return [
        "## Nothing missing\n\nThe paper's model itself, integrated apart, with white noise, with noise that remembers "
        '(AR 0.9), and with little beside the steps of the converter.\n\n' + table(header, lines)
    ]


def _force_section(rows: Sequence[Row]) -> list[str]:
    """Return how the loop on the contact force answered."""
    lines = []
    for schedule, effect in itertools.product(SCHEDULES, ON_FORCE):
        some = [row for row in rows if row.schedule == schedule and row.effects == (effect,)]
        if some:
            lines.append([f'`{schedule}`', *_confusion_line(f'`{effect}`', some)])
    clean = [row for row in rows if row.kind == 'clean_force']
    if not rows:
        return []
    named = [row for row in clean if row.named]
    unexplained = sum(row.verdict == 'unexplained' for row in clean)
    return [
        '## The contact force\n\nDevices whose pressures are as the model has them, with one effect on the measured '
        'force; the piston area is given. Columns as above.\n\n'
        + table(['schedule', 'effect', *ANSWERED], lines)
        + f'\n\nOf {len(clean)} recordings of devices with no effect {len(named)} get a name'
        + (f' ({_names(named)})' if named else '')
        + f', {unexplained} end `unexplained`.'
    ]


def _pairs_section(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    lines = []
    for schedule in (*SCHEDULES, None):
        some = [row for row in rows if schedule in (None, row.schedule)]
        seen = [row for row in some if row.both_visible]
        if some:
            lines.append(
                [
                    f'`{schedule}`' if schedule else '**all**',
                    len(some),
                    len(seen),
                    share(seen, found_both),
                    share(seen, lambda row: len(row.named) == 2 and found_both(row)),
                    share(seen, lambda row: found_both(row, alternatives=True)),
                    share(seen, lambda row: len(row.named) == 2 and found_both(row, alternatives=True)),
                    share(seen, lambda row: row.verdict == 'unexplained'),
                    _spread(row.after_test for row in seen),
                ]
            )
    missed = [row for row in rows if row.both_visible and not found_both(row)]
    details = [
        [
            f'`{row.schedule}`',
            row.seed,
            ' + '.join(row.effects),
            ' / '.join(f'{row.beside[name]:.2f}' if name in row.beside else '-' for name in row.effects),
            ' + '.join(_with_alternatives(row)) or row.verdict,
            f'{row.after_test:.2f}',
        ]
        for row in sorted(missed, key=lambda row: (SCHEDULES.index(row.schedule), row.seed))
    ]
    header = ['schedule', 'recordings', 'both show', 'both found', 'exactly the two']
    header += ['both, listed alternatives too', 'exactly, listed alternatives too', '`unexplained`', 'after']
    text = (
        '## Two effects at once\n\nCounted where each effect shows beside the other: the model with only one of them, '
        f'refitted, leaves more than {VISIBLE} of the oracle floor.\n\n' + table(header, lines)
    )
    if details:
        shown = table(['schedule', 'seed', 'effects', 'each shows', 'named', 'after'], details)
        text += f'\n\nPairs of which not both were found:\n\n{shown}'
    return [text]


def _with_alternatives(row: Row) -> list[str]:
    return [
        name + (f' (or {", ".join(row.alternatives[name])})' if row.alternatives.get(name) else '')
        for name in row.named
    ]


def _errors_section(rows: Sequence[Row]) -> str:
    lines = []
    for kind, schedule in itertools.product(KINDS, SCHEDULES):
        some = [row for row in rows if row.kind == kind and row.schedule == schedule and math.isfinite(row.after)]
        seen = [row for row in some if row.visible or kind.startswith('clean')]
        if some:
            lines.append(
                [
                    f'`{kind}`',
                    f'`{schedule}`',
                    len(some),
                    _spread(row.before_test for row in seen),
                    _spread(row.after_test for row in seen),
                    'test part' if any(row.tested for row in some) else 'whole recording',
                    ' / '.join(f'{np.quantile([row.noise for row in some], one):.3f}' for one in (0.05, 0.5, 0.95)),
                    share(some, lambda row: abs(row.noise - 1.0) <= FLOOR_TOLERANCE),
                    ' / '.join(f'{np.quantile([row.seconds for row in some], one):.1f}' for one in (0.5, 0.9)),
                ]
            )
    header = ['kind', 'schedule', 'recordings', 'before', 'after', 'on', "noise floor over the oracle's", 'within 5 %']
    header.append('time [s]')
    return (
        '## Errors, noise floor, time\n\n'
        '*Before* and *after* over the oracle floor, median / 90th percentile of visible draws, of all where nothing '
        'is missing. A single step has no test part. The noise floor as quantiles 5 %, 50 %, 95 %; the time of an '
        'identification in one process with one thread, median / 90th percentile.\n\n' + table(header, lines)
    )


def _listed_section() -> str:
    lines = [[title, ', '.join(f'`{name}`' for name in names)] for title, names in GROUPS]
    return (
        '## Listed pairs\n\nEffects that data may not separate. Only among these an alternative counts as right.\n\n'
        + table(['family', 'effects'], lines)
    )


def _refused_section(rows: Sequence[Row]) -> list[str]:
    refused = [row for row in rows if row.verdict == 'refused']
    if not refused:
        return []
    lines = [[f'`{row.kind}`', ' + '.join(row.effects), f'`{row.schedule}`', row.seed, row.why] for row in refused]
    return [
        '## Refused\n\nRecordings that were not identified; they count as visible and as answered without a name.\n\n'
        + table(['kind', 'effect', 'schedule', 'seed', 'why'], lines)
    ]


def picture_of(rows: Sequence[Row]) -> str | None:
    """Return the confusion matrices of visible draws as SVG, a panel for each schedule; None where there are none."""
    import io

    import matplotlib
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.kind in ('effects', 'foreign') and row.visible]
    if not shown:
        return None
    truths = [name for name in (*LIBRARY, *FOREIGN) if any(row.effects == (name,) for row in shown)]
    names = [*LIBRARY, 'none missing', 'unexplained', 'refused']
    schedules = [one for one in SCHEDULES if any(row.schedule == one for row in shown)]
    with matplotlib.rc_context({'svg.hashsalt': 'panel', 'svg.fonttype': 'none', 'font.size': 8.0}):
        figure = Figure(figsize=(8.5, (1.8 + 0.24 * len(truths)) * len(schedules)), layout='constrained')
        for axes, schedule in zip(figure.subplots(len(schedules), squeeze=False)[:, 0], schedules):
            counts = np.zeros((len(truths), len(names)))
            for row in shown:
                if row.schedule == schedule:
                    counts[truths.index(row.effects[0]), names.index(_said(row))] += 1
            shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
            axes.imshow(shares, cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto')
            for (line, column), count in np.ndenumerate(counts):
                if count:
                    colour = 'white' if shares[line, column] > 0.6 else 'black'
                    axes.text(column, line, f'{count:.0f}', ha='center', va='center', color=colour)
            axes.set_xticks(range(len(names)), names, rotation=60, ha='right', rotation_mode='anchor')
            axes.set_yticks(range(len(truths)), truths)
            axes.set_title(f'{schedule}: effect in the recording (rows) by first name (columns), visible draws')
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def _said(row: Row) -> str:
    """Return the column that a row belongs to."""
    if row.named:
        return row.named[0]
    return {'no_missing_effect': 'none missing', 'unexplained': 'unexplained'}.get(row.verdict, 'refused')
