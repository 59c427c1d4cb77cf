# SPDX-License-Identifier: Apache-2.0
"""What closing the loop comes to: the verdict in a sentence, and the errors before and after on the test part."""

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
    LARGEST_RATIO_WITHOUT_RESTS,
)
from cfd_pneumatic.model import Effect

VERDICTS = ('effect_added', 'no_missing_effect', 'shape_found', 'unexplained', 'insufficient_data')
"""What the loop may end with."""

STATUSES = ('confirmed', 'hypothesis')
"""How far a verdict is to be trusted."""

_FAILINGS = {
    'inputs': 'follows what drives the device',
    'slow_inputs': 'follows it slowly, too',
    'line': 'has a tone in it',
    'level': 'wanders',
    'ljung_box': 'has a longer memory than the noise',
    'noise_floor': 'is larger than the noise',
}
_UNSOUGHT = 'effects are searched for once what the warning names is mended'
_WHOLE = 'flows, stiffness and sensing follow pressure and position, as the physical core has it'
_UNKNOWN = 'the model lacks something that is none of the effects known here'
_SEED = 2


@dataclass(frozen=True)
class Conclusion:
    """
    What closing the loop comes to.

    Attributes
    ----------
    verdict
        One of `VERDICTS`.
    why
        The verdict in a sentence, for people.
    core
        `linear` or `physical`: what the effects are beside.
    effects
        Names of the effects that were found, in the order in which they were added.
    alternatives
        For each effect those that the recordings can't tell from it, at most two.
    tried
        Every effect that was tried.
    ratio, ratio_interval
        Error after over before on the test part (on all samples where there is none), and the 95 % interval by a block
        bootstrap; None where nothing was added.
    tests_before, tests_after
        Of the residuals, on train and validation.
    noise
        Of the channel.
    not_visible
        Effects that these recordings could not have shown.
    next_experiment
        What to record to see them; empty where there are none.
    doubted
        Whether a warning about the recordings puts all of it in doubt.
    unknown
        A law that is none of the effects, as the recordings have drawn it, or None.
    sought
        Whether effects were looked for: not in recordings that are misread.

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
    doubted: bool = False
    unknown: Characteristic | None = None
    sought: bool = True

    @property
    def status(self) -> str:
        """One of `STATUSES`: a hypothesis is a name beside which more than noise is left, or what a warning doubts."""
        named = self.effects or self.unknown is not None
        more_is_left = self.verdict == 'unexplained' or not is_noise(self.tests_after)
        more_is_left |= maybe_more(self.tests_after, self.noise.known) is not None
        return 'hypothesis' if self.doubted or (named and more_is_left) else 'confirmed'

    @property
    def rounds(self) -> list[tuple[Trial, ...]]:
        """The trials by rounds of the search, each beside another model."""
        return [tuple(trials) for _, trials in groupby(self.tried, attrgetter('beside'))]


@dataclass(frozen=True)
class PartError:
    """Error on one part: RMSE [Pa or N], and as percent of the measured span p99 - p1."""

    rmse: float
    nrmse_percent: float


def part_errors(experiments: Sequence[Experiment], simulated: Sequence[Array]) -> dict[str, PartError]:
    """Return the error on each part that has settled samples, by its name, of all experiments together."""
    span = float(np.mean([one.span for one in experiments]))
    errors = np.concatenate([(one.measured - values)[one.settled] for one, values in zip(experiments, simulated)])
    part = np.concatenate([one.part[one.settled] for one in experiments])
    squares, counts = np.bincount(part, errors**2, len(PARTS)), np.bincount(part, minlength=len(PARTS))
    return {
        name: PartError(rmse, 100.0 * rmse / span)
        for name, rmse in zip(PARTS, np.sqrt(squares / np.maximum(counts, 1.0)).tolist())
        if counts[PARTS.index(name)]
    }


def compared(
    experiments: Sequence[Experiment], before: Sequence[Array], after: Sequence[Array]
) -> tuple[float, tuple[float, float]]:
    """
    Return the ratio of the errors on the test part, and its 95 % interval by a block bootstrap (Kuensch, 1989).

    On all samples where there is no test part.
    """
    judged = np.concatenate([one.part for one in experiments]) == PARTS.index('test')
    if not np.any(judged):
        judged[:] = True
    measured = np.concatenate([one.measured for one in experiments])
    squares = [(measured - np.concatenate(one))[judged] ** 2 for one in (before, after)]
    edges = np.linspace(0, squares[0].size, min(BOOTSTRAP_BLOCKS, squares[0].size) + 1).astype(np.intp)[:-1]
    sums_before, sums_after = (np.add.reduceat(one, edges) for one in squares)
    rng = np.random.default_rng(_SEED)
    drawn = rng.integers(0, edges.size, (BOOTSTRAP_RESAMPLINGS, edges.size))
    ratios = np.sqrt(sums_after[drawn].sum(axis=1) / sums_before[drawn].sum(axis=1))
    low, high = np.quantile(ratios, BOOTSTRAP_QUANTILES)
    return math.sqrt(float(squares[1].sum() / squares[0].sum())), (float(low), float(high))


def shortage_of(experiments: Sequence[Experiment]) -> str | None:
    """Return what the recordings lack for a search, or None."""
    samples = sum(int(np.count_nonzero(one.part == PARTS.index('train'))) for one in experiments)
    if samples < FEWEST_TRAIN_SAMPLES:
        return (
            f'{samples} samples to learn from are too few to tell effects apart: record at least {FEWEST_TRAIN_SAMPLES}'
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
    against: Sequence[str] = (),
    harmless: str = '',
    law: str = '',
    sought: bool = True,
    rested: bool = True,
) -> tuple[str, str]:
    """
    Return the verdict and the sentence that says it; clauses of `against` withdraw it.

    Where `harmless` says why what is left does not matter, it makes no verdict `unexplained`. A `law` is what a curve
    that was drawn does. Whether effects were `sought` at all is said, too; and what is left may be noise with a memory
    or more where nothing `rested`.
    """
    if shortage is not None:
        return 'insufficient_data', shortage
    named = ' and '.join(
        name + (f' (or {" or ".join(alternatives[name])}: not to be told apart here)' if alternatives.get(name) else '')
        for name in effects
    )
    falls = '' if ratio is None or interval is None else f'; with it the error {_change(ratio, interval)}'
    whole = f'{_WHOLE}{falls}, and ' if core == PHYSICAL else ''
    failed = ', '.join(_FAILINGS.get(test.name, test.what) for test in tests if test.decisive and not test.passed)
    if law:
        beside = f', beside {named}' if named else ''
        why = f'the model lacks a law that is none of the effects known here{beside}: {law}{falls}'
        left = f'; something more is left, which {failed}' if failed else ', and what is left is noise'
    elif effects:
        why = f'{_WHOLE}, and the model lacks {named}{falls}' if whole else f'the model lacks {named}{falls}'
        left = ', and what is left is noise'
        if failed:
            left = f', and something that is not known here: what is left {failed}'
    elif failed:
        why, left = f'{whole}{_UNKNOWN if sought else _UNSOUGHT}', f': what is left {failed}'
    else:
        why, left = f'{whole}what the model leaves is noise', ': nothing is missing that these recordings could show'
    size = maybe_more(tests, rested)
    if size is not None and not failed:
        times = f'is {size:.1f} times the noise from sample to sample'
        has_memory = 'if that noise has a memory, which rests of a second or two tell'
        if law or effects:
            left = f', and what is left {times}: nothing more is missing {has_memory}'
        else:
            why, left = f'{whole}what the model leaves {times}', f': nothing is missing {has_memory}'
    if failed and harmless:
        failed, left = '', f'; what is left {failed}, but {harmless}'
    if failed or against:
        return 'unexplained', '; '.join([why + left, *against]) if failed else f'{why}, but {"; ".join(against)}'
    return 'shape_found' if law else 'effect_added' if effects else 'no_missing_effect', why + left


def maybe_more(tests: Sequence[Test], rested: bool) -> float | None:
    """Return what is left, over the noise from sample to sample, where that may be more: nothing `rested`."""
    size = max((test.statistic for test in tests if test.name == 'noise_floor'), default=1.0)
    return size if not rested and size > LARGEST_RATIO_WITHOUT_RESTS else None


def within(tolerance: Tolerance, unit: str, experiments: Sequence[Experiment], simulated: Sequence[Array]) -> str:
    """Return in a clause that the errors of all parts lie within a tolerance, or nothing."""
    errors = part_errors(experiments, simulated)
    worst = max(one.rmse for one in errors.values())
    most = tolerated(tolerance, unit, float(np.mean([one.span for one in experiments])))
    return f'its {worst:.3g} {unit} are within the tolerance of {most:.3g} {unit}' if worst <= most else ''


def not_added(
    effects: Sequence[str], ratio: float, interval: tuple[float, float], tried: Sequence[Trial]
) -> tuple[str, tuple[Trial, ...]]:
    """Return in a clause that with these effects the error does not fall, and the trials without their acceptance."""
    clause = f'with {" and ".join(effects)} the error {_change(ratio, interval)}: not added'
    why = 'with it the error on the test part does not fall'
    return clause, tuple(replace(one, accepted=False, why=why) if one.accepted else one for one in tried)


def _change(ratio: float, interval: tuple[float, float]) -> str:
    change = f'falls to {100.0 * ratio:.0f} %' if ratio < 1.0 else f'does not fall, but is {100.0 * ratio:.0f} %'
    low, high = interval
    by_chance = f', which may be chance ({100.0 * low:.0f} to {100.0 * high:.0f} %)' if low <= 1.0 <= high else ''
    return change + by_chance


def next_experiment(hidden: Sequence[str], library: Mapping[str, Effect], shortage: str | None) -> str:
    """Return what to record to see effects that did not show."""
    if shortage is not None:
        return 'several strokes out and back, of two sizes, at two set-points'
    advice = list(dict.fromkeys(library[name].advice for name in hidden if library[name].advice))
    return '; '.join(advice)
