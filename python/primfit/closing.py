"""Planes that meet to the closed solid around which they lie."""

from __future__ import annotations

import networkx as nx
import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from primfit._check import Floats, Ints, frozen
from primfit.adjacency import OPEN, Face, Side
from primfit.found_polyhedra import EQUAL, FoundPolyhedron
from primfit.joint_fit import fitted, fitted_together, scatter_of
from primfit.polyhedron import Polyhedron
from primfit.shapes import Shape, shape_of

_EDGE = 4.0
"""Standard deviations from the plane of a neighbour within which a point may be its own."""

_STEP = 1e-6
"""By which vertices are moved to see how a shape follows, relative to the size."""


def _oriented(group: list[int], faces: list[Face], graph: nx.Graph) -> dict[int, bool] | None:
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


def _side(face: Face, neighbor: int) -> Side:
    return next(side for side in face.sides if side.neighbor == neighbor)


def closed_solid(group: list[int], faces: list[Face], graph: nx.Graph) -> FoundPolyhedron | None:
    """The closed solid that a group of planes makes, if it makes one."""
    turned = _oriented(group, faces, graph)
    if turned is None:
        return None
    row = {plane: k for k, plane in enumerate(group)}
    sides = [_rims_joined(i, faces[i].sides[:: -1 if turned[i] else 1], graph) for i in group]
    cycles = [
        [row[side.neighbor] if graph.has_edge(i, side.neighbor) else OPEN for side in each]
        for i, each in zip(group, sides, strict=True)
    ]
    scatters = [scatter_of(_inner(i, faces, graph), max(faces[i].rms, 1e-9)) for i in group]
    equations = [faces[i].equation for i in group]
    planes = list(group)
    vague = 0.0
    for cycle in cycles:
        met = [k for k in cycle if k != OPEN]
        if len(cycle) < 3 or len(set(met)) < len(met):
            return None
    while rim := next(
        ((k, n) for k, c in enumerate(cycles) for n, j in enumerate(c) if j < 0), None
    ):
        loop, passed = _loop(cycles, rim)
        if len(loop) < 3 and _stitch(cycles, sides, loop, passed):
            continue
        ends = [sides[k][n] for k, n in loop if k < len(group)]
        if len(ends) < max(3, len(loop)) or len({k for k, _ in loop}) < len(loop):
            return None
        points = np.vstack([side.samples for side in ends])
        slack = max(faces[i].reach for i in group)
        beyond = {side.neighbor for side in ends}
        plane = beyond.pop() if len(beyond) == 1 else OPEN
        equation = fitted(points)
        misfit = float((points @ equation[:3] + equation[3]).std())
        if plane >= 0:
            off = points @ faces[plane].equation[:3] + faces[plane].equation[3]
            # All may end above the floor; that they end along another plane tells another face.
            if off.std() <= 1.5 * misfit and np.abs(off.mean()) <= slack:
                equation = faces[plane].equation
            else:
                plane = OPEN
        if misfit > slack:
            return None
        if plane < 0:
            vague = slack
        for k, n in loop:
            cycles[k][n] = len(cycles)
        cycles.append([k for k, _ in reversed(loop)])
        equations.append(equation)
        scatters.append(scatter_of(points if plane < 0 else faces[plane].points, slack))
        planes.append(plane)
    corners = _corners(cycles)
    if corners is None:
        return None
    vertices, spread = fitted_together(np.array(equations), np.array(scatters), corners)
    for i, corner in zip(group, corners, strict=False):
        flat = shapely.points(vertices[corner] @ faces[i].axes)
        if (shapely.distance(faces[i].polygon, flat) > 3.0 * faces[i].reach).any():
            return None
    try:
        solid = Polyhedron(vertices, tuple(corners))
    except ValueError:
        return None
    # Where sides end is known to a third of the slack, and so is a face that only they tell.
    extent = float(np.ptp(solid.vertices, axis=0).max())
    tolerance = max(EQUAL, 2.0 / 3.0 * vague / extent)
    shape = shape_of(solid.vertices, solid.faces, tolerance)
    return FoundPolyhedron(
        kind=shape.kind,
        vertices=solid.vertices,
        faces=solid.faces,
        planes=tuple(planes),
        observed=tuple(k < len(group) for k in range(len(planes))),
        size=shape.size,
        quat_xyzw=Rotation.from_matrix(shape.rotations[0]).as_quat(canonical=True),
        footprint=shape.footprint,
        covariance=frozen(_covariance(solid, shape, spread, tolerance)),
    )


def _inner(i: int, faces: list[Face], graph: nx.Graph) -> Floats:
    """Points of a face away from its neighbours, which take those on one side near an edge."""
    points = faces[i].points
    inside = np.ones(len(points), dtype=bool)
    for other in (faces[j] for j in graph[i]):
        inside &= np.abs(points @ other.equation[:3] + other.equation[3]) > _EDGE * other.rms
    inner = points[inside]
    return inner if len(inner) > len(points) / 2 else points


def _covariance(solid: Polyhedron, shape: Shape, spread: Floats, tolerance: float) -> Floats:
    """Covariance of centre, rotation and sizes, from that of the vertices."""
    step = _STEP * float(np.ptp(solid.vertices, axis=0).max())
    turn = Rotation.from_matrix(shape.rotations[0]).inv()
    columns = []
    for move in np.eye(solid.vertices.size).reshape(-1, *solid.vertices.shape):
        moved = shape_of(solid.vertices + step * move, solid.faces, tolerance)
        turns = Rotation.from_matrix(moved.rotations) * turn
        sizes = np.atleast_1d(moved.size) - np.atleast_1d(shape.size)
        turned = turns[int(turns.magnitude().argmin())].as_rotvec()
        columns.append(np.concatenate([step * move.mean(axis=0), turned, sizes]) / step)
    jacobian = np.column_stack(columns)
    return jacobian @ spread @ jacobian.T


def _rims_joined(i: int, sides: list[Side], graph: nx.Graph) -> list[Side]:
    """The sides around a face with those in one that follow each other without a neighbour."""
    ends = [not graph.has_edge(i, side.neighbor) for side in sides]
    first = next((k for k, end in enumerate(ends) if not end), 0)
    joined: list[Side] = []
    was_end = False
    for k in [*range(first, len(sides)), *range(first)]:
        side = sides[k]
        if ends[k] and was_end:
            alike = side.neighbor == joined[-1].neighbor
            samples = np.vstack([joined[-1].samples, side.samples])
            joined[-1] = Side(side.neighbor if alike else OPEN, samples)
        else:
            joined.append(side)
        was_end = ends[k]
    return joined


def _loop(
    cycles: list[list[int]], first: tuple[int, int]
) -> tuple[list[tuple[int, int]], list[int]]:
    """Sides (face, place) along the rim of an open surface, and the faces passed on the way.

    The way leads from one side around to itself.
    """
    loop, passed = [first], []
    k, n = first
    while True:
        n = (n + 1) % len(cycles[k])
        if cycles[k][n] >= 0:
            k, n = cycles[k][n], cycles[cycles[k][n]].index(k)
            passed.append(k)
        elif (k, n) == first:
            return loop, passed
        else:
            loop.append((k, n))


def _stitch(
    cycles: list[list[int]],
    sides: list[list[Side]],
    loop: list[tuple[int, int]],
    passed: list[int],
) -> bool:
    """Close a rim too short for a face, in place, where there is one way to; tells whether.

    Two sides are one edge. A side alone is the edge to the one face that its neighbours have
    between them there, which is too small to have seen it; where there is none, its neighbours
    meet, and a corner without points was cut off.
    """
    k, n = loop[0]
    if len(loop) == 2:
        j, m = loop[1]
        if k == j or j in cycles[k]:
            return False
        cycles[k][n], cycles[j][m] = j, k
        return True
    between = [j for j in passed if j != k and j not in cycles[k]]
    if len(between) == 1 and len(passed) == 4:
        (j,) = between
        place = cycles[j].index(cycles[k][(n + 1) % len(cycles[k])]) + 1
        cycles[k][n] = j
        cycles[j].insert(place, k)
        sides[j].insert(place, sides[k][n])
        return True
    if len(passed) == 3 and len(cycles[k]) > 3:
        del cycles[k][n], sides[k][n]
        return True
    return False


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
