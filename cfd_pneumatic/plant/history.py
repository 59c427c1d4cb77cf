# SPDX-License-Identifier: Apache-2.0
"""The history of each device in the result table: the latest verdicts, and the changes of the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from cfd_pneumatic.plant.result_table import FAILED, Row

NOT_ESTIMATED = (FAILED, 'insufficient_data')
"""Verdicts without information about the device. They are skipped when consecutive verdicts are compared."""

FEWEST_DEVICES = 3
"""Fewest devices for which common effects are reported."""


@dataclass(frozen=True)
class Change:
    """A change of the verdict between two bags: the rows before and after."""

    before: Row
    after: Row


@dataclass(frozen=True)
class Part:
    """
    A cylinder of a device, or the contact force of a device.

    Attributes
    ----------
    name
        `cylinder_a`, `cylinder_b` or `force`.
    rows
        Rows in the order of the recordings.
    changes
        Changes of the verdict.

    """

    name: str
    rows: tuple[Row, ...]
    changes: tuple[Change, ...]

    @property
    def latest(self) -> Row:
        """The last row with information about the device, or the last row if no row has information."""
        return next((row for row in reversed(self.rows) if row['verdict'] not in NOT_ESTIMATED), self.rows[-1])


@dataclass(frozen=True)
class Device:
    """
    A device of a plant.

    Attributes
    ----------
    name
        Name of the device.
    bags
        Rows of each bag, in the order of the recordings.
    parts
        Identified parts of the device.

    """

    name: str
    bags: tuple[tuple[Row, ...], ...]
    parts: tuple[Part, ...]

    @property
    def failures(self) -> list[Row]:
        """The rows of the failed bags."""
        return [row for rows in self.bags for row in rows if row['verdict'] == FAILED]

    @property
    def changes(self) -> list[Change]:
        """Return the changes of the verdicts from bag to bag, on all parts."""
        return [change for part in self.parts for change in part.changes]


def devices(rows: Sequence[Row]) -> list[Device]:
    """Return the devices of a plant from its rows, which are in the order of the table."""
    return [_device(name, list(device_rows)) for name, device_rows in groupby(rows, key=lambda row: str(row['device']))]


def effects_of(row: Row) -> list[str]:
    """Return the effects in a row."""
    return list(filter(None, (row.get('effects') or '').split(';')))


def findings_of(row: Row) -> list[str]:
    """Return the effects and the estimated curve in a row."""
    return [*effects_of(row), *filter(None, [row.get('law')])]


def common_findings(plant: Sequence[Device]) -> list[str]:
    """Return the effects and curves that the latest rows of every device have; their cause is likely the set-up."""
    if len(plant) < FEWEST_DEVICES:
        return []
    findings = [{name for part in device.parts for name in findings_of(part.latest)} for device in plant]
    return sorted(set.intersection(*findings))


def _device(name: str, rows: Sequence[Row]) -> Device:
    bags = [tuple(bag_rows) for _, bag_rows in groupby(rows, key=lambda row: str(row['bag']))]
    names = dict.fromkeys(row['part'] for row in sorted(rows, key=lambda row: str(row['part'])) if row['part'])
    parts = []
    for part in names:
        part_rows = tuple(row for row in rows if row['part'] == part)
        parts.append(Part(part, part_rows, tuple(_changes(part_rows))))
    return Device(name, tuple(bags), tuple(parts))


def _changes(rows: Sequence[Row]) -> Iterator[Change]:
    informative = [row for row in rows if row['verdict'] not in NOT_ESTIMATED]
    return (Change(before, after) for before, after in pairwise(informative) if _differ(before, after))


def _differ(before: Row, after: Row) -> bool:
    """
    Return whether two verdicts differ, or their effects by more than indistinguishable alternatives.

    Effects of unexplained bags are not compared: without a complete explanation, each bag may have different effects.
    """
    if before['verdict'] != after['verdict']:
        return True
    if after['verdict'] == 'unexplained':
        return False
    earlier, later = set(effects_of(before)), set(effects_of(after))
    are_equivalent = later <= earlier | _alternatives(before) or earlier <= later | _alternatives(after)
    return len(earlier) != len(later) or not are_equivalent


def _alternatives(row: Row) -> set[str]:
    return set(filter(None, (row.get('alternatives') or '').split(';')))
