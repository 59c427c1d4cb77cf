# SPDX-License-Identifier: Apache-2.0
"""Consoles and tables that print texts literally, because names of files may contain brackets and colons."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Collection
from typing import Any

from rich.console import Console
from rich.table import Table

_WIDTH = 120  # characters, without a terminal
_NARROW = 110  # characters, of text
_LITERAL: dict[str, Any] = {'markup': False, 'highlight': False, 'emoji': False}


def terminal() -> Console:
    """Return the console of standard output."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH, **_LITERAL)


def printed(print_on: Callable[[Console], None]) -> str:
    """Return the text that a function prints on a console."""
    stream = io.StringIO()
    print_on(Console(file=stream, width=_NARROW, force_jupyter=False, color_system=None, **_LITERAL))
    return stream.getvalue().rstrip()


def table(title: str, *headings: str, words: Collection[str] = ()) -> Table:
    """Return a table with right-aligned columns of numbers; `words` are the headings of columns of text."""
    new_table = Table(title=title, title_justify='left', caption_justify='left')
    for heading in headings:
        new_table.add_column(heading, justify='left' if heading in words else 'right')
    return new_table
