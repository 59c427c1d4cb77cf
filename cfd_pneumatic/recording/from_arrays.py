# SPDX-License-Identifier: Apache-2.0
"""Recordings of the user's own arrays: checked, and cleaned as those of files are."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cfd_pneumatic.arguments import check_type
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.cleaning import Cleaned, at_changes, clean, share_at_shared_times
from cfd_pneumatic.recording.outliers import screened
from cfd_pneumatic.recording.signals import CylinderSignals, Signal

_LATEST = 2**62  # [ns]

_COARSEST = 0.5
"""Resolution of times in intervals between samples above which their type cannot hold them."""


class ArraySignals(NamedTuple):
    """The signals of arrays, and what was amiss; of a piston at rest the displacement is zero."""

    epoch: int
    displacement: Signal
    cylinders: dict[str, CylinderSignals]
    force: Signal | None
    notes: tuple[str, ...]
    shared_times: float


def signals_from_arrays(
    times: ArrayLike,
    displacement: ArrayLike | None,
    pressures: Mapping[str, ArrayLike],
    setpoints: Mapping[str, ArrayLike],
    force: ArrayLike | None,
    name: str,
) -> ArraySignals:
    """Return the signals of arrays, checked and cleaned, as `Recording.from_arrays` takes them."""
    for what, given in (('pressures', pressures), ('setpoints', setpoints)):
        check_type(what, given, Mapping, f'a dictionary such as {what}={{"cylinder_a": ...}}')
    check_type('name', name, str, 'a text')
    stamps = _stamps(times)
    if not pressures:
        raise InputError('no pressure is given: give pressures={"cylinder_a": ...} or cylinder_b, or both [Pa]')
    for cylinder in {**pressures, **setpoints}:
        if cylinder not in CYLINDERS:
            raise InputError(f'{cylinder!r} is no cylinder: the cylinders are {" and ".join(CYLINDERS)}')
        if cylinder not in pressures:
            raise InputError(f'{cylinder} has a set-point and no pressure: give its pressure, too')
        if setpoints.get(cylinder, 0.0) is None:
            raise InputError(
                f'the set-point of {cylinder} is None: leave {cylinder} out of setpoints if none was recorded'
            )
    notes: list[str] = []
    shared = [0.0]

    def cleaned(values: ArrayLike, role: str, name: str) -> Cleaned:
        numbers = _values(values, name, stamps.size, held=False)
        shared.append(share_at_shared_times(stamps, numbers))
        found = screened(clean(stamps.copy(), numbers, name), role, name)
        notes.extend(found.notes)
        return found

    def held(values: ArrayLike, name: str) -> Cleaned:
        found = clean(stamps.copy(), _values(values, name, stamps.size, held=True), name, held=True)
        notes.extend(found.notes)
        return at_changes(found)

    moved = None if displacement is None else cleaned(displacement, 'displacement', 'displacement')
    measured = {one: cleaned(values, 'pressure', f'{one} pressure') for one, values in pressures.items()}
    commanded = {one: held(values, f'{one} setpoint') for one, values in setpoints.items()}
    felt = None if force is None else cleaned(force, 'force', 'force')
    epoch = min(int(one.times[0]) for one in (moved, *measured.values(), felt) if one is not None)

    def signal(one: Cleaned) -> Signal:
        return Signal((one.times - epoch) / NANOSECONDS, one.values)

    cylinders = {
        one: CylinderSignals(signal(found), signal(commanded[one]) if one in commanded else None)
        for one, found in measured.items()
    }
    rest = Signal((stamps - epoch) / NANOSECONDS, np.zeros(stamps.size))
    return ArraySignals(
        epoch,
        rest if moved is None else signal(moved),
        cylinders,
        None if felt is None else signal(felt),
        tuple(notes),
        max(shared),
    )


def _stamps(times: ArrayLike) -> NDArray[np.int64]:
    """Return times as stamps [ns]: seconds, dates or times since the beginning, of NumPy, pandas or Python."""
    given = _array(times, 'times')
    if given.ndim != 1 or given.size < 2:
        raise InputError(f'times have the shape {given.shape}: give one time for each sample, two or more')
    if given.dtype.kind in 'OSU':
        given = _parsed(given)
    if given.dtype.kind in 'mM':
        if np.any(np.isnat(given)):
            raise InputError('a time is no date (NaT): leave these samples out')
        if np.max(np.abs(given.astype(f'{given.dtype.kind}8[s]').astype(float))) * NANOSECONDS > _LATEST:
            raise InputError('a date is far too late or too early: check the times')
        return given.astype(f'{given.dtype.kind}8[ns]').astype(np.int64)
    seconds = _numbers(given, 'times')
    if not np.all(np.isfinite(seconds)) or np.max(np.abs(seconds)) * NANOSECONDS > _LATEST:
        raise InputError('a time is not finite, or far too large: give seconds, or dates')
    if given.dtype.kind == 'f':
        resolution = float(np.spacing(np.max(np.abs(given))))
        if resolution > _COARSEST * np.ptp(seconds) / (seconds.size - 1):
            raise InputError(
                f'times are {given.dtype}, which holds them to {resolution:.3g} s only: give float64, or dates'
            )
    return np.rint(seconds * NANOSECONDS).astype(np.int64)


def _parsed(texts: NDArray[Any]) -> NDArray[Any]:
    """Return numbers, dates or durations of an array of texts or objects; dates without a zone are UTC."""
    for kind in (float, 'datetime64[ns]', 'timedelta64[ns]'):
        with suppress(TypeError, ValueError), catch_warnings():
            simplefilter('ignore')  # NumPy warns of a zone, and converts the date to UTC
            return texts.astype(kind)
    raise InputError('times holds something that is no number: give seconds, or dates such as 2024-05-01T12:00:00.25')


def _array(values: ArrayLike, what: str) -> NDArray[Any]:
    """Return an array, with nan or NaT where values are masked."""
    try:
        array: Any = np.ma.asarray(values)
        if array.dtype.kind in 'biu':
            array = array.astype(float)  # integers have no nan
        filled: NDArray[Any] = array.filled('NaT' if array.dtype.kind in 'mM' else np.nan)
    except (TypeError, ValueError) as error:
        raise InputError(f'{what} cannot be made an array: give one value for each time') from error
    return filled


def _values(values: ArrayLike, what: str, size: int, *, held: bool) -> Array:
    found = _numbers(_array(values, what), what)
    if held and found.ndim == 0:
        found = np.full(size, float(found))
    if found.shape != (size,):
        raise InputError(f'{what} has the shape {found.shape}: give one value for each of the {size} times')
    return found.copy()


def _numbers(values: NDArray[Any], what: str) -> Array:
    if values.dtype.kind == 'c':
        raise InputError(f'{what} is complex: give an array of real numbers in SI units')
    try:
        return values.astype(float)
    except (TypeError, ValueError) as error:
        raise InputError(f'{what} holds something that is no number: give an array of numbers in SI units') from error
