"""
Recordings: bags and tables to arrays in SI units, and back.

`read_recording` returns a `Recording`, whose signals are each on their own times; `write_recording` makes a bag of one.
A `ChannelMapping`, read by `read_mapping`, says where a bag or a table of another make keeps the signals. `BagWriter`
writes a bag message by message.
"""

from cfd_pneumatic.recording.mapping import ChannelMapping, read_mapping
from cfd_pneumatic.recording.reading import read_recording
from cfd_pneumatic.recording.signals import CylinderSignals, Recording, Signal
from cfd_pneumatic.recording.writer import BagWriter, write_recording

__all__ = [
    'BagWriter',
    'ChannelMapping',
    'CylinderSignals',
    'Recording',
    'Signal',
    'read_mapping',
    'read_recording',
    'write_recording',
]
