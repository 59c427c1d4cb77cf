# SPDX-License-Identifier: Apache-2.0
"""Cut recordings into train, validation and test parts that each hold motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.data.options import FRACTIONS
from cfd_pneumatic.identification.data.thresholds import FEWEST_STROKES, LEAST_MOTION, LEAST_STROKE
from cfd_pneumatic.runtime import compiler

PARTS = ('train', 'validation', 'test')


@dataclass(frozen=True)
class Split:
    """
    Cuts of a recording into parts.

    Attributes
    ----------
    bounds
        Times at which validation and test begin [s]; infinite where a part is empty.
    whole
        Name of the part that the whole recording belongs to, or None if the recording is cut.
    strokes
        Number of strokes in each part.

    """

    bounds: tuple[float, float]
    whole: str | None
    strokes: tuple[int, int, int]

    def part_of(self, times: Array) -> NDArray[np.int8]:
        """Return the index into `PARTS` of each time, shape (n,)."""
        return np.searchsorted(np.array(self.bounds), times, side='right').astype(np.int8)


def turning_points(displacement: Array, threshold: float) -> NDArray[np.intp]:
    """
    Return the indices at which strokes begin and end, shape (strokes + 1,); empty if nothing moves.

    A stroke is motion in one direction. A stroke begins at an extremum once the displacement is more than `threshold`
    [m] away from this extremum.
    """
    points = np.empty(displacement.size + 1, np.intp)
    return points[: _write_turning_points(displacement, threshold, points)].copy()


@compiler()
def _write_turning_points(displacement: Array, threshold: float, points: NDArray[np.intp]) -> int:
    """Write the indices at which strokes begin, and the end of the last stroke; return their number."""
    count, direction, low, high = 0, 0, 0, 0
    for index in range(displacement.size):
        value = displacement[index]
        if value > displacement[high]:
            high = index
        if value < displacement[low]:
            low = index
        if direction <= 0 and value - displacement[low] > threshold:
            points[count] = low
            count, direction, high = count + 1, 1, index
        elif direction >= 0 and displacement[high] - value > threshold:
            points[count] = high
            count, direction, low = count + 1, -1, index
    if count:
        points[count] = high if direction > 0 else low
        count += 1
    return count


def stroke_times(times: Array, displacement: Array, noise: float) -> Array:
    """
    Return the times at which strokes begin and end, shape (strokes + 1,); empty if nothing moves.

    Motion exceeds `LEAST_MOTION` times the displacement's noise [m] and the share `LEAST_STROKE` of its range.
    """
    threshold = max(LEAST_MOTION * noise, LEAST_STROKE * float(np.ptp(displacement)))
    return times[turning_points(displacement, threshold)]


def _cut_at_strokes(strokes: Array, fractions: tuple[float, float, float]) -> Split:
    """Cut a recording at the turning points nearest to the fractions, with at least one stroke in each part."""
    count = strokes.size - 1
    begin, end = strokes[0], strokes[-1]
    targets = begin + (end - begin) * np.cumsum(fractions)[:2]
    validation = int(np.clip(np.argmin(np.abs(strokes - targets[0])), 1, count - 2))
    test = int(np.clip(np.argmin(np.abs(strokes - targets[1])), validation + 1, count - 1))
    bounds = (float(strokes[validation]), float(strokes[test]))
    return Split(bounds, None, (validation, test - validation, count - test))


def _uncut(part: str, strokes: Array) -> Split:
    """
    Assign a whole recording to a part, except that samples before the first stroke are train.

    A regulator that is set by hand has another set-point in each recording. The samples before the motion determine
    this set-point.
    """
    begin = float(strokes[0]) if strokes.size else -np.inf
    bounds = {'train': (np.inf, np.inf), 'validation': (begin, np.inf), 'test': (begin, begin)}
    counts = [0, 0, 0]
    counts[PARTS.index(part)] = max(strokes.size - 1, 0)
    return Split(bounds[part], part, (counts[0], counts[1], counts[2]))


def split_recordings(
    strokes: list[Array], fractions: tuple[float, float, float] = FRACTIONS
) -> tuple[list[Split], str | None]:
    """
    Return the cuts of each recording, and the reason if there is no test part.

    A recording with at least five strokes is cut in time at whole strokes. If no recording has five strokes, three or
    more recordings are assigned whole. Otherwise everything is train: a test part without motion would show no error.

    Parameters
    ----------
    strokes
        Times at which strokes begin and end, for each recording [s].
    fractions
        Shares of train, validation and test.

    """
    if any(times.size - 1 >= FEWEST_STROKES for times in strokes):
        splits = [
            _cut_at_strokes(times, fractions) if times.size - 1 >= FEWEST_STROKES else _uncut('train', times)
            for times in strokes
        ]
        return splits, None
    count = len(strokes)
    if count >= 3:
        test = max(1, round(fractions[2] * count))
        validation = max(1, round(fractions[1] * count))
        parts = ['train'] * (count - validation - test) + ['validation'] * validation + ['test'] * test
        return [_uncut(part, times) for part, times in zip(parts, strokes)], None
    total = sum(max(times.size - 1, 0) for times in strokes)
    reason = (
        f'{total} stroke{"s" if total != 1 else ""} in {count} recording{"s" if count != 1 else ""}: '
        'too few for a test part with motion, so that the errors are those of the fit'
    )
    return [_uncut('train', times) for times in strokes], reason
