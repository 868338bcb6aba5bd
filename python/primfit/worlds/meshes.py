"""Solids of what has the surface of one: what was found, and meshes of any library."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from primfit._check import Floats, as_rows
from primfit.solids.polyhedron import Polyhedron
from primfit.solids.prism import Prism
from primfit.solids.solid import Solid


def as_solid(thing: Any) -> Solid | None:
    """The solid of something found, or of one closed mesh; None when it has no surface."""
    if isinstance(thing, Solid):
        return thing
    if getattr(thing, "footprint", None) is not None and hasattr(thing, "top"):
        return Prism(thing.footprint, thing.top - thing.base, base=thing.base)
    if hasattr(thing, "vertices") and hasattr(thing, "faces"):
        faces = tuple(np.asarray(face) for face in thing.faces)
        return Polyhedron(*each_once(np.asarray(thing.vertices, np.float64), faces))
    return None


def solids_of_mesh(mesh: Any) -> list[Polyhedron]:
    """A solid for each connected part of a mesh, in order of their first vertices.

    Raises
    ------
    TypeError
        When it is no mesh.
    ValueError
        When a part is not closed, or encloses nothing.
    """
    vertices = getattr(mesh, "vertices", None)
    triangles = getattr(mesh, "faces", getattr(mesh, "triangles", None))
    if isinstance(mesh, tuple) and len(mesh) >= 2:
        vertices, triangles = mesh[:2]
    if vertices is None or triangles is None:
        raise TypeError(
            "mesh must be (vertices, triangles), or have vertices and faces, as that of trimesh or "
            f"Open3D, not {type(mesh).__name__}"
        )
    corners = as_rows("vertices", vertices, 3)
    rows = np.asarray(triangles)
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.dtype.kind not in "iu":
        raise ValueError(f"triangles must be integers (t, 3), not {rows.dtype} {rows.shape}")
    if rows.size and not (rows.min() >= 0 and rows.max() < len(corners)):
        raise ValueError(f"triangles must be rows of {len(corners)} vertices")
    corners, faces = each_once(corners, tuple(rows))
    if not faces:
        return []
    rows = np.array(faces)
    ends = rows[:, [0, 1, 2]].ravel(), rows[:, [1, 2, 0]].ravel()
    links = coo_matrix((np.ones(len(ends[0]), np.int8), ends), shape=(len(corners),) * 2)
    part_of = connected_components(links, directed=False)[1][rows[:, 0]]
    solids = []
    for part in dict.fromkeys(part_of.tolist()):
        own = rows[part_of == part]
        used, again = np.unique(own, return_inverse=True)
        try:
            solids.append(Polyhedron(corners[used], tuple(again.reshape(own.shape))))
        except ValueError as error:
            raise ValueError(f"mesh has a part of {len(own)} triangles: {error}") from None
    return solids


def each_once(vertices: Floats, faces: tuple[Any, ...]) -> tuple[Floats, tuple[Any, ...]]:
    """Vertices of one place are one vertex, which files and viewers often split."""
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)[same.ravel()]
    return vertices[first[order]], tuple(rank[face] for face in faces)
