# SPDX-License-Identifier: Apache-2.0
"""Types of arrays, and the root mean square."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of floats; shape and unit are documented at each use."""

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
