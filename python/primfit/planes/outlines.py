"""Outlines of points in a plane, concave and with holes."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import ConvexHull, Delaunay, QhullError

from primfit._check import Floats, Ints

_MOST = 4_000
"""Points beyond which an outline is drawn from one point a cell."""

_LONGEST = 20
"""One edge in so many is looked at for the widest gap first."""

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
    >>> from primfit.planes.outlines import outline
    >>> x, y = np.mgrid[0:1:21j, 0:1:21j].reshape(2, -1)
    >>> frame = (abs(x - 0.5) > 0.32) | (abs(y - 0.5) > 0.32)
    >>> shape = outline(np.column_stack([x, y])[frame])
    >>> len(shape.interiors), round(shape.area, 2)
    (1, 0.53)
    """
    at = at - at.mean(axis=0)
    try:
        at = thinned(at) if len(at) > _MOST else at
        cells = Delaunay(at)
    except (QhullError, ValueError):
        return shapely.Polygon()
    triangles = cells.simplices
    x, y = (coordinates[triangles.T] for coordinates in at.T)
    edges = x - np.roll(x, 1, axis=0), y - np.roll(y, 1, axis=0)
    sides = np.hypot(*edges)
    twice_area = np.abs(edges[0][0] * edges[1][1] - edges[0][1] * edges[1][0])
    # Each side once: from the triangle with the higher number, or the only one.
    pairs = _sides_of(triangles)[cells.neighbors < np.arange(len(triangles))[:, None]]
    alpha = _BRIDGE * _widest_gap(at, pairs)
    kept = sides.prod(axis=0) <= 2.0 * alpha * twice_area
    kept &= twice_area > 0.0
    # The last number stands for no neighbour.
    is_rim = kept[:, None] & ~np.append(kept, False)[cells.neighbors]
    rim = shapely.linestrings(at[_sides_of(triangles)[is_rim]])
    shape = shapely.build_area(shapely.multilinestrings(rim)).simplify(_SMOOTH * alpha)
    parts = shapely.get_parts(shape)
    return parts[np.argmax(shapely.area(parts))] if len(parts) else shapely.Polygon()


def _sides_of(triangles: Ints) -> Ints:
    """Ends (t, 3, 2) of the side across from each corner."""
    return triangles[:, [[1, 2], [2, 0], [0, 1]]]


def thinned(at: Floats) -> Floats:
    """One point of each cell, and the corners of the hull."""
    low, extent = at.min(axis=0), np.ptp(at, axis=0)
    side = max(np.sqrt(np.prod(extent) / _MOST), extent.max() / _MOST)
    if side == 0.0:
        return at
    row, column = ((at - low) / side).astype(np.int64).T
    # With an empty margin.
    first = np.full((row.max() + 3, column.max() + 3), -1)
    first[row[::-1] + 1, column[::-1] + 1] = np.arange(len(at))[::-1]
    is_full = first >= 0
    # Between full cells on all four diagonals nothing is a corner of the hull.
    is_within = is_full[:-2, :-2] & is_full[:-2, 2:] & is_full[2:, :-2] & is_full[2:, 2:]
    outer = np.flatnonzero(~is_within[row, column])
    return at[np.union1d(first[is_full], outer[ConvexHull(at[outer]).vertices])]


def _widest_gap(at: Floats, pairs: Ints) -> float:
    """Longest edge of the minimum spanning tree of pairs with a group of points on either side."""
    lengths = np.hypot(*(at[pairs[:, 0]] - at[pairs[:, 1]]).T)
    # A length of zero would count as no edge.
    lengths = np.maximum(lengths, 1e-12 * lengths.max())
    n = len(at)
    tree = minimum_spanning_tree(coo_matrix((lengths, pairs.T), shape=(n, n))).tocoo()
    order = np.argsort(tree.data, kind="stable")
    ends, lengths = np.stack([tree.row, tree.col], axis=1)[order], tree.data[order]
    # Most trees have their widest gap among their few longest edges; the others are joined at once.
    for n_joined in (len(order) * (_LONGEST - 1) // _LONGEST, 0):
        gap = _last_gap(ends, lengths, n_joined, n)
        if gap is not None:
            return gap
    return float(np.median(lengths))


def _last_gap(ends: Ints, lengths: Floats, n_joined: int, n: int) -> float | None:
    """Length of the last edge that joins two groups of the n points, after the first `n_joined`."""
    joined = coo_matrix((np.ones(n_joined), ends[:n_joined].T), shape=(n, n))
    n_parts, part = connected_components(joined, directed=False)
    parent, size = list(range(n_parts)), np.bincount(part).tolist()
    last = None
    for (a, b), length in zip(part[ends[n_joined:]].tolist(), lengths[n_joined:], strict=True):
        a, b = _root(parent, a), _root(parent, b)
        if min(size[a], size[b]) >= _FEW:
            last = float(length)
        parent[b] = a
        size[a] += size[b]
    return last


def _root(parent: list[int], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
