# SPDX-License-Identifier: Apache-2.0
"""
Charts as SVG: stacked panels with a common axis.

Lengths are CSS pixels. Texts and rules have the colour and the font of the surrounding page; curves have any CSS
colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array

_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 14, 24, 40
_GAP = 34  # between panels, with the title of the lower panel
_TITLE, _NUMBER = 12, 11  # font sizes
_TICK = 4
_APART = 65  # least distance of numbers below an axis
_MARGIN = 0.08  # share of the curves' range, above and below the curves
_FINE = 10  # resolution of a curve's points in a pixel
_STEPS = (1.0, 2.0, 5.0, 10.0)
_DASHES = {'': '', 'dashed': ' stroke-dasharray="4 3"', 'dotted': ' stroke-dasharray="2 3"'}


@dataclass(frozen=True)
class Curve:
    """
    A line through points, or dots.

    Attributes
    ----------
    x, y : (n,) array
        Points, in the units of the axes.
    colour : str
        CSS colour.
    width : float
        Width of the line or the dots.
    dots : bool
        Whether the points are dots and not joined.

    """

    x: NDArray[Any]
    y: Array
    colour: str
    width: float = 1.1
    dots: bool = False


@dataclass(frozen=True)
class Panel:
    """
    Curves on one pair of axes.

    Attributes
    ----------
    title : str
        Quantity of the curves, with its unit.
    height : float
        Height of the axes.
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

    """

    title: str
    height: float
    curves: Sequence[Curve]
    ticks: int = 6
    headroom: float = 0.0
    labels: Sequence[tuple[float, str]] = ()
    band: float | None = None
    levels: Sequence[tuple[float, str]] = ()

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value of the axis."""
        heights = [curve.y for curve in self.curves if curve.y.size]
        heights += [np.array([level for level, _ in self.levels])] if self.levels else []
        low = min((float(np.min(values)) for values in heights), default=0.0)
        high = max((float(np.max(values)) for values in heights), default=0.0)
        if self.band is not None:
            low, high = min(low, -self.band), max(high, self.band)
        span = high - low or abs(high) or 1.0
        return low - _MARGIN * span, high + (_MARGIN + self.headroom) * span


def chart(
    panels: Sequence[Panel],
    width: float,
    span: tuple[float, float],
    axis: str,
    label: str,
    *,
    marks: Sequence[float] = (),
    whole: bool = False,
) -> str:
    """
    Return a chart as an element of a page.

    Parameters
    ----------
    panels
        Panels from top to bottom.
    width
        Width of the chart.
    span
        Lowest and highest value of the common axis.
    axis
        Quantity of the common axis, with its unit.
    label
        Content of the chart, for screen readers.
    marks
        Positions of vertical dotted lines through all panels.
    whole
        Whether the common axis has whole numbers only.

    """
    right = width - _RIGHT
    total = _TOP + sum(panel.height for panel in panels) + _GAP * (len(panels) - 1) + _BOTTOM
    x_scale = _Scale(span, (_LEFT, right))
    top, parts = float(_TOP), list[str]()
    for panel in panels:
        bottom = top + panel.height
        y_scale = _Scale(panel.range, (bottom, top))
        parts += _panel(panel, x_scale, y_scale)
        parts += [_line((x_scale(mark), top), (x_scale(mark), bottom), 'dotted', 0.5) for mark in marks]
        ticks = ticks_of(span, max(2, round((right - _LEFT) / _APART)), whole)
        parts += [_line((x_scale(tick), bottom), (x_scale(tick), bottom + _TICK), '', 0.35) for tick, _ in ticks]
        if panel is panels[-1]:
            parts += [_text(x_scale(tick), bottom + 17, number, 'middle') for tick, number in ticks]
        top = bottom + _GAP
    parts.append(_text(right, total - 6, axis, 'end'))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {total:g}" role="img" '
        f'aria-label="{escape(label)}" font-family="sans-serif" fill="none" stroke="currentColor">\n'
        + '\n'.join(parts)
        + '\n</svg>'
    )


def ticks_of(span: tuple[float, float], most: int, whole: bool = False) -> list[tuple[float, str]]:
    """Return at most `most` round numbers in a range, with their texts."""
    low, high = span
    least = (high - low) / most
    power = 10.0 ** math.floor(math.log10(least))
    step = next(digit * power for digit in _STEPS if digit * power >= least * (1.0 - 1e-9))
    if whole:
        step = max(1.0, float(math.ceil(step)))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    places = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(place * step, f'{place * step:.{digits}f}'.replace('-', '−')) for place in places]


@dataclass(frozen=True)
class _Scale:
    """Linear map from a range of values to a range of pixels."""

    values: tuple[float, float]
    pixels: tuple[float, float]

    def __call__(self, value: Any) -> Any:
        (low, high), (begin, end) = self.values, self.pixels
        return begin + (value - low) * ((end - begin) / (high - low or 1.0))


def _panel(panel: Panel, x_scale: _Scale, y_scale: _Scale) -> Iterator[str]:
    left_edge, right_edge = x_scale.pixels
    bottom, top = y_scale.pixels
    yield f'<text x="{left_edge:g}" y="{top - 8:g}" font-size="{_TITLE}" {_INK}>{escape(panel.title)}</text>'
    if panel.band is not None:
        low, high = y_scale(panel.band), y_scale(-panel.band)
        yield (
            f'<rect x="{left_edge:g}" y="{low:.1f}" width="{right_edge - left_edge:g}" height="{high - low:.1f}" '
            'fill="currentColor" fill-opacity=".08" stroke="none"/>'
        )
    for value, number in ticks_of(y_scale.values, panel.ticks):
        yield _line((left_edge - _TICK, y_scale(value)), (left_edge, y_scale(value)), '', 0.35)
        yield _text(left_edge - _TICK - 3, y_scale(value) + 4, number, 'end')
    yield _line((left_edge, top), (left_edge, bottom), '', 0.35)
    yield _line((left_edge, bottom), (right_edge, bottom), '', 0.35)
    for level, colour in panel.levels:
        yield _line((left_edge, y_scale(level)), (right_edge, y_scale(level)), 'dashed', 1.0, colour)
    for curve in panel.curves:
        yield _curve(curve, x_scale, y_scale)
    for begin, text in panel.labels:
        yield _text(x_scale(begin) + 4, top + 11, text, 'start')


_INK = 'fill="currentColor" stroke="none"'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{_NUMBER}" text-anchor="{anchor}" {_INK} fill-opacity=".7">'
        f'{escape(text)}</text>'
    )


def _line(
    begin: tuple[float, float], end: tuple[float, float], dashes: str, opacity: float, colour: str = 'currentColor'
) -> str:
    (x1, y1), (x2, y2) = begin, end
    return (
        f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{colour}" stroke-opacity="{opacity:g}"'
        f'{_DASHES[dashes]}/>'
    )


def _curve(curve: Curve, x_scale: _Scale, y_scale: _Scale) -> str:
    """Return a curve as a path of steps in fractions of a pixel."""
    points = np.rint(_FINE * np.stack([x_scale(curve.x), y_scale(curve.y)], axis=1)).astype(np.int64)
    if curve.dots:
        path = ''.join(f'M{x} {y}h0' for x, y in points.tolist())
    elif len(points):
        (x, y), moves = points[0].tolist(), np.diff(points, axis=0)
        path = f'M{x} {y}l{" ".join(map(str, moves.ravel().tolist()))}'
    else:
        path = ''
    return (
        f'<path d="{path}" stroke="{curve.colour}" stroke-width="{curve.width:g}" stroke-linejoin="round" '
        f'stroke-linecap="round" transform="scale({1 / _FINE:g})" vector-effect="non-scaling-stroke"/>'
    )
