# SPDX-License-Identifier: Apache-2.0
"""Comparison of a node's input with the range of the identification, and likely input errors."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

from cfd_pneumatic import convention
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.device import SPEED_INTERVAL, IdentifiedRange, Span
from cfd_pneumatic.units import PSI

_SPAN_MARGIN = 0.1  # share of a span by which a value may be outside
_SPEED_MARGIN = 1.2  # times the largest speed
_PRESSURE_ROOM = 5e3  # by which a set-point or pressure may be outside in any case [Pa]
_DISPLACEMENT_ROOM = 2e-5  # by which a displacement may be outside in any case [m]
_NOISE_ROOM = 1e-5  # change of a displacement by noise [m]
_SHORTEST = SPEED_INTERVAL / 2  # shortest time over which a speed is computed, as for a vibration [s]
_LONGEST_TRAVEL = 0.1  # longest travel of a piston of such a device [m]
_UNIT_RATIO = 20.0  # ratio to the largest displacement above which the unit is wrong
_KILOPASCAL = 1e3  # set-points up to this value probably have another unit [Pa]
_UNITS = {'MPa': 1e6, 'bar': 1e5, 'psi': PSI, 'kPa': 1e3, 'mbar': 1e2}  # [Pa]
_UNTESTED = 'the model is not validated there'


class _Values:
    """The span of a quantity since the last report, or its last value if there is no new value."""

    def __init__(self) -> None:
        self._span: Span | None = None
        self._last = 0.0
        self._is_reported = False

    def add(self, value: float) -> None:
        self._span = _widened(None if self._is_reported else self._span, value)
        self._last, self._is_reported = value, False

    def report(self) -> Span | None:
        """Return the span; None before the first value."""
        span = self._span
        if span is not None:
            self._span, self._is_reported = (self._last, self._last), True
        return span


class InputRange:
    """
    Compares input and predicted pressures since the last report with the range of the identification.

    `report` returns warnings. A warning lasts until a new value arrives.
    """

    def __init__(self, identified: IdentifiedRange) -> None:
        """Set the identified range; `compare_with` changes the range."""
        self.compare_with(identified)
        self._displacement = _Values()
        self._before: Span | None = None  # displacement in the last report
        self._lowest = self._highest = (0.0, 0)  # positions and stamps in the interval of the speed
        self._start = self._latest = -1
        self._speed = 0.0
        self._predicted: defaultdict[str, _Values] = defaultdict(_Values)
        self._measured: defaultdict[str, _Values] = defaultdict(_Values)

    def compare_with(
        self,
        identified: IdentifiedRange,
        ambient_pressure: float = AMBIENT_PRESSURE,
        operating_points: Mapping[str, Span] | None = None,
    ) -> None:
        """Set the identified range, and the operating points for unidentified set-points [Pa]."""
        self._identified = identified
        self._ambient = ambient_pressure
        self._operating_points = operating_points or {}

    def sample(self, stamp: int, position: float) -> None:
        """Note a piston sample: its stamp [ns] and its displacement [m], unless that is not finite."""
        if not math.isfinite(position):
            return
        self._displacement.add(position)
        if stamp != self._latest:  # the model ignores repeated stamps, too
            self._note_speed(stamp, position)

    def _note_speed(self, stamp: int, position: float) -> None:
        """Compute the speed at the end of an interval: travel over the time between lowest and highest position."""
        sample = position, stamp
        if self._start < 0 or stamp < self._latest:
            self._start, self._lowest, self._highest = stamp, sample, sample
        self._latest = stamp
        self._lowest, self._highest = min(self._lowest, sample), max(self._highest, sample)
        if (stamp - self._start) * 1e-9 >= SPEED_INTERVAL:
            elapsed = max(abs(self._highest[1] - self._lowest[1]) * 1e-9, _SHORTEST)
            self._speed = max(self._speed, (self._highest[0] - self._lowest[0] - _NOISE_ROOM) / elapsed)
            self._start, self._lowest, self._highest = stamp, sample, sample

    def predicted(self, names: Iterable[str], readings: Iterable[float]) -> None:
        """Note predicted absolute pressures [Pa], by cylinder."""
        for name, reading in zip(names, readings):
            self._predicted[name].add(reading)

    def measured(self, name: str, reading: float) -> None:
        """Note a cylinder's measured absolute pressure [Pa]."""
        self._measured[name].add(reading)

    def report(self, setpoints: Mapping[str, float]) -> list[str]:
        """Return warnings on values since the last report; set-points are gauge, by cylinder [Pa]."""
        return [
            *self._on_displacement(),
            *self._on_speed(),
            *self._on_setpoints(setpoints),
            *self._on_predicted(),
            *self._on_measured(),
        ]

    def _on_displacement(self) -> Iterator[str]:
        observed, reference = self._displacement.report(), self._identified.displacement
        if observed is None:
            return
        before, self._before = self._before or observed, observed
        if reference is None:
            # Only the travel counts, because the origin of an encoder is arbitrary.
            travel = max(observed[1], before[1]) - min(observed[0], before[0])
            if travel > _LONGEST_TRAVEL:
                yield f'{convention.PISTON_STATE} travels {travel:g} m, which looks like millimetres: publish metres'
            return
        farthest = max(map(abs, observed))
        if farthest > max(_UNIT_RATIO * max(map(abs, reference)), _DISPLACEMENT_ROOM):
            yield f'{convention.PISTON_STATE} reaches {farthest:g} m, which looks like millimetres: publish metres'
        elif _is_outside(observed, reference, _DISPLACEMENT_ROOM):
            yield (
                f'{convention.PISTON_STATE} is {_format_span(observed)} m, outside the identified '
                f'{_format_span(reference)} m: {_UNTESTED}'
            )

    def _on_speed(self) -> Iterator[str]:
        speed, self._speed = self._speed, 0.0
        fastest = self._identified.speed
        if fastest and speed > _SPEED_MARGIN * fastest:
            yield f'the piston moves at {speed:.3g} m/s, faster than the identified {fastest:.3g} m/s: {_UNTESTED}'

    def _on_setpoints(self, setpoints: Mapping[str, float]) -> Iterator[str]:
        for name, setpoint in setpoints.items():
            topic, identified = convention.setpoint_topic(name), self._identified.setpoints.get(name)
            reference = identified or self._operating_points.get(name)
            observed = setpoint, setpoint
            is_small = 0.0 < abs(setpoint) <= _KILOPASCAL and (reference is None or reference[0] > _KILOPASCAL)
            is_outside = reference is not None and _is_outside(observed, reference, _PRESSURE_ROOM)
            if not is_small and not is_outside:
                continue
            units = '' if reference is None else _likely_units(observed, reference)
            if is_small and identified is None:
                units = units or 'bar, psi or kPa'
            if units:
                yield f'{topic} {setpoint:g} Pa looks like {units}: publish Pa above ambient'
            elif identified is not None:
                yield f'{topic} {setpoint:.6g} Pa is outside the identified {_format_span(identified)} Pa: {_UNTESTED}'
            elif reference is not None:
                yield (
                    f'{topic} {setpoint:.6g} Pa is outside the operating points {_format_span(reference)} Pa: '
                    'the nearest gains act'
                )

    def _on_predicted(self) -> Iterator[str]:
        for name, observed, reference in self._outside_identified_range(self._predicted):
            shown, span = _format_span(observed), _format_span(reference)
            yield f'the pressure of {name} is {shown} Pa, outside the identified {span} Pa: {_UNTESTED}'

    def _on_measured(self) -> Iterator[str]:
        outside = [*self._outside_identified_range(self._measured)]
        if len(outside) == len(convention.CYLINDERS):
            (a, observed_a, reference_a), (b, observed_b, reference_b) = outside
            if not _is_outside(observed_a, reference_b, _PRESSURE_ROOM) and not _is_outside(
                observed_b, reference_a, _PRESSURE_ROOM
            ):
                yield (
                    f'the measured pressures of {a} and {b} look swapped: {_format_span(observed_a)} Pa and '
                    f'{_format_span(observed_b)} Pa, identified {_format_span(reference_a)} Pa and '
                    f'{_format_span(reference_b)} Pa: check the topics'
                )
                return
        for name, observed, reference in outside:
            absolute = observed[0] + self._ambient, observed[1] + self._ambient
            units = _likely_units(observed, reference)
            if not units and not _is_outside(absolute, reference, _PRESSURE_ROOM):
                units = 'gauge pressure'
            remedy = f'it looks like {units}, publish absolute Pa' if units else 'check the sensor and its unit'
            yield (
                f'the measured pressure of {name} is {_format_span(observed)} Pa, outside the identified '
                f'{_format_span(reference)} Pa: {remedy}'
            )

    def _outside_identified_range(self, pressures: Mapping[str, _Values]) -> Iterator[tuple[str, Span, Span]]:
        """Yield cylinders with pressures outside the identified range: name, pressures and range [Pa]."""
        for name in sorted(pressures):
            observed, reference = pressures[name].report(), self._identified.pressures.get(name)
            if observed is not None and reference is not None and _is_outside(observed, reference, _PRESSURE_ROOM):
                yield name, observed, reference


def _likely_units(observed: Span, reference: Span) -> str:
    """Return the units that bring values into a known range of pressures [Pa]; empty if no unit does."""
    scaled = {unit: (factor * observed[0], factor * observed[1]) for unit, factor in _UNITS.items()}
    return ' or '.join(unit for unit, span in scaled.items() if not _is_outside(span, reference, _PRESSURE_ROOM))


def _widened(span: Span | None, value: float) -> Span:
    return (value, value) if span is None else (min(span[0], value), max(span[1], value))


def _is_outside(observed: Span, reference: Span, room: float) -> bool:
    """Return whether values are outside a span by more than its margin and by more than `room`."""
    margin = max(_SPAN_MARGIN * (reference[1] - reference[0]), room)
    return observed[0] < reference[0] - margin or observed[1] > reference[1] + margin


def _format_span(span: Span) -> str:
    return f'{span[0]:.6g}' if span[0] == span[1] else f'{span[0]:.6g} to {span[1]:.6g}'
