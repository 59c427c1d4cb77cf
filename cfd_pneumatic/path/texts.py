# SPDX-License-Identifier: Apache-2.0
"""Answers of a preview as texts, for the terminal, the page and Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification import number
from cfd_pneumatic.path.motion import PathMotion
from cfd_pneumatic.path.prediction import Prediction, Violation
from cfd_pneumatic.path.preview import Held, Preview
from cfd_pneumatic.path.thresholds import LATEST, MOST_PLACES, SLOWEST_SHARE

_LITRES_PER_MINUTE = 6e4
"""l/min in a m^3/s."""


def answers(preview: Preview) -> list[tuple[str, str]]:
    """Return the questions that a preview answers, each with its answer."""
    return [(question, answer) for question, answer in _answers(preview) if answer]


def _answers(preview: Preview) -> Iterator[tuple[str, str]]:
    constant = preview.constant
    yield 'Path', _path_text(preview)
    yield 'Set-points', f'{_levels_text(preview)}, constant: the mean force on the path is {preview.task.force:g} N.'
    yield 'Force error', _error_text(constant)
    yield 'Tolerance', _tolerance_text(constant)
    yield 'Fastest feed', _feed_text(preview)
    yield 'Causes', _causes_text(preview)
    yield (
        'Air',
        f'{number(_LITRES_PER_MINUTE * preview.air, 2)} l/min (ANR), without what the regulators bleed at rest.',
    )
    if preview.held is not None:
        yield 'Held force', _held_text(preview.held, constant)


def _path_text(preview: Preview) -> str:
    path = preview.constant.path
    speed = float(np.max(np.abs(path.speed_at(path.grid))))
    travel = 1e3 * float(np.ptp(path.displacement))
    motion = f'The piston moves by {travel:.3g} mm, at up to {number(1e3 * speed, 2)} mm/s.'
    if path.along is None or preview.task.feed is None:
        return f'{path.duration:.3g} s. {motion}'
    length, feed = float(path.along[-1]), 1e3 * preview.task.feed
    size = f'{length:.4g} m' if length > 1.0 else f'{1e3 * length:.4g} mm'
    return f'{size} in {path.duration:.3g} s, at a feed of {feed:.3g} mm/s. {motion}'


def _levels_text(preview: Preview) -> str:
    return ', '.join(f'{name} {level:,.0f} Pa (gauge)' for name, level in preview.levels.items())


def _error_text(prediction: Prediction) -> str:
    error, half = prediction.error, prediction.half_band[prediction.path.is_on_path]
    worst = int(np.argmax(np.abs(error)))
    place = place_text(prediction.path, float(prediction.path.grid[prediction.path.is_on_path][worst]))
    return (
        f'{number(prediction.rms_error, 2)} N (RMS), at most {number(abs(float(error[worst])), 2)} N at {place}. '
        f'The 95 % band is ± {number(float(half[worst]), 2)} N there '
        f'and ± {number(prediction.rms_band, 2)} N on average.'
    )


def _tolerance_text(prediction: Prediction) -> str:
    if prediction.tolerance is None:
        return ''
    kept = f'± {prediction.tolerance:.3g} N'
    certain = [violation for violation in prediction.violations if violation.is_certain]
    possible = [violation for violation in prediction.violations if not violation.is_certain]
    if not prediction.violations:
        return f'{kept} is kept, within the whole band.'
    parts = [
        f'{kind} violated at {_places_text(prediction.path, violations)}'
        for kind, violations in (('certainly', certain), ('possibly', possible))
        if violations
    ]
    return f'{kept} is {"; ".join(parts)}.'


def _places_text(path: PathMotion, violations: Sequence[Violation]) -> str:
    shown = [_span_text(path, violation) for violation in violations[:MOST_PLACES]]
    hidden = len(violations) - len(shown)
    more = [] if not hidden else ['1 more place' if hidden == 1 else f'{hidden} more places']
    return ', '.join([*shown, *more])


def _span_text(path: PathMotion, violation: Violation) -> str:
    begin, end = (place_text(path, time) for time in violation[:2])
    return begin if begin == end else f'{begin.rpartition(" ")[0]} to {end}'


def place_text(path: PathMotion, time: float) -> str:
    """Return a place of the path as text: its position, or its time if no position is known."""
    along: Array | None = path.along_at(np.array([time]))
    return f'{time:.2f} s' if along is None else f'{1e3 * float(along[0]):.0f} mm'


def _feed_text(preview: Preview) -> str:
    feed, tolerance, wanted = preview.feed, preview.task.tolerance, preview.task.feed
    if feed is None or tolerance is None or wanted is None:
        return ''
    if feed.predicted is None:
        slowest = f'{1e3 * SLOWEST_SHARE * wanted:.2g} mm/s'
        return f'No feed down to {slowest} keeps ± {tolerance:.3g} N with these set-points.'
    predicted = f'{1e3 * feed.predicted:.3g} mm/s keep the tolerance as predicted'
    if feed.with_band is None:
        return f'{predicted}; no feed down to a sixteenth of that keeps it within the band.'
    return f'{predicted}, {1e3 * feed.with_band:.3g} mm/s within the whole band.'


def _causes_text(preview: Preview) -> str:
    causes = preview.causes
    growing, shrinking = (number(1e-3 * size, 2) for size in causes.per_speed)
    return (
        f'The force falls by {growing} N per mm/s while the piston moves along +x, and rises by {shrinking} N per mm/s '
        f'while it moves back. On this path: gains {number(causes.gains, 2)} N, '
        f'friction {number(causes.friction, 2)} N, leaks {number(causes.leaks, 2)} N (RMS).'
    )


def _held_text(held: Held, constant: Prediction) -> str:
    prediction = held.prediction
    text = (
        f'{number(prediction.rms_error, 2)} N (RMS) instead of {number(constant.rms_error, 2)} N, '
        f'at most {number(prediction.largest_error, 2)} N. '
        f'The 95 % band is ± {number(prediction.rms_band, 2)} N on average. '
    )
    if kept := _tolerance_text(prediction):
        text += f'{kept} '
    if not held.is_promised:
        text += 'The band is wider than the benefit: a smaller error is not promised. '
    if held.latest >= LATEST:
        return f'{text}Set-points that arrive {1e3 * LATEST:.0f} ms late still have a benefit.'
    return f'{text}The benefit is lost if the set-points arrive {1e3 * held.latest:.0f} ms late.'
