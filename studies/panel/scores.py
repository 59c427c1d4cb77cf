# SPDX-License-Identifier: Apache-2.0
"""Score the loop's answers to the panel's recordings, and compare the scores with the goals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.stats import binomtest

from cfd_pneumatic.model import EFFECTS
from studies.panel import NOISES, OWN_WAYS
from studies.panel.rows import SCHEDULES, Row, make_of

Item = TypeVar('Item')

FLOOR_TOLERANCE = 0.05
"""Largest relative deviation of the loop's noise floor from the oracle's [-]."""

WHOLE_TOLERANCE = 1.10
"""Ratio of the error after to the oracle's error up to which an answer is whole [-]."""

FAMILIES: dict[str, tuple[str, ...]] = {
    family: tuple(name for name, effect in EFFECTS.items() if family in effect.families)
    for family in dict.fromkeys(family for effect in EFFECTS.values() for family in effect.families)
}
"""Effects that a recording may not distinguish, by the name of their family."""

GROUPS = tuple(FAMILIES.items())
"""Families that data may not separate: an alternative within a family is a right answer."""


def is_listed_pair(first: str, second: str) -> bool:
    """Return whether data may not separate two effects."""
    return any(first in names and second in names for _, names in GROUPS)


RIGHT = ('right', 'listed alternative')
"""Answers that the goals count as right."""


def answer(row: Row) -> str:
    """Return the class of the first named effect for a recording with one effect."""
    (true,) = row.effects
    if not row.named:
        return 'no name'
    first = row.named[0]
    if first == true:
        return 'right'
    if true in row.alternatives.get(first, ()):
        return 'listed alternative' if is_listed_pair(first, true) else 'unlisted alternative'
    return 'wrong name'


def found_both(row: Row, alternatives: bool = False) -> bool:
    """Return whether both effects of a pair are named, or are listed alternatives if `alternatives` is set."""
    return any(
        all(
            name == true or (alternatives and is_listed_pair(name, true) and true in row.alternatives.get(name, ()))
            for name, true in zip(names, row.effects)
        )
        for names in itertools.permutations(row.named, len(row.effects))
    )


def found_exactly(row: Row, alternatives: bool = False) -> bool:
    """Return whether the effects of a pair are named and no other effect is."""
    return len(row.named) == len(row.effects) and found_both(row, alternatives)


def accounts_for_each(row: Row, hidden: bool = False) -> bool:
    """Return whether each effect is named or a listed alternative to a name; or listed as not visible, if `hidden`."""
    return all(
        (hidden and true in row.not_visible)
        or any(
            name == true or (is_listed_pair(name, true) and true in row.alternatives.get(name, ()))
            for name in row.named
        )
        for true in row.effects
    )


def is_right(row: Row) -> bool:
    return answer(row) in RIGHT


def is_named(row: Row) -> bool:
    return bool(row.named)


def is_unexplained(row: Row) -> bool:
    return row.verdict == 'unexplained'


def is_among_names(row: Row) -> bool:
    """Return whether the effect, or a name with the effect as listed alternative, is among the names."""
    (true,) = row.effects
    return any(
        name == true or (is_listed_pair(name, true) and true in row.alternatives.get(name, ())) for name in row.named
    )


def is_whole(row: Row) -> bool:
    """Return whether an answer is right as a whole: a single name, noise as residual, an error near the floor."""
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


def share(items: Sequence[Item], passes: Callable[[Item], bool]) -> Share:
    """Return the share of items that pass a test."""
    return Share(sum(map(passes, items)), len(items))


class Goal(NamedTuple):
    """A goal and its measured value."""

    description: str
    wanted: str
    measured: str
    recordings: int
    met: bool


def _by_make(rows: Sequence[Row]) -> list[tuple[list[Row], str]]:
    """Return the rows of all makes, and the rows of makes in `OWN_WAYS`."""
    unlike_core = [row for row in rows if make_of(row.kind, row.seed) in OWN_WAYS]
    return [(list(rows), 'all makes'), (unlike_core, 'makes unlike the core')]


def goals(rows: Sequence[Row]) -> list[Goal]:
    """Return the goals for which there are rows."""
    reached = []

    def add_goal(
        description: str, group: Sequence[Row], passes: Callable[[Row], bool], least: float = 0, most: float = 1
    ) -> None:
        if group:
            part = share(group, passes)
            limit = f'at least {100 * least:.0f} %' if least else f'at most {100 * most:.0f} %'
            reached.append(Goal(description, limit, str(part), part.total, least <= part.value <= most))

    def visible(kind: str) -> list[Row]:
        return [row for row in rows if row.kind == kind and row.visible]

    first_name = 'right name first, or a listed alternative; visible draws'
    for schedule in SCHEDULES:
        group = [row for row in visible('effects') if row.schedule == schedule]
        add_goal(f'{first_name}, `{schedule}`', group, is_right, least=0.90 if schedule == 'paper_step' else 0.95)
    errors = [row.after_test for row in visible('effects') if math.isfinite(row.after_test)]
    if errors:
        for name, quantile, most in (('median', 0.5, 1.03), ('90th percentile', 0.9, 1.10)):
            value = float(np.quantile(errors, quantile))
            description = f"test error after (a step's: whole) over the oracle floor, {name}; visible draws"
            reached.append(Goal(description, f'at most {most:.2f}', f'{value:.3f}', len(errors), value <= most))
    floors = [row for row in rows if row.kind == 'effects' and math.isfinite(row.noise)]
    if floors:
        value = float(np.median([row.noise for row in floors]))
        description = "the report's noise floor over the oracle's; all draws with one effect"
        measured = f'median {value:.3f}; {share(floors, is_near_the_floor)} of the draws within 5 %'
        reached.append(Goal(description, 'within 5 %', measured, len(floors), abs(value - 1.0) <= FLOOR_TOLERANCE))
    for noise in NOISES:
        group = [row for row in rows if row.kind == 'clean' and row.effects == (noise,)]
        add_goal(f'clean textbook recordings, {noise} noise: a name', group, is_named, most=0.02)
    healthy = [row for row in rows if row.kind == 'clean_force']
    add_goal('contact force of healthy devices: a name', healthy, is_named, most=0.02)
    unknown = 'effects outside the library: `unexplained`; visible draws'
    add_goal(unknown, visible('foreign'), is_unexplained, least=0.90)
    add_goal(f'contact force: {first_name}', visible('force'), is_right, least=0.90)
    late = [row for row in rows if row.kind == 'command']
    text = 'a set-point that acts 15 to 60 ms late'
    add_goal(f'{text}: each effect named, or a listed alternative', late, accounts_for_each, least=0.90)
    weak = [row for row in rows if row.kind == 'weak_command']
    text = 'a set-point that acts 1 to 15 ms late'
    add_goal(f'{text}: named, or listed as not visible', weak, partial(accounts_for_each, hidden=True), least=0.90)
    for group, makes in _by_make(visible('whole')):
        add_goal(
            f'full physics, one effect, {makes}: right among the names; visible draws',
            group,
            is_among_names,
            least=0.97,
        )
        add_goal(f'full physics, one effect, {makes}: whole answer right; the same draws', group, is_whole, least=0.85)
    for group, makes in _by_make([row for row in rows if row.kind == 'healthy_whole']):
        add_goal(f'full physics, healthy, {makes}: an effect named', group, is_named, most=0.0)
        add_goal(f'full physics, healthy, {makes}: nothing missing', group, is_silent, least=0.90)
    pairs = [row for row in rows if row.kind == 'pairs' and row.both_visible]
    add_goal('two effects: both found; pairs with both visible', pairs, found_both, least=0.85)
    add_goal('two effects: exactly both; the same pairs', pairs, found_exactly, least=0.75)
    return reached
