"""How far points reach; column by column, which NumPy does many times as fast as row by row."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats

_SOME = 10_000
"""Rows that tell about how far points are from the origin."""


def bounds(points: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates (k,) of points (n, k); NaN does not count."""
    low = np.array([np.fmin.reduce(column) for column in points.T])
    high = np.array([np.fmax.reduce(column) for column in points.T])
    return low, high


def extent(points: Floats) -> float:
    """Longest side of the box around some points (n, k)."""
    low, high = bounds(points)
    return float((high - low).max())


def half_extent(points: Floats, middle: Floats) -> float:
    """How far half of the points (n, k) are from their middle, along the axis of the farthest."""
    return max(
        float(np.median(np.abs(column - at))) for column, at in zip(points.T, middle, strict=True)
    )


def is_amid(points: Floats, n: int, far: float) -> bool:
    """Whether n of the rows (m, 3), those without NaN, surely lie about the origin.

    That is, their middle is no farther from it than `far` times their `half_extent`. Counting tells
    so of most clouds in a tenth of the time that medians take; False is not known.
    """
    some = points[:: max(1, len(points) // _SOME)]
    some = np.abs(some[~np.isnan(some[:, 0])])
    if len(some) < _SOME // 100:
        return False
    # More than half of the points within it: so is their median.
    most = 2.0 * max(float(np.median(column)) for column in some.T)
    counts = [np.count_nonzero(np.abs(column) <= most) for column in points.T]
    if not most > 0.0 or 2 * min(counts) <= n:
        return False
    # Whichever place they are about, one or two bins hold all that are within most / far of it.
    axis = int(np.argmax([np.median(column) for column in some.T]))
    column = points[:, axis]
    bins = np.bincount(((column[np.abs(column) <= most] / most + 1.0) * (far / 4)).astype(np.int64))
    fullest = int((bins[1:] + bins[:-1]).max(initial=0))
    return bool(2 * (fullest + n - counts[axis] + 1) < n)
