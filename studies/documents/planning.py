# SPDX-License-Identifier: Apache-2.0
"""
What `plan_experiment` predicts beside what the virtual rig then gives: make planning-document writes docs/planning.md.

A parameter file is some percent off the true device, as one is that was identified before. The schedule that is planned
with it is played on the rig, which shares no code with the model, and identified.
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

DOCUMENT = ROOT / 'docs' / 'planning.md'

SEEDS = range(510, 512)
"""Devices that are reported; 0, 1, 500 and 501 were used in development."""

LIMITS = Limits((6.0 * PSI, 12.0 * PSI), duration=20.0)
OFF = 0.05
"""By which each parameter in the file is off the true one, up or down."""

RUNS = 30
"""Recordings of one device, to see how estimates scatter."""

TIMES = (2.0, 0.1)
"""Strengths over the smallest that is predicted to show, at which effects are installed."""


REFERENCE = 10.0 * PSI
"""Gauge pressure about which strengths are converted [Pa]."""

EFFECTS = [name for name in MODELLED if name not in FORCE_EFFECTS]
"""Those on the pressure."""

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
"""From an effect's first strength, without its sign, to the panel's, where that is another."""

POSSIBLE = {'volume_variation': (0.0, 1.0), 'line_restriction': (5e-4, math.inf), 'heat_transfer': (0.0, 10.0)}
"""Strengths that the rig can make, where it can't make all."""


@dataclass(frozen=True)
class Case:
    """A device and the plan that was made for it with a file a little off."""

    seed: int
    gains: Gains
    plan: Plan
    schedule: Schedule

    @classmethod
    def of(cls, seed: int) -> Case:
        """Return the case of a seed, which picks the device and how the file is off."""
        gains = draw(None, 'paper_step', seed).truth.gains
        rng = np.random.default_rng([seed, 1])
        guessed = np.array(gains) * (1.0 + OFF * rng.choice([-1.0, 1.0], len(gains)))
        level = LIMITS.pressures[0]
        values: dict[str, Value] = {f'cylinder_a.{name}': (value,) for name, value in zip(NAMES, guessed.tolist())}
        device = Device({'cylinder_a.setpoints': (level,), **values, 'cylinder_b.enabled': False})
        found = plan(device, LIMITS)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / 'schedule.csv'
            write_text(file, found.proposal.table())
            return cls(seed, gains, found, written_schedule(file))

    def predicted(self, effect: str) -> EffectPrediction:
        """Return what is predicted of an effect on the pressure."""
        return next(one for one in self.plan.effects if one.effect == effect and one.channel == 'cylinder_a')

    def strength(self, effect: str, times: float) -> float | None:
        """Return the panel's strength that is some times what just shows; None where the rig has none so large."""
        on_rig = ON_RIG[effect]
        smallest = self.predicted(effect).smallest
        if not smallest:
            return None if smallest is None or times < 1.0 else on_rig.weakest
        value = abs(next(iter(smallest.values())))
        if effect == 'operating_point':  # gains follow the pressure as they do in nature, or not at all
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
    """Return the fit of the paper's model as `identify_bag` makes it."""
    return identify([recording]).channels['cylinder_a'].fit


class Job(NamedTuple):
    """An effect on a device, at some times the strength that just shows."""

    seed: int
    effect: str
    times: float


class Outcome(NamedTuple):
    """What closing the loop named in it, with what it could not tell it from; None where the rig can't make it."""

    effects: tuple[str, ...]
    alternatives: tuple[str, ...]

    def __str__(self) -> str:
        """Return it for people."""
        rivals = f' (or {", ".join(self.alternatives)})' if self.alternatives else ''
        return f'{", ".join(self.effects)}{rivals}' if self.effects else 'none'


@cache
def case(seed: int) -> Case:
    """Return the case of a seed."""
    return Case.of(seed)


def run(job: Job) -> Outcome | None:
    """Return what is named in a recording of a device with an effect."""
    strength = case(job.seed).strength(job.effect, job.times)
    if strength is None:
        return None
    drawn = draw(job.effect, case(job.seed).schedule, job.seed, given={job.effect: strength})
    _, found = close_loop(fitted(cylinder_a_of(drawn)))
    alternatives = dict.fromkeys(itertools.chain.from_iterable(found.alternatives.values()))
    return Outcome(found.effects, tuple(alternatives))


def scatter(seed: int, runs: int) -> tuple[Array, Array]:
    """Return the estimates of recordings of one healthy device that differ in noise, and their standard errors."""
    cylinder = cylinder_with(case(seed).gains, 1.3, Air())
    rig = RigParameters(cylinder_a=cylinder, cylinder_b=cylinder)
    estimates = []
    for noise in range(runs):
        recording = recording_of(record(case(seed).schedule, rig, seed=noise), 'planned')
        alone = replace(recording, cylinders={'cylinder_a': recording.cylinders['cylinder_a']}, force=None)
        found = fitted(alone)
        estimates.append([(one.value, one.std) for one in found.estimates])
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
        '# A plan and what came of it',
        ' '.join(__doc__.split('\n\n')[1].split()),
        '- Command: `make planning-document`\n'
        f'- Machine: {machine()}; {minutes:.1f} minutes, on cores shared with others\n'
        f'- Commit {commit()}\n'
        f'- Limits: {LIMITS.stroke * 1e3:g} mm, {LIMITS.speed:g} m/s, {LIMITS.acceleration:g} m/s^2, '
        f'{low:g} to {high:g} psig, {LIMITS.duration:g} s at 500 Hz; each parameter in the file is {OFF:.0%} off\n'
        f'- Seeds {", ".join(map(str, seeds))}; 0, 1, 500 and 501 were used in development',
        '## Standard errors',
        f'Of one healthy device, {runs} recordings that differ in noise. All in % of the true value; a '
        f'standard deviation of {runs} values is uncertain by {100.0 / math.sqrt(2.0 * (runs - 1)):.0f} %.',
        _scatter_table(case(seeds[0]), values, stds),
        '## Effects',
        'Predicted: from which strength on an effect shows. Installed at twice that strength, and at a tenth, '
        'where no effect is worth a name; a hyphen where the rig makes none so large or so small.',
        _summary(outcomes),
        _effects_table(seeds, outcomes),
    ]
    return '\n\n'.join(parts) + '\n'


def _scatter_table(of: Case, values: Array, stds: Array) -> str:
    lines = []
    for name, true, value, std in zip(NAMES, of.gains, values.T, stds.T):
        predicted = next(one for one in of.plan.parameters if one.name == name).std or math.nan
        spread = float(np.std(value, ddof=1))
        shares = [f'{100.0 * share / true:.3f}' for share in (predicted, spread, np.mean(std))]
        off = np.mean(value) / true - 1.0
        lines.append([name, *shares, f'{spread / predicted:.2f}', f'{100.0 * off:+.3f}'])
    heads = ['parameter', 'predicted', 'scatter of estimates', 'reported, mean', 'scatter / predicted', 'mean error']
    return table(heads, lines)


def _summary(outcomes: Mapping[Job, Outcome | None]) -> str:
    strong = {job: one for job, one in outcomes.items() if job.times == TIMES[0] and one is not None}
    weak = [one for job, one in outcomes.items() if job.times == TIMES[1] and one is not None]
    firsts = {job: next(iter(one.effects), '') for job, one in strong.items()}
    first = sum(name == job.effect for job, name in firsts.items())
    held = sum(job.effect in (*one.effects, *one.alternatives) for job, one in strong.items())
    foretold = sum(name in case(job.seed).predicted(job.effect).alternatives for job, name in firsts.items())
    clean = sum(not one.effects for one in weak)
    return (
        f'At twice the strength the effect is named first in {first} of {len(strong)} recordings, and named or listed '
        f'as an alternative in {held}; in {foretold} another is named first that it was said not to be told from.'
        f' At a tenth nothing is named in {clean} of {len(weak)}.'
    )


def _effects_table(seeds: Sequence[int], outcomes: Mapping[Job, Outcome | None]) -> str:
    lines = []
    for effect in EFFECTS:
        predicted = [case(seed).predicted(effect) for seed in seeds]
        rivals = dict.fromkeys(rival for one in predicted for rival in one.alternatives)
        found = ['<br>'.join(str(outcomes[Job(seed, effect, times)] or '-') for seed in seeds) for times in TIMES]
        lines.append([f'`{effect}`', '<br>'.join(map(smallest_strength_text, predicted)), ', '.join(rivals), *found])
    return table(['effect', 'shows from', 'not to be told from', 'named at twice that', 'at a tenth of that'], lines)


def main() -> None:
    """Write the document."""
    write_text(DOCUMENT, document(SEEDS, RUNS))
    print(DOCUMENT)


if __name__ == '__main__':
    main()
