# SPDX-License-Identifier: Apache-2.0
"""Document the results of each measured run of a cylinder in docs/measurements/measured_runs.md: make measured-runs."""

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

DOCUMENT = ROOT / 'docs' / 'measurements' / 'measured_runs.md'


@dataclass(frozen=True)
class RunResults:
    """Results of a run: a line for each channel, and the notices."""

    run: str
    lines: tuple[tuple[str, ...], ...]
    notices: tuple[Notice, ...]


def results_of(path: Path) -> RunResults:
    """Identify a run, close the loop, and return the results."""
    identification = identify([recording_of_run(path)], Options(close_loop=True))
    lines = tuple(_line(path.stem, channel) for channel in identification.closed)
    return RunResults(path.stem, lines, identification.notices)


def _line(run: str, result: ChannelResult) -> tuple[str, ...]:
    findings = result.findings
    share = [100.0 * errors[result.judged_on].rmse / result.span for errors in (result.before, result.after)]
    alternatives = sorted({effect for effects in findings.alternatives.values() for effect in effects})
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
    """Return the results of `leak_test` for a pressure decay, a line for each leak model."""
    recording = read_recording(path, mapping=read_mapping(ROOT / 'config' / 'pressure_decay.yaml'))
    decay = decay_of(recording.cylinders['cylinder_a'].pressure, AMBIENT_PRESSURE)
    return [
        (
            path.stem,
            leak.characteristic,
            ' to '.join(f'{1e6 * limit:.3g}' for limit in leak.interval),
            f'{1e-3 * leak.settling:.3g} in {leak.time_constant:.3g} s' if leak.settling else '',
            f'{leak.error / decay.noise:.2f}',
            'excluded' if leak.excluded else 'possible',
            f'{1e-3 * decay.distinguishable_below[0]:.0f}' if decay.distinguishable_below else '',
        )
        for leak in decay.leaks
    ]


def document(results: Sequence[RunResults], leaks: Sequence[tuple[str, ...]], predictions_text: str, notes: str) -> str:
    """Return the document: results of runs, warnings, predictions by common models, pressure decays."""
    header = (
        'run',
        'channel',
        'verdict',
        'status',
        'effects',
        'alternatives',
        'before [%]',
        'after [%]',
        'after / noise',
    )
    noticed = [(result.run, notice) for result in results for notice in result.notices]
    counts = Counter((notice.code, notice.level) for _, notice in noticed)
    return '\n'.join(
        [
            '# Measured runs',
            '',
            'What does `identify_bag --close-loop` find in each measured run of a regulated cylinder (a public data '
            'set, CC0)? Written by `make measured-runs`; the section "Notes" at the end is kept.',
            '',
            '- *Before* and *after*: test error without and with effects / measured span.',
            '- *Noise*: standard deviation of the differences between samples / square root of 2. '
            f'{_noise_ratio_medians(results)}',
            f'- Notices: {", ".join(f"`{code}` ({level}) on {n}" for (code, level), n in sorted(counts.items()))} of '
            f'{len(results)} runs.',
            f'- Machine: {machine()}',
            '',
            table(header, [line for result in results for line in result.lines]),
            '',
            '## Warnings',
            '',
            table(
                ('run', 'code', 'message', 'what to do'),
                [
                    (run, f'`{notice.code}`', notice.message, notice.fix)
                    for run, notice in noticed
                    if notice.level == WARNING
                ],
            ),
            '',
            predictions_text,
            '',
            '## Pressure decays',
            '',
            'Results of `leak_test --mapping config/pressure_decay.yaml` for chambers behind a shut valve. Each leak '
            'model is fitted to the first half; the error is that of the second half. The leak models are '
            'distinguishable below the gauge pressure in the last column.',
            '',
            table(
                (
                    'chamber',
                    'leak model',
                    'conductance [1e-6/s], 95 %',
                    'settling [kPa]',
                    'error / noise',
                    'result',
                    'distinguishable below [kPa]',
                ),
                leaks,
            ),
            '',
            notes,
            '',
        ]
    )


def _noise_ratio_medians(results: Sequence[RunResults]) -> str:
    """Return the medians of error / noise of the pressures, of all runs and of seals without a leak."""
    ratios = {result.run: float(line[-1]) for result in results for line in result.lines if line[1] != 'force'}
    healthy = [value for run, value in ratios.items() if not run.startswith('Kidney')]
    at_7_bar = [value for run, value in ratios.items() if run.endswith('7bar')]
    return (
        f'Medians of the pressures: {np.median(healthy):.2f} of {len(healthy)} runs with the three healthy seals, '
        f'{np.median(at_7_bar):.2f} (at most {max(at_7_bar):.2f}) of the runs at 7 bar, '
        f'{np.median(list(ratios.values())):.2f} of all runs.'
    )


def main() -> int:
    """Identify each run and write the document."""
    runs = sorted([*(DATA / 'friction').glob('*.csv'), *(DATA / 'rerun').glob('*.csv')])
    if not runs:
        print(f'measured_runs: no measured runs in {DATA}. Set CFD_PNEUMATIC_DATA to the folder of the measured data.')
        return 2
    leaks = [line for path in sorted((DATA / 'chamber_decay').glob('*.csv')) for line in leaks_of(path)]
    results = list(side_by_side(results_of, runs, 'measured runs'))
    write_text(DOCUMENT, document(results, leaks, predictions.document(DATA), notes_in(DOCUMENT)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
