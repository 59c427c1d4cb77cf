# SPDX-License-Identifier: Apache-2.0
"""A device as its parameters describe it: their table, its file, and what it makes of a recording."""

from cfd_pneumatic.device.descriptors import DESCRIPTORS, NO_NAMES, Descriptor, Value
from cfd_pneumatic.device.device import Device, default_of
from cfd_pneumatic.device.identified_range import SPEED_INTERVAL, IdentifiedRange, Span

__all__ = [
    'DESCRIPTORS',
    'NO_NAMES',
    'SPEED_INTERVAL',
    'Descriptor',
    'Device',
    'IdentifiedRange',
    'Span',
    'Value',
    'default_of',
]
