# SPDX-License-Identifier: Apache-2.0
"""Compute the error of a simulation as in `sim_node`: sample by sample, without smoothing or future samples."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.device.device import Device
from cfd_pneumatic.device.identified import estimated_setpoints
from cfd_pneumatic.device.simulation import simulate_live
from cfd_pneumatic.identification import Identification, PartError

_MOST_SAMPLES = 2_000  # of the displacement that are compared
_LEAD = 500  # samples before, in which the initial state decays


def live_errors(identification: Identification, device: Device) -> dict[str, PartError]:
    """
    Return the errors of a sample-by-sample simulation by channel, on the part on which before and after are compared.

    The first samples represent a long part.
    """
    residuals: dict[str, list[Array]] = {name: [] for name in identification.channels}
    remaining = _MOST_SAMPLES
    for index, setpoints in enumerate(estimated_setpoints(identification)):
        recording = identification.recordings[index]
        compared = [
            (result, comparison)
            for result in identification.channels.values()
            for comparison in result.comparisons
            if comparison.recording == index and np.any(result.judged(comparison))
        ]
        if not compared or not remaining:
            continue
        times = recording.displacement.times
        judged = np.concatenate([comparison.times[result.judged(comparison)] for result, comparison in compared])
        first, last = np.searchsorted(times, [judged.min(), judged.max()]).tolist()
        last = min(last, first + remaining - 1, times.size - 1)
        remaining -= last - first + 1
        piece = recording.between(times[max(first - _LEAD, 0)], np.nextafter(times[last], np.inf))
        # estimated set-points of misread recordings may be ones that `Device.simulate` refuses
        live = simulate_live(device.model, piece, device.constant_setpoints(piece, setpoints))
        for result, _ in compared:
            measured, simulated = result.channel.signal(recording), result.channel.signal(live)
            if measured is not None and simulated is not None:
                signal = measured.between(times[first], np.nextafter(times[last], np.inf))
                values = np.interp(signal.times, simulated.times, simulated.values)
                residuals[result.name].append(signal.values - values)
    return {
        name: _error(np.concatenate(runs), identification.channels[name].span)
        for name, runs in residuals.items()
        if runs
    }


def _error(residual: Array, span: float) -> PartError:
    rmse = rms(residual)
    return PartError(rmse, 100.0 * rmse / span)
