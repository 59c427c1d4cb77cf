# SPDX-License-Identifier: Apache-2.0
"""Run work in processes, start programs, and measure their memory, processor time and messages."""

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
WARMING = 0.1  # share of a process' life without a measurement of memory
BLOCKS = 24  # parts of a run over which memory is averaged
STAMP_AT = 4  # after the four bytes of the encapsulation header


def side_by_side(
    function: Callable[[Work], Result], jobs: Sequence[Work], description: str, processes: int = 2
) -> Iterator[Result]:
    """Yield the result of each job from processes of one thread each, with progress; 0: in this process."""
    if processes == 0:
        yield from map(function, jobs)
        return
    os.environ['OMP_NUM_THREADS'] = '1'  # read by the new processes
    with ProcessPoolExecutor(processes, get_context('spawn')) as pool:
        yield from track(pool.map(function, jobs), description=description, total=len(jobs))


def started(*arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Start Python in a new session, so that an interrupt of the terminal does not reach the process."""
    return subprocess.Popen([sys.executable, *arguments], start_new_session=True, **options)


def usage_of(pid: int) -> dict[str, float]:
    """Return the usage of a process: memory [KiB], threads, descriptors, processor time [s]."""
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


class StampedCallback:
    """Callback of a raw subscription that passes on a message's stamp and times of sending and reception."""

    def __init__(self, handle: Callable[[int, Mapping[str, int]], None]) -> None:
        self._handle = handle
        self.__signature__ = signature(
            lambda message, info: None
        )  # rclpy reads from the signature that both are wanted

    def __call__(self, *arguments: Any) -> None:
        message, info = arguments if len(arguments) == 2 else arguments[0]  # EventsExecutor passes a pair
        seconds, nanoseconds = STAMP.unpack_from(message, STAMP_AT)
        self._handle(seconds * 10**9 + nanoseconds, info)


def slope(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[float, float]:
    """Return the growth of a figure per hour after a warm-up, and half the length of its 95 % interval."""
    blocks = []
    for _, life in itertools.groupby(rows, lambda row: row['pid']):
        samples = list(life)
        at, value = (np.array([row[name] for row in samples]) for name in ('at', key))
        later = at >= at[0] + WARMING * (at[-1] - at[0])
        parts = max(round(BLOCKS * len(samples) / len(rows)), 1)
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
    """Return the range of a figure as text."""
    figures = [row[key] for row in rows]
    return str(figures[0]) if len(set(figures)) == 1 else f'{min(figures)} to {max(figures)}'
