# SPDX-License-Identifier: Apache-2.0
"""One draw: a device, something wrong with it, a schedule, and what the sensors make of it."""

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
"""Kinds of noise by name: as in `Sensors`, with a memory in the pressures', and little beside the converter's steps."""

MARGIN = 0.25
"""Time that a rig goes on after the last sample, for clocks that are late [s]."""


@dataclass(frozen=True, eq=False)
class PanelTruth:
    """What is wrong with the device of a recording, and what really happened."""

    effects: tuple[str, ...]
    """Names of the effects, none for a healthy device."""

    strengths: dict[str, float]
    """Their strengths, as `EFFECTS` has them."""

    changes: dict[str, float]
    """All that was changed, by names like ``effects_a.play``."""

    gains: Gains
    """Gains of cylinder A without effects: the paper's K_x, K_sv, K_v and tau."""

    device: Specimen | Gains
    """The device; its gains alone where it is the textbook's."""

    healthy: Specimen | Gains
    """The device without effects."""

    schedule: Schedule
    """What it was put through."""

    samples: Truth
    """Without noise and at the samples' true times; what happened, not what arrived at the sensors."""


@dataclass(frozen=True, eq=False)
class Draw:
    """A recording, all that an identifier may see, and apart from it the truth."""

    recording: Readings
    truth: PanelTruth


def draw_schedule(name: str, rng: np.random.Generator) -> Schedule:
    """
    Return a schedule with its set-points and amplitudes drawn.

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
    raise InputError(f'schedule {name!r} is not known: use one of paper_step, out_and_back, surface_following')


def motion_of(schedule: Schedule) -> Motion:
    """Return a schedule's motion, with a margin at rest behind it."""
    knots = schedule.knots_per_sample
    more = round(MARGIN / schedule.sampling_period) * knots
    return Motion(
        np.concatenate([schedule.positions, np.full(more, schedule.positions[-1])]),
        np.concatenate([schedule.velocities, np.zeros(more)]),
        np.concatenate([np.repeat(schedule.setpoints, knots, axis=0), np.tile(schedule.setpoints[-1], (more, 1))]),
        schedule.sampling_period / knots,
        -schedule.sampling_period,
    )


def at_times(times: Array, truth: Truth) -> Array:
    """Return the pressures of both cylinders at some times [s], straight between the knots [Pa], (n, 2)."""
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
        'paper_step', 'out_and_back' or 'surface_following', or one that is laid out already.
    seed
        Picks the device, a named schedule's set-points and amplitudes, the strengths, and the noise.
    noise
        A name from `NOISES`.
    given
        Strengths of effects that are not to be drawn.
    make
        A name from `MAKES`, a device with all of its physics; else one of the paper's law.

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
        strengths[name], more = install(name, Situation(healthy, gains, planned, for_strength), given.get(name))
        if changes.keys() & more.keys():
            raise InputError(f'effects {", ".join(names)}: two of them are the same thing')
        changes.update(more)
    device = healthy.with_changes(changes)
    truth, arrived = device.put_through(motion_of(planned))
    return Draw(
        _recorded(arrived, device.clock, planned, for_noise, noise),
        PanelTruth(names, strengths, changes, gains, device, healthy, planned, _samples(truth, planned)),
    )


def draw_textbook(schedule: str, seed: int, noise: str = 'white', *, straight: bool = True) -> Draw:
    """
    Return a recording of the paper's model itself, cylinders A and B alike.

    Parameters
    ----------
    schedule, seed, noise
        As in `draw`.
    straight
        Let the piston move straight from sample to sample, so that sampling loses nothing.

    """
    for_device, for_schedule, for_noise = _generators(seed)
    gains = draw_gains(for_device)
    planned = draw_schedule(schedule, for_schedule)
    truth = _textbook(planned, gains, straight)
    return Draw(
        _recorded(truth, Clock(), planned, for_noise, noise),
        PanelTruth((), {}, {}, gains, gains, gains, planned, _samples(truth, planned)),
    )


def _generators(seed: int) -> list[np.random.Generator]:
    """Return generators for the device, the schedule and the noise."""
    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)]


def _samples(truth: Truth, schedule: Schedule) -> Truth:
    """Return what happened at the samples, of what happened at the knots."""
    samples = truth.every_nth(schedule.knots_per_sample)
    return Truth(**{name: values[: schedule.samples] for name, values in vars(samples).items()})


def _recorded(arrived: Truth, clock: Clock, schedule: Schedule, rng: np.random.Generator, noise: str) -> Readings:
    """Return what the sensors read of what arrives at them at each knot."""
    if noise not in NOISES:
        raise InputError(f'noise {noise!r} is not known: use one of {", ".join(NOISES)}')
    samples = _samples(arrived, schedule)
    times = schedule.sampling_period * np.arange(float(schedule.samples))
    pressures = at_times(clock.sampled(times), arrived)
    if noise == 'coloured':
        pressures = pressures + Sensors.pressure_noise * _coloured(pressures.shape, rng)
    instruments = Instruments(NOISES[noise], schedule.sampling_period, int(rng.integers(2**31)))
    return instruments.read(replace(samples, times=times, pressures=pressures))


def _coloured(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return noise of unit variance that remembers, each column on its own."""
    before = 100
    white = rng.standard_normal((before + shape[0], *shape[1:]))
    noise: Array = lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], white, axis=0)[before:]
    return noise


def _textbook(schedule: Schedule, gains: Gains, straight: bool) -> Truth:
    """Return what happens in the paper's model at each knot; A and B have the same gains."""
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
