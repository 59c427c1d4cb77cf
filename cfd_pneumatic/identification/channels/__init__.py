# SPDX-License-Identifier: Apache-2.0
"""
What is measured: one file for each kind of channel.

A further one is a module here that defines a subclass of `Channel`; nothing else has to know of it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator, Sequence

from cfd_pneumatic.identification.channels.channel import UNTOLD, Channel, Curve, Effects, Estimate, Model, Quantity
from cfd_pneumatic.identification.channels.characteristics import PLACES, VARIABLES
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.channels.unknown import Unknown
from cfd_pneumatic.identification.data import Options
from cfd_pneumatic.recording import Recording

for _found in pkgutil.iter_modules(__path__):
    importlib.import_module(f'{__name__}.{_found.name}')


def channels_of(recordings: Sequence[Recording], options: Options) -> list[Channel]:
    """Return the channels that recordings hold, cylinders first."""
    kinds = sorted(_kinds(Channel.__subclasses__()), key=lambda kind: kind.rank)
    return [channel for kind in kinds for channel in kind.found_in(recordings, options)]


def _kinds(classes: Iterable[type[Channel]]) -> Iterator[type[Channel]]:
    """Yield classes and what is derived from them."""
    for kind in classes:
        yield kind
        yield from _kinds(kind.__subclasses__())


__all__ = [
    'PLACES',
    'UNTOLD',
    'VARIABLES',
    'Channel',
    'Curve',
    'Effects',
    'Estimate',
    'Force',
    'Model',
    'Pressure',
    'Quantity',
    'Unknown',
    'channels_of',
]
