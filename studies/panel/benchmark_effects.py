# SPDX-License-Identifier: Apache-2.0
"""
Measure how often the loop names the effect of a recording: make benchmark-effects.

`rows.py` identifies the recordings of the panel as a user would. `scores.py` scores the answers. `document.py` compares
the scores with the goals.
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
from studies.panel import FOREIGN, LIBRARY, NOISES, ON_COMMAND, ON_FORCE
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
    'command': ((0, 10, 10), (0, 1, 1)),
    'weak_command': ((0, 10, 10), (0, 1, 1)),
}
"""Number of seeds by kind and schedule, in a full run and in a quick run: for each effect or noise, or of pairs."""
DOCUMENT = ROOT / 'docs' / 'measurements' / 'effects_panel.md'


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the panel and write its document; return the exit code."""
    options = _parsed(arguments)

    def seeds(kind: str, schedule: str) -> range:
        count = SEEDS[kind][options.quick][SCHEDULES.index(schedule)]
        first = FIRST_WHOLE_SEED if kind in WHOLE_KINDS else FIRST_SEED
        return options.seeds or range(first, first + count)

    code = code_version()
    jobs = jobs_of(options.kinds, options.schedules, seeds, options.effects)
    version = None if options.any_version else code
    rows = read_rows(options.rows, version)
    pending = [] if options.only_document else [job for job in jobs if job not in rows]
    print(f'{len(jobs)} recordings, {len(pending)} of them are not measured yet. Rows: {options.rows}')
    if pending:
        try:
            run(pending, options.rows, code, options.jobs)
        except KeyboardInterrupt:
            print('Stopped. Run the same command again to continue from here.', file=sys.stderr)
            return 130
        rows = read_rows(options.rows, version)
    chosen = [rows[job] for job in jobs if job in rows]
    drawn = [row for row in chosen if row.verdict != 'not_drawn']
    chosen_options = shlex.join(
        word for word in (sys.argv[1:] if arguments is None else arguments) if word != '--only-document'
    )
    command = 'make benchmark-effects' + (f" ARGS='{chosen_options}'" if chosen_options else '')
    provenance = {'command': command, 'machine': machine()}
    write_text(options.output, document(chosen, provenance, notes_in(options.output)))
    for goal in goals(drawn):
        print(f'{"met    " if goal.met else "NOT MET"}  {goal.description}: {goal.measured} (wanted: {goal.wanted})')
    print(f'The document is {options.output}')
    return 0


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark_effects', description=__doc__.split('\n\n')[0])
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=KINDS, help='kinds of recordings')
    parser.add_argument('--schedules', nargs='+', choices=SCHEDULES, default=SCHEDULES)
    parser.add_argument(
        '--effects',
        nargs='+',
        choices=(*LIBRARY, *ON_FORCE, *ON_COMMAND, *FOREIGN, *NOISES),
        metavar='EFFECT',
        help='only these effects, and pairs of them; for the kind clean: kinds of noise',
    )
    parser.add_argument('--seeds', type=_seeds, metavar='A:B', help=f'seeds of all kinds (default: from {FIRST_SEED})')
    parser.add_argument('--quick', action='store_true', help='use few seeds: about 10 minutes on two cores')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='number of processes; 0: this process')
    parser.add_argument('--output', type=Path, default=DOCUMENT, help='document to write')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'effects_panel.jsonl', help='file of rows')
    parser.add_argument(
        '--only-document', action='store_true', help='write the document from the existing rows, without measuring'
    )
    parser.add_argument('--any-version', action='store_true', help='also use rows that were measured by other versions')
    return parser.parse_args(arguments)


def _seeds(text: str) -> range:
    first, last = map(int, text.split(':'))
    return range(first, last)


if __name__ == '__main__':
    sys.exit(main())
