# SPDX-License-Identifier: Apache-2.0
"""
The motions that a schedule is put together from.

Each begins and ends at rest at home, so that any of them may follow any other and what they tell adds up. Positions
are shares of the stroke, speeds of the speed limit, levels of the way from a cylinder's own set-point to the farther
end of the pressure range, rests of the time in which a pressure settles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Move(NamedTuple):
    """The piston goes somewhere and rests there."""

    to: float
    speed: float = 1.0
    rest: float = 1.0


class Turn(NamedTuple):
    """The set-points of both cylinders change at once, and everything rests."""

    cylinder_a: float
    cylinder_b: float
    rest: float = 1.0


Step = Move | Turn


@dataclass(frozen=True)
class Segment:
    """
    A motion with a name.

    Attributes
    ----------
    name
        What it is, for people.
    steps
        One after the other.

    """

    name: str
    steps: tuple[Step, ...]

    @property
    def turns(self) -> bool:
        """Whether set-points change in it."""
        return any(isinstance(step, Turn) for step in self.steps)


_HOME = Turn(0.0, 0.0)
_LEVELS = {'A': (1.0, 0.0), 'B': (0.0, 1.0), 'A and B': (1.0, 1.0)}
_SPEEDS = {'fast': 1.0, 'medium': 0.25, 'slow': 0.05, 'creeping': 0.01}


def _stroke(reach: float, speed: float) -> tuple[Move, ...]:
    return Move(reach, speed), Move(0.0, speed)


def _reversals(base: float, width: float, count: int) -> tuple[Move, ...]:
    """Return quick small strokes without rests about a place."""
    there_and_back = (Move(base + width, rest=0.0), Move(base, rest=0.0)) * count
    arrival = (Move(base, rest=0.5),) if base else ()
    return (*arrival, *there_and_back[:-1], there_and_back[-1]._replace(rest=1.0), *((Move(0.0),) if base else ()))


def _sweep() -> tuple[Move, ...]:
    """Return strokes at full speed, each half as long as the last one: the frequency rises."""
    turns = [Move(at, rest=0.0) for reach in (1.0, 0.5, 0.25, 0.125, 0.0625) for at in (reach, 0.0)]
    return (*turns[:-1], turns[-1]._replace(rest=1.0))


def _staircase(steps: int) -> tuple[Move, ...]:
    """Return the steps of a gauge block, out one by one and back likewise."""
    heights = [step / steps for step in (*range(1, steps + 1), *range(steps - 1, -1, -1))]
    return tuple(Move(height) for height in heights)


def family() -> tuple[Segment, ...]:
    """Return every segment that a schedule may hold."""
    at_rest = [
        *(
            Segment(f'{name} stroke of {reach:.0%}', _stroke(reach, speed))
            for reach in (1.0, 0.3)
            for name, speed in _SPEEDS.items()
        ),
        *(
            Segment(f'reversals of {width:.0%} at {base:.0%}', _reversals(base, width, 6))
            for width in (0.03, 0.1, 0.3)
            for base in (0.0, 0.6)
        ),
        Segment('sweep', _sweep()),
        Segment('gauge block in 4 steps', _staircase(4)),
    ]
    raised = [
        Segment(f'{one.name}, {who} raised', (Turn(*levels), *one.steps, _HOME))
        for one in at_rest
        if one.name in ('fast stroke of 100%', 'slow stroke of 100%', 'fast stroke of 30%', 'sweep')
        for who, levels in _LEVELS.items()
    ]
    stepped = [
        Segment(f'set-point step of {size:.0%}, {who}', (Turn(size * a, size * b), _HOME))
        for size in (1.0, 0.3, 0.1)
        for who, (a, b) in _LEVELS.items()
    ]
    return (*at_rest, *raised, *stepped)
