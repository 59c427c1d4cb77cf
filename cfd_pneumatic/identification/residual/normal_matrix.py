# SPDX-License-Identifier: Apache-2.0
"""The Gram matrix, by one thread (a library would wake others, which have work of their own), and what it tells."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model import summed


def gram(rows: Array) -> Array:
    """Return the Gram matrix of rows, shape (k, n): their inner products, shape (k, k)."""
    found = np.empty((len(rows), len(rows)))
    _multiply(rows, found)
    return found


@summed
def _multiply(rows: Array, found: Array) -> None:
    """Write the inner products; code that makes an array loads a part of the compiler, which takes 20 ms."""
    for one in range(len(rows)):
        for other in range(one + 1):
            total = 0.0
            for sample in range(rows.shape[1]):
                total += rows[one, sample] * rows[other, sample]
            found[one, other] = found[other, one] = total


def orthonormal(products: Array, least: float) -> Array:
    """
    Return orthonormal combinations of columns, whose inner products are given, shape (k, rank).

    Left out are those whose singular value is less than so much of the largest.
    """
    powers, directions = np.linalg.eigh(products)
    apart = powers > least**2 * powers[-1]
    return np.asarray(directions[:, apart] / np.sqrt(powers[apart]))
