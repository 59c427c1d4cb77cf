# SPDX-License-Identifier: Apache-2.0
"""Define the range of the recordings with which a device was identified; beyond the range the model is untested."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.recording import Recording

SPEED_INTERVAL = 0.02
"""Averaging interval of a speed, which suppresses the noise of the displacement [s]."""

Span = tuple[float, float]
"""The lowest and the highest value."""

UNKNOWN: Span = (0.0, 0.0)
"""Span in a parameter file that is not known."""


@dataclass(frozen=True)
class IdentifiedRange:
    """
    The spans of the recordings with which a device was identified; None for an unknown span.

    Attributes
    ----------
    displacement
        Lowest and highest displacement of the piston [m].
    speed
        Largest speed of the piston [m/s].
    setpoints
        Gauge set-points, by cylinder [Pa].
    pressures
        Absolute pressures, by cylinder [Pa].

    """

    displacement: Span | None = None
    speed: float | None = None
    setpoints: Mapping[str, Span] = field(default_factory=dict)
    pressures: Mapping[str, Span] = field(default_factory=dict)

    @classmethod
    def of_recordings(cls, recordings: Iterable[Recording], ambient_pressure: float) -> IdentifiedRange:
        """Return the spans of recordings, with set-points relative to an ambient pressure [Pa]."""
        recordings = list(recordings)
        moving = [recording.displacement for recording in recordings if not recording.rests]
        setpoints, pressures = {}, {}
        for name in CYLINDERS:
            cylinders = [recording.cylinders[name] for recording in recordings if name in recording.cylinders]
            signals = [cylinder.setpoint for cylinder in cylinders if cylinder.setpoint is not None]
            if signals:
                setpoints[name] = _span(signal.values - ambient_pressure for signal in signals)
            if cylinders:
                pressures[name] = _span(cylinder.pressure.values for cylinder in cylinders)
        return cls(
            _span(signal.values for signal in moving) if moving else None,
            max((_largest_speed(signal.times, signal.values) for signal in moving), default=None),
            setpoints,
            pressures,
        )


def _span(arrays: Iterable[np.ndarray]) -> Span:
    ends = [(float(values.min()), float(values.max())) for values in arrays]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _largest_speed(times: np.ndarray, values: np.ndarray) -> float:
    """Return the largest mean speed over half of `SPEED_INTERVAL`, as nodes measure the speed [m/s]."""
    step = 0.5 * SPEED_INTERVAL
    steps = math.floor((times[-1] - times[0]) / step)
    if steps < 1:
        return 0.0
    grid = times[0] + step * np.arange(steps + 1)
    return float(np.max(np.abs(np.diff(np.interp(grid, times, values)))) / step)
