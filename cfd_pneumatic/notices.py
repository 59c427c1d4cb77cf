# SPDX-License-Identifier: Apache-2.0
"""Notices about data and results: likely input errors, and assumptions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from cfd_pneumatic.errors import InputError

WARNING, NOTE = 'warning', 'note'


@dataclass(frozen=True)
class Notice:
    """
    A notice to the user about data or results.

    Attributes
    ----------
    code
        Kind of the notice, for programs: `unit_suspect` and so on.
    level
        `warning`: do not trust a verdict before the cause is checked. `note`: an assumption or information.
    message
        What was found.
    fix
        What to do.

    """

    code: str
    level: str
    message: str
    fix: str

    def __str__(self) -> str:
        """Return the notice in a line."""
        return f'{self.message}: {self.fix}' if self.fix else self.message


class SuspectError(InputError):
    """Unusable input with a likely cause."""

    def __init__(self, notice: Notice) -> None:
        super().__init__(str(notice))
        self.notice = notice


def warning(code: str, message: str, fix: str) -> Notice:
    """Return a notice that puts a verdict in question."""
    return Notice(code, WARNING, message, fix)


def note(code: str, message: str, fix: str = '') -> Notice:
    """Return a notice for information."""
    return Notice(code, NOTE, message, fix)


def any_warning(notices: Iterable[Notice]) -> bool:
    """Return whether any notice is a warning."""
    return any(notice.level == WARNING for notice in notices)
