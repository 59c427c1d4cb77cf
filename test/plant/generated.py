# SPDX-License-Identifier: Apache-2.0
"""Plants for tests: bags of the virtual rig, of which a few serve many times."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from cfd_pneumatic.recording import Recording, Signal, recording_of, write_recording
from cfd_pneumatic.rig import paper_step, record

FIRST = 1_700_000_000_000_000_000
SHIFT = 8 * 3600 * 10**9

SHIFTS = 6
"""Of each of the three devices of the small plant: so many that a run can be interrupted."""

BAGS = 3 * SHIFTS

PROGRAM = [
    sys.executable,
    '-c',
    'import sys; from cfd_pneumatic.runtime.start import identify_bag as run; sys.exit(run())',
]


@cache
def step(seed: int) -> Recording:
    """Return a short recording of the virtual rig."""
    return recording_of(record(paper_step(setpoint=34.5e3), seed=seed), 'step')


def still() -> Recording:
    """Return a recording in which nothing moves."""
    recording = step(0)
    times = recording.displacement.times
    noise = 1e-6 * np.random.default_rng(0).normal(size=times.size)
    return replace(recording, displacement=Signal(times, noise))


def write_shift(path: Path, recording: Recording, shift: int) -> Path:
    """Write a recording as the bag of a shift."""
    write_recording(path, replace(recording, epoch=FIRST + shift * SHIFT))
    return path


def write_plant(folder: Path, devices: int, shifts: int) -> Path:
    """Write bags as FOLDER/cell_1/shift_1; neighbours differ."""
    for device in range(devices):
        for shift in range(shifts):
            path = folder / f'cell_{device + 1}' / f'shift_{shift + 1}'
            write_shift(path, step((device + shift) % 4), shift)
    return folder


def start(*arguments: object, **more: object) -> subprocess.Popen[str]:
    """Start identify_bag in a session of its own, as a terminal does, with progress as lines."""
    return subprocess.Popen(
        [*PROGRAM, *map(str, arguments), '--progress', 'lines'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {'PYTHONUNBUFFERED': '1'},
        **more,
    )


def wait_for(process: subprocess.Popen[str], bags: int) -> None:
    """Wait until so many bags are done."""
    for line in process.stdout:
        words = json.loads(line)['what'].split()
        if words[0].isdecimal() and int(words[0]) >= bags:
            return
    raise AssertionError(f'it ended before {bags} bags were done: {process.stderr.read()}')


def tables(folder: Path) -> dict[str, bytes]:
    """Return the results as they are written."""
    return {name: (folder / name).read_bytes() for name in ('results.csv', 'results.parquet', 'index.html')}
