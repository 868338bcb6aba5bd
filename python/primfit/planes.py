"""Planes of a point cloud: the public results, and the call that finds nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError
from tqdm import tqdm

from primfit._check import Bools, Floats, Ints, frozen, integer, n_jobs_or_none, number
from primfit.noise import FLOOR, estimate_sigma
from primfit.outlines import outline
from primfit.peeling import Patch, Peeling, find_planes
from primfit.ransac import Cloud, Orientation, PlaneModel, find_plane, fit
from primfit.scans import Scan, as_sigma
from primfit.surfaces import flat_parts

Progress = bool | Callable[[int, int], None]

SIGMAS = 3.0
"""Standard deviations within which a point counts as an inlier."""

_REACH = 4.0
"""Standard deviations within which a plane takes points that lie amid its own."""

_WORSE = 1.5
"""How much farther from the wanted plane than from its own the points of a part may lie."""


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
        Outline of the inliers within the plane, counter-clockwise around the normal. Convex where
        it comes with solids; from `detect_planes` it may be concave.
    area : float, square metres
        Within the boundary, less the holes.
    rms : float, metres
        Root mean square distance of the inliers: along the beams where they are known, else
        perpendicular.
    covariance : (4, 4) float64
        Of the equation; NaN when the plane was not fitted.
    holes : tuple of (k, 3) float64, metres
        Outlines of what lies within the boundary without points, clockwise around the normal.
    """

    equation: Floats
    inliers: Ints
    boundary: Floats
    area: float
    rms: float
    covariance: Floats
    holes: tuple[Floats, ...] = ()

    @property
    def center(self) -> Floats:
        """Mean of the boundary's corners (3,), metres."""
        mean: Floats = self.boundary.mean(axis=0)
        return mean

    @property
    def centroid(self) -> Floats:
        """Centre of the area within the boundary, less the holes (3,), metres."""
        axes = axes_of(self.equation[:3])
        place = self.boundary.mean(axis=0)
        rings = [(ring - place) @ axes.T for ring in (self.boundary, *self.holes)]
        if len(self.boundary) < 3:
            return place
        middle = shapely.Polygon(rings[0], rings[1:]).centroid
        centroid: Floats = place + np.array([middle.x, middle.y]) @ axes
        return centroid

    def moved(self, offset: Floats) -> Plane:
        """The plane moved by a vector (3,), metres."""
        shift = np.eye(4)
        shift[3, :3] = -offset
        return replace(
            self,
            equation=frozen(shift @ self.equation),
            boundary=frozen(self.boundary + offset),
            covariance=frozen(shift @ self.covariance @ shift.T),
            holes=tuple(frozen(hole + offset) for hole in self.holes),
        )

    def __repr__(self) -> str:
        a, b, c, d = self.equation
        return (
            f"Plane([{a:.4f}, {b:.4f}, {c:.4f}, {d:.4f}], {len(self.inliers)} inliers, "
            f"{self.area:.3f} m2, rms {self.rms * 1000:.2f} mm)"
        )


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of a cloud, the one with the most points first.

    Attributes
    ----------
    planes : tuple of Plane
    labels : (n,) int64
        Plane of each point, -1 for none.
    sigma : float, metres
        Noise: given, or the root mean square distance that half of the labelled points' planes
        do not exceed.
    thresholds : (k,) float64, metres
        Distance within which each plane takes points.
    settings : dict
        What the search used.
    """

    planes: tuple[Plane, ...]
    labels: Ints
    sigma: float
    thresholds: Floats
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
    min_points: int | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Planes:
    """Planes of a point cloud of any kind and scale; nothing needs to be told.

    The smallest flat neighbourhood of each point tells the noise there; parts grow from the
    flattest ones, compete for the points and are put together where one plane explains two (see
    `primfit.surfaces`). Curved surfaces and scattered points stay without a plane. Coplanar parts
    with a gap between them are planes of their own.

    Parameters
    ----------
    points : (n, 3) float64, metres, or Scan
    origins : (n, 3), (3,) or None, metres
        Where the sensor was; with it planes are fitted to the ranges, and their normals point to
        the sensor. Else the largest component of each normal is positive.
    sigma : float, (n,) or None, metres
        Noise; None is estimated around each point.
    rng : None, int or numpy.random.Generator
        Taken as everywhere else; nothing is drawn at random here.
    orientation : str or (3,)
        "any", "vertical", "horizontal", or the axis of the normal. It holds for the fitted plane;
        parts that do not lie on such a plane as well as on their own are left out.
    max_angle : float or None, radians
        How far a normal may be off the orientation; None for 0.
    threshold : float or None, metres
        Greatest distance of an inlier, for all planes; stands for three sigma. None: each plane's
        own, which `Planes.thresholds` reports.
    min_points : int or None
        Least inliers; None for 10, and as many as make a plane unlikely to be chance.
    n_jobs : int or None
        Threads; None for all. The result does not depend on them.
    progress : bool or callable
        True shows a bar; a callable gets the number of planes done and in all.

    Returns
    -------
    Planes
        Takes about 300 bytes a point beyond the input.

    Raises
    ------
    ValueError
        When points are not finite, or fewer than a plane needs.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> xy = np.random.default_rng(1).uniform(size=(500, 2))
    >>> planes = primfit.detect_planes(np.column_stack([xy, np.ones(500)]))
    >>> len(planes), f"{planes[0].rms:.6f}"
    (1, '0.000000')
    """
    if isinstance(points, Scan):
        if origins is not None:
            raise ValueError("origins must be None for a Scan, which has its own")
        scan = points
    else:
        # Nobody sees the scan, so it need not own its points.
        cloud = np.asarray(points).view()
        cloud.setflags(write=False)
        scan = Scan.from_points(cloud, origins, sigma)
    np.random.default_rng(rng)
    offset = scan.far_offset
    scan = scan.moved(-offset)
    wanted = Orientation.of(orientation, max_angle)
    rows = np.flatnonzero(scan.is_return)
    check_enough(rows)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    limit = None if threshold is None else number("threshold", threshold, above=0.0)
    least = 3 if min_points is None else integer("min_points", min_points, low=3)
    n_jobs = n_jobs_or_none(n_jobs)
    noise = None if given is None else np.broadcast_to(np.asarray(given, float), len(scan))[rows]
    if limit is not None:
        noise = np.full(len(rows), limit / SIGMAS)
    if noise is not None and not noise.any():
        noise = None
    cloud = scan.points if len(rows) == len(scan) else scan.points[rows]
    parts = flat_parts(cloud, noise, n_jobs)
    directions = np.ascontiguousarray(scan.directions[rows]) if scan.has_origins else None
    members = _members(parts.labels)
    planes: list[Plane] = []
    thresholds: list[float] = []
    labels = np.full(len(scan), -1, dtype=np.int64)
    with tqdm(total=len(members), unit="plane", disable=progress is not True) as bar:
        for number_, own in enumerate(members):
            fitted = _fit_part(
                cloud[own],
                None if directions is None else directions[own],
                parts.sigma[own],
                wanted,
                limit,
            )
            bar.update()
            if callable(progress):
                progress(number_ + 1, len(members))
            if fitted is None or fitted[1].sum() < least:
                continue
            model, is_near, reach = fitted
            inliers = rows[own[is_near]]
            labels[inliers] = len(planes)
            planes.append(_plane_of(model, scan.points[inliers], inliers).moved(offset))
            thresholds.append(reach)
    if given is not None:
        used = float(np.median(given))
    else:
        found = labels[labels >= 0]
        rms = np.array([plane.rms for plane in planes])
        used = float(np.median(rms[found] if len(found) else parts.sigma))
    settings = {
        "threshold": float(np.median(thresholds)) if thresholds else SIGMAS * used,
        "n_neighbors": parts.n_neighbors,
        "min_points": least,
    }
    return Planes(tuple(planes), frozen(labels), used, frozen(np.array(thresholds)), settings)


def _members(labels: Ints) -> list[Ints]:
    """Rows of each label, rising."""
    order = np.argsort(labels, kind="stable")
    counts = np.bincount(labels[labels >= 0])
    return (
        np.split(order[len(labels) - counts.sum() :], np.cumsum(counts)[:-1]) if len(counts) else []
    )


def _fit_part(
    points: Floats,
    directions: Floats | None,
    sigma: Floats,
    wanted: Orientation,
    limit: float | None,
) -> tuple[PlaneModel, Bools, float] | None:
    """The wanted plane through a part, which of its points are near, and how near that is."""
    local = points - points.mean(axis=0)
    normal = np.linalg.eigh(local.T @ local)[1][:, 0]
    rms = float(np.sqrt(np.mean((local @ normal) ** 2)))
    spread = max(rms, float(np.median(sigma)), FLOOR * float(np.abs(local).max()), 1e-100)
    facing = normal[np.abs(normal).argmax()] if directions is None else -(directions @ normal).sum()
    normal = np.copysign(1.0, facing) * normal
    start = np.append(normal, -normal @ points.mean(axis=0))
    each = np.full(len(points), spread)
    reach = _REACH * spread if limit is None else limit
    cloud = Cloud(points, directions, each, np.full(len(points), reach))
    model = fit(cloud, start, wanted)
    if model is None and directions is not None:
        # Where beams graze, or both sides are seen, only the distances tell the plane.
        cloud = replace(cloud, directions=None)
        model = fit(cloud, start, wanted)
    if model is None:
        return None
    distance = points @ model.equation[:3] + model.equation[3]
    if np.sqrt(np.mean(distance**2)) > _WORSE * spread:
        return None
    return model, np.abs(distance) <= reach, reach


def _plane_of(model: PlaneModel, points: Floats, inliers: Ints) -> Plane:
    equation = model.equation
    axes = axes_of(equation[:3])
    place = points.mean(axis=0)
    place = place - (equation[:3] @ place + equation[3]) * equation[:3]
    shape = shapely.geometry.polygon.orient(outline((points - place) @ axes.T))
    middle = ((points - place) @ axes.T).mean(axis=0)
    rings = [
        frozen(place + (shapely.get_coordinates(ring)[:-1] + middle) @ axes)
        for ring in ((shape.exterior, *shape.interiors) if not shape.is_empty else ())
    ]
    return Plane(
        equation=frozen(equation),
        inliers=frozen(inliers),
        boundary=rings[0] if rings else frozen(np.empty((0, 3))),
        area=float(shape.area),
        rms=model.rms,
        covariance=frozen(model.covariance),
        holes=tuple(rings[1:]),
    )


def axes_of(normal: Floats) -> Floats:
    """Directions (2, 3) within a plane, right-handed with its normal."""
    up = np.eye(3)[2 if abs(normal[2]) < 0.9 else 1]
    along = np.cross(up, normal)
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along)])


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
