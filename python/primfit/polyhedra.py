"""Bounded planes to polyhedra: which meet, in which edges and corners, around which solids."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import networkx as nx
import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from primfit import footprints
from primfit._check import Floats, Ints, as_rows, frozen
from primfit.faces import moments
from primfit.joint_fit import fitted, fitted_together, scatter_of
from primfit.planes import Plane
from primfit.polyhedron import Polyhedron
from primfit.shapes import shape_of

EQUAL = 0.02
"""Difference of lengths, relative to the size, and of angles, radians, that still counts as none in
the name of a solid that was found."""

_OPEN = -1
"""Neighbour of a side at which no plane was found."""


@dataclass(frozen=True, eq=False)
class FoundPolyhedron:
    """A closed solid that was found.

    Attributes
    ----------
    kind : str
        As that of `Polyhedron`, where differences up to `EQUAL` count as none.
    vertices : (v, 3) float64, metres
    faces : tuple of int arrays
        Rows of `vertices` around each face, counter-clockwise from outside.
    planes : tuple of int
        Plane of each face; -1 where none was found.
    observed : tuple of bool
        Which faces have points. Others were never seen: the seen ones end in one plane all around.
    size, quat_xyzw, footprint
        As those of `Polyhedron`.
    """

    kind: str
    vertices: Floats
    faces: tuple[Ints, ...]
    planes: tuple[int, ...]
    observed: tuple[bool, ...]
    size: float | tuple[float, ...]
    quat_xyzw: Floats
    footprint: Floats | None

    @property
    def center(self) -> Floats:
        """Mean of the vertices (3,), metres."""
        return self.vertices.mean(axis=0)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        return self.center + moments(self.vertices - self.center, self.faces)[1]

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        return moments(self.vertices - self.center, self.faces)[0]

    @property
    def angle(self) -> float:
        """Yaw of the footprint of an upright prism, radians; NaN for others."""
        if self.footprint is None:
            return np.nan
        return footprints.angle_of(self.footprint, self.kind, EQUAL)

    def moved(self, offset: Floats) -> FoundPolyhedron:
        """The solid moved by a vector (3,), metres."""
        footprint = None if self.footprint is None else frozen(self.footprint + offset[:2])
        return replace(self, vertices=frozen(self.vertices + offset), footprint=footprint)

    def to_dict(self) -> dict[str, Any]:
        """The solid as plain numbers, for JSON."""
        return {
            "kind": self.kind,
            "center": self.center.tolist(),
            "centroid": self.centroid.tolist(),
            "size": self.size,
            "quat_xyzw": self.quat_xyzw.tolist(),
            "vertices": self.vertices.tolist(),
            "faces": [face.tolist() for face in self.faces],
            "planes": list(self.planes),
            "observed": list(self.observed),
        }

    def __repr__(self) -> str:
        center = ", ".join(f"{value:.4f}" for value in self.center)
        size = ", ".join(f"{value:.4f}" for value in np.atleast_1d(self.size))
        return (
            f"FoundPolyhedron({self.kind}, center=({center}), size={size} m, "
            f"{sum(self.observed)} of {len(self.faces)} faces observed)"
        )


@dataclass(frozen=True, eq=False)
class Polyhedra:
    """What planes make.

    Attributes
    ----------
    solids : tuple of FoundPolyhedron
    shells : tuple of tuple of int
        Planes that meet without closing, and are in no solid.
    edges : (e, 2) int64
        Pairs of planes that meet in an edge.
    """

    solids: tuple[FoundPolyhedron, ...]
    shells: tuple[tuple[int, ...], ...]
    edges: Ints

    def __repr__(self) -> str:
        kinds = ", ".join(solid.kind for solid in self.solids) or "none"
        return (
            f"Polyhedra({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; "
            f"{len(self.shells)} open shell{'s' * (len(self.shells) != 1)}; "
            f"{len(self.edges)} edges)"
        )


@dataclass(eq=False)
class _Side:
    """A stretch of a face's outline along which it meets one neighbour.

    Attributes
    ----------
    neighbor : int
        Plane, or `_OPEN`.
    samples : (k, 3) float64
        Points of the outline there, in its direction.
    """

    neighbor: int
    samples: Floats

    @property
    def along(self) -> Floats:
        return self.samples[-1] - self.samples[0]

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.along))


@dataclass(eq=False)
class _Face:
    """A bounded plane: equation, points, outline in its plane, and what it meets around it."""

    equation: Floats
    points: Floats
    boundary: Floats
    axes: Floats
    polygon: shapely.Polygon
    spacing: float
    rms: float
    sides: list[_Side] = field(default_factory=list)

    @classmethod
    def of(cls, plane: Plane, points: Floats) -> _Face:
        own = points[plane.inliers]
        normal = plane.equation[:3]
        x = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(normal, x)], axis=1)
        boundary = plane.boundary
        residuals = own @ normal + plane.equation[3]
        return cls(
            equation=plane.equation,
            points=own,
            boundary=boundary,
            axes=axes,
            polygon=shapely.Polygon(boundary @ axes if plane.area > 0.0 else None),
            spacing=float(np.sqrt(plane.area / max(len(own), 1))),
            rms=float(np.sqrt((residuals**2).mean())) if len(own) else 0.0,
        )

    @property
    def reach(self) -> float:
        """How far from an edge the outline may end, metres."""
        return 3.0 * self.spacing + 3.0 * self.rms


def find_polyhedra(planes: Iterable[Plane], points: ArrayLike) -> Polyhedra:
    """Solids that bounded planes enclose, of any shape and in any position.

    Along the outline of each plane the neighbours are read off that meet it there. Planes that name
    each other share an edge; edges that follow each other around two faces meet in a corner. Where
    all sides of a group have a neighbour, or end in one plane that was not seen from there, the
    group is a solid: its planes are fitted again, all at once, so that they meet in its corners.

    That plane is the floor or wall where one was found there. Else it is the one in which the sides
    end, which is known only to the spacing of the points. Edges shorter than about five spacings
    and five standard deviations of the noise are not seen.

    Parameters
    ----------
    planes : iterable of Plane
        Their outlines, concave for concave faces, must follow the true ones to about three
        spacings of the points.
    points : (n, 3) float64, metres
        The cloud of whose rows `inliers` are.

    Returns
    -------
    Polyhedra

    Examples
    --------
    >>> import numpy as np, primfit
    >>> size, face = np.array([3.0, 2.0, 1.0]), np.arange(6000) % 6
    >>> points = size * np.random.default_rng(1).random((6000, 3))
    >>> points[np.arange(6000), face // 2] = face % 2 * size[face // 2]
    >>> planes = primfit.detect_planes(points, rng=1)
    >>> primfit.find_polyhedra(planes, points).solids[0].kind
    'rectangle'
    """
    cloud = as_rows("points", points, 3, finite=False)
    finite = np.isfinite(cloud).all(axis=1)
    place = cloud[finite].mean(axis=0) if finite.any() else np.zeros(3)
    local = cloud - place
    faces = [_Face.of(plane.moved(-place), local) for plane in planes]
    for i, face in enumerate(faces):
        face.sides = _sides(i, faces)
    lengths = {
        (i, side.neighbor): side.length for i, face in enumerate(faces) for side in face.sides
    }
    for i, face in enumerate(faces):
        face.sides = _joined(
            [side for side in face.sides if _is_clear(i, side, face.reach, lengths)]
        )
    edges = [
        (i, side.neighbor)
        for i, face in enumerate(faces)
        for side in face.sides
        if i < side.neighbor and any(other.neighbor == i for other in faces[side.neighbor].sides)
    ]
    graph = nx.Graph(edges)
    solids, shells = [], []
    for group in sorted(sorted(each) for each in nx.connected_components(graph)):
        solid = _solid(group, faces, graph)
        if solid is None:
            shells.append(tuple(group))
        else:
            solids.append(solid.moved(place))
    return Polyhedra(
        tuple(solids), tuple(shells), frozen(np.array(edges, dtype=int).reshape(-1, 2))
    )


def _sides(i: int, faces: list[_Face]) -> list[_Side]:
    """The neighbours around a face, in the direction of its boundary."""
    face = faces[i]
    if face.polygon.is_empty:
        return []
    ring = np.vstack([face.boundary, face.boundary[:1]])
    steps = np.maximum(1, np.ceil(np.linalg.norm(np.diff(ring, axis=0), axis=1) / face.spacing))
    samples = np.concatenate(
        [
            a + (b - a) * np.arange(int(n))[:, None] / n
            for a, b, n in zip(ring[:-1], ring[1:], steps, strict=True)
        ]
    )
    nearest = np.full(len(samples), _OPEN)
    least = np.full(len(samples), np.inf)
    for j, other in enumerate(faces):
        sine = float(np.linalg.norm(np.cross(face.equation[:3], other.equation[:3])))
        if j == i or sine < 0.1:
            continue
        reach = max(face.reach, other.reach)
        off = np.abs(samples @ other.equation[:3] + other.equation[3]) / sine
        near = np.flatnonzero((off <= reach) & (off < least))
        outline = shapely.distance(other.polygon, shapely.points(samples[near] @ other.axes))
        near = near[outline <= reach]
        nearest[near], least[near] = j, off[near]
    starts = np.flatnonzero(nearest != np.roll(nearest, 1))
    if not len(starts):
        return [_Side(int(nearest[0]), samples)]
    samples, nearest = np.roll(samples, -starts[0], axis=0), np.roll(nearest, -starts[0])
    pieces = np.split(np.arange(len(samples)), starts[1:] - starts[0])
    sides = [_Side(int(nearest[piece[0]]), samples[piece]) for piece in pieces]
    return _joined([side for side in sides if side.length >= 0.5 * face.reach])


def _is_clear(i: int, side: _Side, reach: float, lengths: dict[tuple[int, int], float]) -> bool:
    """Whether a side is no chance meeting near a corner.

    Neighbours that name each other may be short on one of the two; one that does not must be long.
    Where nothing is near, the corners have already been left out.
    """
    if side.neighbor == _OPEN:
        return True
    mutual = lengths.get((side.neighbor, i))
    if mutual is None:
        return side.length >= 2.0 * reach
    return max(side.length, mutual) >= 1.5 * reach


def _joined(sides: list[_Side]) -> list[_Side]:
    """Sides around a face, with those one that follow each other along one neighbour.

    Where nothing is near between two such stretches, the outline has a bay.
    """
    bays = [
        side.neighbor == _OPEN and sides[k - 1].neighbor == sides[(k + 1) % len(sides)].neighbor
        for k, side in enumerate(sides)
    ]
    joined: list[_Side] = []
    for side in (side for side, is_bay in zip(sides, bays, strict=True) if not is_bay):
        if joined and joined[-1].neighbor == side.neighbor:
            joined[-1] = _Side(side.neighbor, np.vstack([joined[-1].samples, side.samples]))
        else:
            joined.append(side)
    if len(joined) > 1 and joined[0].neighbor == joined[-1].neighbor:
        last = joined.pop()
        joined[0] = _Side(last.neighbor, np.vstack([last.samples, joined[0].samples]))
    return joined


def _oriented(group: list[int], faces: list[_Face], graph: nx.Graph) -> dict[int, bool] | None:
    """Which faces run the wrong way around, so that the sides of an edge run opposite ways."""
    turned = {group[0]: False}
    for i, j in nx.bfs_edges(graph, group[0]):
        one, two = _side(faces[i], j), _side(faces[j], i)
        turned[j] = turned[i] ^ bool(one.along @ two.along > 0.0)
    for i, j in graph.subgraph(group).edges:
        alike = bool(_side(faces[i], j).along @ _side(faces[j], i).along > 0.0)
        if turned[i] ^ turned[j] ^ alike:
            return None
    return turned


def _side(face: _Face, neighbor: int) -> _Side:
    return next(side for side in face.sides if side.neighbor == neighbor)


def _solid(group: list[int], faces: list[_Face], graph: nx.Graph) -> FoundPolyhedron | None:
    """The closed solid that a group of planes makes, if it makes one."""
    turned = _oriented(group, faces, graph)
    if turned is None:
        return None
    row = {plane: k for k, plane in enumerate(group)}
    sides = [faces[i].sides[:: -1 if turned[i] else 1] for i in group]
    cycles = [
        [row[side.neighbor] if graph.has_edge(i, side.neighbor) else _OPEN for side in each]
        for i, each in zip(group, sides, strict=True)
    ]
    scatters = [scatter_of(faces[i].points, max(faces[i].rms, 1e-9)) for i in group]
    equations = [faces[i].equation for i in group]
    planes = list(group)
    for cycle in cycles:
        met = [k for k in cycle if k != _OPEN]
        if len(cycle) < 3 or len(set(met)) < len(met):
            return None
    while rim := next(
        ((k, n) for k, c in enumerate(cycles) for n, j in enumerate(c) if j < 0), None
    ):
        loop = _loop(cycles, rim)
        ends = [sides[k][n] for k, n in loop if k < len(group)]
        if len(ends) < max(3, len(loop)) or len({k for k, _ in loop}) < len(loop):
            return None
        beyond = {side.neighbor for side in ends}
        plane = beyond.pop() if len(beyond) == 1 else _OPEN
        points = np.vstack([side.samples for side in ends])
        slack = max(faces[i].reach for i in group)
        equation = fitted(points) if plane < 0 else faces[plane].equation
        if np.sqrt(((points @ equation[:3] + equation[3]) ** 2).mean()) > slack:
            return None
        for k, n in loop:
            cycles[k][n] = len(cycles)
        cycles.append([k for k, _ in reversed(loop)])
        equations.append(equation)
        scatters.append(scatter_of(points if plane < 0 else faces[plane].points, slack))
        planes.append(plane)
    corners = _corners(cycles)
    if corners is None:
        return None
    vertices = fitted_together(np.array(equations), np.array(scatters), corners)
    for i, corner in zip(group, corners, strict=False):
        flat = shapely.points(vertices[corner] @ faces[i].axes)
        if (shapely.distance(faces[i].polygon, flat) > 3.0 * faces[i].reach).any():
            return None
    try:
        solid = Polyhedron(vertices, tuple(corners))
    except ValueError:
        return None
    shape = shape_of(solid.vertices, solid.faces, EQUAL)
    return FoundPolyhedron(
        kind=shape.kind,
        vertices=solid.vertices,
        faces=solid.faces,
        planes=tuple(planes),
        observed=tuple(k < len(group) for k in range(len(planes))),
        size=shape.size,
        quat_xyzw=Rotation.from_matrix(shape.rotations[0]).as_quat(canonical=True),
        footprint=shape.footprint,
    )


def _loop(cycles: list[list[int]], first: tuple[int, int]) -> list[tuple[int, int]]:
    """Sides (face, place) along the rim of an open surface, from one of them around."""
    loop = [first]
    k, n = first
    while True:
        n = (n + 1) % len(cycles[k])
        if cycles[k][n] >= 0:
            k, n = cycles[k][n], cycles[cycles[k][n]].index(k)
        elif (k, n) == first:
            return loop
        else:
            loop.append((k, n))


def _corners(cycles: list[list[int]]) -> list[Ints] | None:
    """Corners around each face, numbered, where three or more faces meet; None where fewer do."""
    number: dict[tuple[int, int], int] = {}
    n_corners = 0
    for k, cycle in enumerate(cycles):
        for n in range(len(cycle)):
            start = k, n
            if start in number:
                continue
            n_met = 0
            while start not in number:
                number[start] = n_corners
                n_met += 1
                face, place = start
                other = cycles[face][place]
                start = other, (cycles[other].index(face) + 1) % len(cycles[other])
            if n_met < 3:
                return None
            n_corners += 1
    return [np.array([number[k, n] for n in range(len(cycle))]) for k, cycle in enumerate(cycles)]
