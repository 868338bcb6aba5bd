"""Spheres, cylinders, cones and tori through points that are known to lie on one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, Ints, n_jobs_or_none, number
from primfit.clouds.foreign import PointsLike
from primfit.geometry.extents import extent
from primfit.scans.columns import as_sigma
from primfit.scans.recorded import as_scan
from primfit.scans.scan import Scan
from primfit.surfaces.kinds import (
    N_PARAMETERS,
    ConeSurface,
    CylinderSurface,
    SphereSurface,
    TorusSurface,
)
from primfit.surfaces.last_fit import LastFit, Measured, last_fit
from primfit.surfaces.starts import first_fits, scale_of

_SIMPLER = {
    "sphere": ("plane",),
    "cylinder": ("plane",),
    "cone": ("plane", "cylinder"),
    "torus": ("plane", "sphere", "cylinder"),
}
"""Kinds that are a limit of another."""

_CLEAR = 6.0
"""Gain in the logarithm of the likelihood, per parameter more, below which points do not tell a
surface from a simpler one: twice that is more than 12 by chance in one of two thousand cases."""

_EXACT = 1e-9
"""Root mean square distance, as a share of the extent, that is rounding."""


def fit_sphere(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    *,
    outliers: float = 0.0,
    n_jobs: int | None = None,
) -> SphereSurface:
    """The sphere through points that lie on one, without bias, and how sure it is.

    The least-squares sphere of noisy points is too large: noise of standard deviation s in all
    directions moves the mean distance from a curved surface by half of s squared times the sum of
    its curvatures, which is taken off here. Where the beams are known, what is fitted is the range
    at which each meets the surface, with weights and derivatives taken there. No start is needed.

    Parameters
    ----------
    points : Scan, or (n, 3) or (h, w, 3) float64, metres, or whatever `as_cloud` takes
        Points of a part of the surface. Rows without a point are left out.
    origins : (n, 3), (3,) or None, metres
        Where the sensor was: noise is along the beams, else alike in all directions.
    sigma : float, (n,) or None, metres
        Standard deviation of the noise; None is estimated from the residuals.
    outliers : float
        Largest share of the points that may lie elsewhere, below 0.5. With 0 every point counts, as
        is best where the noise is normal; else points count less the farther they are off, and from
        4.7 standard deviations not at all.
    n_jobs : int or None
        Threads; None for all. The result does not depend on them.

    Returns
    -------
    SphereSurface
        Its covariance is that of the noise, and grows where residuals are larger than `sigma` or
        those of neighbours alike. Takes about 400 bytes a point.

    Raises
    ------
    ValueError
        When points are too few, or do not tell the surface from a simpler one.

    References
    ----------
    Marshall, Lukacs, Martin: Robust segmentation of primitives from range data in the presence of
    geometric degeneracy, IEEE Transactions on Pattern Analysis and Machine Intelligence 23, 2001.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> ways = np.random.default_rng(1).normal(size=(500, 3))
    >>> ball = ways / np.linalg.norm(ways, axis=1)[:, None] * 0.2 + [1.0, 2.0, 3.0]
    >>> primfit.fit_sphere(ball)
    SphereSurface(center=(1.0000, 2.0000, 3.0000), radius=0.2000 m, 500 inliers, rms 0.00 mm)
    """
    found = _fit("sphere", points, origins, sigma, outliers, n_jobs)
    assert isinstance(found, SphereSurface)
    return found


def fit_cylinder(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    *,
    outliers: float = 0.0,
    n_jobs: int | None = None,
) -> CylinderSurface:
    """The cylinder through points that lie on one, without bias, and how sure it is.

    See `fit_sphere`, also for the parameters.

    Returns
    -------
    CylinderSurface

    Raises
    ------
    ValueError
        When points are too few, or do not tell the surface from a plane.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> angle, z = np.random.default_rng(1).uniform([0, 0], [3.0, 2.0], (500, 2)).T
    >>> pipe = primfit.fit_cylinder(np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), z]))
    >>> round(pipe.radius, 6), np.abs(pipe.axis).round(6).tolist(), round(pipe.arc, 1)
    (0.1, [0.0, 0.0, 1.0], 3.0)
    """
    found = _fit("cylinder", points, origins, sigma, outliers, n_jobs)
    assert isinstance(found, CylinderSurface)
    return found


def fit_cone(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    *,
    outliers: float = 0.0,
    n_jobs: int | None = None,
) -> ConeSurface:
    """The cone through points that lie on one, without bias, and how sure it is.

    See `fit_sphere`, also for the parameters. The points may be those of a truncated cone.

    Returns
    -------
    ConeSurface

    Raises
    ------
    ValueError
        When points are too few, or do not tell the surface from a plane or a cylinder.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> angle, z = np.random.default_rng(1).uniform([0, 1.0], [6.0, 2.0], (500, 2)).T
    >>> cone = primfit.fit_cone(np.column_stack([z * np.cos(angle), z * np.sin(angle), z]))
    >>> round(float(np.degrees(cone.angle)), 6), np.abs(cone.apex).round(6).tolist()
    (45.0, [0.0, 0.0, 0.0])
    """
    found = _fit("cone", points, origins, sigma, outliers, n_jobs)
    assert isinstance(found, ConeSurface)
    return found


def fit_torus(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    *,
    outliers: float = 0.0,
    n_jobs: int | None = None,
) -> TorusSurface:
    """The torus through points that lie on one, without bias, and how sure it is.

    See `fit_sphere`, also for the parameters. The points may be those of the bend of a pipe.

    Returns
    -------
    TorusSurface

    Raises
    ------
    ValueError
        When points are too few, or do not tell the surface from a plane, a sphere or a cylinder.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> around, tube = np.random.default_rng(1).uniform(0, 6, (800, 2)).T
    >>> out = 1.0 + 0.2 * np.cos(tube)
    >>> ring = np.column_stack([out * np.cos(around), out * np.sin(around), 0.2 * np.sin(tube)])
    >>> torus = primfit.fit_torus(ring)
    >>> round(torus.major_radius, 6), round(torus.radius, 6)
    (1.0, 0.2)
    """
    found = _fit("torus", points, origins, sigma, outliers, n_jobs)
    assert isinstance(found, TorusSurface)
    return found


def _fit(
    kind: str, points: Any, origins: Any, sigma: Any, outliers: float, n_jobs: int | None
) -> Any:
    scan = as_scan(points, origins, copy=False)
    offset = scan.far_offset
    scan = scan.moved(-offset)
    share = number("outliers", outliers, low=0.0)
    if share >= 0.5:
        raise ValueError(f"outliers must be below 0.5, not {outliers!r}")
    threads = n_jobs_or_none(n_jobs)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    rows, measured = _measured(kind, scan, given)
    starts = first_fits(kind, measured, share, threads)
    fit = last_fit(kind, starts[0], measured, share, threads) if starts else None
    _refuse_simpler(kind, fit, measured, threads)
    assert fit is not None
    return fit.found(rows, threads).moved(offset)


def _measured(kind: str, scan: Scan, sigma: Any) -> tuple[Ints, Measured]:
    """Rows of the returns, sorted by their coordinates, and what was measured there."""
    rows = np.flatnonzero(scan.is_return)
    least = N_PARAMETERS[kind] + 1
    if len(rows) < least:
        raise ValueError(
            f"points must hold at least {least} returns, since a {kind} needs as many, "
            f"not {len(rows)}"
        )
    rows = rows[np.lexsort(scan.points[rows].T[::-1])]
    points = np.ascontiguousarray(scan.points[rows])
    n_different = 1 + int((points[1:] != points[:-1]).any(axis=1).sum())
    if n_different < least:
        raise ValueError(
            f"points must hold at least {least} different ones for a {kind}, not {n_different}"
        )
    size = extent(points)
    noise = None
    if sigma is not None and np.any(np.asarray(sigma) > 0.0):
        noise = np.broadcast_to(np.asarray(sigma, dtype=float), len(scan))[rows]
        noise = np.maximum(noise, _EXACT * size)
    beams = np.ascontiguousarray(scan.directions[rows]) if scan.has_origins else None
    return rows, Measured(points, noise, beams, size)


def _refuse_simpler(kind: str, fit: LastFit | None, measured: Measured, n_jobs: int | None) -> None:
    """Refuse points that tell no surface of a kind, or a limit of it, such as a plane, as well."""
    if fit is not None:
        measured = measured.among(fit.is_inlier)
    least = _EXACT * measured.size

    def price(of: str, numbers: Floats) -> float:
        spread = max(scale_of(of, numbers, measured), least)
        return len(measured.points) * float(np.log(spread)) + _CLEAR * N_PARAMETERS[of]

    own = np.inf if fit is None else price(kind, fit.numbers)
    rivals = [
        (price(simpler, start), simpler, start)
        for simpler in _SIMPLER[kind]
        for start in first_fits(simpler, measured, 0.0, n_jobs)[:1]
    ]
    for other, simpler, start in sorted(rivals, key=lambda each: each[0])[:1]:
        if other < own:
            spread = scale_of(simpler, start, measured)
            raise ValueError(
                f"points must tell a {kind}, but lie on a {simpler} as well as on any "
                f"(rms {spread:.3g} m, in an extent of {measured.size:.3g} m)"
            )
    if fit is None or not fit.is_determined:
        raise ValueError(f"points must determine a {kind}, but leave some of its parameters open")
