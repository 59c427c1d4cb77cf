# SPDX-License-Identifier: Apache-2.0
"""
Detect sensor ripple: oscillations of the displacement that the pressure does not follow.

The sensor of an evenly driven piston shows ripple if its target is not flat or sways. The pressure follows the speed of
the piston, so that the pressure shows whether the piston itself oscillates.
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
        The recording without ripple.
    spans
        Begin and end of each even motion [s].
    size
        Root mean square of the ripple [m].

    """

    without: Recording
    spans: tuple[tuple[float, float], ...]
    size: float


def ripple_of(recording: Recording, motion: Motion) -> Ripple | None:
    """Return the ripple of a displacement; None without a long even motion, or if the ripple is within the noise."""
    if not motion.reach:
        return None
    times, displacement = motion.times, motion.displacement
    spans, ripples = [], []
    for begin, end in pairwise(stroke_times(times, displacement, motion.noise).tolist()):
        if end - begin < SHORTEST_EVEN_MOTION:
            continue
        stroke = _slice_between(times, begin, end)
        speed = np.abs(motion.rate[stroke])
        usual = float(np.median(speed))
        fast = times[stroke][speed >= LEAST_END_SPEED * usual]
        first, last = float(fast[0]) + EASING_TIME, float(fast[-1]) - EASING_TIME
        inside = _slice_between(times, first, last)
        if last - first < SHORTEST_EVEN_MOTION or inside.stop - inside.start < FEWEST_EVEN_SAMPLES:
            continue
        if np.min(np.abs(motion.rate[inside])) > LEAST_EVEN_SPEED * usual:
            from_end = np.minimum(times[inside] - first, last - times[inside])
            uneven = _uneven_part(times[inside], displacement[inside])
            spans.append((first + EASING_TIME, last - EASING_TIME))
            ripples.append((inside, np.minimum(from_end / EASING_TIME, 1.0) * uneven))
    size = rms(np.concatenate([ripple for _, ripple in ripples])) if ripples else 0.0
    if size <= motion.uncertainty:
        return None
    values = recording.displacement.values.copy()
    for inside, ripple in ripples:
        values[inside] -= ripple
    without = replace(recording, displacement=replace(recording.displacement, values=values))
    return Ripple(without, tuple(spans), size)


def ripple_notice(pressures: Sequence[tuple[Ripple, Fit, Experiment, Experiment]]) -> Notice | None:
    """
    Return a note about ripple that the pressures do not follow; None if they follow, or without evidence.

    A pressure that leads or lags the ripple follows, too. Test parts are not used.

    Parameters
    ----------
    pressures
        Ripple of a recording, fit of a cylinder in that recording, and the cylinder's experiments with and without the
        ripple.

    """
    signals = [rows for pressure in pressures for rows in _ripple_signals(*pressure)]
    if not signals:
        return None
    expected, slope, residual = np.hstack(signals)
    if float(expected @ (expected - 2.0 * residual)) <= LEAST_RIPPLE_EVIDENCE:
        return None
    basis, _ = np.linalg.qr(np.stack([expected, slope], axis=1))
    share = float(np.linalg.norm(basis.T @ residual) / np.linalg.norm(expected))
    if share >= LARGEST_FOLLOWED_SHARE:
        return None
    size = max(ripple.size for ripple, *_ in pressures)
    return note(
        'waves_left_out',
        f'the displacement has sensor ripple of {size * 1e3:.2g} mm in even motion, of which the pressures follow '
        f'{share:.0%}. The identification removes the ripple',
        "inspect the sensor's target and mount; sim_node and monitor_node still receive the ripple",
    )


def _ripple_signals(ripple: Ripple, fit: Fit, recorded: Experiment, even: Experiment) -> Iterator[Array]:
    """Yield the pressure that the ripple would cause, its slope, and the residual without ripple, (3, n) [residual]."""
    times, fitted_times = recorded.sample_times, recorded.sample_times[recorded.fitted]
    if not fitted_times.size:
        return
    channel = fit.likelihood.channel
    with_ripple, without = (channel.simulated([experiment], fit.model)[0] for experiment in (recorded, even))
    without = np.interp(times, even.sample_times, without)
    expected = with_ripple - without
    signals = np.stack([expected, np.gradient(expected, times), recorded.measured - without])
    spans = [_slice_between(times, begin, min(end, float(fitted_times[-1]))) for begin, end in ripple.spans]
    spans = [span for span in spans if span.stop - span.start >= FEWEST_EVEN_SAMPLES]
    uneven = [_uneven_part(times[span], signals[:, span]) for span in spans]
    if uneven:
        rows = np.hstack(uneven)
        yield rows / rms(rows[-1])


def _slice_between(times: Array, begin: float, end: float) -> slice:
    """Return the slice of increasing times between two times."""
    first, last = np.searchsorted(times, [begin, end]).tolist()
    return slice(first, max(first, last))


def _uneven_part(times: Array, signals: Array) -> Array:
    """Return signals, shape (..., n), minus a polynomial of time."""
    elapsed = (times - times[0]) / (times[-1] - times[0])
    basis, _ = np.linalg.qr(legvander(2.0 * elapsed - 1.0, EVEN_MOTION_DEGREE))
    return np.asarray(signals - signals @ basis @ basis.T)
