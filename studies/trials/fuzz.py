# SPDX-License-Identifier: Apache-2.0
"""
Inputs that are changed at random, each given to what reads it: `make fuzz`.

Each kind has a process of its own. An input is valid, or a valid one with changes; one that gets somewhere new becomes
a parent of further ones. A fault is an unexpected exception, a warning, more than ten seconds or a gigabyte, a valid
input that is refused, a number that is none, a file that is quoted, and a message that rosbags reads and we do not, and
nothing is said. The inputs that led to the first fault at each place are left in `build/fuzz`.
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
from typing import TYPE_CHECKING

from studies.documents.markdown import table
from studies.tools.ros_environment import isolate

if TYPE_CHECKING:
    from studies.trials.fuzzing.campaign import Kind, Tally

KEPT = Path('build/fuzz')
_MEMORY = 2**30  # [bytes]


def kinds() -> dict[str, Kind]:
    """Return all kinds that can be tried here, by name."""
    from studies.trials.fuzzing import bags, texts

    found = bags.kinds() + texts.kinds()
    try:
        from studies.trials.fuzzing import nodes, places, strangers
    except ImportError as error:
        print(f'what nodes are sent is left out: ROS 2 is not to be had here ({error})', file=sys.stderr)
    else:
        found += nodes.kinds() + strangers.kinds() + places.kinds()
    return {kind.name: kind for kind in found}


def _tallied(name: str, count: int, seed: int) -> Tally:
    """Run one kind, in a process that does nothing else."""
    isolate()
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    from studies.trials.fuzzing.campaign import run

    memory = Path('/dev/shm')
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        return run(kinds()[name], count, seed, Path(folder), KEPT)


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


def main(arguments: Sequence[str] | None = None) -> int:
    """Try all kinds; return 1 where there are faults."""
    parser = argparse.ArgumentParser(prog='fuzzing', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--each', type=int, default=1000, help='inputs of each kind; default 1000')
    parser.add_argument('--seed', type=int, default=0, help='the same makes the same inputs')
    parser.add_argument('--only', metavar='PATTERN', default='', help='kinds in whose names it is found')
    options = parser.parse_args(arguments)
    os.environ['OMP_NUM_THREADS'] = '1'
    KEPT.mkdir(parents=True, exist_ok=True)
    rows, faults = [], 0
    for kind in kinds().values():
        if not re.search(options.only, kind.name):
            continue
        with ProcessPoolExecutor(1, get_context('spawn')) as workers:
            try:
                tally = workers.submit(_tallied, kind.name, options.each, options.seed).result()
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
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
