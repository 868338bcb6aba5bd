"""Outlines of points in a plane, concave and with holes."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import ConvexHull, Delaunay, QhullError

from primfit._check import Floats, Ints

_MOST = 10_000
"""Points beyond which an outline is drawn from one point a cell."""

_FEW = 10
"""Points that a group must have for the gap to it to count as a gap within the outline."""

_BRIDGE = 2.0
"""Radius alpha over the widest gap: with less, chance gaps notch the outline of random points."""

_SMOOTH = 0.1
"""Deviation of the outline that is not drawn, as a share of alpha."""


def outline(at: Floats) -> shapely.Polygon:
    """The alpha shape of points (n, 2) that holds together; empty without area.

    The radius alpha follows from the widest gap across which it must hold together, so no scale is
    needed
    (Edelsbrunner, Kirkpatrick, Seidel: On the shape of a set of points in the plane, 1983).

    Examples
    --------
    >>> import numpy as np
    >>> from primfit.outlines import outline
    >>> x, y = np.mgrid[0:1:21j, 0:1:21j].reshape(2, -1)
    >>> frame = (abs(x - 0.5) > 0.32) | (abs(y - 0.5) > 0.32)
    >>> shape = outline(np.column_stack([x, y])[frame])
    >>> len(shape.interiors), round(shape.area, 2)
    (1, 0.53)
    """
    at = at - at.mean(axis=0)
    at = _thinned(at) if len(at) > _MOST else at
    try:
        triangles = Delaunay(at).simplices
    except (QhullError, ValueError):
        return shapely.Polygon()
    corners = at[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    edges = corners[:, 1:] - corners[:, :1]
    twice_area = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    alpha = _BRIDGE * _widest_gap(at, triangles)
    kept = sides.prod(axis=1) <= 2.0 * alpha * twice_area
    kept &= twice_area > 0.0
    if not kept.any():
        return shapely.Polygon()
    shape = shapely.coverage_union_all(shapely.polygons(corners[kept])).simplify(_SMOOTH * alpha)
    parts = shapely.get_parts(shape)
    return parts[np.argmax(shapely.area(parts))]


def _thinned(at: Floats) -> Floats:
    """One point of each cell, and the corners of the hull."""
    side = np.sqrt(np.prod(np.ptp(at, axis=0)) / _MOST)
    if side == 0.0:
        return at
    cells = np.floor(at / side).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return at[np.union1d(first, ConvexHull(at).vertices)]


def _widest_gap(at: Floats, triangles: Ints) -> float:
    """Longest edge of the minimum spanning tree with a group of points on either side."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    lengths = np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1)
    # A length of zero would count as no edge.
    lengths = np.maximum(lengths, 1e-12 * lengths.max())
    tree = minimum_spanning_tree(coo_matrix((lengths, pairs.T), shape=(len(at), len(at)))).tocoo()
    parent, size = list(range(len(at))), [1] * len(at)
    widest = float(np.median(tree.data))
    for k in np.argsort(tree.data, kind="stable"):
        a, b = _root(parent, int(tree.row[k])), _root(parent, int(tree.col[k]))
        if min(size[a], size[b]) >= _FEW:
            widest = float(tree.data[k])
        parent[b] = a
        size[a] += size[b]
    return widest


def _root(parent: list[int], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
