# SPDX-License-Identifier: Apache-2.0
"""Within what a device was identified: beyond it nobody has compared the model with the device."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.recording import Recording

SPEED_INTERVAL = 0.02
"""Over which a speed is the mean, so that the noise of the displacement does not count [s]."""

Span = tuple[float, float]
"""The lowest and the highest value."""

UNKNOWN: Span = (0.0, 0.0)
"""Stands for a span in a parameter file: nobody knows it."""


@dataclass(frozen=True)
class IdentifiedRange:
    """
    The spans of the recordings that a device was identified with; None where a span is not known.

    Attributes
    ----------
    displacement
        Of the piston [m].
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
        """Return the spans of some recordings, whose set-points are counted from an ambient pressure [Pa]."""
        recordings = list(recordings)
        moving = [one.displacement for one in recordings if not one.rests]
        setpoints, pressures = {}, {}
        for name in CYLINDERS:
            signals = [one.cylinders[name] for one in recordings if name in one.cylinders]
            recorded = [one.setpoint.values - ambient_pressure for one in signals if one.setpoint is not None]
            if recorded:
                setpoints[name] = _span(recorded)
            if signals:
                pressures[name] = _span(one.pressure.values for one in signals)
        return cls(
            _span(one.values for one in moving) if moving else None,
            max((_largest_speed(one.times, one.values) for one in moving), default=None),
            setpoints,
            pressures,
        )


def _span(values: Iterable[np.ndarray]) -> Span:
    ends = [(float(one.min()), float(one.max())) for one in values]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _largest_speed(times: np.ndarray, values: np.ndarray) -> float:
    """Return the largest travel within half of the interval over that time, as nodes measure it [m/s]."""
    step = 0.5 * SPEED_INTERVAL
    steps = math.floor((times[-1] - times[0]) / step)
    if steps < 1:
        return 0.0
    grid = times[0] + step * np.arange(steps + 1)
    return float(np.max(np.abs(np.diff(np.interp(grid, times, values)))) / step)
