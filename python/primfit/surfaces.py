"""Flat parts of a cloud of which nothing is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints

_FEWEST = 10
"""Points below which there is no plane to be told from chance."""

_FLATTEST = 1024.0
"""Flatness from which all seeds are alike; a few bits of it must not order them either."""

_STEPS = 4
"""Classes of flatness within each doubling: seeds of one class come in the order of the cloud."""

_NEIGHBORS = (10, 128)
"""Least and most nearest neighbours that a point touches: half of what shows a plane."""

_LARGE = 500_000
"""Points from which fewer neighbours are looked at for those that bridge gaps."""


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
    """

    labels: Ints
    sigma: Floats
    n_neighbors: int


def flat_parts(points: Floats, sigma: Floats | None = None, n_jobs: int | None = None) -> FlatParts:
    """Connected flat parts, without any scale given.

    Around each point the smallest neighbourhood is sought that is clearly flat; it tells the
    noise there. Parts grow from the flattest seeds over the graph of touching points, compete for
    the points, are put together where one plane explains two, and must be too unlikely to be
    scattered points. Copies of a point count once.

    Parameters
    ----------
    points : (n, 3) float64, metres
        Finite.
    sigma : (n,) float64 or None, metres
        Noise across the surfaces; None is estimated.
    n_jobs : int or None
        Threads; the result does not depend on them.
    """
    distinct, copy_of = _distinct(points)
    labels, noise, n_neighbors = np.full(len(distinct), -1), np.zeros(len(distinct)), 0
    if len(distinct) >= _FEWEST:
        near = points[distinct] - points[distinct].mean(axis=0)
        tree = _primfit.PointTree(near)
        order = tree.order()
        given = None if sigma is None else np.ascontiguousarray(sigma[distinct[order]])
        _, spread, flatness, size, _ = tree.local_planes(given, n_jobs)
        rank = np.floor(_STEPS * np.log2(np.clip(flatness, 1.0 / _FLATTEST, _FLATTEST)))
        seeds = np.lexsort((order, -rank))
        n_neighbors = int(np.clip(np.median(size) / 2, *_NEIGHBORS))
        n_looked_at = 96 if len(distinct) < _LARGE else 32
        labels[order] = tree.segment(spread, size, seeds, n_neighbors, n_looked_at, n_jobs)
        noise[order] = spread
    return FlatParts(labels[copy_of], noise[copy_of], n_neighbors)


def _distinct(points: Floats) -> tuple[Ints, Ints]:
    """Rows without copies, rising, and for each point its place among them."""
    order = np.lexsort(points.T)
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (np.diff(points[order], axis=0) != 0.0).any(axis=1)
    if is_new.all():
        return np.arange(len(points)), np.arange(len(points))
    # Sorting is stable: the first of a run of copies has the lowest row.
    firsts = order[is_new]
    place = np.argsort(np.argsort(firsts))
    copy_of = np.empty_like(order)
    copy_of[order] = place[np.cumsum(is_new) - 1]
    return np.sort(firsts), copy_of
