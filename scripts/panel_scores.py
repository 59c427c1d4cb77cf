"""How the answers to the panel's recordings count, and the goals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from panel_rows import SCHEDULES, Row

from cfd_pneumatic.model.effects import FAMILIES
from cfd_pneumatic.rig.panel import LIBRARY, NOISES, ON_FORCE

FLOOR_TOLERANCE = 0.05

GROUPS = tuple(
    (family, found)
    for family, found in (
        (family, tuple(name for name in (*LIBRARY, *ON_FORCE) if name in names)) for family, names in FAMILIES.items()
    )
    if found
)
"""Effects that data may not separate, by their physics: a tie among these is a right answer."""


def listed(one: str, other: str) -> bool:
    """Return whether two effects are listed as a pair that data may not separate."""
    return any(one in names and other in names for _, names in GROUPS)


ANSWERS = ('right', 'listed alternative', 'unlisted alternative', 'wrong name', 'no name')

RIGHT = ANSWERS[:2]
"""Answers that the goals count as right."""


def answer(row: Row) -> str:
    """Return how the first name answers for a recording with one effect."""
    (true,) = row.effects
    if not row.named:
        return 'no name'
    first = row.named[0]
    if first == true:
        return 'right'
    if true in row.alternatives.get(first, ()):
        return 'listed alternative' if listed(first, true) else 'unlisted alternative'
    return 'wrong name'


def found_both(row: Row, alternatives: bool = False) -> bool:
    """Return whether both effects of a pair are named; alternatives of listed pairs count where that is asked for."""
    return any(
        all(
            name == true or (alternatives and listed(name, true) and true in row.alternatives.get(name, ()))
            for name, true in zip(names, row.effects)
        )
        for names in itertools.permutations(row.named, len(row.effects))
    )


class Share(NamedTuple):
    """A share with its 95 % interval (Wilson, 1927)."""

    count: int
    total: int

    @property
    def value(self) -> float:
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        if not self.total:
            return math.nan, math.nan
        z2 = 1.959964**2
        centre = (self.count + 0.5 * z2) / (self.total + z2)
        half = math.sqrt(z2 * (self.count * (1.0 - self.value) + 0.25 * z2)) / (self.total + z2)
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        if not self.total:
            return '-'
        low, high = self.interval
        return f'{100 * self.value:.1f} % ({self.count}/{self.total}; {100 * low:.0f} to {100 * high:.0f})'


def share(rows: Iterable[Row], passes: Callable[[Row], bool]) -> Share:
    """Return the share of rows that pass."""
    passed = [passes(row) for row in rows]
    return Share(sum(passed), len(passed))


class Goal(NamedTuple):
    """A goal beside what was measured."""

    what: str
    wanted: str
    measured: str
    recordings: int
    met: bool


def goals(rows: Sequence[Row]) -> list[Goal]:
    """Return the goals that these rows can tell of."""
    singles = [row for row in rows if row.kind == 'effects' and row.visible]
    found = []

    def at_least(what: str, least: float, some: Sequence[Row], passes: Callable[[Row], bool]) -> None:
        if some:
            part = share(some, passes)
            found.append(Goal(what, f'at least {100 * least:.0f} %', str(part), part.total, part.value >= least))

    for schedule in SCHEDULES:
        at_least(
            f'right name first, or a listed alternative; visible draws, `{schedule}`',
            0.90 if schedule == 'paper_step' else 0.95,
            [row for row in singles if row.schedule == schedule],
            lambda row: answer(row) in RIGHT,
        )
    errors = [row.after_test for row in singles if math.isfinite(row.after_test)]
    if errors:
        for name, quantile, most in (('median', 0.5, 1.03), ('90th percentile', 0.9, 1.10)):
            value = float(np.quantile(errors, quantile))
            what = f"test error after (a step's: whole) over the oracle floor, {name}; visible draws"
            found.append(Goal(what, f'at most {most:.2f}', f'{value:.3f}', len(errors), value <= most))
    floors = [row for row in rows if row.kind == 'effects' and math.isfinite(row.noise)]
    if floors:
        value = float(np.median([row.noise for row in floors]))
        near = share(floors, lambda row: abs(row.noise - 1.0) <= FLOOR_TOLERANCE)
        found.append(
            Goal(
                "the report's noise floor over the oracle's; all draws with one effect",
                'within 5 %',
                f'median {value:.3f}; {near} of the draws within 5 %',
                len(floors),
                abs(value - 1.0) <= FLOOR_TOLERANCE,
            )
        )
    for noise in NOISES:
        some = [row for row in rows if row.kind == 'clean' and row.effects == (noise,)]
        if some:
            part = share(some, lambda row: bool(row.named))
            what = f'clean textbook recordings, {noise} noise: a name'
            found.append(Goal(what, 'at most 2 %', str(part), part.total, part.value <= 0.02))
    some = [row for row in rows if row.kind == 'clean_force']
    if some:
        part = share(some, lambda row: bool(row.named))
        what = 'contact force of healthy devices: a name'
        found.append(Goal(what, 'at most 2 %', str(part), part.total, part.value <= 0.02))
    for kind, what, least in (
        ('foreign', 'effects outside the library: `unexplained`; visible draws', 0.90),
        ('leave_one_out', 'leave-one-out: `unexplained`; visible draws', 0.80),
    ):
        some = [row for row in rows if row.kind == kind and row.visible]
        at_least(what, least, some, lambda row: row.verdict == 'unexplained')
    at_least(
        'contact force: right name first, or a listed alternative; visible draws',
        0.90,
        [row for row in rows if row.kind == 'force' and row.visible],
        lambda row: answer(row) in RIGHT,
    )
    pairs = [row for row in rows if row.kind == 'pairs' and row.both_visible]
    at_least('two effects: both found; pairs that show beside each other', 0.85, pairs, found_both)
    at_least(
        'two effects: exactly the two; the same pairs',
        0.75,
        pairs,
        lambda row: len(row.named) == 2 and found_both(row),
    )
    return found
