"""Random polyhedra on the floor."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from primfit._check import Floats
from primfit.geometry.footprints import regular_footprint
from primfit.solids.polyhedron import Polyhedron

POLYHEDRA: dict[str, tuple[float, float]] = {
    "box": (0.10, 0.28),
    "cube": (0.12, 0.22),
    "wedge": (0.12, 0.28),
    "pyramid": (0.16, 0.28),
    "frustum": (0.16, 0.28),
    "prism": (0.16, 0.28),
}
"""Kinds, and ranges of their sizes, metres: sides of boxes, cubes and wedges; diameters around the
bases of the others, and heights."""


def random_polyhedron(
    kind: str,
    limits: tuple[float, float],
    angles: tuple[float, float],
    rng: np.random.Generator,
    *,
    tilted: bool,
) -> Polyhedron:
    """A random convex polyhedron that stands on the floor near the origin.

    Its sizes (see `POLYHEDRA`) are within `limits`, metres. Bases are regular: of 3 to 6 sides, of
    prisms 5 to 8. The top of a frustum is 0.4 to 0.8 of its base.

    Tilted, every orientation is alike likely and the lowest vertex is on the floor. Else it rests
    on a face, any of those alike likely that have the centroid above them, and is turned about the
    vertical by a random one of the `angles`, radians.
    """
    solid = _random_shape(kind, limits, rng)
    if tilted:
        turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    else:
        resting = [face for face in range(len(solid.faces)) if _holds(solid, face)]
        down = resting[rng.integers(len(resting))]
        turn = Rotation.from_euler("z", rng.uniform(*angles)).as_matrix() @ _laid(solid, down)
    vertices = (solid.vertices - solid.center) @ turn.T
    return Polyhedron(vertices - [0.0, 0.0, vertices[:, 2].min()], solid.faces)


def _random_shape(kind: str, limits: tuple[float, float], rng: np.random.Generator) -> Polyhedron:
    if kind == "cube":
        side = rng.uniform(*limits)
        return Polyhedron.box(side, side, side)
    if kind in ("box", "wedge"):
        make = Polyhedron.box if kind == "box" else Polyhedron.wedge
        return make(*rng.uniform(*limits, 3))
    diameter, height = rng.uniform(*limits, 2)
    n = int(rng.integers(5, 9)) if kind == "prism" else int(rng.integers(3, 7))
    side = diameter * np.sin(np.pi / n)
    if kind == "pyramid":
        return Polyhedron.pyramid(n, side, height)
    if kind == "frustum":
        return Polyhedron.frustum(n, side, side * rng.uniform(0.4, 0.8), height)
    return Polyhedron.prism(regular_footprint(n, side, np.zeros(2), 0.0), height)


def _holds(solid: Polyhedron, face: int) -> bool:
    """Whether the centroid of a convex solid is above one of its faces."""
    corners = solid.vertices[solid.faces[face]]
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.cross(solid.normals[face], along)
    return bool((((solid.centroid - corners) * inward).sum(axis=1) > 0.0).all())


def _laid(solid: Polyhedron, face: int) -> Floats:
    """A turn (3, 3) that lays a face down."""
    corners = solid.vertices[solid.faces[face]]
    z = -solid.normals[face]
    x = corners[1] - corners[0]
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
