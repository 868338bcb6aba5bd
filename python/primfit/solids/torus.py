"""Rings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from primfit._check import Floats, number
from primfit.geometry.revolution import circle_points
from primfit.solids.round import OUTLINE, Round


@dataclass(frozen=True, eq=False, repr=False)
class Torus(Round):
    """A ring: a tube around a circle, in any position.

    Parameters
    ----------
    major_radius : float, metres
        Of the circle in the middle of the tube.
    radius : float, metres
        Of the tube, less than `major_radius`.
    center : (3,) or (2,) float64 or None, metres
        (2,) is where it lies on the floor, None at the origin.
    axis : (3,) float64
        Of any length but zero.

    Raises
    ------
    ValueError
        When a length is not positive, the tube is wider than the ring, or the axis is zero.

    Examples
    --------
    >>> import primfit
    >>> ring = primfit.Torus(0.3, 0.1)
    >>> ring
    Torus(center=(0.0000, 0.0000, 0.1000), major_radius=0.3 m, radius=0.1 m)
    >>> ring.contains([[0.3, 0, 0.1], [0, 0, 0.1]])
    array([ True, False])
    """

    type_name = "torus"
    _is_closed = True

    major_radius: float
    radius: float
    center: Any = None
    axis: Any = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        major = number("major_radius", self.major_radius, above=0.0)
        object.__setattr__(self, "major_radius", major)
        object.__setattr__(self, "radius", number("radius", self.radius, above=0.0))
        if self.radius >= major:
            raise ValueError(
                f"radius must be less than major_radius ({major:g}), not {self.radius:g}"
            )
        self._settle_axis()
        self._settle_center()

    @property
    def circles(self) -> tuple[tuple[float, float], ...]:
        """The circle in the middle of the tube."""
        return ((0.0, self.major_radius),)

    @property
    def tube(self) -> float:
        """The radius of the tube, metres."""
        return self.radius

    @property
    def row(self) -> Floats:
        """The numbers (10,) by which the ray caster knows it."""
        return np.array([2.0, *self.center, *self.axis, self.major_radius, self.radius, 0.0])

    @property
    def size(self) -> tuple[float, ...]:
        """Radius of the ring, and of its tube; metres."""
        return self.major_radius, self.radius

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Outer diameter, twice, and diameter of the tube; metres."""
        outer = 2.0 * (self.major_radius + self.radius)
        return outer, outer, 2.0 * self.radius

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        return float(2.0 * np.pi**2 * self.major_radius * self.radius**2)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        return self.center.copy()

    @cached_property
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above, with a hole where one sees through it."""
        # Each ball of the tube is seen as a disc, wherever its centre is.
        ring = shapely.LinearRing(shapely.get_coordinates(self._outline_of_circles()))
        return ring.buffer(self.radius, quad_segs=OUTLINE // 4)

    def surfaces(self, points: Floats) -> tuple[Floats, Floats]:
        """Distances (n, 1) outwards, and normals (n, 1, 3)."""
        heights, distances, away = self._along(points)
        off = distances - self.major_radius
        from_circle = np.sqrt(off * off + heights * heights)
        arms = off[:, None] * away + heights[:, None] * self.axis
        out = arms / np.where(from_circle > 0.0, from_circle, 1.0)[:, None]
        return (from_circle - self.radius)[:, None], out[:, None]

    def _profile(self, segments: int) -> Floats:
        circle = circle_points(max(8, segments // 2))
        return self.radius * circle + [self.major_radius, 0.0]

    def __repr__(self) -> str:
        return self._text(f"major_radius={self.major_radius:g} m, radius={self.radius:g} m")
