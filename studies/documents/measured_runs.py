# SPDX-License-Identifier: Apache-2.0
"""What is said of each measured run of a real cylinder: make measured-runs writes docs/measured_runs.md."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import ChannelResult, Options, decay_of, identify
from cfd_pneumatic.notices import WARNING, Notice
from cfd_pneumatic.recording import read_mapping, read_recording
from studies.documents import predictions
from studies.documents.markdown import notes_in, table
from studies.documents.predictions import noise, recording_of_run
from studies.tools.processes import side_by_side
from studies.tools.provenance import DATA, ROOT, machine

DOCUMENT = ROOT / 'docs' / 'measured_runs.md'


@dataclass(frozen=True)
class Said:
    """What is said of a run: a line for each channel, and the notices."""

    run: str
    lines: tuple[tuple[str, ...], ...]
    notices: tuple[Notice, ...]


def said_of(path: Path) -> Said:
    """Identify a run and close the loop."""
    found = identify([recording_of_run(path)], Options(close_loop=True))
    return Said(path.stem, tuple(_line(path.stem, one) for one in found.closed), found.notices)


def _line(run: str, result: ChannelResult) -> tuple[str, ...]:
    findings = result.findings
    share = [100.0 * errors[result.judged_on].rmse / result.span for errors in (result.before, result.after)]
    alternatives = sorted({one for some in findings.alternatives.values() for one in some})
    return (
        run,
        result.name,
        f'`{findings.verdict}`',
        findings.status or '',
        ', '.join(findings.effects),
        ', '.join(alternatives),
        f'{share[0]:.2f}',
        f'{share[1]:.2f}',
        f'{result.rmse(1) / noise(result.experiments[0].measured):.2f}',
    )


def leaks_of(path: Path) -> list[tuple[str, ...]]:
    """Return what `leak_test` says of a pressure decay, a line for each law."""
    recording = read_recording(path, mapping=read_mapping(ROOT / 'config' / 'pressure_decay.yaml'))
    decay = decay_of(recording.cylinders['cylinder_a'].pressure, AMBIENT_PRESSURE)
    return [
        (
            path.stem,
            leak.characteristic,
            ' to '.join(f'{1e6 * one:.3g}' for one in leak.interval),
            f'{1e-3 * leak.settling:.3g} in {leak.time_constant:.3g} s' if leak.settling else '',
            f'{leak.error / decay.noise:.2f}',
            'excluded' if leak.excluded else 'possible',
            f'{1e-3 * decay.distinguishable_below[0]:.0f}' if decay.distinguishable_below else '',
        )
        for leak in decay.leaks
    ]


def document(said: Sequence[Said], leaks: Sequence[tuple[str, ...]], together: str, notes: str) -> str:
    """Return the table of runs, what was noticed on them, what one model makes of many, and the pressure decays."""
    header = (
        'run',
        'channel',
        'verdict',
        'status',
        'effects',
        'or instead',
        'before [%]',
        'after [%]',
        'after, over the noise',
    )
    noticed = [(one.run, it) for one in said for it in one.notices]
    runs = Counter((it.code, it.level) for _, it in noticed)
    return '\n'.join(
        [
            '# Measured runs',
            '',
            'What `identify_bag --close-loop` says of each measured run of a regulated cylinder (a public data set, '
            'CC0), one by one. Written by `make measured-runs`; what stands under "Notes" at the end is kept.',
            '',
            '- Errors are those of the test part, over the span of what was measured, without and with the effects.',
            '- The last column has them over the noise from sample to sample, the standard deviation of the '
            f'differences over the square root of 2. {_over_noise(said)}',
            f'- Noticed: {", ".join(f"`{code}` ({level}) on {n}" for (code, level), n in sorted(runs.items()))} of '
            f'{len(said)} runs.',
            f'- Machine: {machine()}',
            '',
            table(header, [line for one in said for line in one.lines]),
            '',
            '## Warnings',
            '',
            table(
                ('run', 'code', 'what is said', 'what to do'),
                [(run, f'`{it.code}`', it.message, it.fix) for run, it in noticed if it.level == WARNING],
            ),
            '',
            together,
            '',
            '## Pressure decays',
            '',
            'What `leak_test --mapping config/pressure_decay.yaml` says of chambers behind a shut valve. Each law is '
            'fitted to the first half, and errs on the second as the table says. The last column: to which gauge '
            'pressure a chamber would have to empty for the laws to be told apart.',
            '',
            table(
                (
                    'chamber',
                    'law',
                    'conductance [1e-6/s], 95 %',
                    'settles by [kPa]',
                    'error, over the noise',
                    'is it',
                    'told below [kPa]',
                ),
                leaks,
            ),
            '',
            notes,
            '',
        ]
    )


def _over_noise(said: Sequence[Said]) -> str:
    """Return the medians of the pressures' errors over the noise, of all runs and of the seals that don't leak."""
    found = {one.run: float(line[-1]) for one in said for line in one.lines if line[1] != 'force'}
    healthy = [value for run, value in found.items() if not run.startswith('Kidney')]
    at_7_bar = [value for run, value in found.items() if run.endswith('7bar')]
    return (
        f'Medians of the pressures: {np.median(healthy):.2f} of {len(healthy)} runs of the three healthy seals, '
        f'{np.median(at_7_bar):.2f} (at most {max(at_7_bar):.2f}) of those at 7 bar, '
        f'{np.median(list(found.values())):.2f} of all.'
    )


def main() -> int:
    """Identify each run, write the document."""
    runs = sorted([*(DATA / 'friction').glob('*.csv'), *(DATA / 'rerun').glob('*.csv')])
    if not runs:
        print(f'measured_runs: no runs in {DATA}: set CFD_PNEUMATIC_DATA to the folder that holds them')
        return 2
    leaks = [line for path in sorted((DATA / 'chamber_decay').glob('*.csv')) for line in leaks_of(path)]
    said = list(side_by_side(said_of, runs, 'measured runs'))
    write_text(DOCUMENT, document(said, leaks, predictions.document(DATA), notes_in(DOCUMENT)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
