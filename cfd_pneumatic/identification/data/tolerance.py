# SPDX-License-Identifier: Apache-2.0
"""How large an error may be before it matters to whoever asks."""

from __future__ import annotations

import re
from collections.abc import Iterable

from cfd_pneumatic.arguments import check_type
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.thresholds import LARGEST_TOLERANCE, LONGEST_SHOWN_TEXT

Tolerance = tuple[tuple[float, str], ...]
"""Errors that do not matter, each with its unit: `Pa`, `N`, or `%` of a signal's span; without any every one does."""

_SIZE = re.compile(r'([0-9]+(?:\.[0-9]*)?) *(Pa|N|%)')


def tolerance_from(sizes: Iterable[str]) -> Tolerance:
    """
    Return the tolerance that people write as `300Pa`, `2N` or `1%`, or some of these.

    Raises
    ------
    InputError
        If it is written otherwise.

    """
    tolerance = []
    check_type('tolerance', sizes, Iterable, 'a text such as 300Pa, 2N or 1%, or a list of texts')
    for text in sizes:
        check_type('tolerance', text, str, 'a text such as 300Pa, 2N or 1%, or a list of texts')
        written = _SIZE.fullmatch(text.strip())
        if written is None:
            raise InputError(
                f'tolerance {text[:LONGEST_SHOWN_TEXT]!r}: give Pa, N or percent of the span, as 300Pa, 2N or 1%'
            )
        size = float(written[1])
        if size > LARGEST_TOLERANCE:
            raise InputError(
                f'a tolerance of more than {LARGEST_TOLERANCE:g} {written[2]}: give one that errors can exceed'
            )
        tolerance.append((size, written[2]))
    return tuple(tolerance)


def tolerated(tolerance: Tolerance, unit: str, span: float) -> float:
    """Return which error of a signal with a span does not matter, both in `unit`."""
    sizes = [0.01 * size * span if own == '%' else size for size, own in tolerance if own in (unit, '%')]
    return max(sizes, default=0.0)
