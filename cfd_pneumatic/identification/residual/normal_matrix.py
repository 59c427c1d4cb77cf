# SPDX-License-Identifier: Apache-2.0
"""The Gram matrix, computed by one thread (a library would wake further threads that have other work)."""

from __future__ import annotations

import numpy as np

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.model import summed


def gram(rows: Array) -> Array:
    """Return the Gram matrix of rows, shape (k, n): their inner products, shape (k, k)."""
    products = np.empty((len(rows), len(rows)))
    _write_products(rows, products)
    return products


@summed
def _write_products(rows: Array, products: Array) -> None:
    """Write the inner products into an array: to make the array here would load a part of the compiler, 20 ms."""
    for row in range(len(rows)):
        for column in range(row + 1):
            total = 0.0
            for sample in range(rows.shape[1]):
                total += rows[row, sample] * rows[column, sample]
            products[row, column] = products[column, row] = total


def orthonormal(products: Array, least: float) -> Array:
    """
    Return orthonormal combinations of columns, from their inner products, shape (k, rank).

    Combinations with a singular value below `least` times the largest are omitted.
    """
    powers, directions = np.linalg.eigh(products)
    is_independent = powers > least**2 * powers[-1]
    return np.asarray(directions[:, is_independent] / np.sqrt(powers[is_independent]))
