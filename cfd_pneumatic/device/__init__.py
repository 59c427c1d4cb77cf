# SPDX-License-Identifier: Apache-2.0
"""Describe a device by its parameters: their descriptors, the parameter file, and simulation of recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.device.descriptors import DESCRIPTORS, NO_NAMES, Descriptor, Value
    from cfd_pneumatic.device.device import Device, default_of
    from cfd_pneumatic.device.file import REPORT_FILE, check_run, is_parameter_file, report_in, run_line, run_of
    from cfd_pneumatic.device.force_error import (
        ForcePerSpeed,
        combined_force_per_speed,
        force_per_pressure,
        force_per_speed,
    )
    from cfd_pneumatic.device.identified import identified_device, identified_recordings
    from cfd_pneumatic.device.identified_range import SPEED_INTERVAL, IdentifiedRange, Span
    from cfd_pneumatic.device.live_error import live_errors
    from cfd_pneumatic.device.simulation import simulate_motion
else:
    __getattr__ = loader_of(__name__)
