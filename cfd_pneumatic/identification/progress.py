# SPDX-License-Identifier: Apache-2.0
"""Progress of the searches of all channels, and the limit of their effort."""

from __future__ import annotations

import math
from collections.abc import Callable
from threading import Lock

from cfd_pneumatic.identification.data import Effort, Options
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.thresholds import LARGEST_EFFORT, LARGEST_EFFORT_PER_STEP, LEAST_PROGRESS

Progress = Callable[[str, float], None]
"""Called with the current activity and the completed share of the work [0 to 1]."""

SMOOTHING_SHARE = 0.06
"""Share of the work before the first search [-]."""


def effort_of(fit: Fit, options: Options, is_stopped: Callable[[], bool], report: Callable[[Effort], None]) -> Effort:
    """Return the effort that the search of a channel may take."""
    limit = LARGEST_EFFORT + LARGEST_EFFORT_PER_STEP * fit.likelihood.steps
    return Effort(math.inf if options.thorough else limit, is_stopped, report)


class SearchProgress:
    """
    Progress of all channels' searches.

    Parameters
    ----------
    progress
        Shows the current activity and the completed share.
    channels
        Number of channels.

    """

    def __init__(self, progress: Progress, channels: int) -> None:
        self._progress = progress
        self._shares: dict[str, float] = {}
        self._channels = channels
        self._shown = '', 0.0
        self._lock = Lock()

    def show(self, channel: str, effort: Effort) -> None:
        """Show what a channel tries, its least error, and the share of its effort."""
        error = '' if effort.error is None else f', error {effort.error:.3g} times the noise'
        share = min(effort.spent / effort.limit, 1.0) if math.isfinite(effort.limit) else 0.0
        self._update(channel, share, f'{channel}: {effort.question}{error}' if effort.question else '')

    def end(self, channel: str) -> None:
        """Count a channel as complete."""
        self._update(channel, 1.0, '')

    def _update(self, channel: str, share: float, what: str) -> None:
        with self._lock:
            self._shares[channel] = share
            total = SMOOTHING_SHARE + (1.0 - SMOOTHING_SHARE) * sum(self._shares.values()) / self._channels
            text, before = self._shown
            if (what or text) != text or total - before >= LEAST_PROGRESS:
                self._shown = what or text, max(total, before)
                self._progress(*self._shown)
