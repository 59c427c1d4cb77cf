# SPDX-License-Identifier: Apache-2.0
"""
Measure whether `identify_bag` answers in a bounded time on devices with equations that the project does not have.

    python -m studies.foreign.benchmark_foreign --kinds pi_spool hose_kink --seeds 5000:5003 --output foreign.md

Each recording is a table with a mapping file, which `identify_bag --close-loop` reads in a separate process. A stopped
run continues from its file of rows. Rows of other versions of the program are measured again. A unit is the time of
`import numba, scipy.optimize, matplotlib.pyplot`; the command measures the time before each recording.
"""

from __future__ import annotations

import argparse
import collections
import hashlib
import json
import os
import resource
import shlex
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cfd_pneumatic.files import write_text
from studies.documents.markdown import notes_in, table
from studies.foreign.devices import KINDS, record
from studies.foreign.tables import FORMATS, write_table
from studies.tools.json_rows import read_rows, seed_range
from studies.tools.provenance import ROOT, code_version, commit, machine

UNIT = (sys.executable, '-c', 'import numba, scipy.optimize, matplotlib.pyplot')
MOST_UNITS = {False: 10.0, True: 20.0}
"""Goal of the time of an identification [units]; True: two cylinders and a force."""


@dataclass(frozen=True)
class Row:
    """
    Answer of `identify_bag` on a recording.

    Attributes
    ----------
    kind, seed, format
        The recording, and the format of its table.
    truth, contrast
        The device as text; effect of its fault on the pressure divided by the sensor noise [-].
    exit_code, message
        Exit code, None if the time limit ended the program; last line of its errors.
    channels
        Answer by channel: `verdict`, `status`, `named`, `over_noise`, `before`, `after`, `unit`.
    warnings
        Codes of the warnings.
    wall, processor
        Time of the program and its children [s].
    unit_wall, unit_processor
        Time of a unit before the program [s].
    code, commit
        Version of the program.

    """

    kind: str
    seed: int
    format: str
    truth: str
    contrast: float
    exit_code: int | None
    message: str
    channels: Mapping[str, Mapping[str, Any]]
    warnings: Sequence[str]
    wall: float
    processor: float
    unit_wall: float
    unit_processor: float
    code: str
    commit: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the recordings that have no row yet, and write the document; return the exit code."""
    options = _parsed(arguments)
    version = _version()
    jobs = [(kind, seed) for kind in options.kinds for seed in options.seeds]
    rows = {(row.kind, row.seed): row for row in read_rows(options.rows, Row, version)}
    pending = [job for job in jobs if job not in rows]
    print(f'{len(jobs)} recordings, {len(pending)} of them are not measured yet. Rows: {options.rows}')
    if pending:
        _run([sys.executable, '-m', 'cfd_pneumatic.commands.compile_kernels'], ROOT, 600.0)
        options.rows.parent.mkdir(parents=True, exist_ok=True)
    for kind, seed in pending:
        row = measure(kind, seed, options.keep, options.limit, version)
        with options.rows.open('a', encoding='utf-8') as stream:
            stream.write(json.dumps(asdict(row)) + '\n')
        rows[kind, seed] = row
        print(f'{kind} {seed}: {_answer(row)}; {row.wall:.1f} s')
    command = (
        f'python -m studies.foreign.benchmark_foreign {shlex.join(sys.argv[1:] if arguments is None else arguments)}'
    )
    write_text(options.output, document([rows[job] for job in jobs], command, notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


def measure(kind: str, seed: int, keep: Path | None, limit: float, version: str) -> Row:
    """Write a table, identify the table as a user would, and return the answer."""
    recorded = record(kind, seed)
    layout = list(FORMATS)[(seed + list(KINDS).index(kind)) % len(FORMATS)]
    with nullcontext(str(keep / f'{kind}_{seed}')) if keep else tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        path, mapping = write_table(recorded, layout, folder)
        *_, unit_wall, unit_processor = _run(UNIT, folder, limit)
        start = 'import sys; from cfd_pneumatic.runtime.start import identify_bag; sys.exit(identify_bag())'
        command = [sys.executable, '-c', start, path.name, '--mapping', mapping.name, '--close-loop']
        command += ['--output', 'identified', '--progress', 'none', '--overwrite']
        exit_code, message, wall, processor = _run(command, folder, limit)
        report = folder / 'identified' / 'report.json'
        data = json.loads(report.read_text(encoding='utf-8')) if exit_code == 0 else {'cylinders': {}, 'warnings': []}
    return Row(
        kind=kind,
        seed=seed,
        format=layout,
        truth=recorded.truth,
        contrast=recorded.contrast / recorded.noise,
        exit_code=exit_code,
        message='' if exit_code == 0 else message,
        channels=dict(_channels(data)),
        warnings=[notice['code'] for notice in data['warnings'] if notice['level'] == 'warning'],
        wall=wall,
        processor=processor,
        unit_wall=unit_wall,
        unit_processor=unit_processor,
        code=version,
        commit=commit(),
    )


def _run(command: Sequence[str], folder: Path, limit: float) -> tuple[int | None, str, float, float]:
    """Return exit code, last line of the errors, wall time and processor time [s]; end the program at the limit [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    with tempfile.TemporaryFile('w+', encoding='utf-8') as errors:
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        exit_code: int | None = None
        try:
            exit_code = process.wait(limit)
        except subprocess.TimeoutExpired:
            pass
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        wall = time.perf_counter() - began
        errors.seek(0)
        lines = errors.read().strip().splitlines()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return exit_code, lines[-1] if lines else '', wall, processor


def _channels(data: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the answer on each channel of a report."""
    found = {**data['cylinders'], **({'force': data['force']} if 'force' in data else {})}
    for name, channel in found.items():
        if 'verdict' not in channel:
            continue
        before, after = (_test_error(channel[key]) for key in ('before', 'after'))
        curve = channel['unknown']
        named = [*channel['effects'], *([f'curve: {curve["enters"]} against {curve["against"]}'] if curve else [])]
        yield (
            name,
            {
                'verdict': channel['verdict'],
                'status': channel['status'],
                'named': named,
                'over_noise': channel['left']['over_noise'],
                'before': before,
                'after': after,
                'unit': 'N' if name == 'force' else 'Pa',
            },
        )


def _test_error(errors: Mapping[str, Mapping[str, float]]) -> float | None:
    """Return the RMSE on the test part; None without a test part."""
    part = errors.get('test', {})
    return next((value for key, value in part.items() if key.startswith('rmse_')), None)


def _version() -> str:
    """Return a fingerprint of the package and of the devices."""
    texts = [path.read_bytes() for path in sorted(Path(__file__).parent.glob('*.py')) if path != Path(__file__)]
    return hashlib.sha256(b''.join([code_version().encode(), *texts])).hexdigest()[:12]


def document(rows: Sequence[Row], command: str, notes: str) -> str:
    """Return the answers and a summary in Markdown."""
    unit_wall = statistics.median(row.unit_wall for row in rows)
    unit_processor = statistics.median(row.unit_processor for row in rows)
    units = {id(row): (row.wall / unit_wall, row.processor / unit_processor) for row in rows}
    header = ['kind', 'seed', 'format', 'truth', 'fault / noise', 'exit', 'answer', 'error / noise']
    header += ['error before → after (test)', 'warnings', 'wall [units]', 'processor [units]']
    cells = [
        (
            row.kind, row.seed, row.format, row.truth, f'{row.contrast:.1f}' if row.contrast else '',
            'stopped' if row.exit_code is None else row.exit_code, _answer(row),
            '; '.join(f'{channel["over_noise"]:.2f}' for channel in row.channels.values()),
            '; '.join(_errors(channel) for channel in row.channels.values()),
            ', '.join(row.warnings), *(f'{value:.1f}' for value in units[id(row)]),
        )
        for row in rows
    ]  # fmt: skip
    limits = []
    for two, most in MOST_UNITS.items():
        for column, title in enumerate(('wall', 'processor')):
            chosen = {f'{row.kind} {row.seed}': units[id(row)][column] for row in rows if _has_force(row) == two}
            if chosen:
                largest = max(chosen, key=lambda name: chosen[name])
                below = sum(value < most for value in chosen.values())
                what = 'two cylinders and force' if two else 'one cylinder'
                limits.append((what, title, most, f'{below} of {len(chosen)}', f'{chosen[largest]:.1f} ({largest})'))
    verdicts = [
        (kind, ', '.join(f'{text}: {count}' for text, count in _verdicts(rows, kind).most_common()))
        for kind in dict.fromkeys(row.kind for row in rows)
    ]
    sections = [
        '# Foreign devices',
        f'Does `identify_bag --close-loop` answer in a bounded time, and rightly, on devices with equations that the '
        f'project does not have? Written by `{command}`.',
        f'Machine: {machine()}. Commit: {", ".join(sorted({row.commit for row in rows}))}. A unit is the median time '
        f'of `import numba, scipy.optimize, matplotlib.pyplot`: {unit_wall:.2f} s wall, '
        f'{unit_processor:.2f} s processor.',
        '*Fault / noise* is the RMS change of the pressure by the fault, divided by the sensor noise.',
        table(header, [[str(cell).replace('|', r'\|') for cell in line] for line in cells]),
        '## Summary',
        table(['device', 'time', 'limit [units]', 'below the limit', 'largest [units]'], limits),
        table(['kind', 'verdicts'], verdicts),
        notes,
    ]
    return '\n\n'.join(section for section in sections if section).rstrip() + '\n'


def _has_force(row: Row) -> bool:
    return KINDS[row.kind].plan.cylinders > 1


def _verdicts(rows: Sequence[Row], kind: str) -> collections.Counter[str]:
    answers = [row for row in rows if row.kind == kind]
    refused = ['stopped' if row.exit_code is None else 'refused' for row in answers if row.exit_code != 0]
    return collections.Counter(
        [*refused, *(channel['verdict'] for row in answers for channel in row.channels.values())]
    )


def _answer(row: Row) -> str:
    """Return the answer on all channels as text."""
    if row.exit_code != 0:
        return row.message or 'no message'
    texts = []
    for name, channel in row.channels.items():
        status = f' ({channel["status"]})' if channel['status'] else ''
        named = f': {", ".join(channel["named"])}' if channel['named'] else ''
        texts.append(f'{name} {channel["verdict"]}{status}{named}')
    return '; '.join(texts)


def _errors(channel: Mapping[str, Any]) -> str:
    if channel['before'] is None or channel['after'] is None:
        return 'no test part'
    return f'{channel["before"]:.3g} → {channel["after"]:.3g} {channel["unit"]}'


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark_foreign', description=(__doc__ or '').strip().split('\n\n')[0])
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=list(KINDS), metavar='KIND', help=', '.join(KINDS))
    parser.add_argument('--seeds', type=seed_range, default=range(5000, 5003), metavar='A:B', help='default: 5000:5003')
    parser.add_argument('--output', type=Path, required=True, help='document to write')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'foreign.jsonl', help='file of rows')
    parser.add_argument('--keep', type=Path, help='folder that keeps tables and reports')
    parser.add_argument('--limit', type=float, default=900.0, metavar='S', help='time limit [s] (default: 900)')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
