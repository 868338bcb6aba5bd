"""Planes fitted to their points all at once, so that they meet in given corners."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.decompositions import eliminated
from primfit.geometry.products import dots, lengths_of, product

_RANK = 1e-14
"""Pivot over the largest entry below which a constraint follows from others, to rounding."""


def scatter_of(points: Floats, sigma: float) -> Floats:
    """Sum of squared distances to a plane, over sigma, as a form (4, 4) of its equation."""
    rows = np.column_stack([points, np.ones(len(points))])
    return product(rows.T, rows) / sigma**2


def fitted_together(
    equations: Floats, scatters: Floats, corners: list[Ints]
) -> tuple[Floats, Floats]:
    """Vertices (v, 3) of the planes of least squares that meet in the corners, and covariance.

    Sequential quadratic programming: planes and vertices are free, a plane of each face through
    each of its corners is the constraint. The covariance (3v, 3v) of the vertices is theirs in the
    inverse of the last system (Fletcher, Practical Methods of Optimization, 1987, section 10.1).
    """
    n_planes, n_vertices = len(equations), 1 + max(int(each.max()) for each in corners)
    face = np.repeat(np.arange(n_planes), [len(each) for each in corners])
    corner = np.concatenate(corners)
    vertices = np.zeros((n_vertices, 3))
    for v in range(n_vertices):
        met = equations[face[corner == v]]
        form = product(met.T, met)
        vertices[v] = eliminated(form[:3, :3], -form[:3, 3:], _RANK)[:, 0]
    n_free, n_meet = 4 * n_planes + 3 * n_vertices, len(face)
    unit = np.trace(scatters[0])
    rows, planes = np.arange(n_meet), np.arange(n_planes)
    for _ in range(20):
        system = np.zeros((n_free + n_meet + n_planes,) * 2)
        target = np.zeros(len(system))
        jacobian = np.zeros((n_meet + n_planes, n_free))
        for axis in range(3):
            jacobian[rows, 4 * face + axis] = vertices[corner, axis]
            jacobian[rows, 4 * n_planes + 3 * corner + axis] = equations[face, axis]
            jacobian[n_meet + planes, 4 * planes + axis] = equations[:, axis]
        jacobian[rows, 4 * face + 3] = 1.0
        for k, (equation, scatter) in enumerate(zip(equations, scatters, strict=True)):
            block = slice(4 * k, 4 * k + 4)
            system[block, block] = scatter / unit
            target[block] = -dots(system[block, block], equation)
        system[n_free:, :n_free], system[:n_free, n_free:] = jacobian, jacobian.T
        misfit = np.einsum("ij,ij->i", equations[face, :3], vertices[corner]) + equations[face, 3]
        target[n_free : n_free + n_meet] = -misfit
        step = eliminated(system, target[:, None], _RANK)[:, 0]
        equations = equations + step[: 4 * n_planes].reshape(-1, 4)
        equations /= lengths_of(equations[:, :3])[:, None]
        vertices = vertices + step[4 * n_planes : n_free].reshape(-1, 3)
        if max(np.abs(misfit).max(), np.abs(step[:n_free]).max()) <= 1e-11 * np.abs(vertices).max():
            break
    moving = slice(4 * n_planes, n_free)
    units = np.eye(len(system))[:, moving]
    return vertices, eliminated(system, units, _RANK)[moving] / unit
