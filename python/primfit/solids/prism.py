"""Solids with known truth: upright prisms over any simple footprint."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import (
    MOST_CORNERS,
    Bools,
    Floats,
    Ints,
    as_vector,
    integer,
    number,
    turn,
)
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry import footprints
from primfit.geometry.extrusions import prism_faces, prism_triangles, prism_vertices
from primfit.geometry.motions import Motion
from primfit.geometry.shapes import shape_of, upright_dimensions, upright_name
from primfit.solids.solid import Solid


@dataclass(frozen=True, eq=False)
class Prism(Solid):
    """An upright solid: a footprint drawn up from ``base`` by ``height``.

    Parameters
    ----------
    footprint : (m, 2) float64, metres
        Corners of a simple polygon, convex or not, in either direction.
    height : float, metres
        From bottom to top.
    base : float, metres
        z of the bottom.

    Raises
    ------
    ValueError
        When the footprint crosses itself or has no area, or the height is not positive.

    Examples
    --------
    >>> import primfit
    >>> ell = primfit.Prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], height=0.5)
    >>> ell.kind, ell.vertices.shape
    ('polygon', (12, 3))
    >>> primfit.Prism.regular(3, side=0.3, angle=0.1).kind
    'triangle'
    >>> primfit.Prism.circle(0.12, center=(1, 1))
    Prism(circle, center=(1.000, 1.000), size=0.120 m, angle=0.00 deg, height=0.2 m)
    """

    type_name = "prism"

    footprint: Floats
    height: float = 0.2
    base: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "footprint", footprints.clean_footprint(self.footprint))
        object.__setattr__(self, "height", number("height", self.height, above=0.0))
        object.__setattr__(self, "base", number("base", self.base))

    @classmethod
    def as_found(cls, footprint: Floats, height: float, base: float) -> Prism:
        """What was found, which is not checked: its outline may cross itself."""
        prism = object.__new__(cls)
        found = {"footprint": np.array(footprint), "height": height, "base": base}
        for name, value in found.items():
            object.__setattr__(prism, name, value)
        return prism

    @classmethod
    def regular(
        cls,
        n: int,
        side: float,
        *,
        center: ArrayLike = (0.0, 0.0),
        angle: float = 0.0,
        height: float = 0.2,
    ) -> Prism:
        """Prism over a regular polygon of ``n`` sides (`side` in metres, `angle` in radians)."""
        n, side = integer("n", n, low=3, high=MOST_CORNERS), number("side", side, above=0.0)
        place = as_vector("center", center, 2), turn("angle", angle)
        return cls(footprints.regular_footprint(n, side, *place), height)

    @classmethod
    def rectangle(
        cls,
        long: float,
        short: float,
        *,
        center: ArrayLike = (0.0, 0.0),
        angle: float = 0.0,
        height: float = 0.2,
    ) -> Prism:
        """Prism over a rectangle; at angle 0 its first side, ``long``, lies along +x."""
        long, short = number("long", long, above=0.0), number("short", short, above=0.0)
        place = as_vector("center", center, 2), turn("angle", angle)
        return cls(footprints.rectangle_footprint(long, short, *place), height)

    @classmethod
    def star(
        cls,
        n: int,
        outer: float,
        inner: float,
        *,
        center: ArrayLike = (0.0, 0.0),
        angle: float = 0.0,
        height: float = 0.2,
    ) -> Prism:
        """Prism over a star of ``n`` tips at radius ``outer``, with notches at ``inner``."""
        n = integer("n", n, low=3, high=MOST_CORNERS)
        outer, inner = number("outer", outer, above=0.0), number("inner", inner, above=0.0)
        if inner >= outer:
            raise ValueError(f"inner must be less than outer ({outer:g}), not {inner:g}")
        place = as_vector("center", center, 2), turn("angle", angle)
        return cls(footprints.star_footprint(n, outer, inner, *place), height)

    @classmethod
    def ellipse(
        cls,
        long: float,
        short: float,
        *,
        center: ArrayLike = (0.0, 0.0),
        angle: float = 0.0,
        height: float = 0.2,
    ) -> Prism:
        """Prism over an ellipse with semi-axes ``long``, along +x at angle 0, and ``short``.

        A polygon of 64 corners, the affine image of a regular one, that has the area of the ellipse
        stands for it: in units of the semi-axes its corners are 0.08 % outside and the middles of
        its sides 0.04 % inside.
        """
        long, short = number("long", long, above=0.0), number("short", short, above=0.0)
        if short > long:
            raise ValueError(f"short must be at most long ({long:g}), not {short:g}")
        place = as_vector("center", center, 2), number("angle", angle)
        return cls(footprints.ellipse_footprint(long, short, *place), height)

    @classmethod
    def circle(cls, radius: float, *, center: ArrayLike = (0.0, 0.0), height: float = 0.2) -> Prism:
        """Prism over a circle: a regular polygon of 64 corners that has its area (see `ellipse`).

        Its corners are 0.08 % of the radius outside, the middles of its sides 0.04 % inside.
        """
        radius = number("radius", radius, above=0.0)
        center = as_vector("center", center, 2)
        return cls(footprints.ellipse_footprint(radius, radius, center, 0.0), height)

    @property
    def kind(self) -> str:
        """Class name: "triangle", "square", "rectangle", ..., "star", "polygon".

        Regular polygons of 24 corners or more are "circle", affine images of them "ellipse".
        """
        return footprints.kind_of(self.footprint)

    @property
    def solid_kind(self) -> str:
        """Class name, the same at any tilt: "box", "cube", "wedge", "cylinder" or "prism"."""
        return upright_name(self.kind, len(self.footprint), self.size, self.height)

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Length, width and height along its own axes, metres (see `Polyhedron.dimensions`)."""
        return upright_dimensions(self.kind, self.footprint, self.size, self.height)

    @property
    def rotation(self) -> Floats:
        """Own axes as columns (3, 3) (see `Polyhedron.quat_xyzw`)."""
        return shape_of(self.vertices, self.faces).rotations[0]

    @property
    def angle(self) -> float:
        """Yaw of the footprint in radians, from zero up to its symmetry; 0 for a circle."""
        return footprints.angle_of(self.footprint)

    @property
    def size(self) -> float | tuple[float, float]:
        """Side; (long, short) of a rectangle; (outer, inner) radius of a star; metres.

        Radius of a circle; (long, short) semi-axis of an ellipse.
        """
        return footprints.size_of(self.footprint)

    @property
    def center(self) -> Floats:
        """Mean of the vertices (3,) (the paper's equation 1), at half height; metres."""
        return np.append(self.footprint.mean(axis=0), self.base + self.height / 2)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        return np.append(footprints.area_centroid(self.footprint), self.base + self.height / 2)

    @property
    def vertices(self) -> Floats:
        """Vertices (2m, 3), metres: the bottom, then the top."""
        return prism_vertices(self.footprint, self.base, self.base + self.height)

    @property
    def faces(self) -> tuple[Ints, ...]:
        """Rows of `vertices` around each face, seen from outside: m walls, bottom, top."""
        return prism_faces(len(self.footprint))

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        return float(self.shadow.area * self.height)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the upright box around it, metres."""
        low, high = self.footprint.min(axis=0), self.footprint.max(axis=0)
        return np.append(low, self.base), np.append(high, self.base + self.height)

    @property
    def normals(self) -> Floats:
        """Outward unit normals (m + 2, 3) of the faces: walls, bottom, top."""
        along = np.roll(self.footprint, -1, axis=0) - self.footprint
        out = np.stack([along[:, 1], -along[:, 0], np.zeros(len(along))], axis=1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        return np.vstack([out, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])

    @cached_property
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above."""
        return shapely.Polygon(self.footprint)

    def contains(self, points: PointsLike) -> Bools:
        """Which points (n, 3) are inside or on the surface."""
        rows = points_of("points", points)
        z = rows[:, 2]
        within = shapely.intersects_xy(self.shadow, rows[:, :2])
        return within & (z >= self.base) & (z <= self.base + self.height)

    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (2m, 3) and triangles (t, 3), counter-clockwise from outside."""
        return self.vertices, prism_triangles(self.footprint)

    def laid(self, motion: Motion, rise: float = 0.0) -> Prism:
        """The prism where a motion about the vertical, and a `rise`, metres, bring it."""
        return self.as_found(motion.of(self.footprint), self.height, self.base + rise)

    def to_dict(self) -> dict[str, Any]:
        """The prism as plain numbers, for JSON."""
        return {
            "type": self.type_name,
            "footprint": self.footprint.tolist(),
            "height": self.height,
            "base": self.base,
        }

    def __repr__(self) -> str:
        x, y, _ = self.center
        size = ", ".join(f"{value:.3f}" for value in np.atleast_1d(self.size))
        return (
            f"Prism({self.kind}, center=({x:.3f}, {y:.3f}), size={size} m, "
            f"angle={np.degrees(self.angle):.2f} deg, height={self.height:g} m)"
        )
