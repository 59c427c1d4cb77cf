# SPDX-License-Identifier: Apache-2.0
"""
Recordings: bags and tables to arrays in SI units, and back.

`read_recording` returns a `Recording`, whose signals are each on their own times; `write_recording` makes a bag of one.
`sampled` and `recording_of` make a `Recording` of arrays. A `ChannelMapping`, read by `read_mapping`, says where a bag
or a table of another make keeps the signals. `BagWriter` writes a bag block by block.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.recording.bags import (
        METADATA,
        ROS1_SUFFIX,
        STORAGES,
        SUFFIXES,
        Bag,
        BagWriter,
        StorageName,
        Stream,
        check_bag,
    )
    from cfd_pneumatic.recording.dropouts import is_noisy
    from cfd_pneumatic.recording.gaps import split_at_gaps
    from cfd_pneumatic.recording.mapping import (
        COLUMN_KEYS,
        NUMBER_KEYS,
        PRESSURE_KEYS,
        TABLE_KEYS,
        TOP_KEYS,
        TOPIC_KEYS,
        ChannelMapping,
        read_mapping,
    )
    from cfd_pneumatic.recording.message_texts import count_of
    from cfd_pneumatic.recording.reading import read_recording
    from cfd_pneumatic.recording.recording import Recording
    from cfd_pneumatic.recording.sampled_signals import recording_of, sampled
    from cfd_pneumatic.recording.signals import ABSOLUTE, GAUGE, CylinderSignals, Signal
    from cfd_pneumatic.recording.writing import stamps_of, streams_of, write_recording
else:
    __getattr__ = loader_of(__name__)
