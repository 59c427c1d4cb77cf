# SPDX-License-Identifier: Apache-2.0
"""How well a device does live: sample by sample, as `sim_node` answers, without smoothing or looking ahead."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.device.device import Device
from cfd_pneumatic.device.identified import estimated_setpoints
from cfd_pneumatic.identification import Identification, PartError

_MOST = 2_000  # samples of the displacement that are answered
_LEAD = 500  # samples before these, in which the beginning is forgotten


def live_errors(identification: Identification, device: Device) -> dict[str, PartError]:
    """
    Return the errors of a live simulation, by channel, on the part on which before and after are compared.

    Where that is long its first samples stand for it.
    """
    left: dict[str, list[Array]] = {name: [] for name in identification.channels}
    remaining = _MOST
    for index, setpoints in enumerate(estimated_setpoints(identification)):
        recording = identification.recordings[index]
        compared = [
            (result, one)
            for result in identification.channels.values()
            for one in result.comparisons
            if one.recording == index and np.any(result.judged(one))
        ]
        if not compared or not remaining:
            continue
        times = recording.displacement.times
        judged = np.concatenate([one.times[result.judged(one)] for result, one in compared])
        first, last = np.searchsorted(times, [judged.min(), judged.max()]).tolist()
        last = min(last, first + remaining - 1, times.size - 1)
        remaining -= last - first + 1
        piece = recording.between(times[max(first - _LEAD, 0)], np.nextafter(times[last], np.inf))
        answers = device.simulate(piece, raw=True, setpoints=setpoints)
        for result, _ in compared:
            measured, answered = result.channel.signal(recording), result.channel.signal(answers)
            if measured is not None and answered is not None:
                own = measured.between(times[first], np.nextafter(times[last], np.inf))
                left[result.name].append(own.values - np.interp(own.times, answered.times, answered.values))
    return {
        name: _error(np.concatenate(runs), identification.channels[name].span) for name, runs in left.items() if runs
    }


def _error(residual: Array, span: float) -> PartError:
    rmse = rms(residual)
    return PartError(rmse, 100.0 * rmse / span)
