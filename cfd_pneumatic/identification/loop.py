# SPDX-License-Identifier: Apache-2.0
"""
Closing the loop: what a channel's model lacks, added to it, and the error before and after.

Ask whether the residual of the model without effects is noise; if not, ask which core the recordings need and search
for effects beside it; fit what was found to train and validation together and compare before and after once, on the
test part; say what was found, or that it is not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.characteristic import Characteristic, centred, estimate_characteristic
from cfd_pneumatic.identification.conclusion import (
    Conclusion,
    compared,
    next_experiment,
    not_added,
    shortage_of,
    verdict_of,
    within,
)
from cfd_pneumatic.identification.data import AUTO, LINEAR, PHYSICAL, Tolerance
from cfd_pneumatic.identification.fit import Fit, summary
from cfd_pneumatic.identification.residual import is_noise
from cfd_pneumatic.identification.search import FittedCurve, Strategy, Trial, effects_not_visible
from cfd_pneumatic.identification.search import fitted as fitted_curve
from cfd_pneumatic.identification.test_part import contradiction
from cfd_pneumatic.identification.thresholds import (
    LARGEST_CURVE_ERROR,
    LARGEST_CURVE_ERROR_WITH_EFFECTS,
    LARGEST_FADING_CURVE_ERROR,
)
from cfd_pneumatic.runtime import map_in_threads


def close_loop(
    before: Fit, core: str = AUTO, searching: bool = True, tolerance: Tolerance = ()
) -> tuple[Fit, Conclusion]:
    """
    Return the fit with the core and the effects that were found, and what it comes to.

    Parameters
    ----------
    before
        Fit of a channel's linear model without effects to train and validation.
    core
        One of `Options.core`.
    searching
        Whether a core and effects are looked for.
    tolerance
        Errors that do not matter.

    """
    likelihood = before.likelihood
    channel, experiments = likelihood.channel, likelihood.experiments
    noise = likelihood.noise(before.model)
    tests = tests_before = likelihood.tests(before.model, noise)
    shortage = shortage_of(experiments)
    after = before
    alternatives: Mapping[str, tuple[str, ...]] = {}
    tried: tuple[Trial, ...] = ()
    unknown: Characteristic | None = None
    if searching and shortage is None and not all(one.passed for one in tests):
        strategy = Strategy(before, core, partial(_confirmed, before))
        after, alternatives, tried, curve = strategy.answer(is_noise=is_noise(tests))
        unknown = None if curve is None else estimate_characteristic(likelihood, after.model, curve, curve.begin.model)
    ratio, interval = None, None
    against: list[str] = []
    if after is not before:
        ratio, interval = compared(experiments, before.simulated, after.simulated)
        if ratio >= 1.0:
            clause, tried = not_added(list(after.model.parts), ratio, interval, tried)
            against.append(clause)
            after, alternatives, ratio, interval, unknown = before, {}, None, None, None
    if after is not before:
        noise = likelihood.noise(after.model)
        tests = likelihood.tests(after.model, noise)
    hidden = effects_not_visible(likelihood, after.model, noise) if searching and shortage is None else ()
    left = [one.measured - values for one, values in zip(experiments, after.simulated)]
    if searching:
        against += contradiction(experiments, left, noise.std)
    if unknown is not None and unknown.event:
        against.append(unknown.event)
    effects = tuple(name for name in after.model.effects if name != channel.curve.name)
    used = PHYSICAL if after.model.core else LINEAR
    harmless = within(tolerance, channel.quantity.small.unit, experiments, after.simulated)
    law = '' if unknown is None else unknown.words
    verdict, why = verdict_of(
        used, effects, alternatives, tests, shortage, ratio, interval, against, harmless, law, searching, noise.known
    )
    conclusion = Conclusion(
        verdict=verdict,
        why=why,
        core=used,
        effects=effects,
        alternatives=alternatives,
        tried=tried,
        ratio=ratio,
        ratio_interval=interval,
        tests_before=tuple(tests_before),
        tests_after=tuple(tests),
        noise=noise,
        not_visible=hidden,
        next_experiment=next_experiment(hidden, channel.library, shortage),
        unknown=unknown,
        sought=searching,
    )
    return after, conclusion


def _confirmed(before: Fit, curve: FittedCurve, instead: Model) -> Fit | None:
    """Return the fit of a curve to train and validation; None if the test part contradicts it or prefers `instead`."""
    likelihood, begin = before.likelihood, curve.begin
    fitted = fitted_curve(likelihood, curve.candidate.model, curve.promise).model
    model = centred(likelihood, fitted, curve.promise.slot)
    effects = {name: own for name, own in model.effects.items() if name != likelihood.channel.curve.name}
    models = model, instead, replace(model, effects=effects), begin.model
    simulated, of_other, without, of_begin = map_in_threads(likelihood.simulate, models)
    if not all(np.all(np.isfinite(values)) for values in simulated):
        return None
    experiments = likelihood.experiments
    if compared(experiments, of_other, simulated)[0] >= 1.0:
        return None
    squares = [sum(float(run @ run) for run in likelihood.residuals(one)) for one in (simulated, without)]
    if min(compared(experiments, without, simulated)[0], math.sqrt(squares[0] / squares[1])) >= LARGEST_CURVE_ERROR:
        return None  # it freed a core that was stuck, and does nothing itself
    left_of_unseen = [compared(experiments, of_begin, simulated)[0]]  # of the test part first
    if begin.validation_rmse and curve.candidate.validation_rmse is not None:
        left_of_unseen.append(curve.candidate.validation_rmse / begin.validation_rmse)
    if min(left_of_unseen) >= (LARGEST_CURVE_ERROR_WITH_EFFECTS if begin.effects else LARGEST_CURVE_ERROR):
        return None
    left = [one.measured - values for one, values in zip(experiments, simulated)]
    if left_of_unseen[0] > LARGEST_FADING_CURVE_ERROR and contradiction(experiments, left, likelihood.noise(model).std):
        return None
    return summary(likelihood, model)
