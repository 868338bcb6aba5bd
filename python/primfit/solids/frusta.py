"""Round solids between two parallel discs: cylinders and cones."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from primfit._check import Floats, number
from primfit.geometry.footprints import ellipse_footprint
from primfit.solids.round import Round


class _Frustum(Round):
    """Between a disc at the base and one at the top, whose radius may be 0."""

    height: float

    @property
    @abstractmethod
    def _radii(self) -> tuple[float, float]:
        """At the base and at the top."""

    @property
    def circles(self) -> tuple[tuple[float, float], ...]:
        """Height along the axis, from the centre, and radius of each end, metres."""
        base, top = self._radii
        return (-self.height / 2, base), (self.height / 2, top)

    @property
    def row(self) -> Floats:
        """The numbers (10,) by which the ray caster knows it."""
        return np.array([1.0, *self.center, *self.axis, self.height / 2, *self._radii])

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Diameter of the larger end, twice, and height along the axis; metres."""
        diameter = 2.0 * max(self._radii)
        return diameter, diameter, self.height

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        a, b = self._radii
        return float(np.pi * self.height * (a * a + a * b + b * b) / 3.0)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        a, b = self._radii
        share = (b * b - a * a) / (4.0 * (a * a + a * b + b * b))
        return self.center + share * self.height * self.axis

    @property
    def normals(self) -> Floats:
        """Outward unit normals (1 or 2, 3) of the flat ends."""
        return np.array([np.sign(h) * self.axis for h, radius in self.circles if radius > 0.0])

    def surfaces(self, points: Floats) -> tuple[Floats, Floats]:
        """Distances (n, 3) to side, base and top, outwards, and normals (n, 3, 3)."""
        heights, distances, away = self._along(points)
        base, top = self._radii
        slope = (top - base) / self.height
        cosine = 1.0 / np.sqrt(1.0 + slope * slope)
        side = cosine * (distances - (base + slope * (heights + self.height / 2)))
        normals = np.stack(
            [
                cosine * (away - slope * self.axis),
                np.broadcast_to(-self.axis, away.shape),
                np.broadcast_to(self.axis, away.shape),
            ],
            axis=1,
        )
        ends = [-self.height / 2 - heights, heights - self.height / 2]
        return np.stack([side, *ends], axis=1), normals

    def _profile(self, segments: int) -> Floats:
        return np.array([[radius, height] for height, radius in self.circles])


@dataclass(frozen=True, eq=False, repr=False)
class Cylinder(_Frustum):
    """A right circular cylinder with flat ends, in any position.

    Parameters
    ----------
    radius, height : float, metres
        `height` is along the axis.
    center : (3,) or (2,) float64 or None, metres
        The middle; (2,) is where it stands on the floor, None at the origin.
    axis : (3,) float64
        Of any length but zero.

    Raises
    ------
    ValueError
        When a length is not positive, or the axis is zero.

    Examples
    --------
    >>> import primfit
    >>> pillar = primfit.Cylinder(0.15, 0.4, center=(1, 1))
    >>> pillar
    Cylinder(center=(1.0000, 1.0000, 0.2000), radius=0.15 m, height=0.4 m)
    >>> pillar.kind, pillar.solid_kind, pillar.contains([[1.1, 1.1, 0.4], [1.2, 1, 0.1]])
    ('circle', 'cylinder', array([ True, False]))
    >>> pipe = primfit.Cylinder(0.1, 2.0, center=(0, 0, 1), axis=(1, 0, 0.2))
    >>> pipe.kind, pipe.dimensions
    ('cylinder', (0.2, 0.2, 2.0))
    """

    type_name = "cylinder"

    radius: float
    height: float
    center: Any = None
    axis: Any = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number("radius", self.radius, above=0.0))
        object.__setattr__(self, "height", number("height", self.height, above=0.0))
        self._settle_axis()
        self._settle_center()

    @property
    def _radii(self) -> tuple[float, float]:
        return self.radius, self.radius

    @property
    def kind(self) -> str:
        """That of a prism over a circle, "circle", when upright; else "cylinder"."""
        return "circle" if self.is_upright else "cylinder"

    @property
    def size(self) -> float | tuple[float, ...]:
        """Radius of an upright one; (radius, height) of others; metres."""
        return self.radius if self.is_upright else (self.radius, self.height)

    @property
    def footprint(self) -> Floats | None:
        """The polygon (64, 2), metres, that stands for the circle of an upright one; else None."""
        if not self.is_upright:
            return None
        return ellipse_footprint(self.radius, self.radius, self.center[:2], 0.0)

    def __repr__(self) -> str:
        return self._text(f"radius={self.radius:g} m, height={self.height:g} m")


@dataclass(frozen=True, eq=False, repr=False)
class Cone(_Frustum):
    """A right circular cone, whole or cut off parallel to its base, in any position.

    Parameters
    ----------
    radius, height : float, metres
        Of the base, and along the axis.
    center : (3,) or (2,) float64 or None, metres
        The middle of the axis; (2,) is where it stands on the floor, None at the origin.
    axis : (3,) float64
        From the base to the top, of any length but zero.
    top_radius : float, metres
        0 for a whole cone, else less than `radius`.

    Raises
    ------
    ValueError
        When a length is not positive, the top is not smaller than the base, or the axis is zero.

    Examples
    --------
    >>> import primfit
    >>> primfit.Cone(0.2, 0.5)
    Cone(center=(0.0000, 0.0000, 0.2500), radius=0.2 m, height=0.5 m)
    >>> primfit.Cone(0.2, 0.5, (1, 1), top_radius=0.1).solid_kind
    'cone'
    """

    type_name = "cone"

    radius: float
    height: float
    center: Any = None
    axis: Any = (0.0, 0.0, 1.0)
    top_radius: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number("radius", self.radius, above=0.0))
        object.__setattr__(self, "height", number("height", self.height, above=0.0))
        object.__setattr__(self, "top_radius", number("top_radius", self.top_radius, low=0.0))
        if self.top_radius >= self.radius:
            raise ValueError(
                f"top_radius must be less than radius ({self.radius:g}), not {self.top_radius:g}: "
                f"turn the axis around, or take a Cylinder"
            )
        self._settle_axis()
        self._settle_center()

    @property
    def _radii(self) -> tuple[float, float]:
        return self.radius, self.top_radius

    @property
    def size(self) -> tuple[float, ...]:
        """Radius of the base, of the top, and height along the axis; metres."""
        return self.radius, self.top_radius, self.height

    def __repr__(self) -> str:
        top = f", top_radius={self.top_radius:g} m" if self.top_radius else ""
        return self._text(f"radius={self.radius:g} m{top}, height={self.height:g} m")
