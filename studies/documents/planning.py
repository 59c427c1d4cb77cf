# SPDX-License-Identifier: Apache-2.0
"""
Compare the predictions of `plan_experiment` with the virtual rig: `make planning-document`.

The plan is made with a parameter file that differs from the true device by some percent, as after an identification.
The rig, which shares no code with the model, plays the planned schedule. Its recording is identified.
"""

from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.device import Device, Value
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Fit, close_loop, identify
from cfd_pneumatic.model import EFFECTS as MODELLED
from cfd_pneumatic.model import FORCE_EFFECTS, NAMES
from cfd_pneumatic.planning import EffectPrediction, Limits, Plan, plan, smallest_strength_text
from cfd_pneumatic.recording import Recording, recording_of
from cfd_pneumatic.rig import Air, RigParameters, Schedule, record, written_schedule
from cfd_pneumatic.runtime import LIMIT
from cfd_pneumatic.units import PSI
from studies.documents.markdown import table
from studies.panel import EFFECTS as ON_RIG
from studies.panel import Gains, draw
from studies.panel.rows import cylinder_a_of
from studies.panel.specimen import cylinder_with
from studies.tools.provenance import ROOT, commit, machine

DOCUMENT = ROOT / 'docs' / 'measurements' / 'planning.md'

SEEDS = range(510, 512)
"""Seeds of the reported devices; 0, 1, 500 and 501 were used in development."""

LIMITS = Limits((6.0 * PSI, 12.0 * PSI), duration=20.0)
PARAMETER_ERROR = 0.05
"""Relative error of each parameter in the file, up or down [-]."""

RUNS = 30
"""Number of recordings of a device for the scatter of estimates."""

TIMES = (2.0, 0.1)
"""Strengths of installed effects, divided by the smallest visible strength of the prediction [-]."""


REFERENCE = 10.0 * PSI
"""Gauge pressure about which strengths are converted [Pa]."""

EFFECTS = [name for name in MODELLED if name not in FORCE_EFFECTS]
"""Effects on the pressure."""

INSTALLED: dict[str, Callable[[float, Gains], float]] = {
    'volume_variation': lambda slope, gains: slope * 1.2 * (AMBIENT_PRESSURE + REFERENCE) / gains.k_x,
    'set_point_drift': lambda rate, gains: rate * LIMITS.duration,
    'supply_variation': lambda amplitude, gains: amplitude * math.sqrt(2.0),
    'leakage': lambda conductance, gains: conductance / gains.k_sv,
    'positional_leakage': lambda conductance, gains: conductance / gains.k_sv,
    'flow_saturation': lambda limit, gains: limit / gains.k_sv,
    'lost_motion': lambda width, gains: 2.0 * width,
    'nonlinear_valve': lambda exponent, gains: abs(math.log(exponent)),
    'heat_transfer': lambda loss, gains: 1.0 / loss,
}
"""Conversions of an effect's first parameter, without sign, to the panel's strength, if the two differ."""

POSSIBLE = {'volume_variation': (0.0, 1.0), 'line_restriction': (5e-4, math.inf), 'heat_transfer': (0.0, 10.0)}
"""Limits of strengths that the rig can simulate, if it cannot simulate all."""


@dataclass(frozen=True)
class Case:
    """A device, and the plan that was made with an inexact parameter file."""

    seed: int
    gains: Gains
    plan: Plan
    schedule: Schedule

    @classmethod
    def from_seed(cls, seed: int) -> Case:
        """Return the case of a seed, which determines the device and the errors of the file."""
        gains = draw(None, 'paper_step', seed).truth.gains
        rng = np.random.default_rng([seed, 1])
        assumed = np.array(gains) * (1.0 + PARAMETER_ERROR * rng.choice([-1.0, 1.0], len(gains)))
        level = LIMITS.pressures[0]
        values: dict[str, Value] = {f'cylinder_a.{name}': (value,) for name, value in zip(NAMES, assumed.tolist())}
        device = Device({'cylinder_a.setpoints': (level,), **values, 'cylinder_b.enabled': False})
        planned = plan(device, LIMITS)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'schedule.csv'
            write_text(file, planned.proposal.table())
            return cls(seed, gains, planned, written_schedule(file))

    def predicted(self, effect: str) -> EffectPrediction:
        """Return the prediction for an effect on the pressure."""
        return next(
            prediction
            for prediction in self.plan.effects
            if prediction.effect == effect and prediction.channel == 'cylinder_a'
        )

    def strength(self, effect: str, times: float) -> float | None:
        """Return the panel's strength at a multiple of the smallest visible one; None if the rig has no such effect."""
        on_rig = ON_RIG[effect]
        smallest = self.predicted(effect).smallest
        if not smallest:
            return None if smallest is None or times < 1.0 else on_rig.weakest
        value = abs(next(iter(smallest.values())))
        if effect == 'operating_point':  # on the rig the gains depend on the pressure fully or not at all
            return 1.0 if value * times > 1.0 else None
        if effect == 'flow_saturation' and 'charge' not in smallest:
            value *= self.gains.k_sv / self.gains.k_v
        if effect == 'leakage' and 'orifice' in smallest:
            value *= (AMBIENT_PRESSURE + REFERENCE) / REFERENCE
        strength = INSTALLED[effect](value, self.gains) if effect in INSTALLED else value
        strength *= times if on_rig.weakest <= on_rig.strongest else 1.0 / times
        least, largest = POSSIBLE.get(effect, (0.0, math.inf))
        return strength if least <= strength <= largest else None


def fitted(recording: Recording) -> Fit:
    """Return the fit of the paper's model to a recording, as in `identify_bag`."""
    return identify([recording]).channels['cylinder_a'].fit


class Job(NamedTuple):
    """An effect on a device, at a multiple of the smallest visible strength."""

    seed: int
    effect: str
    times: float


class Outcome(NamedTuple):
    """Effects that the loop named, and alternatives that it could not distinguish from them."""

    effects: tuple[str, ...]
    alternatives: tuple[str, ...]

    def __str__(self) -> str:
        """Return the named effects with their alternatives."""
        rivals = f' (or {", ".join(self.alternatives)})' if self.alternatives else ''
        return f'{", ".join(self.effects)}{rivals}' if self.effects else 'none'


@cache
def case(seed: int) -> Case:
    """Return the case of a seed."""
    return Case.from_seed(seed)


def run(job: Job) -> Outcome | None:
    """Return the outcome of a job; None if the rig cannot simulate the effect at this strength."""
    strength = case(job.seed).strength(job.effect, job.times)
    if strength is None:
        return None
    drawn = draw(job.effect, case(job.seed).schedule, job.seed, given={job.effect: strength})
    _, conclusion = close_loop(fitted(cylinder_a_of(drawn)))
    alternatives = dict.fromkeys(itertools.chain.from_iterable(conclusion.alternatives.values()))
    return Outcome(conclusion.effects, tuple(alternatives))


def scatter(seed: int, runs: int) -> tuple[Array, Array]:
    """Return estimates and standard errors from recordings of a healthy device with different noise."""
    cylinder = cylinder_with(case(seed).gains, 1.3, Air())
    rig = RigParameters(cylinder_a=cylinder, cylinder_b=cylinder)
    estimates = []
    for noise in range(runs):
        recording = recording_of(record(case(seed).schedule, rig, seed=noise), 'planned')
        pressure_only = replace(recording, cylinders={'cylinder_a': recording.cylinders['cylinder_a']}, force=None)
        fit = fitted(pressure_only)
        estimates.append([(estimate.value, estimate.std) for estimate in fit.estimates])
    values, stds = np.moveaxis(np.array(estimates, dtype=np.float64), 2, 0)
    return values, stds


def document(seeds: Sequence[int], runs: int) -> str:
    """Return the document's text."""
    began = time.monotonic()
    jobs = [Job(seed, effect, times) for effect in EFFECTS for times in TIMES for seed in seeds]
    os.environ[LIMIT] = '1'  # a process for each core instead
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), multiprocessing.get_context('spawn')) as pool:
        scattered = pool.submit(scatter, seeds[0], runs)
        outcomes = dict(zip(jobs, pool.map(run, jobs)))
        values, stds = scattered.result()
    minutes = (time.monotonic() - began) / 60.0
    low, high = (pressure / PSI for pressure in LIMITS.pressures)
    parts = [
        '# Predictions of a plan and their test',
        ' '.join(__doc__.split('\n\n')[1].split()),
        '- Command: `make planning-document`\n'
        f'- Machine: {machine()}; {minutes:.1f} minutes, on shared cores\n'
        f'- Commit {commit()}\n'
        f'- Limits: {LIMITS.stroke * 1e3:g} mm, {LIMITS.speed:g} m/s, {LIMITS.acceleration:g} m/s^2, '
        f'{low:g} to {high:g} psig, {LIMITS.duration:g} s at 500 Hz; each parameter in the file is '
        f'{PARAMETER_ERROR:.0%} off\n- Seeds {", ".join(map(str, seeds))}; 0, 1, 500 and 501 were used in development',
        '## Standard errors',
        f'A healthy device, {runs} recordings with different noise, in % of the true value. The standard deviation of '
        f'{runs} values is uncertain by {100.0 / math.sqrt(2.0 * (runs - 1)):.0f} %.',
        _scatter_table(case(seeds[0]), values, stds),
        '## Effects',
        'The plan predicts the smallest visible strength of each effect. The rig has the effect at twice this '
        'strength, and at a tenth, at which no effect should be named. A hyphen: the rig cannot simulate the strength.',
        _summary(outcomes),
        _effects_table(seeds, outcomes),
    ]
    return '\n\n'.join(parts) + '\n'


def _scatter_table(case: Case, values: Array, stds: Array) -> str:
    lines = []
    for name, true, value, std in zip(NAMES, case.gains, values.T, stds.T):
        predicted = next(parameter for parameter in case.plan.parameters if parameter.name == name).std or math.nan
        spread = float(np.std(value, ddof=1))
        shares = [f'{100.0 * share / true:.3f}' for share in (predicted, spread, np.mean(std))]
        off = np.mean(value) / true - 1.0
        lines.append([name, *shares, f'{spread / predicted:.2f}', f'{100.0 * off:+.3f}'])
    heads = ['parameter', 'predicted', 'scatter of estimates', 'reported, mean', 'scatter / predicted', 'mean error']
    return table(heads, lines)


def _summary(outcomes: Mapping[Job, Outcome | None]) -> str:
    strong = {job: outcome for job, outcome in outcomes.items() if job.times == TIMES[0] and outcome is not None}
    weak = [outcome for job, outcome in outcomes.items() if job.times == TIMES[1] and outcome is not None]
    firsts = {job: next(iter(outcome.effects), '') for job, outcome in strong.items()}
    first = sum(name == job.effect for job, name in firsts.items())
    listed = sum(job.effect in (*outcome.effects, *outcome.alternatives) for job, outcome in strong.items())
    predicted = sum(name in case(job.seed).predicted(job.effect).alternatives for job, name in firsts.items())
    clean = sum(not outcome.effects for outcome in weak)
    return (
        f'At twice the strength the effect is named first in {first} of {len(strong)} recordings, and named or listed '
        f'as an alternative in {listed}. A predicted alternative is named first in {predicted}. At a tenth no '
        f'effect is named in {clean} of {len(weak)} recordings.'
    )


def _effects_table(seeds: Sequence[int], outcomes: Mapping[Job, Outcome | None]) -> str:
    lines = []
    for effect in EFFECTS:
        predicted = [case(seed).predicted(effect) for seed in seeds]
        rivals = dict.fromkeys(rival for prediction in predicted for rival in prediction.alternatives)
        named = ['<br>'.join(str(outcomes[Job(seed, effect, times)] or '-') for seed in seeds) for times in TIMES]
        lines.append([f'`{effect}`', '<br>'.join(map(smallest_strength_text, predicted)), ', '.join(rivals), *named])
    return table(
        ['effect', 'smallest visible strength', 'not distinguishable from', 'named at twice', 'named at a tenth'], lines
    )


def main() -> None:
    """Write the document."""
    write_text(DOCUMENT, document(SEEDS, RUNS))
    print(DOCUMENT)


if __name__ == '__main__':
    main()
