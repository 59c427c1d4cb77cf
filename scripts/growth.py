"""
What work costs as recordings grow: time and peak memory against samples.

    make growth                                            all, to 1e7 samples and a bag of four hours: about an hour
    make growth ARGS='--most 1e6 --works read_mcap fit'    less

Each size is measured in a process of its own, after a small one of the same, by which everything is compiled. Time is
the fastest round's; memory is what comes on top of the interpreter with its libraries, told by Linux. Every figure is
written when it is known; the same command goes on where it was stopped, and measures anew what another version of the
program gave. The largest need 10 GB in the temporary folder (TMPDIR).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from functools import partial
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from long_bag import topics, write_long_bag
from panel_rows import CYLINDER, recording_of
from provenance import ROOT, code_version, commit, machine
from strokes import CHANNEL, GAINS, SETPOINT, experiment, record

from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.identification.fit.fit import fit
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.model import Course
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal, read_recording
from cfd_pneumatic.rig import surface_following
from cfd_pneumatic.rig.panel import draw

ENOUGH = 1.0  # rounds of a size take so long together [s]
MOST_ROUNDS = 20
LOOP_RATE = 500  # [Hz]
SURFACE = 900.0  # after which a surface repeats itself [s]
SEED = 60
_SAMPLE = 16  # bytes: time and value

Job = Callable[[], int]
"""Does some work once; returns the size of the recording's arrays [bytes]."""


# what is measured


def write_messages(messages: int, folder: Path, storage: str) -> None:
    write_long_bag(folder / 'bag', messages // len(topics()), storage)


def reading(messages: int, folder: Path) -> Job:
    (bag,) = folder.glob('bag/*')

    def job() -> int:
        read_recording(bag)
        return _SAMPLE * messages

    return job


def simulating(samples: int, folder: Path, slopes: bool) -> Job:
    del folder
    inputs = record(samples)

    def job() -> int:
        Course(GAINS, SETPOINT).follow(*inputs, slopes=slopes)
        return sum(array.nbytes for array in inputs)

    return job


def fitting(samples: int, folder: Path) -> Job:
    del folder
    one, counts = experiment(samples), np.ones(samples, dtype=bool)

    def job() -> int:
        fit(CHANNEL, [one], [counts])
        arrays = (one.times, *one.inputs.values(), one.samples, one.measured, one.part, counts)
        return sum(array.nbytes for array in arrays)

    return job


def closing_the_loop(samples: int, folder: Path) -> Job:
    del folder
    known = identify([_leaking(samples)], Options()).channels[CYLINDER]

    def job() -> int:
        close_loop(known.fit)
        return sum(2 * one.times.nbytes + 2 * one.measured.nbytes for one in known.experiments)

    return job


def _leaking(samples: int) -> Recording:
    """Return a device with a leak that follows a surface, at one set-point; it begins and ends at rest."""
    duration = min(samples / LOOP_RATE, SURFACE)
    schedule = surface_following(duration=duration, seed=SEED, setpoint_steps=0.0)
    recording = recording_of(draw('leakage', schedule, SEED))
    signals = recording.cylinders[CYLINDER]
    times = np.arange(samples) / LOOP_RATE
    displacement, pressure = (np.resize(one.values, samples) for one in (recording.displacement, signals.pressure))
    cylinders = {CYLINDER: CylinderSignals(Signal(times, pressure), signals.setpoint)}
    return Recording(recording.name, 0, Signal(times, displacement), cylinders, None, ())


def write_samples(samples: int, folder: Path) -> None:
    write_long_bag(folder / 'bag', samples)


def identifying(samples: int, folder: Path) -> Job:
    (bag,) = folder.glob('bag/*')
    arguments = [str(bag), '--output', str(folder / 'identified'), '--progress', 'none']

    def job() -> int:
        with redirect_stdout(StringIO()):
            code = identify_bag(arguments)
        if code:
            raise RuntimeError(f'identify_bag ended with {code}')
        return _SAMPLE * len(topics()) * samples

    return job


class Work(NamedTuple):
    """
    Some work that is measured.

    Attributes
    ----------
    title
        What it is called in a plot.
    unit
        What is counted.
    sizes
        How many of them.
    prepare
        Takes a size and a folder, and makes the job in the process that does it; its own cost is not measured.
    write
        Puts the files into the folder that it needs.

    """

    title: str
    unit: str
    sizes: tuple[int, ...]
    prepare: Callable[[int, Path], Job]
    write: Callable[[int, Path], object] = lambda size, folder: None


def _sizes(least: float, most: float) -> tuple[int, ...]:
    """Return sizes in half decades."""
    halves = np.arange(2.0 * np.log10(least), 2.0 * np.log10(most) + 0.5)
    return tuple(round(10.0 ** (half / 2.0)) for half in halves)


WORKS = {
    'read_mcap': Work(
        'read a bag, mcap',
        'messages',
        _sizes(1e3, 1e7),
        reading,
        partial(write_messages, storage='mcap'),
    ),
    'read_sqlite3': Work(
        'read a bag, sqlite3',
        'messages',
        _sizes(1e3, 1e7),
        reading,
        partial(write_messages, storage='sqlite3'),
    ),
    'simulate': Work('simulate', 'samples', _sizes(1e3, 1e7), partial(simulating, slopes=False)),
    'simulate_with_sensitivities': Work(
        'simulate with all sensitivities', 'samples', _sizes(1e3, 1e7), partial(simulating, slopes=True)
    ),
    'fit': Work('fit four parameters', 'samples', _sizes(1e3, 1e7), fitting),
    'close_loop': Work('close the loop', 'samples', _sizes(1e3, 1e7), closing_the_loop),
    'identify_bag': Work(
        'identify a bag of two cylinders',
        'samples',
        (*_sizes(1e4, 1e6), 3_600_000, 14_400_000),
        identifying,
        write_samples,
    ),
}


@dataclass(frozen=True)
class Cost:
    """
    What one size costs.

    Attributes
    ----------
    seconds, busy
        Of the fastest round: by the clock, and processor time of all threads [s].
    peak
        Memory at most, on top of the interpreter with its libraries [bytes].
    arrays
        Size of the recording's arrays, in memory or in files [bytes].

    """

    seconds: float
    busy: float
    peak: int
    arrays: int


def cost(name: str, size: int) -> Cost:
    """Return what some work costs, measured in a process of its own."""
    work = WORKS[name]
    with TemporaryDirectory() as folder:
        small, large = Path(folder) / 'small', Path(folder) / 'large'
        for one, at in ((work.sizes[0], small), (size, large)):
            at.mkdir()
            work.write(one, at)
        with ProcessPoolExecutor(1, get_context('spawn')) as process:
            return process.submit(_measured, name, size, small, large).result()


def _measured(name: str, size: int, small: Path, large: Path) -> Cost:
    work = WORKS[name]
    work.prepare(work.sizes[0], small)()
    before = _memory('VmRSS')
    job = work.prepare(size, large)
    Path('/proc/self/clear_refs').write_text('5')  # forget the peak of compiling
    rounds = []
    while not rounds or (len(rounds) < MOST_ROUNDS and sum(seconds for seconds, _ in rounds) < ENOUGH):
        busy, begin = time.process_time(), time.perf_counter()
        arrays = job()
        rounds.append((time.perf_counter() - begin, time.process_time() - busy))
    return Cost(*min(rounds), peak=max(_memory('VmHWM') - before, 0), arrays=arrays)


def _memory(name: str) -> int:
    """Return one of Linux's figures of this process [bytes]."""
    found = re.search(rf'{name}:\s+(\d+)', Path('/proc/self/status').read_text())
    return 1024 * int(found[1]) if found else 0


# figures on disk


@dataclass(frozen=True)
class Row:
    """What a size of some work costs, by which version of the program, and the machine's load before it."""

    work: str
    size: int
    code: str
    load: float
    cost: Cost


class Rows:
    """Figures of one machine and version, kept in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._about = {'machine': machine(), 'commit': commit(), 'code': code_version()}
        self._rows: dict[tuple[str, int], Row] = {}
        if path.exists():
            rows = rows_in(json.loads(path.read_text(encoding='utf-8')))
            self._rows = {(row.work, row.size): row for row in rows if row.code == self._about['code']}

    def has(self, name: str, size: int) -> bool:
        return (name, size) in self._rows

    def add(self, name: str, size: int, load: float, found: Cost) -> None:
        self._rows[name, size] = Row(name, size, self._about['code'], load, found)
        rows = [asdict(row) for row in self._rows.values()]
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_text(self._path, json.dumps({**self._about, 'rows': rows}, indent=1) + '\n')


def rows_in(told: Mapping[str, Any]) -> list[Row]:
    """Return the figures of what a file tells."""
    return [Row(**{**row, 'cost': Cost(**row['cost'])}) for row in told['rows']]


# the program


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return the exit code."""
    options = _parsed(arguments)
    rows = Rows(options.output)
    missing = [pair for pair in _wanted(options.works, options.most) if not rows.has(*pair)]
    failed = False
    for name, size in missing:
        load = os.getloadavg()[0]
        what = f'{WORKS[name].title:<34} {size:>11,} {WORKS[name].unit:<9}'
        try:
            found = cost(name, size)
        except KeyboardInterrupt:
            print('stopped; the same command goes on from here', file=sys.stderr)
            return 130
        except (InputError, OSError, BrokenProcessPool) as error:  # there is no room for it, in files or in memory
            print(f'{what} not measured: {error}', file=sys.stderr)
            failed = True
            continue
        rows.add(name, size, load, found)
        each = 1e9 * found.seconds / size
        print(f'{what} {found.seconds:>10.4g} s {each:>8.0f} ns each {found.peak / 2**20:>8.1f} MiB', flush=True)
    print(f'The figures are in {options.output}')
    return 1 if failed else 0


def _wanted(works: Sequence[str], most: float) -> list[tuple[str, int]]:
    """Return works and sizes, the small ones first."""
    pairs = [(name, size) for name in works for size in WORKS[name].sizes if size <= most]
    return sorted(pairs, key=lambda pair: pair[1])


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--works', nargs='+', choices=WORKS, default=list(WORKS), help='what is measured')
    parser.add_argument('--most', type=float, default=np.inf, help='largest size')
    parser.add_argument('--output', type=Path, default=ROOT / 'build' / 'growth.json', help='file of the figures')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
