# SPDX-License-Identifier: Apache-2.0
"""
Divide samples by the excitation: by set-point, position, amplitude and mean speed.

A model with an error fits each kind of excitation with different gains. If a division by the excitation reduces the
error as much as a division by the time, the excitation differs and not the device.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from cfd_pneumatic.arrays import Array, Mask
from cfd_pneumatic.identification.changes.thresholds import AMPLITUDE_WINDOW, EXCITATION_QUANTILES, LEAST_GROUP
from cfd_pneumatic.identification.data import Experiment


def groups_by_excitation(experiments: Sequence[Experiment], counts: Mask) -> Iterator[NDArray[np.intp]]:
    """
    Yield divisions of the samples into two groups of a lower and a higher excitation.

    Parameters
    ----------
    experiments
        Adjacent or separate stretches of a recording.
    counts
        Whether the samples count, shape (n,).

    Yields
    ------
    groups
        0 or 1 for each sample, shape (n,).

    """
    for values in map(np.concatenate, zip(*map(_excitations, experiments))):
        for limit in dict.fromkeys(np.quantile(values[counts], EXCITATION_QUANTILES).tolist()):
            groups = (values > limit).astype(np.intp)
            share = float(np.mean(groups[counts]))
            if LEAST_GROUP <= share <= 1.0 - LEAST_GROUP:
                yield groups


def _excitations(experiment: Experiment) -> tuple[Array, ...]:
    """Return set-point [Pa], displacement [m], amplitude [m] and mean speed [m/s] at the samples, each (m,)."""
    position, setpoint = experiment.at_samples('displacement'), experiment.at_samples('setpoint')
    window = max(round(AMPLITUDE_WINDOW / experiment.period), 3)
    amplitude = maximum_filter1d(position, window) - minimum_filter1d(position, window)
    speed = uniform_filter1d(np.abs(np.gradient(position, experiment.sample_times)), window)
    return setpoint, position, amplitude, speed
