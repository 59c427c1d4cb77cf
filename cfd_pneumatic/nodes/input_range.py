# SPDX-License-Identifier: Apache-2.0
"""Whether a node's input lies within what its device was identified with, and what it looks like if not."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

from cfd_pneumatic import convention
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.device import SPEED_INTERVAL, IdentifiedRange, Span
from cfd_pneumatic.units import PSI

_MARGIN = 0.1  # of a span, by which a value may lie outside of it
_SPEED_MARGIN = 1.2  # times the largest speed
_PRESSURE_ROOM = 5e3  # by which a set-point or a pressure may lie outside in any case [Pa]
_DISPLACEMENT_ROOM = 2e-5  # and a displacement [m]
_NOISE_ROOM = 1e-5  # by which noise may move a displacement [m]
_SHORTEST = SPEED_INTERVAL / 2  # time over which a speed is computed at least, as of a vibration [s]
_LONG = 0.1  # no piston of such a device travels as far [m]
_TIMES = 20.0  # times the farthest displacement, beyond which the unit is another one
_KILOPASCAL = 1e3  # set-points up to this are likelier in another unit [Pa]
_UNITS = {'MPa': 1e6, 'bar': 1e5, 'psi': PSI, 'kPa': 1e3, 'mbar': 1e2}  # [Pa]
_UNKNOWN = 'the model is not known to hold there'


class _Values:
    """The span of a quantity since the last report, or its last value if none came since."""

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
    Input and predicted pressures since the last report, compared with the range in which the device was identified.

    `report` returns warnings. A warning lasts as long as its cause: until another value comes.
    """

    def __init__(self, identified: IdentifiedRange) -> None:
        """Compare input with an identified range; `compare_with` sets another one."""
        self.compare_with(identified)
        self._displacement = _Values()
        self._before: Span | None = None  # displacement as of the last report
        self._lowest = self._highest = (0.0, 0)  # positions and stamps in the interval of which the speed is computed
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
        """Compare with an identified range, and with operating points if no set-points were identified [Pa]."""
        self._identified = identified
        self._ambient = ambient_pressure
        self._operating_points = operating_points or {}

    def sample(self, stamp: int, position: float) -> None:
        """Note a piston sample: its stamp [ns] and its displacement [m], unless that is not finite."""
        if not math.isfinite(position):
            return
        self._displacement.add(position)
        if stamp != self._latest:  # the model leaves repeated stamps out, too
            self._note_speed(stamp, position)

    def _note_speed(self, stamp: int, position: float) -> None:
        """Compute the speed if an interval has ended: the travel in it over the time between lowest and highest."""
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
        seen, known = self._displacement.report(), self._identified.displacement
        if seen is None:
            return
        before, self._before = self._before or seen, seen
        if known is None:
            # Only the travel counts: an encoder may count from anywhere.
            travel = max(seen[1], before[1]) - min(seen[0], before[0])
            if travel > _LONG:
                yield f'{convention.PISTON_STATE} travels {travel:g} m, which looks like millimetres: publish metres'
            return
        farthest = max(map(abs, seen))
        if farthest > max(_TIMES * max(map(abs, known)), _DISPLACEMENT_ROOM):
            yield f'{convention.PISTON_STATE} reaches {farthest:g} m, which looks like millimetres: publish metres'
        elif _outside(seen, known, _DISPLACEMENT_ROOM):
            span = _shown(known)
            yield f'{convention.PISTON_STATE} is {_shown(seen)} m, outside of the identified {span} m: {_UNKNOWN}'

    def _on_speed(self) -> Iterator[str]:
        speed, self._speed = self._speed, 0.0
        fastest = self._identified.speed
        if fastest and speed > _SPEED_MARGIN * fastest:
            yield f'the piston moves at {speed:.3g} m/s, faster than the identified {fastest:.3g} m/s: {_UNKNOWN}'

    def _on_setpoints(self, setpoints: Mapping[str, float]) -> Iterator[str]:
        for name, setpoint in setpoints.items():
            topic, identified = convention.setpoint_topic(name), self._identified.setpoints.get(name)
            known = identified or self._operating_points.get(name)
            seen = setpoint, setpoint
            is_small = 0.0 < abs(setpoint) <= _KILOPASCAL and (known is None or known[0] > _KILOPASCAL)
            is_outside = known is not None and _outside(seen, known, _PRESSURE_ROOM)
            if not is_small and not is_outside:
                continue
            units = '' if known is None else _likely_units(seen, known)
            if is_small and identified is None:
                units = units or 'bar, psi or kPa'
            if units:
                yield f'{topic} {setpoint:g} Pa looks like {units}: publish Pa above ambient'
            elif identified is not None:
                yield f'{topic} {setpoint:.6g} Pa is outside of the identified {_shown(identified)} Pa: {_UNKNOWN}'
            elif known is not None:
                yield (
                    f'{topic} {setpoint:.6g} Pa is outside the operating points {_shown(known)} Pa: '
                    'the nearest gains act'
                )

    def _on_predicted(self) -> Iterator[str]:
        for name, seen, known in self._outside_of_identified(self._predicted):
            span = _shown(known)
            yield f'the pressure of {name} is {_shown(seen)} Pa, outside of the identified {span} Pa: {_UNKNOWN}'

    def _on_measured(self) -> Iterator[str]:
        outside = [*self._outside_of_identified(self._measured)]
        if len(outside) == len(convention.CYLINDERS):
            (a, seen_a, known_a), (b, seen_b, known_b) = outside
            if not _outside(seen_a, known_b, _PRESSURE_ROOM) and not _outside(seen_b, known_a, _PRESSURE_ROOM):
                yield (
                    f'the measured pressures of {a} and {b} look swapped: {_shown(seen_a)} Pa and {_shown(seen_b)} Pa, '
                    f'identified {_shown(known_a)} Pa and {_shown(known_b)} Pa'
                )
                return
        for name, seen, known in outside:
            absolute = seen[0] + self._ambient, seen[1] + self._ambient
            units = _likely_units(seen, known)
            if not units and not _outside(absolute, known, _PRESSURE_ROOM):
                units = 'gauge pressure'
            remedy = f'it looks like {units}, publish absolute Pa' if units else 'check the sensor and its unit'
            yield (
                f'the measured pressure of {name} is {_shown(seen)} Pa, outside of the identified {_shown(known)} Pa: '
                f'{remedy}'
            )

    def _outside_of_identified(self, pressures: Mapping[str, _Values]) -> Iterator[tuple[str, Span, Span]]:
        """Yield the cylinders whose pressures are outside of the identified range: name, pressures and range [Pa]."""
        for name in sorted(pressures):
            seen, known = pressures[name].report(), self._identified.pressures.get(name)
            if seen is not None and known is not None and _outside(seen, known, _PRESSURE_ROOM):
                yield name, seen, known


def _likely_units(seen: Span, known: Span) -> str:
    """Return the units that bring values into a known range of pressures [Pa]; an empty text if none does."""
    scaled = {unit: (factor * seen[0], factor * seen[1]) for unit, factor in _UNITS.items()}
    return ' or '.join(unit for unit, span in scaled.items() if not _outside(span, known, _PRESSURE_ROOM))


def _widened(span: Span | None, value: float) -> Span:
    return (value, value) if span is None else (min(span[0], value), max(span[1], value))


def _outside(seen: Span, known: Span, room: float) -> bool:
    """Return whether values lie outside of a span by more than a margin, and by more than some room."""
    margin = max(_MARGIN * (known[1] - known[0]), room)
    return seen[0] < known[0] - margin or seen[1] > known[1] + margin


def _shown(span: Span) -> str:
    return f'{span[0]:.6g}' if span[0] == span[1] else f'{span[0]:.6g} to {span[1]:.6g}'
