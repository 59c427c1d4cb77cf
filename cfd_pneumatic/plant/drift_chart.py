# SPDX-License-Identifier: Apache-2.0
"""Small charts of a value's drift, as SVG of few bytes: a page has thousands of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

WIDTH, HEIGHT = 600, 120
"""Size that charts are drawn in, in whole numbers; the page scales them."""

_EDGE = 8
_LEAST_SPAN = 0.02  # of a value: what varies by less is drawn flat


@dataclass(frozen=True)
class Curve:
    """
    A line of a chart.

    Attributes
    ----------
    key
        Class of its colour: `before` or `after`.
    values, stds
        Values and standard errors; None where there is none.

    """

    key: str
    values: Sequence[float | None]
    stds: Sequence[float | None]

    @property
    def told(self) -> list[float]:
        """The values that there are."""
        return [value for value in self.values if value is not None]


def drift_chart(places: Sequence[float], tracks: Sequence[Curve], marks: Sequence[int], label: str) -> str:
    """
    Return a chart as SVG.

    Parameters
    ----------
    places
        Where the values stand from left to right, 0 to 1.
    tracks
        Lines, each with a value for each place and a band of one standard error to both sides.
    marks
        Indices of the places that are marked by a vertical line.
    label
        What it shows, for those who don't see it.

    """
    x = [round(_EDGE + place * (WIDTH - 2 * _EDGE)) for place in places]
    low, high = _span(tracks)

    def y(value: float) -> int:
        return round(HEIGHT - _EDGE - (value - low) / (high - low) * (HEIGHT - 2 * _EDGE))

    bands, lines = [], []
    for track in tracks:
        runs = list(_runs(track))
        upper = [[(x[at], y(value + std)) for at, value, std in run] for run in runs]
        lower = [[(x[at], y(value - std)) for at, value, std in run] for run in runs]
        bands.append(_path('band', track.key, [[*above, *below[::-1]] for above, below in zip(upper, lower)]))
        points = [[(x[at], y(value)) for at, value, _ in run] for run in runs]
        lines.append(_path('line', track.key, [run for run in points if len(run) > 1]))
        lines.append(_path('dot', track.key, [run for run in points if len(run) == 1]))
    upright = ''.join(f'M{x[mark]} 0v{HEIGHT}' for mark in marks)
    marked = f'<path class="mark" d="{upright}"/>' if upright else ''
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" role="img" aria-label="{escape(label)}">'
        f'{"".join(bands)}{marked}{"".join(lines)}</svg>'
    )


def _span(tracks: Sequence[Curve]) -> tuple[float, float]:
    """Return the lowest and the highest value that the chart shows."""
    edges = [
        value + sign * std for track in tracks for run in _runs(track) for _, value, std in run for sign in (-1.0, 1.0)
    ]
    low, high = min(edges), max(edges)
    middle = (low + high) / 2.0
    half = max((high - low) / 2.0, _LEAST_SPAN / 2.0 * abs(middle)) or 1.0
    return middle - half, middle + half


def _runs(track: Curve) -> Iterator[list[tuple[int, float, float]]]:
    """Yield runs of neighbouring values with their indices and standard errors."""
    run: list[tuple[int, float, float]] = []
    for at, (value, std) in enumerate(zip(track.values, track.stds)):
        if value is not None:
            run.append((at, value, std or 0.0))
        elif run:
            yield run
            run = []
    if run:
        yield run


def _path(kind: str, key: str, runs: Sequence[Sequence[tuple[int, int]]]) -> str:
    """Return a path through runs of points; a point alone is a line of no length. None without runs."""
    data = ''
    for run in runs:
        data += f'M{run[0][0]} {run[0][1]}'
        if len(run) == 1:
            data += 'h0'
        for (x, y), (next_x, next_y) in pairwise(run):
            across, down = next_x - x, next_y - y
            data += f'l{across}{"" if down < 0 else " "}{down}'
    return f'<path class="{kind} {key}" d="{data}"/>' if data else ''
