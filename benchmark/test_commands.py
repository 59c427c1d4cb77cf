# SPDX-License-Identifier: Apache-2.0
"""
Whole commands as a user waits for them, in units of what their heaviest libraries take to import in the same run.

    make benchmark ARGS='-k commands'

Each command is a process of its own, the median of five. Stages are what the command itself says it does
(`--progress lines`), with what the interpreter and the imports take before the first. The measured runs are left out
where the data are not to be had.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cfd_pneumatic.examples import EXAMPLES
from cfd_pneumatic.recording import recording_of, write_recording
from studies.panel import MAKES, draw
from studies.tools.provenance import ROOT
from studies.tools.ros_environment import isolate

ROUNDS = 5
IMPORTS = 'import numba, scipy.optimize, matplotlib.pyplot'
DATA = Path(os.environ.get('CFD_PNEUMATIC_DATA', ROOT.parent / 'shared' / 'data')) / 'pneumatic_actuator' / 'friction'
FAULT = 'effects_a.leak_conductance=1e-10'
LIMITS = '--stroke 3e-3 --speed 0.1 --pressures 35e3 70e3 --duration 20 --wanted k_v leakage lost_motion'
TOGETHER = 5
"""Nodes that start at once."""

CORES = pytest.mark.parametrize('core', ['auto', 'linear'])


def program(name: str, *arguments: str | Path) -> list[str]:
    """Return the command of an installed program."""
    begin = f'import sys; from cfd_pneumatic.runtime.start import {name}; sys.exit({name}())'
    return [sys.executable, '-c', begin, *map(str, arguments)]


def seconds(command: Sequence[str]) -> float:
    """Return how long a command takes."""
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def importing() -> float:
    """Return what the imports take now [s]: within a minute that changes by a third."""
    return seconds([sys.executable, '-c', IMPORTS])


def stages(command: Sequence[str]) -> list[tuple[str, float]]:
    """Return what a command says that it does, with when each begins [s]; the end of the process last."""
    began = time.perf_counter()
    found = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            found.append((json.loads(line)['what'], time.perf_counter() - began))
    assert process.returncode == 0
    return [*found, ('ended', time.perf_counter() - began)]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with a minute of the rig, identified."""
    folder = tmp_path_factory.mktemp('commands')
    record = ('surface_following', '--device', 'paper', '--faults', FAULT, '--output', folder / 'rig')
    seconds(program('record_rig', *record))
    seconds(program('identify_bag', folder / 'rig', '--close-loop', '--output', folder / 'identified'))
    return folder


def timed(benchmark, table, name: str, command: Sequence[str]) -> None:
    """Time a command over its rounds, and tell it in units of the imports, which are timed before each."""
    imports: list[float] = []
    benchmark.group = 'whole commands'
    benchmark.pedantic(seconds, (command,), setup=lambda: imports.append(importing()), rounds=ROUNDS, warmup_rounds=1)
    told(benchmark, table, name, benchmark.stats.stats.median, imports)


def identified(benchmark, table, name: str, arguments: Sequence[str | Path], output: Path) -> None:
    """Time an identification, and tell its stages."""
    command = program('identify_bag', *arguments, '--close-loop', '--output', output)
    timed(benchmark, table, name, [*command, '--progress', 'none'])
    runs = [stages([*command, '--progress', 'lines']) for _ in range(3)]
    middle = sorted(runs, key=lambda run: run[-1][1])[1]
    benchmark.extra_info['stages'] = middle
    table.append(f'  {"; ".join(f"{when:.2f} s {what}" for what, when in middle)}')


@CORES
def test_rig(benchmark, table, folder, core):
    arguments = [folder / 'rig', '--core', core]
    identified(benchmark, table, f'identify_bag, a minute of the rig, --core {core}', arguments, folder / 'output')


@CORES
@pytest.mark.parametrize('run', ['O-ring257_3bar', 'Kidney_2bar'])
def test_measured(benchmark, table, folder, run, core):
    recording = DATA / f'{run}.csv'
    if not recording.is_file():
        pytest.skip('the measured recordings are not to be had here')
    mapping = ROOT / 'config' / 'pneumatic_actuator.yaml'
    arguments = [recording, '--mapping', mapping, '--core', core]
    identified(benchmark, table, f'identify_bag, {run}, --core {core}', arguments, folder / 'output')


@pytest.mark.parametrize('schedule', ['out_and_back', 'surface_following'])
def test_law(benchmark, table, folder, schedule):
    """A device of full physics whose supply valve does not close: no effect of the library explains it."""
    drawn = draw('worn_seat', schedule, 11000, make=next(iter(MAKES)))
    write_recording(folder / schedule, recording_of(drawn.recording, epoch=10**18))
    identified(benchmark, table, f'identify_bag, a law, {schedule}', [folder / schedule], folder / 'output')


def test_plan(benchmark, table, folder):
    found = folder / 'identified'
    arguments = [found / 'parameters.yaml', '--report', found / 'report.json', '--output', folder / 'planned']
    timed(benchmark, table, 'plan_experiment', program('plan_experiment', *arguments, *LIMITS.split()))


@pytest.mark.parametrize('name', EXAMPLES)
def test_help(benchmark, table, name):
    timed(benchmark, table, f'{name} --help', program(name, '--help'))


def ready(name: str, number: int, environment: dict[str, str]) -> float:
    """Return how long a node takes until it is ready [s]."""
    began = time.perf_counter()
    command = program(name, '--ros-args', '-r', f'__ns:=/start_{number}')
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | environment) as process:
        assert process.stderr is not None
        said = next(line for line in process.stderr if 'ready' in line)
        took = time.perf_counter() - began
        process.send_signal(signal.SIGINT)
    assert said
    return took


@pytest.fixture
def graph():
    """Keep nodes to a graph of their own."""
    pytest.importorskip('rclpy', reason='ROS 2 is not to be had here')
    isolate()


@pytest.mark.usefixtures('graph')
@pytest.mark.parametrize('name', ['sim_node', 'monitor_node'])
def test_ready(benchmark, table, name):
    benchmark.group = 'nodes: until they are ready'
    ready(name, 0, {})
    times = [ready(name, number, {}) for number in range(ROUNDS)]
    benchmark.pedantic(lambda: None, rounds=1)
    told(benchmark, table, f'{name}, ready with warm caches', statistics.median(times))


@pytest.mark.usefixtures('graph')
@pytest.mark.parametrize('count', [1, TOGETHER])
def test_first_start(benchmark, table, tmp_path, count):
    benchmark.group = 'nodes: until they are ready'
    cold = {'NUMBA_CACHE_DIR': str(tmp_path)}
    with ThreadPoolExecutor(count) as pool:
        times = list(pool.map(lambda number: ready('sim_node', number, cold), range(count)))
    benchmark.pedantic(lambda: None, rounds=1)
    told(benchmark, table, f'first start of {count} sim_node, the last ready', max(times))


def told(benchmark, table, what: str, took: float, imports: Sequence[float] = ()) -> None:
    """Tell how long something took [s], in units of the imports, too, timed now where they were not before."""
    unit = statistics.median(imports or [importing() for _ in range(ROUNDS)])
    benchmark.extra_info.update(seconds=took, units=took / unit)
    table.append(f'{what}: {took:.2f} s, {took / unit:.2f} units of {unit:.2f} s')


def test_compile_kernels(benchmark, table, tmp_path, monkeypatch):
    benchmark.group = 'whole commands'
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    benchmark.pedantic(seconds, (program('compile_kernels'),), rounds=1)
    told(benchmark, table, 'compile_kernels', benchmark.stats.stats.median)
