# SPDX-License-Identifier: Apache-2.0
"""The paper's pneumatic model: parameters, exact propagation, the two-cylinder device. No input or output."""

from cfd_pneumatic.model.cylinder import Course, Cylinder, CylinderState, simulate_parameter_sets
from cfd_pneumatic.model.device import DIRECTIONS, DeviceModel, DeviceState, ForceGeometry
from cfd_pneumatic.model.extended import ExtendedCylinder, Movement
from cfd_pneumatic.model.first_principles import AspiratorTube, Regulator, first_guess
from cfd_pneumatic.model.live import Arrival, Committed, LiveDevice, warm_up
from cfd_pneumatic.model.parameters import NAMES, SPECS, TABLE_1, TABLE_2, OperatingPoints

__all__ = [
    'DIRECTIONS',
    'NAMES',
    'SPECS',
    'TABLE_1',
    'TABLE_2',
    'Arrival',
    'AspiratorTube',
    'Committed',
    'Course',
    'Cylinder',
    'CylinderState',
    'DeviceModel',
    'DeviceState',
    'ExtendedCylinder',
    'ForceGeometry',
    'LiveDevice',
    'Movement',
    'OperatingPoints',
    'Regulator',
    'first_guess',
    'simulate_parameter_sets',
    'warm_up',
]
