"""Free-space carving: the space that beams passed is free; what is left may hold solids.

A beam frees a cell only above the height at which it passed, since a solid that stands on the
floor may be lower. So space is carved in layers, and a cell is looked at from the floor up to
each of several heights. Elfes: Using occupancy grids for mobile robot perception and navigation,
Computer 22, 1989.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.likelihood.free_space import FreeSpace
from primfit.likelihood.scene import Scene

_MOST_CELLS = 4_000_000
"""Cells of a grid seen from above, at the most: 7 layers of them take 450 MB."""

_ASLANT = 3.0
"""Ranges, in the shortest, at which a wall too near to be seen is seen aslant: at 70 degrees."""

_FEW_BEAMS, _MOST_BEAMS = 60_000, 480_000
"""Beams that carve: few if they cross each cell often enough, or else up to so many."""


def carve(scene: Scene) -> FreeSpace:
    """The free space of a scene of which the floor and the noise are known.

    Beams and cell are such that nine in ten of the cells with returns are crossed by
    `CarvingSettings.crossings` beams: more beams first, then larger cells.

    An empty beam may have met something within the sensor's shortest range. So it frees nothing
    there, and where another beam says that something stands there, it tells nothing at all.
    """
    how, n = scene.settings.carving, len(scene.scan)
    beams = _Spans.of(scene, np.arange(0, n, max(1, n // _FEW_BEAMS)))
    low, high = _extent(scene, beams.solid_ends[:, :2])
    cell = float((high - low).max()) / how.cells_across
    cell = max(cell, float(np.sqrt((high - low).prod() / _MOST_CELLS)))
    space = beams.carved(low, high, cell)
    lack = how.crossings / space.least_crossings
    if lack > 1.0 and n > _FEW_BEAMS:
        beams = _Spans.of(
            scene, np.arange(0, n, max(1, n // min(_MOST_BEAMS, int(lack * _FEW_BEAMS))))
        )
        space = beams.carved(low, high, cell)
        lack = how.crossings / space.least_crossings
    if lack > 1.2:
        space = beams.carved(low, high, cell * min(lack, how.coarsest))
    is_blind = beams.blind(space)
    if not is_blind.any():
        return space
    return space.less(beams.take(is_blind).carved_like(space))


@dataclass(frozen=True, eq=False)
class _Spans:
    """Which part of each of some beams carves, metres from its origin.

    A beam surely passed up to `passed` and is followed to `ends`; nearer than `min_ranges` it sees
    nothing. `solid_ends` are the returns that are not the floor's.
    """

    scene: Scene
    origins: Floats
    directions: Floats
    is_return: Bools
    passed: Floats
    ends: Floats
    min_ranges: Floats
    solid_ends: Floats

    @classmethod
    def of(cls, scene: Scene, rows: Ints) -> _Spans:
        how, scan, model = scene.settings.carving, scene.scan, scene.model
        origins, directions = scan.origins.take(rows, axis=0), scan.directions.take(rows, axis=0)
        ranges, sigma = scan.ranges[rows], model.sigma[rows]
        is_return = np.isfinite(ranges)
        clearance = how.clearance_sigmas * sigma
        is_floor = is_return & (ranges > scene.expected(rows) - clearance)
        at = scan.points[rows[is_return & ~is_floor]]
        shortest, longest = model.limits(rows)
        passed = np.where(is_return, ranges - clearance, longest)
        passed = np.clip(passed, 0.0, longest)
        return cls(
            scene,
            origins,
            directions,
            is_return,
            passed,
            # Returns are followed beyond their ends, but not where the floor may have stopped them.
            np.where(is_floor, passed, longest),
            np.broadcast_to(shortest, len(ranges)),
            at if len(at) else scan.points[rows[is_return]],
        )

    def take(self, rows: Bools) -> _Spans:
        """Some of them."""
        names = ("origins", "directions", "is_return", "passed", "ends", "min_ranges")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def carved(self, low: Floats, high: Floats, cell: float) -> FreeSpace:
        """The free space between two places, in cells, metres."""
        corner = low - 3.0 * cell
        shape = np.ceil((high + 3.0 * cell - corner) / cell).astype(int) + 1
        return self._carved(corner, shape, cell)

    def carved_like(self, space: FreeSpace) -> FreeSpace:
        """The free space in the cells of another one."""
        return self._carved(space.low, np.array(space.is_free.shape[1:]), space.cell)

    def _carved(self, corner: Floats, shape: Ints, cell: float) -> FreeSpace:
        scene = self.scene
        heights = _heights(scene, self.solid_ends[:, 2])
        starts = np.where(self.is_return, 0.0, self.min_ranges + 2.0 * cell)
        counts = _primfit.carve(
            self.origins,
            self.directions,
            starts,
            self.passed,
            self.ends,
            corner.tolist(),
            cell,
            shape.tolist(),
            np.concatenate([[scene.floor_z], heights]),
            scene.n_jobs,
        )
        crossed, passed = np.cumsum(counts, axis=2, dtype=np.uint32).transpose(3, 2, 0, 1)
        return FreeSpace(
            low=corner,
            cell=cell,
            heights=heights,
            crossed=crossed,
            passed=passed,
            ends=_ends_by_cell(self.solid_ends, corner, cell, shape),
            sigma=scene.model.typical_sigma,
            settings=scene.settings.carving,
        )

    def blind(self, space: FreeSpace) -> Bools:
        """Which beams came back empty from where others say that something stands near by.

        A wall nearer than the sensor's shortest range is seen aslant, a little farther off, from
        the same place. What others say is told by returns alone, too: empty beams that go through
        a solid would free it.
        """
        blind = np.zeros(len(self.is_return), dtype=bool)
        shortest = float(self.min_ranges.max(initial=0.0))
        moves = (np.diff(self.origins, axis=0) != 0.0).any(axis=1)
        place = np.concatenate([[0], np.cumsum(moves)])
        is_near = self.is_return & (self.passed < _ASLANT * self.min_ranges)
        is_suspect = np.bincount(place, is_near)[place] > 0
        empty = np.flatnonzero(~self.is_return & is_suspect)
        if shortest == 0.0 or not len(empty):
            return blind
        told = self.take(self.is_return).carved_like(space)
        is_solid = told.is_occupied & (told.crossed >= space.settings.least_crossings)
        is_solid |= space.is_occupied & (space.crossed >= space.settings.least_crossings)
        for depth in np.arange(0.0, shortest + 2.5 * space.cell, space.cell):
            at = self.origins[empty] + depth * self.directions[empty]
            layer = np.searchsorted(told.heights, at[:, 2])
            seen = np.flatnonzero(layer < len(told.heights))
            x, y = told.cells_of(at[seen, :2]).T
            blind[empty[seen]] |= is_solid[layer[seen], x, y]
        return blind


def with_room(space: FreeSpace, scene: Scene) -> FreeSpace:
    """The same space, once it is known which returns the walls of the scene's room explain.

    And how many beams drop out or return from beyond the walls: those seem to pass.
    """
    scan, model = scene.scan, scene.model
    rows = np.flatnonzero(scan.is_return)[:: max(1, len(scan) // _MOST_BEAMS)]
    expected = scene.expected(rows)
    shortfall = expected - scan.ranges[rows]
    seen = model.is_visible(expected, rows)
    beyond = seen & (shortfall < -2.0 * space.settings.clearance_sigmas * model.sigma[rows])
    # Outliers beyond a solid, which is nearer than what is behind it, are about twice as many.
    seeming = model.dropouts + 2.0 * float(beyond.sum() / max(seen.sum(), 1))
    is_unexplained = shortfall > space.settings.clearance_sigmas * model.sigma[rows]
    ends = scan.points[rows[is_unexplained]]
    shape = np.array(space.is_free.shape[1:])
    return replace(
        space,
        ends=_ends_by_cell(ends, space.low, space.cell, shape),
        seeming=seeming,
    )


def _ends_by_cell(points: Floats, low: Floats, cell: float, shape: Ints) -> Ints:
    """How many points (n, 3) are in each cell (nx, ny)."""
    bins = np.floor((points[:, :2] - low) / cell).astype(np.int64)
    bins = bins[((bins >= 0) & (bins < shape)).all(axis=1)]
    return np.bincount(bins @ [shape[1], 1], minlength=shape[0] * shape[1]).reshape(shape)


def _heights(scene: Scene, z: Floats) -> Floats:
    """Heights up to which space is carved: that of the returns, and shares of it."""
    how = scene.settings.carving
    highest = max(1.01 * (float(np.quantile(z, 0.99)) - scene.floor_z), scene.model.least_sigma)
    shares = how.layer_ratio ** -np.arange(float(how.n_layers))
    return scene.floor_z + highest * shares[::-1]


def _extent(scene: Scene, ends: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest place of the sensor, and of what stands in the scene."""
    xy = scene.scan.origins[:, :2]
    low, high = np.quantile(ends, 0.001, axis=0), np.quantile(ends, 0.999, axis=0)
    margin = 0.02 * (high - low).max()
    return np.minimum(xy.min(axis=0), low - margin), np.maximum(xy.max(axis=0), high + margin)
