"""Decompositions of small matrices whose bits no LAPACK decides.

They are sums and products of NumPy's own; `numpy.linalg` hands matrices to the LAPACK that NumPy
was built with.
"""

from __future__ import annotations

import numpy as np

from primfit._check import Floats

_SWEEPS = 12
"""Most rounds of Jacobi's method; it converges quadratically, in five or six."""


def eigen_of(matrices: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues (..., k), rising, of symmetric matrices, and eigenvectors (..., k, k) in columns.

    By Jacobi's rotations (Golub and Van Loan, Matrix Computations, 4th edition, section 8.5).
    """
    k = matrices.shape[-1]
    left = np.array(matrices, dtype=np.float64)
    vectors = np.broadcast_to(np.eye(k), left.shape).copy()
    upper = np.triu_indices(k, 1)
    for _ in range(_SWEEPS):
        # What is below rounding beside the diagonal changes it no more.
        off = np.abs(left[..., upper[0], upper[1]]).max(axis=-1, initial=0.0)
        if (off <= np.finfo(float).tiny + 1e-18 * np.abs(left).max(axis=(-1, -2))).all():
            break
        for p, q in zip(*upper, strict=True):
            apart, beside = left[..., q, q] - left[..., p, p], 2.0 * left[..., p, q]
            root = np.abs(apart) + np.sqrt(apart * apart + beside * beside)
            with np.errstate(divide="ignore", invalid="ignore"):
                tangent = np.where(beside == 0.0, 0.0, beside / root)
            tangent = np.where(apart < 0.0, -tangent, tangent)[..., None]
            cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
            sine = tangent * cosine
            for rows in (left.swapaxes(-1, -2), left, vectors.swapaxes(-1, -2)):
                one, two = rows[..., p, :].copy(), rows[..., q, :].copy()
                rows[..., p, :] = cosine * one - sine * two
                rows[..., q, :] = sine * one + cosine * two
    values = np.diagonal(left, axis1=-2, axis2=-1)
    order = np.argsort(values, axis=-1, kind="stable")
    return np.take_along_axis(values, order, axis=-1), np.take_along_axis(
        vectors, order[..., None, :], axis=-1
    )


def eliminated(matrix: Floats, right: Floats, rcond: float = 0.0) -> Floats:
    """Solution (n, m) of a square system (n, n) with right-hand sides (n, m).

    By Gauss's elimination with complete pivoting. Unknowns whose pivots are not above `rcond` of
    the largest entry are zero: of a system that determines some unknowns only, those are right.
    """
    n = len(matrix)
    rows = np.hstack([matrix, right])
    columns = np.arange(n)
    least = rcond * float(np.abs(matrix).max(initial=0.0))
    rank = n
    for k in range(n):
        rest = np.abs(rows[k:, k:n])
        i, j = divmod(int(rest.argmax()), n - k)
        if not rest[i, j] > least:
            rank = k
            break
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[:, [k, k + j]] = rows[:, [k + j, k]]
        columns[[k, k + j]] = columns[[k + j, k]]
        factors = rows[k + 1 :, k] / rows[k, k]
        rows[k + 1 :, k:] -= factors[:, None] * rows[k, k:]
    solution = np.zeros((n, right.shape[1]))
    for k in range(rank - 1, -1, -1):
        known = np.einsum("j,jm->m", rows[k, k + 1 : rank], solution[k + 1 : rank])
        solution[k] = (rows[k, n:] - known) / rows[k, k]
    result = np.empty_like(solution)
    result[columns] = solution
    return result


def inverse_of(matrix: Floats) -> Floats:
    """Inverse (n, n) of a square matrix.

    Raises
    ------
    numpy.linalg.LinAlgError
        When it has none.
    """
    inverse = eliminated(matrix, np.eye(len(matrix)))
    # A singular one leaves an unknown at zero throughout.
    if not np.isfinite(inverse).all() or not inverse.any(axis=1).all():
        raise np.linalg.LinAlgError("matrix must have an inverse, but is singular")
    return inverse


def root_of(matrix: Floats) -> Floats:
    """Lower triangular root (n, n) of a positive definite matrix (Cholesky).

    Raises
    ------
    numpy.linalg.LinAlgError
        When it is not positive definite.
    """
    root = np.zeros_like(matrix)
    for k in range(len(matrix)):
        column = matrix[k:, k] - np.einsum("ij,j->i", root[k:, :k], root[k, :k])
        if not column[0] > 0.0:
            raise np.linalg.LinAlgError("matrix must be positive definite")
        root[k:, k] = column / np.sqrt(column[0])
    return root
