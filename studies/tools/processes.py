# SPDX-License-Identifier: Apache-2.0
"""Processes: work side by side in some; how they start, what the system says of them, when their messages came."""

from __future__ import annotations

import itertools
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from inspect import signature
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.progress import track
from scipy import stats

Work = TypeVar('Work')
Result = TypeVar('Result')

STAMP = struct.Struct('<iI')
WARMING = 0.1  # share of a process' life in which its memory is not looked at
BLOCKS = 24  # of the run, over which memory is averaged
STAMP_AT = 4  # behind the four bytes that say how a message is encoded


def side_by_side(
    function: Callable[[Work], Result], jobs: Sequence[Work], what: str, processes: int = 2
) -> Iterator[Result]:
    """Yield what a function makes of each job, in processes of one thread each, and show how far it is; 0: in this."""
    if processes == 0:
        yield from map(function, jobs)
        return
    os.environ['OMP_NUM_THREADS'] = '1'  # read by the new processes
    with ProcessPoolExecutor(processes, get_context('spawn')) as pool:
        yield from track(pool.map(function, jobs), description=what, total=len(jobs))


def started(*arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Start Python in a session of its own: an interrupt reaches who has started it, and ends it then."""
    return subprocess.Popen([sys.executable, *arguments], start_new_session=True, **options)


def seen_of(pid: int) -> dict[str, float]:
    """Return what the system knows of a process: memory [KiB], threads, descriptors, processor time [s]."""
    proc = Path(f'/proc/{pid}')
    rolled = dict(line.split(':') for line in (proc / 'smaps_rollup').read_text().splitlines()[1:])
    memory = {key: float(rolled[field].split()[0]) for key, field in (('pss', 'Pss'), ('own', 'Private_Dirty'))}
    fields = (proc / 'stat').read_text().rpartition(')')[2].split()
    return {
        **memory,
        'threads': int(fields[17]),
        'descriptors': len(os.listdir(proc / 'fd')),
        'processor': (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK'),
    }


class Heard:
    """A callback that is told the stamp of a message, and when it was sent and received."""

    def __init__(self, take: Callable[[int, Mapping[str, int]], None]) -> None:
        self._take = take
        self.__signature__ = signature(lambda message, info: None)  # by which rclpy sees that it wants both

    def __call__(self, *given: Any) -> None:
        message, info = given if len(given) == 2 else given[0]  # EventsExecutor gives the pair
        seconds, rest = STAMP.unpack_from(message, STAMP_AT)
        self._take(seconds * 10**9 + rest, info)


def slope(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[float, float]:
    """Return by how much a figure grows in an hour, and half the length of its 95 % interval, beyond a warm-up."""
    blocks = []
    for _, life in itertools.groupby(rows, lambda row: row['pid']):
        one = list(life)
        at, value = (np.array([row[name] for row in one]) for name in ('at', key))
        later = at >= at[0] + WARMING * (at[-1] - at[0])
        parts = max(round(BLOCKS * len(one) / len(rows)), 1)
        means = [
            (np.mean(times), np.mean(values))
            for times, values in zip(np.array_split(at[later], parts), np.array_split(value[later], parts))
            if len(times)
        ]
        blocks.append(np.array(means) - np.mean(means, axis=0))
    if not blocks:
        return float('nan'), float('nan')
    hours, change = np.concatenate(blocks).T
    hours = hours / 3600.0
    freedom = len(hours) - len(blocks) - 1
    squares = float(hours @ hours)
    if freedom < 1 or squares == 0.0:
        return float('nan'), float('nan')
    grown = float(hours @ change) / squares
    error = np.sqrt(float(np.sum((change - grown * hours) ** 2)) / freedom / squares)
    return grown, float(stats.t.ppf(0.975, freedom) * error)


def span(rows: Sequence[Mapping[str, Any]], key: str) -> str:
    """Return between which figures one lay."""
    figures = [row[key] for row in rows]
    return str(figures[0]) if len(set(figures)) == 1 else f'{min(figures)} to {max(figures)}'
