"""What almost all arrays of this package are."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Of floats; shape and unit stand where it is used."""
