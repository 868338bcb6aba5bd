"""The corners of a convex solid, from the planes of its faces."""

from __future__ import annotations

from itertools import combinations

import networkx as nx
import numpy as np
from scipy.spatial import HalfspaceIntersection, QhullError

from primfit._check import Floats, Ints
from primfit.geometry.products import dots, lengths_of, product
from primfit.planes.plane import axes_of

_FAR = 10.0
"""Distance of the walls around a solid that is not closed, in its extent."""


def convex_corners(equations: Floats, points: Floats, shortest: float) -> list[Ints] | None:
    """Corners around each face, numbered, of the solid that planes (n, 4) enclose.

    Edges shorter than `shortest`, metres, are taken for one corner, in which more than three faces
    meet. None when the planes leave it open, or one of them is no face of it.

    Parameters
    ----------
    equations : (n, 4) float64
        Planes with their normals on either side.
    points : (m, 3) float64, metres
        Some of its surface: their mean is inside.
    shortest : float, metres
    """
    inside = points.mean(axis=0)
    outward = equations * -np.sign(dots(equations[:, :3], inside) + equations[:, 3])[:, None]
    normals = np.vstack([outward[:, :3], np.eye(3), -np.eye(3)])
    far = _FAR * float(np.ptp(points, axis=0).max())
    offsets = np.append(dots(outward[:, :3], inside) + outward[:, 3], np.full(6, -far))
    try:
        cut = HalfspaceIntersection(np.column_stack([normals, offsets]), np.zeros(3))
    except QhullError:
        return None
    n = len(equations)
    met = [set(each) for each in cut.dual_facets]
    if any(max(each) >= n for each in met):
        return None
    near = nx.Graph()
    near.add_nodes_from(range(len(met)))
    near.add_edges_from(
        (a, b)
        for a, b in combinations(range(len(met)), 2)
        if len(met[a] & met[b]) >= 2
        and lengths_of(cut.intersections[a] - cut.intersections[b]) < shortest
    )
    corners = [sorted(each) for each in nx.connected_components(near)]
    places = np.stack([cut.intersections[each].mean(axis=0) for each in corners])
    met = [set().union(*(met[a] for a in each)) for each in corners]
    faces = []
    for face, normal in enumerate(outward[:, :3]):
        own = np.array([v for v, each in enumerate(met) if face in each], dtype=np.int64)
        if len(own) < 3:
            return None
        arms = places[own] - places[own].mean(axis=0)
        x, y = product(axes_of(normal), arms.T)
        faces.append(own[np.argsort(np.arctan2(y, x))])
    return faces
