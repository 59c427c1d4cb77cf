# SPDX-License-Identifier: Apache-2.0
"""Charts of a value over all bags of a device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cfd_pneumatic import charts
from cfd_pneumatic.arrays import Array

_MOST_DOTS = 12  # values of a curve that are marked by dots, which a plant's page has no room for
_HEIGHT = 90  # of the axes [CSS px]
_LEAST_SPAN = 0.02  # share of a value; a smaller variation appears as a flat line
_COLOURS = {'before': 'var(--before)', 'after': 'var(--after)'}


@dataclass(frozen=True)
class Curve:
    """
    A line of a chart.

    Attributes
    ----------
    key
        Name of the colour: `before` or `after`.
    values, stds
        Values and standard errors; None for a missing value.

    """

    key: str
    values: Sequence[float | None]
    stds: Sequence[float | None]

    @property
    def present_values(self) -> list[float]:
        """The values that are not missing."""
        return [value for value in self.values if value is not None]


def drift_chart(
    positions: Sequence[float], axis: str, curves: Sequence[Curve], marks: Sequence[int], title: str, label: str
) -> charts.Chart:
    """
    Return the chart of a value.

    Parameters
    ----------
    positions, axis
        Horizontal position of each value, and the quantity of the positions with its unit.
    curves
        Lines with a value for each position. Thin lines show one standard error to both sides.
    marks
        Indices of the positions with a vertical line.
    title
        Quantity of the values, with its unit.
    label
        Description of the chart for screen readers.

    """
    x = np.array(positions, dtype=np.float64)
    margin = 0.02 * float(np.ptp(x)) or 0.5
    panel = charts.Panel(title, _HEIGHT, [line for curve in curves for line in _lines(x, curve)], ticks=4)
    low, high = panel.full_range
    middle = 0.5 * (low + high)
    if high - low < _LEAST_SPAN * abs(middle):
        flat = [(middle * (1.0 + sign * 0.5 * _LEAST_SPAN), 'transparent') for sign in (-1.0, 1.0)]
        panel = charts.Panel(title, _HEIGHT, panel.curves, ticks=4, levels=flat)
    return charts.Chart(
        [panel],
        (float(x.min()) - margin, float(x.max()) + margin),
        axis,
        label,
        marks=[float(x[mark]) for mark in marks],
        is_wide=False,
        is_plain=True,
    )


def _lines(x: Array, curve: Curve) -> Iterator[charts.Curve]:
    """Yield the lines of a curve: one standard error to both sides, the values, and dots if there are few."""
    colour = _COLOURS[curve.key]
    present = [index for index, value in enumerate(curve.values) if value is not None]
    at, values = x[present], np.array(curve.present_values)
    stds = np.array([curve.stds[index] or 0.0 for index in present])
    if np.any(stds):
        for bound in (values - stds, values + stds):
            yield charts.Curve(at, bound, colour, 0.5)
    name = {'before': 'without effects', 'after': 'with effects'}[curve.key]
    yield charts.Curve(at, values, colour, 1.6, name=name)
    if values.size <= _MOST_DOTS:
        yield charts.Curve(at, values, colour, 4.0, 'dots')
