"""
Which effect makes a small step return the paper's Table 2 on a device that has Table 1: make paper-tables.

The paper's parameters fall when the step is small: at 5 psig K_x from 16 to 7 lbf/in^3 and K_sv from 104 to 25 1/s,
at 10 psig less. A device of the paper's model with one effect of the library, or two, is moved by 60 and by 17 mil, and
the four parameters are identified from each record as a user would. What strength of the effect returns Table 2?
"""

from __future__ import annotations

import argparse
import itertools
import math
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification.channels.channel import Model
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.fit import fit
from cfd_pneumatic.identification.procedure import prepared
from cfd_pneumatic.model import TABLE_1, TABLE_2
from cfd_pneumatic.model.effects import EFFECTS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig.schedule import MIL, paper_step
from cfd_pneumatic.units import PSI, PSI_PER_INCH
from studies.documents import NOTES, notes_in, table
from studies.provenance import commit, machine

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

PRESSURES = (5.0, 10.0)
"""Of Table 2 [psig]."""

LARGE, SMALL = 60.0, 17.0
"""Steps of Table 1 and of Table 2 [mil]."""

ROWS = {
    mil: {psig: points.at(psig * PSI).table[0, 1:] for psig in PRESSURES}
    for mil, points in ((LARGE, TABLE_1), (SMALL, TABLE_2))
}
"""By step and pressure: k_x, k_sv, k_v, tau in SI units; the small step tells no k_v."""

JUDGED = slice(2)
"""K_x and K_sv of the small step: tau below 0.01 s changes little, says the paper."""

REPEATABILITY = 0.10
"""By which the paper's repeated identifications differ: what counts as returned."""

_NOT_IDENTIFIED = 3.0  # logarithm of an error
_TRIED = 12  # strengths over the range of the first parameter
_REFINED = 2  # of them
_STEP = 2e-3  # of a finite difference
_MS = 1e-3


class Free(NamedTuple):
    """A parameter that is searched, on a logarithmic scale where all of its range is positive."""

    effect: str
    name: str
    low: float
    high: float
    unit: str
    factor: float = 1.0  # what one of the unit is in SI

    def at(self, share: float) -> float:
        """Return the value at a share of the range."""
        if self.low > 0.0:
            return self.low * (self.high / self.low) ** share
        return self.low + share * (self.high - self.low)


SEARCHED = (
    Free('lost_motion', 'width', 0.1, 16.0, 'mil', MIL),
    Free('displacement_lag', 'lag', 0.1, 50.0, 'ms', _MS),
    Free('transport_delay', 'delay', -20.0, 20.0, 'ms', _MS),
    Free('sensor_lag', 'lag', 0.2, 100.0, 'ms', _MS),
    Free('line_resonance', 'frequency', 2.0, 500.0, 'Hz'),
    Free('line_resonance', 'damping', 0.05, 0.7, 'damping'),
    Free('line_restriction', 'resistance', 0.1, 100.0, 'ms', _MS),
    Free('line_restriction', 'volume', 0.001, 1.0, 'volume'),
    Free('droop', 'slope', 0.1, 100.0, 'ms', _MS),
    Free('droop', 'lag', 2.0, 2000.0, 'ms lag', _MS),
    Free('valve_dead_band', 'band', 0.005, 0.5, 'psi', PSI),
    Free('valve_hysteresis', 'width', 0.005, 0.5, 'psi', PSI),
    Free('nonlinear_valve', 'exponent', 0.3, 3.0, 'exponent'),
    Free('flow_saturation', 'charge', 0.5, 500.0, 'psi/s', PSI),
    Free('flow_saturation', 'exhaust', 0.1, 500.0, 'psi/s out', PSI),
    Free('operating_point', 'supply', 30.0, 150.0, 'psi supply', PSI),
    Free('operating_point', 'exponent', -1.0, 4.0, 'exponent'),
    Free('volume_variation', 'slope', -900.0, 900.0, '1/m'),
    Free('heat_transfer', 'loss', 0.1, 900.0, '1/s'),
    Free('leakage', 'conductance', 0.01, 50.0, '1/s'),
    Free('positional_leakage', 'conductance', 0.01, 50.0, '1/s'),
    Free('positional_leakage', 'position', 0.0, 60.0, 'mil', MIL),
    Free('set_point_drift', 'rate', -2.0, 2.0, 'psi/s', PSI),
    Free('supply_variation', 'in_phase', -0.5, 0.5, 'psi sine', PSI),
    Free('supply_variation', 'quadrature', -0.5, 0.5, 'psi cosine', PSI),
)
"""What is searched of every effect on the pressure, and in which range."""

HELD = {'operating_point': {'strength': 1.0}, 'positional_leakage': {'width': 0.2 * SMALL * MIL}}
"""Parameters that are neither searched nor as where the effect is off."""

TOGETHER = ('lost_motion', 'valve_dead_band', 'nonlinear_valve', 'valve_hysteresis', 'sensor_lag')
"""Effects that are tried two at a time: those that lower K_x or K_sv, with the amplitude or at all."""


class Found(NamedTuple):
    """The best that effects can do."""

    strengths: str
    """What was searched, with units."""

    large: Array
    small: Array
    """Errors of k_x, k_sv, k_v and tau by steps of both sizes, as shares of the tables', shape (pressures, 4)."""


CHANNEL = Pressure('cylinder_a', AMBIENT_PRESSURE)


@cache
def experiment(psig: float, mil: float) -> Experiment:
    """Return the paper's step at a pressure, its pressures still to be made."""
    schedule = paper_step(psig * PSI, mil * MIL)
    knots = schedule.knots_per_sample
    times = schedule.sampling_period * np.arange(float(schedule.samples))
    displacement = Signal(times, schedule.positions[knots - 1 :: knots])
    setpoint = Signal(times[:1], np.array([psig * PSI + AMBIENT_PRESSURE]))
    cylinder = CylinderSignals(Signal(times, times), setpoint)
    recording = Recording('step', 0, displacement, {'cylinder_a': cylinder}, None, ())
    return replace(prepared([recording]).experiments(CHANNEL)[0], chosen=np.ones(times.size, dtype=bool))


def returned(psig: float, mil: float, gains: np.ndarray, effects: Mapping[str, tuple[float, ...]]) -> np.ndarray:
    """Return the four parameters that a step of a device with effects identifies; NaN where it tells nothing."""
    one = experiment(psig, mil)
    (pressure,) = CHANNEL.simulated([one], Model(gains, effects, np.zeros((1, 2))))
    if not np.all(np.isfinite(pressure)):
        return np.full(4, math.nan)
    try:
        return fit(CHANNEL, [replace(one, measured=pressure)]).model.parameters
    except (InputError, ValueError, np.linalg.LinAlgError):
        return np.full(4, math.nan)


@dataclass(frozen=True)
class Question:
    """What strength of some effects returns Table 2 at some pressures, perhaps with gains such that Table 1 is, too."""

    names: Sequence[str]
    pressures: Sequence[float]
    own_gains: bool = False

    @property
    def free(self) -> list[Free]:
        """The parameters that are searched."""
        return [free for name in self.names for free in SEARCHED if free.effect == name]

    def effects(self, values: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """Return the effects' parameters with searched ones put in."""
        own = {
            name: {one.name: one.null for one in EFFECTS[name].parameters} | HELD.get(name, {}) for name in self.names
        }
        for free, value in zip(self.free, values):
            own[free.effect][free.name] = value * free.factor
        return {name: tuple(parameters.values()) for name, parameters in own.items()}

    def split(self, point: Array) -> tuple[Array, list[float]]:
        """Return the gains at each pressure and the searched parameters; a point is 1 to 2 in each direction."""
        values = [free.at(share) for free, share in zip(self.free, point - 1.0)]
        gains = np.array([ROWS[LARGE][psig] for psig in self.pressures])
        if self.own_gains:  # within a factor of ten of the table's
            gains *= 10.0 ** (2.0 * point[len(self.free) :].reshape(-1, 4) - 3.0)
        return gains, values

    def ratios(self, point: Array, mil: float) -> Array:
        """Return what steps of one size identify at each pressure over what the table has."""
        gains, values = self.split(point)
        effects = self.effects(values)
        return np.array(
            [returned(psig, mil, own, effects) / ROWS[mil][psig] for psig, own in zip(self.pressures, gains)]
        )

    def errors(self, point: Array) -> Array:
        """Return logarithms of the errors: of the small step, and of the large one where the gains are free."""
        parts = [self.ratios(point, SMALL)[:, JUDGED]]
        if self.own_gains:
            parts.append(self.ratios(point, LARGE))
        errors = np.log(np.concatenate(parts, axis=None))
        return np.clip(np.where(np.isfinite(errors), errors, _NOT_IDENTIFIED), -_NOT_IDENTIFIED, _NOT_IDENTIFIED)

    def answer(self, starts: Sequence[Array] = ()) -> tuple[Array, Found]:
        """Return the point of the best answer, and the answer."""
        begins = sorted(starts or self.starts(), key=lambda one: float(np.sum(self.errors(one) ** 2)))[:_REFINED]
        found = [
            least_squares(self.errors, one, bounds=(1.0, 2.0), diff_step=_STEP, xtol=1e-4, ftol=1e-4, max_nfev=15)
            for one in begins
        ]
        point = min(found, key=lambda one: one.cost).x
        _, values = self.split(point)
        strengths = ', '.join(f'{value:.3g} {free.unit}' for free, value in zip(self.free, values))
        return point, Found(strengths, *(self.ratios(point, mil) - 1.0 for mil in (LARGE, SMALL)))

    def starts(self) -> Iterator[Array]:
        """Yield points over the range of each effect's first parameter; the others are in the middle."""
        shares = np.linspace(1.02, 1.98, _TRIED // len(self.names)).tolist()
        before = [None, *(free.effect for free in self.free)]
        axes = [[1.5] if free.effect == other else shares for free, other in zip(self.free, before)]
        return map(np.array, itertools.product(*axes))


class Answers(NamedTuple):
    """What is known of some effects."""

    names: Sequence[str]

    alone: tuple[Found, ...]
    """For each pressure alone, gains as in Table 1."""

    both: Found
    """For both pressures together, gains as in Table 1."""

    consistent: Found
    """For both together, gains such that the large step returns Table 1."""

    @property
    def title(self) -> str:
        """The effects' names for the document."""
        return ' + '.join(f'`{name}`' for name in self.names)


def answers(names: Sequence[str]) -> Answers:
    """Ask all questions about some effects."""
    alone = tuple(Question(names, (psig,)).answer()[1] for psig in PRESSURES)
    point, both = Question(names, PRESSURES).answer()
    gains = np.full(4 * len(PRESSURES), 1.5)
    starts = [np.concatenate([one, gains]) for one in (point, 0.5 * (point + 1.5))]
    _, consistent = Question(names, PRESSURES, own_gains=True).answer(starts)
    return Answers(names, alone, both, consistent)


def worst(*errors: Array) -> float:
    """Return the largest error of K_x and K_sv, as a factor's logarithm."""
    return max(float(np.max(np.abs(np.log1p(one[:, JUDGED])))) for one in errors)


def nearness(one: Answers) -> float:
    """Return the largest error of K_x and K_sv of both steps where the gains are free."""
    return worst(one.consistent.small, one.consistent.large)


def _verdict(error: float) -> str:
    return 'yes' if error <= math.log1p(REPEATABILITY) else 'no'


def _percent(errors: Array) -> str:
    return ', '.join(f'{100.0 * error:+.0f} %' for error in errors)


def document(everything: Sequence[Answers], command: str, notes: str) -> str:
    """Return the document in Markdown."""
    before = []
    for psig in PRESSURES:
        rows = [ROWS[mil][psig][JUDGED] for mil in (LARGE, SMALL)]
        gains = [f'{k_x / PSI_PER_INCH:.1f} / {k_sv:.0f}' for k_x, k_sv in rows]
        before.append([f'{psig:g}', *gains, _percent(rows[0] / rows[1] - 1.0)])
    sections = [
        "# The paper's Table 2 from its Table 1\n\n" + ' '.join((__doc__ or '').strip().split('\n\n')[1].split()),
        f'- Command: `{command}`\n- Machine: {machine()}\n- Commit {commit()}\n'
        f"- Records: the paper's step (2 ms, 50 samples at rest, 300 after), {LARGE:g} and {SMALL:g} mil, no noise; "
        'fit of the four parameters and the set-point.\n'
        f'- *Returned* means within {100 * REPEATABILITY:.0f} %, by which the paper says that repeats differ.',
        '## Before: no effect\n\nThe small step returns what the large one does.\n\n'
        + table(['psig', 'Table 1: K_x / K_sv', 'Table 2: K_x / K_sv', 'error against Table 2: K_x, K_sv'], before),
    ]
    for number, title in enumerate(('One effect', 'Two effects'), 1):
        some = [one for one in everything if len(one.names) == number]
        if some:
            sections += [_literal_section(title, some), _consistent_section(title, some)]
    return '\n\n'.join([*sections, _summary_section(everything), notes or NOTES]) + '\n'


def _literal_section(title: str, some: Sequence[Answers]) -> str:
    lines = []
    for one in sorted(some, key=lambda one: worst(one.both.small)):
        lines.append(
            [
                one.title,
                *(f'{found.strengths}: {_percent(found.small[0, JUDGED])}' for found in one.alone),
                one.both.strengths,
                *map(_percent, one.both.small[:, JUDGED]),
                '; '.join(map(_percent, one.both.large[:, JUDGED])),
                ' / '.join(_verdict(worst(found.small)) for found in (*one.alone, one.both)),
            ]
        )
    header = ['effect', 'best at 5 psig alone', 'best at 10 psig alone', 'best for both', 'error at 5', 'error at 10']
    header += ['large step then, at 5; at 10', 'returned at 5 / at 10 / at both']
    return (
        f"## {title} on a device with Table 1's gains\n\nErrors of K_x, K_sv that the small step returns, against "
        "Table 2, at the strength that suits best; the large step's against Table 1.\n\n" + table(header, lines)
    )


def _consistent_section(title: str, some: Sequence[Answers]) -> str:
    tau = np.array([1e3 * ROWS[SMALL][psig][3] for psig in PRESSURES])
    lines = []
    for one in sorted(some, key=nearness):
        found = one.consistent
        lines.append(
            [
                one.title,
                found.strengths,
                *map(_percent, found.small[:, JUDGED]),
                *(f'{ms * (1.0 + error):.1f} ({ms:.1f})' for ms, error in zip(tau, found.small[:, 3])),
                '; '.join(map(_percent, found.large)),
                f'{100.0 * math.expm1(nearness(one)):.0f} %',
                _verdict(nearness(one)),
            ]
        )
    header = ['effect', 'strength', 'small step at 5: K_x, K_sv', 'at 10', 'tau at 5 (Table 2) [ms]', 'at 10']
    header += ['large step at 5; at 10: K_x, K_sv, K_v, tau', 'largest of K_x, K_sv', 'both tables']
    return (
        f'## {title} on a device whose large step returns Table 1\n\nTable 1 was identified on the device with the '
        "effect in it. So here the device's own gains are free at each pressure, and the strength is one for both; all "
        'twelve values are fitted together, and errors are of both steps.\n\n' + table(header, lines)
    )


def _summary_section(everything: Sequence[Answers]) -> str:
    def named(error: Callable[[Answers], float]) -> str:
        return ', '.join(one.title for one in everything if _verdict(error(one)) == 'yes') or 'none'

    nearest = sorted(everything, key=nearness)[:3]
    shares = [f'{one.title} ({100.0 * math.expm1(nearness(one)):.0f} %)' for one in nearest]
    lines = [
        [f'at {PRESSURES[0]:g} psig alone', named(lambda one: worst(one.alone[0].small))],
        [f'at {PRESSURES[1]:g} psig alone', named(lambda one: worst(one.alone[1].small))],
        ["at both with one strength, gains as Table 1's", named(lambda one: worst(one.both.small))],
        ['at both, and the large step still returns Table 1', named(nearness)],
        ['nearest to that, by the largest error of K_x and K_sv in both tables', ', '.join(shares)],
    ]
    return (
        '## Summary\n\nWhat returns K_x and K_sv of Table 2 within '
        f'{100 * REPEATABILITY:.0f} %:\n\n{table(["where", "effects"], lines)}'
    )


def main() -> int:
    """Ask about every effect and some pairs, write the document; return the exit code."""
    from rich.progress import track

    parser = argparse.ArgumentParser(prog='paper_tables', description=(__doc__ or '').split('\n\n')[0])
    parser.add_argument('--effects', help='only these, separated by commas')
    parser.add_argument('--no-pairs', action='store_true', help='one effect at a time only')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='processes')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'paper_tables.md', help='document')
    options = parser.parse_args()
    names = options.effects.split(',') if options.effects else dict.fromkeys(free.effect for free in SEARCHED)
    candidates: list[tuple[str, ...]] = [(name,) for name in names]
    if not options.no_pairs:
        candidates += itertools.combinations([name for name in TOGETHER if name in names], 2)
    for library in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA'):
        os.environ[f'{library}_NUM_THREADS'] = '1'  # read by the new processes
    with ProcessPoolExecutor(options.jobs, multiprocessing.get_context('spawn')) as pool:
        found = list(track(pool.map(answers, candidates), description='candidates', total=len(candidates)))
    write_text(options.output, document(found, 'make paper-tables', notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
