"""The last fit of a surface: by its noise, without bias, with a covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.surfaces.kinds import N_PARAMETERS, surface_of

_CUTOFF = 4.685
"""Standard deviations from which a point does not count where there may be outliers: the biweight
is then 95 % as efficient as least squares for normal noise (Beaton, Tukey 1974)."""

_INLIER = 3.0
"""Standard deviations within which a point counts as an inlier."""

_ROUNDS = 12
"""Most rounds of fit and estimate of the noise; three to five are usual."""

_SETTLED = 1e-4
"""Change of the noise from one round to the next, as a share, that is none."""

_STEPS = 60

_AROUND = 16
"""Points around one of which most must be on the surface where there may be outliers."""

_ENOUGH = 0.3
"""Share of the beams that must meet the surface steeply for the ranges to be fitted."""

_LEAST_NOISE = 1e-12
"""Noise as a share of the extent that takes the place of none."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Points with what is known of them."""

    points: Floats
    sigma: Floats | None
    beams: Floats | None
    size: float
    """Extent of all points, metres."""

    def among(self, rows: Any) -> Measured:
        """Some of them."""
        some = [
            None if each is None else np.ascontiguousarray(each[rows])
            for each in (self.points, self.sigma, self.beams)
        ]
        assert some[0] is not None
        return Measured(some[0], some[1], some[2], self.size)


@dataclass(frozen=True, eq=False)
class LastFit:
    """A fitted surface with what it was fitted to."""

    kind: str
    numbers: Floats
    covariance: Floats
    residuals: Floats
    """In standard deviations of the noise; NaN for beams that miss or graze the surface."""
    sigma: Floats
    is_inlier: Bools
    measured: Measured
    along_beams: bool

    @property
    def _feet(self) -> Floats:
        """Points without their errors: those that err alike would be neighbours for that alone."""
        points, beams = self.measured.points, self.measured.beams
        if self.along_beams and beams is not None:
            return points - (self.residuals * self.sigma)[:, None] * beams
        normals = _primfit.surface_normals(self.kind, self.numbers, points)
        far = _primfit.surface_distances(self.kind, self.numbers, points)
        return points - far[:, None] * normals

    @property
    def is_determined(self) -> bool:
        """Whether the points leave none of the parameters open."""
        return bool(np.isfinite(self.covariance).all())

    def found(self, rows: Ints, n_jobs: int | None) -> Any:
        """The public result; the points are those of some rows of a cloud."""
        counted = np.isfinite(self.residuals) & self.is_inlier
        errors = np.ascontiguousarray(self.residuals[counted])
        tree = _primfit.PointTree(np.ascontiguousarray(self._feet[counted]), n_jobs)
        area = _primfit.correlation_area(tree, errors, n_jobs)
        is_convex = None
        if self.measured.beams is not None:
            normals = _primfit.surface_normals(self.kind, self.numbers, self.measured.points)
            facing = np.einsum("ni,ni->n", normals, self.measured.beams)
            is_convex = bool(facing[self.is_inlier].sum() < 0.0)
        order = np.argsort(rows[self.is_inlier])
        on_it = np.flatnonzero(self.is_inlier)[order]
        return surface_of(
            self.kind,
            self.numbers,
            self.covariance * area,
            self.measured.points,
            on_it,
            inliers=rows[on_it],
            rms=float(np.sqrt(np.mean((errors * self.sigma[counted]) ** 2))),
            is_convex=is_convex,
            correlation_area=area,
        )


def last_fit(
    kind: str,
    start: Floats,
    measured: Measured,
    outliers: float,
    n_jobs: int | None,
    is_shared: Bools | None = None,
) -> LastFit:
    """Fits a surface from a start near it, until fit and noise agree.

    Points that are shared with another surface may be inliers, but do not count where most are not.
    Ranges are fitted where the beams are known and most meet the surface steeply, else distances.
    """
    cutoff = _CUTOFF if outliers else np.inf
    all_noise = measured.sigma
    if all_noise is None:
        all_noise = _spread(kind, start, measured, outliers)
    kept = np.ones(len(all_noise), dtype=bool)
    if outliers:
        kept = _is_amid_others(kind, start, measured, all_noise, n_jobs)
    counts = kept
    if is_shared is not None and 2 * (kept & is_shared).sum() < kept.sum():
        counts = kept & ~is_shared
    some, noise, beams, numbers = measured.among(counts), all_noise[counts], None, start
    if measured.beams is not None:
        beams = some.beams
    for _ in range(_ROUNDS):
        fitted, covariance, variance, residuals, _ = _primfit.fit_surface(
            kind, numbers, some.points, noise, beams, cutoff, beams is None, _STEPS, n_jobs
        )
        numbers = np.array(fitted)
        if beams is not None and np.isfinite(residuals).mean() < _ENOUGH:
            beams, numbers = None, start
            continue
        if measured.sigma is not None:
            break
        factor = float(np.sqrt(_variance(kind, residuals, outliers, cutoff)))
        if not noise[0] * factor > _LEAST_NOISE * measured.size or abs(factor - 1.0) < _SETTLED:
            break
        noise, all_noise = noise * factor, all_noise * factor
    # Of a given noise, what is larger shows that it, or the surface, is not what it was taken for.
    covariance = covariance * (variance if measured.sigma is None else max(variance, 1.0))
    all_residuals, is_inlier = np.full(len(kept), np.nan), kept
    all_residuals[counts] = residuals
    if outliers:
        off = np.abs(_primfit.surface_distances(kind, numbers, measured.points))
        is_inlier = kept & (off < _INLIER * all_noise)
    return LastFit(
        kind, numbers, covariance, all_residuals, all_noise, is_inlier, measured, beams is not None
    )


def _is_amid_others(
    kind: str, start: Floats, measured: Measured, noise: Floats, n_jobs: int | None
) -> Bools:
    """Which points are on the surface as most around them are, and not scattered near it.

    A surface has no ends: scattered points near where it would go on have the longest lever.
    """
    is_near = np.abs(_primfit.surface_distances(kind, start, measured.points)) < _CUTOFF * noise
    tree = _primfit.PointTree(measured.points, n_jobs)
    around = tree.neighbors(measured.points, _AROUND, n_jobs)[0]
    return is_near & (2 * is_near[around].sum(axis=1) > around.shape[1])


def _spread(kind: str, start: Floats, measured: Measured, outliers: float) -> Floats:
    """Noise of all points by their distances from a start."""
    distances = np.abs(_primfit.surface_distances(kind, start, measured.points))
    spread = float(np.sqrt(np.mean(distances**2)))
    if outliers:
        spread = float(np.quantile(distances, 0.5 * (1.0 - outliers))) / 0.6745
    return np.full(len(distances), max(spread, _LEAST_NOISE * measured.size))


def _variance(kind: str, residuals: Floats, outliers: float, cutoff: float) -> float:
    """Variance of the residuals of points of the surface, in terms of the noise assumed."""
    sizes = np.abs(residuals[np.isfinite(residuals)])
    if not outliers:
        freedom = max(len(sizes) - N_PARAMETERS[kind], 1)
        return float(np.sum(sizes**2)) / freedom
    # Half of the points within the cutoff, which hardly any of the surface is beyond.
    within = sizes[sizes < cutoff]
    return float((np.median(within) / 0.6745) ** 2) if len(within) else 1.0
