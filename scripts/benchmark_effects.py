"""
How often the loop names the effect that is in a recording: make benchmark-effects.

Recordings of the rig's panel (`cfd_pneumatic.rig.panel`) go through `identify` as a user's would; what is wrong with
the device is compared with the answer only afterwards. The document has the goals beside what was measured. Results are
kept in a file of rows, one for each recording, so that a run that was stopped goes on where it was; rows that other
versions of the program gave are measured again.
"""

from __future__ import annotations

import argparse
import ast
import collections
import hashlib
import itertools
import json
import math
import multiprocessing
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Fit, Options, identify
from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.extension import Extension, extend
from cfd_pneumatic.identification.loop import Closure, close_loop
from cfd_pneumatic.identification.split import PARTS
from cfd_pneumatic.identification.starts import starting_data
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS
from cfd_pneumatic.recording import CylinderSignals, Recording, Signal
from cfd_pneumatic.rig.panel import FOREIGN, LIBRARY, NOISES, Draw, draw, draw_textbook, oracle_residual

ROOT = Path(__file__).resolve().parents[1]
CYLINDER = 'cylinder_a'

KINDS = ('effects', 'foreign', 'leave_one_out', 'clean', 'pairs')
SCHEDULES = ('paper_step', 'out_and_back', 'surface_following')
FIRST_SEED = 1000
"""Of the report; 0 to 99 were used while developing."""

SEEDS = {
    'effects': (10, 10, 10),
    'foreign': (10, 10, 10),
    'leave_one_out': (5, 5, 5),
    'clean': (80, 80, 40),
    'pairs': (100, 100, 50),
}
"""How many by kind and schedule: for each effect or noise, or of pairs."""

QUICK_SEEDS = {
    'effects': (2, 2, 1),
    'foreign': (2, 2, 1),
    'leave_one_out': (1, 1, 0),
    'clean': (10, 5, 2),
    'pairs': (10, 10, 1),
}

VISIBLE = 1.15
"""Residual over the oracle's from which on somebody could see that something is wrong."""

FLOOR_TOLERANCE = 0.05

GROUPS = (
    (
        'delay / lag / regulator bandwidth',
        ('transport_delay', 'sensor_lag', 'displacement_lag', 'line_resonance', 'line_restriction', 'droop'),
    ),
    ('leakage / droop / set-point offset', ('leakage', 'positional_leakage', 'droop', 'set_point_drift')),
    ('dead volume / polytropic exponent', ('volume_variation', 'heat_transfer')),
    ('dead band / hysteresis / lost motion', ('valve_dead_band', 'valve_hysteresis', 'lost_motion')),
)
"""Effects that data may not separate, as the field notes list them: a tie among these is a right answer."""

PAIRS = tuple(
    tuple(pair) for pair in np.random.default_rng(0).permutation(list(itertools.combinations(LIBRARY, 2))).tolist()
)
"""All pairs in an order in which any run of them is mixed."""

NOTES = '## Notes'
"""What stands in the document from here on is written by hand, and kept."""


# what is measured


class Job(NamedTuple):
    """One recording to be drawn and identified."""

    kind: str
    effects: tuple[str, ...]  # the kind of noise where the kind is 'clean'
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
        Errors on the whole recording.
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
                subjects = [PAIRS[seed % len(PAIRS)]]
            else:
                names = {'foreign': FOREIGN, 'clean': NOISES}.get(kind, LIBRARY)
                subjects = [(name,) for name in names]
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
            drawn = draw(job.effects, job.schedule, job.seed)
    except InputError as error:
        return Row(*job, verdict='not_drawn', why=str(error))
    try:
        return _identified(job, drawn)
    except Exception as error:  # counted as a failure: one recording must not end the run
        return Row(*job, verdict='refused', why=f'{type(error).__name__}: {error}')


def recording_of(drawn: Draw) -> Recording:
    """Return cylinder A of a draw, as a user would hand it in."""
    got = drawn.recording
    setpoint = got.setpoints[:, 0]
    changes = np.diff(setpoint, prepend=np.nan) != 0.0
    begins = np.concatenate([got.times[:1], got.times[:-1]])  # an entry acts from the sample before
    cylinder = CylinderSignals(Signal(got.times, got.pressures[:, 0]), Signal(begins[changes], setpoint[changes]))
    return Recording('recording', 0, Signal(got.times, got.displacement), {CYLINDER: cylinder}, None, ())


def _identified(job: Job, drawn: Draw) -> Row:
    recording = recording_of(drawn)
    leaves_out = job.kind == 'leave_one_out'
    began = time.perf_counter()
    identification = identify([recording], Options(close_loop=not leaves_out))
    result = identification.cylinders[CYLINDER]
    closure = result.closure
    if closure is None:
        library = {name: effect for name, effect in PRESSURE_EFFECTS.items() if name not in job.effects}
        closure = close_loop(result.experiments, result.fit, AMBIENT_PRESSURE, library)
    seconds = time.perf_counter() - began

    (experiment,) = result.experiments
    left = oracle_residual(drawn)
    before, after = (experiment.pressure - one.simulated[0] for one in (result.fit, closure))
    test = experiment.part == PARTS.index('test')
    oracles_test = identification.splits[0].part_of(recording.displacement.times) == PARTS.index('test')
    tested = bool(np.any(test))
    if not tested:
        test[:], oracles_test[:] = True, True
    floor, floor_test = _rms(left), _rms(left[oracles_test])
    return Row(
        *job,
        verdict=closure.verdict,
        named=closure.effects,
        alternatives={name: tuple(others) for name, others in closure.alternatives.items() if others},
        before=_rms(before) / floor,
        after=_rms(after) / floor,
        before_test=_rms(before[test]) / floor_test,
        after_test=_rms(after[test]) / floor_test,
        tested=tested,
        noise=closure.noise.std / floor,
        beside=_beside(job.effects, result.experiments, result.fit, closure, floor) if job.kind == 'pairs' else {},
        seconds=seconds,
        strengths=drawn.truth.strengths,
    )


def _beside(
    pair: Sequence[str], experiments: Sequence[Experiment], baseline: Fit, closure: Closure, floor: float
) -> dict[str, float]:
    """Return for each effect of a pair what the model with only the other one, fitted from many starts, leaves."""
    masks = [one.part < PARTS.index('test') for one in experiments]
    begin = Extension(baseline.gains, {}, baseline.offsets, baseline.starts)
    data = starting_data(experiments, begin, baseline.simulated, AMBIENT_PRESSURE)
    errors = {}
    for effect, other in zip(pair, reversed(pair)):
        starts = [(begin, start) for start in PRESSURE_EFFECTS[other].starts(data)]
        if other in closure.effects:
            starts.append((closure.extension, closure.extension.effects[other]))
        models = [
            extend(experiments, masks, AMBIENT_PRESSURE, one, {other: start}, tolerance=1e-5, evaluations=20)
            for one, start in starts
        ]
        errors[effect] = min(
            _rms(np.concatenate([one.pressure for one in experiments]) - np.concatenate(simulated)) / floor
            for simulated in (model.simulate(experiments, AMBIENT_PRESSURE) for model in models)
        )
    return errors


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# rows on disk


def code_version() -> str:
    """Return a fingerprint of the program text, comments and docstrings apart, that the results depend on."""
    digest = hashlib.sha256()
    package = ROOT / 'cfd_pneumatic'
    folders = (package / name for name in ('identification', 'model', 'recording', 'rig'))
    for path in sorted([*package.glob('*.py'), *itertools.chain.from_iterable(one.rglob('*.py') for one in folders)]):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            body = getattr(node, 'body', None)
            if isinstance(body, list):  # a string that stands alone is a docstring
                node.body = [one for one in body if not _is_text(one)]
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:12]


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def commit() -> str:
    """Return the commit that is checked out, and whether files differ from it."""
    try:
        head = subprocess.check_output(['git', 'rev-parse', '--short', 'HEAD'], cwd=ROOT, text=True).strip()
        changed = subprocess.check_output(['git', 'status', '--porcelain', 'cfd_pneumatic'], cwd=ROOT, text=True)
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'
    return f'{head} with changes' if changed.strip() else head


def read_rows(path: Path, code: str | None) -> dict[Job, Row]:
    """Return the rows of a file that some version of the program measured, of any where it is None."""
    rows = {}
    if path.exists():
        for line in path.read_text(encoding='utf-8').splitlines():
            row = _row(line)
            if row is not None and code in (None, row.code):
                rows[row.job] = row
    return rows


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
    from rich.progress import track

    path.parent.mkdir(parents=True, exist_ok=True)
    here = commit()
    with path.open('a', encoding='utf-8') as stream:
        for row in track(_measured(jobs, processes), description='recordings', total=len(jobs)):
            stream.write(json.dumps({**asdict(row), 'code': code, 'commit': here}) + '\n')
            stream.flush()


def _measured(jobs: Sequence[Job], processes: int) -> Iterator[Row]:
    if processes == 0:
        yield from map(measure, jobs)
        return
    for library in ('OMP', 'OPENBLAS', 'MKL', 'NUMBA'):
        os.environ[f'{library}_NUM_THREADS'] = '1'  # read by the new processes
    with ProcessPoolExecutor(processes, multiprocessing.get_context('spawn')) as pool:
        try:
            for done in as_completed([pool.submit(measure, job) for job in jobs]):
                yield done.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


# how answers count


def listed(one: str, other: str) -> bool:
    """Return whether the field notes list two effects as a pair that data may not separate."""
    return any(one in names and other in names for _, names in GROUPS)


ANSWERS = ('right', 'listed alternative', 'unlisted alternative', 'wrong name', 'no name')
RIGHT = ANSWERS[:2]
"""Answers that the goals count as right."""


def answer(row: Row) -> str:
    """Return how the first name answers for a recording with one effect."""
    (true,) = row.effects
    if not row.named:
        return 'no name'
    first = row.named[0]
    if first == true:
        return 'right'
    if true in row.alternatives.get(first, ()):
        return 'listed alternative' if listed(first, true) else 'unlisted alternative'
    return 'wrong name'


def found_both(row: Row, alternatives: bool = False) -> bool:
    """Return whether both effects of a pair are named; alternatives of listed pairs count where that is asked for."""
    return any(
        all(
            name == true or (alternatives and listed(name, true) and true in row.alternatives.get(name, ()))
            for name, true in zip(names, row.effects)
        )
        for names in itertools.permutations(row.named, len(row.effects))
    )


class Share(NamedTuple):
    """A share with its 95 % interval (Wilson, 1927)."""

    count: int
    total: int

    @property
    def value(self) -> float:
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        if not self.total:
            return math.nan, math.nan
        z2 = 1.959964**2
        centre = (self.count + 0.5 * z2) / (self.total + z2)
        half = math.sqrt(z2 * (self.count * (1.0 - self.value) + 0.25 * z2)) / (self.total + z2)
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        if not self.total:
            return '-'
        low, high = self.interval
        return f'{100 * self.value:.1f} % ({self.count}/{self.total}; {100 * low:.0f} to {100 * high:.0f})'


def share(rows: Iterable[Row], passes: Callable[[Row], bool]) -> Share:
    """Return the share of rows that pass."""
    passed = [passes(row) for row in rows]
    return Share(sum(passed), len(passed))


# the document


class Goal(NamedTuple):
    """A goal of the issue beside what was measured."""

    what: str
    wanted: str
    measured: str
    recordings: int
    met: bool


def goals(rows: Sequence[Row]) -> list[Goal]:
    """Return the goals that these rows can tell of."""
    singles = [row for row in rows if row.kind == 'effects' and row.visible]
    found = []

    def at_least(what: str, least: float, some: Sequence[Row], passes: Callable[[Row], bool]) -> None:
        if some:
            part = share(some, passes)
            found.append(Goal(what, f'at least {100 * least:.0f} %', str(part), part.total, part.value >= least))

    for schedule in SCHEDULES:
        at_least(
            f'right name first, or a listed alternative; visible draws, `{schedule}`',
            0.90 if schedule == 'paper_step' else 0.95,
            [row for row in singles if row.schedule == schedule],
            lambda row: answer(row) in RIGHT,
        )
    errors = [row.after_test for row in singles if math.isfinite(row.after_test)]
    if errors:
        for name, quantile, most in (('median', 0.5, 1.03), ('90th percentile', 0.9, 1.10)):
            value = float(np.quantile(errors, quantile))
            what = f"test error after (a step's: whole) over the oracle floor, {name}; visible draws"
            found.append(Goal(what, f'at most {most:.2f}', f'{value:.3f}', len(errors), value <= most))
    floors = [row for row in rows if row.kind == 'effects' and math.isfinite(row.noise)]
    if floors:
        value = float(np.median([row.noise for row in floors]))
        near = share(floors, lambda row: abs(row.noise - 1.0) <= FLOOR_TOLERANCE)
        found.append(
            Goal(
                "the report's noise floor over the oracle's; all draws with one effect",
                'within 5 %',
                f'median {value:.3f}; {near} of the draws within 5 %',
                len(floors),
                abs(value - 1.0) <= FLOOR_TOLERANCE,
            )
        )
    for noise in NOISES:
        some = [row for row in rows if row.kind == 'clean' and row.effects == (noise,)]
        if some:
            part = share(some, lambda row: bool(row.named))
            what = f'clean textbook recordings, {noise} noise: a name'
            found.append(Goal(what, 'at most 2 %', str(part), part.total, part.value <= 0.02))
    for kind, what, least in (
        ('foreign', 'effects outside the library: `unexplained`; visible draws', 0.90),
        ('leave_one_out', 'leave-one-out: `unexplained`; visible draws', 0.80),
    ):
        some = [row for row in rows if row.kind == kind and row.visible]
        at_least(what, least, some, lambda row: row.verdict == 'unexplained')
    pairs = [row for row in rows if row.kind == 'pairs' and row.both_visible]
    at_least('two effects: both found; pairs that show beside each other', 0.85, pairs, found_both)
    at_least(
        'two effects: exactly the two; the same pairs',
        0.75,
        pairs,
        lambda row: len(row.named) == 2 and found_both(row),
    )
    return found


def document(rows: Sequence[Row], how: Mapping[str, str], picture: str | None, notes: str) -> str:
    """Return the document in Markdown."""
    drawn = [row for row in rows if row.verdict != 'not_drawn']
    sections = [
        '# The panel of effects\n\n'
        'How often the loop names the effect that is in a recording which it knows nothing else of. Written by '
        f'`{how["command"]}`; what stands under "{NOTES.strip("# ")}" at the end is kept.',
        _how_section(rows, drawn, how),
        _goals_section(drawn),
    ]
    if picture is not None and any(row.kind in ('effects', 'foreign') for row in drawn):
        sections.append(f'![confusion matrices]({picture})')
    for schedule in SCHEDULES:
        sections += _confusion_section([row for row in drawn if row.schedule == schedule], schedule)
    sections += [
        *_unknown_section([row for row in drawn if row.kind == 'foreign'], 'foreign', 'Effects outside the library'),
        *_unknown_section(
            [row for row in drawn if row.kind == 'leave_one_out'], 'leave_one_out', 'The true effect not in the library'
        ),
        *_clean_section([row for row in drawn if row.kind == 'clean']),
        *_pairs_section([row for row in drawn if row.kind == 'pairs']),
        _errors_section(drawn),
        _listed_section(),
        *_refused_section(drawn),
        notes or NOTES,
    ]
    return '\n\n'.join(sections).rstrip() + '\n'


def table(header: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    rows = [header, ['---'] * len(header), *lines]
    return '\n'.join('| ' + ' | '.join(str(cell) for cell in row) + ' |' for row in rows)


def _how_section(rows: Sequence[Row], drawn: Sequence[Row], how: Mapping[str, str]) -> str:
    lines = []
    for kind in KINDS:
        some = [row for row in drawn if row.kind == kind]
        if some:
            counts = collections.Counter(row.schedule for row in some)
            seeds = [row.seed for row in some]
            lines.append([f'`{kind}`', f'{min(seeds)} to {max(seeds)}', *(counts[one] for one in SCHEDULES), len(some)])
    versions = collections.Counter((row.commit, row.code) for row in drawn)
    measured_by = '; '.join(
        f'commit {name} (program text {code}): {count} recordings' for (name, code), count in versions.items()
    )
    left_out = sum(row.verdict == 'not_drawn' for row in rows)
    excluded = (
        f' {left_out} pairs whose effects are one and the same part of the rig were left out.' if left_out else ''
    )
    return (
        '## How it was measured\n\n'
        f'- Command: `{how["command"]}`\n'
        f'- Machine: {how["machine"]}\n'
        f'- Measured by {measured_by or "nothing yet"}\n'
        f'- {len(drawn)} recordings.{excluded}\n\n'
        + table(['kind', 'seeds', *(f'`{one}`' for one in SCHEDULES), 'recordings'], lines)
        + '\n\nThe seed draws the device, the schedule, the strength and the noise; seeds below '
        f'{FIRST_SEED} were used while developing. The *oracle floor* is the RMSE that the true device, driven by the '
        "measured displacement, leaves on the same samples. A draw is *visible* where the paper's model, refitted, "
        f'leaves more than {VISIBLE} of it. Shares have 95 % intervals (Wilson).'
    )


def _goals_section(rows: Sequence[Row]) -> str:
    lines = [
        [goal.what, goal.wanted, goal.measured, goal.recordings, 'yes' if goal.met else '**no**']
        for goal in goals(rows)
    ]
    return '## Goals\n\n' + table(['goal', 'wanted', 'measured', 'recordings', 'met'], lines)


def _confusion_section(rows: Sequence[Row], schedule: str) -> list[str]:
    lines = []
    for effect in LIBRARY:
        some = [row for row in rows if row.kind == 'effects' and row.effects == (effect,)]
        if some:
            lines.append(_confusion_line(f'`{effect}`', some))
    every = [row for row in rows if row.kind == 'effects']
    if not every:
        return []
    lines.append(_confusion_line('**all**', every))
    header = ['effect', 'draws', 'nobody could see', 'visible']
    header += ['right', 'listed alternative', 'other', 'no name', 'named instead']
    header += ['more than the one', '`unexplained` beside a name', 'before', 'after']
    return [
        f'## `{schedule}`: effect by answer\n\n'
        'By the first name among visible draws. *Nobody could see*: draws of which no method could tell, and the names '
        'that some got all the same. *Listed alternative*: the effect is named as one of those that the recording '
        "can't tell from the first name, and the pair is listed below. *No name*: none missing / `unexplained` / "
        'refused. *Before* and *after*: RMSE on the test part over the oracle floor, median / 90th '
        'percentile of visible draws.\n\n' + table(header, lines)
    ]


def _confusion_line(label: str, rows: Sequence[Row]) -> list[object]:
    hidden = [row for row in rows if not row.visible]
    seen = [row for row in rows if row.visible]
    answers = collections.Counter(answer(row) for row in seen)
    silent = collections.Counter(row.verdict for row in seen if not row.named)
    others = [row for row in seen if answer(row) in ('unlisted alternative', 'wrong name')]
    false = [row for row in hidden if answer(row) not in (*RIGHT, 'no name')]
    named = [row for row in seen if row.named]
    return [
        label,
        len(rows),
        str(len(hidden)) + (f' ({_names(false)})' if false else ''),
        len(seen),
        answers['right'],
        answers['listed alternative'],
        len(others),
        ' / '.join(str(silent[verdict]) for verdict in ('no_missing_effect', 'unexplained', 'refused')),
        _names(others),
        sum(len(row.named) > 1 for row in named),
        sum(row.verdict == 'unexplained' for row in named),
        _spread(row.before_test for row in seen),
        _spread(row.after_test for row in seen),
    ]


def _names(rows: Iterable[Row]) -> str:
    counts = collections.Counter(row.named[0] for row in rows)
    return ', '.join(f'{name} {count}' for name, count in counts.most_common())


def _spread(values: Iterable[float]) -> str:
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return '-'
    return f'{np.median(finite):.2f} / {np.quantile(finite, 0.9):.2f}'


def _unknown_section(rows: Sequence[Row], kind: str, title: str) -> list[str]:
    """Return how recordings were answered whose effect the library doesn't have."""
    if not rows:
        return []
    lines = []
    for schedule, name in itertools.product(SCHEDULES, FOREIGN if kind == 'foreign' else LIBRARY):
        some = [row for row in rows if row.schedule == schedule and row.effects == (name,)]
        if some:
            lines.append(_unknown_line([f'`{schedule}`', f'`{name}`'], some))
    for schedule in SCHEDULES:
        some = [row for row in rows if row.schedule == schedule]
        if some:
            lines.append(_unknown_line([f'`{schedule}`', '**all**'], some))
    lines.append(_unknown_line(['all', '**all**'], rows))
    header = ['schedule', 'effect', 'draws', 'nobody could see', 'visible', 'unexplained', 'share']
    header += ['of these beside a name', 'none missing', 'named', 'of these a listed rival', 'after']
    return [
        f'## {title}\n\nThe right answer is `unexplained`. *Named*: `effect_added`, among visible draws; a *listed '
        'rival* is one that the field notes say data may not separate from the true one.\n\n' + table(header, lines)
    ]


def _unknown_line(label: Sequence[str], rows: Sequence[Row]) -> list[object]:
    seen = [row for row in rows if row.visible]
    added = [row for row in seen if row.verdict == 'effect_added']
    unexplained = share(seen, lambda row: row.verdict == 'unexplained')
    return [
        *label,
        len(rows),
        len(rows) - len(seen),
        len(seen),
        unexplained.count,
        unexplained,
        sum(row.verdict == 'unexplained' and bool(row.named) for row in seen),
        sum(row.verdict == 'no_missing_effect' for row in seen),
        f'{len(added)}' + (f': {_names(added)}' if added else ''),
        sum(listed(row.named[0], row.effects[0]) for row in added),
        _spread(row.after_test for row in seen),
    ]


def _clean_section(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    lines = []
    for noise, schedule in itertools.product(NOISES, (*SCHEDULES, None)):
        some = [row for row in rows if row.effects == (noise,) and schedule in (None, row.schedule)]
        if some:
            named = [row for row in some if row.named]
            lines.append(
                [
                    noise,
                    f'`{schedule}`' if schedule else '**all**',
                    len(some),
                    len(named),
                    share(some, lambda row: bool(row.named)),
                    _names(named),
                    sum(row.verdict == 'unexplained' for row in some),
                    _spread(row.after_test for row in some),
                ]
            )
    header = [
        'noise',
        'schedule',
        'recordings',
        'with a name',
        'share',
        'names',
        '`unexplained`',
        'error over the floor',
    ]
    return [
        "## Nothing missing\n\nThe paper's model itself, integrated apart, with white noise, with noise that remembers "
        '(AR 0.9), and with little beside the steps of the converter.\n\n' + table(header, lines)
    ]


def _pairs_section(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    lines = []
    for schedule in (*SCHEDULES, None):
        some = [row for row in rows if schedule in (None, row.schedule)]
        seen = [row for row in some if row.both_visible]
        if some:
            lines.append(
                [
                    f'`{schedule}`' if schedule else '**all**',
                    len(some),
                    len(seen),
                    share(seen, found_both),
                    share(seen, lambda row: len(row.named) == 2 and found_both(row)),
                    share(seen, lambda row: found_both(row, alternatives=True)),
                    share(seen, lambda row: len(row.named) == 2 and found_both(row, alternatives=True)),
                    share(seen, lambda row: row.verdict == 'unexplained'),
                    _spread(row.after_test for row in seen),
                ]
            )
    missed = [row for row in rows if row.both_visible and not found_both(row)]
    details = [
        [
            f'`{row.schedule}`',
            row.seed,
            ' + '.join(row.effects),
            ' / '.join(f'{row.beside[name]:.2f}' if name in row.beside else '-' for name in row.effects),
            ' + '.join(_with_alternatives(row)) or row.verdict,
            f'{row.after_test:.2f}',
        ]
        for row in sorted(missed, key=lambda row: (SCHEDULES.index(row.schedule), row.seed))
    ]
    header = ['schedule', 'recordings', 'both show', 'both found', 'exactly the two']
    header += ['both, listed alternatives too', 'exactly, listed alternatives too', '`unexplained`', 'after']
    text = (
        '## Two effects at once\n\nCounted where each effect shows beside the other: the model with only one of them, '
        f'refitted, leaves more than {VISIBLE} of the oracle floor.\n\n' + table(header, lines)
    )
    if details:
        shown = table(['schedule', 'seed', 'effects', 'each shows', 'named', 'after'], details)
        text += f'\n\nPairs of which not both were found:\n\n{shown}'
    return [text]


def _with_alternatives(row: Row) -> list[str]:
    return [
        name + (f' (or {", ".join(row.alternatives[name])})' if row.alternatives.get(name) else '')
        for name in row.named
    ]


def _errors_section(rows: Sequence[Row]) -> str:
    lines = []
    for kind, schedule in itertools.product(KINDS, SCHEDULES):
        some = [row for row in rows if row.kind == kind and row.schedule == schedule and math.isfinite(row.after)]
        seen = [row for row in some if row.visible or kind == 'clean']
        if some:
            lines.append(
                [
                    f'`{kind}`',
                    f'`{schedule}`',
                    len(some),
                    _spread(row.before_test for row in seen),
                    _spread(row.after_test for row in seen),
                    'test part' if any(row.tested for row in some) else 'whole recording',
                    ' / '.join(f'{np.quantile([row.noise for row in some], one):.3f}' for one in (0.05, 0.5, 0.95)),
                    share(some, lambda row: abs(row.noise - 1.0) <= FLOOR_TOLERANCE),
                    ' / '.join(f'{np.quantile([row.seconds for row in some], one):.1f}' for one in (0.5, 0.9)),
                ]
            )
    header = ['kind', 'schedule', 'recordings', 'before', 'after', 'on', "noise floor over the oracle's", 'within 5 %']
    header.append('time [s]')
    return (
        '## Errors, noise floor, time\n\n'
        '*Before* and *after* over the oracle floor, median / 90th percentile of visible draws, of all where nothing '
        'is missing. A single step has no test part. The noise floor as quantiles 5 %, 50 %, 95 %; the time of an '
        'identification in one process with one thread, median / 90th percentile.\n\n' + table(header, lines)
    )


def _listed_section() -> str:
    lines = [[title, ', '.join(f'`{name}`' for name in names)] for title, names in GROUPS]
    return (
        '## Listed pairs\n\nEffects that data may not separate. Only among these an alternative counts as right.\n\n'
        + table(['family', 'effects'], lines)
    )


def _refused_section(rows: Sequence[Row]) -> list[str]:
    refused = [row for row in rows if row.verdict == 'refused']
    if not refused:
        return []
    lines = [[f'`{row.kind}`', ' + '.join(row.effects), f'`{row.schedule}`', row.seed, row.why] for row in refused]
    return [
        '## Refused\n\nRecordings that were not identified; they count as visible and as answered without a name.\n\n'
        + table(['kind', 'effect', 'schedule', 'seed', 'why'], lines)
    ]


def picture_of(rows: Sequence[Row]) -> str | None:
    """Return the confusion matrices of visible draws as SVG, a panel for each schedule; None where there are none."""
    import io

    import matplotlib
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.kind in ('effects', 'foreign') and row.visible]
    if not shown:
        return None
    truths = [name for name in (*LIBRARY, *FOREIGN) if any(row.effects == (name,) for row in shown)]
    names = [*LIBRARY, 'none missing', 'unexplained', 'refused']
    schedules = [one for one in SCHEDULES if any(row.schedule == one for row in shown)]
    with matplotlib.rc_context({'svg.hashsalt': 'panel', 'svg.fonttype': 'none', 'font.size': 8.0}):
        figure = Figure(figsize=(8.5, (1.8 + 0.24 * len(truths)) * len(schedules)), layout='constrained')
        for axes, schedule in zip(figure.subplots(len(schedules), squeeze=False)[:, 0], schedules):
            counts = np.zeros((len(truths), len(names)))
            for row in shown:
                if row.schedule == schedule:
                    counts[truths.index(row.effects[0]), names.index(_said(row))] += 1
            shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
            axes.imshow(shares, cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto')
            for (line, column), count in np.ndenumerate(counts):
                if count:
                    colour = 'white' if shares[line, column] > 0.6 else 'black'
                    axes.text(column, line, f'{count:.0f}', ha='center', va='center', color=colour)
            axes.set_xticks(range(len(names)), names, rotation=60, ha='right', rotation_mode='anchor')
            axes.set_yticks(range(len(truths)), truths)
            axes.set_title(f'{schedule}: effect in the recording (rows) by first name (columns), visible draws')
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def _said(row: Row) -> str:
    """Return the column that a row belongs to."""
    if row.named:
        return row.named[0]
    return {'no_missing_effect': 'none missing', 'unexplained': 'unexplained'}.get(row.verdict, 'refused')


def notes_in(path: Path) -> str:
    """Return what was written by hand at the end of a document."""
    if not path.exists():
        return ''
    _, found, notes = path.read_text(encoding='utf-8').partition(f'\n{NOTES}\n')
    return f'{NOTES}\n{notes.rstrip()}' if found else ''


def machine() -> str:
    """Return what this machine is."""
    model = platform.processor() or platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        names = [line.partition(':')[2].strip() for line in info.read_text().splitlines() if 'model name' in line]
        model = names[0] if names else model
    memory = os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30
    return (
        f'{model}, {os.cpu_count()} cores, {memory:.0f} GiB of memory; '
        f'Python {platform.python_version()}, NumPy {np.__version__}'
    )


# the program


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the panel, write the document; return the exit code."""
    options = _parsed(arguments)
    sizes = QUICK_SEEDS if options.quick else SEEDS

    def seeds(kind: str, schedule: str) -> range:
        return options.seeds or range(FIRST_SEED, FIRST_SEED + sizes[kind][SCHEDULES.index(schedule)])

    code = code_version()
    jobs = jobs_of(options.kinds, options.schedules, seeds, options.effects)
    taken = None if options.any_version else code
    rows = read_rows(options.rows, taken)
    pending = [] if options.only_document else [job for job in jobs if job not in rows]
    print(f'{len(jobs)} recordings, {len(pending)} of them still to be measured; rows in {options.rows}')
    if pending:
        try:
            run(pending, options.rows, code, options.jobs)
        except KeyboardInterrupt:
            print('stopped; the same command goes on from here', file=sys.stderr)
            return 130
        rows = read_rows(options.rows, taken)
    chosen = [rows[job] for job in jobs if job in rows]
    drawing = picture_of([row for row in chosen if row.verdict != 'not_drawn'])
    picture = options.output.with_suffix('.svg')
    if drawing is not None:
        write_text(picture, drawing)
    given = shlex.join(one for one in (sys.argv[1:] if arguments is None else arguments) if one != '--only-document')
    command = 'make benchmark-effects' + (f" ARGS='{given}'" if given else '')
    how = {'command': command, 'machine': machine()}
    write_text(
        options.output, document(chosen, how, picture.name if drawing is not None else None, notes_in(options.output))
    )
    for goal in goals([row for row in chosen if row.verdict != 'not_drawn']):
        print(f'{"met    " if goal.met else "NOT MET"}  {goal.what}: {goal.measured} (wanted: {goal.wanted})')
    print(f'The document is {options.output}')
    return 0


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark_effects', description=__doc__.split('\n\n')[0])
    parser.add_argument('--kinds', type=_some_of(KINDS), default=KINDS, help=f'of {",".join(KINDS)}')
    parser.add_argument('--schedules', type=_some_of(SCHEDULES), default=SCHEDULES, help=f'of {",".join(SCHEDULES)}')
    parser.add_argument(
        '--effects',
        type=_some_of((*LIBRARY, *FOREIGN, *NOISES)),
        help='only these; with clean, kinds of noise; pairs of which both are among them',
    )
    parser.add_argument(
        '--seeds', type=_range, metavar='A:B', help=f'the same for all kinds; by default from {FIRST_SEED}'
    )
    parser.add_argument('--quick', action='store_true', help='few seeds: about 10 minutes on two cores')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='processes; 0: in this one')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'effects_panel.md', help='document')
    parser.add_argument('--rows', type=Path, default=ROOT / 'build' / 'effects_panel.jsonl', help='file of rows')
    parser.add_argument(
        '--only-document', action='store_true', help='measure nothing: write of the rows that are there'
    )
    parser.add_argument('--any-version', action='store_true', help='take rows that other versions measured, too')
    return parser.parse_args(arguments)


def _some_of(known: Sequence[str]) -> Callable[[str], list[str]]:
    def names(text: str) -> list[str]:
        found = text.split(',')
        if unknown := [name for name in found if name not in known]:
            raise argparse.ArgumentTypeError(f'{unknown[0]!r} is none of {", ".join(known)}')
        return found

    return names


def _range(text: str) -> range:
    try:
        first, last = (int(part) for part in text.split(':'))
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not of the form 1000:1010') from None
    return range(first, last)


if __name__ == '__main__':
    sys.exit(main())
