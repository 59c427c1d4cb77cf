# SPDX-License-Identifier: Apache-2.0
"""Charts of the report page: measured and simulated values, the residual, and an estimated curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.charts import Chart, Curve, Panel, Style, Window
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
    signal_dependences,
)

MEASURED, BEFORE, AFTER, MUTED, RULE = (f'var(--{name})' for name in ('measured', 'before', 'after', 'muted', 'rule'))

_ZOOM_SHARE = 0.08  # share of a recording that the zoom shows
_SHORTEST_ZOOM, _LONGEST_ZOOM = 0.5, 1.5  # [s]
_HEADROOM = 0.5  # share of an axis that is kept free for labels
_LAGS = 60  # samples
_LAGS_BEFORE = 20  # samples
_LONGEST_CORRELATION = 500  # largest lag of the autocorrelation of residuals and inputs [samples]
_PLOTTED_SIGNALS = (
    'position',
    'piston speed',
    'pressure',
    'contact force',
    'pressure difference',
    'valve error',
    'time',
)
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
class Excerpt:
    """A section of a recording, from `begin` to `end` [s]."""

    comparison: Comparison
    begin: float
    end: float


def charts_by_section(result: ChannelResult, comparisons: Sequence[Comparison]) -> dict[str, list[Chart]]:
    """Return the charts of a channel by section of the page; each of the `comparisons` is shown in full length."""
    return {
        'characteristic': [] if result.findings.unknown is None else [characteristic_chart(result.findings.unknown)],
        'records': [record_chart(result, comparison) for comparison in comparisons],
        'correlations': correlation_charts(result),
        'dependences': dependence_charts(result),
    }


def characteristic_chart(estimate: Characteristic) -> Chart:
    """Return the chart of an estimated curve with its band; ranges that no recording visited are grey."""
    (variable_scale, variable_unit), (scale, unit) = _CURVE_UNITS[estimate.unit_against], _CURVE_UNITS[estimate.unit]
    at, visited = estimate.at / variable_scale, np.flatnonzero(estimate.visited)
    curves = [Curve(at, estimate.value / scale, MUTED, 0.8)]
    lines = (estimate.low, 0.8), (estimate.high, 0.8), (estimate.value, 2.0)
    for run in np.split(visited, 1 + np.flatnonzero(np.diff(visited) > 1)):  # the gaps between runs are not estimated
        style: Style = 'dots' if run.size == 1 else 'line'
        factor = 3 if run.size == 1 else 1
        curves += [Curve(at[run], line[run] / scale, AFTER, factor * width, style) for line, width in lines]
    text = f'Estimated curve: {estimate.description}. Thin lines: 95 % interval at each point. Grey: not visited.'
    place, variable = PLACES[estimate.enters].axis, VARIABLES[estimate.against].axis
    panel = Panel(f'{place} [{unit}]', 200, curves, levels=[(0.0, RULE)])
    return Chart([panel], (float(at[0]), float(at[-1])), f'{variable} [{variable_unit}]', text, text)


def dependence_charts(result: ChannelResult) -> list[Chart]:
    """Return the charts of the residual over the signals on which the residual may depend, the strongest first."""
    plotted = [dependence for dependence in signal_dependences(result) if dependence.on in _PLOTTED_SIGNALS]
    return [_dependence_chart(result, dependence) for dependence in plotted]


def _dependence_chart(result: ChannelResult, dependence: Dependence) -> Chart:
    """Return the chart of the residual over a signal: samples, and means of equally many samples."""
    small_unit, (scale, unit) = result.quantity.small, _SIGNAL_UNITS.get(dependence.on, (1.0, ''))
    samples, at = dependence.samples, dependence.at / scale
    dots = Curve(samples.signal / scale, samples.residual / small_unit.si, MEASURED, 1.6, 'dots', times=samples.times)
    mean = dependence.mean / small_unit.si
    curves = [dots, Curve(at, mean, AFTER, 2.0), Curve(at, mean, AFTER, 5.0, 'dots')]
    text = f'{dependence.on}: {100.0 * dependence.share:.0f} %'
    panel = Panel(f'residual [{small_unit.unit}]', 160, curves, levels=[(0.0, RULE)], robust=True)
    return Chart(
        [panel],
        (float(np.min(dots.x)), float(np.max(dots.x))),
        f'{dependence.on}{unit}',
        f'Residual over {dependence.on}. Dots: samples. Line: means of equally many samples.',
        text[:1].upper() + text[1:],
        is_wide=False,
        clock='' if samples.times is None else _clock_of(result.comparisons[0]),
    )


def _clock_of(comparison: Comparison) -> str:
    return f'recording {comparison.recording}'


def record_chart(result: ChannelResult, comparison: Comparison) -> Chart:
    """Return the chart of displacement, measured and simulated values, and residuals over a whole recording."""
    times = comparison.times
    begin, end = float(times[0]), float(times[-1])
    large, small = result.quantity.large, result.quantity.small
    simulated = {BEFORE: comparison.before, **({AFTER: comparison.after} if result.added else {})}
    variants = {BEFORE: ' before' if result.added else '', AFTER: ' after'}
    values = [Curve(times, comparison.experiment.measured / large.si, MEASURED, 1.6, 'samples', 'measured')]
    residuals = []
    for which, (colour, curve) in enumerate(simulated.items()):
        values.append(Curve(times, curve / large.si, colour, 1.1, name=f'simulated{variants[colour]}'))
        residual = comparison.residual(which) / small.si
        residuals.append(Curve(times, residual, colour, 1.0, name=f'residual{variants[colour]}'))
    if 'set-point' in comparison.inputs:
        setpoint = comparison.inputs['set-point'] / large.si
        values.insert(0, Curve(times, setpoint, MUTED, 0.9, name='set-point'))
    motion = Curve(times, comparison.inputs['displacement'] * 1e3, MUTED, 1.2, name='displacement')
    labels, marks = _part_labels(comparison)
    first, second, third = _titles(result)
    panels = (
        Panel(first, 61, [motion], ticks=3, headroom=_HEADROOM, labels=labels),
        Panel(second, 166, values),
        Panel(third, 133, residuals, band=2.0 * result.noise.std / small.si, robust=True),
    )
    window = zoom_window(result)
    windows = []
    if window.comparison is comparison:
        windows = [Window(_ZOOM_REASONS[_zoom_criterion(result)], window.begin, window.end)]
    return Chart(
        panels,
        (begin, end),
        'time [s]',
        _alternative_text(result, f'the whole of {comparison.name}'),
        f'{comparison.name}, all {end - begin:.4g} s.',
        marks=marks,
        windows=windows,
        clock=_clock_of(comparison),
    )


def _alternative_text(result: ChannelResult, section: str) -> str:
    unit = result.quantity.small.unit
    models = f'without effects (error {result.rms(0):.3g} {unit} RMS)'
    if result.added:
        models += f' and with effects ({result.rms(1):.3g} {unit} RMS)'
    return (
        f'Three strips over time, {section}: displacement of the piston; {result.quantity.name} as measured and as '
        f'simulated {models}; residuals, measured minus simulated.'
    )


_ZOOM_REASONS = {'reduction': 'Largest improvement', 'remaining': 'Largest error', 'residual': 'Largest error'}


def _zoom_criterion(result: ChannelResult) -> str:
    """Return the power that selects the zoom window, a key of `_ZOOM_REASONS`."""
    if not result.added:
        return 'residual'
    return 'remaining' if result.findings.verdict == 'unexplained' else 'reduction'


def zoom_window(result: ChannelResult) -> Excerpt:
    """Return the window with the largest residual, or with the largest reduction of the residual by the effects."""
    criterion = _zoom_criterion(result)
    best: tuple[float, Excerpt] | None = None
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
            best = float(energies[first]), Excerpt(comparison, begin, begin + length)
    assert best is not None
    return best[1]


def _titles(result: ChannelResult) -> tuple[str, str, str]:
    absolute = ', absolute' if result.quantity.key == 'pa' else ''
    return (
        'displacement, + grows the chamber [mm]' if result.quantity.key == 'pa' else 'displacement [mm]',
        f'{result.quantity.name}{absolute} [{result.quantity.large.unit}]',
        f'residual [{result.quantity.small.unit}]',
    )


def _part_labels(comparison: Comparison) -> tuple[list[tuple[float, str]], list[float]]:
    """Return the names of the parts (train, validation, test) with their begins, and the borders [s]."""
    labels, marks = [], []
    for index, part in enumerate(PARTS):
        samples = np.flatnonzero(comparison.experiment.part == index)
        if samples.size == 0:
            continue
        begin = float(comparison.times[samples[0]])
        if index and begin > comparison.times[0]:
            marks.append(begin)
        labels.append((begin, part))
    return labels, marks


def correlation_charts(result: ChannelResult) -> list[Chart]:
    """Return the charts of the residual's autocorrelation and of its correlations with the inputs that change."""
    charts = [_autocorrelation_chart(result)]
    for name in ('piston speed', 'set-point', 'pressure difference'):
        inputs = _fitted_input(result, name)
        if any(np.ptp(run) > 0.0 for run in inputs):
            charts.append(_crosscorrelation_chart(result, name, inputs))
    return charts


def _tested_residuals(result: ChannelResult, which: int) -> list[Array]:
    """Return the weighted residuals on train and validation without their mean, as the tests use them."""
    return [run - np.mean(run) for run in result.tested(which) if run.size > 2]


def _autocorrelation_chart(result: ChannelResult) -> Chart:
    curves = {}
    for which, colour in _residual_colours(result).items():
        runs = _tested_residuals(result, which)
        covariance = autocovariance(runs, min(_LAGS, min(run.size for run in runs) - 1))
        limit = _TWO_SIDED / np.sqrt(sum(run.size for run in runs))
        curves[colour] = np.arange(1, covariance.size), covariance[1:] / covariance[0], limit
    text = 'Autocorrelation'
    return _correlation_chart(text, curves)


def _fitted_input(result: ChannelResult, name: str) -> list[Array]:
    """Return an input on train and validation without its mean; empty if the channel has no such input."""
    runs = [
        comparison.inputs[name][comparison.experiment.counts]
        for comparison in result.comparisons
        if name in comparison.inputs
    ]
    return [run - np.mean(run) for run in runs if run.size > 2]


def _crosscorrelation_chart(result: ChannelResult, name: str, inputs: Sequence[Array]) -> Chart:
    curves = {}
    for which, colour in _residual_colours(result).items():
        curves[colour] = crosscorrelation(_tested_residuals(result, which), inputs, _LAGS_BEFORE, _LAGS)
    text = f'Correlation with the {name}'
    return _correlation_chart(text, curves)


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


def _correlation_chart(text: str, curves: Mapping[str, tuple[NDArray[np.intp], Array, float]]) -> Chart:
    series, levels, exceedances = [], [(0.0, RULE)], []
    for colour, (lags, values, limit) in curves.items():
        series += [Curve(lags, values, colour, 1.2), Curve(lags, values, colour, 4.0, 'dots')]
        levels += [(-limit, colour), (limit, colour)]
        name = 'without effects' if colour == BEFORE else 'with effects'
        count = int(np.count_nonzero(np.abs(values) > limit))
        exceedances.append(f'{name}, {count} of {values.size} lags exceed the threshold of {limit:.3f}')
    all_lags = np.concatenate([lags for lags, *_ in curves.values()])
    return Chart(
        [Panel('', 160, series, levels=levels)],
        (float(all_lags.min()), float(all_lags.max())),
        'lag [samples]',
        f'{text}, of the residual: {"; ".join(exceedances)}.',
        text,
        whole=True,
        is_wide=False,
    )
