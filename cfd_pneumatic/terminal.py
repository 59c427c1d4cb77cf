# SPDX-License-Identifier: Apache-2.0
"""Consoles that print words as they are: brackets and colons in a file's name are no markup; and their tables."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Collection
from typing import Any

from rich.console import Console
from rich.table import Table

_WIDTH = 120  # characters, where there is no terminal
_NARROW = 110  # characters, as text
_AS_IT_IS: dict[str, Any] = {'markup': False, 'highlight': False, 'emoji': False}


def terminal() -> Console:
    """Return the console of standard output."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH, **_AS_IT_IS)


def printed(work: Callable[[Console], None]) -> str:
    """Return as text what is printed on a console."""
    stream = io.StringIO()
    work(Console(file=stream, width=_NARROW, force_jupyter=False, color_system=None, **_AS_IT_IS))
    return stream.getvalue().rstrip()


def table(title: str, *headings: str, words: Collection[str] = ()) -> Table:
    """Return a table with these columns; numbers stand to the right, and `words` are the headings of others."""
    made = Table(title=title, title_justify='left', caption_justify='left')
    for heading in headings:
        made.add_column(heading, justify='left' if heading in words else 'right')
    return made
