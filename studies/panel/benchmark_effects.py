# SPDX-License-Identifier: Apache-2.0
"""
How often the loop names the effect that is in a recording: make benchmark-effects.

Recordings of the rig's panel (`studies.panel`) go through `identify` as a user's would
(`panel_rows.py`), the answers are scored (`panel_scores.py`), and the document has the goals beside what was measured
(`panel_document.py`).
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from cfd_pneumatic.files import write_text
from studies.documents.markdown import notes_in
from studies.panel import FOREIGN, LIBRARY, NOISES, ON_FORCE
from studies.panel.document import document
from studies.panel.rows import FIRST_SEED, FIRST_WHOLE_SEED, KINDS, SCHEDULES, WHOLE_KINDS, jobs_of, read_rows, run
from studies.panel.scores import goals
from studies.tools.provenance import ROOT, code_version, machine

SEEDS = {
    'effects': ((10, 10, 10), (2, 2, 1)),
    'foreign': ((10, 10, 10), (2, 2, 1)),
    'clean': ((80, 80, 40), (10, 5, 2)),
    'pairs': ((100, 100, 50), (10, 10, 1)),
    'force': ((10, 10, 10), (2, 2, 2)),
    'clean_force': ((40, 40, 20), (5, 5, 2)),
    'whole': ((7, 14, 14), (0, 1, 1)),
    'healthy_whole': ((70, 70, 70), (7, 7, 7)),
}
"""How many by kind and schedule, and how many where it is to be quick: for each effect or noise, or of pairs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the panel, write the document; return the exit code."""
    options = _parsed(arguments)

    def seeds(kind: str, schedule: str) -> range:
        count = SEEDS[kind][options.quick][SCHEDULES.index(schedule)]
        first = FIRST_WHOLE_SEED if kind in WHOLE_KINDS else FIRST_SEED
        return options.seeds or range(first, first + count)

    code = code_version()
    jobs = jobs_of(options.kinds, options.schedules, seeds, options.effects)
    taken = None if options.any_version else code
    rows = read_rows(options.rows, taken)
    pending = [] if options.only_document else [job for job in jobs if job not in rows]
    print(f'{len(jobs)} recordings, {len(pending)} of them still to be measured; rows in {options.rows}')
    if pending:
        try:
            run(pending, options.rows, code, options.jobs)
        except KeyboardInterrupt:
            print('stopped; the same command goes on from here', file=sys.stderr)
            return 130
        rows = read_rows(options.rows, taken)
    chosen = [rows[job] for job in jobs if job in rows]
    drawn = [row for row in chosen if row.verdict != 'not_drawn']
    given = shlex.join(one for one in (sys.argv[1:] if arguments is None else arguments) if one != '--only-document')
    command = 'make benchmark-effects' + (f" ARGS='{given}'" if given else '')
    how = {'command': command, 'machine': machine()}
    write_text(options.output, document(chosen, how, notes_in(options.output)))
    for goal in goals(drawn):
        print(f'{"met    " if goal.met else "NOT MET"}  {goal.what}: {goal.measured} (wanted: {goal.wanted})')
    print(f'The document is {options.output}')
    return 0


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark_effects', description=__doc__.split('\n\n')[0])
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=KINDS, help='of recordings')
    parser.add_argument('--schedules', nargs='+', choices=SCHEDULES, default=SCHEDULES)
    parser.add_argument(
        '--effects',
        nargs='+',
        choices=(*LIBRARY, *ON_FORCE, *FOREIGN, *NOISES),
        metavar='EFFECT',
        help='only these; with clean, kinds of noise; pairs of which both are among them',
    )
    parser.add_argument(
        '--seeds', type=_seeds, metavar='A:B', help=f'the same for all kinds; by default from {FIRST_SEED}'
    )
    parser.add_argument('--quick', action='store_true', help='few seeds: about 10 minutes on two cores')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='processes; 0: in this one')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'effects_panel.md', help='document')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'effects_panel.jsonl', help='file of rows')
    parser.add_argument(
        '--only-document', action='store_true', help='measure nothing: write of the rows that are there'
    )
    parser.add_argument('--any-version', action='store_true', help='take rows that other versions measured, too')
    return parser.parse_args(arguments)


def _seeds(text: str) -> range:
    first, last = map(int, text.split(':'))
    return range(first, last)


if __name__ == '__main__':
    sys.exit(main())
