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
from documents import NOTES, notes_in, table
from provenance import commit, machine
from scipy.optimize import least_squares

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification.channels.channel import Model
from cfd_pneumatic.identification.channels.pressure import Pressure
from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.fit import fit
from cfd_pneumatic.identification.identify import prepared
from cfd_pneumatic.model import TABLE_1, TABLE_2
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig.schedule import MIL, paper_step
from cfd_pneumatic.units import PSI, PSI_PER_INCH

ROOT = Path(__file__).resolve().parents[1]

PRESSURES = (5.0, 10.0)
"""Of Table 2 [psig]."""

LARGE, SMALL = 60.0, 17.0
"""Steps of Table 1 and of Table 2 [mil]."""

LARGE_ROWS, SMALL_ROWS = (
    {psig: points.at(psig * PSI).table[0, 1:] for psig in PRESSURES} for points in (TABLE_1, TABLE_2)
)
"""k_x, k_sv, k_v, tau in SI units; the small step tells no k_v."""

JUDGED = (0, 1)
"""K_x and K_sv of the small step: tau below 0.01 s changes little, says the paper."""

REPEATABILITY = 0.10
"""By which the paper's repeated identifications differ: what counts as returned."""

_NOT_IDENTIFIED = 3.0  # logarithm of an error
_TRIED = 12  # strengths over the range of the first parameter
_REFINED = 2  # of them
_STEP = 2e-3  # of a finite difference


class Free(NamedTuple):
    """A parameter that is searched."""

    effect: str
    index: int
    low: float
    high: float
    unit: str
    factor: float = 1.0  # what one of the unit is in SI
    linear: bool = False


class Fixed(NamedTuple):
    """An effect's parameters at the start; the free ones are replaced."""

    values: tuple[float, ...]
    free: tuple[Free, ...]


def _one(effect: str, low: float, high: float, unit: str, factor: float = 1.0, linear: bool = False) -> Fixed:
    return Fixed((0.0,), (Free(effect, 0, low, high, unit, factor, linear),))


EFFECTS = {
    'lost_motion': _one('lost_motion', 0.1, 16.0, 'mil', MIL),
    'displacement_lag': _one('displacement_lag', 0.1, 50.0, 'ms', 1e-3),
    'transport_delay': _one('transport_delay', -20.0, 20.0, 'ms', 1e-3, linear=True),
    'sensor_lag': _one('sensor_lag', 0.2, 100.0, 'ms', 1e-3),
    'line_resonance': Fixed(
        (100.0, 0.5),
        (Free('line_resonance', 0, 2.0, 500.0, 'Hz'), Free('line_resonance', 1, 0.05, 0.7, 'damping')),
    ),
    'line_restriction': Fixed(
        (1e-3, 0.05),
        (Free('line_restriction', 0, 0.1, 100.0, 'ms', 1e-3), Free('line_restriction', 1, 0.001, 1.0, 'volume')),
    ),
    'droop': Fixed(
        (1e-3, 0.05), (Free('droop', 0, 0.1, 100.0, 'ms', 1e-3), Free('droop', 1, 2.0, 2000.0, 'ms lag', 1e-3))
    ),
    'valve_dead_band': _one('valve_dead_band', 0.005, 0.5, 'psi', PSI),
    'valve_hysteresis': _one('valve_hysteresis', 0.005, 0.5, 'psi', PSI),
    'nonlinear_valve': _one('nonlinear_valve', 0.3, 3.0, 'exponent'),
    'flow_saturation': Fixed(
        (1e9, 1e9),
        (
            Free('flow_saturation', 0, 0.5, 500.0, 'psi/s', PSI),
            Free('flow_saturation', 1, 0.1, 500.0, 'psi/s out', PSI),
        ),
    ),
    'operating_point': Fixed(
        (1.0, 5e5, 1.0),
        (
            Free('operating_point', 1, 30.0, 150.0, 'psi supply', PSI),
            Free('operating_point', 2, -1.0, 4.0, 'exponent', linear=True),
        ),
    ),
    'volume_variation': _one('volume_variation', -900.0, 900.0, '1/m', linear=True),
    'heat_transfer': _one('heat_transfer', 0.1, 900.0, '1/s'),
    'leakage': Fixed((0.0, 0.0), (Free('leakage', 0, 0.01, 50.0, '1/s'),)),
    'positional_leakage': Fixed(
        (1.0, 0.5 * SMALL * MIL, 0.2 * SMALL * MIL, 0.01, 1.0, 0.0),
        (
            Free('positional_leakage', 0, 0.01, 50.0, '1/s'),
            Free('positional_leakage', 1, 0.0, 60.0, 'mil', MIL, linear=True),
        ),
    ),
    'set_point_drift': _one('set_point_drift', -2.0, 2.0, 'psi/s', PSI, linear=True),
    'supply_variation': Fixed(
        (10.0, 10.0, 1.0),
        (
            Free('supply_variation', 0, -0.5, 0.5, 'psi sine', PSI, linear=True),
            Free('supply_variation', 1, -0.5, 0.5, 'psi cosine', PSI, linear=True),
        ),
    ),
}
"""Every effect on the pressure, with what is searched of it and in which range."""

TOGETHER = ('lost_motion', 'valve_dead_band', 'nonlinear_valve', 'valve_hysteresis', 'sensor_lag')
"""Effects that are tried two at a time: those that lower K_x or K_sv, with the amplitude or at all."""


@dataclass(frozen=True)
class Found:
    """
    The best that effects can do.

    Attributes
    ----------
    names
        The effects.
    pressures
        At which they were asked for [psig].
    strengths
        What was searched, with units.
    large, small
        What steps of both sizes return at each pressure, k_x, k_sv, k_v, tau in SI units.

    """

    names: tuple[str, ...]
    pressures: tuple[float, ...]
    strengths: tuple[str, ...]
    large: Mapping[float, np.ndarray]
    small: Mapping[float, np.ndarray]

    @property
    def small_errors(self) -> np.ndarray:
        """Of K_x and K_sv by the small step, by pressure, as shares of Table 2's, shape (pressures, 2)."""
        return np.array([(self.small[psig] / SMALL_ROWS[psig] - 1.0)[list(JUDGED)] for psig in self.pressures])

    @property
    def large_errors(self) -> np.ndarray:
        """Of all four by the large step, as shares of Table 1's, shape (pressures, 4)."""
        return np.array([self.large[psig] / LARGE_ROWS[psig] - 1.0 for psig in self.pressures])

    @property
    def worst(self) -> float:
        """Largest error of the small step, as a factor's logarithm."""
        return float(np.max(np.abs(np.log1p(self.small_errors))))


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
    return prepared([recording]).experiments(CHANNEL)[0]


def returned(psig: float, mil: float, gains: np.ndarray, effects: Mapping[str, tuple[float, ...]]) -> np.ndarray:
    """Return the four parameters that a step of a device with effects identifies; NaN where it tells nothing."""
    one = experiment(psig, mil)
    (pressure,) = CHANNEL.simulated([one], Model(gains, effects, np.zeros((1, 2))))
    if not np.all(np.isfinite(pressure)):
        return np.full(4, math.nan)
    try:
        return fit(CHANNEL, [replace(one, measured=pressure)], [np.ones(pressure.size, dtype=bool)]).model.parameters
    except (InputError, ValueError, np.linalg.LinAlgError):
        return np.full(4, math.nan)


class Question:
    """What strength of some effects returns Table 2 at some pressures."""

    def __init__(self, names: Sequence[str], pressures: Sequence[float], own_gains: bool) -> None:
        self.names = tuple(names)
        self.pressures = tuple(pressures)
        self.own_gains = own_gains  # whether the device's gains are free, so that the large step returns Table 1
        self.free = [free for name in names for free in EFFECTS[name].free]

    def effects(self, values: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """Return the effects' parameters with searched ones put in."""
        own = {name: list(EFFECTS[name].values) for name in self.names}
        for free, value in zip(self.free, values):
            own[free.effect][free.index] = value * free.factor
        return {name: tuple(parameters) for name, parameters in own.items()}

    def split(self, point: np.ndarray) -> tuple[dict[float, np.ndarray], list[float]]:
        """Return the gains at each pressure and the searched parameters; a point is 1 to 2 in each direction."""
        values = []
        for free, share in zip(self.free, point[: len(self.free)] - 1.0):
            if free.linear:
                values.append(free.low + share * (free.high - free.low))
            else:
                values.append(free.low * (free.high / free.low) ** share)
        gains = dict(LARGE_ROWS)
        if self.own_gains:  # within a factor of ten of the table's
            factors = 10.0 ** (2.0 * point[len(self.free) :] - 3.0)
            for psig, own in zip(self.pressures, factors.reshape(-1, 4)):
                gains[psig] = LARGE_ROWS[psig] * own
        return gains, values

    def steps(self, point: np.ndarray, mil: float) -> dict[float, np.ndarray]:
        """Return what steps of one size identify at each pressure."""
        gains, values = self.split(point)
        effects = self.effects(values)
        return {psig: returned(psig, mil, gains[psig], effects) for psig in self.pressures}

    def errors(self, point: np.ndarray) -> np.ndarray:
        """Return logarithms of the errors: of the small step, and of the large one where the gains are free."""
        small = self.steps(point, SMALL)
        parts = [np.log(small[psig] / SMALL_ROWS[psig])[list(JUDGED)] for psig in self.pressures]
        if self.own_gains:
            large = self.steps(point, LARGE)
            parts += [np.log(large[psig] / LARGE_ROWS[psig]) for psig in self.pressures]
        errors = np.concatenate(parts)
        return np.clip(np.where(np.isfinite(errors), errors, _NOT_IDENTIFIED), -_NOT_IDENTIFIED, _NOT_IDENTIFIED)

    def answer(self, starts: Sequence[np.ndarray] | None = None) -> tuple[np.ndarray, Found]:
        """Return the point of the best answer, and the answer."""
        begins = list(self._starts() if starts is None else starts)
        begins = sorted(begins, key=lambda one: float(np.sum(self.errors(one) ** 2)))[:_REFINED]
        found = [
            least_squares(self.errors, one, bounds=(1.0, 2.0), diff_step=_STEP, xtol=1e-4, ftol=1e-4, max_nfev=15)
            for one in begins
        ]
        point = min(found, key=lambda one: one.cost).x
        _, values = self.split(point)
        strengths = tuple(f'{value:.3g} {free.unit}' for free, value in zip(self.free, values))
        return point, Found(self.names, self.pressures, strengths, self.steps(point, LARGE), self.steps(point, SMALL))

    def _starts(self) -> Iterator[np.ndarray]:
        """Yield points over the range of each effect's first parameter; the others are in the middle."""
        firsts = [
            index for index, free in enumerate(self.free) if index == 0 or free.effect != self.free[index - 1].effect
        ]
        shares = np.linspace(1.02, 1.98, _TRIED if len(firsts) == 1 else _TRIED // 2)
        for chosen in itertools.product(shares, repeat=len(firsts)):
            point = np.full(len(self.free) + (4 * len(self.pressures) if self.own_gains else 0), 1.5)
            point[firsts] = chosen
            yield point


class Answers(NamedTuple):
    """What is known of some effects."""

    alone: tuple[Found, ...]
    """For each pressure alone, gains as in Table 1."""

    both: Found
    """For both pressures together, gains as in Table 1."""

    consistent: Found
    """For both together, gains such that the large step returns Table 1."""


def answers(names: Sequence[str]) -> Answers:
    """Ask all questions about some effects."""
    alone = tuple(Question(names, (psig,), own_gains=False).answer()[1] for psig in PRESSURES)
    point, both = Question(names, PRESSURES, own_gains=False).answer()
    start = np.concatenate([point, np.full(4 * len(PRESSURES), 1.5)])
    middle = start.copy()
    middle[: len(point)] = 0.5 * (middle[: len(point)] + 1.5)
    _, consistent = Question(names, PRESSURES, own_gains=True).answer([start, middle])
    return Answers(alone, both, consistent)


def _percent(errors: np.ndarray) -> str:
    return ', '.join(f'{100.0 * error:+.0f} %' for error in errors)


def _candidate(found: Found) -> str:
    return ' + '.join(f'`{name}`' for name in found.names)


def _verdict(found: Found) -> str:
    return 'yes' if found.worst <= math.log1p(REPEATABILITY) else 'no'


def document(singles: Sequence[Answers], pairs: Sequence[Answers], command: str, notes: str) -> str:
    """Return the document in Markdown."""
    before = [
        [
            f'{psig:g}',
            *(f'{row[0] / PSI_PER_INCH:.1f} / {row[1]:.0f}' for row in (LARGE_ROWS[psig], SMALL_ROWS[psig])),
            _percent((LARGE_ROWS[psig] / SMALL_ROWS[psig] - 1.0)[list(JUDGED)]),
        ]
        for psig in PRESSURES
    ]
    sections = [
        "# The paper's Table 2 from its Table 1\n\n" + ' '.join((__doc__ or '').strip().split('\n\n')[1].split()),
        f'- Command: `{command}`\n- Machine: {machine()}\n- Commit {commit()}\n'
        f"- Records: the paper's step (2 ms, 50 samples at rest, 300 after), {LARGE:g} and {SMALL:g} mil, no noise; "
        'fit of the four parameters and the set-point.\n'
        f'- *Returned* means within {100 * REPEATABILITY:.0f} %, by which the paper says that repeats differ.',
        '## Before: no effect\n\nThe small step returns what the large one does.\n\n'
        + table(['psig', 'Table 1: K_x / K_sv', 'Table 2: K_x / K_sv', 'error against Table 2: K_x, K_sv'], before),
    ]
    for title, some in (('One effect', singles), ('Two effects', pairs)):
        if some:
            sections += [_literal_section(title, some), _consistent_section(title, some)]
    sections += [_summary_section([*singles, *pairs]), notes or NOTES]
    return '\n\n'.join(sections).rstrip() + '\n'


def _literal_section(title: str, some: Sequence[Answers]) -> str:
    lines = []
    for one in sorted(some, key=lambda one: one.both.worst):
        lines.append(
            [
                _candidate(one.both),
                *(f'{", ".join(found.strengths)}: {_percent(found.small_errors[0])}' for found in one.alone),
                ', '.join(one.both.strengths),
                *(_percent(errors) for errors in one.both.small_errors),
                '; '.join(_percent(errors[:2]) for errors in one.both.large_errors),
                ' / '.join(_verdict(found) for found in (*one.alone, one.both)),
            ]
        )
    header = ['effect', 'best at 5 psig alone', 'best at 10 psig alone', 'best for both', 'error at 5', 'error at 10']
    header += ['large step then, at 5; at 10', 'returned at 5 / at 10 / at both']
    return (
        f"## {title} on a device with Table 1's gains\n\nErrors of K_x, K_sv that the small step returns, against "
        "Table 2, at the strength that suits best; the large step's against Table 1.\n\n" + table(header, lines)
    )


def _consistent_section(title: str, some: Sequence[Answers]) -> str:
    lines = []
    for one in sorted((one.consistent for one in some), key=largest):
        lines.append(
            [
                _candidate(one),
                ', '.join(one.strengths),
                *(_percent(errors) for errors in one.small_errors),
                *(f'{1e3 * one.small[psig][3]:.1f} ({1e3 * SMALL_ROWS[psig][3]:.1f})' for psig in PRESSURES),
                '; '.join(_percent(errors) for errors in one.large_errors),
                f'{100.0 * math.expm1(largest(one)):.0f} %',
                'yes' if consistent(one) else 'no',
            ]
        )
    header = ['effect', 'strength', 'small step at 5: K_x, K_sv', 'at 10', 'tau at 5 (Table 2) [ms]', 'at 10']
    header += ['large step at 5; at 10: K_x, K_sv, K_v, tau', 'largest of K_x, K_sv', 'both tables']
    return (
        f'## {title} on a device whose large step returns Table 1\n\nTable 1 was identified on the device with the '
        "effect in it. So here the device's own gains are free at each pressure, and the strength is one for both; all "
        'twelve values are fitted together, and errors are of both steps.\n\n' + table(header, lines)
    )


def largest(found: Found) -> float:
    """Return the largest error of K_x and K_sv of both steps, as a factor's logarithm."""
    errors = np.concatenate([found.small_errors, found.large_errors[:, list(JUDGED)]])
    return float(np.max(np.abs(np.log1p(errors))))


def consistent(found: Found) -> bool:
    """Return whether K_x and K_sv of both tables are returned."""
    return largest(found) <= math.log1p(REPEATABILITY)


def _summary_section(everything: Sequence[Answers]) -> str:
    def named(passes: Callable[[Answers], bool]) -> str:
        return ', '.join(_candidate(one.both) for one in everything if passes(one)) or 'none'

    lines = [
        [f'at {psig:g} psig alone', named(lambda one, rank=rank: _verdict(one.alone[rank]) == 'yes')]
        for rank, psig in enumerate(PRESSURES)
    ]
    nearest = sorted(everything, key=lambda one: largest(one.consistent))[:3]
    lines += [
        ["at both with one strength, gains as Table 1's", named(lambda one: _verdict(one.both) == 'yes')],
        ['at both, and the large step still returns Table 1', named(lambda one: consistent(one.consistent))],
        [
            'nearest to that, by the largest error of K_x and K_sv in both tables',
            ', '.join(
                f'{_candidate(one.both)} ({100.0 * math.expm1(largest(one.consistent)):.0f} %)' for one in nearest
            ),
        ],
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
    names = list(EFFECTS) if options.effects is None else options.effects.split(',')
    candidates = [(name,) for name in names]
    if not options.no_pairs:
        candidates += [pair for pair in itertools.combinations(TOGETHER, 2) if set(pair) <= set(names)]
    for library in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA'):
        os.environ[f'{library}_NUM_THREADS'] = '1'  # read by the new processes
    with ProcessPoolExecutor(options.jobs, multiprocessing.get_context('spawn')) as pool:
        found = list(track(pool.map(answers, candidates), description='candidates', total=len(candidates)))
    singles = [one for one in found if len(one.both.names) == 1]
    pairs = [one for one in found if len(one.both.names) == 2]
    write_text(options.output, document(singles, pairs, 'make paper-tables', notes_in(options.output)))
    print(f'The document is {options.output}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
