"""How large an error may be before it matters to whoever asks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from cfd_pneumatic.errors import InputError

_SIZE = re.compile(r'([0-9]+(?:\.[0-9]*)?) *(Pa|N|%)')
_FIELDS = {'Pa': 'pressure', 'N': 'force', '%': 'percent'}


class Tolerance(NamedTuple):
    """Errors that do not matter; by default every one does."""

    pressure: float = 0.0
    """Of a pressure [Pa]."""

    force: float = 0.0
    """Of a force [N]."""

    percent: float = 0.0
    """Of the span of either [%]."""

    def of(self, unit: str, span: float) -> float:
        """Return what is tolerated of a signal in `unit`, Pa or N, with a span, in that unit."""
        return max({'Pa': self.pressure, 'N': self.force}.get(unit, 0.0), 0.01 * self.percent * span)


EVERY = Tolerance()
"""Every error matters."""


def tolerance_from(sizes: Iterable[str]) -> Tolerance:
    """
    Return the tolerance that people write as `300Pa`, `2N` or `1%`, or some of these.

    Raises
    ------
    InputError
        If it is written otherwise.

    """
    told: dict[str, float] = {}
    for text in sizes:
        written = _SIZE.fullmatch(text.strip())
        if written is None:
            raise InputError(f'tolerance {text!r}: give Pa, N or percent of the span, as 300Pa, 2N or 1%')
        told[_FIELDS[written[2]]] = float(written[1])
    return Tolerance(**told)
