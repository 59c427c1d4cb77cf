# SPDX-License-Identifier: Apache-2.0
"""What a model's own unknowns can not make up for."""

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
    The orthogonal complement of a model's Jacobian: small changes of its unknowns leave nothing there.

    Parameters
    ----------
    likelihood, model
        Of which samples, and of which model; what effects change is asked where a model with effects may be.

    """

    def __init__(self, likelihood: Likelihood, model: Model) -> None:
        self.likelihood = likelihood
        self.model = likelihood.channel.limited_for_effects(likelihood.experiments, model)

    @lazy_property
    def simulated(self) -> Array:
        """What the model makes of the samples that count, weighted, shape (n,)."""
        return np.concatenate(self.likelihood.counted(self.likelihood.simulate(self.model)))

    @lazy_property
    def jacobian(self) -> Array:
        """Derivatives by the unknowns as they are searched, weighted, shape (n, k)."""
        unknowns = Unknowns(self.likelihood.channel, self.likelihood.experiments, self.model)
        parts = list(self.likelihood.rows(unknowns, unknowns.start))
        found = np.zeros((sum(rows.shape[1] for rows, _ in parts), len(unknowns.table)))
        first = 0
        for rows, own in parts:
            found[first : first + rows.shape[1], own] = rows[1:].T
            first += rows.shape[1]
        return found

    @lazy_property
    def _basis(self) -> Array:
        size = np.linalg.norm(self.jacobian, axis=0)
        return np.asarray(np.linalg.qr(self.jacobian[:, size > 0.0] / size[size > 0.0])[0])

    @lazy_property
    def residual(self) -> Array:
        """What is left of measured less simulated, weighted, shape (n,)."""
        measured = np.concatenate(self.likelihood.counted([one.measured for one in self.likelihood.experiments]))
        return self.left(measured - self.simulated)

    def left(self, values: Array) -> Array:
        """Return what is left of weighted values, shape (n,) or (n, changes)."""
        left: Array = values - self._basis @ (self._basis.T @ values)
        return left

    def changes(self, effect: str, starts: Sequence[Start]) -> Array:
        """Return by what an effect with some parameters changes the simulation, weighted, shape (n, starts)."""
        beside = [replace(self.model, effects={**self.model.effects, effect: own}) for own in starts]
        together = self.likelihood.channel.simulate(self.likelihood.experiments, beside)
        columns = [self.likelihood.counted([one[:, rank] for one in together]) for rank in range(len(starts))]
        return np.column_stack([np.concatenate(runs) for runs in columns]) - self.simulated[:, None]

    def share(self, effect: str, starts: Sequence[Start]) -> float:
        """Return what share of the residual's sum of squares an effect may take, by all of its starts together."""
        changes = self.left(self.changes(effect, starts))
        size = np.linalg.norm(changes, axis=0)
        telling = np.isfinite(size) & (size > 0.0)
        if not telling.any():
            return 0.0
        scaled = changes[:, telling] / size[telling]
        along = orthonormal(scaled.T @ scaled, LEAST_INDEPENDENT_CHANGE).T @ (scaled.T @ self.residual)
        return float(along @ along) / max(float(self.residual @ self.residual), LEAST_DIVISOR)
