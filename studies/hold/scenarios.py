# SPDX-License-Identifier: Apache-2.0
"""
Scenarios of Gadringer et al. for the contact force of robots (doi 10.5194/ms-13-361-2022).

A rig whose piston is driven by its position can play a constant force at rest, along a flat and a sloped surface, and
steps of the force. An approach to contact needs a robot. A load cell measures the force; five runs are averaged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.path import IdentifiedDevice, PathMotion, Prediction, Preview, Surface, Task, preview_force
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.rig import RigParameters
from studies.hold.devices import regulators
from studies.hold.playing import PERIOD, on_path, play
from studies.hold.surfaces import scanned

RUNS = 5
"""Number of runs that are averaged."""

FORCE, STEP = 20.0, 10.0
"""Wanted force, and the height of a step of the force [N]."""

FEEDS = (0.025, 0.05, 0.1)
"""Speeds along the surfaces [m/s]."""

SLOPE = 0.01
"""Rise of the sloped surface per length of the path."""

SECONDS = 4.0
"""Duration of a run [s]."""

DEVIATION, DEVIATION_LENGTH = 3e-5, 1e-2
"""Unknown deviation of the robot from its path, RMS, and the length over which the deviation changes [m]."""

SMOOTHING = 0.02
"""Span of the mean of the load cell's readings [s]."""

SETTLED = 0.1
"""Distance from the wanted force at which a step has settled, as a share of the step."""


def play_scenarios(rig: RigParameters, identified: IdentifiedDevice) -> dict[str, dict[str, float]]:
    """Return the figures of each scenario by its name; forces in N, times in s."""
    still = np.arange(0.0, SECONDS, 0.01)
    resting = preview_force(identified, PathMotion(still, np.zeros_like(still)), Task(FORCE, regulators=regulators()))
    figures = {'at rest': _mean_figures(_run(resting.constant, rig, run) for run in range(RUNS))}
    for name, slope in (('flat', 0.0), ('sloped', SLOPE)):
        for feed in FEEDS:
            along = np.arange(0.0, SECONDS * feed, 5e-4)
            surface = Surface(along, slope * (along - 0.5 * along[-1]))
            preview = preview_force(identified, surface, Task(FORCE, feed, regulators=regulators(), hold=True))
            figures |= _surface_figures(f'{name}, {1e3 * feed:.0f} mm/s', surface, feed, preview, rig)
    for sign in (1.0, -1.0):
        stepped = _stepped(resting.constant, identified, sign * STEP)
        figures[f'step of {sign * STEP:+.0f} N'] = _mean_figures(
            _step_figures(stepped, rig, run, sign) for run in range(RUNS)
        )
    return figures


def _surface_figures(
    name: str, surface: Surface, feed: float, preview: Preview, rig: RigParameters
) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the figures at constant and at held set-points, on a path with an unknown deviation of the robot."""
    assert preview.held is not None
    shift = float(preview.constant.path.displacement[0])
    for control, prediction in (('constant', preview.constant), ('held', preview.held.prediction)):
        paths = [scanned(surface, DEVIATION, run, DEVIATION_LENGTH).at_feed(feed).shifted(shift) for run in range(RUNS)]
        runs = (_run(replace(prediction, path=path), rig, run) for run, path in enumerate(paths))
        yield f'{name}, {control}', _mean_figures(runs)


def _run(prediction: Prediction, rig: RigParameters, run: int) -> dict[str, float]:
    """Return the force error by the load cell in a run [N]."""
    error = _reading(prediction, rig, run) - prediction.target
    return {
        'mean error': abs(float(np.mean(error))),
        'standard deviation': float(np.std(error)),
        'largest error': float(np.max(np.abs(error))),
    }


def _stepped(constant: Prediction, identified: IdentifiedDevice, step: float) -> Prediction:
    """Return a prediction with set-points that change the force by a step in the middle of the path [N]."""
    area = identified.device.number('area') * identified.device.number('geometric_factor')
    times = np.array([constant.path.grid[0], 0.5 * SECONDS])
    setpoints = {}
    for (name, level), sign in zip(sorted(constant.setpoints.items()), (1.0, -1.0)):
        assert isinstance(level, float)
        setpoints[name] = Signal(times, np.array([level, level + sign * 0.5 * step / area]))
    return replace(constant, setpoints=setpoints, target=constant.target + step)


def _step_figures(stepped: Prediction, rig: RigParameters, run: int, sign: float) -> dict[str, float]:
    """Return settling time [s], overshoot and remaining error [N] of a step of the force in the middle of the path."""
    force = _reading(stepped, rig, run)
    times = stepped.path.grid[stepped.path.is_on_path] - 0.5 * SECONDS
    error = (force - stepped.target)[times >= 0.0]
    unsettled = np.flatnonzero(np.abs(error) > SETTLED * STEP)
    settling = 0.0 if not unsettled.size else float(times[times >= 0.0][unsettled[-1]])
    return {
        'settling time': settling,
        'overshoot': max(float(np.max(sign * error)), 0.0),
        'remaining error': abs(float(np.mean(error[error.size // 2 :]))),
    }


def _reading(prediction: Prediction, rig: RigParameters, run: int) -> Array:
    """Return the smoothed readings of the load cell on the path [N]."""
    answer = play(prediction, rig, seed=run)
    smooth = uniform_filter1d(answer.force, round(SMOOTHING / PERIOD))
    return on_path(prediction, answer.truth.times, smooth)


def _mean_figures(runs: Iterator[dict[str, float]]) -> dict[str, float]:
    """Return the means of figures over runs."""
    answers = list(runs)
    return {name: float(np.mean([answer[name] for answer in answers])) for name in answers[0]}
