"""Noise and spacing of a cloud, from the cloud alone."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree
from scipy.special import ndtri

from primfit import _primfit
from primfit._check import Floats
from primfit.geometry.decompositions import eigen_of
from primfit.geometry.extents import extent
from primfit.scans.scan import Scan

_NEIGHBOURS = (16, 32, 64, 128, 256, 512, 1024)
_SAMPLES = 400
_ORIGINS = 32
_TRIPLES = 4096
_IN_A_ROW = 0.25
"""How far the third of three beams may be off their line, as a share of the gap between them."""
_SAME = 1e-9
"""Difference of ranges, as a share of the largest, that is rounding."""
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
    is `_FLATNESS` times the smallest, and no line, which a single row of a scan is. Where the noise
    is a third of the size of surfaces, few are but by chance: 30 mm on solids of 100 mm were
    estimated as 12 to 52.
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
        values, vectors = eigen_of(np.einsum("nki,nkj->nij", local, local) / (k - 3))
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

    Second differences of the ranges of three beams in a row: one, the nearest to it, and the one
    across, which in a spinning sensor are consecutive firings of one ring. Their median tells it,
    so that corners and edges do not. Unlike points in space these are neighbours however large
    the noise is.
    """
    returns = np.flatnonzero(scan.is_return)
    keys = np.unique(scan.origins[returns], axis=0, return_inverse=True)[1].ravel()
    chosen = rng.permutation(int(keys.max()) + 1)[:_ORIGINS]
    differences = [np.empty(0)]
    for key in chosen:
        rows = returns[keys == key]
        if len(rows) < 3:
            continue
        ways, ranges = scan.directions[rows], scan.ranges[rows]
        tree = KDTree(ways)
        at = rng.permutation(len(rows))[: max(1, _TRIPLES // len(chosen))]
        gaps, nearest = tree.query(ways[at], k=2)
        beside = nearest[:, 1]
        cosine = np.einsum("ni,ni->n", ways[at], ways[beside])
        off, across = tree.query(2.0 * cosine[:, None] * ways[at] - ways[beside])
        in_a_row = off < _IN_A_ROW * gaps[:, 1]
        at, beside, across = at[in_a_row], beside[in_a_row], across[in_a_row]
        differences.append(ranges[beside] - 2.0 * ranges[at] + ranges[across])
    sizes = np.abs(np.concatenate(differences))
    if not len(sizes):
        return float(np.ptp(scan.ranges[returns])) * FLOOR
    # Half of all normal deviates are below their 0.75 quantile, and 1 + 4 + 1 variances add up.
    return _median(sizes) / float(ndtri(0.75) * np.sqrt(6.0))


def _median(sizes: Floats) -> float:
    """Median of sizes that may come in steps, as those of rounded ranges do, between the steps.

    Where the mid-distribution function is one half (Ma, Genton, Parzen: Asymptotic properties of
    sample quantiles of discrete distributions, Annals of the Institute of Statistical Mathematics
    63, 2011).
    """
    # Sizes of one step differ by rounding.
    unit = _SAME * max(float(sizes.max()), np.finfo(float).tiny)
    steps, counts = np.unique(np.rint(sizes / unit), return_counts=True)
    below = np.cumsum(counts) - counts / 2.0
    return unit * float(np.interp(len(sizes) / 2.0, below, steps))
