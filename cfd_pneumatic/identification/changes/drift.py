# SPDX-License-Identifier: Apache-2.0
"""
Test whether the sensor or the set-point drifts slowly along a bent curve, and estimate the drift.

A slow drift of the sensor, the set-point, the supply or a temperature moves the pressure in the same way. A recording
does not distinguish these causes. The effect `set_point_drift` is a straight drift. A bent drift would
mislead the search for effects and is removed before the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.changes.detection import search_time
from cfd_pneumatic.identification.changes.excitation import groups_by_excitation
from cfd_pneumatic.identification.changes.part_fits import PartFits
from cfd_pneumatic.identification.changes.thresholds import FIRST_CUTS, LEAST_DRIFT_DROP, LEAST_RMS_OVER_NOISE
from cfd_pneumatic.identification.channels import Channel
from cfd_pneumatic.identification.data import Experiment
from cfd_pneumatic.identification.report_texts import number
from cfd_pneumatic.identification.residual import sample_noise
from cfd_pneumatic.recording import Recording


@dataclass(frozen=True, eq=False)
class Drift:
    """
    A slow drift of the sensor or the set-point in a recording.

    Attributes
    ----------
    channel, recording
        Names of the channel and of the recording.
    times, values
        Drift at the samples, zero on average, each of shape (n,) [s] and [Pa].

    """

    channel: str
    recording: str
    times: Array
    values: Array

    @property
    def total(self) -> float:
        """Change of the pressure from the first to the last sample [Pa]."""
        return float(self.values[-1] - self.values[0])

    @property
    def rate(self) -> float:
        """Mean rate of the drift [Pa/s]."""
        return self.total / float(self.times[-1] - self.times[0])

    @property
    def text(self) -> str:
        """Return the drift as a clause."""
        return (
            f'{self.recording}, {self.channel}: the sensor or the set-point drifts slowly, by {number(self.total)} Pa '
            f'over the recording, {number(self.rate)} Pa/s on average'
        )


def find_drift(channel: Channel, experiment: Experiment) -> Drift | None:
    """
    Return the bent drift of a channel in a recording; None without one.

    A bent drift is clearly better than a straight drift, also if low and high excitation have separate gains. A bent
    drift is also better than separate gains before and after a time.
    """
    if experiment.drifts or not np.ptp(experiment.inputs['displacement']):
        return None
    straight, bent = PartFits(channel, experiment, 1), PartFits(channel, experiment)
    noise = sample_noise(experiment.sample_times, experiment.measured)
    if not bent.has_bent_drift or straight.joint.stds[0] < LEAST_RMS_OVER_NOISE * noise:
        return None
    if straight.joint.cost - bent.joint.cost < LEAST_DRIFT_DROP:
        return None
    divisions = [*groups_by_excitation(straight.experiments, straight.counts)]
    costs = [straight.grouped(groups, straight.joint.models).cost for groups in divisions]
    if costs:
        best = int(np.argmin(costs))
        if costs[best] - bent.grouped(divisions[best], bent.joint.models).cost < LEAST_DRIFT_DROP:
            return None
    if any(search_time(straight, share, straight.joint.models)[1].cost < bent.joint.cost for share in FIRST_CUTS):
        return None
    times = experiment.sample_times
    return Drift(channel.name, experiment.recording, times, bent.drift(times))


def without_drift(recording: Recording, drift: Drift) -> Recording:
    """Return a recording without the drift of a cylinder's pressure."""
    signals = recording.cylinders[drift.channel]
    times, values = signals.pressure.times, signals.pressure.values
    pressure = replace(signals.pressure, values=values - np.interp(times, drift.times, drift.values))
    return replace(recording, cylinders={**recording.cylinders, drift.channel: replace(signals, pressure=pressure)})
