"""
What makes the contact force in a recording, on one time grid, and what was measured of it.

The pressures are the measured ones, so that what the pressure's model lacks is not laid on the force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import CYLINDERS
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.data.experiment import on_clock
from cfd_pneumatic.identification.data.motion import Motion
from cfd_pneumatic.identification.data.reversals import reversals, travelled
from cfd_pneumatic.identification.data.split import PARTS, Split
from cfd_pneumatic.model.extended_force import ExtendedForce
from cfd_pneumatic.recording import Recording, Signal
from cfd_pneumatic.recording.spool import PART, parts, thinned

Array = NDArray[np.float64]

_FEWEST_SAMPLES = 20
_ROUGH = 0.3  # share of an acceleration that may stray from its neighbours' mean


def _roughness(values: Array) -> float:
    """Return by how much values stray from the mean of their neighbours, as a share of their own size."""
    middle = 0.5 * (values[:-2] + values[2:])
    size = float(np.linalg.norm(values))
    return float(np.linalg.norm(values[1:-1] - middle)) / size if size > 0.0 else 0.0


@dataclass(frozen=True)
class ForceExperiment:
    """
    What makes the contact force in one recording, on one time grid, and what was measured of it.

    The grid is the union of the times of the force's and the displacement's samples and of the piston's reversals, so
    that friction sees each of them; those that may be noise are left out of the displacement (see `travel`).

    Attributes
    ----------
    recording
        Name of the recording.
    times
        Grid, increasing, shape (n,) [s].
    displacement, rate, acceleration
        Smoothed motion, +x grows cylinder A, shape (n,) [m, m/s, m/s^2].
    pressure, opposing
        Measured absolute pressure in the cylinders A and B, ambient where one was not recorded, shape (n,) [Pa].
    samples
        Grid indices of the force samples, shape (m,).
    force
        Measured contact force, shape (m,) [N].
    level
        Set-point of A less that of B at each force sample, shape (m,) [Pa]; the median pressure where no set-point was
        recorded, ambient where no pressure was.
    part
        Index into `split.PARTS` of each force sample, shape (m,).

    """

    recording: str
    times: Array
    displacement: Array
    rate: Array
    acceleration: Array
    pressure: Array
    opposing: Array
    samples: NDArray[np.intp]
    force: Array
    level: Array
    part: NDArray[np.int8]

    @property
    def sample_times(self) -> Array:
        """Times of the force samples, shape (m,) [s]."""
        return self.times[self.samples]

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Which force samples a model is fitted to, those before the test part, shape (m,)."""
        return self.part < PARTS.index('test')

    def until(self, part: str) -> ForceExperiment:
        """Return the experiment without the force samples that come after a part."""
        samples = self.samples[self.part <= PARTS.index(part)]
        grid = slice(0, int(samples[-1]) + 1) if samples.size else slice(0, 0)
        return replace(
            self,
            times=self.times[grid],
            displacement=self.displacement[grid],
            rate=self.rate[grid],
            acceleration=self.acceleration[grid],
            pressure=self.pressure[grid],
            opposing=self.opposing[grid],
            samples=samples,
            force=self.force[: samples.size],
            level=self.level[: samples.size],
            part=self.part[: samples.size],
        )

    @property
    def difference(self) -> Array:
        """Pressure in A less that in B, or ambient, at the force samples, shape (m,) [Pa]."""
        return (self.pressure - self.opposing)[self.samples]

    @property
    def resolves_acceleration(self) -> bool:
        """Whether the acceleration is seen: what changes at every sample comes and goes between them, too."""
        return _roughness(self.acceleration) <= _ROUGH

    def simulate(self, model: ExtendedForce, stretch: float) -> Array:
        """Return the force that a model makes of this at its samples, seals stretched at first, shape (m,) [N]."""
        force = model.simulate(
            self.times, self.displacement, self.rate, self.acceleration, self.pressure, self.opposing, stretch
        )
        return force[self.samples]


def make_force_experiment(
    recording: Recording, motion: Motion, split: Split, ambient_pressure: float, *, thin: bool = False
) -> ForceExperiment:
    """
    Return what makes the contact force in a recording.

    Parameters
    ----------
    recording
        What was recorded.
    motion
        Its smoothed displacement.
    split
        Where it is cut.
    ambient_pressure
        Absolute [Pa].
    thin
        Hold what tells the area alone: some samples of a long recording, and no motion.

    Raises
    ------
    InputError
        If the force is not recorded, it hardly overlaps with displacement and pressures in time, or it never changes.

    """
    if recording.force is None:
        raise InputError(f'{recording.name}: no force was recorded')
    stamps, force = recording.force.times, recording.force.values
    if thin:
        stamps, force = thinned(stamps, PART), thinned(force, PART)
    force_times = on_clock(stamps, motion)
    pressures = {name: _read_on(motion, signals.pressure) for name, signals in recording.cylinders.items()}
    first = max(motion.times[0], *(pressure.times[0] for pressure in pressures.values()))
    last = min(motion.times[-1], *(pressure.times[-1] for pressure in pressures.values()))
    within = (force_times >= first) & (force_times <= last)
    force_times, force = force_times[within], force[within]
    if force.size < _FEWEST_SAMPLES:
        raise InputError(
            f'{recording.name}: only {force.size} samples of the force lie between the first and the last sample of '
            'displacement and pressure: check the time offsets of the topics'
        )
    if np.ptp(force) == 0.0:
        raise InputError(f'{recording.name}: the force never changes ({force[0]:g} N): is its sensor connected?')
    if thin:
        times = force_times
        displacement = rate = acceleration = np.zeros(times.size)
    else:
        moved = np.concatenate([motion.times, reversals(motion)])
        times = np.union1d(moved[(moved >= force_times[0]) & (moved <= force_times[-1])], force_times)
        displacement = travelled(motion, recording.displacement.values, times)
        rate, acceleration = motion.rate_at(times), motion.acceleration_at(times)
    pressure, opposing = (
        _pressure_at(times, pressures[name]) if name in pressures else np.full(times.size, ambient_pressure)
        for name in CYLINDERS
    )
    return ForceExperiment(
        recording=recording.name,
        times=times,
        displacement=displacement,
        rate=rate,
        acceleration=acceleration,
        pressure=pressure,
        opposing=opposing,
        samples=np.searchsorted(times, force_times),
        force=force,
        level=_level_at(force_times, recording, 'cylinder_a', motion, ambient_pressure)
        - _level_at(force_times, recording, 'cylinder_b', motion, ambient_pressure),
        part=split.part_of(force_times),
    )


def _read_on(motion: Motion, signal: Signal) -> Signal:
    """Return a signal at the times at which it was sampled, of which its stamps may stray."""
    return Signal(on_clock(signal.times, motion), signal.values)


def _pressure_at(times: Array, pressure: Signal) -> Array:
    """Return a measured pressure at times between its first sample and its last, straight between samples [Pa]."""
    found = np.empty(times.size)
    done = 0
    for part in parts(pressure.times, pressure.values):
        piece = slice(max(part.start - 1, 0), part.stop)
        until = int(np.searchsorted(times, pressure.times[part.stop - 1], side='right'))
        found[done:until] = np.interp(times[done:until], pressure.times[piece], pressure.values[piece])
        done = until
    return found


def _level_at(times: Array, recording: Recording, cylinder: str, motion: Motion, otherwise: float) -> Array:
    """Return a cylinder's set-point, or its median pressure where none was recorded [Pa]."""
    if cylinder not in recording.cylinders:
        return np.full(times.size, otherwise)
    signals = recording.cylinders[cylinder]
    if signals.setpoint is None:
        return np.full(times.size, float(np.median(thinned(signals.pressure.values))))
    held = np.searchsorted(motion.on_clock(signals.setpoint.times), times, side='right') - 1
    return signals.setpoint.values[np.maximum(held, 0)]
