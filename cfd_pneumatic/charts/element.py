# SPDX-License-Identifier: Apache-2.0
"""
Charts as elements of a page: a static picture, and the data from which a script makes a plot with zoom and cursor.

The plots are Bokeh's. Only the scripts in Bokeh's package are used, so that a page is written without its import. Pages
show the static pictures on paper, in browsers without scripts, and if Bokeh is not installed.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Mapping
from functools import cache
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.charts.chart import Chart, Curve, Panel
from cfd_pneumatic.charts.svg import svg
from cfd_pneumatic.charts.thinning import thinned
from cfd_pneumatic.files import marked

WIDE, NARROW, PANEL = 1000, 380, 340
"""Widths of static pictures: as wide as a page, as wide as a phone, and one of several side by side [CSS px]."""

MOST_POINTS = 32_000
"""Points of a curve in the page's data [1], a minute at 500 Hz; longer curves are thinned to minima and maxima."""

SCRIPT_FILE = 'plots.js'
"""Name of the file of scripts that the pages of a plant share."""

_VALUE_STEPS = (1 << 12) - 1  # a twelfth of a pixel in a plot 340 pixels high
_TIME_STEPS = (1 << 24) - 1  # 4 us in a minute
_MARK = '// plots of cfd_pneumatic'
_BOKEH = ('bokeh.min.js', 'bokeh-api.min.js')


def chart_element(chart: Chart, *, has_plot: bool = True) -> str:
    """Return a figure of a page: static pictures, the data of the plot if the page has plots, and the caption."""
    if chart.is_wide:
        pictures = f'<div class="wide">{svg(chart, WIDE)}</div>\n<div class="narrow">{svg(chart, NARROW)}</div>'
    else:
        pictures = svg(chart, PANEL)
    parts = [f'<figure class="chart">\n<div class="static">\n{pictures}\n</div>']
    if has_plot:
        data = json.dumps(_chart_data(chart), separators=(',', ':')).replace('<', '\\u003c')
        parts.append(f'<script type="application/json">{data}</script>')
    if chart.caption:
        parts.append(f'<figcaption>{escape(chart.caption)}</figcaption>')
    parts.append('</figure>')
    return '\n'.join(parts + [_window_element(chart, rank) for rank in range(len(chart.windows))])


def _window_element(chart: Chart, rank: int) -> str:
    """Return a static figure of a window, which is not shown together with plots."""
    window = chart.windows[rank]
    caption = f'{window.begin:.2f} to {window.end:.2f} s: {window.title}.'
    picture = svg(chart, WIDE, window)
    return f'<figure class="window static">\n{picture}\n<figcaption>{escape(caption)}</figcaption>\n</figure>'


def plot_scripts(shared: str = '') -> str:
    """
    Return the elements that load the scripts of the plots; empty if Bokeh is not installed.

    Parameters
    ----------
    shared
        Relative address of a file with `shared_scripts`; empty to put the scripts into the page.

    """
    if not _bokeh_scripts():
        return ''
    return f'<script src="{escape(shared)}"></script>' if shared else f'<script>\n{shared_scripts()}</script>'


@cache
def shared_scripts() -> str:
    """Return the scripts of the plots, for a file that pages share; empty if Bokeh is not installed."""
    if not _bokeh_scripts():
        return ''
    paths = (*_bokeh_scripts(), Path(__file__).parent / SCRIPT_FILE)
    scripts = '\n'.join(path.read_text(encoding='utf-8') for path in paths)
    return f'{_MARK}\n{scripts}'.replace('</script', '<\\/script')


is_script_file = marked(re.escape(_MARK))
"""Recognise a file of scripts that this program wrote."""


@cache
def _bokeh_scripts() -> tuple[Path, ...]:
    """Return the scripts in Bokeh's package; empty if Bokeh is not installed."""
    spec = find_spec('bokeh')
    if spec is None or spec.origin is None:
        return ()
    paths = tuple(Path(spec.origin).parent / 'server' / 'static' / 'js' / name for name in _BOKEH)
    return paths if all(path.is_file() for path in paths) else ()


def _chart_data(chart: Chart) -> dict[str, Any]:
    """Return a chart as JSON types for the script; without empty entries."""
    columns = _Columns()
    data = {
        'axis': chart.axis,
        'span': chart.span,
        'label': chart.label,
        'marks': list(chart.marks),
        'wide': chart.is_wide,
        'clock': chart.clock,
        'windows': [[window.title, window.begin, window.end] for window in chart.windows],
        'panels': [_panel_data(panel, columns) for panel in chart.panels],
        'columns': columns.data,
    }
    return _without_empty(data)


def _panel_data(panel: Panel, columns: _Columns) -> dict[str, Any]:
    full = panel.full_range
    return _without_empty(
        {
            'title': panel.title,
            'height': panel.height,
            'range': panel.range,
            'full': full if full != panel.range else None,
            'headroom': panel.headroom,
            'robust': panel.robust,
            'band': panel.band,
            'levels': list(panel.levels),
            'labels': list(panel.labels),
            'curves': [columns.curve_data(curve) for curve in panel.curves],
        }
    )


def _without_empty(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if value}


class _Columns:
    """Columns of numbers for the script. Curves with the same array share a column."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}
        self._kept: list[NDArray[Any]] = []  # keeps arrays, so that no other array gets the identity of a known array
        self.data: list[dict[str, Any]] = []

    def curve_data(self, curve: Curve) -> dict[str, Any]:
        """Return a curve as JSON types, its points as indices of columns."""
        x, y, times = curve.x, curve.y, curve.times
        if curve.style != 'dots' and x.size > MOST_POINTS:
            x, y = thinned(x, y, MOST_POINTS // 2)
        data = _without_empty({'colour': curve.colour, 'width': curve.width, 'style': curve.style, 'name': curve.name})
        x_steps = _VALUE_STEPS if curve.style == 'dots' else _TIME_STEPS
        indices = {'x': self._index(x, x_steps), 'y': self._index(y, _VALUE_STEPS)}
        return data | indices | ({} if times is None else {'times': self._index(times, _VALUE_STEPS)})

    def _index(self, values: NDArray[Any], steps: int) -> int:
        """Return the index of a column, new if these values have none."""
        if id(values) not in self._known:
            self._kept.append(values)
            self._known[id(values)] = len(self.data)
            self.data.append(column(np.asarray(values, dtype=np.float64), steps))
        return self._known[id(values)]


def column(values: Array, steps: int) -> dict[str, Any]:
    """
    Return finite values as compressed text that the script reads.

    The values are counted in whole steps from the lowest value, each count as the difference from the count before.
    Bytes of equal weight follow each other, because they compress better.

    Parameters
    ----------
    values
        Finite values, shape (n,).
    steps
        Steps between the lowest and the highest value [1].

    """
    low, high = (float(np.min(values)), float(np.max(values))) if values.size else (0.0, 0.0)
    step = float(f'{(high - low) / steps:.9g}') or 1.0
    kind = np.dtype('<u2' if steps < 1 << 16 else '<u4')
    counts = np.rint((values - low) / step).astype(kind)
    differences = np.diff(counts, prepend=kind.type(0)).astype(kind)
    planes = differences.view(np.uint8).reshape(values.size, -1).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode('ascii')
    return {'low': low, 'step': step, 'size': values.size, 'bytes': kind.itemsize, 'text': text}
