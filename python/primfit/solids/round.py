"""What solids of revolution have in common: an axis, and a mesh that stands for them."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import fields
from functools import cached_property
from typing import Any, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Bools, Floats, Ints, as_floats, as_vector, check_finite, integer
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry.footprints import TOLERANCE
from primfit.geometry.motions import Motion, turned
from primfit.geometry.products import lengths_of, product
from primfit.geometry.revolution import circle_points, fans, frame_about, revolved
from primfit.solids.solid import Solid

SEGMENTS = 64
"""Sides of the mesh that stands for a round solid: at most 0.12 % of a radius inside of it."""

OUTLINE = 256
"""Corners of a circle in a shadow: at most 0.008 % of its radius inside of it."""

_ROUNDING = 1e-12
"""Share of the size by which a point on the surface may be outside: some thousand roundings."""

_MOST_SEGMENTS = 4096


class Round(Solid):
    """A solid of revolution; rays meet its surface itself, and no mesh.

    It is all that is within `tube` of the circles about its axis, and between these.
    """

    center: Any
    axis: Any

    @property
    @abstractmethod
    def circles(self) -> tuple[tuple[float, float], ...]:
        """Height along the axis, from the centre, and radius of each circle, metres."""

    @property
    def tube(self) -> float:
        """How far the solid reaches around its circles, metres."""
        return 0.0

    @property
    @abstractmethod
    def row(self) -> Floats:
        """The numbers (10,) by which the ray caster knows it: kind, centre, axis, lengths."""

    @abstractmethod
    def _profile(self, segments: int) -> Floats:
        """Distances from the axis and heights (k, 2) on the surface, from its bottom upwards."""

    @abstractmethod
    def surfaces(self, points: Floats) -> tuple[Floats, Floats]:
        """Distances (n, f), metres, to each smooth part of the surface, and normals (n, f, 3).

        Positive outside; of a part as it goes on beyond its edges.
        """

    @property
    def kind(self) -> str:
        """Class name (see `solid_kind`)."""
        return self.solid_kind

    @property
    def solid_kind(self) -> str:
        """Class name, the same at any tilt."""
        return self.type_name

    @property
    def footprint(self) -> Floats | None:
        """None but for an upright cylinder: it is no upright prism."""
        return None

    @property
    def angle(self) -> float:
        """NaN, or 0 of an upright cylinder."""
        return np.nan if self.footprint is None else 0.0

    @property
    def is_upright(self) -> bool:
        """Whether the axis is vertical, as nearly as that of an upright prism."""
        return bool(abs(self.axis[2]) >= 1.0 - TOLERANCE**2)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the upright box around it, metres."""
        x, y, z = self.axis**2
        across = np.sqrt(np.array([y + z, z + x, x + y]))
        ends = np.array([self.center + height * self.axis for height, _ in self.circles])
        wide = np.array([radius * across + self.tube for _, radius in self.circles])
        return (ends - wide).min(axis=0), (ends + wide).max(axis=0)

    @property
    def rotation(self) -> Floats:
        """Own axes as columns (3, 3): z is the axis."""
        return frame_about(self.axis).T.copy()

    @property
    def normals(self) -> Floats:
        """Outward unit normals (f, 3) of the flat ends."""
        return np.empty((0, 3))

    @cached_property
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above, circles as polygons of 256 corners."""
        return self._outline_of_circles().convex_hull

    def _outline_of_circles(self) -> shapely.MultiPoint:
        x, y, _ = frame_about(self.axis)
        around = product(circle_points(OUTLINE), np.stack([x, y]))
        corners = [
            self.center + height * self.axis + radius * around for height, radius in self.circles
        ]
        return shapely.MultiPoint(np.concatenate(corners)[:, :2])

    def contains(self, points: PointsLike) -> Bools:
        """Which points (n, 3) are inside, or within rounding of the surface."""
        rows = points_of("points", points)
        slack = _ROUNDING * (max(self.dimensions) + np.abs(self.center).max())
        return (self.surfaces(rows)[0] <= slack).all(axis=1)

    @cached_property
    def _shell(self) -> tuple[Floats, tuple[Ints, ...]]:
        return self._tessellated(SEGMENTS)

    def _tessellated(self, segments: int) -> tuple[Floats, tuple[Ints, ...]]:
        local, faces = revolved(self._profile(segments), segments, closed=self._is_closed)
        return product(local, frame_about(self.axis)) + self.center, tuple(faces)

    _is_closed = False

    @property
    def vertices(self) -> Floats:
        """Vertices (v, 3), metres, of the mesh of 64 sides that stands for it."""
        return self._shell[0].copy()

    @property
    def faces(self) -> tuple[Ints, ...]:
        """Rows of `vertices` around each face of that mesh, counter-clockwise from outside."""
        return self._shell[1]

    def to_mesh(self, segments: int = SEGMENTS) -> tuple[Floats, Ints]:
        """The mesh that stands for it, its vertices on the surface.

        Parameters
        ----------
        segments : int
            Sides around the axis, at least 3.

        Returns
        -------
        vertices : (v, 3) float64, metres
        triangles : (t, 3) int64
            Counter-clockwise from outside.
        """
        segments = integer("segments", segments, low=3, high=_MOST_SEGMENTS)
        vertices, faces = self._shell if segments == SEGMENTS else self._tessellated(segments)
        return vertices.copy(), fans(faces)

    def surface_points(self) -> Floats:
        """Points (n, 3) all over the surface but for the flat ends, metres."""
        profile = self._profile(SEGMENTS)
        steps = -(-SEGMENTS // (2 * (len(profile) - 1)))
        at = np.arange((len(profile) - 1) * steps + 1) / steps
        fine = np.stack(
            [np.interp(at, np.arange(len(profile)), each) for each in profile.T], axis=1
        )
        return product(revolved(fine, SEGMENTS)[0], frame_about(self.axis)) + self.center

    def laid(self, motion: Motion, rise: float = 0.0) -> Self:
        """The solid where a motion about the vertical, and a `rise`, metres, bring it."""
        center = np.append(motion.of(self.center[None, :2])[0], self.center[2] + rise)
        axis = np.append(turned(self.axis[None, :2], motion.turn)[0], self.axis[2])
        return self.placed(center, axis)

    def placed(self, center: ArrayLike, axis: ArrayLike) -> Self:
        """The same solid with its centre and axis elsewhere."""
        values = self._values()
        return type(self)(
            **(values | {"center": center} | ({"axis": axis} if "axis" in values else {}))
        )

    def _values(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """The solid as plain numbers, for JSON."""
        values = self._values().items()
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values}
        return {"type": self.type_name, **plain}

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and np.array_equal(other.row, self.row)

    def __hash__(self) -> int:
        return hash((self.type_name, *self.row.tolist()))

    def _settle_axis(self) -> None:
        """Takes `axis` at unit length."""
        axis = as_vector("axis", self.axis, 3)
        if not axis.any():
            raise ValueError("axis must not be zero")
        # One that has unit length but for rounding stays, so that files keep every number.
        if abs(lengths_of(axis) - 1.0) > 4.0 * np.finfo(float).eps:
            axis = axis / np.abs(axis).max()
            axis = axis / lengths_of(axis)
        object.__setattr__(self, "axis", np.array(axis))

    def _settle_center(self) -> None:
        """Takes the place that `center` means, which follows from lengths and axis."""
        place = np.zeros(2) if self.center is None else as_floats("center", self.center)
        if place.shape not in ((2,), (3,)):
            raise ValueError(f"center must have shape (3,) or (2,), not {place.shape}")
        check_finite("center", place)
        if len(place) == 2:
            object.__setattr__(self, "center", np.zeros(3))
            place = np.append(place, -self.bounds[0][2])
        object.__setattr__(self, "center", np.array(place, dtype=np.float64))

    def _text(self, lengths: str) -> str:
        center = ", ".join(f"{value:.4f}" for value in self.center)
        axis = ""
        if not np.array_equal(self.axis, [0.0, 0.0, 1.0]):
            axis = ", axis=({})".format(", ".join(f"{value:.4f}" for value in self.axis))
        return f"{type(self).__name__}(center=({center}){axis}, {lengths})"

    def _along(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Heights (n,), distances (n,) from the axis, and unit vectors (n, 3) away from it."""
        arms = points - self.center
        heights = product(arms, self.axis[:, None])[:, 0]
        across = arms - heights[:, None] * self.axis
        distances = np.sqrt((across * across).sum(axis=1))
        is_off = distances > 0.0
        away = across / np.where(is_off, distances, 1.0)[:, None]
        away[~is_off] = frame_about(self.axis)[0]
        return heights, distances, away
