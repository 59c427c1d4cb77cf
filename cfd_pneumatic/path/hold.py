# SPDX-License-Identifier: Apache-2.0
"""
Set-points over time that hold the force along a path: the inverse of the identified model.

Equation (12) at constant pressure needs a set-point that leads the pressure by K_x / K times the speed. Effects,
friction, dead time and lag of the command change this lead. The inversion therefore iterates. It simulates, and
converts the force error to an error of each pressure. Least squares then give the corrections of the set-points from
the linearised response of the pressure to each set-point of the schedule.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.sparse import csc_matrix, diags, identity
from scipy.sparse.linalg import splu

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import PRESSURE_PARTS, slowest
from cfd_pneumatic.path.prediction import Prediction
from cfd_pneumatic.path.setpoints import SetpointRange
from cfd_pneumatic.path.simulation import PathResponse, PathSimulator, delayed
from cfd_pneumatic.path.thresholds import (
    CHANGE,
    FASTEST_RATE,
    LATEST,
    LEAST_GAIN,
    LONGEST_RESPONSE,
    MOST_ITERATIONS,
    MOST_MEASUREMENTS,
    SETTLING_TIME_CONSTANTS,
    SMOOTHNESS,
    STEP_SHARES,
)
from cfd_pneumatic.recording import Signal
from cfd_pneumatic.runtime import map_in_threads


@dataclass(frozen=True)
class Regulators:
    """
    Limits of the regulators and of the command.

    Attributes
    ----------
    range
        Lowest and highest gauge set-point [Pa].
    rate
        Rate at which set-points are commanded [Hz].
    slew
        Largest rate of a set-point [Pa/s]; None if it is not limited.

    Raises
    ------
    InputError
        If a limit is not positive, or the range is empty.

    """

    range: SetpointRange
    rate: float = 50.0
    slew: float | None = None

    def __post_init__(self) -> None:
        """Check the limits."""
        if not self.range.low < self.range.high:
            raise InputError(
                f'the range of the regulators must have the lower set-point first, is {self.range.low:g} to '
                f'{self.range.high:g} Pa'
            )
        if not 0.0 < self.rate <= FASTEST_RATE:
            raise InputError(
                f'the rate of set-points must be above 0 and at most {FASTEST_RATE:g} Hz, is {self.rate:g}'
            )
        if self.slew is not None and not self.slew > 0.0:
            raise InputError(f'the largest rate of a set-point must be above 0, is {self.slew:g} Pa/s')

    def limited(self, levels: Array) -> Array:
        """Return set-points within the range and the slew rate, each (n,) [Pa]; a steep change begins earlier."""
        within = np.clip(levels, self.range.low, self.range.high)
        if self.slew is None:
            return within
        step = self.slew / self.rate
        after, before = within.copy(), within.copy()
        for index in range(1, within.size):
            after[index] = np.clip(within[index], after[index - 1] - step, after[index - 1] + step)
        for index in range(within.size - 2, -1, -1):
            before[index] = np.clip(within[index], before[index + 1] - step, before[index + 1] + step)
        return np.asarray(0.5 * (after + before))


def held_setpoints(
    simulator: PathSimulator, device: Device, constant: Mapping[str, float], target: float, regulators: Regulators
) -> dict[str, Signal]:
    """
    Return the set-points over time that hold the force along a path.

    Parameters
    ----------
    simulator, device
        The path and the device.
    constant
        Constant gauge set-points [Pa]; the iteration begins with them, and keeps their mean pressure.
    target
        Wanted force [N].
    regulators
        Limits of the set-points.

    Returns
    -------
    Mapping
        Gauge set-points by cylinder, which act from their times on [Pa].

    """
    return _Inversion(simulator, device, target, regulators).solve(constant)


_Solver = Callable[[Array], Array]
"""Converts a change of a pressure, shape (n,) [Pa], to changes of the set-points, shape (k,) [Pa]."""


class _State(NamedTuple):
    """A state of the iteration."""

    levels: Mapping[str, Array]
    """Gauge set-points by cylinder, each (k,) [Pa]."""

    response: PathResponse
    """Response of the device."""

    error: float
    """Root mean square of the force error on the path [N]."""


class _Inversion:
    """Iteration from constant set-points to set-points that hold the force."""

    def __init__(self, simulator: PathSimulator, device: Device, target: float, regulators: Regulators) -> None:
        self._simulator, self._device, self._target, self._regulators = simulator, device, target, regulators
        grid = simulator.path.grid
        count = int((grid[-1] - grid[0]) * regulators.rate) + 1
        self._times = grid[0] + np.arange(count) / regulators.rate
        self._scale = device.number('area') * device.number('geometric_factor')

    def solve(self, constant: Mapping[str, float]) -> dict[str, Signal]:
        """
        Return the set-points after the last iteration that reduced the force error.

        The responses are measured again if no step along the corrections reduces the error enough: they depend on
        the valve that acts, and thus on the set-points.
        """
        state = self._state({name: np.full(self._times.size, level) for name, level in constant.items()})
        total = sum(float(pressure[0]) for pressure in state.response.pressures.values())
        for _ in range(MOST_MEASUREMENTS):
            solvers = {name: self._solver(state, name) for name in state.levels}
            begin = state
            for _ in range(MOST_ITERATIONS):
                improved = self._improved(state, solvers, total)
                if improved.error > (1.0 - LEAST_GAIN) * state.error:
                    break
                state = improved
            if state.error > (1.0 - LEAST_GAIN) * begin.error:
                break
        return self._signals(state.levels)

    def _state(self, levels: Mapping[str, Array]) -> _State:
        """Return the state at set-points of each cylinder, each (k,) [Pa]."""
        response = self._simulator.simulate(self._device, self._signals(levels))
        return _State(levels, response, rms(response.force[self._simulator.path.is_on_path] - self._target))

    def _improved(self, state: _State, solvers: Mapping[str, _Solver], total: float) -> _State:
        """Return the best state along the corrections: after a whole step, or after a share of the step."""
        corrections = self._pressure_corrections(state.response, total)
        changes = {name: solvers[name](corrections[name]) for name in state.levels}
        states = []
        for share in STEP_SHARES:
            levels = {
                name: self._regulators.limited(level + share * changes[name]) for name, level in state.levels.items()
            }
            states.append(self._state(levels))
            if states[-1].error < state.error:
                break
        return min(states, key=lambda candidate: candidate.error)

    def _signals(self, levels: Mapping[str, Array]) -> dict[str, Signal]:
        return {name: Signal(self._times, level) for name, level in levels.items()}

    def _pressure_corrections(self, response: PathResponse, total: float) -> dict[str, Array]:
        """
        Return the changes of the pressures that remove the force error, each (n,) [Pa].

        Two cylinders share the change, and the sum of their pressures returns to a `total` [Pa].
        """
        difference = (self._target - response.force) / self._scale
        signs = {CYLINDERS[0]: 1.0, CYLINDERS[1]: -1.0}
        count = len(response.pressures)
        common = (total - sum(response.pressures.values(), start=np.zeros_like(difference))) / count
        shared = common if count == len(CYLINDERS) else np.zeros_like(difference)
        return {name: signs[name] * difference / count + shared for name in response.pressures}

    def _solver(self, state: _State, name: str) -> _Solver:
        """
        Return the function that converts a change of a cylinder's pressure to changes of its set-points.

        The response to each set-point is measured: set-points that are far enough apart, so that their responses do
        not overlap, are changed in one simulation.
        """
        grid, rate = self._simulator.path.grid, self._regulators.rate
        spacing = max(2, math.ceil(self._response_time(name) * rate))
        begins = np.searchsorted(grid, self._times - 1e-9)

        def responses(first: int) -> Array:
            """Return the response to every set-point from a first one on, each `spacing` set-points apart."""
            changed = state.levels[name].copy()
            changed[first::spacing] += CHANGE
            response = self._state({**state.levels, name: changed}).response
            return (response.pressures[name] - state.response.pressures[name]) / CHANGE

        rows, columns, values = [], [], []
        for first, response in enumerate(map_in_threads(responses, range(spacing))):
            for index in range(first, self._times.size, spacing):
                end = begins[index + spacing] if index + spacing < self._times.size else grid.size
                part = np.arange(begins[index], end)
                rows.append(part)
                columns.append(np.full(part.size, index))
                values.append(response[part])
        size = self._times.size
        matrix = csc_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(grid.size, size)
        )
        normal = (matrix.T @ matrix).tocsc()
        strength = float(normal.diagonal().max())
        change = diags([-1.0, 1.0], [0, 1], shape=(size - 1, size))
        penalty = SMOOTHNESS * strength * (change.T @ change + 1e-3 * identity(size))
        factors = splu((normal + penalty).tocsc())
        return lambda correction: np.asarray(factors.solve(matrix.T @ correction))

    def _response_time(self, name: str) -> float:
        """Return the time in which the response of a pressure to its set-point ends [s]."""
        cylinder = self._device.model.cylinders[name]
        gains = cylinder.parameters.table[:, 1:]
        delays = sum(values[0] for effect, values in cylinder.effects.items() if PRESSURE_PARTS[effect].is_of_command)
        settling = SETTLING_TIME_CONSTANTS * max(slowest(row) for row in gains)
        return min(settling + SETTLING_TIME_CONSTANTS * delays, LONGEST_RESPONSE)


def latest_arrival(simulator: PathSimulator, device: Device, held: Prediction, constant: Prediction) -> float:
    """
    Return the delay of the set-points at which their benefit is lost [s], at most `LATEST`.

    At this delay the root mean square of the force error is that of constant set-points.
    """
    on_path = simulator.path.is_on_path

    def loss(delay: float) -> float:
        force = simulator.simulate(device, delayed(held.setpoints, delay)).force
        return rms(force[on_path] - held.target) - constant.rms_error

    if loss(0.0) >= 0.0:
        return 0.0
    if loss(LATEST) <= 0.0:
        return LATEST
    return float(brentq(loss, 0.0, LATEST, xtol=1e-3))
