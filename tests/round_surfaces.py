"""Points of curved surfaces whose parameters are known, with noise of either kind."""

from __future__ import annotations

import numpy as np

PARAMETERS = {
    "sphere": ["radius"],
    "cylinder": ["radius"],
    "cone": ["angle"],
    "torus": ["major_radius", "radius"],
}


def rotation(rng):
    """A random rotation (3, 3)."""
    matrix, signs = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix *= np.sign(np.diag(signs))
    return matrix * np.linalg.det(matrix)


def local_points(kind, rng, n, arc=2.0):
    """Points and outward normals of a surface about z, and the truth of it."""
    around = rng.uniform(0.0, arc, n)
    out = np.column_stack([np.cos(around), np.sin(around), np.zeros(n)])
    up = np.array([0.0, 0.0, 1.0])
    if kind == "sphere":
        height = rng.uniform(-0.2, 1.0, n)
        normals = np.sqrt(1.0 - height**2)[:, None] * out + height[:, None] * up
        return 0.5 * normals, normals, {"radius": 0.5}
    if kind == "cylinder":
        height = rng.uniform(-0.5, 0.5, n)
        return 0.3 * out + height[:, None] * up, out, {"radius": 0.3}
    if kind == "cone":
        angle = 0.4
        # Even by area.
        slant = np.sqrt(rng.uniform(0.4**2, 1.2**2, n))
        points = slant[:, None] * (np.sin(angle) * out + np.cos(angle) * up)
        return points, np.cos(angle) * out - np.sin(angle) * up, {"angle": angle}
    tube = rng.uniform(-2.0, 2.0, n)
    normals = np.cos(tube)[:, None] * out + np.sin(tube)[:, None] * up
    return 0.6 * out + 0.2 * normals, normals, {"major_radius": 0.6, "radius": 0.2}


def placed(kind, rng, n, arc=2.0):
    """The same at a random place in a random turn: points, normals, truth with place and axis."""
    points, normals, truth = local_points(kind, rng, n, arc)
    turn, shift = rotation(rng), rng.uniform(-2.0, 2.0, 3)
    truth |= {"place": shift, "axis": turn[:, 2]}
    return points @ turn.T + shift, normals @ turn.T, truth


def seen(kind, rng, n, sigma, arc=3.0):
    """Points with range noise as a sensor outside sees them, its place, and the truth."""
    points, normals, truth = placed(kind, rng, n, arc)
    middle = points.mean(axis=0)
    away = normals.mean(axis=0)
    origin = middle + 3.0 * away / np.linalg.norm(away)
    beams = points - origin
    ranges = np.linalg.norm(beams, axis=1)
    beams /= ranges[:, None]
    facing = np.einsum("ni,ni->n", beams, normals) < 0.0
    noisy = origin + (ranges + rng.normal(0.0, sigma, n))[:, None] * beams
    return noisy[facing], origin, truth
