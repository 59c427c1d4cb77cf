# SPDX-License-Identifier: Apache-2.0
"""
Simulate, identify and watch a pneumatic constant-force device.

`import cfd_pneumatic as cfd` offers what `cfd_pneumatic.api` holds; it is loaded when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cfd_pneumatic.api import (
        CylinderSignals,
        Decay,
        Device,
        InputError,
        Limits,
        Plan,
        Recording,
        Result,
        Sensing,
        Signal,
        decay_of,
        identify,
        plan,
        read_mapping,
        read_recording,
        write_recording,
    )

__version__ = '0.2.0'

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
"""Names that are taken from `cfd_pneumatic.api`."""


def __getattr__(name: str) -> Any:
    """Return what is offered under a name."""
    if name in __all__:
        return getattr(import_module('cfd_pneumatic.api'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return the names that are offered."""
    return sorted([*__all__, '__version__', '__doc__'])
