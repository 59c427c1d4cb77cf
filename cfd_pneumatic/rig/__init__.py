# SPDX-License-Identifier: Apache-2.0
"""
A virtual test rig: a simulated constant-force device that replaces a real device.

Its physics are nonlinear and share no code with the model that is identified from its records::

    from cfd_pneumatic.rig import paper_step, record

    run = record(paper_step(setpoint=34.5e3), seed=1)
    run.times, run.displacement, run.pressures   # readings of the sensors
    run.truth.pressures                          # true values

A faulty device has `Effects`; `studies.panel` generates faulty devices at random.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.rig.bench import Bench, Performance, RigRecord, record
    from cfd_pneumatic.rig.compilation import compiled
    from cfd_pneumatic.rig.devices import DEVICES, device_named, with_faults
    from cfd_pneumatic.rig.effects import Effects
    from cfd_pneumatic.rig.oddities import ForceOddities, Oddities
    from cfd_pneumatic.rig.parameters import Air, Cylinder, Piston, RigParameters, Seal, with_changes
    from cfd_pneumatic.rig.physics import (
        ADIABATIC_EXPONENT,
        ELLIPSE,
        LEAK_CRITICAL_RATIO,
        ONE_WAY_SPEED,
        SPECIFIC_HEAT,
        CylinderState,
        cylinder_rates,
        orifice_flow,
    )
    from cfd_pneumatic.rig.piston import CommandedPiston
    from cfd_pneumatic.rig.rig import Rig, Truth
    from cfd_pneumatic.rig.schedule import (
        LONGEST,
        MIL,
        Schedule,
        SetPoints,
        lay_out,
        out_and_back,
        paper_step,
        surface_following,
    )
    from cfd_pneumatic.rig.schedule_names import SCHEDULES, schedule_named, written_schedule
    from cfd_pneumatic.rig.sensors import Instruments, Readings, Sensors
    from cfd_pneumatic.rig.stroke import Stroke
    from cfd_pneumatic.rig.transmission import Transmission, read_force
else:
    __getattr__ = loader_of(__name__)
