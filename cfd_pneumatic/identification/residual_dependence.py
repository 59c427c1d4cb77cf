# SPDX-License-Identifier: Apache-2.0
"""Find the signals on which the remaining error depends most, and what to inspect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.report_texts import number, percent
from cfd_pneumatic.identification.result import ChannelResult, Comparison
from cfd_pneumatic.identification.thresholds import (
    DEPENDENCE_BINS,
    LEAST_DEPENDENCE,
    LEAST_MOVING_SPEED,
    LEAST_POWER,
    MOST_DEPENDENCES,
    MOST_PLOTTED_SAMPLES,
)

SUGGESTIONS: Mapping[str, str] = MappingProxyType(
    {
        'position': 'the place on the stroke: a scored wall, a port, a linkage',
        'piston speed': 'the flow path: line, fittings, valves',
        'direction': 'what differs between the directions: backlash, friction, hysteresis of a valve',
        'pressure': 'what grows with pressure: a leak, the supply, the scale of a sensor',
        'contact force': 'what grows with the force: the scale of the load cell, friction under load',
        'pressure difference': 'what grows with the force: area, linkage, the scale of the load cell',
        'set-point': 'the set-point: gains that depend on the operating point, or a set-point that does not act',
        'valve error': "the regulator's valves: dead band, limits, dirt",
        'time': 'the temperature, the air supply and other consumers of air',
    }
)
"""What to inspect on the machine, by the signal on which the remaining error depends."""


@dataclass(frozen=True)
class Samples:
    """
    Samples of a residual and a signal, thinned for a plot.

    Attributes
    ----------
    signal, residual
        Values, shape (n,) [SI].
    times
        Times, shape (n,) [s]; None for several recordings.

    """

    signal: Array
    residual: Array
    times: Array | None


@dataclass(frozen=True)
class Dependence:
    """
    Dependence of a residual on a signal.

    Attributes
    ----------
    on
        Name of the signal, for people.
    share
        Share of the residual's power that the mean residual in each bin explains [-].
    at, mean
        Mean signal and mean residual of bins with equally many samples, shape (bins,) [SI].
    samples
        Samples for a plot.

    """

    on: str
    share: float
    at: Array
    mean: Array
    samples: Samples

    @property
    def suggestion(self) -> str:
        """What to inspect on the machine."""
        return SUGGESTIONS.get(self.on, f'causes that depend on the {self.on}')


def signal_dependences(result: ChannelResult) -> list[Dependence]:
    """Return the dependence of the remaining error on each signal, the strongest first."""
    residual = np.concatenate([comparison.residual(1) for comparison in result.comparisons])
    times = result.comparisons[0].times if len(result.comparisons) == 1 else None
    recorded = [dict(_signals(result, comparison)) for comparison in result.comparisons]
    shared = [name for name in recorded[0] if all(name in signals for signals in recorded)]
    dependences = [
        _dependence(name, np.concatenate([signals[name] for signals in recorded]), residual, times) for name in shared
    ]
    return sorted(dependences, key=lambda dependence: -dependence.share)


def residual_dependences(result: ChannelResult) -> list[Dependence]:
    """Return the dependences of the remaining error that are strong enough to be reported, the strongest first."""
    return [dependence for dependence in signal_dependences(result) if dependence.share >= LEAST_DEPENDENCE]


def describe_remaining_error(result: ChannelResult) -> str:
    """Return the size of the remaining error, the signals on which it depends, and what to inspect, as sentences."""
    size, small = result.rmse(1), result.quantity.small
    noise, span = size / result.noise.std, size / result.span
    text = f'The remaining error is {number(size / small.si)} {small.unit}, {number(noise, 2)} times the noise and '
    text += f'{percent(span)} of the span.'
    if not result.findings.is_searched:  # misread recordings would only show their input error
        return text
    dependences = residual_dependences(result)[:MOST_DEPENDENCES]
    if not dependences:
        return f'{text} It does not depend on position, speed, pressure or time alone.'
    strongest, *weaker = dependences
    text += f' It depends most on {strongest.on} ({percent(strongest.share)} of its power)'
    if weaker:
        text += f', then on {", ".join(f"{weak.on} ({percent(weak.share)})" for weak in weaker)}'
    return f'{text}. Inspect {strongest.suggestion}.'


def _signals(result: ChannelResult, comparison: Comparison) -> Iterator[tuple[str, Array]]:
    """Yield the signals on which a residual may depend, by names of `SUGGESTIONS`."""
    inputs = comparison.inputs
    if 'displacement' in inputs:
        yield 'position', inputs['displacement']
    if 'piston speed' in inputs:
        speed = inputs['piston speed']
        yield 'piston speed', speed
        yield 'direction', np.sign(speed) * (np.abs(speed) > LEAST_MOVING_SPEED * np.std(speed))
    yield result.quantity.name, comparison.after
    for name in ('pressure difference', 'set-point'):
        if name in inputs:
            yield name, inputs[name]
    if 'set-point' in inputs:
        yield 'valve error', inputs['set-point'] - comparison.after
    yield 'time', comparison.times


def _dependence(name: str, signal: Array, residual: Array, times: Array | None) -> Dependence:
    """Return the dependence of a residual on a signal: the correlation ratio minus its value expected by chance."""
    edges = np.unique(np.quantile(signal, np.linspace(0.0, 1.0, DEPENDENCE_BINS + 1)))
    index = np.clip(np.searchsorted(edges, signal, side='right') - 1, 0, max(edges.size - 2, 0))
    counts = np.bincount(index)
    is_filled = counts > 0
    means = np.bincount(index, residual)[is_filled] / counts[is_filled]
    signal_means = np.bincount(index, signal)[is_filled] / counts[is_filled]
    centred = residual - np.mean(residual)
    power = max(float(centred @ centred), LEAST_POWER)
    between = float(counts[is_filled] @ (means - np.mean(residual)) ** 2)
    chance = (int(np.count_nonzero(is_filled)) - 1) / residual.size
    every = slice(None, None, -(-residual.size // MOST_PLOTTED_SAMPLES))
    samples = Samples(signal[every], residual[every], None if times is None else times[every])
    return Dependence(name, max(between / power - chance, 0.0), signal_means, means, samples)
