# SPDX-License-Identifier: Apache-2.0
"""
Measure how well the force along a path is predicted and held: `make benchmark-hold`.

    python -m studies.hold.benchmark_hold --seeds 2000:2002 --output build/hold.md

Each device is identified from a recording of one minute. The rig plays its surfaces with several set-points. A stopped
run continues from its file of rows; devices with rows of another version of the program are measured again.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from cfd_pneumatic.files import write_text
from studies.documents.markdown import notes_in
from studies.hold.devices import RECORDING
from studies.hold.document import document
from studies.hold.rows import Job, Row, measure, version
from studies.hold.surfaces import DURATION
from studies.tools.json_rows import read_rows, seed_range
from studies.tools.processes import side_by_side
from studies.tools.provenance import ROOT

DOCUMENT = ROOT / 'docs' / 'hold.md'
SURFACES = 5
"""Number of surfaces of each device."""

FEED_EVERY, SCENARIOS_EVERY = 3, 11
"""Devices per device with the fastest feed, and with scenarios; odd numbers, so that both kinds of makes are used."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the devices that have no rows yet, and write the document; return the exit code."""
    options = _parsed(arguments)
    code = version()
    jobs = [
        Job(
            seed,
            options.surfaces,
            options.duration,
            options.recording,
            seed % FEED_EVERY == 0,
            seed % SCENARIOS_EVERY == 0,
            code,
        )
        for seed in options.seeds
    ]
    rows = {(row.seed, row.surface): row for row in read_rows(options.rows, Row, code)}
    pending = [job for job in jobs if any((job.seed, number) not in rows for number in range(job.surfaces))]
    print(f'{len(jobs)} devices, {len(pending)} of them are not measured yet. Rows: {options.rows}')
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    for found in side_by_side(measure, pending, 'Measuring devices', options.processes):
        with options.rows.open('a', encoding='utf-8') as stream:
            stream.writelines(json.dumps(asdict(row)) + '\n' for row in found)
        rows |= {(row.seed, row.surface): row for row in found}
    given = sys.argv[1:] if arguments is None else arguments
    command = shlex.join(['python', '-m', 'studies.hold.benchmark_hold', *given])
    chosen = [rows[job.seed, number] for job in jobs for number in range(job.surfaces)]
    write_text(options.output, document(chosen, command, notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark_hold', description=(__doc__ or '').strip().split('\n\n')[0])
    parser.add_argument('--seeds', type=seed_range, default=range(5000, 5040), metavar='A:B', help='default: 5000:5040')
    parser.add_argument('--surfaces', type=int, default=SURFACES, metavar='N', help='surfaces of each device')
    parser.add_argument('--duration', type=float, default=DURATION, metavar='S', help='duration of a surface [s]')
    parser.add_argument('--recording', type=float, default=RECORDING, metavar='S', help='identifies a device [s]')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'hold.jsonl', help='file of rows')
    parser.add_argument('--output', type=Path, default=DOCUMENT, help='document to write')
    parser.add_argument('--processes', type=int, default=2, metavar='N', help='0: in this process (default: 2)')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
