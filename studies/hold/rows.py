# SPDX-License-Identifier: Apache-2.0
"""Measure a device: identify the device, predict and hold the force on its surfaces, and play them on the rig."""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cfd_pneumatic as cfd
from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path import IdentifiedDevice, PathSimulator, Prediction, Preview, held_setpoints, preview_force
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import record
from studies.hold.controllers import ControllerGains, controlled_errors, formula_setpoints, tuned_gains
from studies.hold.devices import HoldDevice, draw_device, draw_recording, regulators
from studies.hold.playing import played_feed, shift_of, true_error
from studies.hold.scenarios import play_scenarios
from studies.hold.surfaces import PathTask, draw_task, scanned
from studies.tools.provenance import code_version, commit

SLOWEST = 0.2
"""Slowest feed that is compared with a played feed, as a share of the feed: friction limits slower feeds."""

DELAYS = (0.005, 0.01)
"""Delays of the set-points in the variants [s]."""

SLOWER_RATES = (50.0, 20.0)
"""Rates of the set-points in the variants [Hz]."""

CONSTANT, HELD, CONTROLLER, FORMULA, WRONG_SCAN = 'constant', 'held', 'controller', 'formula', 'scan wrong by 0.05 mm'
VARIED = 3
"""Number of surfaces of each device on which the variants are played."""

TUNING_SURFACE, TUNING_DURATION = 100, 6.0
"""Number of the surface on which the controller is tuned, and its duration [s]."""

FAILURES = (InputError, ArithmeticError, RuntimeError, ValueError)
"""Errors that end the work on a device or a surface, but not the run."""

EPOCH = 1_700_000_000_000_000_000
"""Time of the recordings' first sample since 1970 [ns]."""


class Job(NamedTuple):
    """Work on a device: its surfaces and their duration, duration of the recording [s], and additional figures."""

    seed: int
    surfaces: int
    duration: float
    recording: float
    with_feed: bool
    with_scenarios: bool
    code: str


@dataclass(frozen=True)
class Row:
    """
    Figures of a device on a surface; forces in N.

    Attributes
    ----------
    device, path
        Facts of the device and of the path.
    message
        Error that ended the work; empty if there was none.
    errors
        RMS of the true force error by variant.
    predicted
        Figures of the predictions at constant and at held set-points, see `prediction_figures`.
    fastest
        Fastest feed as predicted and as played [m/s]; empty if not searched, None if friction limits it.
    scenarios
        Figures of the scenarios by name.
    seconds
        Durations by kind of work [s].
    code, commit
        Version of the program.

    """

    seed: int
    surface: int
    device: Mapping[str, Any]
    path: Mapping[str, float]
    code: str
    commit: str
    message: str = ''
    errors: Mapping[str, float] = field(default_factory=dict)
    predicted: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fastest: Mapping[str, float | None] = field(default_factory=dict)
    scenarios: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


def measure(job: Job) -> list[Row]:
    """Return the rows of a device."""
    device, began = draw_device(job.seed), time.perf_counter()
    tasks = [draw_task(job.seed, number, job.duration) for number in range(job.surfaces)]
    blank = [Row(job.seed, n, device.facts, task.facts, job.code, commit()) for n, task in enumerate(tasks)]
    try:
        identified = identify(device, job.seed, job.recording)
        seconds = {'identification': time.perf_counter() - began}
        gains = _tuned_gains(device, identified, job.seed)
        seconds['tuning'] = time.perf_counter() - began - seconds['identification']
    except FAILURES as error:
        return [replace(row, message=f'{type(error).__name__}: {error}') for row in blank]
    rows = []
    for row, task in zip(blank, tasks):
        is_first = row.surface == 0
        try:
            found = _measured(row, device, identified, task, gains, with_feed=job.with_feed and is_first)
            scenarios = play_scenarios(device.rig, identified) if job.with_scenarios and is_first else {}
            rows.append(replace(found, scenarios=scenarios, seconds=found.seconds | (seconds if is_first else {})))
        except FAILURES as error:
            rows.append(replace(row, message=f'{type(error).__name__}: {error}'))
    return rows


def identify(device: HoldDevice, seed: int, duration: float) -> IdentifiedDevice:
    """Record a device on the rig, and return the identified device."""
    answer = record(draw_recording(seed, duration), device.rig, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / 'identified'
        cfd.identify(recording_of(answer, f'device {seed}', EPOCH), close_loop=True).save(output)
        return IdentifiedDevice.load(output)


def _tuned_gains(device: HoldDevice, identified: IdentifiedDevice, seed: int) -> ControllerGains:
    task = draw_task(seed, TUNING_SURFACE, TUNING_DURATION)
    preview = preview_force(identified, task.surface, task.order())
    return tuned_gains(preview.constant, device.rig, identified.device.number('area'))


def _measured(
    row: Row, device: HoldDevice, identified: IdentifiedDevice, task: PathTask, gains: ControllerGains, with_feed: bool
) -> Row:
    """Return a row with the figures of a surface: predictions, variants on the rig, and the fastest feed."""
    began = time.perf_counter()
    preview = preview_force(identified, task.surface, task.order(hold=True))
    assert preview.held is not None
    constant = replace(preview.constant, tolerance=task.tolerance)
    held = replace(preview.held.prediction, tolerance=task.tolerance)
    predictions = {CONSTANT: constant, HELD: held}
    true = {name: true_error(prediction, device.rig) for name, prediction in predictions.items()}
    errors = {name: rms(error) for name, error in true.items()}
    if row.surface < VARIED:
        for delay in DELAYS:
            errors[f'late by {1e3 * delay:.0f} ms'] = rms(true_error(held, device.rig, late=delay))
        for name, variant in _variants(identified, preview, task, row.surface):
            errors[name] = rms(true_error(variant, device.rig))
        errors[CONTROLLER] = rms(controlled_errors(constant, device.rig, gains, identified.device.number('area'))[0])
    fastest = _fastest(device, identified, constant, task) if with_feed else {}
    figures = {name: prediction_figures(prediction, true[name]) for name, prediction in predictions.items()}
    seconds = {'surface': time.perf_counter() - began}
    return replace(row, errors=errors, predicted=figures, fastest=fastest, seconds=seconds)


def _fastest(
    device: HoldDevice, identified: IdentifiedDevice, constant: Prediction, task: PathTask
) -> dict[str, float | None]:
    """Return the fastest feed as predicted and as played [m/s]; None if friction limits the feed."""
    slow = replace(constant, path=task.surface.at_feed(SLOWEST * task.feed).shifted(shift_of(constant, task.surface)))
    force = PathSimulator(slow.path).simulate(identified.device, slow.setpoints).force[slow.path.is_on_path]
    if np.max(np.abs(force - task.force)) > task.tolerance:
        return {'predicted': None, 'played': None}
    feed = preview_force(identified, task.surface, task.order(tolerance=task.tolerance)).feed
    assert feed is not None
    assert feed.predicted is not None
    return {'predicted': feed.predicted, 'played': played_feed(constant, task, device.rig, feed.predicted)}


def _variants(
    identified: IdentifiedDevice, preview: Preview, task: PathTask, number: int
) -> list[tuple[str, Prediction]]:
    """Return the variants of the set-points by name, each with the true path."""
    constant, device = preview.constant, identified.device
    wrong = scanned(task.surface, seed=number).at_feed(task.feed).shifted(shift_of(constant, task.surface))
    plans = {f'held, {rate:.0f} Hz': (constant.path, regulators(rate)) for rate in SLOWER_RATES}
    plans[WRONG_SCAN] = (wrong, regulators())
    setpoints = {
        name: held_setpoints(PathSimulator(path), device, preview.levels, task.force, limits)
        for name, (path, limits) in plans.items()
    }
    setpoints[FORMULA] = formula_setpoints(device, constant.path, preview.levels)
    return [(name, replace(constant, setpoints=levels)) for name, levels in setpoints.items()]


def prediction_figures(prediction: Prediction, true: Array) -> dict[str, float]:
    """
    Return how a prediction agrees with the true force error on the path, shape (n,) [N].

    Returns
    -------
    dict
        `rms`: predicted RMS error [N]. `half_band`: RMS of half of the band [N]. `covered`: share of samples within
        the band. `samples`: their number. `violations`: samples with a true error beyond the tolerance plus half of the
        band. `missed`: such samples without a predicted violation, certain or possible.

    """
    assert prediction.tolerance is not None
    path, half = prediction.path, prediction.half_band[prediction.path.is_on_path]
    times = path.grid[path.is_on_path]
    violates = np.abs(true) > prediction.tolerance + half
    is_predicted = np.zeros(times.size, dtype=bool)
    for begin, end, _ in prediction.violations:
        is_predicted |= (times >= begin) & (times <= end)
    return {
        'rms': prediction.rms_error,
        'half_band': prediction.rms_band,
        'covered': float(np.mean(np.abs(true - prediction.error) <= half)),
        'samples': times.size,
        'violations': int(np.sum(violates)),
        'missed': int(np.sum(violates & ~is_predicted)),
    }


def version() -> str:
    """Return a fingerprint of the package and of this study, without its document."""
    paths = [path for path in sorted(Path(__file__).parent.glob('*.py')) if path.name != 'document.py']
    return hashlib.sha256(b''.join([code_version().encode(), *(path.read_bytes() for path in paths)])).hexdigest()[:12]
