# SPDX-License-Identifier: Apache-2.0
"""Effort of a search: how many simulated steps it has cost, and how many it may cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from threading import Lock
from typing import TypeVar

Item = TypeVar('Item')


class Effort:
    """
    Effort of a search, in simulated steps of several models side by side.

    Simulated steps are counted instead of time, so that a busy computer gives the same answer.

    Parameters
    ----------
    limit
        Largest effort [steps]; by default unlimited.
    is_stopped
        Returns whether the user has ended the search.
    report
        Called after each change of `question`, `spent` or `error`.

    """

    def __init__(
        self,
        limit: float = math.inf,
        is_stopped: Callable[[], bool] = lambda: False,
        report: Callable[[Effort], None] = lambda _effort: None,
    ) -> None:
        self.limit = limit
        self.is_stopped = is_stopped
        self.spent = 0.0
        self.question = ''
        """What is tried."""
        self.error: float | None = None
        """Least error so far [standard deviations of the noise]."""
        self._allowed = limit
        self._is_extended = False
        self._skipped: dict[str, None] = {}
        self._report = report
        self._lock = Lock()

    def add(self, steps: float) -> None:
        """Count simulated steps; threads may call this function."""
        with self._lock:
            self.spent += steps
        self._report(self)

    def ask(self, question: str, error: float | None = None) -> None:
        """Note what is tried next, and the error of the best model so far [standard deviations of the noise]."""
        self.question = question
        if error is not None:
            self.error = error if self.error is None else min(error, self.error)
        self._report(self)

    def allows(self, what: str, steps: float = 0.0) -> bool:
        """Return whether a part of the search may begin that takes some steps; otherwise note that it was skipped."""
        is_allowed = not self.is_stopped() and self.spent + steps < self._allowed
        if not is_allowed:
            self._skipped[what] = None
        return is_allowed

    @property
    def room(self) -> float:
        """Return the effort that remains [steps]."""
        return 0.0 if self.is_stopped() else max(self._allowed - self.spent, 0.0)

    def affordable(self, what: str, items: Sequence[Item], steps: float) -> Sequence[Item]:
        """Return the first of some items, which take some steps each, for which the effort suffices."""
        count = len(items) if math.isinf(self.room) else min(len(items), int(self.room / max(steps, 1.0)))
        if count < len(items):
            self._skipped[what] = None
        return items[:count]

    @property
    def skipped(self) -> tuple[str, ...]:
        """Return the parts of the search that the limit or the user prevented."""
        return tuple(self._skipped)

    @contextmanager
    def share(self, share: float) -> Iterator[None]:
        """Allow only a share of the remaining effort within the context."""
        remaining = self._allowed - self.spent
        with self._limited(self.spent + share * max(remaining, 0.0) if math.isfinite(remaining) else math.inf):
            yield

    @contextmanager
    def _limited(self, allowed: float) -> Iterator[None]:
        before, limit = self._allowed, self.limit
        self._allowed = allowed
        try:
            yield
        finally:
            self._allowed = before if math.isinf(limit) else before + self.limit - limit

    def extend(self, factor: float) -> None:
        """Multiply the limit, once in a search."""
        if not self._is_extended and math.isfinite(self.limit):
            self._allowed += (factor - 1.0) * self.limit
            self.limit *= factor
            self._is_extended = True

    def lifted(self) -> AbstractContextManager[None]:
        """Return a context without limit, for the fits of the answer."""
        return self._limited(math.inf)
