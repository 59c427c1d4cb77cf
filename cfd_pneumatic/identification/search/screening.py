"""What effects may take of a residual, as far as one simulation from each of their starting values tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from cfd_pneumatic.identification.data.experiment import Experiment
from cfd_pneumatic.identification.fit.extension import Extension, simulate_models, tangent

Array = NDArray[np.float64]
Start = tuple[float, ...]

_ALIKE = 1e-3  # part of a change that has to be its own, or it is another start's


class Screening:
    """
    A model's residual, made ready to be held against what effects do.

    What the model's own parameters can make up for, as its Jacobian has them, is neither the residual's nor an
    effect's.

    Parameters
    ----------
    experiments, masks, ambient_pressure, model, weights
        As in `extension.tangent`.

    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        masks: Sequence[NDArray[np.bool_]],
        ambient_pressure: float,
        model: Extension,
        weights: Sequence[Array],
    ) -> None:
        self.experiments = experiments
        self.masks = masks
        self.ambient_pressure = ambient_pressure
        self.model = model
        self.weights = weights
        own = tangent(experiments, masks, ambient_pressure, model, weights)
        size = np.linalg.norm(own.jacobian, axis=0)
        self._basis = np.linalg.qr(own.jacobian[:, size > 0.0] / size[size > 0.0])[0]
        self._residual = self._left(own.residuals)
        measured = [one.pressure for one in experiments]
        self._simulated = own.residuals + self._weighted(measured)

    def share(self, name: str, starts: Sequence[Start]) -> float:
        """Return what share of the residual's sum of squares an effect may take, by all of its starts together."""
        beside = [replace(self.model, effects={**self.model.effects, name: start}) for start in starts]
        pressures = simulate_models(self.experiments, beside, self.ambient_pressure)
        changes = np.column_stack(
            [
                self._left(self._weighted([one[:, rank] for one in pressures]) - self._simulated)
                for rank in range(len(starts))
            ]
        )
        size = np.linalg.norm(changes, axis=0)
        telling = np.isfinite(size) & (size > 0.0)
        if not telling.any():
            return 0.0
        basis, triangle, _ = qr(changes[:, telling] / size[telling], mode='economic', pivoting=True)
        basis = basis[:, np.abs(np.diag(triangle)) > _ALIKE]
        power = max(float(self._residual @ self._residual), 1e-300)
        return float(np.sum((basis.T @ self._residual) ** 2)) / power

    def _weighted(self, pressures: Sequence[Array]) -> Array:
        """Return pressures at the samples that count, weighted, one experiment after the other."""
        parts = zip(pressures, self.weights, self.masks)
        return np.concatenate([(pressure * weight)[mask] for pressure, weight, mask in parts])

    def _left(self, values: Array) -> Array:
        """Return what the model's parameters don't make up for."""
        return values - self._basis @ (self._basis.T @ values)
