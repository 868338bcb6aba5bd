"""How far points reach; column by column, which NumPy does many times as fast as row by row."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats


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
