"""
Figures of the page, as SVG that takes its colours and its fonts from the page around it.

Lengths are CSS pixels: a figure is drawn as large as it is shown on a desk, or in a narrow form on a phone. Long series
are thinned to the lowest and the highest value in each pixel column, so that nothing that can be seen is lost.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.stats import norm

from cfd_pneumatic.identification import ChannelResult
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.residual.autoregression import autocovariance
from cfd_pneumatic.identification.residual.tests import SIGNIFICANCE
from cfd_pneumatic.identification.result import Comparison
from cfd_pneumatic.reporting.thinning import thinned

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER, INK, MUTED, RULE, SHADE, PLANE = (f'#00000{digit}' for digit in range(1, 9))
_ON_PAGE = dict(
    zip(
        (MEASURED, BEFORE, AFTER, INK, MUTED, RULE, SHADE, PLANE),
        ('measured', 'before', 'after', 'ink', 'muted', 'rule', 'shade', 'plane'),
    )
)
"""Stand-ins for the page's colours, by the names of its CSS variables."""

WIDE, NARROW, PANEL = 1000, 380, 340
_TEXT = 12
_ZOOM_SHARE = 0.08  # of a recording that a zoom shows
_SHORTEST_ZOOM, _LONGEST_ZOOM = 0.5, 1.5  # [s]
_MOST_DOTS = 800
_HEADROOM = 0.5  # of an axis, for words
_LAGS = 60  # samples
_LAGS_BEFORE = 20  # samples
_LONGEST_MEMORY = 500  # of a series of residuals or inputs [samples]
_BEGINS = 100_000  # of a zoom, that are compared
_POINTS_PER_INCH = 72.0
_LONG_PATH = 500  # characters


@dataclass(frozen=True)
class Picture:
    """
    One figure.

    Attributes
    ----------
    wide, narrow
        SVG for a desk and for a phone; `narrow` is empty where the wide one is small enough.
    caption
        What it shows.

    """

    wide: str
    narrow: str
    caption: str


@dataclass(frozen=True)
class Window:
    """A stretch of one recording [s]."""

    comparison: Comparison
    begin: float
    end: float


def pictures(result: ChannelResult, drawn: Sequence[Comparison]) -> dict[str, list[Picture]]:
    """Return the figures of a channel by their place on the page; whole recordings are shown of those `drawn`."""
    strips = [zoom_picture(result), *(record_picture(result, one) for one in drawn)]
    return {'strips': strips, 'correlations': correlation_pictures(result)}


def record_picture(result: ChannelResult, comparison: Comparison) -> Picture:
    """Return measured and simulated values and residuals over a whole recording."""
    begin, end = float(comparison.times[0]), float(comparison.times[-1])
    what = _alt(result, f'the whole of {comparison.name}')
    wide, narrow = _strips(result, Window(comparison, begin, end), what)
    return Picture(wide, narrow, f'{comparison.name}, all {end - begin:.4g} s of it.')


def zoom_picture(result: ChannelResult) -> Picture:
    """Return the same of the stretch that tells most."""
    window = telling_window(result)
    where = f'{window.comparison.name}, {window.begin:.2f} s to {window.end:.2f} s'
    wide, narrow = _strips(result, window, _alt(result, where))
    return Picture(wide, narrow, f'{where}: {_REASONS[_telling(result)]}.')


def _alt(result: ChannelResult, where: str) -> str:
    small = result.quantity.small.unit
    models = f'without effects (error {result.rms(0):.3g} {small} RMS)'
    if result.findings.effects:
        models += f' and with them ({result.rms(1):.3g} {small} RMS)'
    return (
        f'Three strips over time, {where}: displacement of the piston; measured {result.quantity.name} and the one '
        f'simulated {models}; the residuals, measured less simulated.'
    )


_REASONS = {
    'taken': 'where the effects matter most',
    'left': 'where most is left unexplained',
    'residual': 'where the residual is largest',
}


def _telling(result: ChannelResult) -> str:
    """Return what of a residual tells most: what effects take of it, what they leave, or all of it."""
    if not result.findings.effects:
        return 'residual'
    return 'left' if result.findings.verdict == 'unexplained' else 'taken'


def telling_window(result: ChannelResult) -> Window:
    """Return the stretch in which there is most of what tells most."""
    telling = _telling(result)
    best: tuple[float, Window] | None = None
    for comparison in result.comparisons:
        power = comparison.residual(1 if telling == 'left' else 0) ** 2
        if telling == 'taken':
            power -= comparison.residual(1) ** 2
        times = comparison.times
        duration = float(np.ptp(times))
        length = min(max(_ZOOM_SHARE * duration, _SHORTEST_ZOOM), _LONGEST_ZOOM, duration)
        edges = np.linspace(0, times.size, min(times.size, _BEGINS), endpoint=False).astype(np.intp)
        total = np.concatenate([[0.0], np.cumsum(np.add.reduceat(power, edges))])
        begins = times[edges]
        gains = total[np.searchsorted(begins, begins + length, side='right')] - total[:-1]
        gains[begins > times[-1] - length] = -np.inf
        first = int(np.argmax(gains))
        begin = float(begins[first])
        if best is None or gains[first] > best[0]:
            best = float(gains[first]), Window(comparison, begin, begin + length)
    assert best is not None
    return best[1]


def _strips(result: ChannelResult, window: Window, what: str) -> tuple[str, str]:
    return (
        _strip_figure(result, window, WIDE, (0.55, 1.5, 1.2), 470, what),
        _strip_figure(result, window, NARROW, (0.55, 1.3, 1.1), 480, what),
    )


def _strip_figure(
    result: ChannelResult, window: Window, width: int, heights: Sequence[float], height: int, what: str
) -> str:
    figure = _figure(width, height)
    axes = figure.subplots(3, 1, sharex=True, gridspec_kw={'height_ratios': list(heights)})
    comparison = window.comparison
    shown = (comparison.times >= window.begin) & (comparison.times <= window.end)
    times = comparison.times[shown]
    few = int(np.count_nonzero(shown)) <= _MOST_DOTS * width / WIDE

    def curve(axis: Axes, values: Array, colour: str, **style: Any) -> None:
        axis.plot(*thinned(times, values[shown], width), color=colour, **{'linewidth': 1.1, **style})

    motion, value, residual = axes
    curve(motion, comparison.inputs['displacement'] * 1e3, MUTED, linewidth=1.2)
    large, small = result.quantity.large, result.quantity.small
    series = [(comparison.before, BEFORE)] + ([(comparison.after, AFTER)] if result.findings.effects else [])
    if few:
        dots = {'linestyle': 'none', 'marker': '.', 'markersize': 2.6, 'markeredgewidth': 0.0}
        value.plot(times, comparison.experiment.measured[shown] / large.si, color=MEASURED, zorder=3.0, **dots)
    else:
        curve(value, comparison.experiment.measured / large.si, MEASURED, linewidth=1.6)
    for which, (simulated, colour) in enumerate(series):
        curve(value, simulated / large.si, colour, linewidth=1.3 if few else 0.9)
        curve(residual, comparison.residual(which) / small.si, colour, linewidth=1.0)
    band = 2.0 * result.noise.std / small.si
    residual.axhspan(-band, band, facecolor=SHADE, edgecolor='none', zorder=0.5)
    _titles(axes, result)
    _mark_parts(motion, comparison, window, width)
    value.set_xlim(window.begin, window.end)
    residual.set_xlabel('time [s]', loc='right')
    return _svg(figure, what, f'{result.name} {window.begin} {window.end} {width} {comparison.recording}')


def _titles(axes: Sequence[Axes], result: ChannelResult) -> None:
    large, small = result.quantity.large.unit, result.quantity.small.unit
    absolute = ', absolute' if result.quantity.key == 'pa' else ''
    names = (
        'displacement that grows the chamber [mm]' if result.quantity.key == 'pa' else 'displacement [mm]',
        f'{result.quantity.name}{absolute} [{large}]',
        f'residual [{small}]',
    )
    for axis, name in zip(axes, names):
        axis.set_title(name, loc='left', fontsize=_TEXT, color=INK, pad=5)
        axis.yaxis.set_major_locator(MaxNLocator(4 if axis is not axes[0] else 2))


def _mark_parts(axis: Axes, comparison: Comparison, window: Window, width: int) -> None:
    """Say above the curve which stretch of the recording was for learning and which for judging."""
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + _HEADROOM * (high - low))
    for index, part in enumerate(PARTS):
        mine = np.flatnonzero(comparison.experiment.part == index)
        if mine.size == 0:
            continue
        begin, end = comparison.times[mine[0]], comparison.times[mine[-1]]
        if index and window.begin < begin < window.end:
            for one in axis.figure.axes:
                one.axvline(begin, color=MUTED, linewidth=0.8, linestyle=(0, (2, 3)), zorder=0.6)
        visible = (max(begin, window.begin), min(end, window.end))
        if visible[1] - visible[0] > (0.04 if width > NARROW else 0.1) * (window.end - window.begin):
            axis.annotate(
                part,
                (visible[0], 1.0),
                xycoords=('data', 'axes fraction'),
                xytext=(4, -3),
                textcoords='offset points',
                va='top',
                fontsize=_TEXT - 2,
                color=MUTED,
            )


def correlation_pictures(result: ChannelResult) -> list[Picture]:
    """Return the residual's autocorrelation and its correlations with the inputs that change."""
    pictures = [_autocorrelation_picture(result)]
    for name in ('piston speed', 'set-point', 'pressure difference'):
        drive = _fitted_input(result, name)
        if any(np.ptp(run) > 0.0 for run in drive):
            pictures.append(_input_picture(result, name, drive))
    return pictures


def _tested(result: ChannelResult, which: int) -> list[Array]:
    """Return the residuals as they are tested: weighted, on train and validation, without their mean."""
    runs = [one.tested(which) for one in result.comparisons]
    return [run - np.mean(run) for run in runs if run.size > 2]


def _autocorrelation_picture(result: ChannelResult) -> Picture:
    curves = {}
    for which, colour in _sides(result).items():
        runs = _tested(result, which)
        covariance = autocovariance(runs, min(_LAGS, min(run.size for run in runs) - 1))
        limit = float(norm.isf(SIGNIFICANCE / 2.0)) / np.sqrt(sum(run.size for run in runs))
        curves[colour] = np.arange(1, covariance.size), covariance[1:] / covariance[0], limit
    text = 'Autocorrelation'
    return Picture(_correlation_figure(result, text, curves), '', text)


def _fitted_input(result: ChannelResult, name: str) -> list[Array]:
    """Return an input on train and validation without its mean; nothing where the channel has no such input."""
    runs = [one.inputs[name][one.experiment.fitted] for one in result.comparisons if name in one.inputs]
    return [run - np.mean(run) for run in runs if run.size > 2]


def _input_picture(result: ChannelResult, name: str, drive: Sequence[Array]) -> Picture:
    curves = {}
    for which, colour in _sides(result).items():
        curves[colour] = crosscorrelation(_tested(result, which), drive, _LAGS_BEFORE, _LAGS)
    text = f'Correlation with the {name}'
    return Picture(_correlation_figure(result, text, curves), '', text)


def crosscorrelation(
    residuals: Sequence[Array], inputs: Sequence[Array], before: int, after: int
) -> tuple[NDArray[np.intp], Array, float]:
    """
    Return lags [samples], correlations of residuals with an input so much earlier, and their threshold [-].

    The threshold is Bartlett's, for two independent series each with a memory of its own.
    """
    shortest = min(one.size for one in residuals)
    lags = np.arange(-min(before, shortest - 1), min(after, shortest - 1) + 1)
    count = sum(one.size for one in residuals)
    size = np.sqrt(sum(float(one @ one) for one in residuals) * sum(float(one @ one) for one in inputs))
    products = [
        sum(
            float(residual[max(lag, 0) : residual.size + min(lag, 0)] @ drive[max(-lag, 0) : drive.size - max(lag, 0)])
            for residual, drive in zip(residuals, inputs)
        )
        for lag in lags.tolist()
    ]
    memory = min(shortest - 1, max(_LAGS, min(int(np.sqrt(count)), _LONGEST_MEMORY)))
    own, other = (autocovariance(series, memory) for series in (residuals, inputs))
    spread = 1.0 + 2.0 * float(own[1:] @ other[1:]) / max(float(own[0] * other[0]), 1e-300)
    limit = float(norm.isf(SIGNIFICANCE / 2.0)) * float(np.sqrt(max(spread, 1.0) / count))
    return lags, np.array(products) / max(size, 1e-300), limit


def _sides(result: ChannelResult) -> dict[int, str]:
    """Return which residuals there are to show, and their colours."""
    return {0: BEFORE, 1: AFTER} if result.findings.effects else {0: BEFORE}


def _correlation_figure(
    result: ChannelResult, text: str, curves: Mapping[str, tuple[NDArray[np.intp], Array, float]]
) -> str:
    figure = _figure(PANEL, 215)
    axis = figure.subplots()
    axis.axhline(0.0, color=RULE, linewidth=1.0, zorder=0.6)
    beyond = []
    for colour, (lags, values, limit) in curves.items():
        axis.plot(lags, values, color=colour, linewidth=1.2, marker='.', markersize=4.0, markeredgewidth=0.0)
        for side in (-limit, limit):
            axis.axhline(side, color=colour, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0.7)
        name = 'without effects' if colour == BEFORE else 'with effects'
        share = int(np.count_nonzero(np.abs(values) > limit))
        beyond.append(f'{name} {share} of {values.size} lags lie beyond the threshold of {limit:.3f}')
    lowest = min(min(float(np.min(values)), -1.4 * limit) for _, values, limit in curves.values())
    highest = max(max(float(np.max(values)), 1.4 * limit) for _, values, limit in curves.values())
    axis.set_ylim(lowest - 0.06 * (highest - lowest), highest + 0.06 * (highest - lowest))
    axis.yaxis.set_major_locator(MaxNLocator(5))
    axis.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axis.set_xlabel('lag [samples]', loc='right')
    return _svg(figure, f'{text}, of the residual: {"; ".join(beyond)}.', f'{result.name} {text}')


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width / _POINTS_PER_INCH, height / _POINTS_PER_INCH), layout='constrained')


_STYLE: dict[str, Any] = {
    'svg.fonttype': 'none',  # the page's fonts, and text that can be searched
    'font.family': 'DejaVu Sans',
    'font.size': _TEXT,
    'axes.edgecolor': RULE,
    'axes.facecolor': 'none',
    'figure.facecolor': 'none',
    'axes.labelcolor': MUTED,
    'axes.labelsize': _TEXT - 1,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.xmargin': 0.0,
    'axes.ymargin': 0.08,
    'axes.unicode_minus': True,
    'axes.formatter.useoffset': False,
    'xtick.color': RULE,
    'ytick.color': RULE,
    'xtick.labelcolor': MUTED,
    'ytick.labelcolor': MUTED,
    'xtick.labelsize': _TEXT - 1,
    'ytick.labelsize': _TEXT - 1,
    'path.simplify': True,
    'lines.solid_joinstyle': 'round',
}


def style() -> AbstractContextManager[None]:
    """Return the context in which figures are drawn."""
    context: AbstractContextManager[None] = matplotlib.rc_context(_STYLE)
    return context


def _svg(figure: Figure, what: str, salt: str) -> str:
    """Return a figure as an element of the page that says what it shows."""
    stream = io.StringIO()
    with matplotlib.rc_context({'svg.hashsalt': salt}):
        FigureCanvasSVG(figure).print_svg(stream, metadata={'Date': None, 'Creator': None})
    return _at_home(stream.getvalue(), what)


def _at_home(svg: str, what: str) -> str:
    """Return Matplotlib's SVG with the page's colours and fonts, small, and without what a page may hold only once."""
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    svg = re.sub(r' id="[\w.]+_\d+"', '', svg)
    size = re.search(r'viewBox="([^"]*)"', svg)
    assert size is not None
    opening = f'<svg viewBox="{size[1]}" role="img" aria-label="{escape(what)}">'
    svg = opening + svg[svg.index('>') + 1 :]
    svg = re.sub(r'font(-family)?: ?([\d.]+px )?[^;\"]*DejaVu Sans[^;\"]*', lambda found: _font(found[2]), svg)
    for colour, name in _ON_PAGE.items():
        svg = svg.replace(colour, f'var(--{name})')
    svg = re.sub(r'(?<= d=")[^"]*', _shorter, svg)
    return re.sub(r'\s*\n\s*', '\n', svg)


def _shorter(path: re.Match[str]) -> str:
    """Return the outline of a curve in tenths of a pixel, that of a marker in hundredths."""
    digits = 1 if len(path[0]) > _LONG_PATH else 2
    return re.sub(rf'(\.\d{{{digits}}})\d+', r'\1', path[0])


def _font(size: str | None) -> str:
    return f'font-size: {size.strip()}' if size else ''
