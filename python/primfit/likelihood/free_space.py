"""Which cells are free, and which pieces of the rest may be solids.

A beam frees a cell only above the height at which it passed, since a solid that stands on the
floor may be lower. So a cell is looked at from the floor up to each of several heights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from primfit._check import Bools, Floats, Ints
from primfit.likelihood.hypotheses import Region
from primfit.likelihood.settings import CarvingSettings

_FARTHEST_CONTACT = 20.0
"""Cells that noise takes returns from their region, at the most."""


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """A grid seen from above: how many beams crossed each cell, and how many passed it.

    Attributes
    ----------
    low : (2,) float64, metres
        Corner of cell [0, 0].
    cell : float, metres
    heights : (k,) float64, metres
        z up to which the beams are counted, ascending.
    crossed, passed : (k, nx, ny) uint32
        How many beams crossed each cell below a height, and how many surely went beyond it.
    ends : (nx, ny) int64
        Returns that neither floor nor walls explain.
    seeming : float
        Share of the beams that seem to pass what they met: dropouts, and outliers beyond it.
    sigma : float, metres
        Typical noise.
    settings : CarvingSettings
    """

    low: Floats
    cell: float
    heights: Floats
    crossed: NDArray[np.uint32]
    passed: NDArray[np.uint32]
    ends: Ints
    sigma: float
    settings: CarvingSettings
    seeming: float = 0.0

    def less(self, other: FreeSpace) -> FreeSpace:
        """The same cells without the beams of another space."""
        crossed, passed = self.crossed - other.crossed, self.passed - other.passed
        return replace(self, crossed=crossed, passed=passed)

    @cached_property
    def is_free(self) -> Bools:
        """Cells (k, nx, ny) that enough of the beams that crossed them below a height passed.

        Whether a beam that ended before ever got there does not matter. Unseen cells are not free.
        """
        how = self.settings
        share = how.least_share + how.lapse_factor * self.seeming
        free: Bools = (self.passed >= how.least_passes) & (self.passed > share * self.crossed)
        return free

    @cached_property
    def is_occupied(self) -> Bools:
        """Cells (k, nx, ny) that enough beams crossed below a height, but did not pass."""
        enough = min(self.settings.least_crossings, self.settings.crossings / 2.0)
        occupied: Bools = (self.crossed >= enough) & ~self.is_free
        return occupied

    @property
    def least_crossings(self) -> float:
        """How often nine in ten of the cells with returns were crossed, at the least."""
        crossed = self.crossed[-1][self.ends > 0]
        return max(float(np.quantile(crossed, 0.1)), 1.0) if len(crossed) else np.inf

    def centers(self) -> Floats:
        """Middle of every cell (nx, ny, 2), metres."""
        index = np.moveaxis(np.indices(self.is_free.shape[1:]), 0, -1)
        return self.low + self.cell * (index + 0.5)

    def cells_of(self, points: Floats) -> Ints:
        """Cells (n, 2) of places (n, 2), the nearest for those outside."""
        index = np.floor((points - self.low) / self.cell).astype(np.int64)
        return np.clip(index, 0, np.array(self.is_free.shape[1:]) - 1)

    def _within(self, place: shapely.Geometry) -> Bools:
        shapely.prepare(place)
        centers = self.centers()
        return shapely.contains_xy(place, centers[..., 0], centers[..., 1])

    def outlines(self) -> Iterator[Floats]:
        """Outlines (m, 2) of the free space below the greater heights, with all that it encloses.

        Below heights at which it is about the same there is one.
        """
        areas: list[int] = []
        for free in self.is_free[:-5:-1]:
            area = int(free.sum())
            if any(abs(area - other) < 0.02 * other for other in areas):
                continue
            areas.append(area)
            filled = ndimage.binary_fill_holes(free)
            labels, n = ndimage.label(filled)
            if n:
                sizes = np.bincount(labels.ravel())[1:]
                yield self._outline(labels == int(np.argmax(sizes)) + 1, np.zeros(2, dtype=int))

    def regions(self, room: Floats | None) -> list[Region]:
        """Connected pieces that are crossed but not free, and on which beams ended.

        From the greatest height to the least. Below its top a solid is whole, above it beams that
        pass over take it to pieces. So a piece below one height takes the place of those below
        greater ones that it contains, where it is much larger than they are together, but not so
        much that it may be several solids and what is between them. Pieces that are tiny or
        hardly crossed are left out.
        """
        how = self.settings
        open_ = np.ones(self.is_free.shape[1:], dtype=bool)
        if room is not None:
            open_ = self._within(shapely.Polygon(room).buffer(-self._margin))
        found: list[Region | None] = []
        owner = np.full(open_.shape, -1)
        for layer in reversed(range(len(self.heights))):
            is_near = ndimage.binary_dilation(owner >= 0, iterations=int(how.contact_cells))
            ends = np.where(open_ & ~is_near, self.ends, 0)
            labels, _ = ndimage.label(ndimage.binary_opening(self.is_occupied[layer] & open_))
            for number, window in enumerate(ndimage.find_objects(labels), start=1):
                piece = labels[window] == number
                inside = [k for k in np.unique(owner[window][piece]) if k >= 0]
                parts = [part for k in inside if (part := found[k]) is not None]
                within = sum(part.area for part in parts)
                area = float(piece.sum()) * self.cell**2
                if parts and area < how.growth * within:
                    continue
                pieces = [piece]
                is_whole = area < how.most_growth * within or self._is_compact(piece)
                if not is_whole:
                    pieces = _connected(ndimage.binary_opening(piece & ~is_near[window]))
                    parts = []
                for some in pieces:
                    if not self._is_crossed(some, window, layer):
                        continue
                    if not parts and self._n_ends(some, window, ends) < how.least_returns:
                        continue
                    region = self._region(some, window, layer)
                    if len(parts) > 1:
                        cut = tuple(replace(part, is_cut=True) for part in parts)
                        region = replace(region, parts=cut)
                    for k in inside if parts else ():
                        found[k] = None
                    owner[window][some] = len(found)
                    found.append(region)
        least = how.sliver_sigmas * self.sigma
        return [region for region in found if region is not None and region.size > least]

    @property
    def _margin(self) -> float:
        """Width of what belongs to walls, metres."""
        how = self.settings
        return how.room_margin_cells * self.cell + how.sliver_sigmas * self.sigma

    def _is_compact(self, piece: Bools) -> bool:
        """Whether a piece has no necks."""
        return len(_cut_at_necks(piece, self.settings.neck)) == 1

    def _is_crossed(self, piece: Bools, window: tuple[slice, ...], layer: int) -> bool:
        """Whether a piece is large, and enough beams crossed it."""
        how = self.settings
        n_cells, n_crossings = int(piece.sum()), int(self.crossed[layer][window][piece].sum())
        enough = min(how.least_crossings * n_cells, how.enough_crossings)
        return n_cells >= how.least_cells and n_crossings >= enough

    def _n_ends(self, piece: Bools, window: tuple[slice, ...], ends: Ints) -> int:
        """How many returns are on a piece."""
        how = self.settings
        noise = min(how.contact_sigmas * self.sigma / self.cell, _FARTHEST_CONTACT)
        reach = int(np.ceil(how.contact_cells + noise))
        around = tuple(slice(max(side.start - reach, 0), side.stop + reach) for side in window)
        before = [side.start - wide.start for side, wide in zip(window, around, strict=True)]
        there = np.zeros(ends[around].shape, dtype=bool)
        there[tuple(slice(b, b + n) for b, n in zip(before, piece.shape, strict=True))] = piece
        return int(ends[around][ndimage.distance_transform_edt(~there) <= reach].sum())

    def _region(self, piece: Bools, window: tuple[slice, ...], layer: int) -> Region:
        """A piece of a window of the grid, with the parts between its necks."""
        corner = np.array([side.start for side in window])
        cut = _cut_at_necks(piece, self.settings.neck)
        parts = tuple(self._part(each, corner, layer, is_cut=True) for each in cut)
        whole = self._part(piece, corner, layer, is_cut=self._is_unseen(piece, window, layer))
        return replace(whole, parts=parts) if len(parts) > 1 else whole

    def _is_unseen(self, piece: Bools, window: tuple[slice, ...], layer: int) -> bool:
        """Whether much of what is around a piece was not seen either, as behind a solid."""
        around = tuple(slice(max(side.start - 2, 0), side.stop + 2) for side in window)
        before = [side.start - wide.start for side, wide in zip(window, around, strict=True)]
        there = np.zeros(self.is_free[layer][around].shape, dtype=bool)
        there[tuple(slice(b, b + n) for b, n in zip(before, piece.shape, strict=True))] = piece
        rim = ndimage.binary_dilation(there, iterations=2) & ~there
        n_unseen = int((~self.is_free[layer][around] & rim).sum())
        return n_unseen > self.settings.unseen_rim * int(rim.sum())

    def _part(self, piece: Bools, corner: Ints, layer: int, *, is_cut: bool) -> Region:
        center = np.argwhere(piece).mean(axis=0) + 0.5
        outline = self._outline(piece, corner)
        return Region(
            center=self.low + self.cell * (corner + center),
            area=float(shapely.Polygon(outline).area),
            outline=outline,
            top=float(self.heights[layer]),
            cell=self.cell,
            is_cut=is_cut,
        )

    def _outline(self, piece: Bools, corner: Ints) -> Floats:
        """Outline (m, 2) of the largest part of a piece, counter-clockwise, metres."""
        steps = np.diff(piece.astype(np.int8), axis=1, prepend=0, append=0)
        (x, starts), (_, stops) = np.nonzero(steps == 1), np.nonzero(steps == -1)
        outline = shapely.union_all(shapely.box(x, starts, x + 1, stops))
        if outline.geom_type != "Polygon":
            outline = max(outline.geoms, key=lambda part: part.area)
        outline = shapely.orient_polygons(outline.simplify(self.settings.smoothing_cells))
        ring = shapely.get_coordinates(outline.exterior)[:-1]
        return self.low + self.cell * (corner + ring)


def _connected(piece: Bools) -> list[Bools]:
    """The connected parts of a piece."""
    labels, n = ndimage.label(piece)
    return [labels == number for number in range(1, n + 1)]


def _cut_at_necks(piece: Bools, neck: float) -> list[Bools]:
    """Parts of a piece: watershed of the distance from its border.

    Two summits are parts of their own when the pass between them is less than `neck` times as
    far from the border as the lower of them.
    """
    padded = np.pad(piece, 1)
    depth = ndimage.gaussian_filter(ndimage.distance_transform_edt(padded), 1.0) * padded
    summits = np.argwhere((depth == ndimage.maximum_filter(depth, size=5)) & padded)
    summits = summits[np.argsort(-depth[tuple(summits.T)], kind="stable")]
    markers = np.where(padded, 0, -1).astype(np.int32)
    n_parts = 0
    for summit in map(tuple, summits):
        labels, _ = ndimage.label(depth >= neck * depth[summit])
        if not (markers[labels == labels[summit]] > 0).any():
            n_parts += 1
            markers[summit] = n_parts
    if n_parts < 2:
        return [piece]
    relief = (255 * (1.0 - depth / depth.max())).astype(np.uint8)
    parts = ndimage.watershed_ift(relief, markers)[1:-1, 1:-1]
    return [parts == number for number in range(1, n_parts + 1)]
