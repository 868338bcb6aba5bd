"""Bounded planes: the public results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import shapely
from scipy.spatial import ConvexHull, QhullError

from primfit._check import Floats, Ints, writable
from primfit._later import Later, called, mapped, replaced
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry.products import product
from primfit.viewing.shown import Shown


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
        it comes with solids; from `detect_planes` it may be concave, and is drawn, with those of
        all planes of the call, when the first of them is asked for.
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
    boundary: Later[Floats] = Later()  # noqa: RUF009
    area: Later[float] = Later()  # noqa: RUF009
    # A field that may come later has no default, which mypy cannot tell.
    rms: float  # type: ignore[misc]
    covariance: Floats  # type: ignore[misc]
    holes: Later[tuple[Floats, ...]] = Later(())  # noqa: RUF009

    kind: ClassVar[str] = "plane"

    def __post_init__(self) -> None:
        for name in ("equation", "inliers", "boundary", "covariance"):
            value = vars(self)[name]
            if not callable(value):
                object.__setattr__(self, name, writable(value))

    def __getstate__(self) -> dict[str, Any]:
        return called(self)

    @property
    def parameters(self) -> Floats:
        """What `covariance` is of: the equation (4,)."""
        return self.equation

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: of the normal, radians, and of the offset d, metres."""
        variances = np.diag(self.covariance)
        return {
            "normal": float(np.sqrt(variances[:3].sum())),
            "offset": float(np.sqrt(variances[3])),
        }

    def distances(self, points: PointsLike) -> Floats:
        """Signed distances (n,) of points (n, 3), metres, positive where the normal points."""
        rows = points_of("points", points)
        return product(rows, self.equation[:3, None])[:, 0] + self.equation[3]

    def normals(self, points: PointsLike) -> Floats:
        """Unit normals (n, 3) at the feet of points (n, 3)."""
        return np.broadcast_to(self.equation[:3], points_of("points", points).shape).copy()

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
        rings = [product(ring - place, axes.T) for ring in (self.boundary, *self.holes)]
        if len(self.boundary) < 3:
            return place
        middle = shapely.Polygon(rings[0], rings[1:]).centroid
        centroid: Floats = place + product(np.array([[middle.x, middle.y]]), axes)[0]
        return centroid

    def moved(self, offset: Floats) -> Plane:
        """The plane moved by a vector (3,), metres."""
        if not offset.any():
            return self
        shift = np.eye(4)
        shift[3, :3] = -offset
        return replaced(
            self,
            equation=product(shift, self.equation[:, None])[:, 0],
            boundary=mapped(self, "boundary", lambda ring: ring + offset),
            covariance=product(product(shift, self.covariance), shift.T),
            holes=mapped(self, "holes", lambda holes: tuple(hole + offset for hole in holes)),
        )

    def __repr__(self) -> str:
        a, b, c, d = self.equation
        return (
            f"Plane([{a:.4f}, {b:.4f}, {c:.4f}, {d:.4f}], {len(self.inliers)} inliers, "
            f"{self.area:.3f} m2, rms {self.rms * 1000:.2f} mm)"
        )


@dataclass(frozen=True, eq=False)
class Planes(Shown):
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
        What the search used: "threshold", metres, the median of the thresholds; "n_neighbors" that
        a point touches; "min_points" of a plane; "stride", one point in how many was enough to find
        the planes (1 but for clouds whose points crowd along rows).
    firmness : (k,) float64
        How much of each plane is found again when one in twenty points is missing, from 0 to 1:
        from 0.85 on it is firm; below 0.6 the points do not decide how they are parted there (see
        `primfit.planes.firmness`). Asking takes the time of three searches, once. NaN by
        tiles.
    """

    planes: tuple[Plane, ...]
    labels: Ints
    sigma: float
    thresholds: Floats
    settings: dict[str, Any]
    firmness: Later[Floats] = Later(partial(np.empty, 0))  # noqa: RUF009

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

    def _repr_html_(self) -> str:
        from primfit._tables import planes_html

        return planes_html(self.planes, repr(self))

    def __repr__(self) -> str:
        share = float((self.labels >= 0).mean()) if len(self.labels) else 0.0
        return (
            f"Planes({len(self)} planes, {share:.0%} of {len(self.labels)} points, "
            f"sigma {self.sigma * 1000:.3g} mm)"
        )


def planes_of(planes: Iterable[Plane], n_points: int) -> tuple[Plane, ...]:
    """The argument `planes`, when each is a plane of a cloud of so many points.

    Raises
    ------
    TypeError, ValueError
        When one is none, or its inliers are no rows of the cloud.
    """
    try:
        chosen = tuple(planes)
    except TypeError:
        raise TypeError(
            f"planes must be an iterable of Plane, not {type(planes).__name__}"
        ) from None
    for i, plane in enumerate(chosen):
        if not isinstance(plane, Plane):
            raise TypeError(f"planes[{i}] must be a Plane, not {type(plane).__name__}")
        rows = plane.inliers
        if len(rows) and not (rows.min() >= 0 and rows.max() < n_points):
            raise ValueError(
                f"planes[{i}] must be of points, but has row {rows.max()} of {n_points} among its "
                f"inliers: it may be of another cloud"
            )
    return chosen


def axes_of(normal: Floats) -> Floats:
    """Directions (2, 3) within a plane, right-handed with its normal."""
    a, b, c = normal.tolist()
    # Across the normal and the z axis, or the y axis.
    x, y, z = (-b, a, 0.0) if abs(c) < 0.9 else (c, 0.0, -a)
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    return np.array([[x, y, z], [b * z - c * y, c * x - a * z, a * y - b * x]])


def hull(at: Floats) -> tuple[Ints, float]:
    """Corners of the convex hull of points in the plane, and its area."""
    if len(at) < 3:
        return np.arange(len(at)), 0.0
    try:
        hull = ConvexHull(at - at.mean(axis=0))
        return hull.vertices, float(hull.volume)
    except QhullError:
        return np.arange(2), 0.0
