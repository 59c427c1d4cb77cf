# SPDX-License-Identifier: Apache-2.0
"""Test common models of many measured runs: fits of all runs, unseen pressures, repeated runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import ChannelResult, Experiment, Identification, Options, identify
from cfd_pneumatic.recording import Recording, read_mapping, read_recording
from studies.documents.markdown import table
from studies.tools.provenance import ROOT

CYLINDER = 'cylinder_a'
SEALS = ('KDN', 'NAP310', 'O-ring257')
PRESSURES = (1, 3, 5, 7)  # [bar]
UNSEEN = 3  # [bar]
LEARNT = 0.2  # share of a run at the unseen pressure to which the set-point is fitted
SMOOTHED = 5  # samples, to find the turns of the piston
BEFORE = 0.3  # from the begin of a stroke to the turn of the piston [s]
PHASES = np.arange(0.0, 10.0, 0.01)  # since a stroke began [s]


def recording_of_run(path: Path) -> Recording:
    """Return the recording of a measured run."""
    return read_recording(path, mapping=read_mapping(ROOT / 'config' / 'pneumatic_actuator.yaml'))


def noise(measured: Array) -> float:
    """Return the noise: the standard deviation of the differences between samples, over the root of 2."""
    return float(np.std(np.diff(measured))) / math.sqrt(2.0)


def rms(values: Array) -> float:
    """Return the root mean square of the finite values."""
    return math.sqrt(float(np.nanmean(values**2)))


def identify_together(*runs: Path) -> Identification:
    """Identify the pressures of several runs with a common model."""
    recordings = [replace(recording_of_run(path), force=None) for path in runs]
    return identify(recordings, Options(close_loop=True))


def drift_of(result: ChannelResult) -> float:
    """Return the median drift rate of the estimated set-points [Pa/s]."""
    return float(np.median(result.found.model.recording_values[:, 2]))


def prediction_error(source: ChannelResult, run: ChannelResult, learnt: float = 1.0) -> float:
    """
    Return the error of other runs' model in a run, divided by the noise; only the set-point is fitted.

    Parameters
    ----------
    source, run
        Result with the model, and result of the predicted run.
    learnt
        Share of the run to which the set-point is fitted; the drift is that of the source. The error is that of the
        remaining samples, or of the whole run if the share is 1.

    """
    (experiment,) = run.experiments
    count = round(learnt * experiment.measured.size)
    scale, drift = noise(experiment.measured), drift_of(source)
    offset, start, _ = run.fit.model.recording_values[0].tolist()

    def residual(shift: Array) -> Array:
        setpoint = np.array([[offset + scale * shift[0], start, drift]])
        model = replace(source.found.model, recording_values=setpoint)
        return (run.channel.simulated([experiment], model)[0] - experiment.measured) / scale

    optimum = least_squares(lambda shift: residual(shift)[:count], [1.0], diff_step=1e-2)
    return rms(residual(optimum.x)[count if learnt < 1.0 else 0 :])


def mean_stroke_error(source: ChannelResult, run: ChannelResult) -> float:
    """Return the error of the source's mean stroke and drift in a run, over the noise; a constant is fitted."""
    (source_experiment,), (experiment,), drift = source.experiments, run.experiments, drift_of(source)
    levelled = source_experiment.measured - drift * source_experiment.sample_times
    curves = {}
    for way in (False, True):
        strokes = [
            np.interp(PHASES, phases, levelled[samples], right=np.nan)
            for inwards, samples, phases in _strokes(source_experiment)
            if inwards == way
        ]
        curves[way] = np.ma.masked_invalid(strokes).mean(axis=0).filled(np.nan)
    measured = experiment.measured - drift * experiment.sample_times
    residuals = [
        measured[samples] - np.interp(phases, PHASES, curves[way]) for way, samples, phases in _strokes(experiment)
    ]
    residual = np.concatenate(residuals)
    return rms(residual - np.nanmean(residual)) / noise(experiment.measured)


def swing(experiment: Experiment) -> tuple[float, float, float]:
    """Return the mean speeds midway of strokes out and in [m/s], and the pressure difference [Pa]."""
    position = experiment.at_samples('displacement')
    midway_values: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for inwards, samples, _ in _strokes(experiment):
        quarter = (samples.stop - samples.start) // 4
        midway = slice(samples.start + quarter, samples.stop - quarter)
        speed = np.polyfit(experiment.sample_times[midway], position[midway], 1)[0]
        midway_values[inwards].append((float(speed), float(np.mean(experiment.measured[midway]))))
    (out, lower), (back, higher) = (np.mean(midway_values[way], axis=0).tolist() for way in (False, True))
    return out, back, higher - lower


def document(data: Path) -> str:
    """Identify measured runs; return the section on how well common models predict them, in Markdown."""
    friction, rerun = data / 'friction', data / 'rerun'
    runs = sorted([*friction.glob('*.csv'), *rerun.glob('*.csv')])
    alone = {
        path.stem: identify_together(path).channels[CYLINDER] for path in runs if not path.stem.startswith('Kidney')
    }
    all_runs = identify_together(*(path for path in runs if path.stem in alone))
    outliers = [notice.message for notice in all_runs.notices if notice.code == 'recording_differs']
    regular = {name: result for name, result in alone.items() if not any(name in message for message in outliers)}
    together = identify_together(*(path for path in runs if path.stem in regular))
    return '\n'.join(
        [
            '## Many runs, one model',
            '',
            'Errors of the pressure divided by the noise between samples. The force is not used.',
            '',
            f'All {len(alone)} runs of the three healthy seals, identified together. Notices: {"; ".join(outliers)}. '
            f'The common model of the {len(regular)} regular runs: {_estimates(together.channels[CYLINDER])}.',
            '',
            table(('run', 'alone, test part', 'together, test part'), _together(regular, together.channels[CYLINDER])),
            '',
            f'Runs at {UNSEEN} bar, predicted by the common model of the seal’s runs at different pressures. Only the '
            f'set-point is fitted, to the first {LEARNT:.0%}; the error is that of the remaining samples.',
            '',
            table(('seal', f'at {UNSEEN} bar', 'effects in addition to the core'), _unseen(friction, alone)),
            '',
            'Pressure difference between strokes out and back, midway, at constant speed. Divided by the difference of '
            'speeds it is a property of the device that needs no model.',
            '',
            table(
                ('run', 'out [mm/s]', 'back [mm/s]', 'difference [kPa]', 'difference / speed difference [kPa s/m]'),
                _swings(alone),
            ),
            '',
            'Repeated runs, predicted by the model or by the mean stroke of a source run. A constant is fitted.',
            '',
            table(('run', 'source', 'error of the model', 'error of the mean stroke'), _reruns(rerun, alone)),
        ]
    )


def _estimates(together: ChannelResult) -> str:
    """Return the identifiable parameters of core and effects as text."""
    return ', '.join(
        f'`{part}.{name}` {estimate.value:.4g} {estimate.unit.strip("-")} '
        f'({estimate.interval[0]:.4g} to {estimate.interval[1]:.4g})'
        for part in together.added
        for name, estimate in together.parameters(part).items()
        if estimate.value is not None and estimate.interval is not None and estimate.interval[0] < estimate.interval[1]
    )


def _together(alone: Mapping[str, ChannelResult], together: ChannelResult) -> Iterator[tuple[str, ...]]:
    for (name, result), comparison in zip(alone.items(), together.comparisons):
        scale = noise(comparison.experiment.measured)
        errors = result.rmse(1), rms(comparison.residual(1)[together.judged(comparison)])
        yield name, *(f'{error / scale:.2f}' for error in errors)


def _unseen(friction: Path, alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for seal in SEALS:
        paths = [friction / f'{seal}_{pressure}bar.csv' for pressure in PRESSURES if pressure != UNSEEN]
        model = identify_together(*paths).channels[CYLINDER]
        error = prediction_error(model, alone[f'{seal}_{UNSEEN}bar'], LEARNT)
        yield seal, f'{error:.2f}', ', '.join(model.findings.effects)


def _swings(alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for name, result in alone.items():
        out, back, pressure = swing(result.experiments[0])
        cells = (
            f'{1e3 * out:.1f}',
            f'{1e3 * back:.1f}',
            f'{1e-3 * pressure:.2f}',
            f'{1e-3 * pressure / (out - back):.1f}',
        )
        yield name, *cells


def _reruns(rerun: Path, alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for pressure in (3, 7):
        names = sorted(path.stem for path in rerun.glob(f'*_{pressure}bar.csv'))
        for source, run in permutations(names, 2):
            stroke = mean_stroke_error(alone[source], alone[run])
            yield run, source, f'{prediction_error(alone[source], alone[run]):.2f}', f'{stroke:.2f}'


def _strokes(experiment: Experiment) -> list[tuple[bool, slice, Array]]:
    """Return direction (True: inwards), samples, and times since the begin [s] of each stroke."""
    times, position = experiment.sample_times, gaussian_filter1d(experiment.at_samples('displacement'), SMOOTHED)
    stroke = float(np.ptp(position))
    turns = sorted(
        (float(times[index]), inwards)
        for inwards in (False, True)
        for index in find_peaks(position if inwards else -position, prominence=0.3 * stroke)[0]
    )
    strokes = []
    for (first, inwards), (last, _) in pairwise(turns):
        samples = slice(*np.searchsorted(times, [first - BEFORE, last - BEFORE]).tolist())
        strokes.append((inwards, samples, times[samples] - first + BEFORE))
    return strokes
