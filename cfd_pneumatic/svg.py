# SPDX-License-Identifier: Apache-2.0
"""
Charts as SVG: panels below each other over one axis.

Lengths are CSS pixels. Words and rules take the colour and the font of the page around; curves have any CSS colour.
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
_GAP = 34  # between panels, with the lower one's title
_TITLE, _NUMBER = 12, 11  # sizes of text
_TICK = 4
_APART = 65  # numbers below an axis, at least
_MARGIN = 0.08  # of an axis, above and below its curves
_FINE = 10  # steps of a curve's points in a pixel
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
        Of the line or the dots.
    dots : bool
        Whether the points are not joined.

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
        What is drawn, with its unit.
    height : float
        Of the axes.
    curves : sequence of Curve
        The last is on top.
    ticks : int
        Numbers beside the axis, at most.
    headroom : float
        Room for words above the curves, as a share of their range.
    words : sequence
        Words above the curves, and from where on [unit of x].
    band : float or None
        Half the height of a shaded band about zero.
    levels : sequence
        Horizontal dashed lines: where, and their colour.

    """

    title: str
    height: float
    curves: Sequence[Curve]
    ticks: int = 6
    headroom: float = 0.0
    words: Sequence[tuple[float, str]] = ()
    band: float | None = None
    levels: Sequence[tuple[float, str]] = ()

    @property
    def range(self) -> tuple[float, float]:
        """From where to where its axis goes."""
        drawn = [curve.y for curve in self.curves if curve.y.size]
        drawn += [np.array([level for level, _ in self.levels])] if self.levels else []
        low = min((float(np.min(one)) for one in drawn), default=0.0)
        high = max((float(np.max(one)) for one in drawn), default=0.0)
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
        From top to bottom.
    width
        Of the whole.
    span
        From where to where the common axis goes.
    axis
        What it is, with its unit.
    label
        What the chart shows, for those who don't see it.
    marks
        Where dotted lines go through all panels.
    whole
        Whether the common axis has whole numbers only.

    """
    right = width - _RIGHT
    total = _TOP + sum(panel.height for panel in panels) + _GAP * (len(panels) - 1) + _BOTTOM
    across = _Scale(span, (_LEFT, right))
    top, parts = float(_TOP), list[str]()
    for panel in panels:
        bottom = top + panel.height
        down = _Scale(panel.range, (bottom, top))
        parts += _panel(panel, across, down)
        parts += [_line((across(one), top), (across(one), bottom), 'dotted', 0.5) for one in marks]
        ticks = ticks_of(span, max(2, round((right - _LEFT) / _APART)), whole)
        parts += [_line((across(one), bottom), (across(one), bottom + _TICK), '', 0.35) for one, _ in ticks]
        if panel is panels[-1]:
            parts += [_text(across(one), bottom + 17, number, 'middle') for one, number in ticks]
        top = bottom + _GAP
    parts.append(_text(right, total - 6, axis, 'end'))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {total:g}" role="img" '
        f'aria-label="{escape(label)}" font-family="sans-serif" fill="none" stroke="currentColor">\n'
        + '\n'.join(parts)
        + '\n</svg>'
    )


def ticks_of(span: tuple[float, float], most: int, whole: bool = False) -> list[tuple[float, str]]:
    """Return at most so many round numbers in a range, and how they are written."""
    low, high = span
    least = (high - low) / most
    power = 10.0 ** math.floor(math.log10(least))
    step = next(one * power for one in _STEPS if one * power >= least * (1.0 - 1e-9))
    if whole:
        step = max(1.0, float(math.ceil(step)))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    places = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(place * step, f'{place * step:.{digits}f}'.replace('-', '−')) for place in places]


@dataclass(frozen=True)
class _Scale:
    """From a range of values to one of pixels."""

    values: tuple[float, float]
    pixels: tuple[float, float]

    def __call__(self, value: Any) -> Any:
        (low, high), (begin, end) = self.values, self.pixels
        return begin + (value - low) * ((end - begin) / (high - low or 1.0))


def _panel(panel: Panel, across: _Scale, down: _Scale) -> Iterator[str]:
    left, right = across.pixels
    bottom, top = down.pixels
    yield f'<text x="{left:g}" y="{top - 8:g}" font-size="{_TITLE}" {_INK}>{escape(panel.title)}</text>'
    if panel.band is not None:
        low, high = down(panel.band), down(-panel.band)
        yield (
            f'<rect x="{left:g}" y="{low:.1f}" width="{right - left:g}" height="{high - low:.1f}" '
            'fill="currentColor" fill-opacity=".08" stroke="none"/>'
        )
    for value, number in ticks_of(down.values, panel.ticks):
        yield _line((left - _TICK, down(value)), (left, down(value)), '', 0.35)
        yield _text(left - _TICK - 3, down(value) + 4, number, 'end')
    yield _line((left, top), (left, bottom), '', 0.35)
    yield _line((left, bottom), (right, bottom), '', 0.35)
    for level, colour in panel.levels:
        yield _line((left, down(level)), (right, down(level)), 'dashed', 1.0, colour)
    for curve in panel.curves:
        yield _curve(curve, across, down)
    for begin, word in panel.words:
        yield _text(across(begin) + 4, top + 11, word, 'start')


_INK = 'fill="currentColor" stroke="none"'


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{_NUMBER}" text-anchor="{anchor}" {_INK} fill-opacity=".7">'
        f'{escape(words)}</text>'
    )


def _line(
    begin: tuple[float, float], end: tuple[float, float], dashes: str, opacity: float, colour: str = 'currentColor'
) -> str:
    (x1, y1), (x2, y2) = begin, end
    return (
        f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{colour}" stroke-opacity="{opacity:g}"'
        f'{_DASHES[dashes]}/>'
    )


def _curve(curve: Curve, across: _Scale, down: _Scale) -> str:
    """Return a curve, its points in fractions of a pixel, each from the one before."""
    points = np.rint(_FINE * np.stack([across(curve.x), down(curve.y)], axis=1)).astype(np.int64)
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
