"""What every solid can tell of itself, and solids by the name that files call them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Bools, Floats, Ints, as_vector
from primfit.clouds.foreign import PointsLike
from primfit.geometry.motions import Motion
from primfit.geometry.shapes import Shape


class Solid(ABC):
    """A closed solid in the world, metres; it never changes.

    A class of solids has a `type_name`, by which files call it, and is known by it from then on:
    worlds hold, scan, draw, save and load whatever keeps this contract.
    """

    type_name: ClassVar[str]
    """Name of the class in files."""

    _of_type: ClassVar[dict[str, type[Solid]]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "type_name" in vars(cls):
            Solid._of_type[cls.type_name] = cls

    if TYPE_CHECKING:
        # At run time a class may hold these as fields, of which a property would be the default.

        @property
        @abstractmethod
        def center(self) -> Floats:
            """Mean of the vertices (3,), or middle of the axis of what is round; metres."""

        @property
        @abstractmethod
        def footprint(self) -> Floats | None:
            """Corners (m, 2), metres, of what is an upright prism; None for other solids."""

        @property
        @abstractmethod
        def vertices(self) -> Floats:
            """Vertices (v, 3), metres, of the solid or of the mesh that stands for it."""

        @property
        @abstractmethod
        def faces(self) -> tuple[Ints, ...]:
            """Rows of `vertices` around each face, counter-clockwise from outside."""

    @property
    @abstractmethod
    def kind(self) -> str:
        """Class name; that of the footprint for what stands upright and has one."""

    @property
    @abstractmethod
    def size(self) -> float | tuple[float, ...]:
        """What there is to tell of the size of this kind, metres."""

    @property
    @abstractmethod
    def solid_kind(self) -> str:
        """Class name, the same at any tilt.

        "box", "cube", "wedge", "pyramid", "frustum", "prism", "polyhedron", "cylinder", "cone",
        "sphere" or "torus".
        """

    @property
    @abstractmethod
    def dimensions(self) -> tuple[float, float, float]:
        """Length, width and height along the solid's own axes, metres, the same at any tilt.

        The height goes from the base into the solid, the length along the longer side of the
        rectangle around the base. The base of a box is its largest face.
        """

    @property
    @abstractmethod
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume, cubic metres."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the upright box around it, metres."""

    @property
    @abstractmethod
    def angle(self) -> float:
        """Yaw of the footprint, radians; NaN without one."""

    @property
    @abstractmethod
    def rotation(self) -> Floats:
        """Own axes as columns (3, 3): z from the base into the solid, x along the base."""

    @property
    def shape(self) -> Shape:
        """What it is, as one value."""
        return Shape(
            self.kind,
            self.footprint,
            self.angle,
            self.size,
            self.solid_kind,
            self.dimensions,
            self.rotation[None],
        )

    @property
    def T_world_solid(self) -> Floats:
        """Pose (4, 4): the own axes, and `center` as their origin."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation, self.center
        return pose

    @property
    @abstractmethod
    def normals(self) -> Floats:
        """Outward unit normals (f, 3) of what is flat of its surface."""

    @property
    @abstractmethod
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above."""

    @abstractmethod
    def contains(self, points: PointsLike) -> Bools:
        """Which points (n, 3) are inside or on the surface."""

    @abstractmethod
    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (v, 3) and triangles (t, 3), counter-clockwise from outside."""

    @abstractmethod
    def laid(self, motion: Motion, rise: float = 0.0) -> Self:
        """The solid where a motion about the vertical, and a `rise`, metres, bring it."""

    def moved(self, offset: ArrayLike) -> Self:
        """The solid moved by a vector (3,), metres."""
        x, y, z = as_vector("offset", offset, 3)
        return self.laid(Motion(0.0, np.array([x, y])), float(z))

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The solid as plain numbers, for JSON; its "type" is the name of the class."""

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> Solid:
        """The solid of which `to_dict` told.

        Parameters
        ----------
        content : mapping
            One without a "type" is of an older file: a prism when it has a footprint, else a
            polyhedron.

        Raises
        ------
        ValueError
            When no class of solids has this type.

        Examples
        --------
        >>> import primfit
        >>> primfit.Solid.from_dict(primfit.Sphere(0.2, (1, 1)).to_dict())
        Sphere(center=(1.0000, 1.0000, 0.2000), radius=0.2 m)
        """
        # A class is known once its module is imported.
        from primfit.solids import frusta, polyhedron, prism, sphere, torus  # noqa: F401

        values = dict(content)
        name = values.pop("type", "prism" if "footprint" in values else "polyhedron")
        if name not in Solid._of_type:
            known = ", ".join(sorted(Solid._of_type))
            raise ValueError(f"type of a solid must be one of {known}; not {name!r}")
        return Solid._of_type[name](**values)
