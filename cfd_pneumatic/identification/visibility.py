"""Which effects a recording could not have shown, had they been there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.extension import Extension, extend, simulate_models, tangent
from cfd_pneumatic.identification.judgement import SHOWN, STRENGTH
from cfd_pneumatic.identification.noise import Noise
from cfd_pneumatic.identification.starts import starting_data
from cfd_pneumatic.model.effects import Effect
from cfd_pneumatic.parallel import each

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PLAIN = 10.0  # times what shows: no fit makes up for so much
_MADE_UP = 2.0  # an effect that loses less than half of itself to the model's parameters keeps what is left
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
    weights = [np.ones_like(one.pressure) for one in experiments]
    jacobian = tangent(experiments, masks, ambient_pressure, fitted, weights).jacobian
    size = np.linalg.norm(jacobian, axis=0)
    basis = np.linalg.qr(jacobian[:, size > 0.0] / size[size > 0.0])[0]

    shown = SHOWN * noise.std

    def shows(name: str) -> bool:
        beside = [replace(fitted, effects={**fitted.effects, name: start}) for start in library[name].starts(data)]
        pressures = simulate_models(experiments, beside, ambient_pressure)
        starts = [[of_all[:, rank] for of_all in pressures] for rank in range(len(beside))]
        changes = [_masked(start, simulated, masks) for start in starts]
        left = [_rms(change - basis @ (basis.T @ change)) for change in changes]
        if any(
            own > shown and (own > _PLAIN * shown or _rms(change) < _MADE_UP * own)
            for own, change in zip(left, changes)
        ):
            return True
        return any(own > shown and remains(start) for own, start in zip(left, starts))

    def remains(pressures: Sequence[Array]) -> bool:
        made = [replace(one, pressure=pressure) for one, pressure in zip(experiments, pressures)]
        without = extend(made, masks, ambient_pressure, fitted, fitted.effects, weights, *_ROUGH)
        return _rms(_masked(pressures, without.simulate(made, ambient_pressure), masks)) > shown

    names = [name for name in library if name not in fitted.effects]
    return tuple(name for name, visible in zip(names, each(shows, names)) if not visible)


def _masked(ones: Sequence[Array], others: Sequence[Array], masks: Sequence[Mask]) -> Array:
    """Return the differences of pressures at the samples that count, one experiment after the other."""
    return np.concatenate([(one - other)[mask] for one, other, mask in zip(ones, others, masks)])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
