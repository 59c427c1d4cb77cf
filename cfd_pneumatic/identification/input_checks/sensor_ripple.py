# SPDX-License-Identifier: Apache-2.0
"""
Ripple of the displacement that the pressure does not follow: its sensor makes them, not the piston.

Where a piston is driven evenly from one reversal to the next, a sensor may see it wave: its target is no plane, or
sways. Whether the piston does, the pressure tells, which follows its speed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import legvander

from cfd_pneumatic.arrays import Array, rms
from cfd_pneumatic.identification.data import Experiment, Motion, stroke_times
from cfd_pneumatic.identification.fit import Fit
from cfd_pneumatic.identification.input_checks.thresholds import (
    EASING_TIME,
    EVEN_MOTION_DEGREE,
    FEWEST_EVEN_SAMPLES,
    LARGEST_FOLLOWED_SHARE,
    LEAST_END_SPEED,
    LEAST_EVEN_SPEED,
    LEAST_RIPPLE_EVIDENCE,
    SHORTEST_EVEN_MOTION,
)
from cfd_pneumatic.notices import Notice, note
from cfd_pneumatic.recording import Recording


@dataclass(frozen=True)
class Ripple:
    """
    Ripple of a recording's displacement in even motion.

    Attributes
    ----------
    without
        The recording without them.
    spans
        Begin and end of each stretch of even motion [s].
    size
        Their root mean square [m].

    """

    without: Recording
    spans: tuple[tuple[float, float], ...]
    size: float


def ripple_of(recording: Recording, motion: Motion) -> Ripple | None:
    """Return the waves of a displacement; None where no motion is even for long, or none stick out of the noise."""
    if not motion.reach:
        return None
    times, moved = motion.times, motion.displacement
    spans, waves = [], []
    for begin, end in pairwise(stroke_times(times, moved, motion.noise).tolist()):
        if end - begin < SHORTEST_EVEN_MOTION:
            continue
        stroke = _between(times, begin, end)
        speed = np.abs(motion.rate[stroke])
        usual = float(np.median(speed))
        fast = times[stroke][speed >= LEAST_END_SPEED * usual]
        first, last = float(fast[0]) + EASING_TIME, float(fast[-1]) - EASING_TIME
        inside = _between(times, first, last)
        if last - first < SHORTEST_EVEN_MOTION or inside.stop - inside.start < FEWEST_EVEN_SAMPLES:
            continue
        if np.min(np.abs(motion.rate[inside])) > LEAST_EVEN_SPEED * usual:
            from_end = np.minimum(times[inside] - first, last - times[inside])
            uneven = _uneven(times[inside], moved[inside])
            spans.append((first + EASING_TIME, last - EASING_TIME))
            waves.append((inside, np.minimum(from_end / EASING_TIME, 1.0) * uneven))
    size = rms(np.concatenate([one for _, one in waves])) if waves else 0.0
    if size <= motion.uncertainty:
        return None
    values = recording.displacement.values.copy()
    for inside, one in waves:
        values[inside] -= one
    without = replace(recording, displacement=replace(recording.displacement, values=values))
    return Ripple(without, tuple(spans), size)


def ripple_notice(pressures: Sequence[tuple[Ripple, Fit, Experiment, Experiment]]) -> Notice | None:
    """
    Return what to say of waves that the pressures do not follow; None where they do, or nothing tells.

    What follows early or late follows, too. Test parts have no say.

    Parameters
    ----------
    pressures
        The waves of each recording with some, and of each cylinder in it its fit, and the recording as it is and
        without waves, made ready for the model.

    """
    told = [one for some in pressures for one in _told(*some)]
    if not told:
        return None
    expected, slope, left = np.hstack(told)
    if float(expected @ (expected - 2.0 * left)) <= LEAST_RIPPLE_EVIDENCE:
        return None
    basis, _ = np.linalg.qr(np.stack([expected, slope], axis=1))
    share = float(np.linalg.norm(basis.T @ left) / np.linalg.norm(expected))
    if share >= LARGEST_FOLLOWED_SHARE:
        return None
    size = max(waves.size for waves, *_ in pressures)
    return note(
        'waves_left_out',
        f'where the piston moves evenly the displacement waves by {size * 1e3:.2g} mm, of which the pressures follow '
        f'{share:.0%}; the sensor makes these waves, and they are left out',
        "look at the sensor's target and mount; sim_node and monitor_node still see the waves",
    )


def _told(waves: Ripple, fit: Fit, recorded: Experiment, even: Experiment) -> Iterator[Array]:
    """Yield what waves would make of a pressure, its slope, and what is left without them, shape (3, n) [residuals]."""
    times, known = recorded.sample_times, recorded.sample_times[recorded.fitted]
    if not known.size:
        return
    with_waves, without = (fit.likelihood.channel.simulated([one], fit.model)[0] for one in (recorded, even))
    without = np.interp(times, even.sample_times, without)
    expected = with_waves - without
    signals = np.stack([expected, np.gradient(expected, times), recorded.measured - without])
    inside = [_between(times, begin, min(end, float(known[-1]))) for begin, end in waves.spans]
    uneven = [_uneven(times[one], signals[:, one]) for one in inside if one.stop - one.start >= FEWEST_EVEN_SAMPLES]
    if uneven:
        found = np.hstack(uneven)
        yield found / rms(found[-1])


def _between(times: Array, begin: float, end: float) -> slice:
    """Return which of increasing times lie between two."""
    first, last = np.searchsorted(times, [begin, end]).tolist()
    return slice(first, max(first, last))


def _uneven(times: Array, signals: Array) -> Array:
    """Return signals, shape (..., n), less what is even in them."""
    since = (times - times[0]) / (times[-1] - times[0])
    basis, _ = np.linalg.qr(legvander(2.0 * since - 1.0, EVEN_MOTION_DEGREE))
    return np.asarray(signals - signals @ basis @ basis.T)
