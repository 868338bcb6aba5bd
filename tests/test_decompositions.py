"""Decompositions without LAPACK against those of it."""

from __future__ import annotations

import numpy as np
import pytest

from primfit.geometry.decompositions import eigen_of, eliminated, inverse_of, root_of


@pytest.mark.parametrize("k", [1, 2, 3, 4, 7])
def test_eigenvectors(k):
    some = np.random.default_rng(k).normal(size=(20, 5, k, k))
    matrices = some + some.swapaxes(-1, -2)
    matrices[0, 0] = np.eye(k)
    matrices[0, 1] = 0.0
    matrices[0, 2] *= 1e-9
    matrices[0, 3] = 1.0
    values, vectors = eigen_of(matrices)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrices), atol=1e-13)
    again = np.einsum("...ij,...j,...kj->...ik", vectors, values, vectors)
    np.testing.assert_allclose(again, matrices, atol=1e-13)
    unit = np.einsum("...ji,...jk->...ik", vectors, vectors)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(k), unit.shape), atol=1e-14)


@pytest.mark.parametrize("n", [1, 3, 9, 60])
def test_systems_that_are_not_singular(n):
    rng = np.random.default_rng(n)
    matrix, right = rng.normal(size=(n, n)), rng.normal(size=(n, 2))
    np.testing.assert_allclose(eliminated(matrix, right), np.linalg.solve(matrix, right), rtol=1e-9)
    np.testing.assert_allclose(inverse_of(matrix), np.linalg.inv(matrix), rtol=1e-8, atol=1e-10)
    definite = matrix @ matrix.T
    np.testing.assert_allclose(root_of(definite), np.linalg.cholesky(definite), atol=1e-9)


def test_what_a_constraint_given_twice_determines():
    # The nearest point to (1, 2, 3) on the plane x + y + z = 0, the plane given twice.
    system = np.zeros((5, 5))
    system[:3, :3] = np.eye(3)
    system[3:, :3] = 1.0
    system[:3, 3:] = 1.0
    right = np.array([[1.0], [2.0], [3.0], [0.0], [0.0]])
    nearest = eliminated(system, right, 1e-14)[:3, 0]
    np.testing.assert_allclose(nearest, [-1.0, 0.0, 1.0], atol=1e-14)


def test_what_has_no_inverse_and_no_root():
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        inverse_of(np.ones((3, 3)))
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        root_of(np.diag([1.0, -1.0]))
