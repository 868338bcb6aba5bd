"""Flat parts of a cloud of which nothing is known."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    labels: Ints
    sigma: Floats
    n_neighbors: int


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
    distinct, copy_of = _distinct(points)
    labels, noise, n_neighbors = np.full(len(distinct), -1), np.zeros(len(distinct)), 0
    if len(distinct) >= _FEWEST:
        near = points[distinct] - points[distinct].mean(axis=0)
        tree = _primfit.PointTree(near)
        order = tree.order()
        given = None if sigma is None else np.ascontiguousarray(sigma[distinct[order]])
        labels[order], noise[order], n_neighbors = tree.segment(given, n_jobs)
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
