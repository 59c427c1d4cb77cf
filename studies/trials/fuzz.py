# SPDX-License-Identifier: Apache-2.0
"""
Give randomly changed inputs to their readers: `make fuzz`.

Each kind of input has a separate process. An input is valid, or a valid input with changes. An input that reaches new
code becomes a parent of further inputs. These are faults:

- an unexpected exception or a warning;
- more than ten seconds or a gigabyte;
- a refused valid input;
- a number that is not finite;
- a message that quotes a file;
- a message of a bag that rosbags reads and the package omits without notice.

The inputs of the first fault at each place are kept in `build/fuzz`.
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
    """Return all kinds that can run on this machine, by name."""
    from studies.trials.fuzzing import bags, texts

    available = bags.kinds() + texts.kinds()
    try:
        from studies.trials.fuzzing import nodes, places, untrusted_inputs
    except ImportError as error:
        print(f'Inputs of nodes are skipped, because ROS 2 is not installed ({error}).', file=sys.stderr)
    else:
        available += nodes.kinds() + untrusted_inputs.kinds() + places.kinds()
    return {kind.name: kind for kind in available}


def _tally_of(name: str, count: int, seed: int) -> Tally:
    """Try the inputs of a kind; call in a separate process."""
    isolate()
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    from studies.trials.fuzzing.campaign import run

    memory = Path('/dev/shm')
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        return run(kinds()[name], count, seed, Path(folder), KEPT)


def _row(tally: Tally) -> tuple[str, ...]:
    parsed = 100.0 * (1.0 - tally.early / tally.inputs)
    return (
        tally.kind,
        f'{tally.inputs:,}',
        f'{tally.whole:,}',
        f'{tally.read:,}',
        f'{tally.inputs - tally.read:,}',
        f'{parsed:.0f} %',
        f'{tally.parents:,}',
        f'{tally.slowest:.2f} s',
        f'{tally.peak / 1e6:.0f} MB',
        f'{tally.seconds:.0f} s',
        str(sum(count for count, _, _ in tally.faults.values())),
    )


_HEADER = (
    *('kind', 'inputs', 'valid', 'read', 'refused', 'accepted by the first parser', 'kept as parents', 'longest'),
    *('peak memory', 'processor time', 'faults'),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try all kinds; return 1 if there are faults."""
    parser = argparse.ArgumentParser(prog='fuzzing', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--each', type=int, default=1000, help='number of inputs of each kind (default: 1000)')
    parser.add_argument('--seed', type=int, default=0, help='seed of the random inputs')
    parser.add_argument('--only', metavar='PATTERN', default='', help='only kinds with names that match the pattern')
    options = parser.parse_args(arguments)
    os.environ['OMP_NUM_THREADS'] = '1'
    KEPT.mkdir(parents=True, exist_ok=True)
    rows, faults = [], 0
    for kind in kinds().values():
        if not re.search(options.only, kind.name):
            continue
        with ProcessPoolExecutor(1, get_context('spawn')) as workers:
            try:
                tally = workers.submit(_tally_of, kind.name, options.each, options.seed).result()
            except BrokenProcessPool:
                print(f'{kind.name}: the process ended unexpectedly', flush=True)
                faults += 1
                continue
        rows.append(_row(tally))
        print(' | '.join(rows[-1]), flush=True)
        for place, (times, number, description) in tally.faults.items():
            print(f'  {times} times, first input {number}: {description.strip()}\n  at {place}', flush=True)
            faults += times
    print(table(_HEADER, rows))
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
