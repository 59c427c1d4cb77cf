# SPDX-License-Identifier: Apache-2.0
"""
What work costs as recordings grow: time and peak memory, each size in a process of its own.

    CFD_PNEUMATIC_SAMPLES=14400000 make benchmark ARGS='-k growth'    to four hours at 1 kHz: 10 GB of temporary files

A small size compiles everything first; memory is what comes on top of the process then, told by Linux. The device of
`identify_bag --close-loop` follows a surface and leaks.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from cfd_pneumatic.commands import identify_bag_main as identify_bag
from cfd_pneumatic.identification import fit_model
from cfd_pneumatic.model import Course
from cfd_pneumatic.recording import read_recording
from cfd_pneumatic.rig import surface_following
from studies.documents.strokes import CHANNEL, GAINS, SETPOINT, experiment, record
from studies.panel import draw
from studies.trials.long_bag import topics, write_long_bag

MOST = float(os.environ.get('CFD_PNEUMATIC_SAMPLES', 1_000_000))
SIZES = (10_000, 100_000, 1_000_000, 3_600_000, 14_400_000)
SEED = 60

Job = Callable[[], object]


def simulating(samples: int, folder: Path, slopes: bool) -> Job:
    inputs = record(samples)
    return lambda: Course(GAINS, SETPOINT).simulate_piece(*inputs, slopes=slopes)


def fitting(samples: int, folder: Path) -> Job:
    one = experiment(samples)
    return lambda: fit_model(CHANNEL, [one])


def write_messages(storage: str, messages: int, folder: Path) -> None:
    write_long_bag(folder / 'bag', messages // len(topics()), storage)


def reading(messages: int, folder: Path) -> Job:
    return partial(read_recording, folder / 'bag')


def write_leaking(samples: int, folder: Path) -> None:
    schedule = surface_following(setpoint_steps=0.0, seed=SEED, sampling_period=1e-3)
    truth = draw('leakage', schedule, SEED).truth.samples
    cylinders = np.stack([truth.pressures, truth.setpoints]).transpose(2, 0, 1).reshape(4, -1)
    write_long_bag(folder / 'bag', samples, signals=np.vstack([truth.displacement, cylinders]))


def identifying(samples: int, folder: Path) -> Job:
    arguments = [str(folder / 'bag'), '--close-loop', '--output', str(folder / 'identified'), '--progress', 'none']

    def job() -> None:
        with redirect_stdout(StringIO()):
            assert identify_bag(arguments) == 0

    return job


WRITE = {
    'read_mcap': partial(write_messages, 'mcap'),
    'read_sqlite3': partial(write_messages, 'sqlite3'),
    'identify_bag': write_leaking,
}
"""What puts the files that some work needs of a size into a folder."""

PREPARE = {
    'read_mcap': reading,
    'read_sqlite3': reading,
    'simulate': partial(simulating, slopes=False),
    'simulate_with_sensitivities': partial(simulating, slopes=True),
    'fit': fitting,
    'identify_bag': identifying,
}
"""What makes the job of a size, in the process that does it."""


def measured(name: str, small: Path, size: int, large: Path) -> dict[str, float]:
    """Return time, processor time of all threads [s] and peak memory [bytes]."""
    PREPARE[name](SIZES[0], small)()
    before = memory('VmRSS')
    job = PREPARE[name](size, large)
    Path('/proc/self/clear_refs').write_text('5')  # forget the peak of compiling
    busy, begin = time.process_time(), time.perf_counter()
    job()
    seconds, busy = time.perf_counter() - begin, time.process_time() - busy
    return {'size': size, 'seconds': seconds, 'busy': busy, 'peak': max(memory('VmHWM') - before, 0)}


def memory(name: str) -> int:
    """Return one of Linux's figures of this process [bytes]."""
    return 1024 * int(re.search(rf'{name}:\s+(\d+)', Path('/proc/self/status').read_text())[1])


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('name', PREPARE)
def test_growth(benchmark, name, size):
    if size > MOST:
        pytest.skip(f'CFD_PNEUMATIC_SAMPLES={size} has it measured')
    benchmark.group = f'cost against size, {name}'
    with TemporaryDirectory() as folder, ProcessPoolExecutor(1, get_context('spawn')) as process:
        small, large = Path(folder) / 'small', Path(folder) / 'large'
        for samples, own in ((SIZES[0], small), (size, large)):
            own.mkdir()
            if name in WRITE:
                WRITE[name](samples, own)
        found = benchmark.pedantic(lambda: process.submit(measured, name, small, size, large).result())
        compared = large / 'identified' / 'compare.mcap'
        if compared.exists():
            found['compared'] = compared.stat().st_size
    benchmark.extra_info.update(found)
