# SPDX-License-Identifier: Apache-2.0
"""
The panel's recordings, each drawn, identified, and put down as a row.

What is wrong with the device is compared with the answer only afterwards. Rows are kept in a file, so that a run that
was stopped goes on where it was; those that other versions of the program gave are measured again.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.arrays import rms
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import PARTS, Fit, Options, find_optimum, identify, with_core
from cfd_pneumatic.model import CORES
from cfd_pneumatic.recording import Recording, recording_of
from cfd_pneumatic.rig import Cylinder
from studies.panel import (
    FOREIGN,
    LIBRARY,
    MAKES,
    NOISES,
    ON_FORCE,
    Draw,
    draw,
    draw_textbook,
    force_oracle_residual,
    oracle_residual,
)
from studies.tools.processes import side_by_side
from studies.tools.provenance import commit

CYLINDER = 'cylinder_a'

ON_FORCE_KINDS = ('force', 'clean_force')
WHOLE_KINDS = ('whole', 'healthy_whole')
"""Of devices with all of their physics, with one effect and without."""

KINDS = ('effects', 'foreign', 'clean', 'pairs', *ON_FORCE_KINDS, *WHOLE_KINDS)

ON_WHOLE = tuple(name for name in LIBRARY if not any(name in core.covers for core in CORES.values()))
"""Effects that a device with all of its physics may have: the others are its physics."""

SCHEDULES = ('paper_step', 'out_and_back', 'surface_following')

FIRST_SEED = 1000
"""Of the report; 0 to 99 were used while developing."""

FIRST_WHOLE_SEED = 23000
"""Of the report on devices with all of their physics; 0 to 199 were used to develop, 5000 to 22999 were reported."""

VISIBLE = 1.15
"""Residual over the oracle's from which on somebody could see that something is wrong."""

PAIRS = tuple(
    tuple(pair) for pair in np.random.default_rng(0).permutation(list(itertools.combinations(LIBRARY, 2))).tolist()
)
"""All pairs in an order in which any run of them is mixed."""


class Job(NamedTuple):
    """One recording to be drawn and identified."""

    kind: str
    effects: tuple[str, ...]  # the kind of noise where the kind is 'clean'; none where it is 'clean_force'
    schedule: str
    seed: int


@dataclass(frozen=True)
class Row:
    """
    What came of one recording; errors are RMSEs over the oracle's on the same samples.

    Attributes
    ----------
    kind, effects, schedule, seed
        As in `Job`.
    verdict
        The loop's, 'refused' where the recording was not identified, 'not_drawn' where two effects exclude each other.
    named, alternatives
        The loop's.
    before, after
        Errors on the whole recording; before, of a device with all of its physics, with the physical core.
    before_test, after_test
        Errors on the test part, on the whole recording where there is none.
    tested
        Whether there is one.
    noise
        The loop's noise floor over the oracle's error.
    beside
        For each effect of a pair: the error of the model with only the other one.
    seconds
        That the identification took.
    strengths
        Of the effects.
    why
        Why it was refused.
    code, commit
        What measured it.

    """

    kind: str
    effects: tuple[str, ...]
    schedule: str
    seed: int
    verdict: str
    named: tuple[str, ...] = ()
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    before: float = math.nan
    after: float = math.nan
    before_test: float = math.nan
    after_test: float = math.nan
    tested: bool = False
    noise: float = math.nan
    beside: Mapping[str, float] = field(default_factory=dict)
    seconds: float = math.nan
    strengths: Mapping[str, float] = field(default_factory=dict)
    why: str = ''
    code: str = ''
    commit: str = ''

    @property
    def job(self) -> Job:
        return Job(self.kind, self.effects, self.schedule, self.seed)

    @property
    def visible(self) -> bool:
        """Whether anybody could have seen that something is wrong; one that is refused is held against the loop."""
        return not self.before <= VISIBLE

    @property
    def both_visible(self) -> bool:
        """Whether each effect of a pair shows beside the other."""
        return not any(error <= VISIBLE for error in self.beside.values())


_DRAWN: Mapping[str, Iterable[str]] = {'foreign': FOREIGN, 'clean': NOISES, 'force': ON_FORCE, 'whole': ON_WHOLE}


def jobs_of(
    kinds: Sequence[str],
    schedules: Sequence[str],
    seeds: Callable[[str, str], range],
    effects: Sequence[str] | None = None,
) -> list[Job]:
    """Return the recordings of a run, mixed, so that a run that is stopped has some of each."""
    jobs = []
    for kind, schedule in itertools.product(kinds, schedules):
        for seed in seeds(kind, schedule):
            if kind == 'pairs':
                subjects: list[tuple[str, ...]] = [PAIRS[seed % len(PAIRS)]]
            else:
                names = _DRAWN.get(kind, LIBRARY)
                subjects = [()] if kind in ('clean_force', 'healthy_whole') else [(name,) for name in names]
            jobs += [Job(kind, subject, schedule, seed) for subject in subjects]
    if effects is not None:
        jobs = [job for job in jobs if set(job.effects) <= set(effects)]
    return sorted(jobs, key=lambda job: job.seed)


def measure(job: Job) -> Row:
    """Draw a recording and identify it."""
    try:
        if job.kind == 'clean':
            drawn = draw_textbook(job.schedule, job.seed, job.effects[0])
        else:
            drawn = draw(job.effects, job.schedule, job.seed, make=make_of(job.kind, job.seed))
    except InputError as error:
        return Row(*job, verdict='not_drawn', why=str(error))
    try:
        return _identified(job, drawn)
    except Exception as error:  # counted as a failure: one recording must not end the run
        return Row(*job, verdict='refused', why=f'{type(error).__name__}: {error}')


def make_of(kind: str, seed: int) -> str | None:
    """Return the make that a device with all of its physics is of, None for one of the paper's law."""
    return list(MAKES)[seed % len(MAKES)] if kind in WHOLE_KINDS else None


def cylinder_a_of(drawn: Draw) -> Recording:
    """Return cylinder A of a draw, as a user would hand it in."""
    whole = recording_of(drawn.recording)
    return replace(whole, cylinders={CYLINDER: whole.cylinders[CYLINDER]}, force=None)


def _identified(job: Job, drawn: Draw) -> Row:
    """Return the answer; residuals stand beside what the oracle has left."""
    if job.kind in ON_FORCE_KINDS:
        recording, left, channel = recording_of(drawn.recording), force_oracle_residual(drawn), 'force'
        options = Options(close_loop=True, area=Cylinder().area)
    else:
        recording, left, channel = cylinder_a_of(drawn), oracle_residual(drawn), CYLINDER
        options = Options(close_loop=True)
    began = time.perf_counter()
    identification = identify([recording], options)
    result = identification.channels[channel]
    seconds = time.perf_counter() - began
    found, conclusion = result.found, result.findings
    (experiment,) = result.experiments
    healthy = with_core(result.fit) if job.kind in WHOLE_KINDS else result.fit
    before, after = (experiment.measured - one.simulated[0] for one in (healthy, found))
    of_oracle = identification.splits[0].part_of(recording.displacement.times)
    test, oracles_test = experiment.part == PARTS.index('test'), of_oracle == PARTS.index('test')
    tested = bool(np.any(test))
    if not tested:
        test[:], oracles_test[:] = True, True
    floor, floor_test = rms(left), rms(left[oracles_test])
    return Row(
        *job,
        verdict=conclusion.verdict,
        named=conclusion.effects,
        alternatives={name: tuple(others) for name, others in conclusion.alternatives.items() if others},
        before=rms(before) / floor,
        after=rms(after) / floor,
        before_test=rms(before[test]) / floor_test,
        after_test=rms(after[test]) / floor_test,
        tested=tested,
        noise=conclusion.noise.std / floor,
        strengths=drawn.truth.strengths,
        beside=_beside(job.effects, result.fit, found, floor) if job.kind == 'pairs' else {},
        seconds=seconds,
    )


def _beside(pair: Sequence[str], baseline: Fit, found: Fit, floor: float) -> dict[str, float]:
    """Return for each effect of a pair what the model with only the other one, fitted from many starts, leaves."""
    likelihood, begin = baseline.likelihood, baseline.model
    channel, experiments = likelihood.channel, likelihood.experiments
    data = channel.data(experiments, begin, baseline.simulated)
    measured = np.concatenate([one.measured for one in experiments])
    errors = {}
    for effect, other in zip(pair, reversed(pair)):
        starts = [replace(begin, effects={other: start}) for start in channel.effects[other].starts(data)]
        if other in found.model.effects:
            starts.append(replace(found.model, effects={other: found.model.effects[other]}))
        models = [find_optimum(likelihood, start, 1e-5, 20).model for start in starts]
        errors[effect] = min(rms(measured - np.concatenate(likelihood.simulate(one))) / floor for one in models)
    return errors


def read_rows(path: Path, code: str | None) -> dict[Job, Row]:
    """Return the rows of a file that some version of the program measured, of any where it is None."""
    rows = map(_row, path.read_text(encoding='utf-8').splitlines()) if path.exists() else ()
    return {row.job: row for row in rows if row is not None and code in (None, row.code)}


def _row(line: str) -> Row | None:
    """Return a row; None where the line was cut off or the rows had other fields then."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    if not isinstance(found, dict) or found.keys() != {one.name for one in fields(Row)}:
        return None
    for name in ('effects', 'named'):
        found[name] = tuple(found[name])
    found['alternatives'] = {name: tuple(others) for name, others in found['alternatives'].items()}
    return Row(**found)


def run(jobs: Sequence[Job], path: Path, code: str, processes: int) -> None:
    """Measure and append a row for each recording, in processes of one thread each; in this one where there are 0."""
    path.parent.mkdir(parents=True, exist_ok=True)
    here = commit()
    with path.open('a', encoding='utf-8') as stream:
        for row in side_by_side(measure, jobs, 'recordings', processes):
            stream.write(json.dumps({**asdict(row), 'code': code, 'commit': here}) + '\n')
            stream.flush()
