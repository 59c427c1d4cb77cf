# SPDX-License-Identifier: Apache-2.0
"""Changes and drifts of the device in prepared recordings and in results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cfd_pneumatic.identification.changes import (
    Cut,
    DeviceState,
    Drift,
    cut_of_curve,
    find_cut,
    find_drift,
    without_drift,
)
from cfd_pneumatic.identification.channels import Channel
from cfd_pneumatic.identification.preparation import Prepared
from cfd_pneumatic.identification.result import ChannelResult, Comparison
from cfd_pneumatic.recording import Recording

_STRAIGHT_DRIFT = 'set_point_drift'


def cuts_of(channel: Channel, data: Prepared) -> Iterator[tuple[int, Cut]]:
    """Yield the indices of recordings in which a channel's device changed, and when."""
    for index, experiment in zip(data.holding(channel), data.experiments(channel)):
        cut = find_cut(channel, experiment)
        if cut is not None:
            yield index, cut


def drifts_of(channel: Channel, data: Prepared) -> Iterator[tuple[int, Drift]]:
    """Yield the indices of recordings in which a channel drifts, and the drifts."""
    for index, experiment in zip(data.holding(channel), data.experiments(channel)):
        drift = find_drift(channel, experiment)
        if drift is not None:
            yield index, drift


def straight_drifts_of(results: Mapping[str, ChannelResult]) -> Iterator[Drift]:
    """Yield the drifts that the search found as an effect, for each recording."""
    for result in results.values():
        if _STRAIGHT_DRIFT in result.found.model.effects:
            rate = result.found.model.effects[_STRAIGHT_DRIFT][0]
            for comparison in result.comparisons:
                times = comparison.times
                yield Drift(result.name, comparison.name, times, rate * (times - float(np.mean(times))))


def without_drifts(data: Prepared, drifts: Sequence[tuple[int, Drift]]) -> tuple[Recording, ...]:
    """Return the recordings without drifts, which have the indices of their recordings."""
    recordings = list(data.recordings)
    for index, drift in drifts:
        recordings[index] = without_drift(recordings[index], drift)
    return tuple(recordings)


def cuts_of_curves(results: Mapping[str, ChannelResult]) -> Iterator[tuple[tuple[str, int], Cut]]:
    """Yield changes that curves of the time show, by name of the channel and index of the recording."""
    for name, result in results.items():
        curve = None if result.conclusion is None else result.conclusion.unknown
        if curve is not None and curve.against == 'time' and len(result.comparisons) == 1:
            (comparison,) = result.comparisons
            cut = cut_of_curve(comparison.experiment.begin + curve.at, curve.value)
            if cut is not None:
                yield (name, comparison.recording), cut


def state_of(result: ChannelResult, comparison: Comparison) -> DeviceState:
    """Return the state of a channel next to a change; the comparison is that of the recording that shows the change."""
    index, conclusion = comparison.experiment.index, result.conclusion
    return DeviceState(
        gains=result.fit.estimates,
        offset=float(result.fit.model.recording_values[index, 0]),
        offset_std=float(result.fit.stds[index, 0]),
        effects=() if conclusion is None else conclusion.effects,
        verdict='' if conclusion is None else conclusion.verdict,
        why='' if conclusion is None else conclusion.why,
        error=result.rms(1),
    )
