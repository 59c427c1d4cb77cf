# SPDX-License-Identifier: Apache-2.0
"""Check whether recorded values are physically possible."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.errors import InputError


def check_range(label: str, values: Array, largest: float, unit: str) -> None:
    """Raise InputError if a signal exceeds a physical limit; `label` names the recording and the signal."""
    low, high = float(np.min(values)), float(np.max(values))
    if max(-low, high) > largest:
        raise InputError(
            f'{label} goes from {low:.3g} to {high:.3g} {unit}, which is beyond any device. '
            'Check the topic or column in the mapping, and its unit'
        )
