# SPDX-License-Identifier: Apache-2.0
"""
What a recording tells, from the scalar products of its signatures.

The notions are the identification's: an effect shows by what the model's own parameters can't make up for
(`visibility`), and two effects are alike where the criterion would not decide between them (`stepwise`).
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

_SINGULAR = 1e-10  # share of a combination's size, squared, below which it is another's


@dataclass(frozen=True)
class Evidence:
    """
    What one channel of a recording tells.

    Attributes
    ----------
    signatures
        Whose products these are.
    products
        Scalar products of the signatures in units of the noise, shape (own + forms, own + forms).
    samples
        How many samples they are over.

    """

    signatures: Signatures
    products: Array
    samples: int

    @lazy_property
    def stds(self) -> Array:
        """Cramer-Rao bounds of what is fitted anyway, as shares of the values; infinite where nothing tells it."""
        own = len(self.signatures.own)
        normal = self.products[:own, :own]
        determined = np.diag(normal) > 0.0
        variances = np.full(own, np.inf)
        white = Information(normal, None, float(self.samples), self.samples)
        variances[determined] = np.diag(white.covariance(self.samples, np.flatnonzero(determined)))
        return np.asarray(np.sqrt(variances))

    @lazy_property
    def _beside_own(self) -> Array:
        """Products of what the forms leave beside what is fitted anyway, shape (forms, forms)."""
        return _left(self.products, len(self.signatures.own))

    @lazy_property
    def _forms_of(self) -> Mapping[str, Indices]:
        effects = np.array([form.effect for form in self.signatures.forms])
        return {effect: np.flatnonzero(effects == effect) for effect in dict.fromkeys(effects.tolist())}

    @lazy_property
    def asked_of(self) -> Mapping[str, Indices]:
        """Forms of each effect but for those that are another one varied."""
        varied = np.array([form.varied for form in self.signatures.forms])
        return {effect: forms[~varied[forms]] for effect, forms in self._forms_of.items()}

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that may be missing."""
        return tuple(self._forms_of)

    @lazy_property
    def visibility(self) -> Mapping[str, Array]:
        """What each form of an effect, typically strong, leaves of itself, over what has to show, shape (forms,)."""
        strength = np.array([form.share for form in self.signatures.forms])
        left = np.sqrt(np.diag(self._beside_own) / max(self.samples, 1)) / strength
        return {effect: left[forms] / SHOWN for effect, forms in self.asked_of.items()}

    @lazy_property
    def remaining(self) -> Mapping[str, Mapping[str, Array]]:
        """Which share of what a form of an effect leaves also remains beside each other effect in all of its forms."""
        scaled, _ = _scaled(self._beside_own)
        found: dict[str, dict[str, Array]] = {effect: {} for effect in self._forms_of}
        for other, others in self._forms_of.items():
            left = np.diag(scaled) - np.sum(_along(scaled, others) ** 2, axis=0)
            shares = np.sqrt(np.where(left > _SINGULAR, left, 0.0))
            for effect, forms in self.asked_of.items():
                if effect != other:
                    found[effect][other] = shares[forms]
        return found

    def distinctness(self, effect: str) -> Mapping[str, Array]:
        """
        Return by how much the criterion would prefer each form of an effect that just shows to each other effect.

        It is over what ties: above 1 the criterion decides between them. A parameter more costs the other one what it
        costs there.
        """
        cost = math.log(max(self.samples, 1))
        return {
            other: (self.samples * np.log1p((SHOWN * shares) ** 2) + cost * (_searched(other) - _searched(effect)))
            / TIE
            for other, shares in self.remaining[effect].items()
        }


def _searched(effect: str) -> int:
    """Return how many parameters of an effect are searched."""
    return sum(not parameter.choice for parameter in EFFECTS[effect].parameters)


def _scaled(products: Array) -> tuple[Array, Array]:
    """Return products of columns scaled to one, and their sizes; a column of nothing stays."""
    size = np.sqrt(np.diag(products))
    size[size == 0.0] = 1.0
    return products / np.outer(size, size), size


def _along(scaled: Array, basis: Indices) -> Array:
    """Return the coordinates of columns along what some of them span, shape (dimensions, columns)."""
    values, vectors = np.linalg.eigh(scaled[np.ix_(basis, basis)])
    kept = values > _SINGULAR * max(float(values[-1]), 1e-300) if basis.size else np.empty(0, np.bool_)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T @ scaled[basis])


def _left(products: Array, basis: int) -> Array:
    """Return the products of what columns leave beside the first `basis` ones."""
    scaled, size = _scaled(products)
    coordinates = _along(scaled, np.arange(basis))[:, basis:]
    left = scaled[basis:, basis:] - coordinates.T @ coordinates
    alone = np.diag(left) > _SINGULAR  # otherwise what is left is rounding
    return np.asarray(np.where(np.outer(alone, alone), left, 0.0) * np.outer(size[basis:], size[basis:]))


def of_samples(signatures: Sequence[Signatures], samples: NDArray[np.bool_]) -> list[Evidence]:
    """Return what some samples of each channel tell."""
    count = int(np.count_nonzero(samples))
    return [Evidence(one, one.products(samples), count) for one in signatures]
