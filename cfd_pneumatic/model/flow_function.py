# SPDX-License-Identifier: Apache-2.0
"""The flow function of ISO 6358: how much passes an orifice, by the ratio of the pressures on its two sides."""

from __future__ import annotations

import math

from cfd_pneumatic.model.kernels import inlined

CRITICAL = 0.528
"""Pressure ratio below which the flow is choked [-]."""


@inlined
def passed(ratio):
    """Return the flow at a pressure ratio, downstream over upstream, against the choked flow [-]."""
    share = min(max((ratio - CRITICAL) / (1.0 - CRITICAL), 0.0), 1.0)
    return math.sqrt(1.0 - share * share)
