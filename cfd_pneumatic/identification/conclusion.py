# SPDX-License-Identifier: Apache-2.0
"""The conclusion of closing the loop: verdict, reasons, and errors on the test part before and after."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.characteristic import Characteristic
from cfd_pneumatic.identification.data import PARTS, PHYSICAL, Experiment, Tolerance, tolerated
from cfd_pneumatic.identification.residual import Noise, Test, is_noise
from cfd_pneumatic.identification.search import Trial
from cfd_pneumatic.identification.thresholds import (
    BOOTSTRAP_BLOCKS,
    BOOTSTRAP_QUANTILES,
    BOOTSTRAP_RESAMPLINGS,
    FEWEST_TRAIN_SAMPLES,
    LARGEST_EXPLAINED_RATIO,
    LARGEST_RATIO_WITHOUT_RESTS,
    MOST_CORE_BOUNDS,
)
from cfd_pneumatic.identification.visited_range import Outside
from cfd_pneumatic.model import Effect

VERDICTS = ('effect_added', 'no_missing_effect', 'shape_found', 'unexplained', 'insufficient_data')
"""Verdicts of the loop."""

STATUSES = ('confirmed', 'hypothesis')
"""Statuses of a verdict: whether the user can rely on the named cause."""

_FAILURES = {
    'inputs': 'depends on the inputs',
    'slow_inputs': 'depends on slow changes of the inputs',
    'line': 'contains a tone',
    'level': 'drifts',
    'ljung_box': 'is autocorrelated for longer than the noise',
    'noise_floor': 'is larger than the noise',
}
_NOT_SEARCHED = 'Effects were not searched: the warning reports a likely input error. Correct the input and run again'
_PHYSICAL_CORE = 'The physical core is used: flows, stiffness and sensing depend on pressure and position'
_CORE_AT_BOUNDS = (
    'The physical core fits better, but does not describe this device: its parameters {} end at their bounds'
)
_NO_KNOWN_EFFECT = 'No known effect explains the remaining error'
_NOISE_REMAINS = 'The remaining error is sensor noise'
_WITHIN = 'to within {:.2f} times the noise'
_SEED = 2


@dataclass(frozen=True)
class Conclusion:
    """
    The conclusion of closing the loop.

    Attributes
    ----------
    verdict
        One of `VERDICTS`.
    why
        The verdict in sentences, for people.
    core
        `linear` or `physical`.
    effects
        Names of the effects that were found, in the order in which they were added.
    alternatives
        For each effect the effects that the recordings do not distinguish from it, at most two.
    tried
        Every effect that was tried.
    ratio, ratio_interval
        Error ratio (after / before) on the test part, and its 95 % interval by a block bootstrap. All samples count if
        there is no test part. None if nothing was added.
    tests_before, tests_after
        Tests of the residual on the train and validation parts.
    noise
        Noise of the channel.
    not_visible
        Effects that these recordings could not have shown.
    next_experiment
        What to record to see these effects; empty if there are none.
    has_warning
        Whether a warning about the recordings makes the verdict uncertain.
    unknown
        Estimated curve of an unknown characteristic, or None.
    is_searched
        Whether effects were searched; false for recordings with a likely input error.
    contradictions
        Clauses that withdraw the verdict, such as a test part with a larger error.
    not_tried
        Parts of the search that its limit or the user prevented.
    not_tested
        Clauses about what the test part does not test, such as the response to set-points.
    outside
        Variables whose range the test part leaves, with errors inside and outside of the range.

    """

    verdict: str
    why: str
    core: str
    effects: tuple[str, ...]
    alternatives: Mapping[str, tuple[str, ...]]
    tried: tuple[Trial, ...]
    ratio: float | None
    ratio_interval: tuple[float, float] | None
    tests_before: tuple[Test, ...]
    tests_after: tuple[Test, ...]
    noise: Noise
    not_visible: tuple[str, ...]
    next_experiment: str
    has_warning: bool = False
    unknown: Characteristic | None = None
    is_searched: bool = True
    contradictions: tuple[str, ...] = ()
    not_tried: tuple[str, ...] = ()
    not_tested: tuple[str, ...] = ()
    outside: tuple[Outside, ...] = ()

    @property
    def status(self) -> str:
        """Return one of `STATUSES`: a hypothesis has a warning, or names a cause although more than noise remains."""
        is_named = self.effects or self.unknown is not None
        has_more = self.verdict == 'unexplained' or not is_noise(self.tests_after)
        has_more |= ratio_without_rests(self.tests_after, self.noise.known) is not None
        return 'hypothesis' if self.has_warning or (is_named and has_more) else 'confirmed'

    @property
    def explained_to_within(self) -> float | None:
        """Return the remaining error over the noise, rounded up to twentieths; None if it is not explained."""
        return None if self.verdict in ('unexplained', 'insufficient_data') else explained_to_within(self.tests_after)

    @property
    def rounds(self) -> list[tuple[Trial, ...]]:
        """Return the trials by rounds of the search; each round extends a different model."""
        return [tuple(trials) for _, trials in groupby(self.tried, attrgetter('present_effects'))]


@dataclass(frozen=True)
class PartError:
    """Error on one part: RMSE [Pa or N], and as percent of the measured span p99 - p1."""

    rmse: float
    nrmse_percent: float


def part_errors(experiments: Sequence[Experiment], simulated: Sequence[Array]) -> dict[str, PartError]:
    """Return the error on each part that has settled samples, by the part's name, over all experiments."""
    span = float(np.mean([experiment.span for experiment in experiments]))
    errors = np.concatenate(
        [(experiment.measured - values)[experiment.settled] for experiment, values in zip(experiments, simulated)]
    )
    part = np.concatenate([experiment.part[experiment.settled] for experiment in experiments])
    squares, counts = np.bincount(part, errors**2, len(PARTS)), np.bincount(part, minlength=len(PARTS))
    return {
        name: PartError(rmse, 100.0 * rmse / span)
        for name, rmse in zip(PARTS, np.sqrt(squares / np.maximum(counts, 1.0)).tolist())
        if counts[PARTS.index(name)]
    }


def error_ratio(
    experiments: Sequence[Experiment], before: Sequence[Array], after: Sequence[Array]
) -> tuple[float, tuple[float, float]]:
    """
    Return the error ratio (after / before) on the test part, and its 95 % interval.

    The interval is from a block bootstrap (Kuensch, 1989). All samples count if there is no test part.
    """
    is_judged = np.concatenate([experiment.part for experiment in experiments]) == PARTS.index('test')
    if not np.any(is_judged):
        is_judged[:] = True
    measured = np.concatenate([experiment.measured for experiment in experiments])
    squares = [(measured - np.concatenate(simulated))[is_judged] ** 2 for simulated in (before, after)]
    edges = np.linspace(0, squares[0].size, min(BOOTSTRAP_BLOCKS, squares[0].size) + 1).astype(np.intp)[:-1]
    sums_before, sums_after = (np.add.reduceat(squared_errors, edges) for squared_errors in squares)
    rng = np.random.default_rng(_SEED)
    resampled = rng.integers(0, edges.size, (BOOTSTRAP_RESAMPLINGS, edges.size))
    ratios = np.sqrt(sums_after[resampled].sum(axis=1) / sums_before[resampled].sum(axis=1))
    low, high = np.quantile(ratios, BOOTSTRAP_QUANTILES)
    return math.sqrt(float(squares[1].sum() / squares[0].sum())), (float(low), float(high))


def shortage_of(experiments: Sequence[Experiment]) -> str | None:
    """Return what the recordings lack for a search, or None."""
    samples = sum(int(np.count_nonzero(experiment.part == PARTS.index('train'))) for experiment in experiments)
    if samples < FEWEST_TRAIN_SAMPLES:
        return (
            f'The train part has {samples} samples, too few to distinguish effects. '
            f'Record at least {FEWEST_TRAIN_SAMPLES}'
        )
    return None


def verdict_of(
    core: str,
    effects: Sequence[str],
    alternatives: Mapping[str, Sequence[str]],
    tests: Sequence[Test],
    shortage: str | None,
    ratio: float | None,
    interval: tuple[float, float] | None,
    contradictions: Sequence[str] = (),
    tolerance: str = '',
    curve: str = '',
    is_searched: bool = True,
    has_rests: bool = True,
    core_bounds: Sequence[str] = (),
) -> tuple[str, str]:
    """
    Return the verdict and its reasons in sentences.

    Parameters
    ----------
    core, effects, alternatives, ratio, interval
        See `Conclusion`.
    tests
        Tests of the residual with core, effects and curve.
    shortage
        See `shortage_of`.
    contradictions
        Clauses that withdraw the verdict.
    tolerance
        Clause that the remaining error is within the tolerance: the verdict is then not `unexplained`.
    curve
        Description of the unknown characteristic.
    is_searched
        Whether effects were searched.
    has_rests
        Whether the piston rested; otherwise autocorrelated noise is not distinguishable from a missing effect.
    core_bounds
        Parameters of the physical core that end at bounds.

    """
    if shortage is not None:
        return 'insufficient_data', shortage
    named = ' and '.join(
        name + (f' (not distinguishable from {" or ".join(alternatives[name])})' if alternatives.get(name) else '')
        for name in effects
    )
    missing = [f'Missing effect{"s" if len(effects) > 1 else ""}: {named}'] if effects else []
    is_physical = core == PHYSICAL
    physical_core = _PHYSICAL_CORE
    if len(core_bounds) > MOST_CORE_BOUNDS:
        physical_core = _CORE_AT_BOUNDS.format(' and '.join(name.replace('_', ' ') for name in core_bounds))
    verb = 'Adding the curve reduces' if curve else 'Adding it reduces'
    if len(effects) + bool(curve or is_physical) > 1:
        verb = 'Together they reduce'
    reduction = [] if ratio is None or interval is None else [f'{verb} the error to {_ratio_text(ratio, interval)}']
    failed = ' and '.join(_FAILURES.get(test.name, test.what) for test in tests if test.decisive and not test.passed)
    if curve:
        reasons, remainder = [f'Unknown cause: {curve}', *missing, *reduction], [_NOISE_REMAINS]
        if failed:
            remainder = [f'The remaining error {failed}']
    elif effects:
        reasons, remainder = [*([physical_core] if is_physical else []), *missing, *reduction], [_NOISE_REMAINS]
        if failed:
            remainder = [_NO_KNOWN_EFFECT, f'The remaining error {failed}']
    else:
        reasons = [physical_core, *reduction] if is_physical else []
        if failed:
            reasons += [_NO_KNOWN_EFFECT if is_searched else _NOT_SEARCHED]
            remainder = [f'The remaining error {failed}']
        else:
            remainder = ['Nothing is missing that the recording could show']
    size = ratio_without_rests(tests, has_rests)
    if not failed and size is not None:
        size_text = f'The remaining error is {size:.1f} times the noise from sample to sample'
        more = ' more' if curve or effects else ''
        remainder = [
            f'Nothing{more} is missing if this noise is autocorrelated. Record rests of one or two seconds to decide'
        ]
        if curve or effects:
            remainder = [size_text, *remainder]
        else:
            reasons += [size_text]
    elif not (failed or curve or effects):
        reasons += ['The model explains the recording down to sensor noise']
    within = explained_to_within(tests)
    if failed and within is not None and (curve or effects or is_physical):
        remainder = [f'The remaining error {failed}', f'The model explains the recording {_WITHIN.format(within)}']
        failed = ''
    if failed and tolerance:
        failed, remainder = '', [f'The remaining error {failed}', tolerance]
    if failed or contradictions:
        return 'unexplained', _text([*reasons, *(remainder if failed else []), *contradictions])
    return 'shape_found' if curve else 'effect_added' if effects else 'no_missing_effect', _text(reasons + remainder)


def _text(clauses: Sequence[str]) -> str:
    return '. '.join(clause[:1].upper() + clause[1:] for clause in clauses)


def ratio_without_rests(tests: Sequence[Test], has_rests: bool) -> float | None:
    """
    Return the residual over the noise from sample to sample, if the residual may be more than noise; None otherwise.

    Rests of the piston would show whether the noise is autocorrelated.
    """
    size = max((test.statistic for test in tests if test.name == 'noise_floor'), default=1.0)
    return size if not has_rests and size > LARGEST_RATIO_WITHOUT_RESTS else None


def explained_to_within(tests: Sequence[Test]) -> float | None:
    """
    Return the residual over the noise, rounded up to twentieths; None if it is clearly more than noise.

    A few percent of the noise that depend on an input withdraw no answer.
    """
    size = max((test.statistic for test in tests if test.name == 'noise_floor'), default=math.inf)
    return math.ceil(20.0 * size) / 20.0 if size <= LARGEST_EXPLAINED_RATIO else None


def within_tolerance(
    tolerance: Tolerance, unit: str, experiments: Sequence[Experiment], simulated: Sequence[Array]
) -> str:
    """Return a clause that the errors of all parts are within a tolerance; empty if they are not."""
    errors = part_errors(experiments, simulated)
    largest = max(error.rmse for error in errors.values())
    limit = tolerated(tolerance, unit, float(np.mean([experiment.span for experiment in experiments])))
    return f'its size, {largest:.3g} {unit}, is within the tolerance of {limit:.3g} {unit}' if largest <= limit else ''


def withdraw_effects(
    effects: Sequence[str], ratio: float, interval: tuple[float, float], tried: Sequence[Trial]
) -> tuple[str, tuple[Trial, ...]]:
    """Return a clause that the effects do not reduce the error, and the trials as not accepted."""
    clause = f'not added: {" and ".join(effects)}. The error would change to {_ratio_text(ratio, interval)}'
    why = 'does not reduce the error on the test part'
    return clause, tuple(replace(trial, accepted=False, why=why) if trial.accepted else trial for trial in tried)


def _ratio_text(ratio: float, interval: tuple[float, float]) -> str:
    low, high = interval
    chance = f'. This may be chance: the 95 % interval is {100.0 * low:.0f} to {100.0 * high:.0f} %'
    return f'{100.0 * ratio:.0f} %' + (chance if low <= 1.0 <= high else '')


def next_experiment(hidden: Sequence[str], library: Mapping[str, Effect], shortage: str | None) -> str:
    """Return what to record so that hidden effects would show."""
    if shortage is not None:
        return 'several strokes out and back, of two sizes, at two set-points'
    advice = list(dict.fromkeys(library[name].advice for name in hidden if library[name].advice))
    return '; '.join(advice)
