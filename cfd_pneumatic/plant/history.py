# SPDX-License-Identifier: Apache-2.0
"""What the rows of a plant say of each device: how it is now, and when that changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from cfd_pneumatic.plant.result_table import FAILED, Row

NOT_ESTIMATED = (FAILED, 'insufficient_data')
"""Verdicts that say nothing of the device: the next ones are compared with what was known before."""

FEWEST_DEVICES = 3
"""That may have something in common."""


@dataclass(frozen=True)
class Change:
    """A bag's verdict that is another than the one before it, by their rows."""

    before: Row
    after: Row


@dataclass(frozen=True)
class Part:
    """
    A cylinder of a device, or its contact force.

    Attributes
    ----------
    name
        `cylinder_a`, `cylinder_b` or `force`.
    rows
        In the order of the recordings.
    changes
        Of the verdict.

    """

    name: str
    rows: tuple[Row, ...]
    changes: tuple[Change, ...]

    @property
    def now(self) -> Row:
        """The last row that says something of the device; the last one where none does."""
        return next((row for row in reversed(self.rows) if row['verdict'] not in NOT_ESTIMATED), self.rows[-1])


@dataclass(frozen=True)
class Device:
    """
    A device.

    Attributes
    ----------
    name
        Of the device.
    bags
        The rows of each of its bags, in the order of the recordings.
    parts
        What was identified of it.

    """

    name: str
    bags: tuple[tuple[Row, ...], ...]
    parts: tuple[Part, ...]

    @property
    def failures(self) -> list[Row]:
        """The rows of the bags that failed."""
        return [row for rows in self.bags for row in rows if row['verdict'] == FAILED]

    @property
    def changes(self) -> list[Change]:
        """All changes of its verdicts."""
        return [change for part in self.parts for change in part.changes]


def devices(rows: Sequence[Row]) -> list[Device]:
    """Return the devices of a plant; the rows are in the order of the table."""
    return [_device(name, list(own)) for name, own in groupby(rows, key=lambda row: str(row['device']))]


def effects_of(row: Row) -> list[str]:
    """Return the effects that a row names."""
    return list(filter(None, (row.get('effects') or '').split(';')))


def named_by(row: Row) -> list[str]:
    """Return the effects that a row names, and the law that was drawn."""
    return [*effects_of(row), *filter(None, [row.get('law')])]


def named_on_all(plant: Sequence[Device]) -> list[str]:
    """Return the effects and laws that every device's last bags show: the set-up's rather than one device's."""
    if len(plant) < FEWEST_DEVICES:
        return []
    shown = [{name for part in device.parts for name in named_by(part.now)} for device in plant]
    return sorted(set.intersection(*shown))


def _device(name: str, rows: Sequence[Row]) -> Device:
    bags = [tuple(own) for _, own in groupby(rows, key=lambda row: str(row['bag']))]
    names = dict.fromkeys(row['part'] for row in sorted(rows, key=lambda row: str(row['part'])) if row['part'])
    parts = []
    for part in names:
        own_rows = tuple(row for row in rows if row['part'] == part)
        parts.append(Part(part, own_rows, tuple(_changes(own_rows))))
    return Device(name, tuple(bags), tuple(parts))


def _changes(rows: Sequence[Row]) -> Iterator[Change]:
    told = [row for row in rows if row['verdict'] not in NOT_ESTIMATED]
    return (Change(before, after) for before, after in pairwise(told) if _differ(before, after))


def _differ(before: Row, after: Row) -> bool:
    """
    Return whether two verdicts differ, or the effects they name by more than the recordings can tell apart.

    Where something stays unexplained, the effects found beside it are no verdict: another bag may name others.
    """
    if before['verdict'] != after['verdict']:
        return True
    if after['verdict'] == 'unexplained':
        return False
    earlier, later = set(effects_of(before)), set(effects_of(after))
    alike = later <= earlier | _rivals(before) or earlier <= later | _rivals(after)
    return len(earlier) != len(later) or not alike


def _rivals(row: Row) -> set[str]:
    return set(filter(None, (row.get('alternatives') or '').split(';')))
