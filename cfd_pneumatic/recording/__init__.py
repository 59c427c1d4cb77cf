# SPDX-License-Identifier: Apache-2.0
"""
Read bags and tables into arrays in SI units, and write recordings as bags.

`read_recording` returns a `Recording`; each of its signals has separate sample times. `write_recording` writes a
recording as a bag. `sampled` and `recording_of` make a `Recording` of arrays. `read_mapping` reads a `ChannelMapping`,
which describes the signals of a bag or table with other names. `BagWriter` writes a bag block by block.
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
        Topic,
        check_bag,
    )
    from cfd_pneumatic.recording.displacement import read_displacement
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
    from cfd_pneumatic.recording.message_texts import count_of, listed
    from cfd_pneumatic.recording.reading import read_recording
    from cfd_pneumatic.recording.recording import Recording
    from cfd_pneumatic.recording.sampled_signals import recording_of, sampled
    from cfd_pneumatic.recording.signals import ABSOLUTE, GAUGE, CylinderSignals, Signal
    from cfd_pneumatic.recording.table_rows import bounded_lines, encoding_of
    from cfd_pneumatic.recording.topics import list_topics
    from cfd_pneumatic.recording.writing import stamps_of, streams_of, write_recording
else:
    __getattr__ = loader_of(__name__)
