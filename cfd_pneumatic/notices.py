# SPDX-License-Identifier: Apache-2.0
"""What has to be said about data and results: mistakes that they look like, and what was assumed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from cfd_pneumatic.errors import InputError

WARNING, NOTE = 'warning', 'note'


@dataclass(frozen=True)
class Notice:
    """
    Something that has to be said.

    Attributes
    ----------
    code
        What kind it is, for programs: `unit_suspect` and so on.
    level
        `warning`: no verdict is to be trusted before it is looked into. `note`: an assumption, or good to know.
    message
        What was seen.
    fix
        What to do about it.

    """

    code: str
    level: str
    message: str
    fix: str

    def __str__(self) -> str:
        """Return it in a line."""
        return f'{self.message}: {self.fix}' if self.fix else self.message


class SuspectError(InputError):
    """Input that can't be used, and what it looks like."""

    def __init__(self, notice: Notice) -> None:
        super().__init__(str(notice))
        self.notice = notice


def warning(code: str, message: str, fix: str) -> Notice:
    """Return a notice without which a verdict would mislead."""
    return Notice(code, WARNING, message, fix)


def note(code: str, message: str, fix: str = '') -> Notice:
    """Return a notice that one may want to know."""
    return Notice(code, NOTE, message, fix)


def any_warning(notices: Iterable[Notice]) -> bool:
    """Return whether one of them is a warning."""
    return any(one.level == WARNING for one in notices)
