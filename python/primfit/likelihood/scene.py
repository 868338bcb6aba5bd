"""A scene as the beams see it: the room, the floor, the solids so far, and what they cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints
from primfit.likelihood.beam_model import BeamModel, Beams
from primfit.likelihood.hypotheses import Candidate, Hypothesis
from primfit.likelihood.obstacles import Obstacle
from primfit.likelihood.settings import LikelihoodSettings
from primfit.scans.casting import RayCaster
from primfit.scans.scan import Scan
from primfit.worlds.world import FLOOR, NOTHING


@dataclass(frozen=True, eq=False)
class Recording:
    """All beams of a scan, also as seen from above.

    Attributes
    ----------
    scan : Scan
    lines : LevelLines
    """

    scan: Scan
    lines: _primfit.LevelLines

    @classmethod
    def of(cls, scan: Scan) -> Recording:
        """The recording of a scan with origins."""
        beams = map(np.ascontiguousarray, (scan.origins, scan.directions))
        return cls(scan, _primfit.LevelLines(*beams))

    @cached_property
    def places(self) -> Floats:
        """Places of the sensor (k, 3), each once but for rounding, metres."""
        origins = self.scan.origins
        changes = (np.diff(origins, axis=0) != 0.0).any(axis=1)
        return origins[np.concatenate([[True], changes])]

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest place of the sensor (3,), metres."""
        return self.scan.origins.min(axis=0), self.scan.origins.max(axis=0)


@dataclass(frozen=True, eq=False)
class Scene:
    """The scan and the surfaces that explain it so far. Nothing of it changes.

    Attributes
    ----------
    recording : Recording
    model : BeamModel
    floor_z : float, metres
    settings : LikelihoodSettings
    room : Candidate or None
        Walls around all.
    solids : tuple of Hypothesis
    n_jobs : int or None
    """

    recording: Recording
    model: BeamModel
    floor_z: float
    settings: LikelihoodSettings
    room: Candidate | None = None
    solids: tuple[Hypothesis, ...] = ()
    n_jobs: int | None = None

    @property
    def scan(self) -> Scan:
        """All beams."""
        return self.recording.scan

    def with_solids(self, solids: Sequence[Hypothesis]) -> Scene:
        """The same scene with other solids."""
        return replace(self, solids=tuple(solids))

    def with_solid(self, i: int, solid: Hypothesis) -> Scene:
        """The same scene with another solid i."""
        return self.with_solids([*self.solids[:i], solid, *self.solids[i + 1 :]])

    def without(self, i: int) -> Scene:
        """The same scene without solid i."""
        return self.with_solids([*self.solids[:i], *self.solids[i + 1 :]])

    @cached_property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The solids, and the room behind them."""
        solids = [solid.obstacle for solid in self.solids]
        return (*solids, self.room.walls) if self.room is not None else tuple(solids)

    def tolerance_of(self, obstacle: Obstacle) -> float:
        """By how much its walls may be off, metres."""
        return self.settings.tolerance_of(obstacle.size, is_room=obstacle.is_open)

    def expected(
        self, rows: Any = slice(None), *, without: int | None = None, floor: bool = True
    ) -> Floats:
        """Range of the nearest surface for some beams, one solid left out; infinite for none."""
        return self._cast(self.obstacles, rows, without, floor)[0]

    def expected_within(self, rows: Any) -> tuple[Floats, Floats]:
        """Nearest and farthest range that the tolerance lets each of some beams have."""
        limits = [each.within(self.tolerance_of(each), self.floor_z) for each in self.obstacles]
        large, small = (
            self._cast([pair[k] for pair in limits], rows, None, True)[0] for k in (0, 1)
        )
        near, far = np.minimum(large, small), np.maximum(large, small)
        for larger, _ in limits:
            # Hardly ever is a sensor so near that this has to be asked for each beam.
            if larger.swallows(self.recording.places).any():
                near[larger.swallows(_some(self.scan.origins, rows))] = 0.0
        return near, far

    def first_hits(self) -> tuple[Floats, Ints, Ints]:
        """Range, part and face of the nearest surface of each beam.

        A part is the number of a solid, `FLOOR`, `NOTHING`, or the number of solids for the
        room. The faces of a prism are its walls in order, then its top and bottom.
        """
        expected, triangles, surfaces = self._cast(self.obstacles, slice(None), None, True)
        parts, faces = np.append(surfaces, [[NOTHING, -1]], axis=0)[triangles].T
        return expected, parts, faces

    def _cast(
        self, obstacles: Sequence[Obstacle], rows: Any, without: int | None, floor: bool
    ) -> tuple[Floats, Ints, Ints]:
        """Range and triangle for some beams, and part and face (t, 2) of each triangle."""
        pieces = [
            (part, obstacle.top, obstacle.unit)
            for part, obstacle in enumerate(obstacles)
            if part != without and obstacle.top > self.floor_z
        ]
        if floor or not pieces:
            depth = 0.0 if floor else 100.0 * self.model.max_range
            pieces.append((FLOOR, self.floor_z - depth, self._plate))
        parts, tops, units = zip(*pieces, strict=True)
        sizes = [len(vertices) for vertices, _, _ in units]
        vertices = np.concatenate([vertices for vertices, _, _ in units])
        vertices[:, 2] = self.floor_z + (np.repeat(tops, sizes) - self.floor_z) * vertices[:, 2]
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
        beyond = 10 * self.model.max_range
        low, high = (
            x[:2] + side for x, side in zip(self.recording.bounds, (-beyond, beyond), strict=True)
        )
        corners = [[*low, 1.0], [high[0], low[1], 1.0], [*high, 1.0], [low[0], high[1], 1.0]]
        return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, dtype=np.int64)

    @cached_property
    def ceiling(self) -> float:
        """z that no beam reaches, metres."""
        return float(self.recording.bounds[1][2]) + 2.0 * self.model.max_range

    def costs(self, rows: Ints) -> Floats:
        """Negative log-likelihood of some beams, each wall where the tolerance fits it best."""
        near, far = self.expected_within(rows)
        model, ranges = self.model, self.scan.ranges[rows]
        return model.fair_costs(ranges, near, far, model.sigma[rows], model.limits(rows))

    def score(self, rows: Ints) -> float:
        """Half the Bayesian information criterion of the solids on some beams."""
        n_parameters = sum(solid.n_parameters for solid in self.solids)
        return float(self.costs(rows).sum()) + 0.5 * float(np.log(len(rows) + 2)) * n_parameters

    def misfit(self, solid: Hypothesis) -> float:
        """Standard deviations by which beams near a solid fit worse than their noise explains.

        The largest of: by the costs of all beams together; by the costs of those that come by in
        about the same direction on the same side, halved since the worst of many is taken; and by
        how many are off by more than three sigmas, which tells more where the noise is less than
        was said.
        """
        how, model = self.settings.refinement, self.model
        rows, (center, radius) = self.rows_of(solid), self.place_of(solid)
        if not len(rows):
            return 0.0
        near, far = self.expected_within(rows)
        ranges, sigma = self.scan.ranges[rows], model.sigma[rows]
        shortest, longest = limits = model.limits(rows)
        costs = model.costs(ranges, near, far, sigma, limits)
        foreseen = np.isfinite(ranges) & (far >= shortest) & (near <= longest)
        # What outliers and dropouts cost at the shares that the scene has of them.
        lapses = model.outliers * model.outlier_cost + model.dropouts * model.dropout_cost
        square = model.outliers * model.outlier_cost**2 + model.dropouts * model.dropout_cost**2
        usual = np.where(foreseen, lapses, 0.0)
        usual[foreseen] += model.usual_costs(near[foreseen], far[foreseen], sigma[foreseen])
        n = max(int(foreseen.sum()), 1)
        by_sum = float((costs.sum() - usual.sum()) / np.sqrt((0.5 + square) * n))
        n_off, expected = int((costs[foreseen] > 4.5).sum()), 0.0027 + model.outliers
        by_number = float((n_off - expected * n) / np.sqrt(expected * n + 1.0))

        shape = how.ways, how.sides
        bundle = self.recording.lines.bundles(rows, tuple(center), radius, shape)
        n_each = np.bincount(bundle, foreseen, how.ways * how.sides)
        excess = np.bincount(bundle, costs - usual, how.ways * how.sides)
        spread = np.sqrt((0.5 + square) * np.maximum(n_each, how.few))
        return max(by_sum, by_number, float((excess / spread).max()) / 2.0)

    def place_of(self, solid: Hypothesis) -> tuple[Floats, float]:
        """Centre and radius within which beams tell of a solid."""
        return solid.region.center, self.settings.selection.near * solid.region.radius

    def gain(self, i: int, rows: Ints) -> float:
        """Log-likelihood, by some beams, that solid i gains over nothing, less its parameters."""
        return self.without(i).score(rows) - self.score(rows)

    def rows_near(
        self, center: Floats, radius: float, stride: int = 1, most: int | None = None
    ) -> Ints:
        """Beams, one in `stride`, whose level lines come within `radius` of a place, in range.

        If there are more than `most`, every other one or fewer.
        """
        rows = self.recording.lines.near(tuple(center), radius, self.model.max_range, stride)
        if most is None or len(rows) <= most:
            return rows
        return np.ascontiguousarray(rows[:: -(-len(rows) // most)])

    def rows_of(self, solid: Hypothesis) -> Ints:
        """The beams that tell whether a solid explains what is near it."""
        return self.rows_near(*self.place_of(solid), most=self.settings.refinement.most_beams)

    def clear_rows(self, stride: int, least: float) -> Ints:
        """Beams, one in `stride`, that come near no solid; all, if less than `least` of them."""
        clear = np.ones(-(-len(self.scan) // stride), dtype=bool)
        for solid in self.solids:
            obstacle = solid.obstacle
            radius = self.settings.selection.near * obstacle.radius
            near = self.rows_near(obstacle.center, radius, stride)
            clear[near // stride] = False
        return stride * np.flatnonzero(clear if clear.mean() > least else clear | True)

    def near(
        self,
        center: Floats,
        radius: float,
        without: int | None = None,
        stride: int = 1,
        most: int | None = None,
    ) -> Beams:
        """Beams, one in `stride`, within `radius` of a place before they meet another surface.

        Each stands for `stride`; if there are more than `most`, the others are as if there were
        none.
        """
        rows = self.rows_near(center, radius, stride, most)
        background = self.expected(rows, without=without)
        before = self.recording.lines.entries(rows, tuple(center), radius) < background
        return self.beams(rows[before], background[before], stride)

    def beams(
        self, rows: Any, background: Floats, stride: int = 1, *, is_open: bool = False
    ) -> Beams:
        """Some beams with what they meet, each of which stands for `stride`."""
        scan = self.scan
        arrays = _some(scan.origins, rows), _some(scan.directions, rows), scan.ranges[rows]
        return Beams(
            (*arrays, background, self.model.sigma[rows]),
            self.model.limits(rows),
            self.model,
            self.floor_z,
            self.settings,
            n_jobs=self.n_jobs,
            stride=stride,
            is_open=is_open,
        )


def _some(array: Floats, rows: Any) -> Floats:
    """Rows of an array: a slice of them, or some by number, which `take` gathers faster."""
    some: Floats = array[rows] if isinstance(rows, slice) else array.take(rows, axis=0)
    return some
