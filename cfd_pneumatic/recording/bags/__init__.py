# SPDX-License-Identifier: Apache-2.0
"""
Read and write bags: files of serialised messages, as blocks of messages.

This package does not depend on signals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.recording.bags.bag import Bag, Topic
    from cfd_pneumatic.recording.bags.storages import METADATA, ROS1_SUFFIX, STORAGES, SUFFIXES, StorageName
    from cfd_pneumatic.recording.bags.writing import BagWriter, Stream, check_bag
else:
    __getattr__ = loader_of(__name__)
