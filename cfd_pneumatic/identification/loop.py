# SPDX-License-Identifier: Apache-2.0
"""
Close the loop of an identification: find what a channel's model lacks, add it, and compare errors before and after.

1. Test whether the residual of the model without effects is noise.
2. If not, search the core that the recordings need, and effects in addition to the core.
3. Fit core and effects to the train and validation parts together.
4. Compare the errors before and after on the test part, once, and conclude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.characteristic import Characteristic, centre_curve, estimate_characteristic
from cfd_pneumatic.identification.conclusion import (
    Conclusion,
    error_ratio,
    next_experiment,
    shortage_of,
    verdict_of,
    withdraw_effects,
    within_tolerance,
)
from cfd_pneumatic.identification.data import AUTO, LINEAR, PHYSICAL, Tolerance
from cfd_pneumatic.identification.fit import AT_BOUND, Fit, summary
from cfd_pneumatic.identification.residual import is_noise
from cfd_pneumatic.identification.search import FittedCurve, Strategy, Trial, effects_not_visible, fit_curve
from cfd_pneumatic.identification.test_part import contradiction, not_tested
from cfd_pneumatic.identification.thresholds import (
    LARGEST_CHANCE_RATIO,
    LARGEST_CURVE_ERROR,
    LARGEST_CURVE_ERROR_WITH_EFFECTS,
    LARGEST_FADING_CURVE_ERROR,
)
from cfd_pneumatic.identification.visited_range import outside_masks, outside_ranges
from cfd_pneumatic.runtime import map_in_threads


def close_loop(
    before: Fit, core: str = AUTO, searching: bool = True, tolerance: Tolerance = ()
) -> tuple[Fit, Conclusion]:
    """
    Return the fit with the core and the effects that were found, and the conclusion.

    Parameters
    ----------
    before
        Fit of a channel's linear model without effects to train and validation.
    core
        One of `Options.core`.
    searching
        Whether to search a core and effects.
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
    if searching and shortage is None and not all(test.passed for test in tests):
        strategy = Strategy(before, core, partial(_confirm_curve, before))
        after, alternatives, tried, curve = strategy.find_answer(is_noise=is_noise(tests))
        unknown = None if curve is None else estimate_characteristic(likelihood, after.model, curve, curve.base.model)
    ratio, interval = None, None
    contradictions: list[str] = []
    if after is not before:
        ratio, interval = error_ratio(experiments, before.simulated, after.simulated)
        noise_after = likelihood.noise(after.model)
        tests_after = likelihood.tests(after.model, noise_after)
        may_be_chance = ratio > LARGEST_CHANCE_RATIO and interval[1] >= 1.0
        if ratio >= 1.0 or (may_be_chance and not is_noise(tests_after)):
            clause, tried = withdraw_effects(list(after.model.parts), ratio, interval, tried)
            contradictions.append(clause)
            after, alternatives, ratio, interval, unknown = before, {}, None, None, None
        else:
            noise, tests = noise_after, tests_after
    at_bounds = _core_bounds(after)
    hidden = effects_not_visible(likelihood, after.model, noise) if searching and shortage is None else ()
    residuals = [experiment.measured - values for experiment, values in zip(experiments, after.simulated)]
    if searching:
        outside = outside_masks(channel, experiments, after.simulated, after.model)
        contradictions += contradiction(experiments, residuals, noise.std, outside)
    effects = tuple(name for name in after.model.effects if name != channel.curve.name)
    used_core = PHYSICAL if after.model.core else LINEAR
    tolerated = within_tolerance(tolerance, channel.quantity.small.unit, experiments, after.simulated)
    description = '' if unknown is None else unknown.description
    verdict, why = verdict_of(
        used_core,
        effects,
        alternatives,
        tests,
        shortage,
        ratio,
        interval,
        contradictions,
        tolerated,
        description,
        searching,
        noise.known,
        at_bounds,
    )
    ranges = outside_ranges(channel, experiments, after.simulated, after.model)
    conclusion = Conclusion(
        verdict=verdict,
        why=why,
        core=used_core,
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
        is_searched=searching,
        contradictions=tuple(contradictions),
        not_tried=likelihood.effort.skipped,
        not_tested=(*not_tested(experiments), *(part.clause for part in ranges)),
        outside=ranges,
    )
    return after, conclusion


def _core_bounds(fit: Fit) -> tuple[str, ...]:
    """Return the parameters of a core that end at a bound, apart from those whose bound switches them off."""
    channel, values = fit.likelihood.channel, {}
    for name, parameters in fit.model.core.items():
        for parameter, value in zip(channel.effects[name].parameters, parameters):
            is_off = math.isclose(value, parameter.null, abs_tol=1e-9)
            values[f'{name}.{parameter.name}'] = '' if is_off else parameter.name
    return tuple(
        values[estimate.name]
        for estimate in fit.estimates
        if values.get(estimate.name) and estimate.reason is not None and estimate.reason.startswith(AT_BOUND)
    )


def _confirm_curve(before: Fit, curve: FittedCurve, rival: Model | None) -> Fit | None:
    """
    Return the fit of a curve to train and validation; None if the test part contradicts it or prefers the rival.

    Without a rival only a fit that diverges is refused.
    """
    likelihood, base = before.likelihood, curve.base
    fitted = fit_curve(likelihood, curve.candidate.model, curve.screened).model
    model = centre_curve(likelihood, fitted, curve.screened.place)
    effects = {name: values for name, values in model.effects.items() if name != likelihood.channel.curve.name}
    simulated = likelihood.simulate(model)
    if not all(np.all(np.isfinite(values)) for values in simulated):
        return None
    if rival is None:
        return summary(likelihood, model)
    models = rival, replace(model, effects=effects), base.model
    of_rival, without_curve, of_base = map_in_threads(likelihood.simulate, models)
    experiments = likelihood.experiments
    if error_ratio(experiments, of_rival, simulated)[0] >= 1.0:
        return None
    squares = [
        sum(float(run @ run) for run in likelihood.residuals(simulation)) for simulation in (simulated, without_curve)
    ]
    if (
        min(error_ratio(experiments, without_curve, simulated)[0], math.sqrt(squares[0] / squares[1]))
        >= LARGEST_CURVE_ERROR
    ):
        return None  # the curve freed a core that was stuck, and has no effect itself
    prediction_ratios = [error_ratio(experiments, of_base, simulated)[0]]  # test part first
    if base.validation_rmse and curve.candidate.validation_rmse is not None:
        prediction_ratios.append(curve.candidate.validation_rmse / base.validation_rmse)
    if min(prediction_ratios) >= (LARGEST_CURVE_ERROR_WITH_EFFECTS if base.effects else LARGEST_CURVE_ERROR):
        return None
    residuals = [experiment.measured - values for experiment, values in zip(experiments, simulated)]
    outside = outside_masks(likelihood.channel, experiments, simulated, model)
    if prediction_ratios[0] > LARGEST_FADING_CURVE_ERROR and contradiction(
        experiments, residuals, likelihood.noise(model).std, outside
    ):
        return None
    return summary(likelihood, model)
