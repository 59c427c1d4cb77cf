# SPDX-License-Identifier: Apache-2.0
"""Texts in messages and notes."""

from __future__ import annotations

from collections.abc import Sequence

from cfd_pneumatic.errors import DamageError, InputError, printable

_LONGEST_NAME = 100  # characters


def count_of(count: int, noun: str) -> str:
    """Return a count with its noun: `1 sample`, `2,000 samples`."""
    return f'{count:,} {noun}{"" if count == 1 else "s"}'


def listed(names: Sequence[str], most: int = 40) -> str:
    """Return names for a message, with at most `most` names, each shortened to 100 characters."""
    shown = ', '.join(printable(name[:_LONGEST_NAME]) for name in names[:most])
    return shown + (f' and {len(names) - most:,} more' if len(names) > most else '')


def reason_of(error: BaseException) -> str:
    """Return the reason of a failure to read. Texts of libraries are omitted: they may quote secret input."""
    if isinstance(error, InputError | DamageError):
        return str(error)
    if isinstance(error, OSError):
        return error.strerror or type(error).__name__
    library = type(error).__module__.partition('.')[0]
    return 'its parts contradict each other' if library in ('builtins', 'struct') else f'{library} cannot read it'
