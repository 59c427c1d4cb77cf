"""Recordings of the rig's panel, and pressures of known models, made ready for the identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from reference import AMBIENT

from cfd_pneumatic.identification.data.experiment import make_experiment, observed_motion
from cfd_pneumatic.identification.data.split import split_recordings
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal


def recording_of(draw, name='drawn'):
    """Return what the sensors of a draw gave, as a recording of cylinder A."""
    got = draw.recording
    return recorded(got.times, got.displacement, got.setpoints[:, 0], got.pressures[:, 0], name, got.force)


def recorded(times, displacement, setpoint, pressure, name='made', force=None):
    """Return signals on one clock as a recording; entry i of the set-point acts up to sample i, from the one before."""
    begins = np.concatenate([times[:1], times[:-1]])
    changes = np.concatenate([[True], np.diff(setpoint) != 0.0])
    cylinder = CylinderSignals(Signal(times, pressure), Signal(begins[changes], setpoint[changes]))
    felt = None if force is None else Signal(times, force)
    return Recording(name, 0, Signal(times, displacement), {'cylinder_a': cylinder}, felt, ())


def experiments_of(recordings):
    """Return cylinder A of each recording, as the identification sees it."""
    motions, strokes = zip(*(observed_motion(one) for one in recordings))
    splits, _ = split_recordings(list(strokes))
    return [make_experiment(one, 'cylinder_a', *seen) for one, *seen in zip(recordings, motions, splits)]


def moved(times, displacement, setpoint, noise=5e-7, seed=0):
    """Return an experiment with such inputs, the displacement measured with noise; its pressure is still to be made."""
    rng = np.random.default_rng(seed)
    measured = displacement + noise * rng.standard_normal(times.size)
    return experiments_of([recorded(times, measured, setpoint, rng.standard_normal(times.size))])[0]


def with_pressure(experiment, extension, noise=0.0):
    """Return an experiment whose pressure is a known model's, which has one offset and one start, with noise [Pa]."""
    (pressure,) = extension.simulate([experiment], AMBIENT)
    return replace(experiment, pressure=pressure + noise)
