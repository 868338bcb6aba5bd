"""Planes that meet to the closed solid around which they lie."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import networkx as nx
import numpy as np
import shapely

from primfit._check import Floats, Ints
from primfit.geometry.products import dots, product
from primfit.polyhedra.adjacency import OPEN, Face, clear_of
from primfit.polyhedra.convex import convex_corners
from primfit.polyhedra.joint_fit import fitted_together, scatter_of
from primfit.polyhedra.naming import found_solid
from primfit.polyhedra.open_surface import OpenSurface, Rim
from primfit.polyhedra.unseen import Unseen, unseen_faces
from primfit.solids.found import FoundSolid
from primfit.solids.polyhedron import Polyhedron

_SHORTEST = 0.5
"""Length of an edge that counts as one, over how far from an edge an outline may end."""

_OFF = 3.0
"""Distance of a vertex to the outlines of its faces, over the same, at the most."""

_ENDS = 0.45
"""Share of the rim that must end in a known plane; others may be hidden behind something."""

_MOST_ALONG = 32
"""Faces along a rim of more than which nothing is inferred from it."""

_LARGER = 2.0
"""Extent of a solid over that of the faces seen of it, at the most."""


@dataclass(frozen=True, eq=False)
class _Bound:
    """A plane on which a face of a solid lies: its number or `OPEN`, and what tells it."""

    equation: Floats
    scatter: Floats
    plane: int


def closed_solid(
    group: list[int], faces: list[Face], graph: nx.Graph, facing: bool
) -> FoundSolid | None:
    """The closed solid that a group of planes makes, if it makes one.

    Where normals are `facing` the sensor, the solid must lie behind them.
    """
    for bounds, corners in _ways_to_close(group, faces, graph, facing):
        solid = None if corners is None else _solid(bounds, corners, group, faces, facing)
        if solid is not None:
            return solid
    return None


def _ways_to_close(
    group: list[int], faces: list[Face], graph: nx.Graph, facing: bool
) -> Iterator[tuple[list[_Bound], list[Ints] | None]]:
    """Planes of faces with the corners around each, if any: what is known before what is inferred.

    A convex solid is where all its planes say it is; of others, and where faces were not seen, what
    the outlines meet tells.
    """
    seen = [_Bound(faces[i].equation, _seen_scatter(i, faces, graph), i) for i in group]
    points = np.vstack([faces[i].boundary for i in group])
    shortest = _SHORTEST * max(faces[i].reach for i in group)
    is_convex = _is_convex(group, faces, points)

    def convex(bounds: list[_Bound]) -> tuple[list[_Bound], list[Ints] | None]:
        equations = np.stack([bound.equation for bound in bounds])
        return bounds, convex_corners(equations, points, shortest)

    if is_convex:
        yield convex(seen)
        for j in _planes_beyond(group, faces, graph):
            yield convex([*seen, _known(j, group, faces)])
    surface = OpenSurface.of(group, faces, graph)
    if surface is None:
        return
    bounds = seen + _close(surface, faces, 3 if facing else 2)
    if is_convex:
        yield convex(bounds)
    elif surface.is_closed:
        yield bounds, surface.corners()


def _seen_scatter(i: int, faces: list[Face], graph: nx.Graph) -> Floats:
    others = [faces[j] for j in graph[i]]
    equations = np.reshape([other.equation for other in others], (-1, 4))
    points = clear_of(faces[i].points, equations, np.array([other.rms for other in others]))
    return scatter_of(points, max(faces[i].rms, 1e-9))


def _is_convex(group: list[int], faces: list[Face], points: Floats) -> bool:
    """Whether all outlines lie on one side of each face."""
    for face in (faces[i] for i in group):
        off = dots(points, face.equation[:3]) + face.equation[3]
        if off.max() > face.reach and off.min() < -face.reach:
            return False
    return True


def _known(plane: int, group: list[int], faces: list[Face]) -> _Bound:
    slack = max(faces[i].reach for i in group)
    return _Bound(faces[plane].equation, scatter_of(faces[plane].points, slack), plane)


def _planes_beyond(group: list[int], faces: list[Face], graph: nx.Graph) -> list[int]:
    """Planes beyond the rims of a group in which much of them ends, as in a floor."""
    ends = [side for i in group for side in faces[i].sides if not graph.has_edge(i, side.neighbor)]
    unit = max(faces[i].reach for i in group) / 3.0
    planes = []
    for plane in sorted({side.neighbor for side in ends} - {OPEN, *group}):
        equation = faces[plane].equation
        off = np.concatenate([dots(side.samples, equation[:3]) + equation[3] for side in ends])
        if np.mean(np.abs(off) <= unit) >= _ENDS:
            planes.append(plane)
    return planes


def _close(surface: OpenSurface, faces: list[Face], most: int) -> list[_Bound]:
    """Close the rims of a surface, in place, as far as can be; the planes of the faces for it."""
    bounds = []
    while (rim := surface.next_rim()) is not None:
        if surface.stitch(rim):
            continue
        unseen = _beyond(rim, surface.group, faces, most)
        if unseen and surface.close(rim, [each.samples for each in unseen]):
            for each in unseen:
                if each.plane == OPEN:
                    unit = max(faces[surface.group[k]].reach for k, _ in rim.places) / 3.0
                    # Where the outline of a face ends too early it does so all along.
                    share = len(np.unique(rim.owner[each.samples])) / len(each.samples)
                    scatter = share * scatter_of(rim.samples[each.samples], unit)
                    bounds.append(_Bound(each.equation, scatter, OPEN))
                else:
                    bounds.append(_known(each.plane, surface.group, faces))
        elif not surface.cut_off(rim, faces):
            break
    return bounds


def _beyond(rim: Rim, group: list[int], faces: list[Face], most: int) -> list[Unseen]:
    """The unseen faces beyond a rim; none when it does not tell, or goes along a face twice."""
    along = [group[k] for k, _ in rim.places]
    if not 2 <= len(along) <= _MOST_ALONG or len(set(along)) < len(along):
        return []
    known = {side.neighbor for i in along for side in faces[i].sides} - {OPEN, *group}
    return unseen_faces(
        rim.samples,
        rim.owner,
        np.stack([faces[i].equation for i in along]),
        {plane: faces[plane].equation for plane in sorted(known)},
        max(faces[i].reach for i in along) / 3.0,
        most,
    )


def _solid(
    bounds: list[_Bound], corners: list[Ints], group: list[int], faces: list[Face], facing: bool
) -> FoundSolid | None:
    """The solid with these faces, the first of which were seen; None when it is not there."""
    equations = np.stack([bound.equation for bound in bounds])
    scatters = np.stack([bound.scatter for bound in bounds])
    vertices, spread = fitted_together(equations, scatters, corners)
    for i, corner in zip(group, corners, strict=False):
        flat = shapely.points(product(vertices[corner], faces[i].axes))
        if (shapely.distance(faces[i].polygon, flat) > _OFF * faces[i].reach).any():
            return None
    extent = float(np.ptp(vertices, axis=0).max())
    if extent > _LARGER * np.ptp(np.vstack([faces[i].boundary for i in group]), axis=0).max():
        return None
    try:
        solid = Polyhedron(vertices, tuple(corners))
    except ValueError:
        return None
    if len(solid.faces) < len(corners) or len(solid.vertices) < len(vertices):
        return None
    if facing and np.sum(solid.normals[: len(group)] * equations[: len(group), :3]) < 0.0:
        return None
    observed = [k < len(group) for k in range(len(bounds))]
    return found_solid(solid, spread, [bound.plane for bound in bounds], observed)
