"""
Which physical effects a recording shows that the paper's model lacks.

How effects are judged stands in `judgement`; here is how a cylinder's pressure is fitted with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.extension import Effects, Extension, extend
from cfd_pneumatic.identification.judgement import EffectSearch, Found
from cfd_pneumatic.identification.noise import precision, pressure_noise, sample_noise
from cfd_pneumatic.identification.residuals import Test, residual_tests
from cfd_pneumatic.identification.split import PARTS
from cfd_pneumatic.identification.starts import starting_data
from cfd_pneumatic.identification.threads import threads
from cfd_pneumatic.model.effects import PRESSURE_EFFECTS, Data, Effect

Array = NDArray[np.float64]

_REFINED = 2  # of an effect's starts
_PROMISING = 4  # effects that are fitted to the end at least
_STRONG = 5.0  # in sample noises: a residual that may have led the gains astray
_QUICKER = 5.0
_SLOWEST_RELIEF, _USUAL_RELIEF = 0.1, 0.25  # K_v over K_sv; the paper's tables have 0.15 to 0.3
_ROUGH = (1e-2, 5)  # tolerance and evaluations from each start
_FINE = (1e-5, 20)


@dataclass(frozen=True)
class _Model:
    """The model with some effects, fitted to the train part."""

    extension: Extension
    simulated: list[Array]
    residuals: tuple[Array, ...]

    @property
    def effects(self) -> Effects:
        return self.extension.effects

    @property
    def rss(self) -> float:
        return float(sum(residual @ residual for residual in self.residuals))

    @property
    def unknowns(self) -> int:
        return self.extension.unknowns


class Search(EffectSearch[_Model]):
    """The search for missing effects in the recordings of one cylinder."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        baseline: Extension,
        ambient_pressure: float,
        library: Mapping[str, Effect] = PRESSURE_EFFECTS,
    ) -> None:
        self.ambient_pressure = ambient_pressure
        self.library = library
        self.train = [one.until('train') for one in experiments]
        self.learn = [one.until('validation') for one in experiments]
        self.masks = [one.part == PARTS.index('train') for one in self.train]
        super().__init__(list(library), sum(int(mask.sum()) for mask in self.masks))
        simulated = baseline.simulate(self.train, ambient_pressure)
        self.weights = [precision(one, pressure) for one, pressure in zip(self.train, simulated)]
        self.noise = math.sqrt(
            sum(sample_noise(one.sample_times, one.pressure) ** 2 for one in self.train) / len(self.train)
        )
        self.baseline = self._fit(baseline, {}, *_FINE)

    def _fit(self, begin: Extension, effects: Effects, tolerance: float, evaluations: int) -> _Model:
        found = extend(
            self.train, self.masks, self.ambient_pressure, begin, effects, self.weights, tolerance, evaluations
        )
        simulated = found.simulate(self.train, self.ambient_pressure)
        if not all(np.all(np.isfinite(pressure)) for pressure in simulated):  # it ran away: as if it were not there
            absent = {name: begin.effects.get(name, self.library[name].null) for name in effects}
            found = replace(begin, effects=absent, unknowns=found.unknowns)
            simulated = found.simulate(self.train, self.ambient_pressure)
        residuals = tuple(
            ((one.pressure - pressure) * weight)[mask]
            for one, pressure, weight, mask in zip(self.train, simulated, self.weights, self.masks)
        )
        return _Model(found, simulated, residuals)

    def extensions(self, model: _Model, names: Sequence[str]) -> dict[str, _Model]:
        """
        Return a model with each of some effects beside its own.

        All are fitted roughly, from every start; the more promising half is fitted to the end.
        """
        data = starting_data(self.train, model.extension, model.simulated, self.ambient_pressure)
        with ThreadPoolExecutor(max_workers=threads()) as pool:  # simulations let other threads run
            rough = dict(zip(names, pool.map(lambda name: self._rough(model, name, data), names)))
            promising = sorted(names, key=lambda name: rough[name][0].rss)[: max(_PROMISING, len(names) // 2)]
            fine = dict(zip(promising, pool.map(lambda name: self._fine(rough[name]), promising)))
        return {name: fine.get(name, rough[name][0]) for name in names}

    def _rough(self, model: _Model, name: str, data: Data) -> list[_Model]:
        """Return a model with one more effect as rough fits from each start leave it, the best first."""
        fits = [
            self._fit(begin, {**model.effects, name: start}, *_ROUGH)
            for begin in self._beginnings(model)
            for start in self.library[name].starts(data)
        ]
        return sorted(fits, key=lambda one: one.rss)

    def _fine(self, rough: Sequence[_Model]) -> _Model:
        """Return the best of a few rough fits, fitted to the end."""
        fits = [self._fit(one.extension, one.effects, *_FINE) for one in rough[:_REFINED]]
        return min(fits, key=lambda one: one.rss)

    def _beginnings(self, model: _Model) -> list[Extension]:
        """Return where the gains may start from: an effect that is not in the model may have led them astray."""
        beginnings = [model.extension]
        k_x, k_sv, k_v, tau = model.extension.gains
        if model.rss > self.samples * (_STRONG * self.noise) ** 2:
            quicker = np.array([k_x, _QUICKER * k_sv, _QUICKER * k_v, tau / _QUICKER])
            beginnings.append(replace(model.extension, gains=quicker))
        if not _SLOWEST_RELIEF * k_sv <= k_v <= k_sv:
            balanced = np.array([k_x, k_sv, _USUAL_RELIEF * k_sv, tau])
            beginnings.append(replace(model.extension, gains=balanced))
        return beginnings

    def without(self, model: _Model, name: str) -> _Model:
        """Return a model with one effect less."""
        fewer = {other: own for other, own in model.effects.items() if other != name}
        return self._fit(model.extension, fewer, *_FINE)

    def resting_colour(self, model: _Model) -> Array:
        """Return the colour of the noise at rest, as a model leaves it."""
        return pressure_noise(self.train, model.simulated, model.extension.gains[0]).colour

    def validation_rmse(self, model: _Model) -> float | None:
        """Return a model's error on the validation part [Pa]; None where there is no such part."""
        pressures = model.extension.simulate(self.learn, self.ambient_pressure)
        errors = np.concatenate(
            [
                (pressure - one.pressure)[one.part == PARTS.index('validation')]
                for one, pressure in zip(self.learn, pressures)
            ]
        )
        return math.sqrt(float(np.mean(errors**2))) if errors.size else None

    def run(self) -> Found[_Model]:
        """Return the effects that were found."""
        return self.search(self.baseline)

    def residual_tests(self, model: _Model) -> list[Test]:
        """Return the tests of what a model leaves of train and validation."""
        simulated = model.extension.simulate(self.learn, self.ambient_pressure)
        noise = pressure_noise(self.learn, simulated, model.extension.gains[0])
        masks = [np.ones(one.pressure.size, dtype=np.bool_) for one in self.learn]
        return residual_tests(self.learn, simulated, masks, noise)
