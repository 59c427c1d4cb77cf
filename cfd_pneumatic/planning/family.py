# SPDX-License-Identifier: Apache-2.0
"""
Define the segments of which a schedule is composed.

Each segment begins and ends at rest at home, so that segments may follow in any order and their information adds up.
Positions are shares of the stroke, and speeds are shares of the speed limit. Levels are shares of the way from the home
set-point to the farther end of the pressure range. Rests are multiples of the settling time of the pressure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Move(NamedTuple):
    """The piston moves to a position and rests there."""

    to: float
    speed: float = 1.0
    rest: float = 1.0


class Turn(NamedTuple):
    """The set-points of both cylinders change together, and the piston rests."""

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
        Name, for people.
    steps
        Steps in succession.

    """

    name: str
    steps: tuple[Step, ...]

    @property
    def turns(self) -> bool:
        """Whether the segment changes set-points."""
        return any(isinstance(step, Turn) for step in self.steps)


_HOME = Turn(0.0, 0.0)
_LEVELS = {'A': (1.0, 0.0), 'B': (0.0, 1.0), 'A and B': (1.0, 1.0)}
_SPEEDS = {'fast': 1.0, 'medium': 0.25, 'slow': 0.05, 'creeping': 0.01}


def _stroke(reach: float, speed: float) -> tuple[Move, ...]:
    return Move(reach, speed), Move(0.0, speed)


def _reversals(base: float, width: float, count: int) -> tuple[Move, ...]:
    """Return quick small strokes without rests from a base position."""
    there_and_back = (Move(base + width, rest=0.0), Move(base, rest=0.0)) * count
    arrival = (Move(base, rest=0.5),) if base else ()
    return (*arrival, *there_and_back[:-1], there_and_back[-1]._replace(rest=1.0), *((Move(0.0),) if base else ()))


def _sweep() -> tuple[Move, ...]:
    """Return strokes at full speed, each half as long as the previous stroke: the frequency rises."""
    turns = [Move(end, rest=0.0) for reach in (1.0, 0.5, 0.25, 0.125, 0.0625) for end in (reach, 0.0)]
    return (*turns[:-1], turns[-1]._replace(rest=1.0))


def _staircase(steps: int) -> tuple[Move, ...]:
    """Return the steps of a gauge block, out and back in equal steps."""
    heights = [step / steps for step in (*range(1, steps + 1), *range(steps - 1, -1, -1))]
    return tuple(Move(height) for height in heights)


def family() -> tuple[Segment, ...]:
    """Return every segment that a schedule may contain."""
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
        Segment(f'{segment.name}, {cylinders} raised', (Turn(*levels), *segment.steps, _HOME))
        for segment in at_rest
        if segment.name in ('fast stroke of 100%', 'slow stroke of 100%', 'fast stroke of 30%', 'sweep')
        for cylinders, levels in _LEVELS.items()
    ]
    stepped = [
        Segment(f'set-point step of {size:.0%}, {cylinders}', (Turn(size * a, size * b), _HOME))
        for size in (1.0, 0.3, 0.1)
        for cylinders, (a, b) in _LEVELS.items()
    ]
    return (*at_rest, *raised, *stepped)
