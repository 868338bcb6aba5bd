"""Surfaces rolled out into the plane, so that they have outlines and areas.

Each chart keeps areas: a cylinder and a cone are rolled out, a sphere is mapped by Lambert's
azimuthal equal-area projection (1772) about the mean direction of its points, a torus by its angle
and the area of the belt up to a place around its tube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from primfit import _primfit
from primfit._check import Floats
from primfit.geometry.products import dots, lengths_of, product
from primfit.planes.plane import axes_of

_SMOOTH = 0.1
"""Deviation of the outline that is not drawn, as a share of its radius alpha."""

_TURNS = 2.0 * np.pi

_STEPS = 8
"""Newton's steps for the place around a tube, each of which doubles the digits."""


@dataclass(frozen=True, eq=False)
class Patch:
    """The part of a surface that its points cover.

    Attributes
    ----------
    loops : tuple of (k, 3) float64, metres
        Its border on the surface, each loop of a ring of corners; holes come after the outline.
    area : float, square metres
    """

    loops: tuple[Floats, ...]
    area: float


@dataclass(frozen=True, eq=False)
class Chart:
    """A map of a surface to the plane and back."""

    flat: Floats
    """Points in the plane (n, 2), metres."""
    lift: Callable[[Floats], Floats]
    """Places (k, 2) to points of the surface (k, 3)."""

    def patch(self, n_jobs: int | None = None) -> Patch:
        """Outline of the points, and its area."""
        ((rings, alpha),) = _primfit.outlines([np.ascontiguousarray(self.flat)], n_jobs)
        if not rings:
            return Patch((), 0.0)
        shape = shapely.Polygon(rings[0], rings[1:]).simplify(_SMOOTH * alpha)
        shape = shapely.geometry.polygon.orient(shape)
        borders = [] if shape.is_empty else [shape.exterior, *shape.interiors]
        loops = tuple(self.lift(shapely.get_coordinates(ring)[:-1]) for ring in borders)
        return Patch(loops, float(shape.area))


def angles_about(place: Floats, axis: Floats, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Angle about an axis (n,), distance from it (n,) and place along it (n,) of points."""
    across = axes_of(axis)
    away = points - place
    x, y = dots(away, across[0]), dots(away, across[1])
    return np.arctan2(y, x), np.hypot(x, y), dots(away, axis)


def arc_of(angles: Floats) -> tuple[float, float]:
    """Angle that the widest gap between some angles leaves, and the middle of that gap, radians."""
    rising = np.sort(angles)
    gaps = np.diff(np.append(rising, rising[0] + _TURNS))
    widest = int(gaps.argmax())
    middle = float(rising[widest] + gaps[widest] / 2.0)
    # Of points all around the widest gap is chance: that of n even ones, doubled by ln n.
    by_chance = _TURNS * (np.log(len(angles)) + 3.0) / len(angles)
    is_closed = gaps[widest] <= by_chance
    return (_TURNS if is_closed else _TURNS - float(gaps[widest])), middle


def _cut(angles: Floats) -> tuple[Floats, float]:
    """Angles counted from their widest gap, in (0, 2 pi), and where that is."""
    start = arc_of(angles)[1]
    return np.mod(angles - start, _TURNS), start


def _in_space(
    place: Floats, axis: Floats, angles: Floats, radius: Floats, height: Floats
) -> Floats:
    x, y = axes_of(axis)
    out = np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
    points: Floats = place + np.asarray(radius)[..., None] * out + height[:, None] * axis
    return points


def cylinder_chart(center: Floats, axis: Floats, radius: float, points: Floats) -> Chart:
    """Angle times radius, and the place along the axis."""
    angles, _, height = angles_about(center, axis, points)
    turned, start = _cut(angles)

    def lift(flat: Floats) -> Floats:
        at = flat[:, 0] / radius + start
        return _in_space(center, axis, at, np.full(len(at), radius), flat[:, 1])

    return Chart(np.column_stack([turned * radius, height]), lift)


def cone_chart(apex: Floats, axis: Floats, angle: float, points: Floats) -> Chart:
    """Polar coordinates: the distance from the apex, and the angle times the sine of the cone's."""
    angles, rho, height = angles_about(apex, axis, points)
    turned, start = _cut(angles)
    sine, cosine = np.sin(angle), np.cos(angle)
    slant = rho * sine + height * cosine
    # Half of a turn in the plane on either side of the middle.
    around = (turned - np.pi) * sine

    def lift(flat: Floats) -> Floats:
        far = np.hypot(flat[:, 0], flat[:, 1])
        at = np.arctan2(flat[:, 1], flat[:, 0]) / sine + np.pi + start
        return _in_space(apex, axis, at, far * sine, far * cosine)

    return Chart(np.column_stack([slant * np.cos(around), slant * np.sin(around)]), lift)


def sphere_chart(center: Floats, radius: float, points: Floats) -> Chart:
    """Lambert's azimuthal projection about the mean direction."""
    away = points - center
    away /= lengths_of(away)[:, None]
    middle = away.mean(axis=0)
    size = float(lengths_of(middle))
    axis = middle / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    across = axes_of(axis)
    # 2 sin(c / 2) / sin(c), c the angle from the middle.
    scale = radius * np.sqrt(2.0 / np.maximum(1.0 + dots(away, axis), 1e-12))

    def lift(flat: Floats) -> Floats:
        square = np.minimum(np.einsum("nk,nk->n", flat, flat) / radius**2, 4.0)
        out = product(flat / radius, across) * np.sqrt(1.0 - square / 4.0)[:, None]
        lifted: Floats = center + radius * (out + (1.0 - square / 2.0)[:, None] * axis)
        return lifted

    return Chart(product(away, across.T) * scale[:, None], lift)


def torus_chart(
    center: Floats, axis: Floats, major_radius: float, radius: float, points: Floats
) -> Chart:
    """Angle times major radius, and the area of the belt per length of the circle."""
    angles, rho, height = angles_about(center, axis, points)
    turned, start = _cut(angles)
    around, seam = _cut(np.arctan2(height, rho - major_radius))
    bulge = radius**2 / major_radius

    def belt(tube: Floats) -> Floats:
        swept: Floats = radius * tube + bulge * (np.sin(tube + seam) - np.sin(seam))
        return swept

    def lift(flat: Floats) -> Floats:
        tube = flat[:, 1] / radius
        for _ in range(_STEPS):
            slope = radius + bulge * np.cos(tube + seam)
            tube = tube - (belt(tube) - flat[:, 1]) / slope
        tube = tube + seam
        out = major_radius + radius * np.cos(tube)
        at = flat[:, 0] / major_radius + start
        return _in_space(center, axis, at, out, radius * np.sin(tube))

    return Chart(np.column_stack([turned * major_radius, belt(around)]), lift)
