# SPDX-License-Identifier: Apache-2.0
"""Answers of a preview on the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from cfd_pneumatic.path.preview import Preview
from cfd_pneumatic.path.texts import answers


def print_preview(preview: Preview, console: Console) -> None:
    """Print the answers as two columns, then the notes."""
    rows = Table.grid(padding=(0, 2))
    rows.add_column(no_wrap=True)
    rows.add_column()
    for question, answer in answers(preview):
        rows.add_row(question, answer)
    console.print(rows)
    for note in preview.notes:
        console.print(f'note: {note}', style='yellow')
