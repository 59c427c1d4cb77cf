# SPDX-License-Identifier: Apache-2.0
"""The paper's pneumatic model: parameters, exact propagation, the two-cylinder device. No input or output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.model.cylinder import Course, Cylinder, CylinderState
    from cfd_pneumatic.model.device_model import DIRECTIONS, DeviceModel, DeviceState, ForceGeometry
    from cfd_pneumatic.model.effects import (
        BOTH_WAYS,
        CORES,
        CURVE,
        CURVE_AGAINST,
        CURVE_ENTERS,
        EFFECTS,
        FORCE_CURVE,
        FORCE_CURVE_AGAINST,
        FORCE_CURVE_ENTERS,
        FORCE_EFFECTS,
        FORCE_PARTS,
        FUNCTIONS,
        GENERIC,
        KNOTS,
        LIFTING,
        MODULES,
        ONE_WAY,
        PRESSURE_EFFECTS,
        PRESSURE_PARTS,
        Data,
        Effect,
        EffectParameter,
        Moment,
        is_of_flow,
    )
    from cfd_pneumatic.model.extended import MOVING, ExtendedCylinder, Movement, SideBySide, extremes
    from cfd_pneumatic.model.extended_force import ExtendedForce
    from cfd_pneumatic.model.first_principles import AspiratorTube, Regulator, first_guess
    from cfd_pneumatic.model.gain_starts import (
        HINTS,
        alternative_starts,
        displacement_sensitivity,
        flows,
        identifiable_gain_bounds,
        slowest,
        starting_gains,
    )
    from cfd_pneumatic.model.kernels import fused, kernel, summed
    from cfd_pneumatic.model.lanes import COUNT
    from cfd_pneumatic.model.live import Arrival, LiveDevice, warm_up
    from cfd_pneumatic.model.parameters import NAMES, SPECS, TABLE_1, TABLE_1_ROWS, TABLE_2, OperatingPoints
    from cfd_pneumatic.model.propagation import propagate
else:
    __getattr__ = loader_of(__name__)
