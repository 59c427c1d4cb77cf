# SPDX-License-Identifier: Apache-2.0
"""The tolerance: how large an error may be before it matters to the user."""

from __future__ import annotations

import re
from collections.abc import Iterable

from cfd_pneumatic.arguments import check_type
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.thresholds import LARGEST_TOLERANCE, LONGEST_SHOWN_TEXT

Tolerance = tuple[tuple[float, str], ...]
"""Errors that do not matter, each with its unit: `Pa`, `N`, or `%` of a signal's span. Empty: every error matters."""

_SIZE = re.compile(r'([0-9]+(?:\.[0-9]*)?) *(Pa|N|%)')


def tolerance_from(sizes: Iterable[str]) -> Tolerance:
    """
    Parse a tolerance from texts such as `300Pa`, `2N` or `1%`.

    Raises
    ------
    InputError
        If a text is no tolerance or too large.

    """
    tolerance = []
    check_type('tolerance', sizes, Iterable, 'a text such as 300Pa, 2N or 1%, or a list of texts')
    for text in sizes:
        check_type('tolerance', text, str, 'a text such as 300Pa, 2N or 1%, or a list of texts')
        match = _SIZE.fullmatch(text.strip())
        if match is None:
            raise InputError(
                f'tolerance {text[:LONGEST_SHOWN_TEXT]!r} is not usable. '
                'Give Pa, N or percent of the span, as 300Pa, 2N or 1%'
            )
        size = float(match[1])
        if size > LARGEST_TOLERANCE:
            raise InputError(
                f'a tolerance of more than {LARGEST_TOLERANCE:g} {match[2]} has no effect. '
                'Give a tolerance that errors can exceed'
            )
        tolerance.append((size, match[2]))
    return tuple(tolerance)


def tolerated(tolerance: Tolerance, unit: str, span: float) -> float:
    """Return the largest error of a signal that does not matter; span and error in `unit`."""
    sizes = [
        0.01 * size * span if size_unit == '%' else size for size, size_unit in tolerance if size_unit in (unit, '%')
    ]
    return max(sizes, default=0.0)
