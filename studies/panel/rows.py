# SPDX-License-Identifier: Apache-2.0
"""
Draw and identify the panel's recordings, and write a row of results for each.

The identification does not see the fault of the device. A stopped run continues from its file of rows. Rows of other
versions of the program are measured again.
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
    ON_COMMAND,
    ON_FORCE,
    WEAK_ON_COMMAND,
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
"""Devices with full physics, with an effect and healthy."""

COMMAND_KINDS = ('command', 'weak_command')
"""Set-points that act late; strengths of the second kind are in the range `WEAK_ON_COMMAND`."""

KINDS = ('effects', 'foreign', 'clean', 'pairs', *ON_FORCE_KINDS, *WHOLE_KINDS, *COMMAND_KINDS)

ON_WHOLE = tuple(name for name in LIBRARY if not any(name in core.covers for core in CORES.values()))
"""Effects that are not part of the full physics."""

SCHEDULES = ('paper_step', 'out_and_back', 'surface_following')

WITHOUT_SETPOINT_STEPS = ('paper_step',)
"""Schedules that cannot show a set-point that acts late."""

FIRST_SEED = 1000
"""First seed of the report; 0 to 99 were used for development."""

FIRST_WHOLE_SEED = 23000
"""First seed of the report on full physics; 0 to 199 were used for development, 5000 to 22999 reported before."""

VISIBLE = 1.15
"""Ratio of the error before to the oracle's error from which an effect is visible [-]."""

PAIRS = tuple(
    tuple(pair) for pair in np.random.default_rng(0).permutation(list(itertools.combinations(LIBRARY, 2))).tolist()
)
"""All pairs of effects, in random order."""


class Job(NamedTuple):
    """A recording to draw and identify."""

    kind: str
    effects: tuple[str, ...]  # the kind of noise if the kind is 'clean'; empty if it is 'clean_force'
    schedule: str
    seed: int


@dataclass(frozen=True)
class Row:
    """
    Results of a recording; errors are RMSEs divided by the oracle's RMSE on the same samples.

    Attributes
    ----------
    kind, effects, schedule, seed
        As in `Job`.
    verdict
        Verdict of the loop; 'refused' if the identification failed; 'not_drawn' if two effects exclude each other.
    named, alternatives
        Effects that the loop named, and the alternatives to each.
    not_visible
        Effects that the loop listed as not visible.
    before, after
        Errors on the whole recording. `before` is the error of the physical core for devices with full physics.
    before_test, after_test
        Errors on the test part, or on the whole recording if there is no test part.
    tested
        Whether there is a test part.
    noise
        Noise floor of the loop divided by the oracle's error.
    errors_without
        For each effect of a pair: the error of the model without the effect, refitted.
    seconds
        Duration of the identification.
    strengths
        Strengths of the effects.
    why
        Reason of a verdict 'refused' or 'not_drawn'.
    code, commit
        Version of the program that measured the row.

    """

    kind: str
    effects: tuple[str, ...]
    schedule: str
    seed: int
    verdict: str
    named: tuple[str, ...] = ()
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    not_visible: tuple[str, ...] = ()
    before: float = math.nan
    after: float = math.nan
    before_test: float = math.nan
    after_test: float = math.nan
    tested: bool = False
    noise: float = math.nan
    errors_without: Mapping[str, float] = field(default_factory=dict)
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
        """Whether the effect is visible; a refused recording counts as visible."""
        return not self.before <= VISIBLE

    @property
    def both_visible(self) -> bool:
        """Whether each effect of a pair is visible next to the other."""
        return not any(error <= VISIBLE for error in self.errors_without.values())


_EFFECTS_OF_KIND: Mapping[str, Iterable[str]] = {
    'foreign': FOREIGN,
    'clean': NOISES,
    'force': ON_FORCE,
    'whole': ON_WHOLE,
}


def jobs_of(
    kinds: Sequence[str],
    schedules: Sequence[str],
    seeds: Callable[[str, str], range],
    effects: Sequence[str] | None = None,
) -> list[Job]:
    """Return the recordings of a run by seed, so that a stopped run has recordings of each kind."""
    jobs = []
    for kind, schedule in itertools.product(kinds, schedules):
        if kind in COMMAND_KINDS and schedule in WITHOUT_SETPOINT_STEPS:
            continue
        for seed in seeds(kind, schedule):
            if kind == 'pairs':
                subjects: list[tuple[str, ...]] = [PAIRS[seed % len(PAIRS)]]
            elif kind in COMMAND_KINDS:
                subjects = [*((name,) for name in ON_COMMAND), tuple(ON_COMMAND)]
            else:
                names = _EFFECTS_OF_KIND.get(kind, LIBRARY)
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
            drawn = draw(
                job.effects,
                job.schedule,
                job.seed,
                given=given_strengths(job.kind, job.effects, job.seed),
                make=make_of(job.kind, job.seed),
            )
    except InputError as error:
        return Row(*job, verdict='not_drawn', why=str(error))
    try:
        return _identify(job, drawn)
    except Exception as error:  # counted as a failure: a recording must not end the run
        return Row(*job, verdict='refused', why=f'{type(error).__name__}: {error}')


def make_of(kind: str, seed: int) -> str | None:
    """Return the make of a device with full physics; None if the device follows the paper's model."""
    return list(MAKES)[seed % len(MAKES)] if kind in WHOLE_KINDS else None


def given_strengths(kind: str, effects: Sequence[str], seed: int) -> dict[str, float]:
    """Return the strengths of weak effects, by name, evenly on a logarithmic scale; empty for all other kinds."""
    if kind != 'weak_command':
        return {}
    weakest, strongest = WEAK_ON_COMMAND
    shares = {name: np.random.default_rng([seed, *name.encode(), 1]).random() for name in effects}
    return {name: float(weakest * (strongest / weakest) ** share) for name, share in shares.items()}


def cylinder_a_of(drawn: Draw) -> Recording:
    """Return the recording of cylinder A alone."""
    whole = recording_of(drawn.recording)
    return replace(whole, cylinders={CYLINDER: whole.cylinders[CYLINDER]}, force=None)


def _identify(job: Job, drawn: Draw) -> Row:
    """Return the row of an identification; its errors are relative to the oracle's."""
    if job.kind in ON_FORCE_KINDS:
        recording, oracle_error, channel = recording_of(drawn.recording), force_oracle_residual(drawn), 'force'
        options = Options(close_loop=True, area=Cylinder().area)
    else:
        recording, oracle_error, channel = cylinder_a_of(drawn), oracle_residual(drawn), CYLINDER
        options = Options(close_loop=True)
    began = time.perf_counter()
    identification = identify([recording], options)
    result = identification.channels[channel]
    seconds = time.perf_counter() - began
    found, conclusion = result.found, result.findings
    (experiment,) = result.experiments
    healthy = with_core(result.fit) if job.kind in WHOLE_KINDS else result.fit
    before, after = (experiment.measured - fit.simulated[0] for fit in (healthy, found))
    of_oracle = identification.splits[0].part_of(recording.displacement.times)
    test, oracles_test = experiment.part == PARTS.index('test'), of_oracle == PARTS.index('test')
    tested = bool(np.any(test))
    if not tested:
        test[:], oracles_test[:] = True, True
    floor, floor_test = rms(oracle_error), rms(oracle_error[oracles_test])
    return Row(
        *job,
        verdict=conclusion.verdict,
        named=conclusion.effects,
        alternatives={name: tuple(names) for name, names in conclusion.alternatives.items() if names},
        not_visible=conclusion.not_visible,
        before=rms(before) / floor,
        after=rms(after) / floor,
        before_test=rms(before[test]) / floor_test,
        after_test=rms(after[test]) / floor_test,
        tested=tested,
        noise=conclusion.noise.std / floor,
        strengths=drawn.truth.strengths,
        errors_without=_errors_without_each(job.effects, result.fit, found, floor) if job.kind == 'pairs' else {},
        seconds=seconds,
    )


def _errors_without_each(pair: Sequence[str], baseline: Fit, found: Fit, floor: float) -> dict[str, float]:
    """Return for each effect of a pair the error of the model without the effect, refitted from many starts."""
    likelihood, baseline_model = baseline.likelihood, baseline.model
    channel, experiments = likelihood.channel, likelihood.experiments
    data = channel.data(experiments, baseline_model, baseline.simulated)
    measured = np.concatenate([experiment.measured for experiment in experiments])
    errors = {}
    for effect, remaining in zip(pair, reversed(pair)):
        starts = [
            replace(baseline_model, effects={remaining: start}) for start in channel.effects[remaining].starts(data)
        ]
        if remaining in found.model.effects:
            starts.append(replace(found.model, effects={remaining: found.model.effects[remaining]}))
        models = [find_optimum(likelihood, start, 1e-5, 20).model for start in starts]
        errors[effect] = min(rms(measured - np.concatenate(likelihood.simulate(model))) / floor for model in models)
    return errors


def read_rows(path: Path, code: str | None) -> dict[Job, Row]:
    """Return the rows of a file that a version of the program measured; None: all rows."""
    rows = map(_row, path.read_text(encoding='utf-8').splitlines()) if path.exists() else ()
    return {row.job: row for row in rows if row is not None and code in (None, row.code)}


def _row(line: str) -> Row | None:
    """Return the row of a line; None if the line is incomplete or has different fields."""
    try:
        values = json.loads(line)
    except ValueError:
        return None
    if not isinstance(values, dict) or values.keys() != {field.name for field in fields(Row)}:
        return None
    for name in ('effects', 'named', 'not_visible'):
        values[name] = tuple(values[name])
    values['alternatives'] = {name: tuple(names) for name, names in values['alternatives'].items()}
    return Row(**values)


def run(jobs: Sequence[Job], path: Path, code: str, processes: int) -> None:
    """Measure recordings and append a row for each, in processes of one thread each; 0: in this process."""
    path.parent.mkdir(parents=True, exist_ok=True)
    current_commit = commit()
    with path.open('a', encoding='utf-8') as stream:
        for row in side_by_side(measure, jobs, 'recordings', processes):
            stream.write(json.dumps({**asdict(row), 'code': code, 'commit': current_commit}) + '\n')
            stream.flush()
