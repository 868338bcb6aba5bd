"""Boxes that do not close, since they were seen from one side, or by a sensor that bends them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import networkx as nx
import numpy as np
import shapely
from scipy.spatial import cKDTree

from primfit._check import Floats
from primfit.geometry.decompositions import inverse_of
from primfit.geometry.products import dot, dots, lengths_of, product
from primfit.polyhedra.adjacency import OPEN, Face
from primfit.polyhedra.box_fit import box_through
from primfit.polyhedra.naming import found_solid
from primfit.solids.found import FoundSolid
from primfit.solids.polyhedron import Polyhedron

_BENT, _STRAIGHT = 0.15, 0.05
"""Angle off a right one, radians, of faces of a box, where a sensor bends them and where not."""

_ALIKE = 0.4
"""Correlation of the errors of nearest points from which a sensor bends what it sees."""

_EXACT = 1e-3
"""Least noise of a face, over how far from an edge its outline may end."""

_FILLED = 0.8
"""Share of each face of a box that its plane must cover."""

_EXPLAINED = 0.9
"""Share of the points of a piece that must lie as near a box as those of its faces do."""

_ROUNDS = 4
"""Most rounds of putting pieces together; two or three are enough."""

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
"""Which end of each axis each corner of a box is at."""

_AROUND = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
"""Corners around each of its faces, as `BoxFit.faces` numbers them."""


def boxes_among(
    group: list[int], faces: list[Face], graph: nx.Graph, facing: bool, loose: Floats
) -> list[FoundSolid]:
    """Boxes of which planes that meet are two or three faces, the ones with more and larger first.

    Points (n, 3) of no plane are `loose`.

    Two must rest on a plane that goes on beyond the box; where normals are not `facing` the sensor,
    three must, since two may be a corner of a room.
    """
    square = nx.Graph(
        (i, j)
        for i, j in graph.subgraph(group).edges
        if _is_corner(faces[i], faces[j], facing) and _is_corner(faces[j], faces[i], facing)
    )
    met = [each for each in nx.enumerate_all_cliques(square) if 2 <= len(each) <= 3]
    met.sort(key=lambda each: (len(each), sum(faces[i].polygon.area for i in each)), reverse=True)
    boxes: list[FoundSolid] = []
    used: set[int] = set()
    for chosen in met:
        if not used.isdisjoint(chosen):
            continue
        box, own, pieces = _box_of(sorted(chosen), faces, graph, facing, loose)
        if box is not None:
            boxes.append(box.found(own))
            used.update(box.seen.values(), pieces)
    return boxes


def _box_of(
    chosen: list[int],
    faces: list[Face],
    graph: nx.Graph,
    facing: bool,
    loose: Floats,
) -> tuple[_Box | None, list[Face], set[int]]:
    """The box with these faces, the faces with pieces put together, and the pieces of its own.

    What bends a face may break it: where a sensor does, what the box explains is its own.
    """
    pieces: set[int] = set()
    for n_rounds in range(_ROUNDS):
        try:
            box = _Box.of(chosen, faces, graph)
        except (ValueError, FloatingPointError):
            break
        if box.is_there(faces, facing):
            return box, faces, pieces
        if not facing or len(chosen) < 3:
            break
        if not n_rounds and not _is_bent([faces[i] for i in chosen]):
            break
        far = np.concatenate([box.distances(faces[i].points).min(axis=1) for i in chosen])
        near = 3.0 * float(np.sqrt(np.mean(far**2)))
        more = box.pieces(set(range(len(faces))) - pieces, faces, near)
        if n_rounds and not more:
            break
        others = [loose[box.distances(loose).min(axis=1) <= near]] if not n_rounds else []
        faces = box.with_points([*(faces[i].points for i in sorted(more)), *others], faces)
        pieces |= more
    return None, faces, pieces


def _is_corner(one: Face, two: Face, facing: bool) -> bool:
    """Whether faces are nearly at right angles, the second behind the first where that is known."""
    normal = one.equation[:3]
    is_behind = dot(two.boundary.mean(axis=0), normal) + one.equation[3] < 0.0
    return bool(is_behind or not facing) and abs(dot(normal, two.equation[:3])) <= np.sin(_BENT)


@dataclass(frozen=True, eq=False)
class _Box:
    """A box that planes may be faces of.

    Attributes
    ----------
    frame : (3, 3) float64
        Its axes, in rows.
    ends : (2, 3) float64, metres
        Lower and upper, along the axes.
    seen, resting : dict of int to int
        By face, as `BoxFit.faces`: its plane, or the one that it rests on, which goes on beyond it.
    """

    frame: Floats
    ends: Floats
    seen: dict[int, int]
    resting: dict[int, int]

    @classmethod
    def of(cls, chosen: list[int], faces: list[Face], graph: nx.Graph) -> _Box:
        """The box of least squares with these faces and those opposite, up to what it rests on."""
        box = cls._through(chosen, faces)
        around = {side.neighbor for i in chosen for side in faces[i].sides} - {OPEN}
        around.update(j for i in chosen for j in graph[i])
        ends = box._at_ends(around, faces)
        opposite = [i for number, i in ends.items() if box._is_filled(number, faces[i])]
        if opposite:
            box = cls._through([*chosen, *opposite], faces)
            ends = box._at_ends(around, faces)
        resting = {number: i for number, i in ends.items() if box._goes_on(number, faces[i])}
        for number, plane in resting.items():
            axis, upper = divmod(number, 2)
            box.ends[upper, axis] = box._place(axis, faces[plane].equation)
        return replace(box, resting=resting)

    @classmethod
    def _through(cls, chosen: list[int], faces: list[Face]) -> _Box:
        normals = np.stack([faces[i].equation[:3] for i in chosen])
        frame, numbers, ends, _ = box_through(normals, [faces[i].points for i in chosen])
        return cls(frame, ends, dict(zip(numbers.tolist(), chosen, strict=True)), {})

    def _at_ends(self, planes: set[int], faces: list[Face]) -> dict[int, int]:
        """Which of the planes are where faces of the box end that were not seen."""
        reach = max(faces[i].reach for i in self.seen.values())
        found = {}
        for plane in sorted(planes.difference(self.seen.values())):
            normal = faces[plane].equation[:3]
            axis = int(np.abs(dots(self.frame, normal)).argmax())
            if abs(dot(self.frame[axis], normal)) < np.cos(_BENT):
                continue
            off = np.abs(self._place(axis, faces[plane].equation) - self.ends[:, axis])
            number = 2 * axis + int(off.argmin())
            if off.min() <= reach and number not in self.seen:
                found[number] = plane
        return found

    def _place(self, axis: int, equation: Floats) -> float:
        """Where the axis of the box goes through a plane."""
        middle = product(self.ends.mean(axis=0)[None], self.frame)[0]
        along = (dot(middle, equation[:3]) + equation[3]) / dot(self.frame[axis], equation[:3])
        return float(dot(middle, self.frame[axis]) - along)

    @property
    def vertices(self) -> Floats:
        return product(self.ends[_CORNERS, np.arange(3)], self.frame)

    def is_there(self, faces: list[Face], facing: bool) -> bool:
        """Whether what was seen fills its faces, and there is a solid behind them."""
        told = len(self.seen) > 2, bool(self.resting)
        if not (any(told) if facing else all(told)):
            return False
        for number, plane in self.seen.items():
            outward = self.frame[number // 2] * (2 * (number % 2) - 1)
            if facing and dot(outward, faces[plane].equation[:3]) < 0.0:
                return False
            if not self._is_filled(number, faces[plane]):
                return False
        own = [faces[plane] for plane in self.seen.values()]
        normals = np.stack([face.equation[:3] for face in own])
        off = np.abs(product(normals, self.frame.T)).max(axis=1).min()
        return bool(off >= np.cos(_STRAIGHT)) or _is_bent(own)

    def pieces(self, planes: set[int], faces: list[Face], near: float) -> set[int]:
        """The planes whose points are near the box."""
        return {
            i
            for i in planes.difference(self.seen.values())
            if not faces[i].polygon.is_empty
            and self.distances(faces[i].boundary.mean(axis=0)[None]).min() <= near
            and np.mean(self.distances(faces[i].points).min(axis=1) <= near) >= _EXPLAINED
        }

    def with_points(self, more: list[Floats], faces: list[Face]) -> list[Face]:
        """The faces with the points of those of the box and more, each at the nearest."""
        points = np.concatenate([*(faces[i].points for i in self.seen.values()), *more])
        nearest = self.distances(points).argmin(axis=1)
        together = list(faces)
        for row, (number, plane) in enumerate(self.seen.items()):
            normal = (2 * (number % 2) - 1) * self.frame[number // 2]
            own = points[nearest == row]
            if len(own):
                equation = np.append(normal, -dots(own, normal).mean())
                together[plane] = Face.through(equation, own)
        return together

    def distances(self, points: Floats) -> Floats:
        """Of points (n, 3) to each face that was seen (n, k)."""
        at = product(points, self.frame.T)
        beyond = np.maximum(np.maximum(self.ends[0] - at, at - self.ends[1]), 0.0)
        columns = []
        for number in self.seen:
            axis, upper = divmod(number, 2)
            off = beyond.copy()
            off[:, axis] = at[:, axis] - self.ends[upper, axis]
            columns.append(lengths_of(off))
        return np.stack(columns, axis=1)

    def _is_filled(self, number: int, face: Face) -> bool:
        """Whether a plane has the outline of a face of the box, to half of its reach."""
        outline = self._outline(number, face)
        inner = outline.buffer(-face.reach / 2)
        within = shapely.intersection(inner, face.polygon).area
        return within >= _FILLED * inner.area and not self._goes_on(number, face)

    def _goes_on(self, number: int, face: Face) -> bool:
        """Whether a plane goes on beyond a face of the box."""
        outline = self._outline(number, face)
        beyond = shapely.difference(face.polygon, outline.buffer(face.reach / 2))
        return beyond.area > (1.0 - _FILLED) * outline.area

    def _outline(self, number: int, face: Face) -> shapely.Polygon:
        return shapely.Polygon(product(self.vertices[_AROUND[number]], face.axes))

    def found(self, faces: list[Face]) -> FoundSolid:
        """The box as what it is called, and how well it is known."""
        numbers = [*self.seen, *(k for k in range(6) if k not in self.seen)]
        planes = [{**self.resting, **self.seen}.get(k, OPEN) for k in numbers]
        vertices = self.vertices
        solid = Polyhedron(vertices, tuple(_AROUND[numbers]))
        arms = vertices - vertices.mean(axis=0)
        turns = np.cross(np.eye(3), arms[:, None]).swapaxes(1, 2)
        grows = (_CORNERS - 0.5)[:, None] * self.frame.T
        moves = np.concatenate([np.tile(np.eye(3), (8, 1, 1)), turns, grows], axis=2)
        moves = moves.reshape(24, 9)
        spread = product(product(moves, self._covariance(faces)), moves.T)
        return found_solid(solid, spread, planes, [k in self.seen for k in numbers])

    def _covariance(self, faces: list[Face]) -> Floats:
        """Of centre, rotation and sizes (9, 9).

        What bends the faces of a box does so in all their points alike: the misfit counts by the
        number of planes (Birge, The calculation of errors by the method of least squares, 1932).
        """
        told, misfit = np.zeros((9, 9)), 0.0
        seen = {number: faces[plane] for number, plane in self.seen.items()}
        for number, face in seen.items():
            rows = self._rows(number, face.points)
            off = dots(face.points, self.frame[number // 2]) - self.ends[number % 2, number // 2]
            variance = max(face.rms, _EXACT * face.reach) ** 2
            misfit += float((off**2).sum()) / variance - len(off)
            told += product(rows.T, rows) / variance
        told /= max(1.0, misfit / (2 * len(seen) - 3))
        for number in set(range(6)).difference(seen):
            ending = [face.reach for other, face in seen.items() if other // 2 != number // 2]
            middle = self.vertices[_AROUND[number]].mean(axis=0)
            rows = self._rows(number, middle[None])
            told += product(rows.T, rows) / (min(ending) / 3.0) ** 2
        return inverse_of(told)

    def _rows(self, number: int, points: Floats) -> Floats:
        """How the distances of points to a face follow centre, rotation and sizes (n, 9)."""
        axis, upper = divmod(number, 2)
        outward = (2 * upper - 1) * self.frame[axis]
        arms = points - self.vertices.mean(axis=0)
        center = np.tile(-outward, (len(points), 1))
        size = np.tile(-0.5 * (np.arange(3) == axis), (len(points), 1))
        return np.hstack([center, np.cross(outward, arms), size])


def _is_bent(faces: list[Face]) -> bool:
    """Whether points next to each other err alike, as those of depth images do."""
    residuals, nearest = [], []
    for face in faces:
        off = dots(face.points, face.equation[:3]) + face.equation[3]
        flat = product(face.points, face.axes)
        _, pairs = cKDTree(flat).query(flat, k=2)
        residuals.append(off)
        nearest.append(off[pairs[:, 1]])
    one, two = np.concatenate(residuals), np.concatenate(nearest)
    return bool(np.mean((one - two) ** 2) < 2.0 * (1.0 - _ALIKE) * np.mean(one**2))
