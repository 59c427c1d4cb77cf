# SPDX-License-Identifier: Apache-2.0
"""Small charts of a value over all bags, as SVG of few bytes, because a page has thousands of charts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

WIDTH, HEIGHT = 600, 120
"""Size of the charts in whole numbers. The page scales the charts."""

_EDGE = 8
_LEAST_SPAN = 0.02  # share of a value; a smaller variation appears as a flat line


@dataclass(frozen=True)
class Curve:
    """
    A line of a chart.

    Attributes
    ----------
    key
        CSS class of the colour: `before` or `after`.
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


def drift_chart(positions: Sequence[float], curves: Sequence[Curve], marks: Sequence[int], label: str) -> str:
    """
    Return a chart as SVG.

    Parameters
    ----------
    positions
        Horizontal position of each value, from 0 (left edge) to 1.
    curves
        Lines with a value for each position. A band shows one standard error to both sides.
    marks
        Indices of the positions with a vertical line.
    label
        Description of the chart for screen readers.

    """
    x = [round(_EDGE + position * (WIDTH - 2 * _EDGE)) for position in positions]
    low, high = _span(curves)

    def y(value: float) -> int:
        return round(HEIGHT - _EDGE - (value - low) / (high - low) * (HEIGHT - 2 * _EDGE))

    bands, lines = [], []
    for curve in curves:
        runs = list(_runs(curve))
        upper = [[(x[index], y(value + std)) for index, value, std in run] for run in runs]
        lower = [[(x[index], y(value - std)) for index, value, std in run] for run in runs]
        bands.append(_path('band', curve.key, [[*above, *below[::-1]] for above, below in zip(upper, lower)]))
        points = [[(x[index], y(value)) for index, value, _ in run] for run in runs]
        lines.append(_path('line', curve.key, [run for run in points if len(run) > 1]))
        lines.append(_path('dot', curve.key, [run for run in points if len(run) == 1]))
    verticals = ''.join(f'M{x[mark]} 0v{HEIGHT}' for mark in marks)
    marked = f'<path class="mark" d="{verticals}"/>' if verticals else ''
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" role="img" aria-label="{escape(label)}">'
        f'{"".join(bands)}{marked}{"".join(lines)}</svg>'
    )


def _span(curves: Sequence[Curve]) -> tuple[float, float]:
    """Return the lowest and the highest value that the chart shows."""
    edges = [
        value + sign * std for curve in curves for run in _runs(curve) for _, value, std in run for sign in (-1.0, 1.0)
    ]
    low, high = min(edges), max(edges)
    middle = (low + high) / 2.0
    half = max((high - low) / 2.0, _LEAST_SPAN / 2.0 * abs(middle)) or 1.0
    return middle - half, middle + half


def _runs(curve: Curve) -> Iterator[list[tuple[int, float, float]]]:
    """Yield runs of consecutive values with their indices and standard errors."""
    run: list[tuple[int, float, float]] = []
    for index, (value, std) in enumerate(zip(curve.values, curve.stds)):
        if value is not None:
            run.append((index, value, std or 0.0))
        elif run:
            yield run
            run = []
    if run:
        yield run


def _path(kind: str, key: str, runs: Sequence[Sequence[tuple[int, int]]]) -> str:
    """Return an SVG path through runs of points, empty without runs. A single point becomes a line of zero length."""
    commands = ''
    for run in runs:
        commands += f'M{run[0][0]} {run[0][1]}'
        if len(run) == 1:
            commands += 'h0'
        for (x, y), (next_x, next_y) in pairwise(run):
            across, down = next_x - x, next_y - y
            commands += f'l{across}{"" if down < 0 else " "}{down}'
    return f'<path class="{kind} {key}" d="{commands}"/>' if commands else ''
