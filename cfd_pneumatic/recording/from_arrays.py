# SPDX-License-Identifier: Apache-2.0
"""Check and clean a user's arrays for a recording, in the same way as files."""

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
"""Coarsest accepted resolution of the type of times, in intervals between samples."""


class ArraySignals(NamedTuple):
    """Signals of arrays, with notes on defects; the displacement of a piston at rest is zero."""

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
    """Return checked and cleaned signals of arrays; see `Recording.from_arrays`."""
    for argument, mapping in (('pressures', pressures), ('setpoints', setpoints)):
        check_type(argument, mapping, Mapping, f'a dictionary such as {argument}={{"cylinder_a": ...}}')
    check_type('name', name, str, 'a text')
    stamps = _stamps(times)
    if not pressures:
        raise InputError('no pressure: give pressures={"cylinder_a": ...} or cylinder_b, or both [Pa]')
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
        samples = screened(clean(stamps.copy(), numbers, name), role, name)
        notes.extend(samples.notes)
        return samples

    def held(values: ArrayLike, name: str) -> Cleaned:
        samples = clean(stamps.copy(), _values(values, name, stamps.size, held=True), name, held=True)
        notes.extend(samples.notes)
        return at_changes(samples)

    clean_displacement = None if displacement is None else cleaned(displacement, 'displacement', 'displacement')
    clean_pressures = {
        cylinder: cleaned(values, 'pressure', f'{cylinder} pressure') for cylinder, values in pressures.items()
    }
    clean_setpoints = {cylinder: held(values, f'{cylinder} setpoint') for cylinder, values in setpoints.items()}
    clean_force = None if force is None else cleaned(force, 'force', 'force')
    sampled = (clean_displacement, *clean_pressures.values(), clean_force)
    epoch = min(int(samples.times[0]) for samples in sampled if samples is not None)

    def signal(samples: Cleaned) -> Signal:
        return Signal((samples.times - epoch) / NANOSECONDS, samples.values)

    cylinders = {
        cylinder: CylinderSignals(
            signal(samples), signal(clean_setpoints[cylinder]) if cylinder in clean_setpoints else None
        )
        for cylinder, samples in clean_pressures.items()
    }
    rest = Signal((stamps - epoch) / NANOSECONDS, np.zeros(stamps.size))
    return ArraySignals(
        epoch,
        rest if clean_displacement is None else signal(clean_displacement),
        cylinders,
        None if clean_force is None else signal(clean_force),
        tuple(notes),
        max(shared),
    )


def _stamps(times: ArrayLike) -> NDArray[np.int64]:
    """Convert times to stamps [ns]: seconds, dates or durations of NumPy, pandas or Python."""
    array = _array(times, 'times')
    if array.ndim != 1 or array.size < 2:
        raise InputError(f'times have the shape {array.shape}: give one time for each sample, two or more')
    if array.dtype.kind in 'OSU':
        array = _parsed(array)
    if array.dtype.kind in 'mM':
        if np.any(np.isnat(array)):
            raise InputError('a time is no date (NaT): leave these samples out')
        if np.max(np.abs(array.astype(f'{array.dtype.kind}8[s]').astype(float))) * NANOSECONDS > _LATEST:
            raise InputError('a date is far too late or too early: check the times')
        return array.astype(f'{array.dtype.kind}8[ns]').astype(np.int64)
    seconds = _numbers(array, 'times')
    if not np.all(np.isfinite(seconds)) or np.max(np.abs(seconds)) * NANOSECONDS > _LATEST:
        raise InputError('a time is not finite, or far too large: give seconds, or dates')
    if array.dtype.kind == 'f':
        resolution = float(np.spacing(np.max(np.abs(array))))
        if resolution > _COARSEST * np.ptp(seconds) / (seconds.size - 1):
            raise InputError(
                f'times are {array.dtype}, which holds them to {resolution:.3g} s only: give float64, or dates'
            )
    return np.rint(seconds * NANOSECONDS).astype(np.int64)


def _parsed(texts: NDArray[Any]) -> NDArray[Any]:
    """Convert texts or objects to numbers, dates or durations; dates without a zone are UTC."""
    for kind in (float, 'datetime64[ns]', 'timedelta64[ns]'):
        with suppress(TypeError, ValueError), catch_warnings():
            simplefilter('ignore')  # NumPy warns of a zone, and converts the date to UTC
            return texts.astype(kind)
    raise InputError('times holds something that is no number: give seconds, or dates such as 2024-05-01T12:00:00.25')


def _array(values: ArrayLike, signal_name: str) -> NDArray[Any]:
    """Return an array, with nan or NaT where values are masked."""
    try:
        array: Any = np.ma.asarray(values)
        if array.dtype.kind in 'biu':
            array = array.astype(float)  # integers have no nan
        filled: NDArray[Any] = array.filled('NaT' if array.dtype.kind in 'mM' else np.nan)
    except (TypeError, ValueError) as error:
        raise InputError(f'{signal_name} cannot be made an array: give one value for each time') from error
    return filled


def _values(values: ArrayLike, signal_name: str, size: int, *, held: bool) -> Array:
    numbers = _numbers(_array(values, signal_name), signal_name)
    if held and numbers.ndim == 0:
        numbers = np.full(size, float(numbers))
    if numbers.shape != (size,):
        raise InputError(f'{signal_name} has the shape {numbers.shape}: give one value for each of the {size} times')
    return numbers.copy()


def _numbers(values: NDArray[Any], signal_name: str) -> Array:
    if values.dtype.kind == 'c':
        raise InputError(f'{signal_name} is complex: give an array of real numbers in SI units')
    try:
        return values.astype(float)
    except (TypeError, ValueError) as error:
        raise InputError(f'{signal_name} holds something that is no number: give numbers in SI units') from error
