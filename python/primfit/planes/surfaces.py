"""Flat parts of a cloud of which nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats, Ints

_FEWEST = 10
"""Points below which there is no plane to be told from chance."""


@dataclass(frozen=True, eq=False)
class FlatParts:
    """What `flat_parts` finds.

    Attributes
    ----------
    labels : (n,) int64
        Part of each point, numbered by falling size; -1 for none.
    sigma : (n,) float64, metres
        Noise around each point, given or estimated.
    n_neighbors : int
        Nearest points that a point touches.
    stride : int
        One point in so many was enough to find the parts; the others were assigned to them.
    order : (n,) int64
        Rows by their coordinates or pixels: sums in this order do not depend on the order of rows.
    """

    labels: Ints
    sigma: Floats
    n_neighbors: int
    stride: int
    order: Ints

    def among(self, mask: Bools) -> FlatParts:
        """The parts of points that are those of a mask (n,); the others have label -1."""
        labels, sigma = np.full(len(mask), -1), np.zeros(len(mask))
        labels[mask], sigma[mask] = self.labels, self.sigma
        return replace(self, labels=labels, sigma=sigma, order=np.flatnonzero(mask)[self.order])


def flat_parts(
    points: Floats,
    sigma: Floats | None = None,
    n_jobs: int | None = None,
    factors: Sequence[tuple[str, float]] | None = None,
) -> FlatParts:
    """Connected flat parts, without any scale given.

    Around each point the smallest neighbourhood is sought that is clearly flat; it tells the
    noise there, and around it where edges and clutter tell none. Parts grow from the flattest
    seeds over the graph of touching points, compete for the points, are cut in two or put
    together as the points ask for, and must be too unlikely to be scattered points. Copies of a
    point count once.

    Parameters
    ----------
    points : (n, 3) float64, metres
        Finite.
    sigma : (n,) float64 or None, metres
        Noise across the surfaces; None is estimated.
    n_jobs : int or None
        Threads; the result does not depend on them.
    factors : sequence of (str, float) or None
        Settings of the search by name, each times a factor.
    """
    order, is_new = _by_place(points)
    distinct = order[is_new]
    given = None if sigma is None else sigma[distinct]
    parts = _flat_parts(points[distinct], given, n_jobs, factors)
    copy_of = np.empty(len(points), dtype=np.int64)
    copy_of[order] = np.cumsum(is_new) - 1
    return FlatParts(
        parts.labels[copy_of], parts.sigma[copy_of], parts.n_neighbors, parts.stride, order
    )


def _flat_parts(
    points: Floats,
    sigma: Floats | None,
    n_jobs: int | None,
    factors: Sequence[tuple[str, float]] | None,
) -> FlatParts:
    """The same for points without copies, sorted by their coordinates."""
    rows = np.arange(len(points))
    if len(points) < _FEWEST:
        return FlatParts(np.full(len(points), -1), np.zeros(len(points)), 0, 1, rows)
    # A point far away would draw their mean along.
    middle = np.array([np.median(column) for column in points.T])
    tree = _primfit.PointTree(points - middle, n_jobs)
    given = None if sigma is None else np.ascontiguousarray(sigma[tree.order()])
    sorted_labels, sorted_noise, n_neighbors, stride = tree.segment(given, n_jobs, factors)
    order = tree.order()
    labels, noise = np.empty_like(sorted_labels), np.empty_like(sorted_noise)
    labels[order], noise[order] = sorted_labels, sorted_noise
    return FlatParts(labels, noise, n_neighbors, stride, rows)


def _by_place(points: Floats) -> tuple[Ints, Bools]:
    """Rows sorted by x, y and z, and which of them are not copies of the one before."""
    x = np.ascontiguousarray(points[:, 0])
    order = np.argsort(x, kind="stable")
    rising = x[order]
    is_new = np.ones(len(points), dtype=bool)
    shares = rising[1:] == rising[:-1]
    if shares.any():
        # Only rows that share their x are compared further.
        some = np.append(shares, False) | np.append(False, shares)
        rows = order[some]
        order[some] = rows[np.lexsort(points[rows].T[::-1])]
        is_new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    return order, is_new
