# SPDX-License-Identifier: Apache-2.0
"""
From recordings to parameters, and to what the model lacks: fit, uncertainty, identifiability, effects.

A name is loaded when it is first asked for: a monitor needs the noise's formulas long before it needs a fit.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cfd_pneumatic.identification.channels.channel import Estimate
    from cfd_pneumatic.identification.data.options import Options
    from cfd_pneumatic.identification.fit.fit import Fit
    from cfd_pneumatic.identification.procedure import identify
    from cfd_pneumatic.identification.result import ChannelResult, Geometry, Identification
    from cfd_pneumatic.identification.verdict import PartError

__all__ = ['ChannelResult', 'Estimate', 'Fit', 'Geometry', 'Identification', 'Options', 'PartError', 'identify']

_MODULES = {
    'ChannelResult': 'result',
    'Estimate': 'channels.channel',
    'Fit': 'fit.fit',
    'Geometry': 'result',
    'Identification': 'result',
    'Options': 'data.options',
    'PartError': 'verdict',
    'identify': 'procedure',
}


def __getattr__(name: str) -> Any:
    """Return what is offered under a name."""
    if name in _MODULES:
        return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
