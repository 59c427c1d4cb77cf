# SPDX-License-Identifier: Apache-2.0
"""Markdown of documents that a program writes: tables, and handwritten notes that are kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

NOTES = '## Notes'
"""Heading of the handwritten notes at the end of a document; a new version keeps the notes."""


def table(header: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    rows = [header, ['---'] * len(header), *lines]
    return '\n'.join('| ' + ' | '.join(str(cell) for cell in row) + ' |' for row in rows)


def code(text: object) -> str:
    """Return a text as code, with escaped bars, which would end a cell of a table."""
    return f'`{text}`'.replace('|', r'\|')


def notes_in(path: Path) -> str:
    """Return the handwritten notes at the end of a document."""
    if not path.exists():
        return ''
    _, heading, notes = path.read_text(encoding='utf-8').partition(f'\n{NOTES}\n')
    return f'{NOTES}\n{notes.rstrip()}' if heading else ''
