"""Where round solids end: at a plane across the axis, or at their last points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from primfit._check import Floats
from primfit.geometry.products import dots, lengths_of, product
from primfit.planes.plane import Plane, axes_of
from primfit.planes.scan_planes import SIGMAS
from primfit.solids.found import EQUAL
from primfit.surfaces.kinds import ConeSurface, CurvedSurface, CylinderSurface

_RIM = 4.0
"""Standard deviations from the side within which a point of a flat end may be the side's."""

_FEWEST = 10
"""Points of a flat end by which it is known better than by its plane."""


@dataclass(frozen=True, eq=False)
class End:
    """Where a solid ends across its axis: at a place (3,), or at the apex of its cone."""

    place: Floats | None
    variance: float
    plane: int = -1
    is_seen: bool = False


@dataclass(frozen=True, eq=False)
class Wall:
    """A plane with its outline, holes cut out, in its own axes (3, 2)."""

    number: int
    equation: Floats
    covariance: Floats
    axes: Floats
    polygon: shapely.Polygon
    reach: float

    @classmethod
    def of(cls, number: int, plane: Plane) -> Wall:
        """The plane of this number."""
        axes = axes_of(plane.equation[:3]).T
        loops = [product(loop, axes) for loop in (plane.boundary, *plane.holes)]
        outline = shapely.Polygon(loops[0], loops[1:]) if plane.area > 0.0 else shapely.Polygon()
        spacing = float(np.sqrt(plane.area / max(len(plane.inliers), 1)))
        reach = SIGMAS * (spacing + plane.rms)
        return cls(number, plane.equation, plane.covariance, axes, outline.buffer(0.0), reach)

    def height(self, place: Floats, axis: Floats) -> float:
        """How far from a place the line along an axis meets it, metres."""
        equation = self.equation
        return -float(equation[:3] @ place + equation[3]) / float(equation[:3] @ axis)

    def disc(self, center: Floats, radius: float) -> shapely.Polygon:
        """A disc of its own, about the foot of a point."""
        return shapely.Point(product(center[None], self.axes)[0]).buffer(radius)


def ends_of(
    surface: CurvedSurface, points: Floats, planes: Sequence[Plane], walls: list[Wall]
) -> list[End]:
    """Lower and upper end along the axis of what has ends."""
    if not isinstance(surface, CylinderSurface | ConeSurface):
        return []
    place = surface.center if isinstance(surface, CylinderSurface) else surface.apex
    heights = np.sort(dots(points[surface.inliers] - place, surface.axis))
    spacing = float(np.sqrt(surface.area / len(heights)))
    ends = []
    for side, rising in ((-1.0, -heights[::-1]), (1.0, heights)):
        outer = rising[rising >= (rising[0] + rising[-1]) / 2.0]
        gap = max(float(np.diff(outer).max(initial=0.0)), spacing)
        last = side * float(rising[-1])
        if isinstance(surface, ConeSurface) and side < 0.0 and last <= gap:
            ends.append(End(None, 0.0))
            continue
        wall = _across(surface, place, last, gap, walls)
        if wall is None:
            # The end is as likely anywhere up to where the next points would have been.
            ends.append(End(place + last * surface.axis, gap**2 / 3.0))
        else:
            ends.append(_at_plane(surface, place, wall, points[planes[wall.number].inliers]))
    return ends


def _across(
    surface: CylinderSurface | ConeSurface,
    place: Floats,
    last: float,
    gap: float,
    walls: list[Wall],
) -> Wall | None:
    """The plane across the axis that is nearest to the last points, if there is one."""
    axis, best = surface.axis, None
    nearest = np.inf
    axis_variance = float(np.trace(surface.covariance[3:6, 3:6]))
    for wall in walls:
        deviation = np.sqrt(axis_variance + np.trace(wall.covariance[:3, :3]))
        tilt = float(lengths_of(np.cross(wall.equation[:3], axis)))
        if tilt > max(EQUAL, SIGMAS * deviation):
            continue
        height = wall.height(place, axis)
        reach = wall.reach + gap + SIGMAS * surface.rms
        if abs(height - last) > min(reach, nearest):
            continue
        disc = wall.disc(place + height * axis, _radius_at(surface, height))
        if wall.polygon.distance(disc) <= reach:
            best, nearest = wall, abs(height - last)
    return best


def _at_plane(
    surface: CylinderSurface | ConeSurface, place: Floats, wall: Wall, own: Floats
) -> End:
    """The end at a plane with its points: where the axis meets it, or a flat end's middle.

    Of the points of a flat end those near its rim are left out: they may be of the side.
    """
    middle = place + wall.height(place, surface.axis) * surface.axis
    disc = wall.disc(middle, _radius_at(surface, wall.height(place, surface.axis)))
    row = np.append(middle, 1.0) / float(wall.equation[:3] @ surface.axis)
    variance = float(row @ wall.covariance @ row)
    if wall.polygon.intersection(disc).area < 0.5 * disc.area:
        return End(middle, variance, wall.number)
    clear = own[surface.distances(own) < -_RIM * surface.rms]
    if len(clear) < _FEWEST:
        return End(middle, variance, wall.number, is_seen=True)
    off = dots(clear, surface.axis)
    variance = float(off.var()) * surface.correlation_area / len(clear)
    return End(clear.mean(axis=0), variance, wall.number, is_seen=True)


def _radius_at(surface: CylinderSurface | ConeSurface, height: float) -> float:
    if isinstance(surface, CylinderSurface):
        return surface.radius
    return max(height, 0.0) * float(np.tan(surface.angle))
