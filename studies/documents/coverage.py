# SPDX-License-Identifier: Apache-2.0
"""
How often the 95 % intervals of the gains hold the truth, and where the estimates lie: `make coverage`.

The truth is made of equations (8) and (12), or of a chamber and two orifices, by Runge and Kutta's method, from
displacements that are smooth functions of time: nothing of the package's model is in it. Each of the paper's rows takes
turns. The sensors are the rig's.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Estimate, Fit, Pressure, fit_model, prepare_recordings, with_core
from cfd_pneumatic.model import NAMES, TABLE_1_ROWS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig import Sensors
from cfd_pneumatic.units import INCH, PSI, PSI_PER_INCH
from studies.documents.markdown import notes_in, table
from studies.tools.processes import side_by_side
from studies.tools.provenance import ROOT, machine

Array = NDArray[Any]
Motion = Callable[[Array], Array]
"""Times [s] to displacements [m]."""

DOCUMENT = ROOT / 'docs' / 'coverage.md'
CHANNEL = Pressure('cylinder_a', AMBIENT_PRESSURE)
PERIOD = 2e-3  # [s]
BEFORE = 49 * PERIOD  # the trigger [s]
STEP = 60e-3 * INCH  # [m]
SURFACE = 0.8e-3  # standard deviation [m]
FREQUENCIES = (0.2, 8.0)  # of a surface [Hz]
WAVES = 12
SUBSTEPS = 20  # of a sample
LEAD = 100  # samples before the recording begins: a surface is under way then
TOGETHER = 20  # recordings that are simulated side by side, of one device
CRITICAL_RATIOS = (0.25, 0.55)  # of the orifices of physical devices [-]
EXPONENTS = (1.2, 1.4)  # of their air [-]


@dataclass(frozen=True)
class Kind:
    """A kind of recording: its motion, its length in samples, and the bits of its converters, 0 for none."""

    name: str
    motion: Callable[[np.random.Generator], Motion]
    samples: int
    bits: int


def _steps(times: Sequence[float], durations: Sequence[float]) -> Motion:
    """Return steps out and back, each half a cosine."""

    def displacement(at: Array) -> Array:
        found = np.zeros_like(at)
        for rank, (begin, duration) in enumerate(zip(times, durations)):
            phase = np.clip((at - begin) / duration, 0.0, 1.0)
            found += (-1.0) ** rank * 0.5 * STEP * (1.0 - np.cos(np.pi * phase))
        return found

    return displacement


def step(rng: np.random.Generator) -> Motion:
    """Return the paper's step, of 3 to 7 samples."""
    return _steps([BEFORE + PERIOD * rng.random()], [PERIOD * rng.uniform(3.0, 7.0)])


def strokes(rng: np.random.Generator) -> Motion:
    """Return strokes out and back, as quick, with rests of 0.25 to 0.45 s."""
    begins = BEFORE + np.cumsum(rng.uniform(0.25, 0.45, 8))
    return _steps(begins.tolist(), (PERIOD * rng.uniform(3.0, 7.0, begins.size)).tolist())


def surface(rng: np.random.Generator) -> Motion:
    """Return the motion over a surface: waves of all lengths."""
    omega = 2.0 * np.pi * np.exp(rng.uniform(math.log(FREQUENCIES[0]), math.log(FREQUENCIES[1]), WAVES))
    phase, height = rng.uniform(0.0, 2.0 * np.pi, WAVES), SURFACE * math.sqrt(2.0 / WAVES)
    return lambda at: height * np.sin(np.multiply.outer(at, omega) + phase).sum(axis=-1)


KINDS = [
    Kind(f'{name}, {"rounded to 12 bits" if bits else "not rounded"}', motion, samples, bits)
    for name, motion, samples in (('a step', step, 350), ('strokes', strokes, 1750), ('a surface', surface, 4000))
    for bits in (12, 0)
]


class Linear:
    """A device of equations (8) and (12), with gains k_x, k_sv, k_v, tau and an absolute set-point [SI]."""

    name = 'linear'

    def __init__(self, gains: Array, setpoint: float, _rng: np.random.Generator) -> None:
        self.gains = gains
        self.setpoint = setpoint

    def slope(self, state: Array, _x: Array, rate: Array) -> Array:
        """Return the rates of pressure and sensed pressure, shape (2, motions) [Pa/s]."""
        k_x, k_sv, k_v, tau = self.gains
        p, p_f = state
        error = self.setpoint - p_f
        return np.array([np.where(error > 0.0, k_sv, k_v) * error - k_x * rate, (p - p_f) / tau])

    def told(self, found: Fit) -> tuple[Sequence[Estimate], Array]:
        """Return the estimates of the gains, and what they should be."""
        return found.estimates, self.gains


class Orifices(Linear):
    """
    A chamber between two orifices that open with the error, polytropic, sensed through a laminar tube.

    The gains hold at the set-point and where the piston begins. Flow is that of ISO 6358. Critical ratio and exponent
    are drawn around what the core's prior holds: an interval with a prior covers over such devices, not for each.
    """

    name = 'physical'
    supply, exhaust = 8e5, AMBIENT_PRESSURE

    def __init__(self, gains: Array, setpoint: float, rng: np.random.Generator) -> None:
        super().__init__(gains, setpoint, rng)
        self.critical, self.exponent = rng.uniform(*CRITICAL_RATIOS), rng.uniform(*EXPONENTS)

    def flows(self, p: Any) -> tuple[Any, Any]:
        """Return what passes either orifice, against what passes at the set-point [-]."""
        return (
            self._choked(self.supply, p) / self._choked(self.supply, self.setpoint),
            self._choked(p, self.exhaust) / self._choked(self.setpoint, self.exhaust),
        )

    def _choked(self, upstream: Any, downstream: Any) -> Any:
        """Return what passes an orifice, as the upstream pressure of which as much is choked [Pa]."""
        beyond = np.maximum(downstream / upstream - self.critical, 0.0) / (1.0 - self.critical)
        return upstream * np.sqrt(1.0 - beyond**2)

    @property
    def length(self) -> float:
        """Of the chamber where the piston begins [m]."""
        return float(self.exponent * self.setpoint / self.gains[0])

    def slope(self, state: Array, x: Array, rate: Array) -> Array:
        """Return the rates of pressure and sensed pressure, shape (2, motions) [Pa/s]."""
        _, k_sv, k_v, tau = self.gains
        p, p_f = state
        error, length = self.setpoint - p_f, self.length + x
        charged, vented = self.flows(p)
        flow = np.where(error > 0.0, k_sv * charged, k_v * vented) * error * self.length / length
        return np.array([flow - self.exponent * p / length * rate, (p**2 - p_f**2) / (2.0 * tau * self.setpoint)])

    def told(self, found: Fit) -> tuple[Sequence[Estimate], Array]:
        """Return the estimates of the gains beside the core, and what they should be at its reference."""
        beside = with_core(found)
        pressure, position, *_ = beside.model.core['physical_core']
        length = self.length + position
        charged, vented = (one * self.length / length for one in self.flows(np.asarray(pressure)))
        _, k_sv, k_v, tau = self.gains
        truth = [self.exponent * pressure / length, k_sv * charged, k_v * vented, tau * self.setpoint / pressure]
        return beside.estimates, np.array(truth)


DEVICES = {one.name: one for one in (Linear, Orifices)}
COUNTS = {'linear': 1000, 'physical': 300}
"""Recordings of each kind: a fit with the physical core takes ten times as long."""


def pressures(device: Linear, motions: Sequence[Motion], samples: int) -> Array:
    """Return pressures at samples, from rest some time before the first, shape (samples, motions) [Pa]."""
    h = PERIOD / SUBSTEPS
    halves = 0.5 * h * np.arange(2 * SUBSTEPS * (LEAD + samples - 1) + 1) - LEAD * PERIOD
    x = np.column_stack([one(halves) for one in motions])
    moved = x, np.gradient(x, 0.5 * h, axis=0)
    state = np.full((2, len(motions)), device.setpoint)
    found = [state[0]]
    for begin in range(0, len(halves) - 1, 2):
        first, middle, last = zip(*(one[begin : begin + 3] for one in moved))
        a = device.slope(state, *first)
        b = device.slope(state + 0.5 * h * a, *middle)
        c = device.slope(state + 0.5 * h * b, *middle)
        d = device.slope(state + h * c, *last)
        state = state + h / 6.0 * (a + 2.0 * (b + c) + d)
        if (begin + 2) % (2 * SUBSTEPS) == 0:
            found.append(state[0])
    return np.array(found[LEAD:])


def scored(job: tuple[int, int, str]) -> Array:
    """Return for some seeds of a kind by how many standard errors each gain is off, shape (seeds, gains)."""
    kind, first, core = KINDS[job[0]], *job[1:]
    psig, k_x, *others = TABLE_1_ROWS[first // TOGETHER % len(TABLE_1_ROWS)]
    gains, setpoint = np.array([k_x * PSI_PER_INCH, *others]), AMBIENT_PRESSURE + psig * PSI
    device = DEVICES[core](gains, setpoint, np.random.default_rng([job[0], first, 1]))
    draws = [np.random.default_rng([job[0], seed]) for seed in range(first, first + TOGETHER)]
    motions = [kind.motion(rng) for rng in draws]
    exact = pressures(device, motions, kind.samples)
    times: Array = PERIOD * np.arange(kind.samples)
    sensors = Sensors(bits=kind.bits)
    rows = []
    for displacement, pressure, rng in zip(motions, exact.T, draws):
        moved = Signal(times, sensors.measure_displacement(displacement(times), rng))
        cylinder = CylinderSignals(Signal(times, sensors.measure_pressure(pressure, rng)), None)
        recording = Recording('made', 0, moved, {CHANNEL.name: cylinder}, None, ())
        estimates, truth = device.told(fit_model(CHANNEL, prepare_recordings([recording]).experiments(CHANNEL)))
        rows.append(
            [
                math.nan if one.value is None or not one.std else (one.value - gain) / one.std
                for one, gain in zip(estimates, truth.tolist())
            ]
        )
    return np.array(rows)


def line(name: str, off: Array) -> tuple[str, ...]:
    """Return a kind's line: how often each gain is held, and the mean, in standard errors."""
    held = [f'{100.0 * np.mean(np.abs(one[np.isfinite(one)]) < _REACH):.1f}' for one in off.T]
    means = [f'{np.nanmean(one):+.2f}' for one in off.T]
    return name, str(len(off)), *held, *means


_REACH = 1.96  # standard errors: half a 95 % interval of many samples


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit the recordings, write the table."""
    parser = argparse.ArgumentParser(prog='coverage', description=__doc__)
    for core, count in COUNTS.items():
        told = f'of each kind of {core} devices, {count} by default'
        parser.add_argument(f'--{core}', type=int, nargs=2, default=(0, count), metavar=('FIRST', 'END'), help=told)
    seeds = vars(parser.parse_args(arguments))
    jobs = [
        (kind, seed, core)
        for core, (first, end) in seeds.items()
        for kind in range(len(KINDS))
        for seed in range(first, end, TOGETHER)
    ]
    off = defaultdict(list)
    for some, (kind, _, core) in zip(side_by_side(scored, jobs, 'coverage'), jobs):
        off[core, kind].append(some)
    lines = [line(f'{core}: {KINDS[kind].name}', np.concatenate(some)) for (core, kind), some in off.items()]
    header = ('recordings', 'how many', *(f'{name} held [%]' for name in NAMES), *(f'{name} off' for name in NAMES))
    given = ' '.join(f'--{core} {first} {end}' for core, (first, end) in seeds.items())
    page = (
        '# Coverage\n\n'
        'How often the 95 % intervals of the gains hold the truth, and by how many standard errors the estimates are '
        'off in the mean. The truth is of another integrator and of smooth motions, sampled at 2 ms; the six rows of '
        "the paper's Table 1 in turn; linear devices, and physical ones, which are fitted with the physical core; "
        f'their critical ratios are drawn from {CRITICAL_RATIOS[0]} to {CRITICAL_RATIOS[1]}, their exponents from '
        f'{EXPONENTS[0]} to {EXPONENTS[1]}, one device for every {TOGETHER} recordings. '
        f"Written by `make coverage ARGS='{given}'`.\n\n"
        f'- Machine: {machine()}\n\n{table(header, lines)}\n\n{notes_in(DOCUMENT)}\n'
    )
    write_text(DOCUMENT, page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
