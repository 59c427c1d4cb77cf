# SPDX-License-Identifier: Apache-2.0
"""Words for messages and notes."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """Return a count with its noun: `1 sample`, `2,000 samples`."""
    return f'{count:,} {noun}{"" if count == 1 else "s"}'


def reason_of(error: BaseException) -> str:
    """Return what an error says, on one line."""
    return ' '.join(str(error).split()).rstrip('.') or type(error).__name__
