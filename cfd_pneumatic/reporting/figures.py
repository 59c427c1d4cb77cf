# SPDX-License-Identifier: Apache-2.0
"""
Figures of the report page, as SVG that uses the colours and fonts of the page.

Lengths are CSS pixels. A figure has the size at which a desktop shows it; some have a narrow form for phones. Long
series are thinned to the lowest and the highest value in each pixel column, which loses no visible detail.
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
_ZOOM_SHARE = 0.08  # share of a recording that the zoom shows
_SHORTEST_ZOOM, _LONGEST_ZOOM = 0.5, 1.5  # [s]
_MOST_DOTS = 800
_HEADROOM = 0.5  # share of an axis that is kept free for labels
_LAGS = 60  # samples
_LAGS_BEFORE = 20  # samples
_LONGEST_CORRELATION = 500  # largest lag of the autocorrelation of residuals and inputs [samples]
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
_CURVE_UNITS = {
    'm': (1e-3, 'mm'),
    'm/s': (1e-3, 'mm/s'),
    'Pa': (1.0, 'Pa'),
    'N': (1.0, 'N'),
    'Pa/s': (1e3, 'kPa/s'),
    's': (1.0, 's'),
    '1': (1e-2, '%'),
    '1/s': (1e-2, '%/s'),
}
_ZOOM_STARTS = 100_000  # starts of the zoom that are compared
_TWO_SIDED = float(-ndtri(SIGNIFICANCE / 2.0))


@dataclass(frozen=True)
class Picture:
    """
    A figure of the page.

    Attributes
    ----------
    wide, narrow
        SVG for a desktop and for a phone. `narrow` is empty if the wide figure is small enough for a phone.
    caption
        Description of the content.

    """

    wide: str
    narrow: str
    caption: str


@dataclass(frozen=True)
class Window:
    """A section of a recording, from `begin` to `end` [s]."""

    comparison: Comparison
    begin: float
    end: float


def pictures_by_section(result: ChannelResult, comparisons: Sequence[Comparison]) -> dict[str, list[Picture]]:
    """Return the figures of a channel by section of the page; each of the `comparisons` is shown in full length."""
    strips = [zoom_picture(result), *(record_picture(result, comparison) for comparison in comparisons)]
    unexplained = result.findings.verdict == 'unexplained'
    dependences = residual_dependences(result)[:_MOST_DEPENDENCES] if unexplained else []
    return {
        'characteristic': [] if result.findings.unknown is None else [characteristic_picture(result.findings.unknown)],
        'strips': strips,
        'correlations': correlation_pictures(result),
        'dependences': [_dependence_picture(result, dependence) for dependence in dependences],
    }


def characteristic_picture(estimate: Characteristic) -> Picture:
    """Return the figure of an estimated curve with its band; ranges that no recording visited are grey."""
    (variable_scale, variable_unit), (scale, unit) = _CURVE_UNITS[estimate.unit_against], _CURVE_UNITS[estimate.unit]
    at, visited = estimate.at / variable_scale, np.flatnonzero(estimate.visited)
    curves = [Curve(at, estimate.value / scale, MUTED, 0.8)]
    lines = (estimate.low, 0.8), (estimate.high, 0.8), (estimate.value, 2.0)
    for run in np.split(visited, 1 + np.flatnonzero(np.diff(visited) > 1)):  # the gaps between runs are not estimated
        is_dot = run.size == 1
        curves += [Curve(at[run], line[run] / scale, AFTER, (1 + 2 * is_dot) * width, is_dot) for line, width in lines]
    text = f'Estimated curve: {estimate.description}. Thin lines: 95 % interval at each point. Grey: not visited.'
    place, variable = PLACES[estimate.enters].axis, VARIABLES[estimate.against].axis

    def figure(width: int) -> str:
        panel = Panel(f'{place} [{unit}]', 200, curves, levels=[(0.0, 'var(--rule)')])
        return chart([panel], width, (float(at[0]), float(at[-1])), f'{variable} [{variable_unit}]', text)

    return Picture(figure(WIDE), figure(NARROW), text)


def _dependence_picture(result: ChannelResult, dependence: Dependence) -> Picture:
    """Return the figure of the mean residual over a signal on which the residual depends."""
    small_unit, (scale, unit) = result.quantity.small, _SIGNAL_UNITS.get(dependence.on, (1.0, ''))
    at, mean = dependence.at / scale, dependence.mean / small_unit.si
    curves = [Curve(at, mean, AFTER, 1.2), Curve(at, mean, AFTER, 4.0, dots=True)]
    text = f'{dependence.on} explains {100.0 * dependence.share:.0f} %: {dependence.suggestion}'
    panel = Panel(f'residual [{small_unit.unit}]', 160, curves, levels=[(0.0, 'var(--rule)')])
    span = (float(at.min()), float(at.max()))
    return Picture(chart([panel], PANEL, span, f'{dependence.on}{unit}', f'Mean of the residual. {text}.'), '', text)


def record_picture(result: ChannelResult, comparison: Comparison) -> Picture:
    """Return the figure of measured values, simulated values and residuals over a whole recording."""
    begin, end = float(comparison.times[0]), float(comparison.times[-1])
    label = _alternative_text(result, f'the whole of {comparison.name}')
    wide, narrow = _strips(result, Window(comparison, begin, end), label)
    return Picture(wide, narrow, f'{comparison.name}, all {end - begin:.4g} s.')


def zoom_picture(result: ChannelResult) -> Picture:
    """Return the figure of measured values, simulated values and residuals in the zoom window."""
    window = zoom_window(result)
    section = f'{window.comparison.name}, {round(window.begin, 2) + 0.0:.2f} s to {window.end:.2f} s'
    wide, narrow = _strips(result, window, _alternative_text(result, section))
    return Picture(wide, narrow, f'{section}: {_ZOOM_REASONS[_zoom_criterion(result)]}.')


def _alternative_text(result: ChannelResult, section: str) -> str:
    unit = result.quantity.small.unit
    models = f'without effects (error {result.rms(0):.3g} {unit} RMS)'
    if result.added:
        models += f' and with effects ({result.rms(1):.3g} {unit} RMS)'
    return (
        f'Three strips over time, {section}: displacement of the piston; {result.quantity.name} as measured and as '
        f'simulated {models}; residuals, measured minus simulated.'
    )


_ZOOM_REASONS = {
    'reduction': 'here the effects reduce the residual most',
    'remaining': 'here the remaining error is largest',
    'residual': 'here the residual is largest',
}


def _zoom_criterion(result: ChannelResult) -> str:
    """Return the power that selects the zoom window, a key of `_ZOOM_REASONS`."""
    if not result.added:
        return 'residual'
    return 'remaining' if result.findings.verdict == 'unexplained' else 'reduction'


def zoom_window(result: ChannelResult) -> Window:
    """Return the window with the largest residual, or with the largest reduction of the residual by the effects."""
    criterion = _zoom_criterion(result)
    best: tuple[float, Window] | None = None
    for comparison in result.comparisons:
        power = comparison.residual(1 if criterion == 'remaining' else 0) ** 2
        if criterion == 'reduction':
            power -= comparison.residual(1) ** 2
        times = comparison.times
        duration = float(np.ptp(times))
        length = min(max(_ZOOM_SHARE * duration, _SHORTEST_ZOOM), _LONGEST_ZOOM, duration)
        edges = np.linspace(0, times.size, min(times.size, _ZOOM_STARTS), endpoint=False).astype(np.intp)
        total = np.concatenate([[0.0], np.cumsum(np.add.reduceat(power, edges))])
        begins = times[edges]
        energies = total[np.searchsorted(begins, begins + length, side='right')] - total[:-1]
        energies[begins > times[-1] - length] = -np.inf
        first = int(np.argmax(energies))
        begin = float(begins[first])
        if best is None or energies[first] > best[0]:
            best = float(energies[first]), Window(comparison, begin, begin + length)
    assert best is not None
    return best[1]


def _strips(result: ChannelResult, window: Window, label: str) -> tuple[str, str]:
    return (
        _strip_figure(result, window, WIDE, (61, 166, 133), label),
        _strip_figure(result, window, NARROW, (67, 158, 134), label),
    )


def _strip_figure(
    result: ChannelResult, window: Window, width: int, heights: tuple[float, float, float], label: str
) -> str:
    comparison = window.comparison
    shown = (comparison.times >= window.begin) & (comparison.times <= window.end)
    times = comparison.times[shown]
    is_dotted = int(np.count_nonzero(shown)) <= _MOST_DOTS * width / WIDE
    large, small = result.quantity.large, result.quantity.small

    def curve(values: Array, colour: str, line: float) -> Curve:
        return Curve(*thinned(times, values[shown], width), colour, line)

    motion = curve(comparison.inputs['displacement'] * 1e3, MUTED, 1.2)
    series = [(comparison.before, BEFORE)] + ([(comparison.after, AFTER)] if result.added else [])
    simulated = [curve(values / large.si, colour, 1.3 if is_dotted else 0.9) for values, colour in series]
    measured = comparison.experiment.measured / large.si
    if is_dotted:
        values = [*simulated, Curve(times, measured[shown], MEASURED, 2.6, dots=True)]
    else:
        values = [curve(measured, MEASURED, 1.6), *simulated]
    residuals = [
        curve(comparison.residual(which) / small.si, BEFORE if which == 0 else AFTER, 1.0)
        for which in range(len(series))
    ]
    titles = _titles(result)
    labels, marks = _part_labels(comparison, window, width)
    panels = (
        Panel(titles[0], heights[0], [motion], ticks=3, headroom=_HEADROOM, labels=labels),
        Panel(titles[1], heights[1], values),
        Panel(titles[2], heights[2], residuals, band=2.0 * result.noise.std / small.si),
    )
    return chart(panels, width, (window.begin, window.end), 'time [s]', label, marks=marks)


def _titles(result: ChannelResult) -> tuple[str, str, str]:
    absolute = ', absolute' if result.quantity.key == 'pa' else ''
    return (
        'displacement that grows the chamber [mm]' if result.quantity.key == 'pa' else 'displacement [mm]',
        f'{result.quantity.name}{absolute} [{result.quantity.large.unit}]',
        f'residual [{result.quantity.small.unit}]',
    )


def _part_labels(comparison: Comparison, window: Window, width: int) -> tuple[list[tuple[float, str]], list[float]]:
    """Return the names of the visible parts (train, validation, test) with their begins, and the borders [s]."""
    labels, marks = [], []
    for index, part in enumerate(PARTS):
        samples = np.flatnonzero(comparison.experiment.part == index)
        if samples.size == 0:
            continue
        begin, end = comparison.times[samples[0]], comparison.times[samples[-1]]
        if index and window.begin < begin < window.end:
            marks.append(float(begin))
        visible = max(begin, window.begin), min(end, window.end)
        if visible[1] - visible[0] > (0.04 if width > NARROW else 0.1) * (window.end - window.begin):
            labels.append((float(visible[0]), part))
    return labels, marks


def correlation_pictures(result: ChannelResult) -> list[Picture]:
    """Return the figures of the residual's autocorrelation and of its correlations with the inputs that change."""
    pictures = [_autocorrelation_picture(result)]
    for name in ('piston speed', 'set-point', 'pressure difference'):
        inputs = _fitted_input(result, name)
        if any(np.ptp(run) > 0.0 for run in inputs):
            pictures.append(_crosscorrelation_picture(result, name, inputs))
    return pictures


def _tested_residuals(result: ChannelResult, which: int) -> list[Array]:
    """Return the weighted residuals on train and validation without their mean, as the tests use them."""
    return [run - np.mean(run) for run in result.tested(which) if run.size > 2]


def _autocorrelation_picture(result: ChannelResult) -> Picture:
    curves = {}
    for which, colour in _residual_colours(result).items():
        runs = _tested_residuals(result, which)
        covariance = autocovariance(runs, min(_LAGS, min(run.size for run in runs) - 1))
        limit = _TWO_SIDED / np.sqrt(sum(run.size for run in runs))
        curves[colour] = np.arange(1, covariance.size), covariance[1:] / covariance[0], limit
    text = 'Autocorrelation'
    return Picture(_correlation_figure(text, curves), '', text)


def _fitted_input(result: ChannelResult, name: str) -> list[Array]:
    """Return an input on train and validation without its mean; empty if the channel has no such input."""
    runs = [
        comparison.inputs[name][comparison.experiment.counts]
        for comparison in result.comparisons
        if name in comparison.inputs
    ]
    return [run - np.mean(run) for run in runs if run.size > 2]


def _crosscorrelation_picture(result: ChannelResult, name: str, inputs: Sequence[Array]) -> Picture:
    curves = {}
    for which, colour in _residual_colours(result).items():
        curves[colour] = crosscorrelation(_tested_residuals(result, which), inputs, _LAGS_BEFORE, _LAGS)
    text = f'Correlation with the {name}'
    return Picture(_correlation_figure(text, curves), '', text)


def crosscorrelation(
    residuals: Sequence[Array], inputs: Sequence[Array], before: int, after: int
) -> tuple[NDArray[np.intp], Array, float]:
    """
    Return lags [samples], the correlation at each lag and the threshold [-].

    At a positive lag, the residual comes later than the input. The threshold is Bartlett's, for two independent series
    that are each autocorrelated.
    """
    shortest = min(residual.size for residual in residuals)
    lags = np.arange(-min(before, shortest - 1), min(after, shortest - 1) + 1)
    count = sum(residual.size for residual in residuals)
    norm = np.sqrt(sum(float(run @ run) for run in residuals) * sum(float(run @ run) for run in inputs))
    products = [
        sum(
            float(residual[max(lag, 0) : residual.size + min(lag, 0)] @ run[max(-lag, 0) : run.size - max(lag, 0)])
            for residual, run in zip(residuals, inputs)
        )
        for lag in lags.tolist()
    ]
    longest_lag = min(shortest - 1, max(_LAGS, min(int(np.sqrt(count)), _LONGEST_CORRELATION)))
    residual_covariance, input_covariance = (autocovariance(series, longest_lag) for series in (residuals, inputs))
    power = float(residual_covariance[0] * input_covariance[0])
    spread = 1.0 + 2.0 * float(residual_covariance[1:] @ input_covariance[1:]) / max(power, 1e-300)
    limit = _TWO_SIDED * float(np.sqrt(max(spread, 1.0) / count))
    return lags, np.array(products) / max(norm, 1e-300), limit


def _residual_colours(result: ChannelResult) -> dict[int, str]:
    """Return the colour of each residual of the channel: 0 without effects, 1 with effects."""
    return {0: BEFORE, 1: AFTER} if result.added else {0: BEFORE}


def _correlation_figure(text: str, curves: Mapping[str, tuple[NDArray[np.intp], Array, float]]) -> str:
    series, levels, exceedances = [], [(0.0, 'var(--rule)')], []
    for colour, (lags, values, limit) in curves.items():
        series += [Curve(lags, values, colour, 1.2), Curve(lags, values, colour, 4.0, dots=True)]
        levels += [(-limit, colour), (limit, colour)]
        name = 'without effects' if colour == BEFORE else 'with effects'
        count = int(np.count_nonzero(np.abs(values) > limit))
        exceedances.append(f'{name}, {count} of {values.size} lags exceed the threshold of {limit:.3f}')
    all_lags = np.concatenate([lags for lags, *_ in curves.values()])
    return chart(
        [Panel('', 160, series, levels=levels)],
        PANEL,
        (float(all_lags.min()), float(all_lags.max())),
        'lag [samples]',
        f'{text}, of the residual: {"; ".join(exceedances)}.',
        whole=True,
    )
