"""Solids of any shape that were found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry import footprints
from primfit.geometry.faces import FlatFaced, triangles_of

EQUAL = 0.02
"""Difference of lengths, relative to the size, and of angles, radians, that still counts as none in
the name of a solid that was found."""


@dataclass(frozen=True, eq=False)
class FoundPolyhedron(FlatFaced):
    """A closed solid that was found.

    Attributes
    ----------
    kind : str
        As that of `Polyhedron`, where differences up to `EQUAL` count as none, and larger ones of
        faces that are known less well.
    vertices : (v, 3) float64, metres
    faces : tuple of int arrays
        Rows of `vertices` around each face, counter-clockwise from outside.
    planes : tuple of int
        Plane of each face; -1 where none was found.
    observed : tuple of bool
        Which faces have points. Others were never seen: in each several of the seen ones end.
    size, quat_xyzw, footprint
        As those of `Polyhedron`.
    covariance : (6 + s, 6 + s) float64
        Of x, y, z of the centre, metres, of a small rotation about the axes of the world, radians,
        and of the s sizes, from the distances of the points to their planes.
    """

    kind: str
    vertices: Floats
    faces: tuple[Ints, ...]
    planes: tuple[int, ...]
    observed: tuple[bool, ...]
    size: float | tuple[float, ...]
    quat_xyzw: Floats
    footprint: Floats | None
    covariance: Floats

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by name: metres, and radians for the rotation."""
        names = [f"{what}_{axis}" for what in ("center", "rotation") for axis in "xyz"]
        names += ["size", "size_2", "size_3"]
        deviations = np.sqrt(np.diag(self.covariance)).tolist()
        return dict(zip(names, deviations, strict=False))

    @property
    def angle(self) -> float:
        """Yaw of the footprint of an upright prism, radians; NaN for others."""
        if self.footprint is None:
            return np.nan
        return footprints.angle_of(self.footprint, self.kind, EQUAL)

    @property
    def height(self) -> float:
        """Extent along z, metres."""
        return float(np.ptp(self.vertices[:, 2]))

    def to_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (v, 3) and triangles (t, 3), counter-clockwise from outside."""
        return self.vertices, triangles_of(self.vertices, self.faces)

    def moved(self, offset: Floats) -> FoundPolyhedron:
        """The solid moved by a vector (3,), metres."""
        footprint = None if self.footprint is None else self.footprint + offset[:2]
        return replace(self, vertices=self.vertices + offset, footprint=footprint)

    def to_dict(self) -> dict[str, Any]:
        """The solid as plain numbers, for JSON."""
        return {
            "kind": self.kind,
            "center": self.center.tolist(),
            "centroid": self.centroid.tolist(),
            "size": self.size,
            "quat_xyzw": self.quat_xyzw.tolist(),
            "sigmas": self.sigmas,
            "vertices": self.vertices.tolist(),
            "faces": [face.tolist() for face in self.faces],
            "planes": list(self.planes),
            "observed": list(self.observed),
        }

    def __repr__(self) -> str:
        seen = f"{sum(self.observed)} of {len(self.faces)} faces observed"
        return self._text(self.kind, self.size, seen)


@dataclass(frozen=True, eq=False)
class Polyhedra:
    """What planes make.

    Attributes
    ----------
    solids : tuple of FoundPolyhedron
    shells : tuple of tuple of int
        Planes that meet without closing, and are in no solid.
    edges : (e, 2) int64
        Pairs of planes that meet in an edge.
    """

    solids: tuple[FoundPolyhedron, ...]
    shells: tuple[tuple[int, ...], ...]
    edges: Ints

    def __repr__(self) -> str:
        kinds = ", ".join(solid.kind for solid in self.solids) or "none"
        return (
            f"Polyhedra({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; "
            f"{len(self.shells)} open shell{'s' * (len(self.shells) != 1)}; "
            f"{len(self.edges)} edges)"
        )
