# SPDX-License-Identifier: Apache-2.0
"""
Recordings: bags and tables to arrays in SI units, and back.

`read_recording` returns a `Recording`, whose signals are each on their own times; `write_recording` makes a bag of one.
`sampled` and `recording_of` make a `Recording` of arrays. A `ChannelMapping`, read by `read_mapping`, says where a bag
or a table of another make keeps the signals. `BagWriter` writes a bag block by block.
"""

from cfd_pneumatic.recording.bags.writing import BagWriter, check_bag
from cfd_pneumatic.recording.mapping import ChannelMapping, read_mapping
from cfd_pneumatic.recording.reading import read_recording
from cfd_pneumatic.recording.sampled import recording_of, sampled
from cfd_pneumatic.recording.signals import CylinderSignals, Recording, Signal
from cfd_pneumatic.recording.writing import write_recording

__all__ = [
    'BagWriter',
    'ChannelMapping',
    'CylinderSignals',
    'Recording',
    'Signal',
    'check_bag',
    'read_mapping',
    'read_recording',
    'recording_of',
    'sampled',
    'write_recording',
]
