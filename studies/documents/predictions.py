# SPDX-License-Identifier: Apache-2.0
"""One model for many measured runs: of all at once, of a pressure that it never saw, of the same again."""

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
LEARNT = 0.2  # of a run of the pressure that was not seen: what its set-point is fitted to
SMOOTHED = 5  # samples, where the piston turns
BEFORE = 0.3  # that a stroke is taken to begin before the piston has turned [s]
PHASES = np.arange(0.0, 10.0, 0.01)  # since a stroke began [s]


def recording_of_run(path: Path) -> Recording:
    """Return a measured run."""
    return read_recording(path, mapping=read_mapping(ROOT / 'config' / 'pneumatic_actuator.yaml'))


def noise(measured: Array) -> float:
    """Return the noise from sample to sample, the standard deviation of the differences over the root of 2."""
    return float(np.std(np.diff(measured))) / math.sqrt(2.0)


def rms(values: Array) -> float:
    """Return the root of the mean square of what is finite."""
    return math.sqrt(float(np.nanmean(values**2)))


def identified(*runs: Path) -> Identification:
    """Return what the pressures of some runs tell together."""
    recordings = [replace(recording_of_run(path), force=None) for path in runs]
    return identify(recordings, Options(close_loop=True))


def drift_of(of: ChannelResult) -> float:
    """Return the median rate by which the set-points drift that nobody recorded [Pa/s]."""
    return float(np.median(of.found.model.recording_values[:, 2]))


def predicted(of: ChannelResult, run: ChannelResult, learnt: float = 1.0) -> float:
    """
    Return the error of a model of other runs in a run, over its noise, where only the set-point is fitted.

    Parameters
    ----------
    of, run
        Whose model, and which run.
    learnt
        Share of the run that its set-point is fitted to, which then drifts as in the other runs; the rest is scored, or
        all of it where that is 1.

    """
    (experiment,) = run.experiments
    count = round(learnt * experiment.measured.size)
    scale, drift = noise(experiment.measured), drift_of(of)
    offset, start, _ = run.fit.model.recording_values[0].tolist()

    def left(more: Array) -> Array:
        own = np.array([[offset + scale * more[0], start, drift]])
        return (
            run.channel.simulated([experiment], replace(of.found.model, recording_values=own))[0] - experiment.measured
        ) / scale

    found = least_squares(lambda more: left(more)[:count], [1.0], diff_step=1e-2)
    return rms(left(found.x)[count if learnt < 1.0 else 0 :])


def mean_stroke(of: ChannelResult, run: ChannelResult) -> float:
    """Return the error of one run's mean stroke and drift in another run, over its noise; a constant is fitted."""
    (of_one,), (one,), drift = of.experiments, run.experiments, drift_of(of)
    even = of_one.measured - drift * of_one.sample_times
    curves = {}
    for way in (False, True):
        strokes = [
            np.interp(PHASES, phases, even[samples], right=np.nan)
            for inwards, samples, phases in _strokes(of_one)
            if inwards == way
        ]
        curves[way] = np.ma.masked_invalid(strokes).mean(axis=0).filled(np.nan)
    measured = one.measured - drift * one.sample_times
    left = [measured[samples] - np.interp(phases, PHASES, curves[way]) for way, samples, phases in _strokes(one)]
    together = np.concatenate(left)
    return rms(together - np.nanmean(together)) / noise(one.measured)


def swing(one: Experiment) -> tuple[float, float, float]:
    """Return the mean speed of the strokes out and in, midway [m/s], and the difference of the pressures there [Pa]."""
    position = one.at_samples('displacement')
    found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for inwards, samples, _ in _strokes(one):
        quarter = (samples.stop - samples.start) // 4
        midway = slice(samples.start + quarter, samples.stop - quarter)
        speed = np.polyfit(one.sample_times[midway], position[midway], 1)[0]
        found[inwards].append((float(speed), float(np.mean(one.measured[midway]))))
    (out, lower), (back, higher) = (np.mean(found[way], axis=0).tolist() for way in (False, True))
    return out, back, higher - lower


def document(data: Path) -> str:
    """Return the tables, of the runs in a folder."""
    friction, rerun = data / 'friction', data / 'rerun'
    runs = sorted([*friction.glob('*.csv'), *rerun.glob('*.csv')])
    alone = {path.stem: identified(path).channels[CYLINDER] for path in runs if not path.stem.startswith('Kidney')}
    all_runs = identified(*(path for path in runs if path.stem in alone))
    odd = [one.message for one in all_runs.notices if one.code == 'recording_differs']
    others = {name: one for name, one in alone.items() if not any(name in message for message in odd)}
    together = identified(*(path for path in runs if path.stem in others))
    return '\n'.join(
        [
            '## Many runs, one model',
            '',
            'Errors over the noise from sample to sample, of the pressure; the force is left out.',
            '',
            f'All {len(alone)} runs of the three healthy seals, identified together. Said: {"; ".join(odd)}. The other '
            f'{len(others)} together tell {_told(together.channels[CYLINDER])}.',
            '',
            table(('run', 'alone, test part', 'together, test part'), _together(others, together.channels[CYLINDER])),
            '',
            f'Runs at {UNSEEN} bar, predicted by the model of the others of that seal, identified together. Their '
            f'set-point alone is fitted, to the first {LEARNT:.0%}, which is not scored.',
            '',
            table(('seal', f'at {UNSEEN} bar', 'effects beside the core'), _unseen(friction, alone)),
            '',
            'How far the pressure swings between strokes out and back, midway, where the piston is even. Over the '
            'difference of the speeds that is a number of the device, without a model.',
            '',
            table(('run', 'out [mm/s]', 'back [mm/s]', 'swing [kPa]', 'over the speeds [kPa s/m]'), _swings(alone)),
            '',
            'Reruns, predicted by the model of another, or by its mean stroke; one constant is fitted.',
            '',
            table(('run', 'by that of', 'model', 'mean stroke'), _reruns(rerun, alone)),
        ]
    )


def _told(together: ChannelResult) -> str:
    """Return the numbers beside the gains that are told, in words."""
    return ', '.join(
        f'`{part}.{name}` {one.value:.4g} {one.unit.strip("-")} ({one.interval[0]:.4g} to {one.interval[1]:.4g})'
        for part in together.added
        for name, one in together.parameters(part).items()
        if one.value is not None and one.interval is not None and one.interval[0] < one.interval[1]
    )


def _together(alone: Mapping[str, ChannelResult], together: ChannelResult) -> Iterator[tuple[str, ...]]:
    for (name, one), comparison in zip(alone.items(), together.comparisons):
        scale = noise(comparison.experiment.measured)
        errors = one.rmse(1), rms(comparison.residual(1)[together.judged(comparison)])
        yield name, *(f'{error / scale:.2f}' for error in errors)


def _unseen(friction: Path, alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for seal in SEALS:
        others = [friction / f'{seal}_{pressure}bar.csv' for pressure in PRESSURES if pressure != UNSEEN]
        model = identified(*others).channels[CYLINDER]
        error = predicted(model, alone[f'{seal}_{UNSEEN}bar'], LEARNT)
        yield seal, f'{error:.2f}', ', '.join(model.findings.effects)


def _swings(alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for name, one in alone.items():
        out, back, pressure = swing(one.experiments[0])
        told = (
            f'{1e3 * out:.1f}',
            f'{1e3 * back:.1f}',
            f'{1e-3 * pressure:.2f}',
            f'{1e-3 * pressure / (out - back):.1f}',
        )
        yield name, *told


def _reruns(rerun: Path, alone: Mapping[str, ChannelResult]) -> Iterator[tuple[str, ...]]:
    for pressure in (3, 7):
        names = sorted(path.stem for path in rerun.glob(f'*_{pressure}bar.csv'))
        for of, run in permutations(names, 2):
            stroke = mean_stroke(alone[of], alone[run])
            yield run, of, f'{predicted(alone[of], alone[run]):.2f}', f'{stroke:.2f}'


def _strokes(one: Experiment) -> list[tuple[bool, slice, Array]]:
    """Return of each stroke whether it goes inwards, its samples, and how long after its begin they are [s]."""
    times, position = one.sample_times, gaussian_filter1d(one.at_samples('displacement'), SMOOTHED)
    stroke = float(np.ptp(position))
    turns = sorted(
        (float(times[index]), inwards)
        for inwards in (False, True)
        for index in find_peaks(position if inwards else -position, prominence=0.3 * stroke)[0]
    )
    found = []
    for (first, inwards), (last, _) in pairwise(turns):
        samples = slice(*np.searchsorted(times, [first - BEFORE, last - BEFORE]).tolist())
        found.append((inwards, samples, times[samples] - first + BEFORE))
    return found
