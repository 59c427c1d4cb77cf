"""Standard errors from a Jacobian and residuals that may be correlated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def covariance(jacobian: Array, residuals: Array, degrees: int, lengths: Sequence[int]) -> Array:
    """
    Return the covariance of fitted unknowns, shape (k, k).

    Parameters
    ----------
    jacobian, residuals
        Of the residuals by the unknowns, shape (n, k), and the residuals, shape (n,), at the fit.
    degrees
        Degrees of freedom, samples less unknowns.
    lengths
        Of the runs of neighbouring samples that the residuals are made of.

    (J'J)^-1 times the residual variance where the residual is white. Where neighbouring residuals are correlated, by
    the displacement's smoothed noise or by an effect that the model lacks, each of them tells less: the sandwich of
    Newey and West (1987) with a Bartlett window.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    scaled = jacobian / size  # metres and hertz side by side would pass for a matrix without full rank
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(size, size)
    lags = _correlation_length(residuals, lengths)
    if lags == 0:
        return inverse * float(residuals @ residuals) / degrees
    middle = np.zeros_like(inverse)
    scores = jacobian * residuals[:, None]
    for part in np.split(scores, np.cumsum(lengths)[:-1]):
        # sums over every window of lags + 1 neighbours, which weight products by the Bartlett window
        total = np.cumsum(np.pad(part, ((lags + 1, lags), (0, 0))), axis=0)
        windows = total[lags + 1 :] - total[: -lags - 1]
        middle += windows.T @ windows / (lags + 1.0)
    return inverse @ middle @ inverse * (residuals.size / degrees)


def _correlation_length(residuals: Array, lengths: Sequence[int]) -> int:
    """Return over how many samples residuals are correlated, 0 where the first lag's correlation is noise."""
    series = np.split(residuals, np.cumsum(lengths)[:-1])
    power = float(residuals @ residuals)
    significance = 3.0 / math.sqrt(residuals.size)
    longest = max(1, min(length for length in lengths) // 4)

    def correlation(lag: int) -> float:
        return sum(float(part[lag:] @ part[:-lag]) for part in series) / power

    if power == 0.0 or abs(correlation(1)) < significance:
        return 0
    lag = 1
    while lag < longest and correlation(lag) > significance:
        lag += max(1, lag // 8)
    return min(2 * lag, longest)
