# SPDX-License-Identifier: Apache-2.0
"""Whether a node's input lies within what its device was identified with, and what it looks like if not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from cfd_pneumatic import convention
from cfd_pneumatic.device import SPEED_INTERVAL, IdentifiedRange, Span

_MARGIN = 0.1  # of a span, by which a value may lie outside of it
_SPEED_MARGIN = 1.2  # times the largest speed
_PRESSURE_ROOM = 5e3  # by which a set-point or a pressure may lie outside in any case [Pa]
_DISPLACEMENT_ROOM = 2e-5  # and a displacement [m]
_LONG = 0.1  # no piston of such a device goes as far [m]
_TIMES = 20.0  # times the farthest displacement, beyond which the unit is another one
_BAR, _PSI, _KILOPASCAL = 12.0, 200.0, 1e3  # set-points up to these are likelier in these units


class InputRange:
    """
    What came since the last report, beside what the device was identified with.

    `told` says what was outside, so that a warning lasts as long as its cause.
    """

    def __init__(self, identified: IdentifiedRange) -> None:
        """Compare with what was identified."""
        self._identified = identified
        self._since: tuple[int, float] | None = None
        self._forget()

    def _forget(self) -> None:
        self._displacement: Span | None = None
        self._speed = 0.0
        self._pressures: dict[str, Span] = {}

    def sample(self, stamp: int, position: float) -> None:
        """Note a sample of the piston: its stamp [ns], and its displacement [m]; what is no number says nothing."""
        if not math.isfinite(position):
            return
        self._displacement = _widened(self._displacement, position)
        if self._since is None or stamp <= self._since[0]:
            self._since = stamp, position
            return
        elapsed = (stamp - self._since[0]) * 1e-9
        if elapsed >= SPEED_INTERVAL:
            self._speed = max(self._speed, abs(position - self._since[1]) / elapsed)
            self._since = stamp, position

    def pressures(self, names: Iterable[str], readings: Iterable[float]) -> None:
        """Note the model's absolute pressures [Pa], by cylinder."""
        for name, reading in zip(names, readings):
            self._pressures[name] = _widened(self._pressures.get(name), reading)

    def told(self, setpoints: Mapping[str, float]) -> list[str]:
        """Return in words what was outside since this was asked last; set-points are gauge, by cylinder [Pa]."""
        words = [*self._on_displacement(), *self._on_setpoints(setpoints), *self._on_pressures()]
        self._forget()
        return words

    def _on_displacement(self) -> Iterable[str]:
        seen, known = self._displacement, self._identified.displacement
        if seen is None:
            return
        farthest = max(map(abs, seen))
        usual = None if known is None else max(map(abs, known))
        if farthest > (_LONG if not usual else max(_TIMES * usual, _DISPLACEMENT_ROOM)):
            yield f'{convention.PISTON_STATE} reaches {farthest:g} m, which looks like millimetres: publish metres'
        elif known is not None and _outside(seen, known, _DISPLACEMENT_ROOM):
            yield (
                f'{convention.PISTON_STATE} is {_shown(seen)} m, outside of the identified {_shown(known)} m: '
                'the model is not known to hold there'
            )
        fastest = self._identified.speed
        if fastest and self._speed > _SPEED_MARGIN * fastest:
            yield (
                f'the piston moves at {self._speed:.3g} m/s, faster than the identified {fastest:.3g} m/s: '
                'the model is not known to hold there'
            )

    def _on_setpoints(self, setpoints: Mapping[str, float]) -> Iterable[str]:
        for name, setpoint in setpoints.items():
            topic, known = convention.setpoint_topic(name), self._identified.setpoints.get(name)
            unit = _likely_unit(setpoint)
            if unit is not None and (known is None or known[0] > _KILOPASCAL):
                yield f'{topic} {setpoint:g} Pa looks like {unit}: publish Pa above ambient'
            elif known is not None and _outside((setpoint, setpoint), known, _PRESSURE_ROOM):
                yield (
                    f'{topic} {setpoint:.0f} Pa is outside of the identified {_shown(known)} Pa: '
                    'the model is not known to hold there'
                )

    def _on_pressures(self) -> Iterable[str]:
        for name, seen in self._pressures.items():
            known = self._identified.pressures.get(name)
            if known is not None and _outside(seen, known, _PRESSURE_ROOM):
                yield (
                    f'the pressure of {name} is {_shown(seen)} Pa, outside of the identified {_shown(known)} Pa: '
                    'the model is not known to hold there'
                )


def _likely_unit(setpoint: float) -> str | None:
    """Return the unit that a set-point is likelier in than pascals; 0 is ambient pressure in every unit."""
    for unit, largest in (('bar or psi', _BAR), ('psi', _PSI), ('kPa', _KILOPASCAL)):
        if 0.0 < abs(setpoint) <= largest:
            return unit
    return None


def _widened(span: Span | None, value: float) -> Span:
    return (value, value) if span is None else (min(span[0], value), max(span[1], value))


def _outside(seen: Span, known: Span, room: float) -> bool:
    """Return whether values lie outside of a span by more than a margin, and by more than some room."""
    margin = max(_MARGIN * (known[1] - known[0]), room)
    return seen[0] < known[0] - margin or seen[1] > known[1] + margin


def _shown(span: Span) -> str:
    return f'{span[0]:.6g}' if span[0] == span[1] else f'{span[0]:.6g} to {span[1]:.6g}'
