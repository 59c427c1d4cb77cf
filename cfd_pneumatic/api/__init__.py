# SPDX-License-Identifier: Apache-2.0
"""What `import cfd_pneumatic as cfd` offers, see docs/python.md."""

from cfd_pneumatic.api.result import Result, identify
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Decay, decay_of
from cfd_pneumatic.planning import Limits, Plan, Sensing, plan
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal, read_mapping, read_recording, write_recording

__all__ = [
    'CylinderSignals',
    'Decay',
    'Device',
    'InputError',
    'Limits',
    'Plan',
    'Recording',
    'Result',
    'Sensing',
    'Signal',
    'decay_of',
    'identify',
    'plan',
    'read_mapping',
    'read_recording',
    'write_recording',
]
