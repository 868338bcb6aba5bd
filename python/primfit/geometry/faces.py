"""Flat faces in space, and what they enclose: triangles, volume, inside."""

from __future__ import annotations

import numpy as np
import shapely

from primfit._check import Floats, Ints
from primfit.geometry.footprints import triangulate
from primfit.geometry.products import dots, lengths_of, product
from primfit.geometry.shells import FLAT, Faces, area_vectors


def check_flat(vertices: Floats, faces: Faces) -> None:
    """Refuse faces that have no area, are not flat, or cross themselves."""
    size = np.ptp(vertices, axis=0).max()
    rounding = 8.0 * np.finfo(float).eps * np.abs(vertices).max()
    for i, (face, across) in enumerate(zip(faces, area_vectors(vertices, faces), strict=True)):
        area = lengths_of(across)
        if area <= 1e-12 * size**2:
            raise ValueError(f"faces[{i}] must have an area, but its vertices lie on a line")
        off = np.abs(dots(vertices[face] - vertices[face].mean(axis=0), across / area)).max()
        if off > FLAT * size + rounding:
            raise ValueError(f"faces[{i}] must be flat, but a vertex is {off:g} m off")
        if len(face) > 3 and not shapely.Polygon(_outline(vertices[face], across)).is_valid:
            raise ValueError(f"faces[{i}] must not cross itself: {face.tolist()}")


def _outline(corners: Floats, across: Floats) -> Floats:
    """Corners (m, 2) in their own plane, counter-clockwise as seen against the vector across it."""
    z = across / lengths_of(across)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= lengths_of(x)
    return product(corners - corners[0], np.stack([x, np.cross(z, x)], axis=1))


def triangles_of(vertices: Floats, faces: Faces) -> Ints:
    """Triangles (t, 3) of the faces, without new corners; concave ones are cut rightly."""
    vectors = area_vectors(vertices, faces)
    return np.concatenate(
        [
            face[triangulate(_outline(vertices[face], across))] if len(face) > 3 else face[None]
            for face, across in zip(faces, vectors, strict=True)
        ]
    )


def moments(vertices: Floats, faces: Faces) -> tuple[float, Floats]:
    """Volume, positive when the faces look outwards, and centroid (3,)."""
    fans = [np.column_stack([np.full(len(f) - 2, f[0]), f[1:-1], f[2:]]) for f in faces]
    a, b, c = np.moveaxis(vertices[np.concatenate(fans)], 1, 0)
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    volume = float(parts.sum())
    return volume, product(parts[None], a + b + c)[0] / (4.0 * volume or 1.0)


def winding_number(points: Floats, vertices: Floats, triangles: Ints) -> Floats:
    """How often the surface goes around each point (Van Oosterom and Strackee, 1983)."""
    arms = vertices[triangles] - points[:, None, None]
    a, b, c = np.moveaxis(arms, 2, 0)
    la, lb, lc = (np.linalg.norm(each, axis=-1) for each in (a, b, c))
    volume = np.einsum("...i,...i", a, np.cross(b, c))
    rest = la * lb * lc
    for first, second, length in ((a, b, lc), (b, c, la), (c, a, lb)):
        rest += np.einsum("...i,...i", first, second) * length
    return np.arctan2(volume, rest).sum(axis=1) / (2.0 * np.pi)
