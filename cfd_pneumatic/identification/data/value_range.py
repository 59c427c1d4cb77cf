# SPDX-License-Identifier: Apache-2.0
"""Whether recorded numbers can be what they are said to be."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError


def check_range(what: str, values: Array, largest: float, unit: str) -> None:
    """Raise InputError where a signal goes beyond anything physical; `what` names the recording and the signal."""
    low, high = float(np.min(values)), float(np.max(values))
    if max(-low, high) > largest:
        raise InputError(
            f'{what} goes from {low:.3g} to {high:.3g} {unit}, which no device does: is it what the topic or column '
            'holds, and in the unit that the mapping says?'
        )
