# SPDX-License-Identifier: Apache-2.0
"""
Figures of the page, as SVG that takes its colours and its fonts from the page around it.

Lengths are CSS pixels: a figure is drawn as large as it is shown on a desk, or in a narrow form on a phone. Long series
are thinned to the lowest and the highest value in each pixel column, so that nothing that can be seen is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import (
    PARTS,
    PLACES,
    SIGNIFICANCE,
    VARIABLES,
    ChannelResult,
    Characteristic,
    Comparison,
    Dependence,
    autocovariance,
    residual_dependences,
)
from cfd_pneumatic.reporting.thinning import thinned
from cfd_pneumatic.svg import Curve, Panel, chart

MEASURED, BEFORE, AFTER, MUTED = (f'var(--{name})' for name in ('measured', 'before', 'after', 'muted'))

WIDE, NARROW, PANEL = 1000, 380, 340
_ZOOM_SHARE = 0.08  # of a recording that a zoom shows
_SHORTEST_ZOOM, _LONGEST_ZOOM = 0.5, 1.5  # [s]
_MOST_DOTS = 800
_HEADROOM = 0.5  # of an axis, for words
_LAGS = 60  # samples
_LAGS_BEFORE = 20  # samples
_LONGEST_MEMORY = 500  # of a series of residuals or inputs [samples]
_MOST_DEPENDENCES = 3
_SIGNAL_UNITS = {
    'position': (1e-3, ' [mm]'),
    'piston speed': (1e-3, ' [mm/s]'),
    'direction': (1.0, ''),
    'pressure': (1e3, ', absolute [kPa]'),
    'contact force': (1.0, ' [N]'),
    'pressure difference': (1e3, ' [kPa]'),
    'set-point': (1e3, ', absolute [kPa]'),
    'valve error': (1e3, ' [kPa]'),
    'time': (1.0, ' [s]'),
}
_LAW_UNITS = {
    'm': (1e-3, 'mm'),
    'm/s': (1e-3, 'mm/s'),
    'Pa': (1.0, 'Pa'),
    'N': (1.0, 'N'),
    'Pa/s': (1e3, 'kPa/s'),
    's': (1.0, 's'),
    '1': (1e-2, '%'),
    '1/s': (1e-2, '%/s'),
}
_BEGINS = 100_000  # of a zoom, that are compared
_TWO_SIDED = float(-ndtri(SIGNIFICANCE / 2.0))


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
    unexplained = result.findings.verdict == 'unexplained'
    depended = residual_dependences(result)[:_MOST_DEPENDENCES] if unexplained else []
    return {
        'law': [] if result.findings.unknown is None else [law_picture(result.findings.unknown)],
        'strips': strips,
        'correlations': correlation_pictures(result),
        'dependences': [_dependence_picture(result, one) for one in depended],
    }


def law_picture(law: Characteristic) -> Picture:
    """Return the curve of a law with its band; grey where no recording has been."""
    (scale, across), (size, up) = _LAW_UNITS[law.unit_against], _LAW_UNITS[law.unit]
    at, seen = law.at / scale, np.flatnonzero(law.visited)
    curves, lines = [Curve(at, law.value / size, MUTED, 0.8)], ((law.low, 0.8), (law.high, 0.8), (law.value, 2.0))
    for run in np.split(seen, 1 + np.flatnonzero(np.diff(seen) > 1)):  # what lies between two of them is not told
        alone = run.size == 1  # a dot
        curves += [Curve(at[run], line[run] / size, AFTER, (1 + 2 * alone) * width, alone) for line, width in lines]
    text = f'The law that was drawn: {law.description}. Thin lines: 95 % at each point; grey: not visited.'
    place, variable = PLACES[law.enters].axis, VARIABLES[law.against].axis

    def drawn(width: int) -> str:
        panel = Panel(f'{place} [{up}]', 200, curves, levels=[(0.0, 'var(--rule)')])
        return chart([panel], width, (float(at[0]), float(at[-1])), f'{variable} [{across}]', text)

    return Picture(drawn(WIDE), drawn(NARROW), text)


def _dependence_picture(result: ChannelResult, found: Dependence) -> Picture:
    """Return the mean of what is left over a signal that it depends on."""
    small, (scale, unit) = result.quantity.small, _SIGNAL_UNITS.get(found.on, (1.0, ''))
    at, mean = found.at / scale, found.mean / small.si
    curves = [Curve(at, mean, AFTER, 1.2), Curve(at, mean, AFTER, 4.0, dots=True)]
    text = f'{found.on} explains {100.0 * found.share:.0f} %: {found.suggestion}'
    panel = Panel(f'residual [{small.unit}]', 160, curves, levels=[(0.0, 'var(--rule)')])
    span = (float(at.min()), float(at.max()))
    return Picture(chart([panel], PANEL, span, f'{found.on}{unit}', f'Mean of the residual. {text}.'), '', text)


def record_picture(result: ChannelResult, comparison: Comparison) -> Picture:
    """Return measured and simulated values and residuals over a whole recording."""
    begin, end = float(comparison.times[0]), float(comparison.times[-1])
    what = _alt(result, f'the whole of {comparison.name}')
    wide, narrow = _strips(result, Window(comparison, begin, end), what)
    return Picture(wide, narrow, f'{comparison.name}, all {end - begin:.4g} s of it.')


def zoom_picture(result: ChannelResult) -> Picture:
    """Return the same of the stretch that tells most."""
    window = telling_window(result)
    where = f'{window.comparison.name}, {round(window.begin, 2) + 0.0:.2f} s to {window.end:.2f} s'
    wide, narrow = _strips(result, window, _alt(result, where))
    return Picture(wide, narrow, f'{where}: {_REASONS[_telling(result)]}.')


def _alt(result: ChannelResult, where: str) -> str:
    small = result.quantity.small.unit
    models = f'without effects (error {result.rms(0):.3g} {small} RMS)'
    if result.added:
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
    if not result.added:
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
        _strip_figure(result, window, WIDE, (61, 166, 133), what),
        _strip_figure(result, window, NARROW, (67, 158, 134), what),
    )


def _strip_figure(
    result: ChannelResult, window: Window, width: int, heights: tuple[float, float, float], what: str
) -> str:
    comparison = window.comparison
    shown = (comparison.times >= window.begin) & (comparison.times <= window.end)
    times = comparison.times[shown]
    few = int(np.count_nonzero(shown)) <= _MOST_DOTS * width / WIDE
    large, small = result.quantity.large, result.quantity.small

    def curve(values: Array, colour: str, line: float) -> Curve:
        return Curve(*thinned(times, values[shown], width), colour, line)

    motion = curve(comparison.inputs['displacement'] * 1e3, MUTED, 1.2)
    series = [(comparison.before, BEFORE)] + ([(comparison.after, AFTER)] if result.added else [])
    simulated = [curve(values / large.si, colour, 1.3 if few else 0.9) for values, colour in series]
    measured = comparison.experiment.measured / large.si
    if few:
        values = [*simulated, Curve(times, measured[shown], MEASURED, 2.6, dots=True)]
    else:
        values = [curve(measured, MEASURED, 1.6), *simulated]
    residuals = [
        curve(comparison.residual(which) / small.si, BEFORE if which == 0 else AFTER, 1.0)
        for which in range(len(series))
    ]
    titles = _titles(result)
    words, marks = _parts(comparison, window, width)
    panels = (
        Panel(titles[0], heights[0], [motion], ticks=3, headroom=_HEADROOM, words=words),
        Panel(titles[1], heights[1], values),
        Panel(titles[2], heights[2], residuals, band=2.0 * result.noise.std / small.si),
    )
    return chart(panels, width, (window.begin, window.end), 'time [s]', what, marks=marks)


def _titles(result: ChannelResult) -> tuple[str, str, str]:
    absolute = ', absolute' if result.quantity.key == 'pa' else ''
    return (
        'displacement that grows the chamber [mm]' if result.quantity.key == 'pa' else 'displacement [mm]',
        f'{result.quantity.name}{absolute} [{result.quantity.large.unit}]',
        f'residual [{result.quantity.small.unit}]',
    )


def _parts(comparison: Comparison, window: Window, width: int) -> tuple[list[tuple[float, str]], list[float]]:
    """Return which stretch of the recording was for learning and which for judging, and where one follows another."""
    words, marks = [], []
    for index, part in enumerate(PARTS):
        mine = np.flatnonzero(comparison.experiment.part == index)
        if mine.size == 0:
            continue
        begin, end = comparison.times[mine[0]], comparison.times[mine[-1]]
        if index and window.begin < begin < window.end:
            marks.append(float(begin))
        seen = max(begin, window.begin), min(end, window.end)
        if seen[1] - seen[0] > (0.04 if width > NARROW else 0.1) * (window.end - window.begin):
            words.append((float(seen[0]), part))
    return words, marks


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
    return [run - np.mean(run) for run in result.tested(which) if run.size > 2]


def _autocorrelation_picture(result: ChannelResult) -> Picture:
    curves = {}
    for which, colour in _sides(result).items():
        runs = _tested(result, which)
        covariance = autocovariance(runs, min(_LAGS, min(run.size for run in runs) - 1))
        limit = _TWO_SIDED / np.sqrt(sum(run.size for run in runs))
        curves[colour] = np.arange(1, covariance.size), covariance[1:] / covariance[0], limit
    text = 'Autocorrelation'
    return Picture(_correlation_figure(text, curves), '', text)


def _fitted_input(result: ChannelResult, name: str) -> list[Array]:
    """Return an input on train and validation without its mean; nothing where the channel has no such input."""
    runs = [one.inputs[name][one.experiment.counts] for one in result.comparisons if name in one.inputs]
    return [run - np.mean(run) for run in runs if run.size > 2]


def _input_picture(result: ChannelResult, name: str, drive: Sequence[Array]) -> Picture:
    curves = {}
    for which, colour in _sides(result).items():
        curves[colour] = crosscorrelation(_tested(result, which), drive, _LAGS_BEFORE, _LAGS)
    text = f'Correlation with the {name}'
    return Picture(_correlation_figure(text, curves), '', text)


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
    limit = _TWO_SIDED * float(np.sqrt(max(spread, 1.0) / count))
    return lags, np.array(products) / max(size, 1e-300), limit


def _sides(result: ChannelResult) -> dict[int, str]:
    """Return which residuals there are to show, and their colours."""
    return {0: BEFORE, 1: AFTER} if result.added else {0: BEFORE}


def _correlation_figure(text: str, curves: Mapping[str, tuple[NDArray[np.intp], Array, float]]) -> str:
    drawn, levels, beyond = [], [(0.0, 'var(--rule)')], []
    for colour, (lags, values, limit) in curves.items():
        drawn += [Curve(lags, values, colour, 1.2), Curve(lags, values, colour, 4.0, dots=True)]
        levels += [(-limit, colour), (limit, colour)]
        name = 'without effects' if colour == BEFORE else 'with effects'
        share = int(np.count_nonzero(np.abs(values) > limit))
        beyond.append(f'{name} {share} of {values.size} lags lie beyond the threshold of {limit:.3f}')
    every = np.concatenate([lags for lags, *_ in curves.values()])
    return chart(
        [Panel('', 160, drawn, levels=levels)],
        PANEL,
        (float(every.min()), float(every.max())),
        'lag [samples]',
        f'{text}, of the residual: {"; ".join(beyond)}.',
        whole=True,
    )
