# SPDX-License-Identifier: Apache-2.0
"""What almost all arrays of this package are, and how large."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Of floats; shape and unit stand where it is used."""

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
