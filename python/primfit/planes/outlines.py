"""Outlines of planes: concave, with holes, drawn when someone asks for them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from primfit import _primfit
from primfit._check import Floats, Ints
from primfit.geometry.products import product
from primfit.planes.plane import axes_of

_SMOOTH = 0.1
"""Deviation of the outline that is not drawn, as a share of its radius alpha: far below what chance
gaps between the points leave unknown."""


class Outlines:
    """The outlines of many planes, drawn all at once when the first is asked for.

    Each is the alpha shape of the plane's points that holds together. The radius alpha follows from
    the widest gap across which it must, so no scale is needed
    (Edelsbrunner, Kirkpatrick, Seidel: On the shape of a set of points in the plane, 1983).

    Examples
    --------
    >>> import numpy as np
    >>> from primfit.planes.outlines import Outlines
    >>> x, y = np.mgrid[0:1:21j, 0:1:21j].reshape(2, -1)
    >>> frame = (abs(x - 0.5) > 0.32) | (abs(y - 0.5) > 0.32)
    >>> points = np.column_stack([x, y, 0 * x])
    >>> outline = Outlines().of(np.array([0.0, 0.0, 1.0, -2.0]), points, np.flatnonzero(frame))
    >>> len(outline.holes()), round(outline.area(), 2), outline.boundary()[:, 2].tolist()
    (1, 0.53, [2.0, 2.0, 2.0, 2.0])
    """

    def __init__(self, n_jobs: int | None = None) -> None:
        self._n_jobs = n_jobs
        self._points: list[Floats] = []
        self._drawn: list[shapely.Polygon] = []

    def of(self, equation: Floats, points: Floats, rows: Ints) -> Outline:
        """The outline of some points (n, 3) near a plane, which may be changed afterwards."""
        axes = axes_of(equation[:3])
        number = len(self._points)
        flat, place = _primfit.laid_out(points, rows, equation, axes)
        self._points.append(flat)
        return Outline(lambda: self._polygon(number), place, axes)

    def _polygon(self, number: int) -> shapely.Polygon:
        if len(self._drawn) < len(self._points):
            rings = _primfit.outlines(self._points, self._n_jobs)
            self._drawn = [_smooth(*each) for each in rings]
        return self._drawn[number]


def _smooth(rings: list[Floats], alpha: float) -> shapely.Polygon:
    if not rings:
        return shapely.Polygon()
    shape = shapely.Polygon(rings[0], rings[1:]).simplify(_SMOOTH * alpha)
    return shapely.geometry.polygon.orient(shape)


class Outline:
    """One of them, in space; every part of it is there when it is asked for."""

    def __init__(self, polygon: Callable[[], shapely.Polygon], place: Floats, axes: Floats) -> None:
        self._polygon, self._place, self._axes = polygon, place, axes

    def boundary(self) -> Floats:
        """Its corners (k, 3), metres; none without area."""
        shape = self._polygon()
        return np.empty((0, 3)) if shape.is_empty else self._in_space(shape.exterior)

    def holes(self) -> tuple[Floats, ...]:
        """Corners (k, 3) of each hole, metres."""
        return tuple(self._in_space(ring) for ring in self._polygon().interiors)

    def area(self) -> float:
        """Within the boundary, less the holes, square metres."""
        return float(self._polygon().area)

    def _in_space(self, ring: shapely.LinearRing) -> Floats:
        return self._place + product(shapely.get_coordinates(ring)[:-1], self._axes)
