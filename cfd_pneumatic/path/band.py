# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of a predicted force: parameters, residual of the identification, scan, and timing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device, Value
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import STEP_SETTLING_TIME
from cfd_pneumatic.path.identified import IdentifiedDevice
from cfd_pneumatic.path.motion import PathMotion
from cfd_pneumatic.path.simulation import PathResponse, PathSimulator, Setpoints, acting_at, delayed
from cfd_pneumatic.path.thresholds import DEVIATION, PERIOD, SCAN_LENGTH, SCAN_TIME, SCANS
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.runtime import map_in_threads


@dataclass(frozen=True)
class PlanErrors:
    """
    Errors of the plan, as standard deviations.

    Attributes
    ----------
    scan
        Error of the surface [m].
    timing
        Error of the time at which the robot is at a position [s].

    Raises
    ------
    InputError
        If an error is negative.

    """

    scan: float = 0.0
    timing: float = 0.0

    def __post_init__(self) -> None:
        """Check the errors."""
        for name, error in (('scan', self.scan), ('timing', self.timing)):
            if not (math.isfinite(error) and error >= 0.0):
                raise InputError(f'the {name} error must be 0 or above, is {error:g}')


def force_variances(
    simulator: PathSimulator,
    identified: IdentifiedDevice,
    setpoints: Setpoints,
    response: PathResponse,
    errors: PlanErrors,
) -> dict[str, Array]:
    """
    Return the variances of the predicted force by their causes, each (n,) [N^2].

    `parameters`: each principal axis of the covariance of the parameters moves the force by the difference of two
    simulations. `model`: the error that the identified model leaves beyond the noise. `scan`: the variance over random
    errors of the surface. `timing`: the slope of the force, or the force at set-points that act earlier or later.
    """
    variances = {
        'parameters': _variance_of_parameters(simulator, identified, setpoints, response),
        'model': _variance_of_model(simulator.path, identified, setpoints),
    }
    if errors.scan > 0.0:
        variances['scan'] = _variance_of_scan(simulator.path, identified.device, setpoints, response, errors.scan)
    if errors.timing > 0.0:
        variances['timing'] = _variance_of_timing(simulator, identified.device, setpoints, response, errors.timing)
    return variances


def _variance_of_parameters(
    simulator: PathSimulator, identified: IdentifiedDevice, setpoints: Setpoints, response: PathResponse
) -> Array:
    def change(values: Mapping[str, Value]) -> Array:
        return simulator.simulate(identified.device.with_values(values), setpoints).force - response.force

    changes = map_in_threads(change, [values for _, values in identified.deviations(DEVIATION)])
    return sum(((difference / DEVIATION) ** 2 for difference in changes), start=np.zeros_like(response.force))


def _variance_of_model(path: PathMotion, identified: IdentifiedDevice, setpoints: Setpoints) -> Array:
    """
    Return the variance of the error that the identification left, at rest or in motion [N^2].

    Set-points that change add the error that the identification left after steps, in proportion to their range over
    the time in which a step settles.
    """
    force_per_pascal = identified.device.number('area') * identified.device.number('geometric_factor')
    moves = path.speed_at(path.grid) != 0.0
    variance = np.zeros_like(path.grid)
    for channel, error in identified.model_errors.items():
        scale = force_per_pascal if channel in CYLINDERS else 1.0
        known = [size for size in (error.rest, error.motion) if size is not None]
        if known:
            variance += (scale * np.where(moves, known[-1], known[0])) ** 2
        level = setpoints.get(channel)
        if isinstance(level, Signal) and error.per_step is not None:
            variance += (scale * error.per_step * _recent_range(acting_at(level, path.grid))) ** 2
    return variance


def _recent_range(levels: Array) -> Array:
    """Return the range of set-points over the last `STEP_SETTLING_TIME`, shape (n,) [Pa]."""
    window = round(STEP_SETTLING_TIME / PERIOD)
    recent = {'size': window, 'origin': (window - 1) // 2, 'mode': 'nearest'}
    return np.asarray(maximum_filter1d(levels, **recent) - minimum_filter1d(levels, **recent))


def _variance_of_scan(
    path: PathMotion, device: Device, setpoints: Setpoints, response: PathResponse, scan_error: float
) -> Array:
    """Return the variance over random errors of the surface, which change over a length or a time [N^2]."""
    length = SCAN_TIME if path.along is None else SCAN_LENGTH * path.duration / float(path.along[-1])
    on_path = np.clip(np.arange(path.grid.size), *np.flatnonzero(path.is_on_path)[[0, -1]])
    random = np.random.default_rng(0)
    variance = np.zeros_like(response.force)
    for _ in range(SCANS):
        error = gaussian_filter1d(random.standard_normal(path.grid.size), length / PERIOD)
        deviation = (scan_error / float(np.std(error))) * error[on_path]  # constant before and after the path
        variance += (PathSimulator(path, deviation).simulate(device, setpoints).force - response.force) ** 2
    return variance / SCANS


def _variance_of_timing(
    simulator: PathSimulator, device: Device, setpoints: Setpoints, response: PathResponse, timing_error: float
) -> Array:
    """Return the variance by the slope of the force, and by set-points that act earlier or later [N^2]."""
    variance = (timing_error * np.gradient(response.force, simulator.path.grid)) ** 2
    if not any(isinstance(level, Signal) for level in setpoints.values()):
        return variance
    shifted = [simulator.simulate(device, delayed(setpoints, delay)).force for delay in (-timing_error, timing_error)]
    return np.asarray(np.mean([(force - response.force) ** 2 for force in shifted], axis=0))
