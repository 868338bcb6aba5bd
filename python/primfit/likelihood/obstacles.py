"""What beams may meet: upright prisms, and the walls of a room."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from primfit._check import Bools, Floats, Ints
from primfit.geometry.extrusions import prism_triangles, prism_vertices
from primfit.geometry.footprints import signed_area

_MITRE = 5.0
"""Longest corner of an outline that is moved outwards, in the move: that of 23 degrees."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """An upright prism that beams may meet, from the floor up to z = top.

    Attributes
    ----------
    footprint : (m, 2) float64, metres
    top : float, metres
    is_open : bool
        Whether it has neither top nor bottom, as the walls of a room.
    """

    footprint: Floats
    top: float
    is_open: bool = False

    @cached_property
    def center(self) -> Floats:
        """Mean of the corners (2,), metres."""
        mean: Floats = self.footprint.mean(axis=0)
        return mean

    @cached_property
    def radius(self) -> float:
        """Distance of the farthest corner from the centre, metres."""
        return float(np.linalg.norm(self.footprint - self.center, axis=1).max())

    @cached_property
    def size(self) -> float:
        """Square root of the area of the footprint, metres."""
        return float(np.sqrt(abs(signed_area(self.footprint))))

    def within(self, tolerance: float, floor_z: float) -> tuple[Obstacle, Obstacle]:
        """The same as near to the beams, and as far from them, as a tolerance lets it be, metres.

        The top is off by as large a share of the height as the walls of the size.
        """
        key = tolerance, floor_z
        if key not in self._within:
            rise = tolerance * min(1.0, (self.top - floor_z) / self.size)
            out = -tolerance if self.is_open else tolerance
            self._within[key] = (
                self._grown(out, self.top + rise),
                self._grown(-out, self.top - rise),
            )
        return self._within[key]

    def swallows(self, origins: Floats) -> Bools:
        """Which places (n, 3) are on its inner side: in a solid, or behind the walls of a room."""
        x, y, z = origins.T
        around = (x - self.center[0]) ** 2 + (y - self.center[1]) ** 2 <= self.radius**2
        swallowed = np.full(len(origins), self.is_open)
        near = np.flatnonzero(around)
        if len(near):
            inside = shapely.contains_xy(self._polygon, x[near], y[near])
            swallowed[near] = ~inside if self.is_open else inside
        return swallowed & (z <= self.top)

    @cached_property
    def _polygon(self) -> shapely.Polygon:
        polygon = shapely.Polygon(self.footprint)
        shapely.prepare(polygon)
        return polygon

    @cached_property
    def _within(self) -> dict[tuple[float, float], tuple[Obstacle, Obstacle]]:
        return {}

    def _grown(self, by: float, top: float) -> Obstacle:
        """All walls moved outwards, metres, and another top; as it is where nothing is left."""
        outline = shapely.Polygon(self.footprint)
        moved = shapely.buffer(outline, by, join_style="mitre", mitre_limit=_MITRE)
        if moved.geom_type != "Polygon" or moved.is_empty:
            return replace(self, top=top)
        ring = shapely.get_coordinates(shapely.orient_polygons(moved).exterior)[:-1]
        return Obstacle(ring, top, self.is_open)

    @cached_property
    def unit(self) -> tuple[Floats, Ints, Ints]:
        """Vertices (2m, 3), triangles (t, 3) and the face of each, from z = 0 up to 1.

        The faces are the walls in order, then top (m) and bottom.
        """
        vertices = prism_vertices(self.footprint, 0.0, 1.0)
        m = len(self.footprint)
        triangles = prism_triangles(self.footprint)
        faces = np.concatenate([np.tile(np.arange(m), 2), np.repeat([m + 1, m], m - 2)])
        n = 2 * m if self.is_open else len(triangles)
        return vertices, triangles[:n], faces[:n]
