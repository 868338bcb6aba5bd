"""Solids with known truth: polyhedra in any position, convex or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from primfit._check import (
    MOST_CORNERS,
    Bools,
    Floats,
    Ints,
    as_rows,
    as_vector,
    integer,
    number,
)
from primfit.clouds.foreign import PointsLike, points_of
from primfit.geometry import shells
from primfit.geometry.extrusions import prism_faces
from primfit.geometry.faces import check_flat, moments, triangles_of, winding_number
from primfit.geometry.footprints import clean_footprint, regular_footprint
from primfit.geometry.motions import Motion
from primfit.geometry.products import product
from primfit.geometry.shapes import Shape, shape_of
from primfit.geometry.shells import FLAT
from primfit.solids.solid import Solid

_PAIRS_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Polyhedron(Solid):
    """A solid with flat faces, in any position.

    Faces are turned outwards, flat neighbours become one face, and vertices in the middle of edges
    go. That the surface does not cross itself is left to the caller.

    Parameters
    ----------
    vertices : (v, 3) float64, metres
    faces : sequence of sequences of int
        Rows of `vertices` around each face, in either direction. A face has one outline: one with
        a hole must be given in parts.

    Raises
    ------
    ValueError
        When the faces do not close, meet more than two at an edge or only at a vertex, are several
        surfaces, are not flat, cross themselves or have no area, or enclose no volume.

    Examples
    --------
    >>> import primfit
    >>> ramp = primfit.Polyhedron.wedge(0.4, 0.2, 0.1)
    >>> ramp.kind, ramp.vertices.shape, round(ramp.volume, 6)
    ('wedge', (6, 3), 0.004)
    >>> primfit.Polyhedron.box(0.3, 0.2, 0.1, quat_xyzw=(0.5, 0, 0, 1)).kind
    'box'
    """

    type_name = "polyhedron"

    vertices: Floats
    faces: tuple[Ints, ...]

    def __post_init__(self) -> None:
        vertices = as_rows("vertices", self.vertices, 3)
        faces = shells.oriented(shells.as_faces(self.faces, len(vertices)))
        check_flat(vertices, faces)
        volume = moments(vertices - vertices.mean(axis=0), faces)[0]
        if abs(volume) <= 1e-12 * np.ptp(vertices, axis=0).max() ** 3:
            raise ValueError("faces must enclose a volume, but it is zero")
        if volume < 0.0:
            faces = tuple(face[::-1].copy() for face in faces)
        vertices, faces = shells.merged(vertices, faces)
        object.__setattr__(self, "vertices", np.array(vertices))
        object.__setattr__(self, "faces", tuple(faces))

    @classmethod
    def box(
        cls,
        length: float,
        width: float,
        height: float,
        *,
        center: ArrayLike | None = None,
        quat_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> Polyhedron:
        """A cuboid, before it is turned `length` along x, `width` along y, `height` along z.

        Here and below, `quat_xyzw` turns the solid (x, y, z, w, of any length), and `center` (3,)
        is where the mean of its vertices comes to lie; None stands it on the floor at the origin.
        """
        length, width, height = _positive(length=length, width=width, height=height)
        base = _rectangle(length, width)
        return cls._drawn(base, base, height, center, quat_xyzw)

    @classmethod
    def wedge(
        cls,
        length: float,
        width: float,
        height: float,
        *,
        center: ArrayLike | None = None,
        quat_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> Polyhedron:
        """A ramp: a box of `length`, `width` and `height` cut so that it rises along x."""
        length, width, height = _positive(length=length, width=width, height=height)
        low = np.column_stack([_rectangle(length, width), np.zeros(4)])
        vertices = np.concatenate([low, low[1:3] + np.array([0.0, 0.0, height])])
        faces = [(0, 3, 2, 1), (1, 2, 5, 4), (0, 4, 5, 3), (0, 1, 4), (2, 3, 5)]
        return cls._placed(vertices, faces, center, quat_xyzw)

    @classmethod
    def pyramid(
        cls,
        n: int,
        side: float,
        height: float,
        *,
        center: ArrayLike | None = None,
        quat_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> Polyhedron:
        """A right pyramid over a regular polygon of `n` sides of length `side`."""
        n = integer("n", n, low=3, high=MOST_CORNERS)
        side, height = _positive(side=side, height=height)
        base = regular_footprint(n, side, np.zeros(2), 0.0)
        vertices = np.vstack([np.column_stack([base, np.zeros(n)]), [0.0, 0.0, height]])
        i = np.arange(n)
        faces = [i[::-1], *np.stack([i, np.roll(i, -1), np.full(n, n)], axis=1)]
        return cls._placed(vertices, faces, center, quat_xyzw)

    @classmethod
    def frustum(
        cls,
        n: int,
        side: float,
        top_side: float,
        height: float,
        *,
        center: ArrayLike | None = None,
        quat_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> Polyhedron:
        """A right pyramid cut off parallel to its base, where a side is `top_side` long."""
        n = integer("n", n, low=3, high=MOST_CORNERS)
        side, top_side, height = _positive(side=side, top_side=top_side, height=height)
        base, top = (regular_footprint(n, each, np.zeros(2), 0.0) for each in (side, top_side))
        return cls._drawn(base, top, height, center, quat_xyzw)

    @classmethod
    def prism(
        cls,
        footprint: ArrayLike,
        height: float,
        *,
        center: ArrayLike | None = None,
        quat_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> Polyhedron:
        """A right prism over a simple polygon (m, 2), convex or not, to be turned anyhow."""
        base = clean_footprint(footprint)
        (height,) = _positive(height=height)
        return cls._drawn(base, base, height, center, quat_xyzw)

    @classmethod
    def _drawn(
        cls, base: Floats, top: Floats, height: float, center: ArrayLike | None, quat: ArrayLike
    ) -> Polyhedron:
        rings = ((base, 0.0), (top, height))
        vertices = np.concatenate([np.column_stack([r, np.full(len(r), z)]) for r, z in rings])
        return cls._placed(vertices, prism_faces(len(base)), center, quat)

    @classmethod
    def _placed(
        cls, vertices: Floats, faces: Sequence[Any], center: ArrayLike | None, quat: ArrayLike
    ) -> Polyhedron:
        quaternion = as_vector("quat_xyzw", quat, 4)
        if not quaternion.any():
            raise ValueError("quat_xyzw must not be zero")
        turned = product(
            vertices - vertices.mean(axis=0), Rotation.from_quat(quaternion).as_matrix().T
        )
        if center is None:
            return cls(turned - [0.0, 0.0, turned[:, 2].min()], tuple(faces))
        return cls(turned + as_vector("center", center, 3), tuple(faces))

    @cached_property
    def shape(self) -> Shape:
        """What it is, as one value."""
        return shape_of(self.vertices, self.faces)

    @property
    def kind(self) -> str:
        """Class name.

        Of an upright prism that of its footprint: "triangle", "square", "rectangle", ..., "star",
        "polygon". Else "box" and "cube" (right angles), "wedge" (a right prism over a triangle),
        "pyramid" (any base, upright or leaning), "frustum" (a pyramid cut off parallel to its
        base), "prism" (any other, right or leaning), or "polyhedron".
        """
        return self.shape.kind

    @property
    def size(self) -> float | tuple[float, ...]:
        """Side of a cube, metres; (3,) descending of the others: extents along the own axes.

        Of an upright prism the size of its footprint (see `Prism.size`).
        """
        return self.shape.size

    @property
    def solid_kind(self) -> str:
        """Class name, the same at any tilt.

        "box", "cube", "wedge", "pyramid", "frustum", "prism" or "polyhedron", as `kind`; a right
        prism over what stands for a circle is a "cylinder".
        """
        return self.shape.solid_kind

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Length, width and height along its own axes, metres, the same at any tilt.

        The height goes from the base into the solid (see `quat_xyzw`), and length and width are
        those of the rectangle around it as seen along the height. Those of a box are its sides,
        descending.
        """
        return self.shape.dimensions

    @property
    def center(self) -> Floats:
        """Mean of the vertices (3,), metres (the paper's equation 1)."""
        return self.vertices.mean(axis=0)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        return self.center + moments(self.vertices - self.center, self.faces)[1]

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        return moments(self.vertices - self.center, self.faces)[0]

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the upright box around it, metres."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @property
    def quat_xyzw(self) -> Floats:
        """Orientation (4,): unit quaternion x, y, z, w that turns the world's axes into its own.

        The own z axis goes from the base into the solid; the base is that of a pyramid, frustum or
        prism, else a largest face. The x axis goes along the side of the base where the rectangle
        around it has the least perimeter, the longest of such. Among orientations that look alike
        it is the one that turns least.
        """
        return Rotation.from_matrix(self.shape.rotations[0]).as_quat(canonical=True)

    @property
    def rotation(self) -> Floats:
        """Own axes as columns (3, 3) (see `quat_xyzw`)."""
        return self.shape.rotations[0].copy()

    @property
    def symmetry(self) -> Floats:
        """Turns (s, 3, 3) about the centroid that lay the solid onto itself; the first is none."""
        rotations = self.shape.rotations
        return np.einsum("ij,skj->sik", rotations[0], rotations)

    @property
    def footprint(self) -> Floats | None:
        """Corners (m, 2), metres, of an upright prism; None for other solids."""
        return self.shape.footprint

    @property
    def angle(self) -> float:
        """Yaw of the footprint of an upright prism, radians (see `Prism.angle`); NaN for others."""
        return self.shape.angle

    @property
    def base(self) -> float:
        """Lowest z, metres."""
        return float(self.vertices[:, 2].min())

    @property
    def height(self) -> float:
        """Extent along z, metres."""
        return float(np.ptp(self.vertices[:, 2]))

    @property
    def normals(self) -> Floats:
        """Outward unit normals (f, 3) of the faces."""
        vectors = shells.area_vectors(self.vertices, self.faces)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    @property
    def edges(self) -> Ints:
        """Rows of `vertices` (e, 2) at the ends of each edge."""
        shell = shells.Shell.of(self.faces)
        ends = np.stack([shell.start, shell.start[shell.following]], axis=1)
        return ends[ends[:, 0] < ends[:, 1]]

    @property
    def euler_characteristic(self) -> int:
        """Vertices less edges plus faces: 2, and 2 less for each tunnel."""
        return len(self.vertices) - len(self.edges) + len(self.faces)

    @property
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above."""
        up = self.normals[:, 2] > FLAT
        faces = [face for face, is_up in zip(self.faces, up, strict=True) if is_up]
        return shapely.union_all([shapely.Polygon(self.vertices[face, :2]) for face in faces])

    def contains(self, points: PointsLike) -> Bools:
        """Which points (n, 3) are inside, or within rounding of a face."""
        rows = points_of("points", points)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        near = np.flatnonzero(((rows >= low) & (rows <= high)).all(axis=1))
        inside = np.zeros(len(rows), dtype=bool)
        at_once = max(1, _PAIRS_AT_ONCE // len(self._mesh))
        for first in range(0, len(near), at_once):
            some = near[first : first + at_once]
            inside[some] = winding_number(rows[some], self.vertices, self._mesh) >= 0.5 - 1e-9
        return inside

    @cached_property
    def _mesh(self) -> Ints:
        return triangles_of(self.vertices, self.faces)

    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (v, 3) and triangles (t, 3), counter-clockwise from outside."""
        return self.vertices.copy(), self._mesh.copy()

    def laid(self, motion: Motion, rise: float = 0.0) -> Polyhedron:
        """The polyhedron where a motion about the vertical, and a `rise`, metres, bring it."""
        vertices = np.column_stack([motion.of(self.vertices[:, :2]), self.vertices[:, 2] + rise])
        # What was checked once stays right, however coarse the numbers are over there.
        moved = object.__new__(Polyhedron)
        object.__setattr__(moved, "vertices", vertices)
        object.__setattr__(moved, "faces", self.faces)
        return moved

    def to_dict(self) -> dict[str, Any]:
        """The polyhedron as plain numbers, for JSON."""
        return {
            "type": self.type_name,
            "vertices": self.vertices.tolist(),
            "faces": [face.tolist() for face in self.faces],
        }

    def __repr__(self) -> str:
        center = ", ".join(f"{value:.4f}" for value in self.center)
        sizes = ", ".join(f"{value:.4f}" for value in np.atleast_1d(self.size))
        return (
            f"Polyhedron({self.kind}, center=({center}), size={sizes} m, "
            f"{len(self.faces)} faces, {len(self.vertices)} vertices)"
        )


def _positive(**values: float) -> tuple[float, ...]:
    return tuple(number(name, value, above=0.0) for name, value in values.items())


def _rectangle(length: float, width: float) -> Floats:
    x, y = length / 2, width / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
