# SPDX-License-Identifier: Apache-2.0
"""Did the device change during a recording, and when? No other module states the time of a change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.changes.change import Change, DeviceState, Difference
    from cfd_pneumatic.identification.changes.detection import Cut, cut_of_curve, find_cut
    from cfd_pneumatic.identification.changes.drift import Drift, find_drift, without_drift
else:
    __getattr__ = loader_of(__name__)
