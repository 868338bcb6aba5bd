"""Surfaces that were found: sphere, cylinder, cone, torus."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from primfit._check import Floats, Ints
from primfit._later import replaced
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry.products import dots, lengths_of
from primfit.surfaces.charts import (
    Chart,
    angles_about,
    arc_of,
    cone_chart,
    cylinder_chart,
    sphere_chart,
    torus_chart,
)
from primfit.surfaces.found import FoundSurface, row_of

N_PARAMETERS = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6, "torus": 7}
"""Parameters of each kind that points determine."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SphereSurface(FoundSurface):
    """A sphere, or a part of one, as points show it.

    Attributes
    ----------
    center : (3,) float64, metres
    radius : float, metres
    covariance : (4, 4) float64
        Of center and radius.
    """

    center: Floats
    radius: float

    kind = "sphere"
    _sigmas: ClassVar[dict[str, slice]] = {"center": slice(0, 3), "radius": slice(3, 4)}

    @property
    def parameters(self) -> Floats:
        """What `covariance` is of (p,)."""
        return np.append(self.center, self.radius)

    def distances(self, points: PointsLike) -> Floats:
        """Signed distances (n,) of points (n, 3), metres, positive away from axis or centre."""
        distances: Floats = lengths_of(points_of("points", points) - self.center) - self.radius
        return distances

    def normals(self, points: PointsLike) -> Floats:
        """Unit normals (n, 3) at the feet of points (n, 3), away from axis or centre."""
        away = points_of("points", points) - self.center
        normals: Floats = away / lengths_of(away)[:, None]
        return normals

    def _chart(self, points: Floats) -> Chart:
        return sphere_chart(self.center, self.radius, points)

    def __repr__(self) -> str:
        return self._told(f"center={row_of(self.center)}, radius={self.radius:.4f} m")


class _Round(FoundSurface):
    """Distances and normals by the place in the plane through the axis."""

    axis: Floats

    @property
    @abstractmethod
    def _place(self) -> Floats:
        """A point of the axis (3,), metres."""

    @abstractmethod
    def _profile(self, rho: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        """Distance, and the normal's part away from the axis and along it."""

    def _sights(self, points: PointsLike) -> tuple[Floats, Floats]:
        away = points_of("points", points) - self._place
        height = dots(away, self.axis)
        across = away - height[:, None] * self.axis
        rho = lengths_of(across)
        distance, out, up = self._profile(rho, height)
        with np.errstate(invalid="ignore", divide="ignore"):
            radial = across / rho[:, None]
        return distance, out[:, None] * radial + up[:, None] * self.axis

    def distances(self, points: PointsLike) -> Floats:
        """Signed distances (n,) of points (n, 3), metres, positive away from axis or centre."""
        return self._sights(points)[0]

    def normals(self, points: PointsLike) -> Floats:
        """Unit normals (n, 3) at the feet of points (n, 3), away from axis or centre."""
        return self._sights(points)[1]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CylinderSurface(_Round):
    """A circular cylinder without its ends, or a strip of one, as points show it.

    Attributes
    ----------
    center : (3,) float64, metres
        Of its axis, in the middle between its ends.
    axis : (3,) float64
        Unit direction; its largest component is positive.
    radius : float, metres
    length : float, metres
        Between the outermost points along the axis.
    arc : float, radians
        Angle about the axis that its points cover; 2 pi all around.
    covariance : (7, 7) float64
        Of center, axis and radius, of rank 5: the place along the axis is that of the points.
    """

    center: Floats
    axis: Floats
    radius: float
    length: float
    arc: float

    kind = "cylinder"
    _sigmas: ClassVar[dict[str, slice]] = {
        "center": slice(0, 3),
        "axis": slice(3, 6),
        "radius": slice(6, 7),
    }

    @property
    def parameters(self) -> Floats:
        """What `covariance` is of (p,)."""
        return np.concatenate([self.center, self.axis, [self.radius]])

    @property
    def extent(self) -> tuple[float, float]:
        """Ends along the axis, counted from the centre, metres."""
        return -self.length / 2.0, self.length / 2.0

    @property
    def _place(self) -> Floats:
        return self.center

    def _profile(self, rho: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        return rho - self.radius, np.ones_like(rho), np.zeros_like(rho)

    def _chart(self, points: Floats) -> Chart:
        return cylinder_chart(self.center, self.axis, self.radius, points)

    def __repr__(self) -> str:
        return self._told(
            f"center={row_of(self.center)}, axis={row_of(self.axis)}, radius={self.radius:.4f} m, "
            f"length={self.length:.4f} m, arc={np.degrees(self.arc):.0f} deg"
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ConeSurface(_Round):
    """A circular cone or truncated cone without its ends, or a strip of one, as points show it.

    Attributes
    ----------
    apex : (3,) float64, metres
    axis : (3,) float64
        Unit direction from the apex to where the cone opens.
    angle : float, radians
        Between axis and surface (half of the opening).
    extent : (float, float), metres
        Ends along the axis, counted from the apex.
    arc : float, radians
        Angle about the axis that its points cover; 2 pi all around.
    covariance : (7, 7) float64
        Of apex, axis and angle, of rank 6.
    """

    apex: Floats
    axis: Floats
    angle: float
    extent: tuple[float, float]
    arc: float

    kind = "cone"
    _sigmas: ClassVar[dict[str, slice]] = {
        "apex": slice(0, 3),
        "axis": slice(3, 6),
        "angle": slice(6, 7),
    }

    @property
    def parameters(self) -> Floats:
        """What `covariance` is of (p,)."""
        return np.concatenate([self.apex, self.axis, [self.angle]])

    @property
    def length(self) -> float:
        """Between the outermost points along the axis, metres."""
        return self.extent[1] - self.extent[0]

    @property
    def radii(self) -> tuple[float, float]:
        """Radii at both ends, metres; the smaller one first."""
        slope = float(np.tan(self.angle))
        return max(self.extent[0], 0.0) * slope, self.extent[1] * slope

    @property
    def _place(self) -> Floats:
        return self.apex

    def _profile(self, rho: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        distance = rho * cosine - height * sine
        return distance, np.full_like(rho, cosine), np.full_like(rho, -sine)

    def _chart(self, points: Floats) -> Chart:
        return cone_chart(self.apex, self.axis, self.angle, points)

    def __repr__(self) -> str:
        return self._told(
            f"apex={row_of(self.apex)}, axis={row_of(self.axis)}, "
            f"angle={np.degrees(self.angle):.2f} deg, length={self.length:.4f} m, "
            f"arc={np.degrees(self.arc):.0f} deg"
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TorusSurface(_Round):
    """A torus, or a part of one such as the bend of a pipe, as points show it.

    Attributes
    ----------
    center : (3,) float64, metres
    axis : (3,) float64
        Unit direction; its largest component is positive.
    major_radius : float, metres
        Of the circle that the tube is about.
    radius : float, metres
        Of the tube.
    arc : float, radians
        Angle about the axis that its points cover; 2 pi all around.
    covariance : (8, 8) float64
        Of center, axis, major_radius and radius, of rank 7.
    """

    center: Floats
    axis: Floats
    major_radius: float
    radius: float
    arc: float

    kind = "torus"
    _sigmas: ClassVar[dict[str, slice]] = {
        "center": slice(0, 3),
        "axis": slice(3, 6),
        "major_radius": slice(6, 7),
        "radius": slice(7, 8),
    }

    @property
    def parameters(self) -> Floats:
        """What `covariance` is of (p,)."""
        return np.concatenate([self.center, self.axis, [self.major_radius, self.radius]])

    @property
    def _place(self) -> Floats:
        return self.center

    def _profile(self, rho: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        ring = rho - self.major_radius
        arm = np.hypot(ring, height)
        with np.errstate(invalid="ignore", divide="ignore"):
            return arm - self.radius, ring / arm, height / arm

    def _chart(self, points: Floats) -> Chart:
        return torus_chart(self.center, self.axis, self.major_radius, self.radius, points)

    def __repr__(self) -> str:
        return self._told(
            f"center={row_of(self.center)}, axis={row_of(self.axis)}, "
            f"major_radius={self.major_radius:.4f} m, radius={self.radius:.4f} m, "
            f"arc={np.degrees(self.arc):.0f} deg"
        )


CurvedSurface = SphereSurface | CylinderSurface | ConeSurface | TorusSurface


def surface_of(
    kind: str,
    numbers: Floats,
    covariance: Floats,
    points: Floats,
    on_it: Ints,
    **common: Any,
) -> CurvedSurface:
    """A found surface from what the fit returned.

    Parameters
    ----------
    kind : str
    numbers : (8,) float64
        Place, axis and sizes; of a cone cosine and sine of its half angle.
    covariance : (8, 8) float64
        Of place, axis and sizes, or half angle.
    points : (n, 3) float64, metres
        May be changed afterwards.
    on_it : (m,) int64
        Which of them lie on the surface.
    **common
        What all kinds have.
    """
    place, axis, (first, second) = numbers[:3], numbers[3:6], numbers[6:]
    own = points[on_it]
    if kind != "cone" and axis[np.abs(axis).argmax()] < 0.0:
        axis, covariance = -axis, _turned_over(covariance)
    found: CurvedSurface
    if kind == "sphere":
        kept = [0, 1, 2, 6]
        found = SphereSurface(
            center=place, radius=float(first), covariance=covariance[np.ix_(kept, kept)], **common
        )
    else:
        angles, _, height = angles_about(place, axis, own)
        arc = arc_of(angles)[0]
        if kind == "torus":
            found = TorusSurface(
                center=place,
                axis=axis,
                major_radius=float(first),
                radius=float(second),
                arc=arc,
                covariance=covariance,
                **common,
            )
        elif kind == "cone":
            found = ConeSurface(
                apex=place,
                axis=axis,
                angle=float(np.arctan2(second, first)),
                extent=(float(height.min()), float(height.max())),
                arc=arc,
                covariance=covariance[:7, :7],
                **common,
            )
        else:
            length = 2.0 * float(np.abs(height).max())
            found = CylinderSurface(
                center=place,
                axis=axis,
                radius=float(first),
                length=length,
                arc=arc,
                covariance=covariance[:7, :7],
                **common,
            )
    return replaced(found, patch=lambda: found._chart(own).patch())


def _turned_over(covariance: Floats) -> Floats:
    """The covariance (8, 8) where the axis points the other way."""
    sign = np.ones(8)
    sign[3:6] = -1.0
    turned: Floats = covariance * sign[:, None] * sign
    return turned
