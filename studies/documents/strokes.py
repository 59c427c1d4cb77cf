# SPDX-License-Identifier: Apache-2.0
"""
Make recordings of any length with known gains, for benchmarks of simulation and fit.

The piston moves 1.5 mm every 0.35 s at a constant set-point. The pressure is the model's with white noise.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from cfd_pneumatic.identification import Experiment, Pressure, prepare_recordings
from cfd_pneumatic.model import Cylinder, OperatingPoints
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal

AMBIENT = 101_325.0
SETPOINT = AMBIENT + 34_474.0
GAINS = np.array([4.33e6, 104.0, 19.4, 0.0105])
NOISE = 52.0  # of the pressure [Pa]
CHANNEL = Pressure('cylinder_a', AMBIENT)
CYLINDER = Cylinder(OperatingPoints.constant(*GAINS), AMBIENT)
PERIOD = 1e-3  # of recordings of more than a million samples [s]
SHORT_PERIOD = 2e-3  # of shorter recordings [s]


def displacement_at(times: np.ndarray) -> np.ndarray:
    phase = np.clip(np.abs((times + 0.25) % 0.7 - 0.35) / 0.006 - 29.0, 0.0, 1.0)
    return 0.5 * 1.524e-3 * (1.0 - np.cos(np.pi * phase))


@cache
def record(samples: int, jitter: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, displacement and set-point; at a `jitter` of 1 times move by up to 0.3 periods."""
    period = PERIOD if samples > 1e6 else SHORT_PERIOD
    times = period * (np.arange(samples) + jitter * np.random.default_rng(1).uniform(-0.3, 0.3, samples))
    return times, displacement_at(times), np.full(samples, SETPOINT)


@cache
def experiment(samples: int) -> Experiment:
    """Return a record with its pressure as an experiment for a fit."""
    times, displacement, setpoint = record(samples)
    measured = CYLINDER.simulate(times, displacement, setpoint) + NOISE * np.random.default_rng(0).normal(size=samples)
    cylinders = {'cylinder_a': CylinderSignals(Signal(times, measured), Signal(times[:1], setpoint[:1]))}
    recording = Recording('strokes', 0, Signal(times, displacement), cylinders, None, ())
    prepared = prepare_recordings([recording]).experiments(CHANNEL)[0]
    return replace(prepared, chosen=np.ones(samples, dtype=bool))
