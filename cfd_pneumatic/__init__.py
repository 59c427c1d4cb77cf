# SPDX-License-Identifier: Apache-2.0
"""
Simulate, identify and watch a pneumatic constant-force device.

`import cfd_pneumatic as cfd` offers the names of `__all__`. Each name is loaded on first access.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.api import Result, identify
    from cfd_pneumatic.device import Device
    from cfd_pneumatic.errors import InputError
    from cfd_pneumatic.identification import Decay, decay_of
    from cfd_pneumatic.path import PathMotion, Surface
    from cfd_pneumatic.planning import Limits, Plan, Sensing, plan
    from cfd_pneumatic.recording import (
        CylinderSignals,
        Recording,
        Signal,
        read_mapping,
        read_recording,
        write_recording,
    )
else:
    __getattr__ = loader_of(__name__)

__version__ = '0.3.0'

__all__ = [
    'CylinderSignals',
    'Decay',
    'Device',
    'InputError',
    'Limits',
    'PathMotion',
    'Plan',
    'Recording',
    'Result',
    'Sensing',
    'Signal',
    'Surface',
    'decay_of',
    'identify',
    'plan',
    'read_mapping',
    'read_recording',
    'write_recording',
]
"""The public names."""


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted([*__all__, '__version__', '__doc__'])
