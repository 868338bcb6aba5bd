"""Upright prisms as polyhedra: a footprint drawn upwards."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.footprints import triangulate


def prism_vertices(footprint: Floats, bottom: float, top: float) -> Floats:
    """Vertices (2m, 3) of an upright prism: the bottom, then the top."""
    return np.concatenate(
        [np.column_stack([footprint, np.full(len(footprint), z)]) for z in (bottom, top)]
    )


def prism_faces(m: int) -> tuple[Ints, ...]:
    """Faces of an upright prism over m corners: walls, bottom, top."""
    i = np.arange(m)
    j = (i + 1) % m
    walls = np.stack([i, j, j + m, i + m], axis=1)
    return (*walls, i[::-1].copy(), i + m)


def prism_triangles(footprint: Floats) -> Ints:
    """Triangles (t, 3) of an upright prism; concave footprints are cut without new corners."""
    m = len(footprint)
    i = np.arange(m)
    j = (i + 1) % m
    walls = np.concatenate([np.stack([i, j, j + m], axis=1), np.stack([i, j + m, i + m], axis=1)])
    top = triangulate(footprint)
    return np.concatenate([walls, top[:, ::-1], top + m]).astype(np.int64)
