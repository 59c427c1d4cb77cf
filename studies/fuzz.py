"""
Inputs that are changed at random, each given to what reads it: `make fuzz`.

Each kind has a process of its own. An input is valid, or a valid one with changes; one that gets somewhere new becomes
a parent of further ones. A fault is an unexpected exception, a warning, more than ten seconds or a gigabyte, a valid
input that is refused, a number that is none, and a message that rosbags reads and we do not, with nothing said. The
inputs that led to the first fault at each place are left in `build/fuzz`.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.documents import table
from studies.ros_environment import isolate

if TYPE_CHECKING:
    from studies.fuzzing.campaign import Kind, Tally

KEPT = Path('build/fuzz')
_MEMORY = 2**30  # [bytes]
READERS = {
    'bags': [
        'recording/bags/[bcdo]*.py',
        'recording/bags/fields.py',
        'recording/bags/layout.py',
        'recording/bags/mcap_pieces.py',
        'recording/bags/*_reading.py',
        'recording/bags/sqlite_salvage.py',
        'recording/bags/storages.py',
    ],
    'signals of a recording': [
        'recording/cleaning.py',
        'recording/intake.py',
        'recording/reading.py',
        'recording/s[ao]*.py',
        'recording/topics.py',
    ],
    'YAML': ['yaml_files.py'],
    'mappings': ['recording/mapping.py'],
    'tables': ['recording/table.py'],
    'parameter files': ['device/file.py:read', 'device/file.py:_flat', 'device/file.py:_ros_parameters'],
    'values of parameters': ['device/descriptors.py:Descriptor.checked'],
    'schedules': ['rig/written.py'],
    'report.json': ['planning/device.py:read_report'],
    'messages': ['nodes/samples.py:_ByLayout.read', 'nodes/samples.py:_ByLayout._learn', 'nodes/model_node.py'],
}
"""What reads inputs: modules, or functions of them."""


def kinds() -> dict[str, Kind]:
    """Return all kinds that can be tried here, by name."""
    from studies.fuzzing import bags, texts

    found = bags.kinds() + texts.kinds()
    try:
        from studies.fuzzing import nodes
    except ImportError as error:
        print(f'what nodes are sent is left out: ROS 2 is not to be had here ({error})', file=sys.stderr)
    else:
        found += nodes.kinds()
    return {kind.name: kind for kind in found}


def _tallied(name: str, count: int, seed: int, measured: bool) -> Tally:
    """Run one kind, in a process that does nothing else."""
    isolate()
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    coverage: Any = None
    if measured:
        from coverage import Coverage

        coverage = Coverage(data_file=KEPT / 'coverage', data_suffix=True, branch=True, source=['cfd_pneumatic'])
        coverage.start()
    from studies.fuzzing.campaign import run

    memory = Path('/dev/shm')
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        tally = run(kinds()[name], count, seed, Path(folder), KEPT)
    if coverage is not None:
        coverage.stop()
        coverage.save()
    return tally


def _row(tally: Tally) -> tuple[str, ...]:
    past = 100.0 * (1.0 - tally.early / tally.inputs)
    return (
        tally.kind,
        f'{tally.inputs:,}',
        f'{tally.whole:,}',
        f'{tally.read:,}',
        f'{tally.inputs - tally.read:,}',
        f'{past:.0f} %',
        f'{tally.parents:,}',
        f'{tally.slowest:.2f} s',
        f'{tally.peak / 1e6:.0f} MB',
        f'{tally.seconds:.0f} s',
        str(sum(count for count, _, _ in tally.faults.values())),
    )


_HEADER = (
    *('kind', 'inputs', 'of these valid', 'read', 'refused', 'past the first parser', 'kept as parents', 'longest'),
    *('most memory', 'processor', 'faults'),
)


def _coverage_table() -> str:
    """Return how many branches of each reader were taken."""
    from coverage import Coverage

    coverage = Coverage(data_file=KEPT / 'coverage', branch=True)
    coverage.combine([str(KEPT)])
    coverage.save()
    report = KEPT / 'coverage.json'
    coverage.json_report(outfile=str(report), ignore_errors=True)
    return table(('reader', 'branches', 'taken'), _branches(report))


def _branches(report: Path) -> list[tuple[str, int, str]]:
    import json
    from fnmatch import fnmatch

    files = json.loads(report.read_text(encoding='utf-8'))['files']
    rows = []
    for reader, parts in READERS.items():
        found = covered = 0
        for part in parts:
            module, _, function = part.partition(':')
            for file, content in files.items():
                if fnmatch(file, f'*cfd_pneumatic/{module}'):
                    summary = (content['functions'][function] if function else content)['summary']
                    found += summary['num_branches']
                    covered += summary['covered_branches']
        if found:
            rows.append((reader, found, f'{100.0 * covered / found:.0f} %'))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Try all kinds; return 1 where there are faults."""
    parser = argparse.ArgumentParser(prog='fuzzing', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--each', type=int, default=1000, help='inputs of each kind; default 1000')
    parser.add_argument('--seed', type=int, default=0, help='the same makes the same inputs')
    parser.add_argument('--only', metavar='PATTERN', default='', help='kinds in whose names it is found')
    parser.add_argument('--coverage', action='store_true', help='measure which branches of the readers are taken')
    options = parser.parse_args(arguments)
    os.environ['OMP_NUM_THREADS'] = '1'
    KEPT.mkdir(parents=True, exist_ok=True)
    rows, faults = [], 0
    for kind in kinds().values():
        if not re.search(options.only, kind.name):
            continue
        with ProcessPoolExecutor(1, get_context('spawn')) as workers:
            try:
                tally = workers.submit(_tallied, kind.name, options.each, options.seed, options.coverage).result()
            except BrokenProcessPool:
                print(f'{kind.name}: the process was ended', flush=True)
                faults += 1
                continue
        rows.append(_row(tally))
        print(' | '.join(rows[-1]), flush=True)
        for where, (times, number, what) in tally.faults.items():
            print(f'  {times} times, first input {number}: {what.strip()}\n  at {where}', flush=True)
            faults += times
    print(table(_HEADER, rows))
    if options.coverage:
        print(_coverage_table())
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
