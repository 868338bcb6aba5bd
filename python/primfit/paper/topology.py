"""From upright planes to closed outlines: corners and cycles.

Two ways. `chain_walls`, the default, follows each wall to the next one, as their normals and the
beams that pass between them tell. `intersect_pairs` and `simple_cycles` are the paper's Algorithms
3 (lines 10 to 22) and 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, islice

import networkx as nx
import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from primfit._check import Floats
from primfit.geometry.footprints import signed_area
from primfit.geometry.products import dot, dots
from primfit.planes.passages import MOST_PASSING, passages
from primfit.planes.peeling import Patch
from primfit.planes.ransac import NoisyPoints, Orientation, fit
from primfit.scans.scan import Scan

_LEAST_SINE = 0.1
"""Sine of the angle between two walls below which they have no corner worth the name."""

_REFINEMENTS = 4
"""Rounds of `refine`; corners move by less than their deviation after the second."""

_WIDE = 1.5
"""Times the limit up to which a point that is a wall's by its place is fitted."""

_MOST_CYCLES = 10_000
"""Simple cycles after which the literal search gives up: their number grows exponentially."""


@dataclass(frozen=True, eq=False)
class Wall:
    """An upright plane seen from above: a line that runs from `start` to `end`.

    The free side is to the right of `along`, so the walls of a solid follow each other
    counter-clockwise, those of a room clockwise.

    Attributes
    ----------
    plane : int
        Number of the patch.
    patch : Patch
    low, high : float, metres
        Where the wall ends, along the first axis of the patch.
    passages : (k,) float64 or None, metres
        Where beams passed the line below the top, along the same axis, sorted; None when origins
        are not known.
    cleared : float, metres
        Lowest z above the top at which a beam passed over the wall; infinite for none.
    side : float
        1, or -1 for the wall seen from the back of the patch.
    """

    plane: int
    patch: Patch
    low: float
    high: float
    passages: Floats | None
    cleared: float = np.inf
    side: float = 1.0

    @classmethod
    def of(cls, number: int, patch: Patch, cloud: NoisyPoints, scan: Scan | None) -> Wall:
        """The wall of an upright patch.

        With a scan it ends where beams that pass begin to outnumber those that end on it.
        """
        if scan is None:
            return cls(number, patch, float(patch.low[0]), float(patch.high[0]), None)
        at = passages(scan, patch.model.equation, patch.axes, cloud.typical_sigma)
        passed = np.sort(at[at[:, 1] <= patch.high[1], 0])
        hits = dots(cloud.take(patch.inliers).feet(patch.model.equation), patch.axes[0])
        low, high = _dense_run(hits, passed)
        over = at[(at[:, 0] >= low) & (at[:, 0] <= high) & (at[:, 1] > patch.high[1]), 1]
        return cls(number, patch, low, high, passed, float(over.min(initial=np.inf)))

    @cached_property
    def line(self) -> tuple[float, float, float]:
        """``a x + b y + c == 0`` on the line, with (a, b) a unit normal towards the free side."""
        a, b, _, d = (self.side * self.patch.model.equation).tolist()
        length = math.hypot(a, b)
        return a / length, b / length, d / length

    @property
    def along(self) -> Floats:
        """Unit direction (2,) of the line."""
        direction: Floats = self.side * self.patch.axes[0, :2]
        return direction

    @property
    def start(self) -> float:
        """First place along the line, metres."""
        return self.low if self.side > 0.0 else -self.high

    @property
    def end(self) -> float:
        """Last place along the line, metres."""
        return self.high if self.side > 0.0 else -self.low

    @property
    def top(self) -> float:
        """z of the highest return, metres."""
        return float(self.patch.high[1])

    def is_open(self, low: float, high: float) -> bool:
        """Whether beams passed between two places of the line, metres along it."""
        if low >= high or self.passages is None:
            return False
        first, last = np.searchsorted(self.passages, (low, high))
        return bool(last - first > MOST_PASSING)


@dataclass(frozen=True, eq=False)
class Cycle:
    """A closed run of walls.

    Attributes
    ----------
    walls : tuple of Wall
        In order; vertex i is between wall i - 1 and wall i.
    vertices : (m, 2) float64, metres
    """

    walls: tuple[Wall, ...]
    vertices: Floats

    @property
    def is_simple(self) -> bool:
        """Whether it does not cross itself."""
        return bool(shapely.LinearRing(self.vertices).is_simple)

    @property
    def is_solid(self) -> bool:
        """Whether it is seen from outside; a room is seen from inside."""
        return signed_area(self.vertices) > 0.0


def _dense_run(hits: Floats, passed: Floats) -> tuple[float, float]:
    """First and last hit of the run of places with the most hits less passages."""
    hits = hits[np.isfinite(hits)]
    places = np.concatenate([hits, passed])
    order = np.argsort(places, kind="stable")
    gain = np.cumsum(np.where(order < len(hits), 1, -1))
    before = np.concatenate([[0], gain[:-1]])
    lowest = np.minimum.accumulate(before)
    last = int(np.argmax(gain - lowest))
    first = int(np.argmin(before[: last + 1]))
    return float(places[order[first]]), float(places[order[last]])


def walls_of(patches: Iterable[Patch], cloud: NoisyPoints, scan: Scan | None) -> list[Wall]:
    """The upright ones of some patches, as walls."""
    return [
        Wall.of(number, patch, cloud, scan)
        for number, patch in enumerate(patches)
        if abs(patch.model.equation[2]) < 0.5
    ]


def chain_walls(walls: list[Wall], tolerance: float) -> list[Cycle]:
    """Cycles of walls that follow each other.

    A wall is followed by another when the lines meet within `tolerance` of the end of the one and
    the start of the other. Farther is allowed, up to the length of the longer wall, where no beam
    passed between. Each wall has one next wall at the most; of all ways to choose them the one
    with the most corners and the shortest gaps is taken. Time and memory grow with the square of
    the number of walls.

    Parameters
    ----------
    walls : list of Wall
        Without a scan both sides of each are tried.
    tolerance : float, metres
    """
    one_sided = all(wall.passages is not None for wall in walls)
    sides = walls if one_sided else walls + [replace(wall, side=-1.0) for wall in walls]
    n = len(sides)
    corners: dict[tuple[int, int], Floats] = {}
    reach = sum(wall.end - wall.start for wall in walls) + 1.0
    cost = np.full((n, n), 4.0 * reach)
    for i, wall in enumerate(sides):
        for j, following in enumerate(sides):
            corner = _corner(wall, following)
            if corner is None or wall.plane == following.plane:
                continue
            here, there = dot(corner, wall.along), dot(corner, following.along)
            gaps = here - wall.end, following.start - there
            farthest = max(wall.end - wall.start, following.end - following.start, tolerance)
            if min(gaps) < -tolerance or max(gaps) > farthest:
                continue
            margin = tolerance / 4
            if gaps[0] > tolerance and (
                not one_sided or wall.is_open(wall.end + margin, here - margin)
            ):
                continue
            if gaps[1] > tolerance and (
                not one_sided or following.is_open(there + margin, following.start - margin)
            ):
                continue
            corners[i, j] = corner
            cost[i, j] = abs(gaps[0]) + abs(gaps[1])
    graph: nx.DiGraph[int] = nx.DiGraph()
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    graph.add_edges_from((int(i), int(j)) for i, j in pairs if (i, j) in corners)
    cycles = []
    for loop in nx.simple_cycles(graph):
        # Each wall has one way in and one way out, so cycles share no wall.
        if len(loop) >= 3:
            first = loop.index(min(loop))
            order = loop[first:] + loop[:first]
            vertices = np.array([corners[order[k - 1], order[k]] for k in range(len(order))])
            cycle = Cycle(tuple(sides[k] for k in order), vertices)
            if cycle.is_simple:
                cycles.append(cycle)
    cycles.sort(key=lambda cycle: min(wall.plane for wall in cycle.walls))
    return cycles if one_sided else [cycle for cycle in cycles if cycle.is_solid]


def refine(cycle: Cycle, cloud: NoisyPoints, orientation: Orientation) -> Cycle:
    """The cycle with its walls fitted to all points that are theirs by their place.

    A point is a wall's when its beam meets the line between the two corners: unlike the distance
    from the plane, that does not depend on the noise of its range, so neighbouring walls no
    longer take each other's points.
    """
    for _ in range(_REFINEMENTS):
        walls = []
        has_settled = True
        for k, wall in enumerate(cycle.walls):
            following = cycle.vertices[(k + 1) % len(cycle.vertices)]
            ends = sorted((dot(cycle.vertices[k], wall.along), dot(following, wall.along)))
            equation = wall.patch.model.equation
            near = np.flatnonzero(np.abs(cloud.residuals(equation)) <= _WIDE * cloud.limit)
            at = dots(cloud.take(near).feet(equation)[:, :2], wall.along)
            rows = near[(at >= ends[0]) & (at <= ends[1])]
            has_settled &= np.array_equal(rows, wall.patch.inliers)
            model = fit(cloud.take(rows), equation, orientation)
            if model is None:
                return cycle
            walls.append(replace(wall, patch=Patch.of(cloud, model, rows)))
        corners = [_corner(walls[k - 1], walls[k]) for k in range(len(walls))]
        if any(corner is None for corner in corners):
            return cycle
        moved = Cycle(tuple(walls), np.array(corners))
        if not moved.is_simple or moved.is_solid != cycle.is_solid:
            return cycle
        cycle = moved
        if has_settled:
            break
    return cycle


def _corner(wall: Wall, other: Wall) -> Floats | None:
    (a, b, c), (p, q, r) = wall.line, other.line
    sine = a * q - b * p
    if abs(sine) < _LEAST_SINE:
        return None
    return np.array([b * r - c * q, c * p - a * r]) / sine


def intersect_pairs(
    cloud: NoisyPoints, patches: list[Patch], walls: list[Wall], close: float
) -> list[tuple[int, int, Floats]]:
    """Edges of the paper's graph (Algorithm 3, lines 10 to 21).

    Every pair of planes is intersected; the point counts when inliers of both are within `close`
    of it, seen from above. A plane with exactly two such points is an edge between them.

    Returns
    -------
    edges : list of (int, int, (2, 2) float64)
        The two points as numbers, and where they are.
    """
    points: list[Floats] = []
    incident: dict[int, list[int]] = {wall.plane: [] for wall in walls}
    for wall, other in combinations(walls, 2):
        corner = _corner(wall, other)
        if corner is None:
            continue
        near = all(
            np.hypot(*(cloud.points[patches[k].inliers, :2] - corner).T).min() <= close
            for k in (wall.plane, other.plane)
        )
        if near:
            for k in (wall.plane, other.plane):
                incident[k].append(len(points))
            points.append(corner)
    return [
        (ends[0], ends[1], np.array([points[ends[0]], points[ends[1]]]))
        for ends in incident.values()
        if len(ends) == 2
    ]


def simple_cycles(edges: list[tuple[int, int, Floats]]) -> list[Floats]:
    """All simple cycles of the paper's graph as outlines (m, 2) (Algorithm 5).

    Cycles with the same set of points count once, whichever comes first. The outlines run
    counter-clockwise by angle about their mean, as the paper sorts vertices.
    """
    graph: nx.Graph[int] = nx.Graph()
    places: dict[int, Floats] = {}
    for i, j, ends in edges:
        graph.add_edge(i, j)
        places[i], places[j] = ends
    unique: dict[tuple[int, ...], list[int]] = {}
    for cycle in islice(nx.simple_cycles(graph), _MOST_CYCLES):
        unique.setdefault(tuple(sorted(cycle)), cycle)
    outlines = []
    for cycle in unique.values():
        vertices = np.array([places[k] for k in cycle])
        arms = vertices - vertices.mean(axis=0)
        outlines.append(vertices[np.argsort(np.arctan2(arms[:, 1], arms[:, 0]))])
    return outlines
