# SPDX-License-Identifier: Apache-2.0
"""
Static pictures of charts, as SVG.

Lengths are CSS pixels. Texts and rules have the colour and the font of the surrounding page; curves have any CSS
colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np

from cfd_pneumatic.charts.chart import Chart, Curve, Panel, Window
from cfd_pneumatic.charts.thinning import thinned

_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 14, 24, 40
_GAP = 34  # between panels, with the title of the lower panel
_TITLE, _NUMBER = 12, 11  # font sizes
_TICK = 4
_LABEL_ROOM = 40  # least room of a label
_APART = 65  # least distance of numbers below an axis
MOST_DOTS = 800
"""Samples in the full width of a page up to which samples are dots and not a line [1]."""

_FULL_WIDTH = 1000
_DOT = 2.6
_MOST_FREE_DOTS = 600  # that are not joined in time
_COLUMN = 2  # width of a column, in which a long curve is thinned to its extremes
_FINE = 10  # resolution of a curve's points in a pixel
_STEPS = (1.0, 2.0, 5.0, 10.0)
_DASHES = {'': '', 'dashed': ' stroke-dasharray="4 3"', 'dotted': ' stroke-dasharray="2 3"'}


def svg(chart: Chart, width: float, window: Window | None = None) -> str:
    """
    Return a chart as an element of a page.

    Parameters
    ----------
    chart
        The chart.
    width
        Width of the picture [CSS px]. Long curves are thinned to columns of two pixels.
    window
        Visible range of the horizontal axis; by default the whole range.

    """
    span = chart.span if window is None else (window.begin, window.end)
    panels = [replace(panel, curves=[_visible(curve, span, width) for curve in panel.curves]) for panel in chart.panels]
    right = width - _RIGHT
    total = _TOP + sum(panel.height for panel in panels) + _GAP * (len(panels) - 1) + _BOTTOM
    x_scale = _Scale(span, (_LEFT, right))
    top, parts = float(_TOP), list[str]()
    for panel in panels:
        bottom = top + panel.height
        y_scale = _Scale(panel.range, (bottom, top))
        parts += (
            [_curve(curve, x_scale, y_scale) for curve in panel.curves]
            if chart.is_plain
            else _panel(panel, x_scale, y_scale)
        )
        marks = [mark for mark in chart.marks if span[0] < mark < span[1]]
        parts += [_line((x_scale(mark), top), (x_scale(mark), bottom), 'dotted', 0.5) for mark in marks]
        top = bottom + _GAP
        if chart.is_plain:
            continue
        ticks = ticks_of(span, max(2, round((right - _LEFT) / _APART)), chart.whole)
        parts += [_line((x_scale(tick), bottom), (x_scale(tick), bottom + _TICK), '', 0.35) for tick, _ in ticks]
        if panel is panels[-1]:
            parts += [_text(x_scale(tick), bottom + 17, number, 'middle') for tick, number in ticks]
    parts += [] if chart.is_plain else [_text(right, total - 6, chart.axis, 'end')]
    label = chart.label if window is None else f'{window.title}, {window.begin:.2f} to {window.end:.2f}. {chart.label}'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {total:g}" role="img" '
        f'aria-label="{escape(label)}" font-family="sans-serif" fill="none" stroke="currentColor">\n'
        + '\n'.join(parts)
        + '\n</svg>'
    )


def _visible(curve: Curve, span: tuple[float, float], width: float) -> Curve:
    """Return the visible part of a curve, thinned to pixel columns if it is long."""
    if curve.style == 'dots':
        every = slice(None, None, max(-(-curve.x.size // _MOST_FREE_DOTS), 1))
        return replace(curve, x=curve.x[every], y=curve.y[every])
    begin, end = np.searchsorted(curve.x, [span[0], np.nextafter(span[1], np.inf)]).tolist()
    if curve.style == 'samples' and end - begin <= MOST_DOTS * width / _FULL_WIDTH:
        return replace(curve, x=curve.x[begin:end], y=curve.y[begin:end], width=_DOT, style='dots')
    x, y = thinned(curve.x[begin:end], curve.y[begin:end], int(width / _COLUMN))
    return replace(curve, x=x, y=y, style='line')


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
    for begin, text in _visible_labels(panel, x_scale):
        yield _text(x_scale(begin) + 4, top + 11, text, 'start')


def _visible_labels(panel: Panel, x_scale: _Scale) -> Iterator[tuple[float, str]]:
    """Yield each label from its visible begin, if there is room up to the next label or the end of the axis."""
    low, high = x_scale.values
    ends = [*(begin for begin, _ in panel.labels[1:]), high]
    for (begin, text), end in zip(panel.labels, ends):
        visible = max(begin, low), min(end, high)
        if x_scale(visible[1]) - x_scale(visible[0]) > _LABEL_ROOM:
            yield visible[0], text


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
    y = np.clip(curve.y, *y_scale.values)  # spikes end at the edge of a robust panel
    points = np.rint(_FINE * np.stack([x_scale(curve.x), y_scale(y)], axis=1)).astype(np.int64)
    if curve.style == 'dots':
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
