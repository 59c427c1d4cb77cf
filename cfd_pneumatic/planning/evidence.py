# SPDX-License-Identifier: Apache-2.0
"""
Predict what a recording determines, from the scalar products of its signatures.

The definitions are those of the identification. An effect is visible by the part of its signature that the fitted
parameters cannot compensate (`visibility`). Two effects are alike if the criterion does not decide between them
(`stepwise`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array, Indices
from cfd_pneumatic.identification import SHOWN, TIE, Information
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.model import EFFECTS
from cfd_pneumatic.planning.signatures import Signatures

_SINGULAR = 1e-10  # squared share of a column's size below which the column depends on other columns


@dataclass(frozen=True)
class Evidence:
    """
    Information of a channel of a recording.

    Attributes
    ----------
    signatures
        Signatures of the channel.
    products
        Scalar products of the signatures in units of the noise, shape (fitted + forms, fitted + forms).
    samples
        Number of samples in the products.

    """

    signatures: Signatures
    products: Array
    samples: int

    @lazy_property
    def stds(self) -> Array:
        """Cramer-Rao bounds of the fitted parameters, as shares of the values; infinite if not determined."""
        count = len(self.signatures.fitted)
        normal = self.products[:count, :count]
        determined = np.diag(normal) > 0.0
        variances = np.full(count, np.inf)
        white = Information(normal, None, float(self.samples), self.samples)
        variances[determined] = np.diag(white.covariance(self.samples, np.flatnonzero(determined)))
        return np.asarray(np.sqrt(variances))

    @lazy_property
    def _uncompensated(self) -> Array:
        """Products of the parts of the forms that the fitted parameters cannot compensate, shape (forms, forms)."""
        return _residual_products(self.products, len(self.signatures.fitted))

    @lazy_property
    def _forms_of(self) -> Mapping[str, Indices]:
        effects = np.array([form.effect for form in self.signatures.forms])
        return {effect: np.flatnonzero(effects == effect) for effect in dict.fromkeys(effects.tolist())}

    @lazy_property
    def basic_forms(self) -> Mapping[str, Indices]:
        """Indices of the forms of each effect, without the varied forms."""
        varied = np.array([form.varied for form in self.signatures.forms])
        return {effect: forms[~varied[forms]] for effect, forms in self._forms_of.items()}

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that may be missing."""
        return tuple(self._forms_of)

    @lazy_property
    def visibility(self) -> Mapping[str, Array]:
        """Size of each typical form's uncompensated part over the detectable size, by effect, shape (forms,)."""
        strength = np.array([form.share for form in self.signatures.forms])
        sizes = np.sqrt(np.diag(self._uncompensated) / max(self.samples, 1)) / strength
        return {effect: sizes[forms] / SHOWN for effect, forms in self.basic_forms.items()}

    @lazy_property
    def remaining(self) -> Mapping[str, Mapping[str, Array]]:
        """Share of each form's uncompensated part that no form of a rival effect compensates, by effect and rival."""
        scaled, _ = _scaled(self._uncompensated)
        remaining: dict[str, dict[str, Array]] = {effect: {} for effect in self._forms_of}
        for rival, rival_forms in self._forms_of.items():
            squares = np.diag(scaled) - np.sum(_coordinates(scaled, rival_forms) ** 2, axis=0)
            shares = np.sqrt(np.where(squares > _SINGULAR, squares, 0.0))
            for effect, forms in self.basic_forms.items():
                if effect != rival:
                    remaining[effect][rival] = shares[forms]
        return remaining

    def distinctness(self, effect: str) -> Mapping[str, Array]:
        """
        Return the criterion's preference for each just visible form of an effect over each rival effect.

        The preference is relative to a tie: above 1 the criterion decides for the effect. Additional parameters cost as
        much as in the criterion.
        """
        cost = math.log(max(self.samples, 1))
        return {
            rival: (self.samples * np.log1p((SHOWN * shares) ** 2) + cost * (_unknowns(rival) - _unknowns(effect)))
            / TIE
            for rival, shares in self.remaining[effect].items()
        }


def _unknowns(effect: str) -> int:
    """Return the number of parameters of an effect that a fit searches."""
    return sum(not parameter.choice for parameter in EFFECTS[effect].parameters)


def _scaled(products: Array) -> tuple[Array, Array]:
    """Return the products of columns scaled to size 1, and the sizes; a zero column is not scaled."""
    size = np.sqrt(np.diag(products))
    size[size == 0.0] = 1.0
    return products / np.outer(size, size), size


def _coordinates(scaled: Array, basis: Indices) -> Array:
    """Return the coordinates of columns in the space that the basis columns span, shape (dimensions, columns)."""
    values, vectors = np.linalg.eigh(scaled[np.ix_(basis, basis)])
    kept = values > _SINGULAR * max(float(values[-1]), 1e-300) if basis.size else np.empty(0, np.bool_)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T @ scaled[basis])


def _residual_products(products: Array, basis: int) -> Array:
    """Return the products of the columns' residuals after a projection on the first `basis` columns."""
    scaled, size = _scaled(products)
    coordinates = _coordinates(scaled, np.arange(basis))[:, basis:]
    residual = scaled[basis:, basis:] - coordinates.T @ coordinates
    independent = np.diag(residual) > _SINGULAR  # a smaller residual is a rounding error
    return np.asarray(
        np.where(np.outer(independent, independent), residual, 0.0) * np.outer(size[basis:], size[basis:])
    )


def evidence_of_samples(signatures: Sequence[Signatures], samples: NDArray[np.bool_]) -> list[Evidence]:
    """Return the evidence of each channel from selected samples."""
    count = int(np.count_nonzero(samples))
    return [Evidence(channel, channel.products(samples), count) for channel in signatures]
