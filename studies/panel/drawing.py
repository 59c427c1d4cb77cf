# SPDX-License-Identifier: Apache-2.0
"""Draw a device, a fault, a schedule, and the recording of its sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.signal import lfilter

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.rig import (
    MIL,
    Cylinder,
    Instruments,
    Readings,
    Schedule,
    Sensors,
    Truth,
    out_and_back,
    paper_step,
    surface_following,
)
from cfd_pneumatic.units import PSI
from studies.panel.makes import draw_make
from studies.panel.situation import Situation
from studies.panel.specimen import Clock, Motion, Specimen, draw_specimen
from studies.panel.strengths import install
from studies.panel.textbook import Gains, draw_gains, pressure_along

COLOUR = 0.9
"""Correlation of a coloured noise from sample to sample."""

NOISES = {
    'white': Sensors(),
    'coloured': Sensors(pressure_noise=0.0),
    'quantised': Sensors(
        pressure_noise=0.1 * Sensors.pressure_noise, displacement_noise=0.1 * Sensors.displacement_noise
    ),
}
"""Kinds of noise by name: as in `Sensors`; autocorrelated in the pressures; little more than the converter's steps."""

MARGIN = 0.25
"""Time that a rig runs on after the last sample, for late clocks [s]."""


@dataclass(frozen=True, eq=False)
class PanelTruth:
    """The fault of a recorded device, and its true motion, pressures and force."""

    effects: tuple[str, ...]
    """Names of the effects; empty for a healthy device."""

    strengths: dict[str, float]
    """Strength of each effect, in the unit of `EFFECTS`."""

    changes: dict[str, float]
    """Changed fields and their values, by names like ``effects_a.play``."""

    gains: Gains
    """Gains of cylinder A without effects: the paper's K_x, K_sv, K_v and tau."""

    device: Specimen | Gains
    """The device; the gains alone if the paper's model was simulated."""

    healthy: Specimen | Gains
    """The device without effects."""

    schedule: Schedule
    """Motion and set-points of the recording."""

    samples: Truth
    """True values at the samples' true times, before lags of sensors and without noise."""


@dataclass(frozen=True, eq=False)
class Draw:
    """A recording, and the truth that an identifier must not see."""

    recording: Readings
    truth: PanelTruth


def draw_schedule(name: str, rng: np.random.Generator) -> Schedule:
    """
    Return a schedule with random set-points and amplitudes.

    Raises
    ------
    InputError
        If there is no such schedule.

    """
    if name == 'paper_step':
        return paper_step(rng.uniform(5.0, 15.0) * PSI, rng.uniform(48.0, 75.0) * MIL, setpoint_b=5 * PSI)
    if name == 'out_and_back':
        setpoint = rng.uniform(5.0, 9.0) * PSI
        amplitude = rng.uniform(48.0, 120.0) * MIL
        return out_and_back(
            setpoint,
            amplitude,
            second_setpoint=setpoint + rng.uniform(3.0, 7.0) * PSI,
            second_amplitude=amplitude * rng.uniform(0.2, 0.5),
        )
    if name == 'surface_following':
        return surface_following(
            rng.uniform(8.0, 12.0) * PSI,
            rng.uniform(0.7e-3, 1.6e-3),
            setpoint_steps=rng.uniform(1.5, 4.0) * PSI,
            seed=int(rng.integers(2**31)),
        )
    raise InputError(f'schedule {name!r} is not known. Use one of paper_step, out_and_back, surface_following.')


def motion_of(schedule: Schedule) -> Motion:
    """Return the motion of a schedule, followed by a margin at rest."""
    knots = schedule.knots_per_sample
    extra_knots = round(MARGIN / schedule.sampling_period) * knots
    return Motion(
        np.concatenate([schedule.positions, np.full(extra_knots, schedule.positions[-1])]),
        np.concatenate([schedule.velocities, np.zeros(extra_knots)]),
        np.concatenate(
            [np.repeat(schedule.setpoints, knots, axis=0), np.tile(schedule.setpoints[-1], (extra_knots, 1))]
        ),
        schedule.sampling_period / knots,
        -schedule.sampling_period,
    )


def pressures_at(times: Array, truth: Truth) -> Array:
    """Return the pressures of both cylinders at times [s], interpolated between the knots [Pa], (n, 2)."""
    return np.column_stack([np.interp(times, truth.times, pressure) for pressure in truth.pressures.T])


def draw(
    effect: str | tuple[str, ...] | None,
    schedule: str | Schedule,
    seed: int,
    noise: str = 'white',
    given: Mapping[str, float] = MappingProxyType({}),
    make: str | None = None,
) -> Draw:
    """
    Return a recording of a device with one effect, several or none.

    Parameters
    ----------
    effect
        Names from `EFFECTS`.
    schedule
        'paper_step', 'out_and_back' or 'surface_following', or a ready schedule.
    seed
        Picks the device, a named schedule's set-points and amplitudes, the strengths, and the noise.
    noise
        A name from `NOISES`.
    given
        Strengths of effects; the seed determines the strengths of all other effects.
    make
        A name from `MAKES`: a device with full physics. None: a device that follows the paper's model.

    Raises
    ------
    InputError
        If a name is not known, or two effects exclude each other.

    """
    names = (effect,) if isinstance(effect, str) else effect or ()
    for_device, for_schedule, for_noise = _generators(seed)
    healthy, gains = draw_make(make, for_device) if make else draw_specimen(for_device)
    planned = draw_schedule(schedule, for_schedule) if isinstance(schedule, str) else schedule
    strengths: dict[str, float] = {}
    changes: dict[str, float] = {}
    for name in names:
        for_strength = np.random.default_rng([seed, *name.encode()])
        strengths[name], effect_changes = install(
            name, Situation(healthy, gains, planned, for_strength), given.get(name)
        )
        if changes.keys() & effect_changes.keys():
            raise InputError(
                f'effects {", ".join(names)}: two of them change the same part of the rig. '
                'They cannot be combined. Choose different effects.'
            )
        changes.update(effect_changes)
    device = healthy.with_changes(changes)
    truth, arrived = device.simulate(motion_of(planned))
    return Draw(
        _recorded(arrived, device.clock, planned, for_noise, noise),
        PanelTruth(names, strengths, changes, gains, device, healthy, planned, _samples(truth, planned)),
    )


def draw_textbook(schedule: str, seed: int, noise: str = 'white', *, straight: bool = True) -> Draw:
    """
    Return a recording of the paper's model; cylinders A and B have equal gains.

    Parameters
    ----------
    schedule, seed, noise
        As in `draw`.
    straight
        Let the piston move at constant speed from sample to sample, so that sampling loses nothing.

    """
    for_device, for_schedule, for_noise = _generators(seed)
    gains = draw_gains(for_device)
    planned = draw_schedule(schedule, for_schedule)
    truth = _paper_model_truth(planned, gains, straight)
    return Draw(
        _recorded(truth, Clock(), planned, for_noise, noise),
        PanelTruth((), {}, {}, gains, gains, gains, planned, _samples(truth, planned)),
    )


def _generators(seed: int) -> list[np.random.Generator]:
    """Return generators for the device, the schedule and the noise."""
    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)]


def _samples(truth: Truth, schedule: Schedule) -> Truth:
    """Return the values at the samples from the values at the knots."""
    samples = truth.every_nth(schedule.knots_per_sample)
    return Truth(**{name: values[: schedule.samples] for name, values in vars(samples).items()})


def _recorded(arrived: Truth, clock: Clock, schedule: Schedule, rng: np.random.Generator, noise: str) -> Readings:
    """Return the sensors' readings of the quantities at each knot."""
    if noise not in NOISES:
        raise InputError(f'noise {noise!r} is not known. Use one of {", ".join(NOISES)}.')
    samples = _samples(arrived, schedule)
    times = schedule.sampling_period * np.arange(float(schedule.samples))
    pressures = pressures_at(clock.sampled(times), arrived)
    if noise == 'coloured':
        pressures = pressures + Sensors.pressure_noise * _coloured_noise(pressures.shape, rng)
    instruments = Instruments(NOISES[noise], schedule.sampling_period, int(rng.integers(2**31)))
    return instruments.read(replace(samples, times=times, pressures=pressures))


def _coloured_noise(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return autocorrelated noise of unit variance, independent in each column."""
    warm_up = 100
    white = rng.standard_normal((warm_up + shape[0], *shape[1:]))
    noise: Array = lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], white, axis=0)[warm_up:]
    return noise


def _paper_model_truth(schedule: Schedule, gains: Gains, straight: bool) -> Truth:
    """Return the motion and pressures of the paper's model at each knot; A and B have the same gains."""
    motion = motion_of(schedule)
    knots = schedule.knots_per_sample
    times = motion.start + motion.period * np.arange(1.0, len(motion.positions) + 1.0)
    x = motion.positions
    if straight:
        x = np.interp(times, times[knots - 1 :: knots], x[knots - 1 :: knots])
    v = np.gradient(x, motion.period)
    setpoints = motion.setpoints + AMBIENT_PRESSURE
    pressures = np.column_stack(
        [
            pressure_along(direction * x, setpoints[:, cylinder], motion.period, gains)
            for cylinder, direction in enumerate((1.0, -1.0))
        ]
    )
    force = Cylinder().area * (pressures[:, 0] - pressures[:, 1])
    return Truth(times, x, v, np.gradient(v, motion.period), pressures, pressures, setpoints, force)
