# SPDX-License-Identifier: Apache-2.0
"""Rows of a study in a file of JSON lines, from which a stopped run continues."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

Row = TypeVar('Row')


def read_rows(path: Path, row: type[Row], code: str) -> Iterator[Row]:
    """
    Yield the rows that a version of the program wrote; skip lines that are incomplete or have different fields.

    Parameters
    ----------
    path
        File of the rows; a missing file has none.
    row
        Dataclass of the rows, with a field `code`.
    code
        Version of the program.

    """
    row_type: Any = row
    names = {field.name for field in fields(row_type)}
    for line in path.read_text(encoding='utf-8').splitlines() if path.exists() else ():
        try:
            values = json.loads(line)
        except ValueError:
            continue
        if values.keys() == names and values['code'] == code:
            yield row(**values)


def seed_range(text: str) -> range:
    """Return the seeds of an option such as `5000:5003`."""
    first, last = map(int, text.split(':'))
    return range(first, last)
