# SPDX-License-Identifier: Apache-2.0
"""What documents that are written by a program share: tables, and notes by hand that are kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

NOTES = '## Notes'
"""What stands in the document from here on is written by hand, and kept."""


def table(header: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    rows = [header, ['---'] * len(header), *lines]
    return '\n'.join('| ' + ' | '.join(str(cell) for cell in row) + ' |' for row in rows)


def code(text: object) -> str:
    """Return a text as code, in a table too, where a bar would end the cell."""
    return f'`{text}`'.replace('|', r'\|')


def notes_in(path: Path) -> str:
    """Return what was written by hand at the end of a document."""
    if not path.exists():
        return ''
    _, found, notes = path.read_text(encoding='utf-8').partition(f'\n{NOTES}\n')
    return f'{NOTES}\n{notes.rstrip()}' if found else ''
