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
