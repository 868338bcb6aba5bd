"""Seeds of solids: what is left when the space that beams passed is carved away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray
from scipy import ndimage

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.scans.scan import Scan

_CLEAR = 3.0
"""Standard deviations by which a beam must end beyond a cell to have passed it."""

_LEAST_BEAMS, _LEAST_SHARE = 3, 0.02
"""Beams, and share of the beams of a cell, that must have passed for it to be free."""

_LOSSES = 1.5
"""Times the share of lost returns that must seem to have passed, beyond the least share."""

_CELLS = 100
"""Cells that the sensor sees far."""

_LEAST_CELLS = 9
"""Cells of the smallest seed."""

_CROSSINGS, _ENOUGH = 10, 400
"""Beams that must have crossed each cell of a seed on average, or all together: few may all have
ended before."""

_SMOOTHING = 1.0
"""Cells by which an outline may be off the steps of its cells."""

_NECK = 0.8
"""Depth of a pass over that of a summit below which a piece is cut there."""


@dataclass(frozen=True, eq=False)
class Seed:
    """A piece of space that no beam passed.

    Attributes
    ----------
    center : (2,) float64, metres
    area : float, square metres
    outline : (m, 2) float64, metres
        Counter-clockwise, along the cells.
    cell : float, metres
        Size of the cells that it is made of: it lacks those that a solid fills in part.
    parts : tuple of Seed
        What it falls into where it is cut at its necks, if it may be several solids.
    is_cut : bool
        Whether it is such a part: then it may hold more than its solid, on one side.
    """

    center: Floats
    area: float
    outline: Floats
    cell: float
    parts: tuple[Seed, ...] = ()
    is_cut: bool = False

    @classmethod
    def of_polygon(cls, polygon: shapely.Polygon, cell: float, *, is_cut: bool) -> Seed:
        """The inside of a polygon."""
        outline = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
        center = shapely.get_coordinates(polygon.centroid)[0]
        return cls(center, float(polygon.area), outline, cell, is_cut=is_cut)

    @property
    def hull(self) -> Floats:
        """Its convex hull (k, 2), counter-clockwise, metres."""
        hull = shapely.orient_polygons(shapely.Polygon(self.outline).convex_hull)
        corners: Floats = shapely.get_coordinates(hull.exterior)[:-1]
        return corners

    def halves(self) -> tuple[Seed, ...]:
        """Its parts on either side of the line across its longest extent."""
        frame = shapely.get_coordinates(shapely.Polygon(self.outline).minimum_rotated_rectangle)
        sides = np.diff(frame, axis=0)[:2]
        short = min(sides, key=np.linalg.norm)
        line = shapely.LineString([self.center - short, self.center + short])
        pieces = shapely.ops.split(shapely.Polygon(self.outline), line).geoms
        return tuple(Seed.of_polygon(piece, self.cell, is_cut=True) for piece in pieces)

    @property
    def radius(self) -> float:
        """Distance of its farthest corner from its centre, metres."""
        return float(np.linalg.norm(self.outline - self.center, axis=1).max())


@dataclass(frozen=True, eq=False)
class Carving:
    """A grid seen from above: which cells beams crossed, and which of them they passed.

    Attributes
    ----------
    low : (2,) float64, metres
        Corner of cell [0, 0].
    cell : float, metres
    crossed, passed : (nx, ny) uint32
        How many beams crossed each cell, and how many of them surely went beyond.
    lost : float
        Share of the beams that come back empty although they met something: they seem to pass.
    """

    low: Floats
    cell: float
    crossed: NDArray[np.uint32]
    passed: NDArray[np.uint32]
    lost: float = 0.0

    @cached_property
    def is_free(self) -> Bools:
        """Cells (nx, ny) that enough of the beams that crossed them have passed.

        Whether a beam that ended before ever got there does not matter. Unseen cells are not free.
        """
        share = _LEAST_SHARE + _LOSSES * self.lost
        free: Bools = (self.passed >= _LEAST_BEAMS) & (self.passed > share * self.crossed)
        return free

    def inside(self, room: Floats | None) -> Bools:
        """Cells (nx, ny) within walls (m, 2), a little away from them; all where there are none."""
        if room is None:
            return np.ones_like(self.is_free)
        return self._within(shapely.Polygon(room).buffer(-2.5 * self.cell))

    def covered(self, seeds: list[Seed]) -> Bools:
        """Cells (nx, ny) that seeds cover, and a little around them."""
        outlines = [shapely.Polygon(seed.outline).buffer(2.0 * self.cell) for seed in seeds]
        return self._within(shapely.union_all(outlines))

    def _within(self, place: shapely.Geometry) -> Bools:
        shapely.prepare(place)
        centers = self.centers()
        return shapely.contains_xy(place, centers[..., 0], centers[..., 1])

    def seeds(self, within: Bools) -> list[Seed]:
        """Connected pieces that are crossed but not free, without tiny or hardly crossed ones."""
        occupied = (self.crossed > 0) & ~self.is_free & within
        labels, _ = ndimage.label(ndimage.binary_opening(occupied))
        seeds = []
        for number, window in enumerate(ndimage.find_objects(labels), start=1):
            piece = labels[window] == number
            n_cells, n_crossings = piece.sum(), self.crossed[window][piece].sum()
            is_crossed = n_crossings >= min(_CROSSINGS * n_cells, _ENOUGH)
            if n_cells >= _LEAST_CELLS and is_crossed:
                corner = np.array([side.start for side in window])
                cut = (self._seed(part, corner) for part in _cut_at_necks(piece))
                parts = tuple(replace(part, is_cut=True) for part in cut)
                seeds.append(self._seed(piece, corner, parts if len(parts) > 1 else ()))
        return seeds

    def _seed(self, piece: Bools, corner: Ints, parts: tuple[Seed, ...] = ()) -> Seed:
        """A piece whose first cell is `corner` of the grid."""
        steps = np.diff(piece.astype(np.int8), axis=1, prepend=0, append=0)
        (x, starts), (_, ends) = np.nonzero(steps == 1), np.nonzero(steps == -1)
        outline = shapely.union_all(shapely.box(x, starts, x + 1, ends))
        if outline.geom_type != "Polygon":
            outline = max(outline.geoms, key=lambda part: part.area)
        outline = shapely.orient_polygons(outline.simplify(_SMOOTHING))
        ring = shapely.get_coordinates(outline.exterior)[:-1]
        center = np.argwhere(piece).mean(axis=0) + 0.5
        return Seed(
            center=self.low + self.cell * (corner + center),
            area=float(outline.area) * self.cell**2,
            outline=self.low + self.cell * (corner + ring),
            cell=self.cell,
            parts=parts,
        )

    def centers(self) -> Floats:
        """Middle of every cell (nx, ny, 2), metres."""
        index = np.moveaxis(np.indices(self.is_free.shape), 0, -1)
        return self.low + self.cell * (index + 0.5)


def _cut_at_necks(piece: Bools) -> list[Bools]:
    """Parts of a piece: watershed of the distance from its border.

    Two summits are parts of their own when the pass between them is less than `_NECK` times as
    far from the border as the lower of them.
    """
    padded = np.pad(piece, 1)
    depth = ndimage.gaussian_filter(ndimage.distance_transform_edt(padded), 1.0) * padded
    summits = np.argwhere((depth == ndimage.maximum_filter(depth, size=5)) & padded)
    summits = summits[np.argsort(-depth[tuple(summits.T)], kind="stable")]
    markers = np.where(padded, 0, -1).astype(np.int32)
    n_parts = 0
    for summit in map(tuple, summits):
        labels, _ = ndimage.label(depth >= _NECK * depth[summit])
        if not (markers[labels == labels[summit]] > 0).any():
            n_parts += 1
            markers[summit] = n_parts
    if n_parts < 2:
        return [piece]
    relief = (255 * (1.0 - depth / depth.max())).astype(np.uint8)
    parts = ndimage.watershed_ift(relief, markers)[1:-1, 1:-1]
    return [parts == number for number in range(1, n_parts + 1)]


def carve(
    scan: Scan,
    sigma: Floats,
    *,
    bottom: float,
    top: float,
    reach: float,
    n_jobs: int | None = None,
) -> Carving:
    """Carve the layer between two heights: a beam passed the cells well before its end.

    Parameters
    ----------
    scan : Scan
        With origins.
    sigma : (n,) float64, metres
        Of the ranges.
    bottom, top : float, metres
        z of the layer.
    reach : float, metres
        How far the sensor sees.
    n_jobs : int or None
        Threads; None for all.
    """
    cell = reach / _CELLS
    low = scan.origins[:, :2].min(axis=0) - reach
    shape = np.ceil((scan.origins[:, :2].max(axis=0) + reach - low) / cell).astype(int) + 1
    certain = np.where(np.isfinite(scan.ranges), scan.ranges - _CLEAR * sigma, reach)
    counts = _primfit.carve(
        scan.origins,
        scan.directions,
        certain,
        reach,
        low.tolist(),
        cell,
        shape.tolist(),
        [bottom, top],
        n_jobs,
    )
    return Carving(low, cell, *np.moveaxis(counts, -1, 0))
