# SPDX-License-Identifier: Apache-2.0
"""How the answers to the panel's recordings count, and the goals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.stats import binomtest

from cfd_pneumatic.model import EFFECTS
from studies.panel import NOISES, OWN_WAYS
from studies.panel.rows import SCHEDULES, Row, make_of

One = TypeVar('One')

FLOOR_TOLERANCE = 0.05

WHOLE_TOLERANCE = 1.10
"""Error over the true device's up to which an answer is a whole one."""

FAMILIES: dict[str, tuple[str, ...]] = {
    family: tuple(name for name, effect in EFFECTS.items() if family in effect.families)
    for family in dict.fromkeys(family for effect in EFFECTS.values() for family in effect.families)
}
"""Effects that a recording may not tell from each other, by the name of what they have in common."""

GROUPS = tuple(FAMILIES.items())
"""Effects that data may not separate, by their physics: a tie among these is a right answer."""


def listed(one: str, other: str) -> bool:
    """Return whether two effects are listed as a pair that data may not separate."""
    return any(one in names and other in names for _, names in GROUPS)


RIGHT = ('right', 'listed alternative')
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


def found_exactly(row: Row, alternatives: bool = False) -> bool:
    """Return whether both effects of a pair are named, and nothing else."""
    return len(row.named) == len(row.effects) and found_both(row, alternatives)


def is_right(row: Row) -> bool:
    return answer(row) in RIGHT


def is_named(row: Row) -> bool:
    return bool(row.named)


def is_unexplained(row: Row) -> bool:
    return row.verdict == 'unexplained'


def is_among_names(row: Row) -> bool:
    """Return whether the one effect is named, or listed beside a name that data may not separate from it."""
    (true,) = row.effects
    return any(name == true or (listed(name, true) and true in row.alternatives.get(name, ())) for name in row.named)


def is_whole(row: Row) -> bool:
    """Return whether all of an answer is right: one name, noise left, an error like that of the true device."""
    right = is_among_names(row) and len(row.named) == 1 and row.verdict == 'effect_added'
    return right and row.after_test <= WHOLE_TOLERANCE


def is_silent(row: Row) -> bool:
    return row.verdict == 'no_missing_effect'


def is_near_the_floor(row: Row) -> bool:
    return abs(row.noise - 1.0) <= FLOOR_TOLERANCE


class Share(NamedTuple):
    """A share with its 95 % interval (Wilson, 1927)."""

    counted: int
    total: int

    @property
    def value(self) -> float:
        return self.counted / self.total

    @property
    def interval(self) -> tuple[float, float]:
        return binomtest(self.counted, self.total).proportion_ci(method='wilson')

    def __str__(self) -> str:
        if not self.total:
            return '-'
        low, high = self.interval
        return f'{100 * self.value:.1f} % ({self.counted}/{self.total}; {100 * low:.0f} to {100 * high:.0f})'


def share(rows: Sequence[One], passes: Callable[[One], bool]) -> Share:
    """Return the share of some that pass."""
    return Share(sum(map(passes, rows)), len(rows))


class Goal(NamedTuple):
    """A goal beside what was measured."""

    what: str
    wanted: str
    measured: str
    recordings: int
    met: bool


def _by_make(rows: Sequence[Row]) -> list[tuple[list[Row], str]]:
    """Return rows of all makes, and of those that go ways of their own."""
    own = [row for row in rows if make_of(row.kind, row.seed) in OWN_WAYS]
    return [(list(rows), 'all makes'), (own, 'makes that the core is not')]


def goals(rows: Sequence[Row]) -> list[Goal]:
    """Return the goals that these rows can tell of."""
    found = []

    def aim(what: str, some: Sequence[Row], passes: Callable[[Row], bool], least: float = 0, most: float = 1) -> None:
        if some:
            part = share(some, passes)
            limit = f'at least {100 * least:.0f} %' if least else f'at most {100 * most:.0f} %'
            found.append(Goal(what, limit, str(part), part.total, least <= part.value <= most))

    def visible(kind: str) -> list[Row]:
        return [row for row in rows if row.kind == kind and row.visible]

    first_name = 'right name first, or a listed alternative; visible draws'
    for schedule in SCHEDULES:
        some = [row for row in visible('effects') if row.schedule == schedule]
        aim(f'{first_name}, `{schedule}`', some, is_right, least=0.90 if schedule == 'paper_step' else 0.95)
    errors = [row.after_test for row in visible('effects') if math.isfinite(row.after_test)]
    if errors:
        for name, quantile, most in (('median', 0.5, 1.03), ('90th percentile', 0.9, 1.10)):
            value = float(np.quantile(errors, quantile))
            what = f"test error after (a step's: whole) over the oracle floor, {name}; visible draws"
            found.append(Goal(what, f'at most {most:.2f}', f'{value:.3f}', len(errors), value <= most))
    floors = [row for row in rows if row.kind == 'effects' and math.isfinite(row.noise)]
    if floors:
        value = float(np.median([row.noise for row in floors]))
        what = "the report's noise floor over the oracle's; all draws with one effect"
        measured = f'median {value:.3f}; {share(floors, is_near_the_floor)} of the draws within 5 %'
        found.append(Goal(what, 'within 5 %', measured, len(floors), abs(value - 1.0) <= FLOOR_TOLERANCE))
    for noise in NOISES:
        some = [row for row in rows if row.kind == 'clean' and row.effects == (noise,)]
        aim(f'clean textbook recordings, {noise} noise: a name', some, is_named, most=0.02)
    healthy = [row for row in rows if row.kind == 'clean_force']
    aim('contact force of healthy devices: a name', healthy, is_named, most=0.02)
    unknown = 'effects outside the library: `unexplained`; visible draws'
    aim(unknown, visible('foreign'), is_unexplained, least=0.90)
    aim(f'contact force: {first_name}', visible('force'), is_right, least=0.90)
    for some, which in _by_make(visible('whole')):
        aim(
            f'full physics, one effect, {which}: right among the names; visible draws', some, is_among_names, least=0.97
        )
        aim(f'full physics, one effect, {which}: the whole answer; the same draws', some, is_whole, least=0.85)
    for some, which in _by_make([row for row in rows if row.kind == 'healthy_whole']):
        aim(f'full physics, healthy, {which}: a part blamed', some, is_named, most=0.0)
        aim(f'full physics, healthy, {which}: nothing missing', some, is_silent, least=0.90)
    pairs = [row for row in rows if row.kind == 'pairs' and row.both_visible]
    aim('two effects: both found; pairs that show beside each other', pairs, found_both, least=0.85)
    aim('two effects: exactly the two; the same pairs', pairs, found_exactly, least=0.75)
    return found
