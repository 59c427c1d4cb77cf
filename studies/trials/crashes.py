# SPDX-License-Identifier: Apache-2.0
"""
Check the results of programs that are killed, or run out of disk space: `make crash`.

The first run of a scenario is under strace, which lists the system calls that change a name. Further runs are killed
before each of these calls, or have a limit on the size of files. After each run the path must hold the complete old or
the complete new results, or readers must refuse the results. A repetition of the command must succeed, and must remove
all temporary files.
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
"""Name of a system call, and its number among the calls of this name in a process."""

INTERPRETER = [sys.executable, '-B', '-m']
"""Python, without files of compiled code."""


@dataclass(frozen=True)
class Scenario:
    """
    A run of a program in a folder.

    Attributes
    ----------
    name
        Name for people.
    arguments
        Module and arguments of the program, run in the folder.
    prepare
        Function that fills the folder before the run.
    state
        Function that returns the state of the results: `old`, `new`, `none`, or `refused` by readers.

    """

    name: str
    arguments: tuple[str, ...]
    prepare: Callable[[Path], None]
    state: Callable[[Path], str]


@dataclass
class Outcome:
    """Outcome of a scenario: number of kills and of full disks, and number of results by state."""

    scenario: str
    kills: int = 0
    full: int = 0
    states: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def module(name: str) -> str:
    """Return the module of a program."""
    return f'cfd_pneumatic.commands.{name}'


def _make_bag(folder: Path, name: str = 'bag', seed: int = 0) -> None:
    _run(folder, module('record_rig'), 'out_and_back', '--device', 'paper', '--seed', str(seed), '--output', name)


def _run(folder: Path, *arguments: str) -> None:
    subprocess.run([*INTERPRETER, *arguments], cwd=folder, check=True, capture_output=True)


def _state_of_results(folder: Path) -> str:
    """Return the state of the results in a folder."""
    report = folder / 'report.json'
    if not report.exists():
        return 'none'
    content = json.loads(report.read_text(encoding='utf-8'))
    fits = all((folder / name).is_file() and checksum(folder / name) == sum_ for name, sum_ in content['files'].items())
    if not fits:
        return 'refused' if _is_refused(folder) else 'mixed'
    return 'new' if 'compare.mcap' in content['files'] else 'old'


def _is_refused(folder: Path) -> bool:
    ended = subprocess.run(
        [*INTERPRETER, module('plan_experiment'), 'parameters.yaml', '--report', 'report.json', '--output', 'plan'],
        cwd=folder,
        capture_output=True,
        check=False,
    )
    return ended.returncode == 2 and b'identify again' in ended.stderr


def _identified_before(folder: Path) -> None:
    _make_bag(folder)
    _run(folder, module('identify_bag'), 'bag', '--output', 'out')


def _identified_with_file_of_user(folder: Path) -> None:
    _identified_before(folder)
    (folder / 'out' / 'mine.txt').write_text('mine', encoding='utf-8')


def _identified_in_place(folder: Path) -> None:
    _identified_before(folder)
    _keep_in_place(folder / 'out')


def _keep_in_place(folder: Path) -> None:
    """Give a folder an unusual mode; the program then keeps the folder, as it keeps a mount point."""
    folder.chmod(0o700)


def _state_with_file_of_user(folder: Path) -> str:
    if (folder / 'out' / 'mine.txt').read_text(encoding='utf-8') != 'mine':
        raise AssertionError('the file of the user is lost')
    return _state_of_results(folder / 'out')


def _state_of_bag(path: Path) -> str:
    if not path.exists():
        return 'none'
    try:
        return 'old' if len(read_recording(path).displacement) < OLD else 'new'
    except InputError:
        return 'half'


OLD = 2000
"""Limit of the number of samples; bags of an earlier run have fewer."""


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
    _run(folder, *_CSV_TO_BAG)
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
    return _state_of_results(results)


_CSV_TO_BAG = (module('csv_to_bag'), 'table.csv', '--mapping', 'table.yaml', '--output', 'made')
_IDENTIFY = (module('identify_bag'), 'bag', '--close-loop', '--output', 'out')

SCENARIOS = (
    Scenario('identify_bag, a new folder', _IDENTIFY, _make_bag, lambda folder: _state_of_results(folder / 'out')),
    Scenario(
        'identify_bag over earlier results',
        _IDENTIFY,
        _identified_before,
        lambda folder: _state_of_results(folder / 'out'),
    ),
    Scenario(
        'identify_bag in a folder with a file of the user',
        _IDENTIFY,
        _identified_with_file_of_user,
        _state_with_file_of_user,
    ),
    Scenario(
        'identify_bag in a folder that cannot be exchanged',
        _IDENTIFY,
        _identified_in_place,
        lambda folder: _state_of_results(folder / 'out'),
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
    """Return the system calls of a scenario that change a name below a folder."""
    log = folder / 'calls.log'
    _traced(scenario, folder, ['-o', str(log), '-e', f'trace={CALLS}'])
    counts: Counter[tuple[str, str]] = Counter()
    calls: dict[Call, None] = {}
    for line in log.read_text(encoding='utf-8').splitlines():
        match = re.match(rf'(\d+) +({CALLS.replace(",", "|")})\((.*)', line)
        if match:
            counts[match[1], match[2]] += 1
            if str(folder) in match[3] or not re.search('"/', match[3]):
                calls[match[2], counts[match[1], match[2]]] = None
    return list(calls)


def _traced(scenario: Scenario, folder: Path, options: Sequence[str]) -> None:
    command = ['strace', '-f', '-qq', *options, *INTERPRETER, *scenario.arguments]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet, start_new_session=True) as running:
        running.wait()
        with suppress(ProcessLookupError):  # workers of a killed program
            os.killpg(running.pid, signal.SIGKILL)


def run_and_kill(scenario: Scenario, folder: Path, call: Call) -> None:
    """Run a program and kill it before one of its system calls that change a name."""
    name, number = call
    _traced(scenario, folder, ['-o', '/dev/null', '-e', f'inject={name}:signal=KILL:when={number}'])


def run_on_full_disk(scenario: Scenario, folder: Path, size: int) -> str | None:
    """Run a program with a limit on the size of files [bytes]; return its fault, if any."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    ended = subprocess.run(
        [*INTERPRETER, *scenario.arguments], cwd=folder, capture_output=True, check=False, preexec_fn=limit, text=True
    )
    if 'Traceback' in ended.stderr:
        return f'a traceback at {size} bytes: {ended.stderr.strip().splitlines()[-1]}'
    return None


def try_scenario(scenario: Scenario, kills: Sequence[Call] | None = None, sizes: Sequence[int] = ()) -> Outcome:
    """Run a scenario with kills before calls (default: all), and with full disks; return the outcome."""
    outcome = Outcome(scenario.name)
    with tempfile.TemporaryDirectory() as name:
        origin = Path(name) / 'origin'
        origin.mkdir()
        scenario.prepare(origin)
        before = scenario.state(origin)
        if kills is None:
            kills = calls_of(scenario, _copy(origin))
        for call in track(kills, description=scenario.name, disable=not sys.stderr.isatty()):
            folder = _copy(origin)
            run_and_kill(scenario, folder, call)
            outcome.kills += 1
            _judge(scenario, folder, before, outcome, f'killed at {call[0]} {call[1]}')
        for size in sizes:
            folder = _copy(origin)
            fault = run_on_full_disk(scenario, folder, size)
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


def _judge(scenario: Scenario, folder: Path, before: str, outcome: Outcome, event: str) -> None:
    """Check the state after an event, and whether the command then succeeds and removes temporary files."""
    try:
        state = scenario.state(folder)
    except Exception as error:
        state = f'{type(error).__name__}: {error}'
    outcome.states[state] = outcome.states.get(state, 0) + 1
    if state not in (before, 'new', 'refused'):
        outcome.faults.append(f'{event}: state {state}, before {before}')
    arguments = list(scenario.arguments)
    if arguments[0] in (module('csv_to_bag'), module('record_rig')) and state != 'none':
        arguments.append('--overwrite')  # without this the program keeps an earlier bag
    ended = subprocess.run([*INTERPRETER, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if ended.returncode or scenario.state(folder) != 'new':
        outcome.faults.append(f'{event}, then repeated: {ended.stderr.strip()[-200:]}')
    temporary = sorted(path.name for path in folder.rglob('.*~*'))
    if temporary:
        outcome.faults.append(f'{event}, then repeated: temporary files remain: {", ".join(temporary)}')


def document(outcomes: Sequence[Outcome]) -> str:
    """Return the table of outcomes in Markdown."""
    rows = [
        (
            outcome.scenario,
            outcome.kills,
            outcome.full,
            ', '.join(f'{state} {count}' for state, count in sorted(outcome.states.items())),
            len(outcome.faults),
        )
        for outcome in outcomes
    ]
    return table(('program', 'kills', 'full disks', 'states of the results', 'faults'), rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try all scenarios; return 1 if there are faults."""
    parser = argparse.ArgumentParser(prog='crashes', description=__doc__.split('\n\n')[0])
    parser.add_argument('--sizes', type=int, default=20, help='number of file sizes at which the disk is full')
    parser.add_argument('--only', metavar='TEXT', default='', help='only scenarios with this text in their names')
    options = parser.parse_args(arguments)
    if shutil.which('strace') is None:
        print('crashes: strace is not installed. Install strace, which lists the system calls.')
        return 2
    os.environ['OMP_NUM_THREADS'] = '1'
    sizes = [int(2 ** (6 + 0.9 * rank)) for rank in range(options.sizes)]
    outcomes = []
    for scenario in SCENARIOS:
        if options.only in scenario.name:
            outcomes.append(try_scenario(scenario, sizes=sizes))
            print('\n'.join([f'{scenario.name}: {outcomes[-1].states}', *outcomes[-1].faults]), flush=True)
    print(document(outcomes))
    return 1 if any(outcome.faults for outcome in outcomes) else 0


if __name__ == '__main__':
    sys.exit(main())
