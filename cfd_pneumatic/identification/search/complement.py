# SPDX-License-Identifier: Apache-2.0
"""Changes of a simulation that small changes of the model's unknowns cannot compensate for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.identification.channels import Model
from cfd_pneumatic.identification.fit import Likelihood, Unknowns
from cfd_pneumatic.identification.residual import orthonormal
from cfd_pneumatic.identification.search.thresholds import LEAST_DIVISOR, LEAST_INDEPENDENT_CHANGE
from cfd_pneumatic.lazy import lazy_property

Start = tuple[float, ...]


class Complement:
    """
    The orthogonal complement of a model's Jacobian.

    Small changes of the model's unknowns have no component in the complement.

    Parameters
    ----------
    likelihood
        Samples and weights.
    model
        Model of the Jacobian, brought to a state in which effects can be added.

    """

    def __init__(self, likelihood: Likelihood, model: Model) -> None:
        self.likelihood = likelihood
        self.model = likelihood.channel.limited_for_effects(likelihood.experiments, model)

    @lazy_property
    def simulated(self) -> Array:
        """Return the model's simulation at the samples that count, weighted, shape (n,)."""
        return np.concatenate(self.likelihood.counted(self.likelihood.simulate(self.model)))

    @lazy_property
    def jacobian(self) -> Array:
        """Return the derivatives by the unknowns as they are searched, weighted, shape (n, k)."""
        unknowns = Unknowns(self.likelihood.channel, self.likelihood.experiments, self.model)
        parts = list(self.likelihood.rows(unknowns, unknowns.start))
        jacobian = np.zeros((sum(rows.shape[1] for rows, _ in parts), len(unknowns.table)))
        first = 0
        for rows, indices in parts:
            jacobian[first : first + rows.shape[1], indices] = rows[1:].T
            first += rows.shape[1]
        return jacobian

    @lazy_property
    def _basis(self) -> Array:
        size = np.linalg.norm(self.jacobian, axis=0)
        return np.asarray(np.linalg.qr(self.jacobian[:, size > 0.0] / size[size > 0.0])[0])

    @lazy_property
    def residual(self) -> Array:
        """Return the component of the residual in the complement, weighted, shape (n,)."""
        measured = np.concatenate(
            self.likelihood.counted([experiment.measured for experiment in self.likelihood.experiments])
        )
        return self.remainder(measured - self.simulated)

    def remainder(self, values: Array) -> Array:
        """Return the component of weighted values in the complement, shape (n,) or (n, changes)."""
        remainder: Array = values - self._basis @ (self._basis.T @ values)
        return remainder

    def changes(self, effect: str, starts: Sequence[Start]) -> Array:
        """Return by what an effect with some parameters changes the simulation, weighted, shape (n, starts)."""
        models = [replace(self.model, effects={**self.model.effects, effect: start}) for start in starts]
        self.likelihood.effort.add(self.likelihood.effort_of(models[0], len(models)))
        simulations = self.likelihood.channel.simulate(self.likelihood.experiments, models)
        columns = [
            self.likelihood.counted([simulated[:, rank] for simulated in simulations]) for rank in range(len(starts))
        ]
        return np.column_stack([np.concatenate(runs) for runs in columns]) - self.simulated[:, None]

    def explained_share(self, effect: str, starts: Sequence[Start]) -> float:
        """Return the share of the squared residual that an effect can explain, with all of its starts together."""
        changes = self.remainder(self.changes(effect, starts))
        size = np.linalg.norm(changes, axis=0)
        is_usable = np.isfinite(size) & (size > 0.0)
        if not is_usable.any():
            return 0.0
        scaled = changes[:, is_usable] / size[is_usable]
        along = orthonormal(scaled.T @ scaled, LEAST_INDEPENDENT_CHANGE).T @ (scaled.T @ self.residual)
        return float(along @ along) / max(float(self.residual @ self.residual), LEAST_DIVISOR)
