# SPDX-License-Identifier: Apache-2.0
"""Write the results of the panel in Markdown."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np

from studies.documents.markdown import NOTES, table
from studies.panel import FOREIGN, LIBRARY, MAKES, NOISES, ON_FORCE, OWN_WAYS
from studies.panel.rows import COMMAND_KINDS, FIRST_SEED, KINDS, ON_WHOLE, SCHEDULES, VISIBLE, Row, make_of
from studies.panel.scores import (
    GROUPS,
    RIGHT,
    WHOLE_TOLERANCE,
    accounts_for_each,
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
"""Verdicts that name no effect."""

Line = Mapping[str, object]
"""Cells of a table by their columns."""


def document(rows: Sequence[Row], provenance: Mapping[str, str], notes: str) -> str:
    """Return the document in Markdown."""
    drawn = [row for row in rows if row.verdict != 'not_drawn']
    aims = [(*goal[:-1], 'yes' if goal.met else '**no**') for goal in goals(drawn)]
    sections = [
        '# The panel of effects\n\n'
        'How often does the loop name the effect of a recording, given the recording alone? Written by '
        f'`{provenance["command"]}`; the section "{NOTES.strip("# ")}" at the end is kept.',
        _provenance_section(rows, drawn, provenance),
        '## Goals\n\n' + table(['goal', 'wanted', 'measured', 'recordings', 'met'], aims),
    ]
    for heading, text, lines in _tables(drawn):
        if lines:
            sections.append(f'## {heading}\n\n{text}\n\n{_table(lines)}')
    return '\n\n'.join([*sections, notes or NOTES]).rstrip() + '\n'


def _table(lines: Sequence[Line]) -> str:
    """Return the table of lines with equal columns."""
    return table(list(lines[0]), [list(line.values()) for line in lines]) if lines else 'No recordings.'


def _lines(
    rows: Sequence[Row],
    labels: Sequence[str],
    choices: Iterable[tuple[str, ...]],
    cells: Callable[[Sequence[Row]], Line],
) -> list[Line]:
    """Return a line for each choice of kind, schedule, effect or noise that has rows."""
    lines: list[Line] = []
    for choice in choices:
        matching = [
            row for row in rows if all(value in (ALL, row.kind, row.schedule, *row.effects) for value in choice)
        ]
        if matching:
            shown = (value if value in (ALL, *NOISES) else f'`{value}`' for value in choice)
            lines.append({**dict(zip(labels, shown)), **cells(matching)})
    return lines


def _provenance_section(rows: Sequence[Row], drawn: Sequence[Row], provenance: Mapping[str, str]) -> str:
    versions = collections.Counter((row.commit, row.code) for row in drawn)
    measured_by = '; '.join(
        f'commit {name} (program text {code}): {count} recordings' for (name, code), count in versions.items()
    )
    return (
        '## How it was measured\n\n'
        f'- Command: `{provenance["command"]}`\n'
        f'- Machine: {provenance["machine"]}\n'
        f'- Measured by {measured_by or "nothing yet"}\n'
        f'- {len(drawn)} recordings; {len(rows) - len(drawn)} pairs were omitted: '
        'both effects change the same part of the rig\n\n'
        + _table(_lines(drawn, ['kind'], product(KINDS), _seeds))
        + '\n\nThe seed determines the device, the schedule, the strength and the noise. Seeds below '
        f'{FIRST_SEED} were used for development. The *oracle floor* is the RMSE of the true device, driven by the '
        "measured displacement. A draw is *visible* if the RMSE of the refitted paper's model exceeds the floor by a "
        f'factor of {VISIBLE}. Shares have 95 % intervals (Wilson).'
    )


def _seeds(rows: Sequence[Row]) -> Line:
    seeds = [row.seed for row in rows]
    counts = collections.Counter(row.schedule for row in rows)
    return {
        'seeds': f'{min(seeds)} to {max(seeds)}',
        **{f'`{schedule}`': counts[schedule] for schedule in SCHEDULES},
        'recordings': len(rows),
    }


BY_ANSWER = (
    'Visible draws by the first named effect. *Not visible*: draws, and the effects that were named there. *Listed '
    'alternative*: the true effect is an alternative to the first named effect, and the pair is listed below. *No '
    'name*: `no_missing_effect` / `unexplained` / refused. *Before* and *after*: test RMSE / oracle floor, median / '
    '90th percentile of visible draws.'
)
AS_ABOVE = 'Columns as in the first table of answers.'


def _by_answer(rows: Sequence[Row]) -> Line:
    hidden = [row for row in rows if not row.visible]
    seen = [row for row in rows if row.visible]
    answers = collections.Counter(answer(row) for row in seen)
    silent = collections.Counter(row.verdict for row in seen if not row.named)
    wrong = [row for row in seen if answer(row) in ('unlisted alternative', 'wrong name')]
    false = [row for row in hidden if answer(row) not in (*RIGHT, 'no name')]
    named = [row for row in seen if row.named]
    return {
        'draws': len(rows),
        'not visible': str(len(hidden)) + (f' ({_names(false)})' if false else ''),
        'visible': len(seen),
        'right': answers['right'],
        'listed alternative': answers['listed alternative'],
        'other': len(wrong),
        'no name': ' / '.join(str(silent[verdict]) for verdict in SILENT),
        'named instead': _names(wrong),
        'more than one name': sum(len(row.named) > 1 for row in named),
        '`unexplained` with a name': sum(is_unexplained(row) for row in named),
        'before': _quantiles(row.before_test for row in seen),
        'after': _quantiles(row.after_test for row in seen),
    }


def _names(rows: Iterable[Row]) -> str:
    counts = collections.Counter(row.named[0] for row in rows)
    return ', '.join(f'{name} {count}' for name, count in counts.most_common())


def _quantiles(values: Iterable[float], quantiles: Sequence[float] = (0.5, 0.9), digits: int = 2) -> str:
    finite = [value for value in values if math.isfinite(value)]
    return ' / '.join(f'{value:.{digits}f}' for value in np.quantile(finite, quantiles)) if finite else '-'


UNKNOWN = 'The right answer is `unexplained`. *Named*: `effect_added`, among visible draws.'


def _unknown(rows: Sequence[Row]) -> Line:
    """Return how the loop answers recordings with an effect outside the library."""
    seen = [row for row in rows if row.visible]
    added = [row for row in seen if row.verdict == 'effect_added']
    return {
        'draws': len(rows),
        'not visible': len(rows) - len(seen),
        'visible': len(seen),
        'unexplained': share(seen, is_unexplained),
        '`unexplained` with a name': sum(is_unexplained(row) and is_named(row) for row in seen),
        'none missing': sum(row.verdict == 'no_missing_effect' for row in seen),
        'named': f'{len(added)}' + (f': {_names(added)}' if added else ''),
        'after': _quantiles(row.after_test for row in seen),
    }


CLEAN = (
    "The paper's model itself, integrated separately, with white noise, with autocorrelated noise (AR 0.9), and "
    'with little noise other than the steps of the converter.'
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
    'Pairs in which each effect is visible next to the other: the RMSE of the refitted model with only one of them is '
    f'more than {VISIBLE} times the oracle floor.'
)


def _pairs(rows: Sequence[Row]) -> Line:
    seen = [row for row in rows if row.both_visible]
    return {
        'recordings': len(rows),
        'both visible': len(seen),
        'both found': share(seen, found_both),
        'exactly the two': share(seen, found_exactly),
        'both, listed alternatives too': share(seen, partial(found_both, alternatives=True)),
        'exactly, listed alternatives too': share(seen, partial(found_exactly, alternatives=True)),
        '`unexplained`': share(seen, is_unexplained),
        'after': _quantiles(row.after_test for row in seen),
    }


def _missed(row: Row) -> Line:
    """Return the answer to a pair of which not both effects were found."""
    alternatives = {
        name: f' (or {", ".join(row.alternatives[name])})' for name in row.named if name in row.alternatives
    }
    return {
        'schedule': f'`{row.schedule}`',
        'seed': row.seed,
        'effects': ' + '.join(row.effects),
        'each visible': ' / '.join(
            f'{row.errors_without[name]:.2f}' if name in row.errors_without else '-' for name in row.effects
        ),
        'named': ' + '.join(name + alternatives.get(name, '') for name in row.named) or row.verdict,
        'after': f'{row.after_test:.2f}',
    }


def _force(clean: Sequence[Row]) -> str:
    named = [row for row in clean if row.named]
    return (
        'Devices with one effect on the measured force and a given piston area. Columns as in the first table of '
        f'answers. Of {len(clean)} recordings of devices with no effect {len(named)} get a name'
        + (f' ({_names(named)})' if named else '')
        + f', {sum(map(is_unexplained, clean))} end `unexplained`.'
    )


COMMAND = (
    'Set-points that act late by a dead time, a lag, or both: 15 to 60 ms each (`command`), or 1 to 15 ms '
    '(`weak_command`). *Named*: each effect is among the names or a listed alternative to a name. *Or not visible*: '
    'each effect is named, or the loop lists it as not visible. *Another name*: a name outside of the true effects.'
)


def _command(rows: Sequence[Row]) -> Iterator[Line]:
    """Yield a line for each kind, schedule and combination of effects."""
    cases = dict.fromkeys((row.kind, row.schedule, row.effects) for row in rows)
    for case in sorted(cases, key=lambda case: (COMMAND_KINDS.index(case[0]), SCHEDULES.index(case[1]), case[2])):
        matching = [row for row in rows if (row.kind, row.schedule, row.effects) == case]
        wrongly_named = [row for row in matching if set(row.named) - set(row.effects)]
        yield {
            'kind': f'`{case[0]}`',
            'schedule': f'`{case[1]}`',
            'effects': ' + '.join(f'`{name}`' for name in case[2]),
            'draws': len(matching),
            'named': share(matching, accounts_for_each),
            'or not visible': share(matching, partial(accounts_for_each, hidden=True)),
            'another name': len(wrongly_named),
            '`unexplained`': sum(map(is_unexplained, matching)),
            'before': _quantiles(row.before_test for row in matching),
            'after': _quantiles(row.after_test for row in matching),
        }


WHOLE = (
    'By make; *own*: more than two orifices, a laminar tube and a polytropic chamber with walls. *Visible*: the RMSE '
    f'of the refitted core is more than {VISIBLE} times the oracle floor. *Whole*: the right effect is the only name, '
    f'the remaining error is noise, and the test error is at most {WHOLE_TOLERANCE:.2f} of the floor.'
)


def _whole(rows: Sequence[Row], make: str) -> Line:
    of_make = [row for row in rows if make_of(row.kind, row.seed) == make]
    seen = [row for row in of_make if row.kind == 'whole' and row.visible]
    healthy = [row for row in of_make if row.kind == 'healthy_whole']
    return {
        'make': f'`{make}`{", own" if make in OWN_WAYS else ""}',
        'visible': len(seen),
        'right among the names': share(seen, is_among_names),
        'whole': share(seen, is_whole),
        'after': _quantiles(row.after_test for row in seen),
        'healthy': len(healthy),
        'nothing missing': share(healthy, is_silent),
        'an effect named': share(healthy, is_named),
    }


ERRORS = (
    '*Before* and *after*: test RMSE / oracle floor, median / 90th percentile of visible draws and clean recordings. '
    'A single step has no test part. Noise floor: quantiles 5 %, 50 %, 95 %. Time in one thread: median / 90th '
    'percentile.'
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

    def rows_of(kind: str) -> list[Row]:
        return [row for row in rows if row.kind == kind]

    by_effect = ['schedule', 'effect']
    for schedule in SCHEDULES:
        of_schedule = [row for row in rows_of('effects') if row.schedule == schedule]
        lines = _lines(of_schedule, ['effect'], product([*LIBRARY, ALL]), _by_answer)
        yield f'`{schedule}`: effect by answer', BY_ANSWER if schedule == SCHEDULES[0] else AS_ABOVE, lines
    choices = [*product(SCHEDULES, FOREIGN), *product(SCHEDULES, [ALL]), (ALL, ALL)]
    yield 'Effects outside the library', UNKNOWN, _lines(rows_of('foreign'), by_effect, choices, _unknown)
    lines = _lines(rows_of('clean'), ['noise', 'schedule'], product(NOISES, [*SCHEDULES, ALL]), _clean)
    yield 'Nothing missing', CLEAN, lines
    yield 'Two effects at once', PAIRS, _lines(rows_of('pairs'), ['schedule'], product([*SCHEDULES, ALL]), _pairs)
    not_both_found = [row for row in rows_of('pairs') if row.both_visible and not found_both(row)]
    not_both_found.sort(key=lambda row: (SCHEDULES.index(row.schedule), row.seed))
    text = 'Only pairs in which each effect is visible next to the other.'
    yield 'Pairs of which not both were found', text, [_missed(row) for row in not_both_found]
    lines = _lines(rows_of('force'), by_effect, product(SCHEDULES, ON_FORCE), _by_answer)
    yield 'The contact force', _force(rows_of('clean_force')), lines
    yield 'Set-points that act late', COMMAND, [*_command([row for row in rows if row.kind in COMMAND_KINDS])]
    of_makes = [*rows_of('whole'), *rows_of('healthy_whole')]
    yield 'Devices with all of their physics', WHOLE, [_whole(of_makes, make) for make in MAKES if of_makes]
    lines = _lines(rows_of('whole'), by_effect, product([*SCHEDULES, ALL], [*ON_WHOLE, ALL]), _by_answer)
    yield 'Devices with all of their physics: effect by answer', AS_ABOVE, lines
    finite = [row for row in rows if math.isfinite(row.after)]
    lines = _lines(finite, ['kind', 'schedule'], product(KINDS, SCHEDULES), _errors)
    yield 'Errors, noise floor, time', ERRORS, lines
    text = 'Effects that data may not separate. An alternative counts as right only within a family.'
    lines = [{'family': family, 'effects': ', '.join(f'`{name}`' for name in names)} for family, names in GROUPS]
    yield 'Listed pairs', text, lines
    text = 'Recordings that were not identified. They count as visible and as answered without a name.'
    yield 'Refused', text, [_refused(row) for row in rows if row.verdict == 'refused']
