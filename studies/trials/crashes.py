# SPDX-License-Identifier: Apache-2.0
"""
What is left of results when a program is killed, or its disk fills up: `make crash`.

Each scenario is run once under strace, which counts the system calls that change a name. It is run again for each of
them and killed there, before the call; and for file sizes spread over its largest file, beyond which nothing can be
written. After that what is at the path has to be the old or the new whole, a reader has to refuse what is neither, and
the same command has to succeed and leave nothing aside.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rich.progress import track

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import checksum
from cfd_pneumatic.recording import read_recording
from studies.documents.markdown import table

CALLS = 'rename,renameat,renameat2,unlink,unlinkat,mkdir,mkdirat,rmdir,link,linkat,symlink,symlinkat'
"""System calls that change names."""

Call = tuple[str, int]
"""A system call, and how many of its kind a process made up to it."""

INTERPRETER = [sys.executable, '-B', '-m']
"""Python that writes no files of its own."""


@dataclass(frozen=True)
class Scenario:
    """
    A program at work in a folder.

    Attributes
    ----------
    name
        In words.
    arguments
        Module and arguments of the program, run in the folder.
    prepare
        What is in the folder before.
    state
        Says what is at the path: `old`, `new`, `none`, `refused` by readers; raises what else it is.

    """

    name: str
    arguments: tuple[str, ...]
    prepare: Callable[[Path], None]
    state: Callable[[Path], str]


@dataclass
class Outcome:
    """What came of a scenario: how often it was ended, and what was there then, by state."""

    scenario: str
    kills: int = 0
    full: int = 0
    states: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def module(name: str) -> str:
    """Return the module of a program."""
    return f'cfd_pneumatic.commands.{name}'


def _make_bag(folder: Path, name: str = 'bag', seed: int = 0) -> None:
    _done(folder, module('record_rig'), 'out_and_back', '--device', 'paper', '--seed', str(seed), '--output', name)


def _done(folder: Path, *arguments: str) -> None:
    subprocess.run([*INTERPRETER, *arguments], cwd=folder, check=True, capture_output=True)


def _set_of_results(folder: Path) -> str:
    """Return whether the results in a folder are those of one run, and of which."""
    report = folder / 'report.json'
    if not report.exists():
        return 'none'
    content = json.loads(report.read_text(encoding='utf-8'))
    fits = all((folder / name).is_file() and checksum(folder / name) == sum_ for name, sum_ in content['files'].items())
    if not fits:
        return 'refused' if _is_refused(folder) else 'mixed'
    return 'new' if 'compare.mcap' in content['files'] else 'old'


def _is_refused(folder: Path) -> bool:
    done = subprocess.run(
        [*INTERPRETER, module('plan_experiment'), 'parameters.yaml', '--report', 'report.json', '--output', 'plan'],
        cwd=folder,
        capture_output=True,
        check=False,
    )
    return done.returncode == 2 and b'identify again' in done.stderr


def _identified_before(folder: Path) -> None:
    _make_bag(folder)
    _done(folder, module('identify_bag'), 'bag', '--output', 'out')


def _identified_beside(folder: Path) -> None:
    _identified_before(folder)
    (folder / 'out' / 'mine.txt').write_text('mine', encoding='utf-8')


def _identified_in_place(folder: Path) -> None:
    _identified_before(folder)
    _keep_in_place(folder / 'out')


def _keep_in_place(folder: Path) -> None:
    """Give a folder a mode that a new one would not have: it is not exchanged, as a mount point can't be."""
    folder.chmod(0o700)


def _with_what_is_mine(folder: Path) -> str:
    if (folder / 'out' / 'mine.txt').read_text(encoding='utf-8') != 'mine':
        raise AssertionError('what was mine is gone')
    return _set_of_results(folder / 'out')


def _state_of_bag(path: Path) -> str:
    if not path.exists():
        return 'none'
    try:
        return 'old' if len(read_recording(path).displacement) < OLD else 'new'
    except InputError:
        return 'half'


OLD = 2000
"""Samples of a displacement that earlier bags have less of."""


def _table(folder: Path, rows: int = 3000) -> None:
    lines = [f'{0.01 * row},{1e-3 * (row % 100)},{2e5 + row}' for row in range(rows)]
    (folder / 'table.csv').write_text('\n'.join(['t,x,p', *lines]) + '\n', encoding='utf-8')
    (folder / 'table.yaml').write_text(
        'table: {time: {column: t, unit: s}, delimiter: comma, header_rows: 1}\n'
        'displacement: {column: x, unit: m}\n'
        'cylinder_a: {pressure: {column: p, unit: Pa, reference: absolute}}\n',
        encoding='utf-8',
    )


def _table_over_a_bag(folder: Path) -> None:
    _table(folder, 1000)
    _done(folder, *_CSV_TO_BAG)
    _table(folder)


def _table_in_place_of_a_bag(folder: Path) -> None:
    _table_over_a_bag(folder)
    _keep_in_place(folder / 'made')


def _plant(folder: Path) -> None:
    (folder / 'plant').mkdir()
    _make_bag(folder / 'plant', 'one')


def _state_of_plant(folder: Path) -> str:
    results = folder / 'out' / 'plant' / 'one'  # the device is the folder of the bag
    if not results.exists():
        return 'none'
    if not (results / 'row.json').is_file():
        return 'half'
    return _set_of_results(results)


_CSV_TO_BAG = (module('csv_to_bag'), 'table.csv', '--mapping', 'table.yaml', '--output', 'made')
_IDENTIFY = (module('identify_bag'), 'bag', '--close-loop', '--output', 'out')

SCENARIOS = (
    Scenario('identify_bag, a new folder', _IDENTIFY, _make_bag, lambda folder: _set_of_results(folder / 'out')),
    Scenario(
        'identify_bag over earlier results',
        _IDENTIFY,
        _identified_before,
        lambda folder: _set_of_results(folder / 'out'),
    ),
    Scenario('identify_bag where something else is', _IDENTIFY, _identified_beside, _with_what_is_mine),
    Scenario(
        'identify_bag in a folder that cannot be exchanged',
        _IDENTIFY,
        _identified_in_place,
        lambda folder: _set_of_results(folder / 'out'),
    ),
    Scenario(
        'identify_bag --each',
        (module('identify_bag'), 'plant', '--each', '--close-loop', '--jobs', '1', '--output', 'out'),
        _plant,
        _state_of_plant,
    ),
    Scenario('csv_to_bag', _CSV_TO_BAG, _table, lambda folder: _state_of_bag(folder / 'made')),
    Scenario(
        'csv_to_bag --overwrite over a bag',
        (*_CSV_TO_BAG, '--overwrite'),
        _table_over_a_bag,
        lambda folder: _state_of_bag(folder / 'made'),
    ),
    Scenario(
        'csv_to_bag --overwrite in a folder that cannot be exchanged',
        (*_CSV_TO_BAG, '--overwrite'),
        _table_in_place_of_a_bag,
        lambda folder: _state_of_bag(folder / 'made'),
    ),
    Scenario(
        'record_rig',
        (module('record_rig'), 'out_and_back', '--output', 'bag'),
        lambda folder: None,
        lambda folder: _state_of_bag(folder / 'bag'),
    ),
)


def calls_of(scenario: Scenario, folder: Path) -> list[Call]:
    """Return the system calls that change a name below a folder: and how many of its kind came before."""
    log = folder / 'calls.log'
    _traced(scenario, folder, ['-o', str(log), '-e', f'trace={CALLS}'])
    seen: Counter[tuple[str, str]] = Counter()
    found: dict[Call, None] = {}
    for line in log.read_text(encoding='utf-8').splitlines():
        call = re.match(rf'(\d+) +({CALLS.replace(",", "|")})\((.*)', line)
        if call:
            seen[call[1], call[2]] += 1
            if str(folder) in call[3] or not re.search('"/', call[3]):
                found[call[2], seen[call[1], call[2]]] = None
    return list(found)


def _traced(scenario: Scenario, folder: Path, options: Sequence[str]) -> None:
    command = ['strace', '-f', '-qq', *options, *INTERPRETER, *scenario.arguments]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet, start_new_session=True) as running:
        running.wait()
        with suppress(ProcessLookupError):  # workers of a program that was killed
            os.killpg(running.pid, signal.SIGKILL)


def killed(scenario: Scenario, folder: Path, call: Call) -> None:
    """Run a program and kill it before one of its system calls that change a name."""
    name, which = call
    _traced(scenario, folder, ['-o', '/dev/null', '-e', f'inject={name}:signal=KILL:when={which}'])


def full(scenario: Scenario, folder: Path, size: int) -> str | None:
    """Run a program that can write no file beyond a size [bytes]; return what is wrong with how it ended."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    done = subprocess.run(
        [*INTERPRETER, *scenario.arguments], cwd=folder, capture_output=True, check=False, preexec_fn=limit, text=True
    )
    if 'Traceback' in done.stderr:
        return f'a traceback at {size} bytes: {done.stderr.strip().splitlines()[-1]}'
    return None


def tried(scenario: Scenario, kills: Sequence[Call] | None = None, sizes: Sequence[int] = ()) -> Outcome:
    """Return what comes of a scenario: killed at some of its calls, all by default, and with a disk that is full."""
    outcome = Outcome(scenario.name)
    with tempfile.TemporaryDirectory() as name:
        origin = Path(name) / 'origin'
        origin.mkdir()
        scenario.prepare(origin)
        before = scenario.state(origin)
        if kills is None:
            kills = calls_of(scenario, _copy(origin))
        for at in track(kills, description=scenario.name, disable=not sys.stderr.isatty()):
            folder = _copy(origin)
            killed(scenario, folder, at)
            outcome.kills += 1
            _judge(scenario, folder, before, outcome, f'killed at {at[0]} {at[1]}')
        for size in sizes:
            folder = _copy(origin)
            fault = full(scenario, folder, size)
            outcome.full += 1
            if fault:
                outcome.faults.append(fault)
            _judge(scenario, folder, before, outcome, f'full at {size} bytes')
    return outcome


def _copy(origin: Path) -> Path:
    folder = origin.with_name('tried')
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(origin, folder)
    return folder


def _judge(scenario: Scenario, folder: Path, before: str, outcome: Outcome, what: str) -> None:
    """Look at what is left, and whether the same command then succeeds and takes away what was left aside."""
    try:
        state = scenario.state(folder)
    except Exception as error:
        state = f'{type(error).__name__}: {error}'
    outcome.states[state] = outcome.states.get(state, 0) + 1
    if state not in (before, 'new', 'refused'):
        outcome.faults.append(f'{what}: {state} of {before}')
    arguments = list(scenario.arguments)
    if arguments[0] in (module('csv_to_bag'), module('record_rig')) and state != 'none':
        arguments.append('--overwrite')  # an earlier bag stays otherwise
    done = subprocess.run([*INTERPRETER, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode or scenario.state(folder) != 'new':
        outcome.faults.append(f'{what}, then again: {done.stderr.strip()[-200:]}')
    left = sorted(path.name for path in folder.rglob('.*~*'))
    if left:
        outcome.faults.append(f'{what}, then again: left {", ".join(left)}')


def document(outcomes: Sequence[Outcome]) -> str:
    """Return the part of the page."""
    rows = [
        (
            one.scenario,
            one.kills,
            one.full,
            ', '.join(f'{state} {count}' for state, count in sorted(one.states.items())),
            len(one.faults),
        )
        for one in outcomes
    ]
    return table(('program', 'killed at', 'disk full at', 'what was there then', 'faults'), rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try all scenarios; return 1 where something is half, mixed or left."""
    parser = argparse.ArgumentParser(prog='crashes', description=__doc__.split('\n\n')[0])
    parser.add_argument('--sizes', type=int, default=20, help='of files at which the disk is full')
    parser.add_argument('--only', metavar='WORDS', default='', help='scenarios whose name holds these words')
    options = parser.parse_args(arguments)
    if shutil.which('strace') is None:
        print('crashes: strace is not to be had here: install it')
        return 2
    os.environ['OMP_NUM_THREADS'] = '1'
    sizes = [int(2 ** (6 + 0.9 * rank)) for rank in range(options.sizes)]
    outcomes = []
    for scenario in SCENARIOS:
        if options.only in scenario.name:
            outcomes.append(tried(scenario, sizes=sizes))
            print('\n'.join([f'{scenario.name}: {outcomes[-1].states}', *outcomes[-1].faults]), flush=True)
    print(document(outcomes))
    return 1 if any(one.faults for one in outcomes) else 0


if __name__ == '__main__':
    sys.exit(main())
