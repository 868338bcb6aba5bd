"""First fits of a surface to points of which nothing is known but that many lie on one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from primfit import _primfit
from primfit._check import Floats
from primfit.geometry.decompositions import eigen_of
from primfit.surfaces.last_fit import Measured

_NEIGHBORS = (6, 12, 24, 48, 96, 192)
"""Points that tell a normal: which number is best depends on the noise, which is not known yet."""

_SOME = 4096
"""Points that starts are compared by: more move the scale that they are compared by by less than
1 / sqrt(2 * 4096) = 1 %."""

_SEEDS = 64
"""Neighbourhoods that are tried where there are outliers: with half of all points on the surface as
good as certainly one of them, and with noise of a tenth of the size some."""

_AROUND = (32, 128, 512)
"""Points of such a neighbourhood."""

_TRIED = 4
"""Starts that are fitted: the best one by its distances is the best fit in nine of ten cases."""

_STEPS = 60


def first_fits(kind: str, measured: Measured, outliers: float, n_jobs: int | None) -> list[Floats]:
    """Surfaces (8,) fitted to some of the points, the best first; none where normals tell none."""
    n = len(measured.points)
    stride = -(-n // _SOME)
    some = measured.among(slice(None, None, stride))
    scored = []
    for start in _starts(kind, measured.points, outliers, n_jobs):
        spread = scale_of(kind, start, some, outliers)
        if np.isfinite(spread):
            scored.append((spread, start))
    scored.sort(key=lambda each: each[0])
    fits = []
    for spread, start in scored[:_TRIED]:
        fitted = _settled(kind, start, spread, some, outliers, n_jobs)
        fits.append((scale_of(kind, fitted, some, outliers), fitted))
    fits = [each for each in fits if np.isfinite(each[0])]
    return [start for _, start in sorted(fits, key=lambda each: each[0])]


def _settled(
    kind: str, start: Floats, spread: float, some: Measured, outliers: float, n_jobs: int | None
) -> Floats:
    """A start fitted to distances, with outliers by ever closer cutoffs."""
    numbers = start
    for _ in range(6 if outliers else 1):
        noise = np.full(len(some.points), max(spread, 1e-12 * some.size))
        cutoff = 4.685 if outliers else np.inf
        fitted = _primfit.fit_surface(
            kind, numbers, some.points, noise, None, cutoff, False, _STEPS, n_jobs
        )
        after = scale_of(kind, np.array(fitted[0]), some, outliers)
        if not after <= spread:
            break
        numbers, before, spread = np.array(fitted[0]), spread, after
        if after > 0.99 * before:
            break
    return numbers


def scale_of(kind: str, numbers: Floats, measured: Measured, outliers: float = 0.0) -> float:
    """Scale of the distances from a surface: root mean square, or of all but the outliers."""
    distances = np.abs(_primfit.surface_distances(kind, numbers, measured.points))
    if not outliers:
        return float(np.sqrt(np.mean(distances**2)))
    return float(np.quantile(distances, 0.9 * (1.0 - outliers))) / 1.645


def _starts(kind: str, points: Floats, outliers: float, n_jobs: int | None) -> Iterator[Floats]:
    tree = _primfit.PointTree(points, n_jobs)
    n = len(points)
    normals = [tree.normals(k, n_jobs) for k in _NEIGHBORS if k < n] or [tree.normals(n, n_jobs)]
    groups: list[tuple[Floats, Floats]] = [(points, normal) for normal in normals]
    if outliers:
        seeds = np.ascontiguousarray(points[:: max(1, n // _SEEDS)])
        for k in _AROUND:
            if k < n:
                near = tree.neighbors(seeds, k, n_jobs)[0]
                groups += [(points[rows], normal[rows]) for normal in normals[1:4] for rows in near]
    else:
        # Across each of their own axes points may be as of a body about it.
        groups += [(points, normal) for normal in _about_axes(points)]
    for some, normal in groups:
        start = _primfit.first_surface(
            kind, np.ascontiguousarray(some), np.ascontiguousarray(normal)
        )
        if start is not None:
            yield np.array(start)


def _about_axes(points: Floats) -> Iterator[Floats]:
    """Normals away from each of the principal axes of the points, and from their mean."""
    away = points - points.mean(axis=0)
    axes = eigen_of(np.einsum("ni,nj->ij", away, away)[None])[1][0].T
    for axis in axes:
        across = away - np.einsum("ni,i->n", away, axis)[:, None] * axis
        yield _unit(across)
    yield _unit(away)


def _unit(vectors: Floats) -> Floats:
    lengths = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    unit: Floats = vectors / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return unit
