# SPDX-License-Identifier: Apache-2.0
"""Cutting recordings into train, validation and test parts that each hold motion."""

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
    Where one recording is cut.

    Attributes
    ----------
    bounds
        Times at which validation and test begin [s]; infinite where a part is empty.
    whole
        Name of the part that the whole recording belongs to, or None where it is cut.
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
    Return indices at which strokes begin and end, shape (strokes + 1,); empty where nothing moves.

    A stroke is a run of motion in one direction; a reversal, or a rest, counts once the displacement has left its last
    extremum by more than `threshold` [m].
    """
    points = np.empty(displacement.size + 1, np.intp)
    return points[: _turns(displacement, threshold, points)].copy()


@compiler()
def _turns(displacement: Array, threshold: float, points: NDArray[np.intp]) -> int:
    """Write the indices at which strokes begin, and that at which the last one ends; return how many they are."""
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
    Return the times at which strokes begin and end, shape (strokes + 1,); empty where nothing moves.

    Motion is more than `LEAST_MOTION` times the displacement's noise [m] and `LEAST_STROKE` of its whole range.
    """
    threshold = max(LEAST_MOTION * noise, LEAST_STROKE * float(np.ptp(displacement)))
    return times[turning_points(displacement, threshold)]


def _cut(strokes: Array, fractions: tuple[float, float, float]) -> Split:
    """Cut one recording at the turning points nearest to the wanted fractions, at least one stroke in each part."""
    count = strokes.size - 1
    first, last = strokes[0], strokes[-1]
    targets = first + (last - first) * np.cumsum(fractions)[:2]
    validation = int(np.clip(np.argmin(np.abs(strokes - targets[0])), 1, count - 2))
    test = int(np.clip(np.argmin(np.abs(strokes - targets[1])), validation + 1, count - 1))
    bounds = (float(strokes[validation]), float(strokes[test]))
    return Split(bounds, None, (validation, test - validation, count - test))


def _whole(part: str, strokes: Array) -> Split:
    """
    Deal out a whole recording.

    What lies before its first stroke counts as train whatever the part: a regulator set by hand has a set-point of its
    own in each recording, and the rest before the motion tells it.
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
    Return where each recording is cut, and why there is no test part where there is none.

    A recording with at least five strokes is cut in time at whole strokes. Where none has as many, at least three
    recordings are dealt out whole. Otherwise everything is train: a test part without motion would be blind.

    Parameters
    ----------
    strokes
        For each recording the times at which its strokes begin and end [s].
    fractions
        Shares of train, validation and test.

    """
    if any(times.size - 1 >= FEWEST_STROKES for times in strokes):
        splits = [
            _cut(times, fractions) if times.size - 1 >= FEWEST_STROKES else _whole('train', times) for times in strokes
        ]
        return splits, None
    count = len(strokes)
    if count >= 3:
        test = max(1, round(fractions[2] * count))
        validation = max(1, round(fractions[1] * count))
        parts = ['train'] * (count - validation - test) + ['validation'] * validation + ['test'] * test
        return [_whole(part, times) for part, times in zip(parts, strokes)], None
    total = sum(max(times.size - 1, 0) for times in strokes)
    reason = (
        f'{total} stroke{"s" if total != 1 else ""} in {count} recording{"s" if count != 1 else ""}: '
        'no test part that holds motion of its own can be set aside, so the errors given are those of the fit'
    )
    return [_whole('train', times) for times in strokes], reason
