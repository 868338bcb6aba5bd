"""Bounded planes to polyhedra."""

from __future__ import annotations

from collections.abc import Iterable

import networkx as nx
import numpy as np

from primfit._check import check_within, instance
from primfit.clouds.foreign import PointsLike, points_of
from primfit.planes.plane import Plane, planes_of
from primfit.polyhedra.adjacency import OPEN, Face, meet
from primfit.polyhedra.boxes import boxes_among
from primfit.polyhedra.closing import closed_solid
from primfit.polyhedra.found import Polyhedra


def find_polyhedra(
    planes: Iterable[Plane], points: PointsLike, *, facing: bool = False
) -> Polyhedra:
    """Solids that bounded planes enclose, of any shape and in any position.

    Along the outline of each plane the neighbours are read off that meet it there. Planes that name
    each other share an edge; edges that follow each other around two faces meet in a corner. Where
    all sides of a group have a neighbour, or end in up to three planes that were not seen from
    there, the group is a solid: its planes are fitted again, all at once, so that they meet in its
    corners.

    Such a plane is the floor or wall where one was found there. Else it is the one in which sides
    of several faces end, which is known only to the spacing of the points. Edges shorter than about
    five spacings and five standard deviations of the noise are not seen.

    Of planes that do not close, three that meet at nearly right angles, fill what they would be of
    a box, and end in a plane that goes on beyond it, are taken for that box; where planes are
    `facing`, two of them with such a plane, or three without. What a depth camera bends counts as
    straight, and the covariance tells how far it is off.

    Parameters
    ----------
    planes : iterable of Plane
        Their outlines, concave for concave faces, must follow the true ones to about three
        spacings of the points.
    points : (n, 3) float64, metres, or whatever `as_cloud` takes
        The cloud of whose rows `inliers` are.
    facing : bool
        Whether the normals of the planes point to where they were seen from. Then what is seen from
        inside, as the walls of a room are, is no solid. Else three faces that meet may be a corner
        of a room, and are not taken for half of a solid.

    Returns
    -------
    Polyhedra

    Raises
    ------
    TypeError, ValueError
        When `planes` are none, or not of `points`.

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
    cloud = points_of("points", points, finite=False)
    check_within("points", cloud)
    chosen = planes_of(planes, len(cloud))
    instance("facing", facing, bool)
    finite = np.isfinite(cloud).all(axis=1)
    place = np.median(cloud[finite], axis=0) if finite.any() else np.zeros(3)
    local = cloud - place
    faces = [Face.of(plane.moved(-place), local) for plane in chosen]
    is_loose = np.array(finite)
    for plane in chosen:
        is_loose[plane.inliers] = False
    loose = local[is_loose]
    edges = meet(faces)
    graph = nx.Graph(edges)
    solids, shells = [], []
    for group in sorted(sorted(each) for each in nx.connected_components(graph)):
        solid = closed_solid(group, faces, graph, facing)
        found = [] if solid is None else [solid]
        if solid is None or OPEN in solid.planes:
            boxes = boxes_among(group, faces, graph, facing, loose)
            # Where faces are inferred, a box that explains all others is likelier.
            if solid is None or any(set(group) <= set(box.planes) for box in boxes):
                found = boxes
        solids += [each.moved(place) for each in found]
        rest = graph.subgraph(set(group).difference(*(each.planes for each in found)))
        shells += [tuple(sorted(each)) for each in nx.connected_components(rest) if len(each) > 1]
    return Polyhedra(tuple(solids), tuple(shells), np.array(edges, dtype=int).reshape(-1, 2))
