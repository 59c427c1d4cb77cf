# SPDX-License-Identifier: Apache-2.0
"""Preview of the force along a path: prediction, set-points, feed, air, and set-points that hold the force."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cfd_pneumatic.convention import SUPPLY_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path.air import air_consumption
from cfd_pneumatic.path.band import PlanErrors
from cfd_pneumatic.path.causes import ForceCauses, force_causes
from cfd_pneumatic.path.feed import FastestFeed, fastest_feed
from cfd_pneumatic.path.hold import Regulators, held_setpoints, latest_arrival
from cfd_pneumatic.path.identified import IdentifiedDevice
from cfd_pneumatic.path.motion import PathMotion, Surface
from cfd_pneumatic.path.prediction import Prediction, predict
from cfd_pneumatic.path.setpoints import SetpointRange, centred_setpoints, check_force, usual_bias
from cfd_pneumatic.path.simulation import PathSimulator
from cfd_pneumatic.path.thresholds import LARGEST_EXCESS, LONGEST_PATH


@dataclass(frozen=True)
class Task:
    """
    What the force along a path has to be, and under which conditions.

    Attributes
    ----------
    force
        Wanted contact force [N].
    feed
        Speed along the path [m/s]; None for a motion that is given over time.
    tolerance
        Largest accepted distance from the wanted force [N]; None if no tolerance is given.
    bias
        Mean gauge set-point of two cylinders [Pa]; None for that of the recordings.
    start
        Displacement of the piston where the error of a surface is 0 [m]; None to centre the path in the stroke.
    errors
        Errors of the scan and of the timing.
    regulators
        Limits of the regulators.
    hold
        Whether set-points over time are computed that hold the force.

    """

    force: float
    feed: float | None = None
    tolerance: float | None = None
    bias: float | None = None
    start: float | None = None
    errors: PlanErrors = field(default_factory=PlanErrors)
    regulators: Regulators = field(default_factory=lambda: Regulators(SetpointRange(0.0, SUPPLY_PRESSURE)))
    hold: bool = False

    def __post_init__(self) -> None:
        """Check the wanted force and the tolerance."""
        if not (math.isfinite(self.force) and self.force != 0.0):
            raise InputError(f'the wanted force must be a finite number other than 0, is {self.force:g} N')
        if self.tolerance is not None and not self.tolerance > 0.0:
            raise InputError(f'the tolerance must be above 0, is {self.tolerance:g} N')


@dataclass(frozen=True)
class Held:
    """
    Set-points over time that hold the force.

    Attributes
    ----------
    prediction
        Predicted force at these set-points.
    latest
        Delay of the set-points at which their benefit is lost [s].
    is_promised
        Whether the force error is smaller than that of constant set-points within the whole band.

    """

    prediction: Prediction
    latest: float
    is_promised: bool


@dataclass(frozen=True)
class Preview:
    """
    Preview of the force along a path; `print` shows the answers.

    Attributes
    ----------
    task
        What was wanted.
    identified
        The device.
    levels
        Constant gauge set-points by cylinder [Pa].
    constant
        Predicted force at these set-points.
    causes
        Causes of the force error at constant set-points.
    air
        Mean air consumption at constant set-points [m^3/s ANR].
    feed
        Fastest feeds that keep the tolerance; None without a tolerance or for a motion over time.
    held
        Set-points that hold the force; None if they were not wanted.
    notes
        Limits of this preview, as sentences.

    """

    task: Task
    identified: IdentifiedDevice
    levels: Mapping[str, float]
    constant: Prediction
    causes: ForceCauses
    air: float
    feed: FastestFeed | None
    held: Held | None
    notes: tuple[str, ...]


def preview_force(
    identified: IdentifiedDevice,
    course: Surface | PathMotion,
    task: Task,
    progress: Callable[[str], None] = lambda step: None,
) -> Preview:
    """
    Predict the force of a device along a path.

    Parameters
    ----------
    identified, course, task
        The device, the path, and what the force has to be.
    progress
        Called with the name of each step when the step begins.

    Raises
    ------
    InputError
        If the device or the regulators cannot give the force, or the path is not within the stroke.

    """
    device = identified.device
    check_force(device, task.force)
    path = _placed(_motion(course, task.feed), identified, task.start, is_surface=isinstance(course, Surface))
    simulator = PathSimulator(path)
    bias = usual_bias(device) if task.bias is None else task.bias
    progress('constant set-points')
    levels = centred_setpoints(simulator, device, task.force, bias, task.regulators.range)
    progress('force and its band')
    constant = predict(simulator, identified, levels, task.force, task.tolerance, task.errors)
    causes = force_causes(simulator, device, levels, constant.force)
    air = air_consumption(device, path, constant.response.pressures)
    progress('fastest feed')
    feed = _fastest_feeds(identified, course, constant, task) if isinstance(course, Surface) else None
    progress('set-points that hold the force')
    held = _held(simulator, identified, levels, constant, task) if task.hold else None
    return Preview(task, identified, levels, constant, causes, air, feed, held, tuple(_notes(identified, path)))


def _motion(course: Surface | PathMotion, feed: float | None) -> PathMotion:
    """Return the motion of the piston; refuse a motion that takes too long to simulate."""
    motion = _motion_of(course, feed)
    if motion.duration > LONGEST_PATH:
        raise InputError(
            f'the path takes {motion.duration:.0f} s, but {LONGEST_PATH:.0f} s are the longest that is simulated. '
            'Split the path, or choose a faster feed'
        )
    return motion


def _motion_of(course: Surface | PathMotion, feed: float | None) -> PathMotion:
    if isinstance(course, PathMotion):
        if feed is not None:
            raise InputError('a feed is for a surface, but the path is given over time. Leave the feed out')
        return course
    if feed is None:
        raise InputError('the path is given as the error of a surface, which needs a feed in m/s. Add --feed')
    return course.at_feed(feed)


def _placed(path: PathMotion, identified: IdentifiedDevice, start: float | None, *, is_surface: bool) -> PathMotion:
    """Return the motion in the stroke of the device; refuse a motion outside of the identified stroke."""
    stroke = identified.device.identified_range.displacement
    low, high = float(np.min(path.displacement)), float(np.max(path.displacement))
    if not is_surface and start is not None:
        raise InputError('a start is for a surface, but the path is given over time. Leave the start out')
    if stroke is None:
        return path if start is None else path.shifted(start)
    if is_surface:
        path = path.shifted(0.5 * (sum(stroke) - low - high) if start is None else start)
        low, high = float(np.min(path.displacement)), float(np.max(path.displacement))
    excess = max(stroke[0] - low, high - stroke[1])
    if excess > LARGEST_EXCESS * (stroke[1] - stroke[0]):
        raise InputError(
            f'the path needs displacements of {1e3 * low:.3g} to {1e3 * high:.3g} mm, but the device was identified '
            f'from {1e3 * stroke[0]:.3g} to {1e3 * stroke[1]:.3g} mm. Teach a path that is closer to the surface, or '
            'identify with longer strokes'
        )
    return path


def _fastest_feeds(
    identified: IdentifiedDevice, surface: Surface, constant: Prediction, task: Task
) -> FastestFeed | None:
    """Return the fastest feeds at the constant set-points that keep the tolerance."""
    tolerance = task.tolerance
    if tolerance is None or task.feed is None:
        return None
    shift = float(constant.path.displacement[0] - surface.error[0])

    def at_feed(feed: float) -> PathSimulator:
        return PathSimulator(surface.at_feed(feed).shifted(shift))

    def predicted_error(feed: float) -> float:
        simulator = at_feed(feed)
        force = simulator.simulate(identified.device, constant.setpoints).force
        return float(np.max(np.abs(force[simulator.path.is_on_path] - task.force)))

    def possible_error(feed: float) -> float:
        predicted = predicted_error(feed)
        if predicted > tolerance:
            return predicted  # the band takes most of the time, and would not change the answer
        prediction = predict(at_feed(feed), identified, constant.setpoints, task.force, None, task.errors)
        return prediction.largest_possible_error

    length = float(surface.along[-1])
    predicted = fastest_feed(predicted_error, length, tolerance, task.feed)
    if predicted is None:
        return FastestFeed(None, None)
    return FastestFeed(predicted, fastest_feed(possible_error, length, tolerance, predicted))


def _held(
    simulator: PathSimulator,
    identified: IdentifiedDevice,
    levels: Mapping[str, float],
    constant: Prediction,
    task: Task,
) -> Held:
    setpoints = held_setpoints(simulator, identified.device, levels, task.force, task.regulators)
    prediction = predict(simulator, identified, setpoints, task.force, task.tolerance, task.errors)
    largest = float(np.hypot(prediction.rms_error, prediction.rms_band))
    return Held(
        prediction, latest_arrival(simulator, identified.device, prediction, constant), largest < constant.rms_error
    )


def _notes(identified: IdentifiedDevice, path: PathMotion) -> list[str]:
    """Return the limits of a preview, as sentences."""
    notes = list(path.notes)
    known = identified.device.identified_range
    if not identified.covariances:
        notes.append(
            'The uncertainty of the device is not known, so that the band covers scan and timing only. '
            'Give the output folder of identify_bag.'
        )
    speed = float(np.max(np.abs(path.speed_at(path.grid))))
    if known.speed is not None and speed > known.speed:
        notes.append(
            f'The piston moves at up to {1e3 * speed:.3g} mm/s, but the device was identified up to '
            f'{1e3 * known.speed:.3g} mm/s. Faster parts of the path are not tested.'
        )
    if identified.device.not_identifiable:
        notes.append(f'Not identified, and assumed as in the fit: {", ".join(identified.device.not_identifiable)}.')
    return notes
