# SPDX-License-Identifier: Apache-2.0
"""What came of the panel, in Markdown."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np

from studies.documents.markdown import NOTES, table
from studies.panel import FOREIGN, LIBRARY, MAKES, NOISES, ON_FORCE, OWN_WAYS
from studies.panel.rows import FIRST_SEED, KINDS, ON_WHOLE, SCHEDULES, VISIBLE, Row, make_of
from studies.panel.scores import (
    GROUPS,
    RIGHT,
    WHOLE_TOLERANCE,
    answer,
    found_both,
    found_exactly,
    goals,
    is_among_names,
    is_named,
    is_near_the_floor,
    is_silent,
    is_unexplained,
    is_whole,
    share,
)

ALL = '**all**'
SILENT = ('no_missing_effect', 'unexplained', 'refused')
"""What stands for an answer without a name."""

Line = Mapping[str, object]
"""Cells of a table by their columns."""


def document(rows: Sequence[Row], how: Mapping[str, str], notes: str) -> str:
    """Return the document in Markdown."""
    drawn = [row for row in rows if row.verdict != 'not_drawn']
    aims = [(*goal[:-1], 'yes' if goal.met else '**no**') for goal in goals(drawn)]
    sections = [
        '# The panel of effects\n\n'
        'How often the loop names the effect that is in a recording which it knows nothing else of. Written by '
        f'`{how["command"]}`; what stands under "{NOTES.strip("# ")}" at the end is kept.',
        _how_section(rows, drawn, how),
        '## Goals\n\n' + table(['goal', 'wanted', 'measured', 'recordings', 'met'], aims),
    ]
    for heading, text, lines in _tables(drawn):
        if lines:
            sections.append(f'## {heading}\n\n{text}\n\n{_table(lines)}')
    return '\n\n'.join([*sections, notes or NOTES]).rstrip() + '\n'


def _table(lines: Sequence[Line]) -> str:
    """Return a table of lines that have the same columns."""
    return table(list(lines[0]), [list(line.values()) for line in lines]) if lines else 'No recordings.'


def _lines(
    rows: Sequence[Row],
    labels: Sequence[str],
    choices: Iterable[tuple[str, ...]],
    cells: Callable[[Sequence[Row]], Line],
) -> list[Line]:
    """Return a line for each choice of a kind, a schedule, an effect or a noise, or of all, of which there are rows."""
    lines: list[Line] = []
    for choice in choices:
        some = [row for row in rows if all(one in (ALL, row.kind, row.schedule, *row.effects) for one in choice)]
        if some:
            shown = (one if one in (ALL, *NOISES) else f'`{one}`' for one in choice)
            lines.append({**dict(zip(labels, shown)), **cells(some)})
    return lines


def _how_section(rows: Sequence[Row], drawn: Sequence[Row], how: Mapping[str, str]) -> str:
    versions = collections.Counter((row.commit, row.code) for row in drawn)
    measured_by = '; '.join(
        f'commit {name} (program text {code}): {count} recordings' for (name, code), count in versions.items()
    )
    return (
        '## How it was measured\n\n'
        f'- Command: `{how["command"]}`\n'
        f'- Machine: {how["machine"]}\n'
        f'- Measured by {measured_by or "nothing yet"}\n'
        f'- {len(drawn)} recordings; {len(rows) - len(drawn)} pairs whose effects are one and the same part of the rig '
        'were left out\n\n'
        + _table(_lines(drawn, ['kind'], product(KINDS), _seeds))
        + '\n\nThe seed draws the device, the schedule, the strength and the noise; seeds below '
        f'{FIRST_SEED} were used while developing. The *oracle floor* is the RMSE that the true device, driven by the '
        "measured displacement, leaves on the same samples. A draw is *visible* where the paper's model, refitted, "
        f'leaves more than {VISIBLE} of it. Shares have 95 % intervals (Wilson).'
    )


def _seeds(rows: Sequence[Row]) -> Line:
    seeds = [row.seed for row in rows]
    counts = collections.Counter(row.schedule for row in rows)
    return {
        'seeds': f'{min(seeds)} to {max(seeds)}',
        **{f'`{one}`': counts[one] for one in SCHEDULES},
        'recordings': len(rows),
    }


BY_ANSWER = (
    'By the first name among visible draws. *Nobody could see*: draws of which no method could tell, and the names '
    'that some got all the same. *Listed alternative*: the effect is named as one of those that the recording '
    "can't tell from the first name, and the pair is listed below. *No name*: none missing / `unexplained` / "
    'refused. *Before* and *after*: RMSE on the test part over the oracle floor, median / 90th '
    'percentile of visible draws.'
)


def _by_answer(rows: Sequence[Row]) -> Line:
    hidden = [row for row in rows if not row.visible]
    seen = [row for row in rows if row.visible]
    answers = collections.Counter(answer(row) for row in seen)
    silent = collections.Counter(row.verdict for row in seen if not row.named)
    others = [row for row in seen if answer(row) in ('unlisted alternative', 'wrong name')]
    false = [row for row in hidden if answer(row) not in (*RIGHT, 'no name')]
    named = [row for row in seen if row.named]
    return {
        'draws': len(rows),
        'nobody could see': str(len(hidden)) + (f' ({_names(false)})' if false else ''),
        'visible': len(seen),
        'right': answers['right'],
        'listed alternative': answers['listed alternative'],
        'other': len(others),
        'no name': ' / '.join(str(silent[verdict]) for verdict in SILENT),
        'named instead': _names(others),
        'more than the one': sum(len(row.named) > 1 for row in named),
        '`unexplained` beside a name': sum(is_unexplained(row) for row in named),
        'before': _quantiles(row.before_test for row in seen),
        'after': _quantiles(row.after_test for row in seen),
    }


def _names(rows: Iterable[Row]) -> str:
    counts = collections.Counter(row.named[0] for row in rows)
    return ', '.join(f'{name} {count}' for name, count in counts.most_common())


def _quantiles(values: Iterable[float], quantiles: Sequence[float] = (0.5, 0.9), digits: int = 2) -> str:
    finite = [value for value in values if math.isfinite(value)]
    return ' / '.join(f'{one:.{digits}f}' for one in np.quantile(finite, quantiles)) if finite else '-'


UNKNOWN = 'The right answer is `unexplained`. *Named*: `effect_added`, among visible draws.'


def _unknown(rows: Sequence[Row]) -> Line:
    """Return how recordings were answered whose effect the library doesn't have."""
    seen = [row for row in rows if row.visible]
    added = [row for row in seen if row.verdict == 'effect_added']
    return {
        'draws': len(rows),
        'nobody could see': len(rows) - len(seen),
        'visible': len(seen),
        'unexplained': share(seen, is_unexplained),
        'of these beside a name': sum(is_unexplained(row) and is_named(row) for row in seen),
        'none missing': sum(row.verdict == 'no_missing_effect' for row in seen),
        'named': f'{len(added)}' + (f': {_names(added)}' if added else ''),
        'after': _quantiles(row.after_test for row in seen),
    }


CLEAN = (
    "The paper's model itself, integrated apart, with white noise, with noise that remembers (AR 0.9), and with little "
    'beside the steps of the converter.'
)


def _clean(rows: Sequence[Row]) -> Line:
    named = [row for row in rows if row.named]
    return {
        'recordings': len(rows),
        'with a name': len(named),
        'share': share(rows, is_named),
        'names': _names(named),
        '`unexplained`': sum(map(is_unexplained, rows)),
        'error over the floor': _quantiles(row.after_test for row in rows),
    }


PAIRS = (
    'Counted where each effect shows beside the other: the model with only one of them, refitted, leaves more than '
    f'{VISIBLE} of the oracle floor.'
)


def _pairs(rows: Sequence[Row]) -> Line:
    seen = [row for row in rows if row.both_visible]
    return {
        'recordings': len(rows),
        'both show': len(seen),
        'both found': share(seen, found_both),
        'exactly the two': share(seen, found_exactly),
        'both, listed alternatives too': share(seen, partial(found_both, alternatives=True)),
        'exactly, listed alternatives too': share(seen, partial(found_exactly, alternatives=True)),
        '`unexplained`': share(seen, is_unexplained),
        'after': _quantiles(row.after_test for row in seen),
    }


def _missed(row: Row) -> Line:
    """Return what was answered of a pair."""
    others = {name: f' (or {", ".join(row.alternatives[name])})' for name in row.named if name in row.alternatives}
    return {
        'schedule': f'`{row.schedule}`',
        'seed': row.seed,
        'effects': ' + '.join(row.effects),
        'each shows': ' / '.join(f'{row.beside[name]:.2f}' if name in row.beside else '-' for name in row.effects),
        'named': ' + '.join(name + others.get(name, '') for name in row.named) or row.verdict,
        'after': f'{row.after_test:.2f}',
    }


def _force(clean: Sequence[Row]) -> str:
    named = [row for row in clean if row.named]
    return (
        'Devices whose pressures are as the model has them, with one effect on the measured force; the piston area is '
        f'given. Columns as above. Of {len(clean)} recordings of devices with no effect {len(named)} get a name'
        + (f' ({_names(named)})' if named else '')
        + f', {sum(map(is_unexplained, clean))} end `unexplained`.'
    )


WHOLE = (
    'By make; *own*: more than two orifices, a laminar tube and a polytropic chamber with walls. *Visible*: the core, '
    f'refitted, leaves more than {VISIBLE} of the oracle floor. *Whole*: the right name and no other, what is left is '
    f'noise, and the test error at most {WHOLE_TOLERANCE:.2f} of the floor.'
)


def _whole(rows: Sequence[Row], make: str) -> Line:
    own = [row for row in rows if make_of(row.kind, row.seed) == make]
    seen = [row for row in own if row.kind == 'whole' and row.visible]
    healthy = [row for row in own if row.kind == 'healthy_whole']
    return {
        'make': f'`{make}`{", own" if make in OWN_WAYS else ""}',
        'visible': len(seen),
        'right among the names': share(seen, is_among_names),
        'whole': share(seen, is_whole),
        'after': _quantiles(row.after_test for row in seen),
        'healthy': len(healthy),
        'nothing missing': share(healthy, is_silent),
        'a part blamed': share(healthy, is_named),
    }


ERRORS = (
    '*Before* and *after* over the oracle floor, median / 90th percentile of visible draws, of all where nothing '
    'is missing. A single step has no test part. The noise floor as quantiles 5 %, 50 %, 95 %; the time of an '
    'identification in one process with one thread, median / 90th percentile.'
)


def _errors(rows: Sequence[Row]) -> Line:
    seen = [row for row in rows if row.visible or row.kind.startswith('clean')]
    return {
        'recordings': len(rows),
        'before': _quantiles(row.before_test for row in seen),
        'after': _quantiles(row.after_test for row in seen),
        'on': 'test part' if any(row.tested for row in rows) else 'whole recording',
        "noise floor over the oracle's": _quantiles((row.noise for row in rows), (0.05, 0.5, 0.95), 3),
        'within 5 %': share(rows, is_near_the_floor),
        'time [s]': _quantiles((row.seconds for row in rows), (0.5, 0.9), 1),
    }


def _refused(row: Row) -> Line:
    return {
        'kind': f'`{row.kind}`',
        'effect': ' + '.join(row.effects),
        'schedule': f'`{row.schedule}`',
        'seed': row.seed,
        'why': row.why,
    }


def _tables(rows: Sequence[Row]) -> Iterator[tuple[str, str, Sequence[Line]]]:
    """Yield heading, text and lines of each table."""

    def of(kind: str) -> list[Row]:
        return [row for row in rows if row.kind == kind]

    by_effect = ['schedule', 'effect']
    for schedule in SCHEDULES:
        own = [row for row in of('effects') if row.schedule == schedule]
        lines = _lines(own, ['effect'], product([*LIBRARY, ALL]), _by_answer)
        yield f'`{schedule}`: effect by answer', BY_ANSWER, lines
    choices = [*product(SCHEDULES, FOREIGN), *product(SCHEDULES, [ALL]), (ALL, ALL)]
    yield 'Effects outside the library', UNKNOWN, _lines(of('foreign'), by_effect, choices, _unknown)
    lines = _lines(of('clean'), ['noise', 'schedule'], product(NOISES, [*SCHEDULES, ALL]), _clean)
    yield 'Nothing missing', CLEAN, lines
    yield 'Two effects at once', PAIRS, _lines(of('pairs'), ['schedule'], product([*SCHEDULES, ALL]), _pairs)
    missed = [row for row in of('pairs') if row.both_visible and not found_both(row)]
    missed.sort(key=lambda row: (SCHEDULES.index(row.schedule), row.seed))
    text = 'Of those where each effect shows beside the other.'
    yield 'Pairs of which not both were found', text, [_missed(row) for row in missed]
    lines = _lines(of('force'), by_effect, product(SCHEDULES, ON_FORCE), _by_answer)
    yield 'The contact force', _force(of('clean_force')), lines
    of_makes = [*of('whole'), *of('healthy_whole')]
    yield 'Devices with all of their physics', WHOLE, [_whole(of_makes, make) for make in MAKES if of_makes]
    lines = _lines(of('whole'), by_effect, product([*SCHEDULES, ALL], [*ON_WHOLE, ALL]), _by_answer)
    yield 'Devices with all of their physics: effect by answer', BY_ANSWER, lines
    finite = [row for row in rows if math.isfinite(row.after)]
    lines = _lines(finite, ['kind', 'schedule'], product(KINDS, SCHEDULES), _errors)
    yield 'Errors, noise floor, time', ERRORS, lines
    text = 'Effects that data may not separate. Only among these an alternative counts as right.'
    lines = [{'family': family, 'effects': ', '.join(f'`{name}`' for name in names)} for family, names in GROUPS]
    yield 'Listed pairs', text, lines
    text = 'Recordings that were not identified; they count as visible and as answered without a name.'
    yield 'Refused', text, [_refused(row) for row in rows if row.verdict == 'refused']
