"""A scene as the beams see it: the room, the floor, the solids so far, and what they cost."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints
from primfit.geometry.extrusions import prism_triangles, prism_vertices
from primfit.likelihood.beams import Beams, Noise
from primfit.scans.casting import RayCaster
from primfit.scans.scan import Scan
from primfit.worlds.world import FLOOR, NOTHING

_SOME = 4
"""One beam in so many tells whether a solid is there at all."""

_WAYS, _SIDES = 24, 24
"""Bundles of beams about a solid: directions, and sides on which they come by."""

_LEAST_CLEAR = 0.05
"""Share of the beams that tell outliers and losses, if they are clear of all solids."""

_END = 0.01
"""Share of the reach, at its end, in which a surface may be seen or not."""

_FEW = 50
"""Beams of a bundle that are few."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """An upright prism that beams may meet, from the floor up to z = top."""

    footprint: Floats
    top: float

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
    def unit(self) -> tuple[Floats, Ints, Ints]:
        """Vertices (2m, 3), triangles (t, 3) and the face of each, from z = 0 up to 1.

        The faces are the walls in order, then top (m) and bottom.
        """
        vertices = prism_vertices(self.footprint, 0.0, 1.0)
        m = len(self.footprint)
        faces = np.concatenate([np.tile(np.arange(m), 2), np.repeat([m + 1, m], m - 2)])
        return vertices, prism_triangles(self.footprint), faces


class Scene:
    """The scan and the surfaces that explain it so far.

    Attributes
    ----------
    scan : Scan
    noise : Noise
    base : float, metres
        z of the floor.
    room : Obstacle or None
        Walls around all, as high as any beam.
    obstacles : list of Obstacle
        The solids.
    """

    def __init__(self, scan: Scan, noise: Noise, base: float, n_jobs: int | None) -> None:
        self.scan = scan
        self.noise = noise
        self.base = base
        self.n_jobs = n_jobs
        self.room: Obstacle | None = None
        self.obstacles: list[Obstacle] = []

    @cached_property
    def _lines(self) -> _primfit.LevelLines:
        """Level lines of the beams."""
        beams = self.scan.origins, self.scan.directions
        return _primfit.LevelLines(*map(np.ascontiguousarray, beams))

    def background(
        self, without: int | None = None, rows: Any = slice(None), *, floor: bool = True
    ) -> Floats:
        """Range of the nearest surface for some beams, one obstacle left out."""
        return self._cast(without, rows, floor)[0]

    def first_hits(self) -> tuple[Floats, Ints, Ints]:
        """Range, part and face of the nearest surface of each beam.

        A part is the number of an obstacle, `FLOOR`, `NOTHING`, or the number of obstacles for the
        room. The faces of a prism are its walls in order, then its top and bottom.
        """
        expected, triangles, surfaces = self._cast(None, slice(None), True)
        parts, faces = np.append(surfaces, [[NOTHING, -1]], axis=0)[triangles].T
        return expected, parts, faces

    def _cast(self, without: int | None, rows: Any, floor: bool) -> tuple[Floats, Ints, Ints]:
        """Range and triangle for some beams, and part and face (t, 2) of each triangle."""
        bodies = [*enumerate(self.obstacles)]
        if self.room is not None:
            bodies.append((len(self.obstacles), self.room))
        pieces = [
            (part, body.top, body.unit)
            for part, body in bodies
            if part != without and body.top > self.base
        ]
        if floor or not pieces:
            depth = 0.0 if floor else 100.0 * self.noise.reach
            pieces.append((FLOOR, self.base - depth, self._plate))
        parts, tops, units = zip(*pieces, strict=True)
        sizes = [len(vertices) for vertices, _, _ in units]
        vertices = np.concatenate([vertices for vertices, _, _ in units])
        vertices[:, 2] = self.base + (np.repeat(tops, sizes) - self.base) * vertices[:, 2]
        first = np.cumsum([0, *sizes[:-1]])
        faces = np.concatenate([each for _, _, each in units])
        mesh = (
            vertices,
            np.concatenate([rows + i for (_, rows, _), i in zip(units, first, strict=True)]),
        )
        n_faces = [len(each) for _, _, each in units]
        surfaces = np.column_stack([np.repeat(parts, n_faces), faces])
        beams = _some(self.scan.origins, rows), _some(self.scan.directions, rows)
        ranges, triangles = RayCaster(mesh).cast(*beams, self.n_jobs)
        return ranges, triangles, surfaces

    @cached_property
    def _plate(self) -> tuple[Floats, Ints, Ints]:
        """A floor at z = 1, like `Obstacle.unit`."""
        beyond = 10 * self.noise.reach
        low, high = self._extent[0] - beyond, self._extent[1] + beyond
        corners = [[*low, 1.0], [high[0], low[1], 1.0], [*high, 1.0], [low[0], high[1], 1.0]]
        return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, dtype=np.int64)

    @cached_property
    def _extent(self) -> tuple[Floats, Floats]:
        """Lowest and highest x and y of the sensor."""
        xy = self.scan.origins[:, :2]
        return xy.min(axis=0), xy.max(axis=0)

    @cached_property
    def ceiling(self) -> float:
        """z that no beam reaches, metres."""
        return float(self.scan.origins[:, 2].max()) + 2.0 * self.noise.reach

    @cached_property
    def middle(self) -> float:
        """Median z of the sensor, metres."""
        return float(np.median(self.scan.origins[:, 2]))

    def costs(self, rows: Ints) -> Floats:
        """Negative log-likelihood of some beams."""
        expected = self.background(rows=rows)
        return self.noise.costs(self.scan.ranges[rows], expected, self.noise.sigma[rows])

    def misfit(self, center: Floats, radius: float) -> float:
        """Standard deviations by which beams near a place fit worse than their noise explains.

        The largest of: by the costs of all beams together; by the costs of those that come by in
        about the same direction on the same side, halved since the worst of many is taken; and by
        how many are off by more than three sigmas, which tells more where the noise is less than
        was said.
        """
        noise, rows = self.noise, self.rows_near(center, radius)
        # Whether a surface at the very end of the reach returns a beam tells of that surface.
        expected = self.background(rows=rows)
        counts = np.abs(expected - noise.reach) >= _END * noise.reach
        rows, expected = rows[counts], expected[counts]
        ranges = self.scan.ranges[rows]
        costs = noise.costs(ranges, expected, noise.sigma[rows])
        foreseen = np.isfinite(ranges) & (expected <= noise.reach)
        # What outliers and losses cost at the shares that the scene has of them.
        mean = 0.5 + noise.outliers * noise.outlier_price + noise.lost * noise.missing_price
        square = noise.outliers * noise.outlier_price**2 + noise.lost * noise.missing_price**2
        n = max(int(foreseen.sum()), 1)
        by_sum = float((costs.sum() - mean * n) / np.sqrt((0.5 + square) * n))
        n_off, usual = int((costs[foreseen] > 4.5).sum()), 0.0027 + noise.outliers
        by_number = float((n_off - usual * n) / np.sqrt(usual * n + 1.0))

        bundle = self._lines.bundles(rows, tuple(center), radius, (_WAYS, _SIDES))
        n_each = np.bincount(bundle, foreseen, _WAYS * _SIDES)
        excess = np.bincount(bundle, costs, _WAYS * _SIDES) - mean * n_each
        by_bundle = float((excess / np.sqrt((0.5 + square) * np.maximum(n_each, _FEW))).max())
        return max(by_sum, by_number, by_bundle / 2.0)

    def gains(self) -> Floats:
        """Log-likelihood that each obstacle gains over nothing, by some of the beams it stops."""
        some = np.arange(0, len(self.scan), _SOME)
        expected, triangles, surfaces = self._cast(None, some, True)
        parts = np.append(surfaces[:, 0], NOTHING)[triangles]
        gains = np.zeros(len(self.obstacles))
        for i in range(len(gains)):
            stopped = np.flatnonzero(parts == i)
            rows = some[stopped]
            ranges, sigma = self.scan.ranges[rows], self.noise.sigma[rows]
            costs = [
                self.noise.costs(ranges, each, sigma).sum()
                for each in (self.background(i, rows), expected[stopped])
            ]
            gains[i] = _SOME * float(costs[0] - costs[1])
        return gains

    def clear_rows(self, stride: int) -> Ints:
        """Beams, one in `stride`, that come near no obstacle; all of them, when these are few."""
        clear = np.ones(-(-len(self.scan) // stride), dtype=bool)
        for obstacle in self.obstacles:
            near = self.rows_near(obstacle.center, 1.3 * obstacle.radius, stride)
            clear[near // stride] = False
        return stride * np.flatnonzero(clear if clear.mean() > _LEAST_CLEAR else clear | True)

    def rows_near(self, center: Floats, radius: float, stride: int = 1) -> Ints:
        """Beams, one in `stride`, whose level lines come within `radius` of a place, in reach."""
        return self._lines.near(tuple(center), radius, self.noise.reach, stride)

    def near(self, center: Floats, radius: float, without: int | None, stride: int = 1) -> Beams:
        """Beams, one in `stride`, within `radius` of a place before they meet another surface."""
        rows = self.rows_near(center, radius, stride)
        background = self.background(without, rows)
        before = self._lines.entries(rows, tuple(center), radius) < background
        return self.beams(rows[before], background[before], stride)

    def beams(self, rows: Any, background: Floats, stride: int = 1) -> Beams:
        """Some beams with what they meet, each of which stands for so many."""
        scan = self.scan
        arrays = _some(scan.origins, rows), _some(scan.directions, rows), scan.ranges[rows]
        return Beams(
            (*arrays, background, self.noise.sigma[rows]),
            self.noise,
            self.base,
            self.n_jobs,
            stride,
        )


def _some(array: Floats, rows: Any) -> Floats:
    """Rows of an array: a slice of them, or some by number, which `take` gathers faster."""
    some: Floats = array[rows] if isinstance(rows, slice) else array.take(rows, axis=0)
    return some
