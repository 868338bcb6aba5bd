"""Planes of a point cloud: the public results, and the call that finds nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError
from tqdm import tqdm

from primfit._check import Floats, Ints, frozen, integer, n_jobs_or_none, number
from primfit.noise import FLOOR, estimate_sigma
from primfit.peeling import Patch, Peeling, find_planes
from primfit.ransac import Cloud, Orientation, find_plane
from primfit.scans import Scan, as_sigma

Progress = bool | Callable[[int, int], None]

SIGMAS = 3.0
"""Standard deviations within which a point counts as an inlier."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A bounded plane.

    Attributes
    ----------
    equation : (4,) float64
        ``[a, b, c, d]`` with a unit normal, ``a x + b y + c z + d = 0``; the normal points to
        free space where the sensor is known.
    inliers : (m,) int64
        Rows of the scan or cloud.
    boundary : (k, 3) float64, metres
        Convex hull of the inliers within the plane, counter-clockwise around the normal.
    area : float, square metres
        Of the boundary.
    rms : float, metres
        Root mean square distance of the inliers: along the beams where they are known, else
        perpendicular.
    covariance : (4, 4) float64
        Of the equation; NaN when the plane was not fitted.
    """

    equation: Floats
    inliers: Ints
    boundary: Floats
    area: float
    rms: float
    covariance: Floats

    @property
    def center(self) -> Floats:
        """Mean of the boundary's corners (3,), metres."""
        mean: Floats = self.boundary.mean(axis=0)
        return mean

    def moved(self, offset: Floats) -> Plane:
        """The plane moved by a vector (3,), metres."""
        shift = np.eye(4)
        shift[3, :3] = -offset
        return replace(
            self,
            equation=frozen(shift @ self.equation),
            boundary=frozen(self.boundary + offset),
            covariance=frozen(shift @ self.covariance @ shift.T),
        )

    def __repr__(self) -> str:
        a, b, c, d = self.equation
        return (
            f"Plane([{a:.4f}, {b:.4f}, {c:.4f}, {d:.4f}], {len(self.inliers)} inliers, "
            f"{self.area:.3f} m2, rms {self.rms * 1000:.2f} mm)"
        )


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of a cloud, in the order in which they were found.

    Attributes
    ----------
    planes : tuple of Plane
    labels : (n,) int64
        Plane of each point, -1 for none.
    sigma : float, metres
        Noise that was given or estimated.
    settings : dict
        What the search used; lengths in metres.
    """

    planes: tuple[Plane, ...]
    labels: Ints
    sigma: float
    settings: dict[str, Any]

    @property
    def equations(self) -> Floats:
        """Equations (k, 4)."""
        return np.array([plane.equation for plane in self.planes]).reshape(-1, 4)

    def __len__(self) -> int:
        return len(self.planes)

    def __getitem__(self, i: int) -> Plane:
        return self.planes[i]

    def __iter__(self) -> Iterator[Plane]:
        return iter(self.planes)

    def __repr__(self) -> str:
        share = float((self.labels >= 0).mean()) if len(self.labels) else 0.0
        return (
            f"Planes({len(self)} planes, {share:.0%} of {len(self.labels)} points, "
            f"sigma {self.sigma * 1000:.3g} mm)"
        )


def detect_planes(
    points: ArrayLike | Scan,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    rng: Any = None,
    *,
    orientation: Any = "any",
    max_angle: float | None = None,
    threshold: float | None = None,
    eps: float | None = None,
    min_points: int | None = None,
    max_trials: int = 512,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Planes:
    """Planes of a point cloud, by RANSAC and DBSCAN, refitted by least squares.

    Parameters
    ----------
    points : (n, 3) float64, metres, or Scan
    origins : (n, 3), (3,) or None, metres
        Where the sensor was; with it distances are taken along the beams.
    sigma : float, (n,) or None, metres
        Noise; None is estimated from the cloud.
    rng : None, int or numpy.random.Generator
        Same `rng`, same planes, at any number of threads.
    orientation : str or (3,)
        "any", "vertical", "horizontal", or the axis of the normal.
    max_angle : float or None, radians
        How far a normal may be off the orientation.
    threshold : float or None, metres
        Greatest distance of an inlier; None for three sigma.
    eps : float or None, metres
        Of DBSCAN; None for the spacing of the points that are left.
    min_points : int or None
        Least inliers; None for 1 in 500 points, at least 10.
    max_trials : int
        Most hypotheses for one plane.
    n_jobs : int or None
        Threads; None for all.
    progress : bool or callable
        True shows a bar; a callable gets the number of points done and in all.

    Returns
    -------
    Planes
        Takes about 400 bytes a point beyond the input.

    Raises
    ------
    ValueError
        When points are not finite, or fewer than a plane needs.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> xy = np.random.default_rng(1).uniform(size=(500, 2))
    >>> planes = primfit.detect_planes(np.column_stack([xy, np.ones(500)]), rng=1)
    >>> len(planes), f"{planes[0].rms:.6f}"
    (1, '0.000000')
    """
    if isinstance(points, Scan):
        if origins is not None:
            raise ValueError("origins must be None for a Scan, which has its own")
        scan = points
    else:
        scan = Scan.from_points(points, origins, sigma)
    offset = scan.far_offset
    scan = scan.moved(-offset)
    wanted = Orientation.of(orientation, max_angle)
    rng = np.random.default_rng(rng)
    rows = np.flatnonzero(scan.is_return)
    check_enough(rows)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    cloud, used = cloud_of(scan, rows, given, rng, threshold=threshold)
    if min_points is None:
        min_points = max(10, len(rows) // 500)
    how = Peeling(
        orientation=wanted,
        eps=None if eps is None else number("eps", eps, above=0.0),
        min_points=integer("min_points", min_points, low=3),
        max_trials=integer("max_trials", max_trials, low=1),
        local=True,
        msac=True,
        refit=True,
        compete=True,
    )
    seen = scan if scan.has_origins else None
    patches, used_eps = peel_with_progress(cloud, how, rng, seen, n_jobs_or_none(n_jobs), progress)
    planes, labels = bounded(patches, cloud, rows, len(scan))
    settings = {
        "threshold": float(np.median(cloud.limit)),
        "eps": used_eps,
        "min_points": how.min_points,
        "max_trials": how.max_trials,
    }
    return Planes(tuple(plane.moved(offset) for plane in planes), labels, used, settings)


def check_enough(rows: Ints) -> None:
    """Refuse clouds without a plane's worth of points."""
    if len(rows) < 3:
        raise ValueError(
            f"points must hold at least 3 returns, since a plane needs as many, not {len(rows)}"
        )


def cloud_of(
    scan: Scan,
    rows: Ints,
    sigma: Any,
    rng: np.random.Generator,
    *,
    threshold: float | None = None,
    along_beams: bool = True,
) -> tuple[Cloud, float]:
    """Some returns of a scan as a cloud, and the noise that was given or estimated."""
    points = np.ascontiguousarray(scan.points[rows])
    directions = None
    if along_beams and scan.has_origins:
        directions = np.ascontiguousarray(scan.directions[rows])
    if sigma is None:
        sigma = estimate_sigma(points, directions, rng)
    spread = np.broadcast_to(np.asarray(sigma, dtype=float), len(scan))[rows]
    extent, farthest = float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
    least = max(FLOOR * extent, 4.0 * np.finfo(float).eps * farthest, 1e-100)
    each = np.maximum(spread, least)
    limit = SIGMAS * each
    if threshold is not None:
        limit = np.full(len(rows), number("threshold", threshold, above=0.0))
    return Cloud(points, directions, each, limit), float(np.median(spread))


def peel_with_progress(
    cloud: Cloud,
    how: Peeling,
    rng: np.random.Generator,
    scan: Scan | None,
    n_jobs: int | None,
    progress: Progress,
) -> tuple[list[Patch], float]:
    """`find_planes`, with a bar or a callable told of the points that are done."""
    with tqdm(total=len(cloud), unit="point", disable=progress is not True) as bar:

        def on_plane(n_done: int, n_all: int) -> None:
            bar.update(n_done - bar.n)
            if callable(progress):
                progress(n_done, n_all)

        return find_planes(cloud, how, rng, scan=scan, n_jobs=n_jobs, on_plane=on_plane)


def bounded(
    patches: list[Patch], cloud: Cloud, rows: Ints, n: int
) -> tuple[tuple[Plane, ...], Ints]:
    """Patches as public planes, and the plane of each of n rows of the scan.

    `rows` are the scan's row numbers of the cloud. A point of two patches is the nearer one's.
    """
    owner = np.full(len(cloud), -1, dtype=np.int64)
    nearest = np.full(len(cloud), np.inf)
    for number_, patch in enumerate(patches):
        distance = np.abs(cloud.take(patch.inliers).residuals(patch.model.equation))
        closer = distance < nearest[patch.inliers]
        owner[patch.inliers[closer]] = number_
        nearest[patch.inliers[closer]] = distance[closer]
    labels = np.full(n, -1, dtype=np.int64)
    labels[rows] = owner
    planes = []
    for number_, patch in enumerate(patches):
        equation = patch.model.equation
        own = np.flatnonzero(owner == number_)
        at = cloud.take(own).feet(equation) @ patch.axes.T
        at = at[np.isfinite(at).all(axis=1)]
        corners, area = hull(at)
        boundary = at[corners] @ patch.axes - equation[3] * equation[:3]
        planes.append(
            Plane(
                equation=frozen(equation),
                inliers=frozen(rows[own]),
                boundary=frozen(boundary),
                area=area,
                rms=patch.model.rms,
                covariance=frozen(patch.model.covariance),
            )
        )
    return tuple(planes), frozen(labels)


def find_floor(cloud: Cloud, rows: Ints, rng: np.random.Generator) -> Plane | None:
    """The horizontal plane that is seen from above and has next to nothing below it."""
    extent = max(float(np.ptp(cloud.points, axis=0).max()), np.finfo(float).tiny)
    level = Orientation.of("horizontal")
    z = cloud.points[:, 2]
    pool = np.arange(len(cloud))
    if cloud.directions is None:
        # Without beams nothing tells the floor from a layer of the scan but that it is lowest.
        lowest = np.quantile(z, 0.01) + 3.0 * float(np.median(cloud.limit))
        pool = np.flatnonzero(z <= lowest)
    found = find_plane(
        cloud.take(pool), level, rng, near=None, eps=extent, min_points=10, max_trials=512
    )
    if found is None:
        return None
    model, inliers = found
    height = z + model.equation[3] / model.equation[2]
    below = (height < 0.0) & (np.abs(cloud.residuals(model.equation)) > 2.0 * cloud.limit)
    if model.equation[2] < 0.0 or below.mean() > 0.01 or len(inliers) < 0.02 * len(cloud):
        return None
    planes, _ = bounded([Patch.of(cloud, model, pool[inliers])], cloud, rows, int(rows[-1]) + 1)
    return planes[0] if planes[0].area > 0.0 else None


def hull(at: Floats) -> tuple[Ints, float]:
    """Corners of the convex hull of points in the plane, and its area."""
    if len(at) < 3:
        return np.arange(len(at)), 0.0
    try:
        hull = ConvexHull(at - at.mean(axis=0))
        return hull.vertices, float(hull.volume)
    except QhullError:
        return np.arange(2), 0.0
