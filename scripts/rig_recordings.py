"""The rig without a graph: it follows a surface, is read as from a bag, and is identified."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CYLINDERS, PISTON_AREA
from cfd_pneumatic.identification import Identification
from cfd_pneumatic.model import Cylinder, Device, ForceGeometry, OperatingPoints
from cfd_pneumatic.model.effects import EFFECTS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig import Performance, RigParameters, RigRecord, surface_following
from cfd_pneumatic.rig.panel import PanelRecording

EPOCH = 1_700_000_000_000_000_000


def surfaces(rig: RigParameters, seed: int, duration: float = 60.0) -> Performance:
    """Return a rig that follows a random surface, over and over."""
    schedule = surface_following(duration=duration, seed=seed).with_return()
    return Performance(schedule, rig, seed=seed)


def take(performance: Performance, count: int) -> RigRecord:
    """Return so many samples; a schedule begins again at its end."""
    if not performance.remaining:
        performance.rewind()
    return performance.take(count)


def recording_of(record: RigRecord | PanelRecording) -> Recording:
    """Return what a rig's sensors gave, as it is read from a bag."""
    times = record.times
    begins = np.concatenate([times[:1], times[:-1]])
    cylinders = {}
    for index, cylinder in enumerate(CYLINDERS):
        changes = np.diff(record.setpoints[:, index], prepend=np.nan) != 0.0
        setpoint = Signal(begins[changes], record.setpoints[changes, index])
        cylinders[cylinder] = CylinderSignals(Signal(times, record.pressures[:, index]), setpoint)
    displacement, force = Signal(times, record.displacement), Signal(times, record.force)
    return Recording('recording', EPOCH, displacement, cylinders, force, ())


def identified_device(identification: Identification) -> Device:
    """Return the model that an identification ends with, as `sim_node` has it from the parameter file."""
    cylinders = []
    for name in CYLINDERS:
        model = identification.channels[name].found.model
        # the phase of an effect of the time belongs to a recording's own
        effects = {key: own for key, own in model.effects.items() if not EFFECTS[key].of_time}
        points = OperatingPoints(np.zeros(1), *(np.array([gain]) for gain in model.parameters))
        cylinders.append(Cylinder(points, AMBIENT_PRESSURE, effects))
    area, force_effects = PISTON_AREA, {}
    if 'force' in identification.channels:
        model = identification.channels['force'].found.model
        area, force_effects = float(model.parameters[0]), dict(model.effects)
    return Device(*cylinders, ForceGeometry(area, 1.0, AMBIENT_PRESSURE), force_effects, seal_play=2e-6)
