"""Corners of convex solids from the planes of their faces."""

from __future__ import annotations

import numpy as np
import pytest

import primfit
from primfit.polyhedra.convex import convex_corners
from primfit.worlds.random_polyhedra import POLYHEDRA, random_polyhedron


def planes_of(solid, rng):
    """Equations of the faces, on either side of them."""
    firsts = np.stack([solid.vertices[face[0]] for face in solid.faces])
    equations = np.column_stack([solid.normals, -(solid.normals * firsts).sum(axis=1)])
    return equations * rng.choice([-1.0, 1.0], len(equations))[:, None]


@pytest.mark.parametrize("kind", POLYHEDRA)
@pytest.mark.parametrize("seed", range(5))
def test_faces_are_those_of_the_solid(kind, seed):
    rng = np.random.default_rng(seed)
    solid = random_polyhedron(kind, POLYHEDRA[kind], (0, 6.28), rng, tilted=True).moved([5, 6, 7])
    corners = convex_corners(planes_of(solid, rng), solid.vertices, 1e-6)
    assert [len(each) for each in corners] == [len(face) for face in solid.faces]
    again = primfit.Polyhedron(places(solid, corners), corners)
    assert again.volume == pytest.approx(solid.volume)
    assert again.kind == solid.kind


def places(solid, corners):
    """Vertices by their numbers: the one that is in all faces of a corner, and in no other."""
    own, met = (
        [frozenset(k for k, face in enumerate(faces) if v in face) for v in range(n)]
        for faces, n in ((solid.faces, len(solid.vertices)), (corners, 1 + max(map(max, corners))))
    )
    return np.stack([solid.vertices[own.index(each)] for each in met])


def test_short_edges_are_corners():
    rng = np.random.default_rng(1)
    solid = primfit.Polyhedron.pyramid(5, 0.2, 0.3)
    equations = planes_of(solid, rng)
    equations[:, 3] += 1e-3 * rng.normal(size=len(equations))
    assert sum(map(len, convex_corners(equations, solid.vertices, 1e-4))) > 20
    corners = convex_corners(equations, solid.vertices, 0.05)
    assert sorted(map(len, corners)) == [3, 3, 3, 3, 3, 5]


def test_what_is_open_or_no_face():
    rng = np.random.default_rng(1)
    solid = primfit.Polyhedron.box(3, 2, 1)
    equations = planes_of(solid, rng)
    assert convex_corners(equations[:5], solid.vertices, 1e-6) is None
    beyond = np.vstack([equations, [0.0, 0.6, 0.8, -10.0]])
    assert convex_corners(beyond, solid.vertices, 1e-6) is None
    flat = solid.vertices * [1.0, 1.0, 0.0]
    assert convex_corners(equations[:3], flat, 1e-6) is None
