"""Which effects a recording could not have shown, had they been there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.extension import Extension, extend_with_cost, simulate_models, tangent
from cfd_pneumatic.identification.fit.starts import starting_data
from cfd_pneumatic.identification.residual.noise import Noise
from cfd_pneumatic.identification.search.stepwise import SHOWN, STRENGTH
from cfd_pneumatic.model.effects import Effect
from cfd_pneumatic.parallel import each

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PLAIN = 10.0  # times what shows: no fit makes up for so much
_MADE_UP = 2.0  # an effect that loses less than half of itself to the model's parameters keeps what is left
_EXCERPT = 8000  # grid steps of each recording that are asked first
_SURELY = 2.0  # times what shows: what shows in an excerpt shows in the whole
_ROUGH = (1e-2, 10)  # tolerance and evaluations of a fit to what an effect makes


def invisible(
    experiments: Sequence[Experiment],
    masks: Sequence[Mask],
    ambient_pressure: float,
    fitted: Extension,
    simulated: Sequence[Array],
    noise: Noise,
    library: Mapping[str, Effect],
) -> tuple[str, ...]:
    """
    Return the effects that could not have shown themselves beside a model, by their names.

    Each is added at a strength well above the noise. It shows by what the model's own parameters can't make up for:
    by small changes of theirs, as its Jacobian has them, or, as effects are not small, by any.

    Parameters
    ----------
    experiments, masks, ambient_pressure
        As in `extension.extend`.
    fitted, simulated
        A model and its pressures [Pa].
    noise
        Of the pressure.
    library
        Effects to ask for.

    """
    data = {
        **starting_data(experiments, fitted, simulated, ambient_pressure),
        'residual': STRENGTH * noise.std,
        'lag': 0.0,
    }
    shown = SHOWN * noise.std
    whole = _View(experiments, masks, ambient_pressure, fitted)
    excerpt = whole.excerpt(_EXCERPT)

    def shows(name: str) -> bool:
        starts = library[name].starts(data)
        seen_at_once = excerpt is not whole and excerpt.shows(name, starts, _SURELY * shown, asks_a_fit=False)
        return seen_at_once or whole.shows(name, starts, shown)

    names = [name for name in library if name not in fitted.effects]
    return tuple(name for name, visible in zip(names, each(shows, names)) if not visible)


class _View:
    """Experiments in which effects may show beside a model."""

    def __init__(
        self, experiments: Sequence[Experiment], masks: Sequence[Mask], ambient_pressure: float, fitted: Extension
    ) -> None:
        self._experiments = experiments
        self._masks = masks
        self._ambient_pressure = ambient_pressure
        self._fitted = fitted
        self._weights = [np.ones_like(one.pressure) for one in experiments]

    @cached_property
    def _simulated(self) -> list[Array]:
        return self._fitted.simulate(self._experiments, self._ambient_pressure)

    @cached_property
    def _basis(self) -> Array:
        """What the model's parameters make up for by small changes."""
        own = tangent(self._experiments, self._masks, self._ambient_pressure, self._fitted, self._weights).jacobian
        size = np.linalg.norm(own, axis=0)
        return np.asarray(np.linalg.qr(own[:, size > 0.0] / size[size > 0.0])[0])

    def excerpt(self, steps: int) -> _View:
        """Return the liveliest part, itself where it has no more steps."""
        if max(one.times.size for one in self._experiments) <= steps:
            return self
        experiments, samples = zip(*(one.liveliest(steps, mask) for one, mask in zip(self._experiments, self._masks)))
        masks = [mask[part] for mask, part in zip(self._masks, samples)]
        return _View(experiments, masks, self._ambient_pressure, self._fitted) if any(map(np.any, masks)) else self

    def shows(self, name: str, starts: Sequence[tuple[float, ...]], least: float, *, asks_a_fit: bool = True) -> bool:
        """Return whether an effect leaves more than so much [Pa] of itself; a fit is asked where that isn't plain."""
        beside = [replace(self._fitted, effects={**self._fitted.effects, name: start}) for start in starts]
        together = simulate_models(self._experiments, beside, self._ambient_pressure)
        pressures = [[one[:, rank] for one in together] for rank in range(len(beside))]
        changes = [_masked(one, self._simulated, self._masks) for one in pressures]
        left = [_rms(change - self._basis @ (self._basis.T @ change)) for change in changes]
        if any(
            own > least and (own > _PLAIN * least or _rms(change) < _MADE_UP * own)
            for own, change in zip(left, changes)
        ):
            return True
        return asks_a_fit and any(own > least and self._remains(one, least) for own, one in zip(left, pressures))

    def _remains(self, pressures: Sequence[Array], least: float) -> bool:
        """Return whether more than so much of what was simulated is left when the model is fitted to it."""
        made = [replace(one, pressure=pressure) for one, pressure in zip(self._experiments, pressures)]
        model = self._fitted
        little = least**2 * sum(np.count_nonzero(mask) for mask in self._masks)
        _, left = extend_with_cost(
            made, self._masks, self._ambient_pressure, model, model.effects, self._weights, *_ROUGH, enough=little
        )
        return left > little


def _masked(ones: Sequence[Array], others: Sequence[Array], masks: Sequence[Mask]) -> Array:
    """Return the differences of pressures at the samples that count, one experiment after the other."""
    return np.concatenate([(one - other)[mask] for one, other, mask in zip(ones, others, masks)])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
