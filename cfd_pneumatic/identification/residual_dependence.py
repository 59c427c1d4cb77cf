# SPDX-License-Identifier: Apache-2.0
"""Where what a model leaves lives: on which signals it depends most, and what that suggests to look at."""

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
)

SUGGESTIONS: Mapping[str, str] = MappingProxyType(
    {
        'position': 'something at one place of the travel: a scored wall, a port, a linkage',
        'piston speed': 'what flow has to pass: line, fittings, the valves',
        'direction': 'what differs out and back: play, friction, hysteresis of a valve',
        'pressure': 'what grows with pressure: a leak, the supply, the scale of a sensor',
        'contact force': 'what grows with the force: the scale of the load cell, friction under load',
        'pressure difference': 'what grows with the force: area, linkage, the scale of the load cell',
        'set-point': 'gains that follow the operating point, or a set-point that is not the one that acts',
        'valve error': "the regulator's valves: dead band, limits, dirt",
        'time': 'what drifts or comes and goes: temperature, supply, another consumer',
    }
)
"""What a dependence suggests to look at on the machine, by signal."""


@dataclass(frozen=True)
class Dependence:
    """
    How a residual depends on a signal.

    Attributes
    ----------
    on
        Name of the signal, for people.
    share
        Part of the residual's power that its mean over the signal explains [-].
    at, mean
        The signal, and the residual's mean there, from bins of equally many samples, shape (bins,) [SI].

    """

    on: str
    share: float
    at: Array
    mean: Array

    @property
    def suggestion(self) -> str:
        """What it suggests to look at on the machine."""
        return SUGGESTIONS.get(self.on, f'what goes with the {self.on}')


def residual_dependences(result: ChannelResult) -> list[Dependence]:
    """Return on which signals what is left depends, the strongest first."""
    residual = np.concatenate([one.residual(1) for one in result.comparisons])
    signals = [dict(_signals(result, one)) for one in result.comparisons]
    shared = [name for name in signals[0] if all(name in one for one in signals)]
    found = [_dependence(name, np.concatenate([one[name] for one in signals]), residual) for name in shared]
    return sorted((one for one in found if one.share >= LEAST_DEPENDENCE), key=lambda one: -one.share)


def describe_remaining_error(result: ChannelResult) -> str:
    """Return in a sentence or two how large what is left is, where it lives, and what that suggests to look at."""
    size, small = result.rmse(1), result.quantity.small
    noise, span = size / result.noise.std, size / result.span
    text = f'What is left is {number(size / small.si, 3)} {small.unit}, {number(noise, 2)} times the noise and '
    text += f'{percent(span)} of the span.'
    if not result.findings.is_searched:  # what it goes with is the mistake
        return text
    found = residual_dependences(result)
    if not found:
        return f'{text} It goes with none of position, speed, pressure and time alone.'
    others = ', '.join(f'{one.on} ({percent(one.share)})' for one in found[1:MOST_DEPENDENCES])
    text += f' It goes most with {found[0].on} ({percent(found[0].share)} of its power)'
    return f'{text}{f", then with {others}" if others else ""}: look at {found[0].suggestion}.'


def _signals(result: ChannelResult, comparison: Comparison) -> Iterator[tuple[str, Array]]:
    """Yield what a residual may depend on, by names of `SUGGESTIONS`."""
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


def _dependence(name: str, signal: Array, residual: Array) -> Dependence:
    """Return how a residual depends on a signal: its correlation ratio, less what chance makes of so many bins."""
    edges = np.unique(np.quantile(signal, np.linspace(0.0, 1.0, DEPENDENCE_BINS + 1)))
    place = np.clip(np.searchsorted(edges, signal, side='right') - 1, 0, max(edges.size - 2, 0))
    counts = np.bincount(place)
    held = counts > 0
    means = np.bincount(place, residual)[held] / counts[held]
    at = np.bincount(place, signal)[held] / counts[held]
    centred = residual - np.mean(residual)
    power = max(float(centred @ centred), LEAST_POWER)
    between = float(counts[held] @ (means - np.mean(residual)) ** 2)
    chance = (int(np.count_nonzero(held)) - 1) / residual.size
    return Dependence(name, max(between / power - chance, 0.0), at, means)
