# SPDX-License-Identifier: Apache-2.0
"""The programs that need no ROS graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.commands.identify_bag import CHECKSUM_KEY, PROGRESS_KEY
    from cfd_pneumatic.commands.identify_bag import main as identify_bag_main
    from cfd_pneumatic.commands.program import run
    from cfd_pneumatic.commands.record_rig import main as record_rig_main
else:
    __getattr__ = loader_of(__name__)
