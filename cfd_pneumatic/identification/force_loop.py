"""
Closing the loop on the contact force: what area times pressure lacks, added to it, and the error before and after.

As in `loop`, but on the force, with the measured pressures as its input. Of area and geometric factor only the product
shows: the factor is held as given, and so is the area where all recordings have one set-point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cfd_pneumatic.identification.data.force_experiment import ForceExperiment
from cfd_pneumatic.identification.data.split import PARTS
from cfd_pneumatic.identification.fit.force import (
    Effects,
    ForceFit,
    fit_force,
    hold_several_levels,
    likely_area,
    starting_force_data,
)
from cfd_pneumatic.identification.fit.output_error import Estimate
from cfd_pneumatic.identification.held_out import contradiction
from cfd_pneumatic.identification.residual.autoregression import autoregression, independent_share
from cfd_pneumatic.identification.residual.noise import Noise, noise_of, rounding_step, runs_at_rest, sample_noise
from cfd_pneumatic.identification.residual.regressors import Regressors
from cfd_pneumatic.identification.residual.tests import Test, explained, tests_of
from cfd_pneumatic.identification.search.stepwise import SHOWN, STRENGTH, EffectSearch, Found, Trial
from cfd_pneumatic.identification.verdict import (
    Conclusion,
    PartError,
    compared,
    next_experiment,
    not_added,
    part_errors,
    shortage_of,
    verdict_of,
)
from cfd_pneumatic.model.effects import FORCE_EFFECTS, Effect
from cfd_pneumatic.model.effects.moving_mass import GRAVITY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROUGH = (1e-3, 8)  # tolerance and steps of the search from each start
_FINE = (1e-6, 30)
_FINEST = (1e-8, 60)
_IMMATERIAL = 1e-4  # share of the force's span below which nothing is looked for: simulated forces have no noise
_CONSTANT = ('force_offset',)  # effects that another area is as good as, at one set-point
_SMOOTHED = 25  # samples
_AHEAD = 5  # samples before a stroke into which its smoothed acceleration reaches
_SLOW = 0.05  # share of the speed's spread at which the piston stands, as far as friction goes
_TIED = 3.2  # standard errors: by so much the criterion tells as little as between tied effects


@dataclass(frozen=True)
class ForceClosure(Conclusion):
    """
    What came of closing the loop on the contact force.

    Attributes
    ----------
    fit
        Area and the effects that were found, fitted to train and validation.
    before, after
        Error on each part that has samples, by its name, without and with effects [N].
    experiments
        The recordings made ready for the model.
    simulated_before, simulated
        Force without and with effects at each experiment's samples [N].
    noise_floor
        Standard deviation that measurement noise alone gives the residual [N].

    """

    fit: ForceFit
    before: Mapping[str, PartError]
    after: Mapping[str, PartError]
    experiments: tuple[ForceExperiment, ...]
    simulated_before: tuple[Array, ...]
    simulated: tuple[Array, ...]
    noise_floor: float


def close_force_loop(
    experiments: Sequence[ForceExperiment],
    ambient_pressure: float,
    area: float | None,
    factor: float = 1.0,
    library: Mapping[str, Effect] = FORCE_EFFECTS,
) -> ForceClosure:
    """
    Close the loop on the contact force.

    Parameters
    ----------
    experiments
        What was measured.
    ambient_pressure
        Absolute [Pa].
    area
        About how large the piston is [m^2], held where the recordings have one set-point; None if nobody knows: then it
        is held there at what makes the force with the sensor's zero taken to be right.
    factor
        Contact force over piston force, from the linkage [-].
    library
        Effects to choose from.

    Raises
    ------
    InputError
        If the force falls with the pressure.

    """
    masks = [one.fitted for one in experiments]
    measured, parts = [one.force for one in experiments], [one.part for one in experiments]
    search = ForceSearch(experiments, ambient_pressure, area, factor, library)
    fitting = _Fitting(experiments, masks, ambient_pressure, area, factor)
    plain = fitting.fit({}, *_FINEST, estimated=True)
    before = tuple(force_residual_tests(experiments, plain.simulated, masks))
    shortage = shortage_of(parts)
    fit, alternatives, tried = plain, dict[str, tuple[str, ...]](), tuple[Trial, ...]()
    if shortage is None and not explained(before):
        found = search.run()
        tried = found.tried
        if found.model.effects:
            fit = fitting.fit(found.model.effects, *_FINEST, estimated=True)
            alternatives = dict(found.alternatives)
            if 'force_offset' in fit.effects and 'moving_mass' in library and _may_be_weight(fitting, fit):
                alternatives['force_offset'] = ('moving_mass',)
    ratio, interval = compared(measured, plain.simulated, fit.simulated, parts) if fit.effects else (None, None)
    against: list[str] = []
    if ratio is not None and interval is not None and ratio >= 1.0:
        clause, tried = not_added(list(fit.effects), ratio, interval, tried)
        against.append(clause)
        fit, alternatives, ratio, interval = plain, {}, None, None
    after = tuple(force_residual_tests(experiments, fit.simulated, masks)) if fit.effects else before
    noise = force_noise(experiments, fit.simulated)
    hidden = () if shortage else _invisible(fitting, fit, noise, library)
    against += contradiction(experiments, fit.residuals(experiments), noise.std)
    verdict, why = verdict_of(list(fit.effects), alternatives, after, shortage, ratio, interval, against)
    return ForceClosure(
        verdict=verdict,
        why=why,
        effects=tuple(fit.effects),
        fit=fit,
        estimates=_estimates(fit),
        alternatives=alternatives,
        tried=tried,
        before=part_errors(measured, plain.simulated, parts),
        after=part_errors(measured, fit.simulated, parts),
        experiments=tuple(experiments),
        simulated_before=plain.simulated,
        simulated=fit.simulated,
        ratio=ratio,
        ratio_interval=interval,
        tests_before=before,
        tests_after=after,
        noise_floor=noise.std,
        not_visible=hidden,
        next_experiment=next_experiment(hidden, library, shortage),
    )


class _Fitting:
    """Fits of the force to one part of the experiments."""

    def __init__(
        self,
        experiments: Sequence[ForceExperiment],
        masks: Sequence[Mask],
        ambient_pressure: float,
        area: float | None,
        factor: float,
    ) -> None:
        self.experiments = experiments
        self.masks = masks
        self.ambient_pressure = ambient_pressure
        self.factor = factor
        self.area_is_told = area is not None or hold_several_levels(experiments, masks)
        self.area = area if self.area_is_told else likely_area(experiments, masks, factor)

    def may_tell(self, effect: str) -> bool:
        """Return whether these recordings may tell an effect from the area's doing."""
        return self.area_is_told or effect not in _CONSTANT

    def fit(self, effects: Effects, tolerance: float, steps: int, *, estimated: bool = False) -> ForceFit:
        """Return the best fit that is found from an area and effects with starting values."""
        return fit_force(
            self.experiments,
            self.masks,
            self.ambient_pressure,
            self.area,
            self.factor,
            effects,
            tolerance,
            steps,
            estimated=estimated,
        )

    def simulate(self, fit: ForceFit, effects: Effects) -> list[Array]:
        """Return the force of a fit with other effects at the samples that count [N]."""
        model = replace(fit, effects=effects).model(self.ambient_pressure)
        return [
            one.simulate(model, stretch)[mask]
            for one, stretch, mask in zip(self.experiments, fit.stretches, self.masks)
        ]


@dataclass(frozen=True)
class _Model:
    """Area times pressure with some effects, fitted to the train part."""

    fit: ForceFit
    residuals: tuple[Array, ...]

    @property
    def effects(self) -> Effects:
        return self.fit.effects

    @property
    def rss(self) -> float:
        return self.fit.cost

    @property
    def unknowns(self) -> int:
        return self.fit.unknowns


class ForceSearch(EffectSearch[_Model]):
    """The search for missing effects in the force of some recordings."""

    def __init__(
        self,
        experiments: Sequence[ForceExperiment],
        ambient_pressure: float,
        area: float | None,
        factor: float,
        library: Mapping[str, Effect],
    ) -> None:
        learn = [one.until('validation') for one in experiments if np.any(one.fitted)]
        masks = [one.part == PARTS.index('train') for one in learn]
        self.experiments = learn
        self.library = library
        self.fitting = _Fitting(learn, masks, ambient_pressure, area, factor)
        super().__init__(
            [name for name in library if self.fitting.may_tell(name)], sum(int(mask.sum()) for mask in masks)
        )

    def run(self) -> Found[_Model]:
        """Return the effects that were found."""
        return self.search(self._fitted({}, *_FINE))

    def _fitted(self, effects: Effects, tolerance: float, steps: int) -> _Model:
        fit = self.fitting.fit(effects, tolerance, steps)
        left = fit.residuals(self.experiments)
        return _Model(fit, tuple(residual[mask] for residual, mask in zip(left, self.fitting.masks)))

    def extensions(self, model: _Model, names: Sequence[str]) -> dict[str, _Model]:
        """Return a model with one more effect, from the best of its starts, for each of some names."""
        data = starting_force_data(self.experiments, model.fit, self.fitting.ambient_pressure)
        blurred = 'moving_mass' in model.effects and not _resolve_acceleration(self.experiments)
        extended = {}
        for name in names:
            if blurred and name not in _CONSTANT:
                continue  # what unresolved inertia leaves behind looks like friction
            starts = [{**model.effects, name: start} for start in self.library[name].starts(data)]
            rough = [self._fitted(start, *_ROUGH) for start in starts]
            extended[name] = self._fitted(min(rough, key=lambda one: one.rss).effects, *_FINE)
        return extended

    def without(self, model: _Model, name: str) -> _Model:
        """Return a model with one effect less."""
        return self._fitted({other: own for other, own in model.effects.items() if other != name}, *_FINE)

    def validation_rmse(self, model: _Model) -> float | None:
        """Return a model's error on the validation part [N]; None where there is no such part."""
        errors = np.concatenate(
            [
                residual[one.part == PARTS.index('validation')]
                for one, residual in zip(self.experiments, model.fit.residuals(self.experiments))
            ]
        )
        return math.sqrt(float(np.mean(errors**2))) if errors.size else None

    def resting_colour(self, model: _Model) -> Array:
        """Return the colour of the noise at rest."""
        return force_noise(self.experiments, model.fit.simulated).colour

    def residual_tests(self, model: _Model) -> list[Test]:
        """Return the tests of what a model leaves of train and validation."""
        masks = [np.ones(one.force.size, dtype=np.bool_) for one in self.experiments]
        return force_residual_tests(self.experiments, model.fit.simulated, masks)


def force_noise(experiments: Sequence[ForceExperiment], simulated: Sequence[Array]) -> Noise:
    """
    Return the noise of the force beside the area times the noise of the pressures, from the rests where there are some.

    What is less than a ten-thousandth of the force's span is taken for rounding: a simulated force has no noise at all.

    Parameters
    ----------
    experiments
        What was measured.
    simulated
        Force by a model, which at rest need not be right but for a level and a trend [N].

    """
    residuals = [one.force - force for one, force in zip(experiments, simulated)]
    rests = [
        rest[:-_AHEAD] - np.mean(rest[:-_AHEAD])
        for one, residual in zip(experiments, residuals)
        for rest in runs_at_rest(one.sample_times, one.displacement[one.samples], one.level, 0.0, residual)
    ]
    variances = [sample_noise(one.sample_times, residual) ** 2 for one, residual in zip(experiments, residuals)]
    sizes = [residual.size for residual in residuals]
    rounding = [rounding_step(one.force) ** 2 / 12.0 + (_IMMATERIAL * np.ptp(one.force)) ** 2 for one in experiments]
    white = math.sqrt(float(np.average(variances, weights=sizes)))
    return noise_of(rests, white, sum(sizes), math.sqrt(float(np.mean(rounding))))


def force_residual_tests(
    experiments: Sequence[ForceExperiment], simulated: Sequence[Array], masks: Sequence[Mask]
) -> list[Test]:
    """
    Return the tests of measured less simulated force.

    Parameters
    ----------
    experiments, masks
        As in `force.fit_force`; the samples of a mask follow each other.
    simulated
        Force at the samples of each experiment [N].

    """
    used = [index for index, mask in enumerate(masks) if np.any(mask)]
    residuals = [(experiments[index].force - simulated[index])[masks[index]] for index in used]
    regressors = [_regressors(experiments[index], masks[index]) for index in used]
    return tests_of(residuals, regressors, force_noise(experiments, simulated))


def _regressors(experiment: ForceExperiment, mask: Mask) -> Regressors:
    """Return what the residual may depend on: motion, pressures and their products."""
    at = experiment.samples
    x, rate, acceleration = experiment.displacement[at], experiment.rate[at], experiment.acceleration[at]
    # smoothed: the noise of the pressures, which the residual has in it, would pass for a dependence on them
    difference = uniform_filter1d(experiment.difference, _SMOOTHED, mode='nearest')
    gauge = uniform_filter1d((experiment.pressure + experiment.opposing)[at], _SMOOTHED, mode='nearest')
    change = np.gradient(difference)
    centred = (x - np.mean(x)) / max(float(np.std(x)), 1e-12)
    level = difference - np.mean(difference)
    direction = np.sign(rate) * (np.abs(rate) > _SLOW * np.std(rate))
    lagged = [rate, direction, np.abs(direction), acceleration]
    once = [
        x,
        difference,
        gauge,
        change,
        centred * rate,
        centred * difference,
        gauge * direction,
        gauge * rate,
        x * x,
        level * level,
    ]
    once += [rate * np.abs(rate), np.abs(acceleration), centred * direction]
    return Regressors(once, lagged, np.ones_like(x), int(np.argmax(mask)), int(np.count_nonzero(mask)))


def _invisible(fitting: _Fitting, fit: ForceFit, noise: Noise, library: Mapping[str, Effect]) -> tuple[str, ...]:
    """
    Return the effects that could not have shown themselves beside a fit, by their names.

    Each is added at a strength well above the noise. It shows by what the other unknowns can't make up for, as the
    Jacobian has them: the force is linear in most of them.
    """
    strength = STRENGTH * noise.std
    data = {
        **starting_force_data(fitting.experiments, fit, fitting.ambient_pressure),
        'force_residual': strength,
        'force_mean': strength,
    }

    def shows(name: str, start: tuple[float, ...]) -> bool:
        if not fitting.may_tell(name):
            return False
        left = _beside(fitting, fit, {**fit.effects, name: start})
        return math.sqrt(float(np.mean(left**2))) > SHOWN * noise.std

    return tuple(
        name
        for name, effect in library.items()
        if name not in fit.effects and not any(shows(name, start) for start in effect.starts(data))
    )


def _may_be_weight(fitting: _Fitting, fit: ForceFit) -> bool:
    """
    Return whether a force offset may be the weight of a mass on an incline, whose inertia would not have shown.

    A weight is a constant, as an offset is: the mass is at least as large as the offset takes on the steepest incline.
    """
    least = abs(fit.effects['force_offset'][0]) / GRAVITY
    if 'moving_mass' in fit.effects:
        (mass,) = (one for one in fit.estimates if one.name == 'moving_mass.mass')
        return mass.value is None or mass.std is None or least <= mass.value + _TIED * mass.std
    inertia = _beside(fitting, fit, {**fit.effects, 'moving_mass': (1.0, 0.0)})
    residuals = [residual[mask] for residual, mask in zip(fit.residuals(fitting.experiments), fitting.masks)]
    independent = independent_share(autoregression(residuals))
    size, together = float(np.linalg.norm(inertia)), np.concatenate(residuals)
    if size == 0.0 or not _resolve_acceleration(fitting.experiments):
        return True
    std = math.sqrt(float(np.mean(together**2)) / independent) / size
    return least <= float(inertia @ together) / size**2 + _TIED * std


def _resolve_acceleration(experiments: Sequence[ForceExperiment]) -> bool:
    return any(one.resolves_acceleration for one in experiments)


def _beside(fitting: _Fitting, fit: ForceFit, effects: Effects) -> Array:
    """Return by what other effects change the force of a fit that its own unknowns can't make up for [N]."""
    size = np.linalg.norm(fit.jacobian, axis=0)
    basis = np.linalg.qr(fit.jacobian[:, size > 0.0] / size[size > 0.0])[0]
    change = np.concatenate(fitting.simulate(fit, effects)) - np.concatenate(fitting.simulate(fit, fit.effects))
    left: Array = change - basis @ (basis.T @ change)
    return left


def _estimates(fit: ForceFit) -> tuple[Estimate, ...]:
    """Return what was fitted, and that the factor wasn't."""
    reason = f'only its product with the area shows: it is held at {fit.factor:g}'
    factor = Estimate('geometric_factor', '-', None, None, None, reason)
    rank = sum(estimate.name == 'area' for estimate in fit.estimates)
    return (*fit.estimates[:rank], factor, *fit.estimates[rank:])
