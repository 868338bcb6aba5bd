"""Products of small matrices whose bits no BLAS decides.

`@` hands arrays to the BLAS that NumPy was built with, which sums in another order, or with fused
operations, on another processor. What must have the same bits on any of them uses these instead.
"""

from __future__ import annotations

import math

import numpy as np

from primfit._check import Floats


def dots(rows: Floats, vector: Floats) -> Floats:
    """Dot product of each row (n, k) with a vector (k,)."""
    return np.einsum("nk,k->n", rows, vector)


def dot(a: Floats, b: Floats) -> float:
    """Dot product of two vectors (k,)."""
    return math.fsum((a * b).tolist())


def product(a: Floats, b: Floats) -> Floats:
    """Matrix product (n, m) of (n, k) and (k, m)."""
    return np.einsum("nk,km->nm", a, b)


def lengths_of(vectors: Floats) -> Floats:
    """Lengths (...) of vectors (..., k)."""
    return np.sqrt(np.einsum("...k,...k->...", vectors, vectors))


def solved(matrix: Floats, right: Floats) -> Floats:
    """The vector (3,) that a matrix (3, 3) takes to another; not finite when it has no inverse."""
    first, second, third = matrix
    columns = np.cross([second, third, first], [third, first, second])
    with np.errstate(divide="ignore", invalid="ignore"):
        return product(right[None], columns)[0] / np.einsum("k,k", first, columns[0])


def turned_by(turn: Floats) -> Floats:
    """Matrix (3, 3) of a rotation about a vector (3,), by about its length in radians (Cayley)."""
    x, y, z = (turn / 2).tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 / (1.0 + x * x + y * y + z * z) * (cross + product(cross, cross))
