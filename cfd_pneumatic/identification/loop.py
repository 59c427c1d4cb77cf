"""
Closing the loop: what the model lacks, added to it, and the error before and after.

Fit the paper's model; ask whether its residual is noise; if not, search for effects (`attribution`); fit before and
after to train and validation together and compare them once, on the test part; say what was found, or that it is not
known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.extension import Extension, extend, tangent
from cfd_pneumatic.identification.fit.output_error import Estimate, Fit
from cfd_pneumatic.identification.fit.uncertainty import LARGEST_RELATIVE_STD, covariance
from cfd_pneumatic.identification.held_out import contradiction
from cfd_pneumatic.identification.residual.noise import Noise, precision, pressure_noise
from cfd_pneumatic.identification.residual.tests import explained, residual_tests
from cfd_pneumatic.identification.search.attribution import Search
from cfd_pneumatic.identification.search.stepwise import Trial
from cfd_pneumatic.identification.search.visibility import invisible
from cfd_pneumatic.identification.verdict import (
    VERDICTS,
    Conclusion,
    compared,
    next_experiment,
    not_added,
    shortage_of,
    verdict_of,
)
from cfd_pneumatic.model import SPECS
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS, Effect

__all__ = ['VERDICTS', 'Closure', 'close_loop']

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FINE = (1e-8, 60)


@dataclass(frozen=True)
class Closure(Conclusion):
    """
    What came of closing the loop on one cylinder.

    Attributes
    ----------
    extension
        The model with the effects that were found, fitted to train and validation; without any it is the paper's.
    simulated
        Pressures by it at each experiment's samples [Pa].
    noise
        Of the pressure.

    """

    extension: Extension
    simulated: tuple[Array, ...]
    noise: Noise


def close_loop(
    experiments: Sequence[Experiment],
    baseline: Fit,
    ambient_pressure: float,
    library: Mapping[str, Effect] = PRESSURE_EFFECTS,
) -> Closure:
    """
    Close the loop on one cylinder.

    Parameters
    ----------
    experiments
        What was measured.
    baseline
        The paper's model, fitted to their train and validation parts.
    ambient_pressure
        Absolute [Pa].
    library
        Effects to choose from.

    """
    masks = [one.fitted for one in experiments]
    begin = Extension(baseline.gains, {}, baseline.offsets, baseline.starts)
    noise = pressure_noise(experiments, baseline.simulated, baseline.gains[0])
    before = tuple(residual_tests(experiments, baseline.simulated, masks, noise))
    measured, parts = [one.pressure for one in experiments], [one.part for one in experiments]
    shortage = shortage_of(parts)
    found = begin
    alternatives: dict[str, tuple[str, ...]] = {}
    tried: tuple[Trial, ...] = ()
    if shortage is None and not explained(before):
        answer = Search(experiments, begin, ambient_pressure, library).run()
        alternatives, tried, rough = dict(answer.alternatives), answer.tried, answer.model.extension
        if rough.effects:
            weights = _weights(experiments, rough.simulate(experiments, ambient_pressure))
            found = extend(experiments, masks, ambient_pressure, rough, rough.effects, weights, *_FINE)
            if not _finite(found.simulate(experiments, ambient_pressure)):
                found = rough
    simulated = found.simulate(experiments, ambient_pressure) if found.effects else list(baseline.simulated)
    ratio, interval = compared(measured, baseline.simulated, simulated, parts) if found.effects else (None, None)
    against: list[str] = []
    if ratio is not None and interval is not None and ratio >= 1.0:
        clause, tried = not_added(list(found.effects), ratio, interval, tried)
        against.append(clause)
        found, simulated, alternatives, ratio, interval = begin, list(baseline.simulated), {}, None, None
    noise = pressure_noise(experiments, simulated, found.gains[0])
    after = tuple(residual_tests(experiments, simulated, masks, noise)) if found.effects else before
    hidden = invisible(experiments, masks, ambient_pressure, found, simulated, noise, library) if not shortage else ()
    against += contradiction(experiments, [one - other for one, other in zip(measured, simulated)], noise.std)
    verdict, why = verdict_of(list(found.effects), alternatives, after, shortage, ratio, interval, against)
    return Closure(
        verdict=verdict,
        why=why,
        effects=tuple(found.effects),
        extension=found,
        estimates=_estimates(experiments, masks, ambient_pressure, found, simulated, baseline),
        alternatives=alternatives,
        tried=tried,
        simulated=tuple(simulated),
        ratio=ratio,
        ratio_interval=interval,
        noise=noise,
        tests_before=before,
        tests_after=after,
        not_visible=hidden,
        next_experiment=next_experiment(hidden, library, shortage),
    )


def _finite(pressures: Sequence[Array]) -> bool:
    return all(bool(np.all(np.isfinite(pressure))) for pressure in pressures)


def _weights(experiments: Sequence[Experiment], simulated: Sequence[Array]) -> list[Array]:
    return [precision(one, pressure) for one, pressure in zip(experiments, simulated)]


def _estimates(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    found: Extension,
    simulated: Sequence[Array],
    baseline: Fit,
) -> tuple[Estimate, ...]:
    """Return the gains and the effects' parameters with standard errors."""
    if not found.effects:
        return baseline.estimates
    at = tangent(experiments, masks, ambient_pressure, found, _weights(experiments, simulated))
    degrees = max(at.residuals.size - len(at.names), 1)
    lengths = [int(np.count_nonzero(mask)) for mask in masks]
    stds = np.sqrt(np.diag(covariance(at.jacobian, at.residuals, degrees, lengths)))
    stds[~np.any(at.jacobian, axis=0)] = np.inf  # nothing depends on them
    quantile = float(stdtrit(degrees, 0.975))
    known = {name: (float(std), bool(logarithm)) for name, std, logarithm in zip(at.names, stds, at.logarithmic)}
    told = {estimate.name: estimate for estimate in baseline.estimates}
    estimates = []
    for spec, value in zip(SPECS, found.gains.tolist()):
        std, _ = known[spec.name]
        reason = told[spec.name].reason
        if reason is None and std > LARGEST_RELATIVE_STD:
            reason = f'beside the effects its standard error would be {100.0 * std:.0f} % of its value'
        estimates.append(_estimate(spec.name, spec.unit, value, value * std, quantile, reason))
    for name, own in found.effects.items():
        for parameter, value in zip(PRESSURE_EFFECTS[name].parameters, own):
            full = f'{name}.{parameter.name}'
            if parameter.choice:
                estimates.append(Estimate(full, parameter.unit, value, 0.0, (value, value), None))
                continue
            std, logarithm = known[full]
            own_std = abs(value) * std if logarithm else std
            untold = 'these recordings tell the effect, but not this parameter' if own_std > abs(value) else None
            estimates.append(_estimate(full, parameter.unit, value, own_std, quantile, untold))
    return tuple(estimates)


def _estimate(name: str, unit: str, value: float, std: float, quantile: float, reason: str | None) -> Estimate:
    if reason is not None:
        return Estimate(name, unit, None, None, None, reason)
    return Estimate(name, unit, value, std, (value - quantile * std, value + quantile * std), None)
