"""Faces that meet, and the rims where their surface ends: walked around, closed, sewn up."""

from __future__ import annotations

from dataclasses import dataclass

import networkx as nx
import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.products import dot
from primfit.polyhedra.adjacency import OPEN, Face, Side

_CORNER = 1.5
"""Length of a side where nothing was found up to which it may be a corner without points, over how
far from an edge an outline may end."""


@dataclass(eq=False)
class OpenSurface:
    """A surface of faces with what each meets around it, counter-clockwise from one side of it.

    Attributes
    ----------
    group : list of int
        Planes of the faces that were seen, the first ones.
    cycles : list of list of int
        Faces around each, or `OPEN`.
    sides : list of list of Side
        Where seen faces meet those.
    """

    group: list[int]
    cycles: list[list[int]]
    sides: list[list[Side]]

    @classmethod
    def of(cls, group: list[int], faces: list[Face], graph: nx.Graph) -> OpenSurface | None:
        """The surface of a group of planes that meet; None when it is one-sided."""
        turned = _turned(group, faces, graph)
        if turned is None:
            return None
        row = {plane: k for k, plane in enumerate(group)}
        sides = []
        for i in group:
            around = _rims_joined(i, faces[i].sides, graph)
            if turned[i]:
                around = [Side(side.neighbor, side.samples[::-1]) for side in reversed(around)]
            sides.append(around)
        cycles = [[row.get(side.neighbor, OPEN) for side in each] for each in sides]
        return cls(group, cycles, sides)

    @property
    def is_closed(self) -> bool:
        """Whether every face has three or more different ones around it."""
        return all(OPEN not in each and 3 <= len(set(each)) == len(each) for each in self.cycles)

    def next_rim(self) -> Rim | None:
        """The rim with the first open side; None without, or when it cannot be walked around."""
        met = [[j for j in cycle if j != OPEN] for cycle in self.cycles]
        if any(len(set(each)) < len(each) for each in met):
            return None
        for k, cycle in enumerate(self.cycles):
            if OPEN in cycle:
                return self._rim(k, cycle.index(OPEN))
        return None

    def _rim(self, k: int, n: int) -> Rim:
        first = k, n
        places, passed = [first], []
        while True:
            n = (n + 1) % len(self.cycles[k])
            other = self.cycles[k][n]
            if other != OPEN:
                k, n = other, self.cycles[other].index(k)
                passed.append(k)
            elif (k, n) == first:
                break
            else:
                places.append((k, n))
        samples = [self.sides[k][n].samples for k, n in places]
        owner = np.repeat(np.arange(len(places)), [len(each) for each in samples])
        return Rim(places, passed, np.concatenate(samples), owner)

    def close(self, rim: Rim, stretches: list[Ints]) -> bool:
        """Put new faces beyond a rim, each at a stretch of its samples; tells whether it can be.

        Two of them meet in an edge, three in a vertex.
        """
        first, n_faces = len(self.cycles), len(stretches)
        beyond = np.empty(len(rim.owner), dtype=np.int64)
        for j, stretch in enumerate(stretches):
            beyond[stretch] = first + j
        runs = [beyond[rim.owner == row] for row in range(len(rim.places))]
        starts = [np.flatnonzero(np.diff(run, prepend=OPEN)) for run in runs]
        if any(len(np.unique(run)) < len(each) for run, each in zip(runs, starts, strict=True)):
            return False
        for (k, n), run, each in zip(rim.places, runs, starts, strict=True):
            parts = np.split(self.sides[k][n].samples, each[1:])
            self.cycles[k][n : n + 1] = run[each].tolist()
            self.sides[k][n : n + 1] = [Side(OPEN, part) for part in parts]
        for j, stretch in enumerate(stretches):
            seen = [rim.places[row][0] for row in dict.fromkeys(rim.owner[stretch].tolist())]
            others = dict.fromkeys(((j - 1) % n_faces, (j + 1) % n_faces))
            self.cycles.append(seen[::-1] + [first + other for other in others if other != j])
        return True

    def stitch(self, rim: Rim) -> bool:
        """Close a rim too short for a face where there is one way to; tells whether.

        Two sides are one edge. A side alone is the edge to the one face that its neighbours have
        between them there, which is too small to have seen it; where there is none, its neighbours
        meet, and a corner without points was cut off.
        """
        cycles = self.cycles
        k, n = rim.places[0]
        if len(rim.places) == 2:
            j, m = rim.places[1]
            if k == j or j in cycles[k]:
                return False
            cycles[k][n], cycles[j][m] = j, k
            return True
        if len(rim.places) > 2:
            return False
        between = [j for j in rim.passed if j != k and j not in cycles[k]]
        if len(between) == 1 and len(rim.passed) == 4:
            (j,) = between
            place = cycles[j].index(cycles[k][(n + 1) % len(cycles[k])]) + 1
            cycles[k][n] = j
            cycles[j].insert(place, k)
            self.sides[j].insert(place, self.sides[k][n])
            return True
        if len(rim.passed) == 3 and len(cycles[k]) > 3:
            del cycles[k][n], self.sides[k][n]
            return True
        return False

    def cut_off(self, rim: Rim, faces: list[Face]) -> bool:
        """Take out a rim that may be only corners without points; tells whether it may."""
        for k, n in rim.places:
            if self.sides[k][n].length > _CORNER * faces[self.group[k]].reach:
                return False
        for k, n in sorted(rim.places, reverse=True):
            del self.cycles[k][n], self.sides[k][n]
        return True

    def corners(self) -> list[Ints] | None:
        """Corners around each face, numbered; None where fewer than three faces meet."""
        number: dict[tuple[int, int], int] = {}
        n_corners = 0
        for k, cycle in enumerate(self.cycles):
            for n in range(len(cycle)):
                start = k, n
                if start in number:
                    continue
                n_met = 0
                while start not in number:
                    number[start] = n_corners
                    n_met += 1
                    face, place = start
                    other = self.cycles[face][place]
                    around = self.cycles[other]
                    start = other, (around.index(face) + 1) % len(around)
                if n_met < 3:
                    return None
                n_corners += 1
        return [
            np.array([number[k, n] for n in range(len(cycle))])
            for k, cycle in enumerate(self.cycles)
        ]


@dataclass(frozen=True, eq=False)
class Rim:
    """A way along the open sides of a surface, around to itself.

    Attributes
    ----------
    places : list of (int, int)
        Face, and place in its cycle, of each side.
    passed : list of int
        Faces that the way turns over to.
    samples : (n, 3) float64
        Points along it.
    owner : (n,) int64
        Row of `places` of each.
    """

    places: list[tuple[int, int]]
    passed: list[int]
    samples: Floats
    owner: Ints


def _turned(group: list[int], faces: list[Face], graph: nx.Graph) -> dict[int, bool] | None:
    """Which faces run the wrong way around, so that the sides of an edge run opposite ways."""
    turned = {group[0]: False}
    for i, j in nx.bfs_edges(graph, group[0]):
        turned[j] = turned[i] ^ _runs_alike(faces, i, j)
    for i, j in graph.subgraph(group).edges:
        if turned[i] ^ turned[j] ^ _runs_alike(faces, i, j):
            return None
    return turned


def _runs_alike(faces: list[Face], i: int, j: int) -> bool:
    one, two = (
        next(side for side in faces[a].sides if side.neighbor == b) for a, b in ((i, j), (j, i))
    )
    return bool(dot(one.along, two.along) > 0.0)


def _rims_joined(i: int, sides: list[Side], graph: nx.Graph) -> list[Side]:
    """The sides around a face with those in one that follow each other without a neighbour."""
    ends = [not graph.has_edge(i, side.neighbor) for side in sides]
    first = next((k for k, end in enumerate(ends) if not end), 0)
    joined: list[Side] = []
    was_end = False
    for k in [*range(first, len(sides)), *range(first)]:
        if ends[k] and was_end:
            joined[-1] = Side(OPEN, np.vstack([joined[-1].samples, sides[k].samples]))
        else:
            joined.append(Side(OPEN, sides[k].samples) if ends[k] else sides[k])
        was_end = ends[k]
    return joined
