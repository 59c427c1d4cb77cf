# SPDX-License-Identifier: Apache-2.0
"""
Measure how often the 95 % intervals of the gains contain the true values: `make coverage`.

Equations (8) and (12), or a chamber with two orifices, give the true pressures from smooth displacements by the
Runge-Kutta method. This simulation shares no code with the package's model. The gains are the rows of the paper's
Table 1 in turn. The sensors are the rig's.
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

DOCUMENT = ROOT / 'docs' / 'measurements' / 'coverage.md'
CHANNEL = Pressure('cylinder_a', AMBIENT_PRESSURE)
PERIOD = 2e-3  # [s]
BEFORE = 49 * PERIOD  # time before the trigger [s]
STEP = 60e-3 * INCH  # [m]
SURFACE = 0.8e-3  # standard deviation [m]
FREQUENCIES = (0.2, 8.0)  # of a surface [Hz]
SINES = 12  # of a surface
SUBSTEPS = 20  # of a sample
LEAD = 100  # samples before the recording begins, so that it begins in motion
TOGETHER = 20  # recordings of a device, simulated in one call
CRITICAL_RATIOS = (0.25, 0.55)  # of the orifices of physical devices [-]
EXPONENTS = (1.2, 1.4)  # of their air [-]


@dataclass(frozen=True)
class Kind:
    """A kind of recording: its motion, its length in samples, and the bits of its converters (0: not rounded)."""

    name: str
    motion: Callable[[np.random.Generator], Motion]
    samples: int
    bits: int


def _steps(times: Sequence[float], durations: Sequence[float]) -> Motion:
    """Return steps out and back; each step is half a cosine."""

    def displacement(at: Array) -> Array:
        found = np.zeros_like(at)
        for rank, (begin, duration) in enumerate(zip(times, durations)):
            phase = np.clip((at - begin) / duration, 0.0, 1.0)
            found += (-1.0) ** rank * 0.5 * STEP * (1.0 - np.cos(np.pi * phase))
        return found

    return displacement


def step(rng: np.random.Generator) -> Motion:
    """Return the paper's step with a duration of 3 to 7 samples."""
    return _steps([BEFORE + PERIOD * rng.random()], [PERIOD * rng.uniform(3.0, 7.0)])


def strokes(rng: np.random.Generator) -> Motion:
    """Return strokes out and back of 3 to 7 samples each, with rests of 0.25 to 0.45 s."""
    begins = BEFORE + np.cumsum(rng.uniform(0.25, 0.45, 8))
    return _steps(begins.tolist(), (PERIOD * rng.uniform(3.0, 7.0, begins.size)).tolist())


def surface(rng: np.random.Generator) -> Motion:
    """Return the motion over a surface: a sum of sines with random frequencies."""
    omega = 2.0 * np.pi * np.exp(rng.uniform(math.log(FREQUENCIES[0]), math.log(FREQUENCIES[1]), SINES))
    phase, height = rng.uniform(0.0, 2.0 * np.pi, SINES), SURFACE * math.sqrt(2.0 / SINES)
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

    def estimates_and_truth(self, fit: Fit) -> tuple[Sequence[Estimate], Array]:
        """Return the estimates of the gains and the true gains."""
        return fit.estimates, self.gains


class Orifices(Linear):
    """
    A polytropic chamber between two orifices that open with the error, sensed through a laminar tube.

    The gains hold at the set-point and at the piston's initial position. The flow follows ISO 6358. Critical ratio and
    exponent are random about the core's prior: intervals with a prior have their coverage over such devices, not for
    each device.
    """

    name = 'physical'
    supply, exhaust = 8e5, AMBIENT_PRESSURE

    def __init__(self, gains: Array, setpoint: float, rng: np.random.Generator) -> None:
        super().__init__(gains, setpoint, rng)
        self.critical, self.exponent = rng.uniform(*CRITICAL_RATIOS), rng.uniform(*EXPONENTS)

    def flows(self, p: Any) -> tuple[Any, Any]:
        """Return the flows of both orifices divided by the flows at the set-point [-]."""
        return (
            self._choked(self.supply, p) / self._choked(self.supply, self.setpoint),
            self._choked(p, self.exhaust) / self._choked(self.setpoint, self.exhaust),
        )

    def _choked(self, upstream: Any, downstream: Any) -> Any:
        """Return the flow of an orifice as the upstream pressure with an equal choked flow [Pa]."""
        beyond = np.maximum(downstream / upstream - self.critical, 0.0) / (1.0 - self.critical)
        return upstream * np.sqrt(1.0 - beyond**2)

    @property
    def length(self) -> float:
        """Length of the chamber at the piston's initial position [m]."""
        return float(self.exponent * self.setpoint / self.gains[0])

    def slope(self, state: Array, x: Array, rate: Array) -> Array:
        """Return the rates of pressure and sensed pressure, shape (2, motions) [Pa/s]."""
        _, k_sv, k_v, tau = self.gains
        p, p_f = state
        error, length = self.setpoint - p_f, self.length + x
        charged, vented = self.flows(p)
        flow = np.where(error > 0.0, k_sv * charged, k_v * vented) * error * self.length / length
        return np.array([flow - self.exponent * p / length * rate, (p**2 - p_f**2) / (2.0 * tau * self.setpoint)])

    def estimates_and_truth(self, fit: Fit) -> tuple[Sequence[Estimate], Array]:
        """Return the estimates of the gains with the core, and the true gains at the core's reference."""
        core_fit = with_core(fit)
        pressure, position, *_ = core_fit.model.core['physical_core']
        length = self.length + position
        charged, vented = (flow * self.length / length for flow in self.flows(np.asarray(pressure)))
        _, k_sv, k_v, tau = self.gains
        truth = [self.exponent * pressure / length, k_sv * charged, k_v * vented, tau * self.setpoint / pressure]
        return core_fit.estimates, np.array(truth)


DEVICES = {device.name: device for device in (Linear, Orifices)}
COUNTS = {'linear': 1000, 'physical': 300}
"""Recordings of each kind: a fit with the physical core takes ten times as long."""


def pressures(device: Linear, motions: Sequence[Motion], samples: int) -> Array:
    """Return pressures at samples, from rest `LEAD` samples earlier, shape (samples, motions) [Pa]."""
    h = PERIOD / SUBSTEPS
    halves = 0.5 * h * np.arange(2 * SUBSTEPS * (LEAD + samples - 1) + 1) - LEAD * PERIOD
    x = np.column_stack([motion(halves) for motion in motions])
    motion_values = x, np.gradient(x, 0.5 * h, axis=0)
    state = np.full((2, len(motions)), device.setpoint)
    results = [state[0]]
    for begin in range(0, len(halves) - 1, 2):
        first, middle, last = zip(*(values[begin : begin + 3] for values in motion_values))
        a = device.slope(state, *first)
        b = device.slope(state + 0.5 * h * a, *middle)
        c = device.slope(state + 0.5 * h * b, *middle)
        d = device.slope(state + h * c, *last)
        state = state + h / 6.0 * (a + 2.0 * (b + c) + d)
        if (begin + 2) % (2 * SUBSTEPS) == 0:
            results.append(state[0])
    return np.array(results[LEAD:])


def gain_errors(job: tuple[int, int, str]) -> Array:
    """Return the errors of the gains in standard errors for seeds of a kind, shape (seeds, gains)."""
    kind, first, core = KINDS[job[0]], *job[1:]
    psig, k_x, *further_gains = TABLE_1_ROWS[first // TOGETHER % len(TABLE_1_ROWS)]
    gains, setpoint = np.array([k_x * PSI_PER_INCH, *further_gains]), AMBIENT_PRESSURE + psig * PSI
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
        estimates, truth = device.estimates_and_truth(
            fit_model(CHANNEL, prepare_recordings([recording]).experiments(CHANNEL))
        )
        rows.append(
            [
                math.nan if estimate.value is None or not estimate.std else (estimate.value - gain) / estimate.std
                for estimate, gain in zip(estimates, truth.tolist())
            ]
        )
    return np.array(rows)


def line(name: str, errors: Array) -> tuple[str, ...]:
    """Return the line of a kind: coverage of each gain, and mean errors in standard errors."""
    coverage = [f'{100.0 * np.mean(np.abs(column[np.isfinite(column)]) < _REACH):.1f}' for column in errors.T]
    means = [f'{np.nanmean(column):+.2f}' for column in errors.T]
    return name, str(len(errors)), *coverage, *means


_REACH = 1.96  # standard errors: half a 95 % interval of many samples


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit the recordings and write the table."""
    parser = argparse.ArgumentParser(prog='coverage', description=__doc__)
    for core, count in COUNTS.items():
        text = f'seeds of each kind of {core} devices (default: 0 {count})'
        parser.add_argument(f'--{core}', type=int, nargs=2, default=(0, count), metavar=('FIRST', 'END'), help=text)
    seeds = vars(parser.parse_args(arguments))
    jobs = [
        (kind, seed, core)
        for core, (first, end) in seeds.items()
        for kind in range(len(KINDS))
        for seed in range(first, end, TOGETHER)
    ]
    errors = defaultdict(list)
    for chunk, (kind, _, core) in zip(side_by_side(gain_errors, jobs, 'coverage'), jobs):
        errors[core, kind].append(chunk)
    lines = [line(f'{core}: {KINDS[kind].name}', np.concatenate(chunks)) for (core, kind), chunks in errors.items()]
    header = ('recordings', 'number', *(f'{name} covered [%]' for name in NAMES), *(f'{name} error' for name in NAMES))
    chosen_options = ' '.join(f'--{core} {first} {end}' for core, (first, end) in seeds.items())
    page = (
        '# Coverage\n\n'
        'How often do the 95 % intervals of the gains contain the true values? *Error* is the mean error in standard '
        'errors. An independent integrator simulates smooth motions, sampled at 2 ms, with the six rows of the '
        "paper's Table 1 in turn. Linear devices are fitted with the linear core, physical devices with the physical "
        f'core. Physical devices have random critical ratios ({CRITICAL_RATIOS[0]} to {CRITICAL_RATIOS[1]}) and '
        f'exponents ({EXPONENTS[0]} to {EXPONENTS[1]}), with {TOGETHER} recordings each. '
        f"Written by `make coverage ARGS='{chosen_options}'`.\n\n"
        f'- Machine: {machine()}\n\n{table(header, lines)}\n\n{notes_in(DOCUMENT)}\n'
    )
    write_text(DOCUMENT, page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
