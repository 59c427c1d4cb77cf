# SPDX-License-Identifier: Apache-2.0
"""Describe a chart: stacked panels of curves with a common horizontal axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

Style = Literal['line', 'dots', 'samples']
"""Form of a curve; `samples` are dots if few of them are visible, otherwise a line."""

_MARGIN = 0.08  # share of the curves' range, above and below the curves
_OUTER_QUANTILE = 0.005  # share of the samples beyond either end of the usual range
_ROBUST_MARGIN = 0.35  # share of the usual range, above and below the usual range
_LEAST_SPIKE = 2.5  # full range over robust range, from which spikes are cut off


@dataclass(frozen=True)
class Curve:
    """
    A line through points, or dots.

    Attributes
    ----------
    x, y : (n,) array
        Points, in the units of the axes; x increases if the style is not `dots`.
    colour : str
        CSS colour.
    width : float
        Width of the line or the dots [CSS px].
    style : Style
        Form of the curve.
    name : str
        Name for the reader of values under the cursor; empty for a curve without a reading.
    times : (n,) array or None
        Times of dots [s]: only the dots of the visible time range appear.

    """

    x: NDArray[Any]
    y: Array
    colour: str
    width: float = 1.1
    style: Style = 'line'
    name: str = ''
    times: Array | None = None


@dataclass(frozen=True)
class Panel:
    """
    Curves on one pair of axes.

    Attributes
    ----------
    title : str
        Quantity of the curves, with its unit.
    height : float
        Height of the axes [CSS px].
    curves : sequence of Curve
        Curves; the last curve is on top.
    ticks : int
        Largest number of ticks of the axis.
    headroom : float
        Space for texts above the curves, as a share of their range.
    labels : sequence
        Positions [unit of x] and texts above the curves.
    band : float or None
        Half the height of a shaded band about zero.
    levels : sequence
        Heights and colours of horizontal dashed lines.
    robust : bool
        Whether spikes are cut off, so that they do not hide the remaining curve.

    """

    title: str
    height: float
    curves: Sequence[Curve]
    ticks: int = 6
    headroom: float = 0.0
    labels: Sequence[tuple[float, str]] = ()
    band: float | None = None
    levels: Sequence[tuple[float, str]] = ()
    robust: bool = False

    @property
    def full_range(self) -> tuple[float, float]:
        """Lowest and highest value of the axis if it shows every point."""
        heights = [curve.y for curve in self.curves if curve.y.size]
        low, high = self._with_references(
            min((float(np.min(values)) for values in heights), default=np.inf),
            max((float(np.max(values)) for values in heights), default=-np.inf),
        )
        span = high - low or abs(high) or 1.0
        return low - _MARGIN * span, high + (_MARGIN + self.headroom) * span

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value of the axis: without spikes if the panel is robust."""
        full = self.full_range
        heights = [curve.y for curve in self.curves if curve.y.size]
        if not self.robust or not heights:
            return full
        ends = [np.quantile(values, [_OUTER_QUANTILE, 1.0 - _OUTER_QUANTILE]) for values in heights]
        low, high = float(min(low for low, _ in ends)), float(max(high for _, high in ends))
        margin = _ROBUST_MARGIN * (high - low)
        low, high = self._with_references(low - margin, high + margin)
        return (low, high) if 0.0 < _LEAST_SPIKE * (high - low) < full[1] - full[0] else full

    def _with_references(self, low: float, high: float) -> tuple[float, float]:
        """Return a range that is extended to the band and the levels; 0 to 0 for an empty panel."""
        references = [level for level, _ in self.levels] + ([-self.band, self.band] if self.band is not None else [])
        low, high = min([low, *references]), max([high, *references])
        return (low, high) if low <= high else (0.0, 0.0)


@dataclass(frozen=True)
class Window:
    """A range of the horizontal axis that deserves a closer look: its title, begin and end [unit of x]."""

    title: str
    begin: float
    end: float


@dataclass(frozen=True)
class Chart:
    """
    Stacked panels with a common horizontal axis.

    Attributes
    ----------
    panels : sequence of Panel
        Panels from top to bottom.
    span : (float, float)
        Lowest and highest value of the common axis.
    axis : str
        Quantity of the common axis, with its unit.
    label : str
        Content of the chart, for screen readers.
    caption : str
        Description below the chart.
    marks : sequence of float
        Positions of vertical dotted lines through all panels.
    whole : bool
        Whether the common axis has whole numbers only.
    is_wide : bool
        Whether the chart is as wide as the page; otherwise several charts are side by side.
    is_plain : bool
        Whether the static picture has no numbers, on pages with thousands of charts.
    windows : sequence of Window
        Ranges that the static picture shows in addition, and that a button of the plot shows.
    clock : str
        Charts of the same clock share their cursor and their zoom; dots with times follow it. Empty for none.

    """

    panels: Sequence[Panel]
    span: tuple[float, float]
    axis: str
    label: str
    caption: str = ''
    marks: Sequence[float] = ()
    whole: bool = False
    is_wide: bool = True
    is_plain: bool = False
    windows: Sequence[Window] = ()
    clock: str = ''
