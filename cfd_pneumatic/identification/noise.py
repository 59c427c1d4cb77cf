"""How small the residual could be: the noise that no model can explain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from cfd_pneumatic.identification.experiment import Experiment

Array = NDArray[np.float64]

_KEPT = 0.9  # share of the smallest differences that is taken for noise; the rest may be transients


def sample_noise(times: Array, values: Array) -> float:
    """
    Return the standard deviation of a signal's white noise, in the signal's unit.

    Each sample is compared with the straight line through its neighbours (Gasser, Sroka and Jennen-Steinmetz, 1986);
    the largest tenth of the differences is left out, and made up for as in a normal distribution.

    Parameters
    ----------
    times
        Increasing, shape (n,), n at least 3 [s].
    values
        The signal, shape (n,).

    """
    left = (times[2:] - times[1:-1]) / (times[2:] - times[:-2])
    right = 1.0 - left
    differences = values[1:-1] - left * values[:-2] - right * values[2:]
    squares = np.sort(differences**2 / (1.0 + left**2 + right**2))
    kept = squares[: max(1, int(_KEPT * squares.size))]
    limit = norm.ppf(0.5 + 0.5 * _KEPT)
    share_of_variance = 1.0 - 2.0 * limit * norm.pdf(limit) / _KEPT
    return math.sqrt(float(np.mean(kept)) / share_of_variance)


def noise_floor(experiment: Experiment, k_x: float) -> float:
    """
    Return the RMSE that the true model would leave [Pa].

    The pressure's own noise, and the uncertainty that is left of the smoothed displacement times K_x [Pa/m].
    """
    pressure = sample_noise(experiment.sample_times, experiment.pressure)
    displacement = k_x * math.sqrt(float(np.mean(experiment.motion.std**2)))
    return math.hypot(pressure, displacement)
