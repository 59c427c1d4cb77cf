# SPDX-License-Identifier: Apache-2.0
"""Recordings of the user's own arrays: checked, and cleaned as those of files are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.recording.bags.messages import NANOSECONDS
from cfd_pneumatic.recording.cleaning import Cleaned, at_changes, clean
from cfd_pneumatic.recording.signals import CylinderSignals, Recording, Signal

_LATEST = 2**62  # [ns]


def recording_from_arrays(
    times: ArrayLike,
    displacement: ArrayLike | None,
    pressures: Mapping[str, ArrayLike],
    setpoints: Mapping[str, ArrayLike],
    force: ArrayLike | None,
    name: str,
) -> Recording:
    """Do as `Recording.from_arrays`."""
    stamps = _stamps(times)
    if not pressures:
        raise InputError('no pressure is given: give pressures={"cylinder_a": ...} or cylinder_b, or both [Pa]')
    for cylinder in {**pressures, **setpoints}:
        if cylinder not in CYLINDERS:
            raise InputError(f'{cylinder!r} is no cylinder: the cylinders are {" and ".join(CYLINDERS)}')
        if cylinder not in pressures:
            raise InputError(f'{cylinder} has a set-point and no pressure: give its pressure, too')
    notes: list[str] = []

    def cleaned(values: ArrayLike, what: str, *, held: bool = False) -> Cleaned:
        found = clean(stamps.copy(), _values(values, what, stamps.size, held=held), what, held=held)
        notes.extend(found.notes)
        return at_changes(found) if held else found

    moved = None if displacement is None else cleaned(displacement, 'displacement')
    measured = {one: cleaned(values, f'{one} pressure') for one, values in pressures.items()}
    commanded = {one: cleaned(values, f'{one} setpoint', held=True) for one, values in setpoints.items()}
    felt = None if force is None else cleaned(force, 'force')
    epoch = min(int(one.times[0]) for one in (moved, *measured.values(), felt) if one is not None)

    def signal(one: Cleaned) -> Signal:
        return Signal((one.times - epoch) / NANOSECONDS, one.values)

    cylinders = {
        one: CylinderSignals(signal(found), signal(commanded[one]) if one in commanded else None)
        for one, found in measured.items()
    }
    rest = Signal((stamps - epoch) / NANOSECONDS, np.zeros(stamps.size))
    return Recording(
        name,
        epoch,
        rest if moved is None else signal(moved),
        cylinders,
        None if felt is None else signal(felt),
        tuple(notes),
        rests=moved is None,
    )


def _stamps(times: ArrayLike) -> NDArray[np.int64]:
    """Return times as stamps [ns]: seconds, or dates of NumPy or pandas."""
    given = np.asarray(times)
    if given.ndim != 1 or given.size < 2:
        raise InputError(f'times have the shape {given.shape}: give one time for each sample, two or more')
    if given.dtype.kind == 'M':
        found: NDArray[np.int64] = given.astype('datetime64[ns]').astype(np.int64)
        if np.any(np.isnat(given)):
            raise InputError('a time is no date (NaT): leave these samples out')
        return found
    seconds = _numbers(given, 'times')
    if not np.all(np.isfinite(seconds)) or np.max(np.abs(seconds)) * NANOSECONDS > _LATEST:
        raise InputError('a time is not finite, or far too large: give seconds, or dates')
    return np.rint(seconds * NANOSECONDS).astype(np.int64)


def _values(values: ArrayLike, what: str, size: int, *, held: bool) -> Array:
    found = _numbers(np.asarray(values), what)
    if held and found.ndim == 0:
        found = np.full(size, float(found))
    if found.shape != (size,):
        raise InputError(f'{what} has the shape {found.shape}: give one value for each of the {size} times')
    return found.copy()


def _numbers(values: NDArray[np.generic], what: str) -> Array:
    try:
        return values.astype(float)
    except (TypeError, ValueError) as error:
        raise InputError(f'{what} holds something that is no number: give an array of numbers in SI units') from error
