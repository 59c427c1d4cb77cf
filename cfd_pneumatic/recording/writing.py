# SPDX-License-Identifier: Apache-2.0
"""Write a recording as a bag in our convention."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arguments import check_numbers, check_path, check_switches, check_type
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE, PISTON_JOINT, ROLES
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.messages import NANOSECONDS, Form
from cfd_pneumatic.recording.bags import BagWriter, StorageName, Stream
from cfd_pneumatic.recording.recording import Recording
from cfd_pneumatic.recording.topics import resolve

_NAMESPACE = re.compile(r'/?|/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?', re.ASCII)
_LONGEST_NAMESPACE = 200  # characters

_LAST_STAMP = 2**31
"""Time from which on a stamp overflows [s]."""


def write_recording(
    path: Path | str,
    recording: Recording,
    *,
    namespace: str = '/cfd/device',
    storage: StorageName = 'mcap',
    ambient_pressure: float = AMBIENT_PRESSURE,
    joint: str = PISTON_JOINT,
    overwrite: bool = False,
) -> None:
    """
    Write a recording as a bag in our convention.

    The bag's metadata document the units of the table from which the recording was read.

    Parameters
    ----------
    path : Path or str
        Folder of the bag.
    recording : Recording
        Recording to write.
    namespace : str
        Namespace of the topics.
    storage : str
        `mcap` or `sqlite3`.
    ambient_pressure : float
        Ambient pressure, which is subtracted from the set-points: a bag has gauge set-points [Pa].
    joint : str
        Name of the piston in JointState.
    overwrite : bool
        Whether to replace an existing bag.

    Raises
    ------
    InputError
        If the bag cannot be written, the recording's times do not fit a stamp, or the namespace is not valid in ROS 2.

    """
    check_path('path', path)
    check_type('recording', recording, Recording, 'a recording')
    check_type('namespace', namespace, str, 'a text')
    check_numbers(ambient_pressure=ambient_pressure)
    check_switches(overwrite=overwrite)
    if len(namespace) > _LONGEST_NAMESPACE or not _NAMESPACE.fullmatch(namespace):
        raise InputError(
            f'namespace {printable(namespace)[:_LONGEST_NAMESPACE]}: give one as ROS 2 has it, /cfd/device'
        )
    with BagWriter(path, storage=storage, overwrite=overwrite) as bag:
        bag.write_streams(list(streams_of(recording, namespace, ambient_pressure, joint)))
        for role, cylinder, signal in recording.signals():
            if role in ROLES and signal.unit is not None:  # so that the checks of units also apply to the bag
                unit = f'{signal.unit} {signal.reference or ""}'.strip()
                bag.remark(resolve(namespace, ROLES[role].topic_of(cylinder)), unit)


def streams_of(
    recording: Recording, namespace: str, ambient_pressure: float, joint: str = PISTON_JOINT
) -> Iterator[Stream]:
    """
    Yield the streams of a recording on topics in a namespace, except signals that only a mapping defines.

    Set-points come first, so that at equal times a set-point precedes the samples on which it acts.
    """
    known = [(ROLES[role], cylinder, signal) for role, cylinder, signal in recording.signals() if role in ROLES]
    for role, cylinder, signal in sorted(known, key=lambda entry: not entry[0].held):
        yield Stream(
            resolve(namespace, role.topic_of(cylinder)),
            Form(role.msgtype, joint=joint),
            stamps_of(recording, signal.times),
            signal.values - ambient_pressure if role.gauge else signal.values,
        )


def stamps_of(recording: Recording, times: Array) -> NDArray[np.int64]:
    """
    Return the stamps of a recording's times [ns].

    Raises
    ------
    InputError
        If a time does not fit a stamp.

    """
    stamps = recording.epoch + np.rint(times * NANOSECONDS).astype(np.int64)
    if stamps[0] < 0 or stamps[-1] >= _LAST_STAMP * NANOSECONDS:
        first, last = stamps[[0, -1]] / NANOSECONDS
        raise InputError(
            f'{recording.name}: times of {first:g} to {last:g} s do not fit a stamp: check their unit and offset'
        )
    return stamps
