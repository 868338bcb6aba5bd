"""Noise and spacing of a cloud, from the cloud alone."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from primfit import _primfit
from primfit._check import Floats
from primfit.extents import extent
from primfit.scans import Scan

_NEIGHBOURS = (16, 32, 64, 128, 256, 512, 1024)
_SAMPLES = 400
_ORIGINS = 32
_BESIDE = 12
_FLATNESS = 6.0
"""Second smallest over smallest eigenvalue from which a neighbourhood counts as a flat one."""

FLOOR = 1e-6
"""Least standard deviation as a fraction of the extent: exact ranges are stored rounded."""


def spacing(points: Floats, tree: _primfit.PointTree | None = None) -> float:
    """Distance to the 16th neighbour that 99 of 100 points do not exceed, metres."""
    some = np.ascontiguousarray(points[:: max(1, len(points) // 5000)])
    tree = _primfit.PointTree(points) if tree is None else tree
    return float(np.quantile(tree.neighbors(some, 17)[1][:, -1], 0.99))


def estimate_sigma(points: Floats, directions: Floats | None, rng: np.random.Generator) -> float:
    """Standard deviation of the points about their surfaces, metres.

    The median over random neighbourhoods, each the smallest that is clearly flat; along the beams
    where their directions are known. A neighbourhood is flat when its second smallest eigenvalue
    is `_FLATNESS` times the smallest, and no line, which a single row of a scan is.
    """
    tree = _primfit.PointTree(points)
    at = rng.integers(len(points), size=_SAMPLES)
    sigma = np.full(_SAMPLES, np.nan)
    for k in _NEIGHBOURS:
        open_ = np.flatnonzero(np.isnan(sigma))
        if k >= len(points) or not len(open_):
            break
        neighbours = points[tree.neighbors(points[at[open_]], k)[0]]
        local = neighbours - neighbours.mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local) / (k - 3))
        values = np.maximum(values, 0.0)
        flat = (values[:, 1] > _FLATNESS * values[:, 0]) & (values[:, 1] > 0.06 * values[:, 2])
        across = np.sqrt(values[:, 0])
        if directions is not None:
            approach = np.abs(np.einsum("ni,ni->n", vectors[:, :, 0], directions[at[open_]]))
            # At grazing incidence the neighbourhood says little of the range.
            flat &= approach > 0.3
            across = across / np.maximum(approach, 0.3)
        sigma[open_[flat]] = across[flat]
    if np.isnan(sigma).all():
        return extent(points) * FLOOR
    return float(np.nanmedian(sigma))


def estimate_range_sigma(scan: Scan, rng: np.random.Generator) -> float:
    """Standard deviation of the ranges, metres, from neighbouring beams of the same origin.

    The median over random beams of what a linear trend in direction leaves of the ranges of the
    nearest ones. Unlike points in space these are neighbours however large the noise is.
    """
    returns = np.flatnonzero(scan.is_return)
    keys = np.unique(scan.origins[returns], axis=0, return_inverse=True)[1].ravel()
    variances = []
    for key in rng.permutation(int(keys.max()) + 1)[:_ORIGINS]:
        rows = returns[keys == key]
        if len(rows) < 3 * _BESIDE:
            continue
        ways, ranges = scan.directions[rows], scan.ranges[rows]
        at = rng.integers(len(rows), size=_BESIDE)
        beside = KDTree(ways).query(ways[at], k=_BESIDE)[1]
        trend = np.concatenate([np.ones((*beside.shape, 1)), ways[beside]], axis=2)
        fitted = trend @ np.linalg.pinv(trend, rcond=1e-6) @ ranges[beside][..., None]
        left = ((ranges[beside] - fitted[..., 0]) ** 2).sum(axis=1)
        variances.append(left / (_BESIDE - np.linalg.matrix_rank(trend, tol=1e-6)))
    if not variances:
        return float(np.ptp(scan.ranges[returns])) * FLOOR
    return float(np.sqrt(np.median(np.concatenate(variances))))
