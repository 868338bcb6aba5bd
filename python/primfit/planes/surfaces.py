"""Flat parts of a cloud of which nothing is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints

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
    """

    labels: Ints
    sigma: Floats
    n_neighbors: int
    stride: int

    def select(self, rows: Ints) -> FlatParts:
        """The parts of some of the points."""
        return replace(self, labels=self.labels[rows], sigma=self.sigma[rows])


def flat_parts(points: Floats, sigma: Floats | None = None, n_jobs: int | None = None) -> FlatParts:
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
    """
    first = _first_copies(points)
    if first is None:
        return _flat_parts(points, sigma, n_jobs)
    distinct, copy_of = np.unique(first, return_inverse=True)
    given = None if sigma is None else sigma[distinct]
    parts = _flat_parts(points[distinct], given, n_jobs)
    return FlatParts(parts.labels[copy_of], parts.sigma[copy_of], parts.n_neighbors, parts.stride)


def _flat_parts(points: Floats, sigma: Floats | None, n_jobs: int | None) -> FlatParts:
    """The same for points without copies."""
    if len(points) < _FEWEST:
        return FlatParts(np.full(len(points), -1), np.zeros(len(points)), 0, 1)
    # A point far away would draw their mean along.
    middle = np.array([np.median(column) for column in points.T])
    tree = _primfit.PointTree(points - middle, n_jobs)
    given = None if sigma is None else np.ascontiguousarray(sigma[tree.order()])
    sorted_labels, sorted_noise, n_neighbors, stride = tree.segment(given, n_jobs)
    order = tree.order()
    labels, noise = np.empty_like(sorted_labels), np.empty_like(sorted_noise)
    labels[order], noise[order] = sorted_labels, sorted_noise
    return FlatParts(labels, noise, n_neighbors, stride)


def _first_copies(points: Floats) -> Ints | None:
    """The lowest row with the coordinates of each point; None when no two points are the same."""
    x = np.ascontiguousarray(points[:, 0])
    rising = np.sort(x)
    if (rising[1:] != rising[:-1]).all():
        return None
    order = np.argsort(x)
    rising = x[order]
    shares_next = rising[1:] == rising[:-1]
    shares = np.append(shares_next, False) | np.append(False, shares_next)
    rows = order[shares]
    # Sorting is stable: the first of a run of copies has the lowest row.
    rows.sort()
    rows = rows[np.lexsort(points[rows].T)]
    is_new = np.ones(len(rows), dtype=bool)
    is_new[1:] = (np.diff(points[rows], axis=0) != 0.0).any(axis=1)
    if is_new.all():
        return None
    first = np.arange(len(points))
    first[rows] = rows[is_new][np.cumsum(is_new) - 1]
    return first
