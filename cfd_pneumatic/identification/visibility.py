"""Which effects a recording could not have shown, had they been there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.identification.experiment import Experiment
from cfd_pneumatic.identification.extension import Extension, tangent
from cfd_pneumatic.identification.noise import Noise
from cfd_pneumatic.identification.starts import starting_data
from cfd_pneumatic.model.effects import Effect

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STRENGTH = 5.0  # in standard deviations of the noise: what an effect's starting values are drawn for
_SHOWN = 0.57  # of the noise: what raises the error by 15 %


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

    Each is added at a strength well above the noise; what the model's own parameters can't make up for is its sight.

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
        'residual': _STRENGTH * noise.std,
        'lag': 0.0,
    }
    weights = [np.ones_like(one.pressure) for one in experiments]
    jacobian = tangent(experiments, masks, ambient_pressure, fitted, weights).jacobian
    size = np.linalg.norm(jacobian, axis=0)
    basis = np.linalg.qr(jacobian[:, size > 0.0] / size[size > 0.0])[0]

    def sight(name: str, start: tuple[float, ...]) -> float:
        beside = replace(fitted, effects={**fitted.effects, name: start})
        pressures = beside.simulate(experiments, ambient_pressure)
        change = np.concatenate([(new - old)[mask] for new, old, mask in zip(pressures, simulated, masks)])
        left = change - basis @ (basis.T @ change)
        return float(np.sqrt(np.mean(left**2)))

    return tuple(
        name
        for name, effect in library.items()
        if name not in fitted.effects
        and not any(sight(name, start) > _SHOWN * noise.std for start in effect.starts(data))
    )
