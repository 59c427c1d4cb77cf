# SPDX-License-Identifier: Apache-2.0
"""What a device makes of a recording: smoothed, as it is identified, or sample by sample, as `sim_node` answers it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import (
    Channel,
    Experiment,
    Force,
    Model,
    Motion,
    Pressure,
    rests_at_start,
    smooth_motion,
)
from cfd_pneumatic.model import Cylinder, CylinderState, DeviceModel, LiveDevice
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

_FEWEST = 5  # samples that a spline needs
_STARTING = 3  # samples whose median a pressure begins with
_LONGEST_GAP = 1.0  # as `sim_node` has it by default [s]


def smoothed(
    device: DeviceModel, recording: Recording, constant: Mapping[str, float], measured_pressures: bool = False
) -> Recording:
    """Return pressures and force at the times at which they were measured; constant set-points are gauge [Pa]."""
    signal = recording.displacement
    if len(signal) < _FEWEST:
        raise InputError(f'{recording.name}: {len(signal)} displacement samples are too few to simulate anything')
    motion = smooth_motion(signal.times, signal.values)
    setpoints = _setpoints(device, recording, constant)
    cylinders = {
        name: CylinderSignals(_pressure(name, one, recording, motion, setpoints[name]), setpoints[name])
        for name, one in device.cylinders.items()
    }
    found = replace(recording, cylinders=cylinders, force=None, health=(), others={})
    if measured_pressures and recording.cylinders.keys() != device.cylinders.keys():
        raise InputError(f'{recording.name}: pressures of {", ".join(device.cylinders)} are needed for the force')
    source = recording if measured_pressures else found
    return replace(found, force=_force(device, source, motion, recording.force or signal))


def _setpoints(device: DeviceModel, recording: Recording, constant: Mapping[str, float]) -> dict[str, Signal]:
    """Return the absolute set-points [Pa]: the constant ones, or those that were recorded."""
    begin, ambient = recording.displacement.times[:1], device.geometry.ambient_pressure
    found = {}
    for name in device.cylinders:
        recorded = None if name in constant else recording.cylinders[name].setpoint
        found[name] = Signal(begin, np.array([constant[name] + ambient])) if recorded is None else recorded
    return found


def _pressure(name: str, cylinder: Cylinder, recording: Recording, motion: Motion, setpoint: Signal) -> Signal:
    measured = recording.cylinders[name].pressure if name in recording.cylinders else None
    stamps = recording.displacement.times if measured is None else measured.times
    sampled = motion.clock_of(stamps)
    within = motion.during(sampled)
    channel = Pressure(name, cylinder.ambient_pressure)
    level = float(setpoint.values[0])
    times, inputs = channel.driven(motion, level if setpoint.times.size == 1 else setpoint, sampled[within])
    samples = np.searchsorted(times, sampled[within])
    first = level + cylinder.setpoint_offset
    if measured is not None and not rests_at_start(motion):
        first = float(np.median(measured.values[within][:_STARTING]))
    if cylinder.effects and cylinder.parameters.setpoints.size == 1:
        start = first - level - cylinder.setpoint_offset
        own = np.array([[cylinder.setpoint_offset, start, 0.0]])
        model = Model.of_parts(cylinder.parameters.table[0, 1:], cylinder.effects, own)
        values = _simulated(channel, model, recording, motion, times, inputs, samples)
    else:
        state = CylinderState.at_rest(first) if not cylinder.effects else None
        values = cylinder.simulate(times, inputs['displacement'], inputs['setpoint'], state)[samples]
    return Signal(stamps[within], values)


def _force(device: DeviceModel, simulated: Recording, motion: Motion, at: Signal) -> Signal:
    geometry = device.geometry
    channel = Force(geometry.area, geometry.geometric_factor, geometry.ambient_pressure)
    sampled = motion.clock_of(at.times)
    within = channel.within(simulated, motion, sampled)
    times, inputs = channel.driven(simulated, motion, sampled[within])
    samples = np.searchsorted(times, sampled[within])
    parameters = np.array([geometry.area, geometry.geometric_factor])
    model = Model(parameters, device.force_effects, np.zeros((1, 1)))
    return Signal(at.times[within], _simulated(channel, model, simulated, motion, times, inputs, samples))


def _simulated(
    channel: Channel,
    model: Model,
    recording: Recording,
    motion: Motion,
    times: Array,
    inputs: Mapping[str, Array],
    samples: NDArray[np.intp],
) -> Array:
    """Return what a channel's model makes of inputs, at the samples, as a fit has it."""
    experiment = Experiment(
        recording=recording.name,
        times=times,
        inputs=inputs,
        samples=samples,
        measured=np.zeros(samples.size),
        part=np.zeros(samples.size, np.int8),
        motion=motion,
        starts_at_rest=rests_at_start(motion),
    )
    return channel.simulated([experiment], model)[0]


def answered(device: DeviceModel, recording: Recording, constant: Mapping[str, float]) -> Recording:
    """
    Return pressures and force at the displacement's samples, each answered as it comes.

    A set-point acts up to the first sample that is later, as in a node that hears it before that sample. After a gap it
    starts anew, at rest.
    """
    signal = recording.displacement
    setpoints = _setpoints(device, recording, constant)
    stamps = _nanoseconds(signal.times)
    ambient = device.geometry.ambient_pressure
    held = np.full((len(signal), len(CYLINDERS)), ambient)
    for name, one in setpoints.items():
        place = np.searchsorted(_nanoseconds(one.times), stamps) - 1
        held[:, CYLINDERS.index(name)] = one.values[np.maximum(place, 0)]
    live = LiveDevice(device, _LONGEST_GAP)
    answers = np.empty((len(signal), len(CYLINDERS) + 1))
    for index, (stamp, position, pair) in enumerate(zip(stamps.tolist(), signal.values.tolist(), held.tolist())):
        live.sample(stamp, position, (pair[0], pair[1]))
        assert live.committed is not None
        state = live.committed.state
        readings = [ambient if one is None else one.reading for one in (state.a, state.b)]
        answers[index] = *readings, device.contact_force(state)
    cylinders = {
        name: CylinderSignals(Signal(signal.times, answers[:, CYLINDERS.index(name)]), setpoints[name])
        for name in device.cylinders
    }
    force = Signal(signal.times, answers[:, -1])
    return replace(recording, cylinders=cylinders, force=force, health=(), others={})


def _nanoseconds(times: Array) -> NDArray[np.int64]:
    """Return times [s] as stamps [ns]."""
    return np.rint(times * 1e9).astype(np.int64)
