# SPDX-License-Identifier: Apache-2.0
"""
From recordings to parameters, and to what the model lacks: fit, uncertainty, identifiability, effects.

A name is loaded when it is first asked for: a monitor needs the noise's formulas long before it needs a fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.identification.channels.channel import Estimate
    from cfd_pneumatic.identification.conclusion import PartError
    from cfd_pneumatic.identification.data.options import Options
    from cfd_pneumatic.identification.fit.fit import Fit
    from cfd_pneumatic.identification.procedure import identify
    from cfd_pneumatic.identification.result import ChannelResult, Geometry, Identification
else:
    __getattr__ = loader_of(__name__)

__all__ = ['ChannelResult', 'Estimate', 'Fit', 'Geometry', 'Identification', 'Options', 'PartError', 'identify']
