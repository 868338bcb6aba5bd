"""A solid that was found: what it is, how well that is known, and what tells it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from primfit._check import Floats, Ints, as_vector
from primfit.geometry.motions import Motion, turned
from primfit.geometry.products import product
from primfit.geometry.shapes import Shape, upright_shape
from primfit.solids.prism import Prism
from primfit.solids.solid import Solid

EQUAL = 0.02
"""Difference of lengths, relative to the size, and of angles, radians, that still counts as none in
the name of a solid that was found."""

_UPRIGHT = ("center_x", "center_y", "angle", "size", "size_2")


@dataclass(frozen=True, eq=False)
class FoundSolid:
    """A solid that was found.

    Where it is and what it looks like is that of `solid`. What it is called, `kind` and `size` and
    the like, tells `shape`: fitted faces are never quite at right angles, and differences within
    what is known of them count as none.

    Attributes
    ----------
    solid : Solid
        A `Prism` for what is known to stand upright; where nobody saw its top, it ends at the
        highest beam that met it.
    shape : Shape
        What the solid is, within what is known of it.
    parameters : tuple of str
        What `covariance` is of: "center_x", "center_y", and "center_z", metres; "angle" about the
        vertical, or small turns "rotation_x", ... about the axes of the world, radians; lengths
        "size", "size_2", ... in the order of `size`, or by their own names ("radius").
    covariance : (k, k) float64
        Of the parameters; NaN when nothing was fitted.
    planes : tuple of int
        Planes of its faces among those found; -1 for a face on none.
    observed : tuple of bool
        Which of `faces` returned beams; of a round solid, which of its surfaces and flat ends.
    surfaces : tuple of int
        Curved surfaces of it among those found.
    height_sigma : float or None, metres
        Standard deviation of the height of an upright solid, NaN where no beam tells the height;
        None where the height is not a parameter of its own.
    tolerance_sigma : float, metres
        Standard deviation of x and y of the center that the shape's own inexactness adds to
        `covariance`, which is that of the noise alone: walls of a real solid may be off its kind by
        as much as the tolerance, unless the beams say less.
    """

    solid: Solid
    shape: Shape
    parameters: tuple[str, ...]
    covariance: Floats
    planes: tuple[int, ...]
    observed: tuple[bool, ...]
    surfaces: tuple[int, ...] = ()
    height_sigma: float | None = None
    tolerance_sigma: float = 0.0

    @classmethod
    def upright(
        cls,
        kind: str,
        footprint: Floats,
        base: float,
        top: float,
        angle: float,
        size: float | tuple[float, float],
        covariance: Floats,
        planes: tuple[int, ...],
        observed: tuple[bool, ...],
        height_sigma: float = np.nan,
        tolerance_sigma: float = 0.0,
    ) -> FoundSolid:
        """An upright prism over a footprint (m, 2) of which kind, angle and size are known.

        The `covariance` is that of the center's x and y, the angle and the one or two sizes. The
        angle of a circle is zero by definition, and so are its row and column.
        """
        height = top - base if np.isfinite(height_sigma) else np.nan
        return cls(
            solid=Prism.as_found(footprint, top - base, base),
            shape=upright_shape(kind, np.array(footprint), angle, size, height),
            parameters=_UPRIGHT[: len(covariance)],
            covariance=covariance,
            planes=planes,
            observed=observed,
            height_sigma=height_sigma,
            tolerance_sigma=tolerance_sigma,
        )

    @property
    def kind(self) -> str:
        """Class name as that of `Solid.kind`, within what is known of it."""
        return self.shape.kind

    @property
    def size(self) -> float | tuple[float, ...]:
        """As that of a solid of this kind, metres."""
        return self.shape.size

    @property
    def solid_kind(self) -> str:
        """Class name as that of `Solid.solid_kind`, the same at any tilt."""
        return self.shape.solid_kind

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Length, width and height along the own axes, metres; NaN for an unknown height."""
        return self.shape.dimensions

    @property
    def angle(self) -> float:
        """Yaw of the footprint, radians, from zero up to its symmetry; NaN without a footprint."""
        return self.shape.angle

    @property
    def T_world_solid(self) -> Floats:
        """Pose (4, 4): the own axes, and `center` as their origin."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._rotation, self.center
        return pose

    @property
    def _rotation(self) -> Floats:
        rotations = self.shape.rotations
        return rotations[0] if len(rotations) else self.solid.rotation

    @property
    def quat_xyzw(self) -> Floats:
        """Orientation (4,) of its own axes: unit quaternion x, y, z, w."""
        return Rotation.from_matrix(self._rotation).as_quat(canonical=True)

    @property
    def footprint(self) -> Floats | None:
        """Corners (m, 2), metres, of what stands upright; None for other solids."""
        return self.shape.footprint

    @property
    def base(self) -> float:
        """Lowest z, metres."""
        return float(self.solid.bounds[0][2])

    @property
    def top(self) -> float:
        """Highest z, metres; where the height is not known, that of the highest beam."""
        return float(self.solid.bounds[1][2])

    @property
    def height(self) -> float:
        """Extent along z, metres; NaN where no beam tells."""
        if not self._is_whole:
            return np.nan
        if isinstance(self.solid, Prism):
            return self.solid.height
        return self.top - self.base

    @property
    def center(self) -> Floats:
        """Mean of the vertices, or middle of a round solid (3,), metres; z as `height`."""
        return self._known(self.solid.center)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres; z is NaN where the height is."""
        return self._known(self.solid.centroid)

    @property
    def volume(self) -> float:
        """Volume, cubic metres; NaN where the height is."""
        return self.solid.volume if self._is_whole else np.nan

    @property
    def _is_whole(self) -> bool:
        return self.height_sigma is None or bool(np.isfinite(self.height_sigma))

    def _known(self, place: Floats) -> Floats:
        return place if self._is_whole else np.append(place[:2], np.nan)

    @property
    def vertices(self) -> Floats:
        """Vertices (v, 3), metres, of the solid or of the mesh that stands for it."""
        return self.solid.vertices

    @property
    def faces(self) -> tuple[Ints, ...]:
        """Rows of `vertices` around each face, counter-clockwise from outside."""
        return self.solid.faces

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: metres, and radians for angles."""
        deviations = np.sqrt(np.diag(self.covariance)).tolist()
        found = dict(zip(self.parameters, deviations, strict=True))
        return found if self.height_sigma is None else found | {"height": self.height_sigma}

    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (v, 3) and triangles (t, 3), counter-clockwise from outside."""
        return self.solid.to_mesh()

    def moved(self, offset: ArrayLike) -> FoundSolid:
        """The solid moved by a vector (3,), metres."""
        shift = as_vector("offset", offset, 3)
        return self.laid(Motion(0.0, shift[:2]), float(shift[2]))

    def laid(self, motion: Motion, rise: float = 0.0) -> FoundSolid:
        """The solid where a motion about the vertical, and a `rise`, metres, bring it."""
        return replace(
            self,
            solid=self.solid.laid(motion, rise),
            shape=self.shape.laid(motion),
            covariance=self._turned(motion.turn) if motion.turn else self.covariance,
        )

    def _turned(self, angle: float) -> Floats:
        """The covariance where x and y are those of axes that the solid has turned in."""
        turn = np.eye(len(self.parameters))
        for what in ("center", "rotation"):
            if f"{what}_x" in self.parameters:
                i, j = (self.parameters.index(f"{what}_{axis}") for axis in "xy")
                turn[np.ix_([i, j], [i, j])] = turned(np.eye(2), angle).T
        return product(product(turn, self.covariance), turn.T)

    def to_dict(self) -> dict[str, Any]:
        """What it is and where, and how well that is known, as plain numbers, for JSON."""
        footprint = self.footprint
        return self.solid.to_dict() | {
            "kind": self.kind,
            "solid_kind": self.solid_kind,
            "dimensions": _plain(self.dimensions),
            "center": _plain(self.center),
            "centroid": _plain(self.centroid),
            "angle": _or_none(self.angle),
            "size": self.size,
            "height": _or_none(self.height),
            "footprint": None if footprint is None else footprint.tolist(),
            "quat_xyzw": self.quat_xyzw.tolist(),
            "sigmas": {name: _or_none(sigma) for name, sigma in self.sigmas.items()},
            "tolerance_sigma": self.tolerance_sigma,
            "planes": list(self.planes),
            "surfaces": list(self.surfaces),
            "observed": list(self.observed),
        }

    @property
    def title(self) -> str:
        """What it is called where all are listed: the kind of what was fitted as upright."""
        return self.kind if "angle" in self.parameters else self.solid_kind

    def __repr__(self) -> str:
        x, y, z = self.center
        if "angle" in self.parameters:
            size = ", ".join(f"{value:.4f}" for value in np.atleast_1d(self.size))
            return (
                f"FoundSolid({self.kind}, center=({x:.4f}, {y:.4f}), size={size} m, "
                f"angle={np.degrees(self.angle):.2f} deg)"
            )
        dimensions = " x ".join(f"{value:.4f}" for value in self.dimensions)
        return (
            f"FoundSolid({self.solid_kind}, center=({x:.4f}, {y:.4f}, {z:.4f}), {dimensions} m, "
            f"{sum(self.observed)} of {len(self.observed)} faces observed)"
        )


def _plain(values: Floats | tuple[float, ...]) -> list[float | None]:
    return [_or_none(float(value)) for value in values]


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
