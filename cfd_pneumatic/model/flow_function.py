# SPDX-License-Identifier: Apache-2.0
"""The flow function of ISO 6358: the flow through an orifice as a function of the pressure ratio."""

from __future__ import annotations

import math

from cfd_pneumatic.model.kernels import inlined

CRITICAL = 0.528
"""Pressure ratio below which the flow is choked [-]."""


@inlined
def relative_flow(ratio):
    """Return the flow relative to the choked flow [-] at a pressure ratio, downstream / upstream."""
    share = min(max((ratio - CRITICAL) / (1.0 - CRITICAL), 0.0), 1.0)
    return math.sqrt(1.0 - share * share)
