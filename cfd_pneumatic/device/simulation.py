# SPDX-License-Identifier: Apache-2.0
"""Simulate a device from a recording: with smoothing as in the identification, or sample by sample as in `sim_node`."""

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

_FEWEST_SAMPLES = 5  # of a spline
_START_SAMPLES = 3  # with the median of which a pressure begins
_LONGEST_GAP = 1.0  # default of `sim_node` [s]


def simulate_smoothed(
    device: DeviceModel, recording: Recording, constant: Mapping[str, float], measured_pressures: bool = False
) -> Recording:
    """Simulate pressures and force at the times of the measurements; constant set-points are gauge [Pa]."""
    signal = recording.displacement
    if len(signal) < _FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: {len(signal)} displacement samples are too few: give at least {_FEWEST_SAMPLES}'
        )
    motion = smooth_motion(signal.times, signal.values)
    setpoints = _setpoints(device, recording, constant)
    if measured_pressures and recording.cylinders.keys() != device.cylinders.keys():
        raise InputError(f'{recording.name}: the force needs recorded pressures of {", ".join(device.cylinders)}')
    return simulate_motion(device, recording, motion, setpoints, measured_pressures)


def simulate_motion(
    device: DeviceModel,
    recording: Recording,
    motion: Motion,
    setpoints: Mapping[str, Signal],
    measured_pressures: bool = False,
) -> Recording:
    """Simulate pressures and force of a smoothed motion at absolute set-points by cylinder [Pa]."""
    cylinders = {
        name: CylinderSignals(_simulate_pressure(name, cylinder, recording, motion, setpoints[name]), setpoints[name])
        for name, cylinder in device.cylinders.items()
    }
    simulated = replace(recording, cylinders=cylinders, force=None, health=(), others={})
    source = recording if measured_pressures else simulated
    force = _simulate_force(device, source, motion, recording.force or recording.displacement)
    return replace(simulated, force=force)


def _setpoints(device: DeviceModel, recording: Recording, constant: Mapping[str, float]) -> dict[str, Signal]:
    """Return the absolute set-points [Pa], constant or as recorded."""
    begin, ambient = recording.displacement.times[:1], device.geometry.ambient_pressure
    setpoints = {}
    for name in device.cylinders:
        recorded = None if name in constant else recording.cylinders[name].setpoint
        setpoints[name] = Signal(begin, np.array([constant[name] + ambient])) if recorded is None else recorded
    return setpoints


def _simulate_pressure(name: str, cylinder: Cylinder, recording: Recording, motion: Motion, setpoint: Signal) -> Signal:
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
        first = float(np.median(measured.values[within][:_START_SAMPLES]))
    if cylinder.effects and cylinder.parameters.setpoints.size == 1:
        start = first - level - cylinder.setpoint_offset
        experiment_values = np.array([[cylinder.setpoint_offset, start, 0.0]])
        model = Model.of_parts(cylinder.parameters.table[0, 1:], cylinder.effects, experiment_values)
        values = _simulate_channel(channel, model, recording, motion, times, inputs, samples)
    else:
        state = CylinderState.at_rest(first) if not cylinder.effects else None
        values = cylinder.simulate(times, inputs['displacement'], inputs['setpoint'], state)[samples]
    return Signal(stamps[within], values)


def _simulate_force(device: DeviceModel, simulated: Recording, motion: Motion, measured: Signal) -> Signal:
    geometry = device.geometry
    channel = Force(geometry.area, geometry.geometric_factor, geometry.ambient_pressure)
    sampled = motion.clock_of(measured.times)
    within = channel.within(simulated, motion, sampled)
    times, inputs = channel.driven(simulated, motion, sampled[within])
    samples = np.searchsorted(times, sampled[within])
    parameters = np.array([geometry.area, geometry.geometric_factor])
    model = Model(parameters, device.force_effects, np.zeros((1, 1)))
    values = _simulate_channel(channel, model, simulated, motion, times, inputs, samples)
    return Signal(measured.times[within], values)


def _simulate_channel(
    channel: Channel,
    model: Model,
    recording: Recording,
    motion: Motion,
    times: Array,
    inputs: Mapping[str, Array],
    samples: NDArray[np.intp],
) -> Array:
    """Simulate a channel's model at the samples, as in a fit."""
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


def simulate_live(device: DeviceModel, recording: Recording, constant: Mapping[str, float]) -> Recording:
    """
    Simulate pressures and force at the samples of the displacement, sample by sample.

    A set-point acts up to the first later sample, as in a node that receives the set-point before that sample. After a
    gap the simulation restarts at rest.
    """
    signal = recording.displacement
    setpoints = _setpoints(device, recording, constant)
    stamps = _nanoseconds(signal.times)
    ambient = device.geometry.ambient_pressure
    levels = np.full((len(signal), len(CYLINDERS)), ambient)
    for name, setpoint in setpoints.items():
        indices = np.searchsorted(_nanoseconds(setpoint.times), stamps) - 1
        levels[:, CYLINDERS.index(name)] = setpoint.values[np.maximum(indices, 0)]
    live = LiveDevice(device, _LONGEST_GAP)
    samples = np.empty((len(signal), len(CYLINDERS) + 1))
    for index, (stamp, position, pair) in enumerate(zip(stamps.tolist(), signal.values.tolist(), levels.tolist())):
        live.sample(stamp, position, (pair[0], pair[1]))
        assert live.committed is not None
        state = live.committed.state
        readings = [ambient if cylinder is None else cylinder.reading for cylinder in (state.a, state.b)]
        samples[index] = *readings, device.contact_force(state)
    cylinders = {
        name: CylinderSignals(Signal(signal.times, samples[:, CYLINDERS.index(name)]), setpoints[name])
        for name in device.cylinders
    }
    force = Signal(signal.times, samples[:, -1])
    return replace(recording, cylinders=cylinders, force=force, health=(), others={})


def _nanoseconds(times: Array) -> NDArray[np.int64]:
    """Return times [s] as stamps [ns]."""
    return np.rint(times * 1e9).astype(np.int64)
