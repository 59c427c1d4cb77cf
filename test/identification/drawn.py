# SPDX-License-Identifier: Apache-2.0
"""Recordings of the rig's panel, and pressures of known models, made ready for the identification."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from reference import AMBIENT

from cfd_pneumatic.identification.channels.channel import Model
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.fit.likelihood import Likelihood
from cfd_pneumatic.identification.fit.uncertainty import information
from cfd_pneumatic.identification.preparation import prepare_recordings
from cfd_pneumatic.identification.search.complement import Complement
from cfd_pneumatic.recording import recording_of as recording_of_samples
from cfd_pneumatic.recording import sampled

CHANNEL = Pressure('cylinder_a', AMBIENT)


def recording_of(draw, name='drawn'):
    """Return what the sensors of a draw gave, as a recording of cylinder A."""
    got = draw.recording
    return recorded(got.times, got.displacement, got.setpoints[:, 0], got.pressures[:, 0], name)


def recorded(times, displacement, setpoint, pressure, name='made', force=None):
    """Return signals of cylinder A; entry i of the set-point acts up to sample i, from the one before."""
    return sampled(times, displacement, {'cylinder_a': pressure}, {'cylinder_a': setpoint}, force, name=name)


def both_cylinders(drawn):
    """Return what the sensors of a draw gave, cylinder B too, as the force is of both."""
    return recording_of_samples(drawn.recording, 'drawn')


def experiments_of(recordings, channel=CHANNEL):
    """Return cylinder A of each recording, as the identification sees it."""
    return list(prepare_recordings(recordings).experiments(channel))


def model(gains, effects=MappingProxyType({}), offsets=(0.0,), starts=(0.0,)):
    """Return a model of the pressure with an offset and a start for each experiment [Pa]."""
    return Model(np.array(gains), dict(effects), np.column_stack([offsets, starts, np.zeros_like(starts)]))


def whole(experiment):
    """Return an experiment whose samples all count."""
    return replace(experiment, chosen=np.ones(experiment.measured.size, dtype=bool))


def alike(experiments, weights=None, channel=CHANNEL):
    """Return the likelihood of experiments whose samples all count alike, or as some of them or weights say."""
    likelihood = Likelihood.alike(channel, [one if one.chosen is not None else whole(one) for one in experiments])
    return likelihood if weights is None else replace(likelihood, weights=tuple(weights))


def moved(times, displacement, setpoint, noise=5e-7, seed=0):
    """Return an experiment with such inputs, the displacement measured with noise; its pressure is still to be made."""
    rng = np.random.default_rng(seed)
    measured = displacement + noise * rng.standard_normal(times.size)
    return experiments_of([recorded(times, measured, setpoint, rng.standard_normal(times.size))])[0]


def with_pressure(experiment, known, noise=0.0):
    """Return an experiment whose pressure is a known model's, which has one offset and one start, with noise [Pa]."""
    (pressure,) = CHANNEL.simulated([experiment], known)
    return replace(experiment, measured=pressure + noise)


class Slope(NamedTuple):
    """Residuals at a fit, their derivatives (by logarithms where those are searched), and the names of the unknowns."""

    residuals: np.ndarray
    jacobian: np.ndarray
    names: tuple[str, ...]
    logarithmic: np.ndarray


def slope_of(experiments, fitted):
    """Return the slope of experiments whose samples all count alike."""
    likelihood = alike(experiments)
    table = CHANNEL.unknowns(experiments, fitted)
    scales = np.array([1.0 if one.logarithmic else one.scale for one in table])
    residuals = -np.concatenate(likelihood.residuals(likelihood.simulate(fitted)))
    names, logarithmic = tuple(one.name for one in table), np.array([one.logarithmic for one in table])
    return Slope(residuals, Complement(likelihood, fitted).jacobian / scales, names, logarithmic)


def covariance(jacobian, residuals, degrees):
    """Return the covariance of fitted unknowns from one run of residuals."""
    return information([jacobian], [residuals]).covariance(degrees)
