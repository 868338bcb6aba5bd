"""Polyhedra of every kind, and their poses, for tests."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import primfit
from primfit import Polyhedron

ELL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
STAIRS = [(0, 0), (3.5, 0), (3.5, 3), (2, 3), (2, 2), (1, 2), (1, 1), (0, 1)]
CUBE = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
CUBE_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]


def turned(solid, seed, place=0.0, scale=1.0):
    """The solid somewhere else, and the turn that took it there."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    vertices = scale * solid.vertices @ turn.T + place * rng.uniform(-1, 1, 3)
    return Polyhedron(vertices, solid.faces), turn


# A roof over a rectangle: a ridge shorter than the eaves.
HIP = Polyhedron(
    [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0), (1, 1, 1), (3, 1, 1)],
    [(0, 3, 2, 1), (0, 1, 5, 4), (2, 3, 4, 5), (1, 2, 5), (3, 0, 4)],
)
TETRAHEDRON = Polyhedron(
    [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]
)
LEANING = np.array([0.5, 0.2, 0.0]) * CUBE[:, 2:] + CUBE
# Solid, name when tilted, order of its symmetry, volume.
SHAPES = {
    "box": (Polyhedron.box(3, 2, 1), "box", 4, 6.0),
    "slab": (Polyhedron.box(2, 2, 1), "box", 8, 4.0),
    "cube": (Polyhedron.box(2, 2, 2), "cube", 24, 8.0),
    "ramp": (Polyhedron.wedge(4, 3, 2), "wedge", 1, 12.0),
    "tent": (Polyhedron.prism([(0, 0), (2, 0), (1, 1)], 3), "wedge", 2, 3.0),
    "toblerone": (Polyhedron.prism(primfit.Prism.regular(3, 1).footprint, 4), "wedge", 6, 3**0.5),
    "pyramid": (Polyhedron.pyramid(4, 3, 2), "pyramid", 4, 6.0),
    "spire": (Polyhedron.pyramid(3, 2, 3), "pyramid", 3, 3**0.5),
    "tetrahedron": (TETRAHEDRON, "pyramid", 12, 8 / 3),
    "frustum": (Polyhedron.frustum(4, 2, 1, 3), "frustum", 4, 7.0),
    "bucket": (Polyhedron.frustum(6, 1, 2, 1), "frustum", 6, 3**0.5 / 2 * 7),
    "ell": (Polyhedron.prism(ELL, 1.5), "prism", 2, 4.5),
    "stairs": (Polyhedron.prism(STAIRS, 2), "prism", 1, 15.0),
    "star": (Polyhedron.prism(primfit.Prism.star(5, 2, 1).footprint, 1), "prism", 10, None),
    "hexagon": (
        Polyhedron.prism(primfit.Prism.regular(6, 2).footprint, 1),
        "prism",
        12,
        6 * 3**0.5,
    ),
    "leaning": (Polyhedron(LEANING, CUBE_FACES), "prism", 1, 1.0),
    "hip": (HIP, "polyhedron", 2, None),
}
