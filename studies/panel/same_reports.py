# SPDX-License-Identifier: Apache-2.0
"""
Check that a change of the code changes no result: compare reports of many recordings number by number.

    python -m studies.panel.same_reports write build/before     # at the commit before the change

    python -m studies.panel.same_reports write build/after

    python -m studies.panel.same_reports compare build/before build/after

The recordings are the quick panel, the unknown characteristics of a seed, and the measured runs. `--every 10` takes a
tenth of the recordings.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.recording import Recording, recording_of
from cfd_pneumatic.reporting import report_data
from cfd_pneumatic.rig import Cylinder
from studies.documents.predictions import recording_of_run
from studies.panel import draw, draw_textbook
from studies.panel.benchmark_effects import SEEDS
from studies.panel.laws import CHARACTERISTICS
from studies.panel.laws import SCHEDULES as CHARACTERISTIC_SCHEDULES
from studies.panel.rows import (
    CYLINDER,
    FIRST_SEED,
    FIRST_WHOLE_SEED,
    KINDS,
    ON_FORCE_KINDS,
    SCHEDULES,
    WHOLE_KINDS,
    cylinder_a_of,
    given_strengths,
    jobs_of,
    make_of,
)
from studies.tools.processes import side_by_side
from studies.tools.provenance import DATA

CHARACTERISTIC_SEED = 7000
"""Seed of unknown characteristics that were reported before, so that no unseen recording is used here."""

TOLERANCE = 1e-9
"""Relative difference up to which two numbers are the same [-]."""

MEASURED = ('friction', 'rerun')
"""Folders of measured runs."""

TEXTS = (
    'fix',
    'look_at',
    'message',
    'next_experiment',
    'next_plan',
    'no_test_part',
    'notes',
    'on',
    'reason',
    'refused',
    'what',
    'why',
    'words',
)
"""Keys of report.json whose values are sentences for people."""

_MOST_SHOWN = 20  # differences


class Case(NamedTuple):
    """A recording: of the panel, of an unknown characteristic (kind `law`), or a measured run (kind `measured`)."""

    kind: str
    subject: tuple[str, ...]
    schedule: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the file that holds its report."""
        return '-'.join((self.kind, *self.subject, self.schedule, str(self.seed))) + '.json'


def cases() -> list[Case]:
    """Return all recordings."""

    def seeds(kind: str, schedule: str) -> range:
        first = FIRST_WHOLE_SEED if kind in WHOLE_KINDS else FIRST_SEED
        return range(first, first + SEEDS[kind][1][SCHEDULES.index(schedule)])

    panel = [Case(*job) for job in jobs_of(KINDS, SCHEDULES, seeds)]
    characteristics = [
        Case('law', (name,), schedule, CHARACTERISTIC_SEED)
        for name in chain(*CHARACTERISTICS.values())
        for schedule in CHARACTERISTIC_SCHEDULES
    ]
    runs = [
        Case('measured', (folder, path.stem), '', 0)
        for folder in MEASURED
        for path in sorted((DATA / folder).glob('*.csv'))
    ]
    return panel + characteristics + runs


def recording_and_options(case: Case) -> tuple[Recording, Options]:
    """Return the recording of a case and the options of its identification."""
    if case.kind == 'measured':
        return recording_of_run(DATA.joinpath(*case.subject).with_suffix('.csv')), Options(close_loop=True)
    if case.kind == 'law':
        drawn = draw(case.subject[0], case.schedule, case.seed)
        if case.subject[0] not in CHARACTERISTICS[CYLINDER]:
            return recording_of(drawn.recording), Options(close_loop=True)
    elif case.kind == 'clean':
        drawn = draw_textbook(case.schedule, case.seed, case.subject[0])
    else:
        given = given_strengths(case.kind, case.subject, case.seed)
        drawn = draw(case.subject, case.schedule, case.seed, given=given, make=make_of(case.kind, case.seed))
    if case.kind in ON_FORCE_KINDS:
        return recording_of(drawn.recording), Options(close_loop=True, area=Cylinder().area)
    return cylinder_a_of(drawn), Options(close_loop=True)


def write_report_of(folder: Path, case: Case) -> None:
    """Write the report of a case, or the reason of a refusal, unless the folder already has the file."""
    path = folder / case.name
    if path.exists():
        return
    try:
        recording, options = recording_and_options(case)
        report = report_data(identify([recording], options))
    except InputError as error:
        report = {'refused': str(error)}
    path.write_text(json.dumps(report, indent=1), encoding='utf-8')


def differences(before: Any, after: Any, texts: bool, location: str = '') -> Iterator[str]:
    """Yield a line for each difference between two values of a report."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before.keys() | after.keys():
            if texts or key not in TEXTS:
                yield from differences(before.get(key), after.get(key), texts, f'{location}.{key}')
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for index, pair in enumerate(zip(before, after)):
            yield from differences(*pair, texts, f'{location}[{index}]')
    elif isinstance(before, float) and isinstance(after, float):
        if not math.isclose(before, after, rel_tol=TOLERANCE):
            yield f'{location}: {before!r}, then {after!r}'
    elif before != after:
        yield f'{location}: {before!r}, then {after!r}'


def compare(before: Path, after: Path, texts: bool) -> int:
    """Print the differences between the reports of two folders; return the exit code."""
    names = [{path.name for path in folder.glob('*.json')} for folder in (before, after)]
    different = 0
    for name in sorted(names[0] & names[1]):
        first, second = (json.loads((folder / name).read_text(encoding='utf-8')) for folder in (before, after))
        lines = list(differences(first, second, texts))
        different += bool(lines)
        for line in lines[:_MOST_SHOWN]:
            print(f'{name}{line}')
    unpaired = sorted(names[0] ^ names[1])
    print(f'{len(names[0] & names[1])} reports, {different} differ; {len(unpaired)} are in one folder only')
    return 1 if different or unpaired or not names[0] else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or compare reports; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='same_reports', description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    actions = parser.add_subparsers(dest='action', required=True)
    writing = actions.add_parser('write', help='identify all recordings')
    writing.add_argument('folder', type=Path)
    writing.add_argument('--every', type=int, default=1, metavar='N', help='identify only every Nth recording')
    writing.add_argument('--jobs', type=int, default=2, help='number of processes')
    comparing = actions.add_parser('compare', help='compare two folders')
    comparing.add_argument('before', type=Path)
    comparing.add_argument('after', type=Path)
    comparing.add_argument('--without-texts', action='store_true', help='ignore differences in sentences for people')
    options = parser.parse_args(arguments)
    if options.action == 'compare':
        return compare(options.before, options.after, not options.without_texts)
    options.folder.mkdir(parents=True, exist_ok=True)
    for _ in side_by_side(
        partial(write_report_of, options.folder), cases()[:: options.every], 'recordings', options.jobs
    ):
        pass
    return 0


if __name__ == '__main__':
    sys.exit(main())
