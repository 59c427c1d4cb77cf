"""Bringing into order what comes in pieces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_NEVER = 2**63 - 1


def earliest_after(begins: Sequence[int]) -> list[int]:
    """Return for each piece the earliest time [ns] in all later pieces, whose own earliest times are given."""
    earliest = np.minimum.accumulate([*begins, _NEVER][::-1])[::-1]
    return [int(time) for time in earliest[1:]]
