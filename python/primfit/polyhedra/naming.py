"""What a solid that was found is, when its vertices are known to some deviation."""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.spatial.transform import Rotation

from primfit._check import Floats
from primfit.geometry.products import product
from primfit.geometry.shapes import Shape, shape_of
from primfit.solids.found import EQUAL, FoundSolid
from primfit.solids.polyhedron import Polyhedron

_VAGUE = 0.05, 0.15
"""Differences of lengths, relative to the size, and of angles, that may count as none: of what is
known well, and of anything."""

_TOLERANCES = 8
"""How many are tried."""

_PARAMETERS = (
    *(f"{what}_{axis}" for what in ("center", "rotation") for axis in "xyz"),
    *("size", "size_2", "size_3"),
)

_STEP = 1e-6
"""By which vertices are moved to see how a shape follows, relative to the size."""


def found_solid(
    solid: Polyhedron, spread: Floats, planes: list[int], observed: list[bool]
) -> FoundSolid:
    """A solid with the plane of each face, named by the covariance (3v, 3v) of its vertices."""
    deviation = np.sqrt(spread.diagonal().reshape(-1, 3).sum(axis=1).max())
    extent = float(np.ptp(solid.vertices, axis=0).max())
    most = float(np.clip(3.0 * deviation / extent, *_VAGUE))
    shape, covariance = _named(solid, spread, most)
    return FoundSolid(
        solid=solid,
        shape=shape,
        parameters=_PARAMETERS[: len(covariance)],
        covariance=covariance,
        planes=tuple(planes),
        observed=tuple(observed),
    )


def _named(solid: Polyhedron, spread: Floats, most: float) -> tuple[Shape, Floats]:
    """What a solid is, and the covariance of that, with tolerances up to `most`.

    The smallest one counts that gives it a name, but faces that lean a little lean by chance. And
    sizes that differ by less than three deviations are one size.
    """
    tries = (
        (shape_of(solid.vertices, solid.faces, tolerance), tolerance)
        for tolerance in np.geomspace(EQUAL, most, _TOLERANCES).tolist()
    )
    strictest = next(tries)
    nameless = ("polyhedron", "prism" if len(solid.faces) < 7 else "polyhedron")
    shape, tolerance = next(
        (each for each in chain([strictest], tries) if each[0].kind not in nameless), strictest
    )
    covariance = _covariance(solid, shape, spread, tolerance)
    if shape.kind in ("box", "rectangle"):
        sizes = np.atleast_1d(shape.size)
        deviation = np.sqrt(covariance.diagonal()[6:].sum())
        for equal, tolerance in tries if np.ptp(sizes) <= 3.0 * deviation else ():
            if equal.kind in ("cube", "square"):
                return equal, _covariance(solid, equal, spread, tolerance)
    return shape, covariance


def _covariance(solid: Polyhedron, shape: Shape, spread: Floats, tolerance: float) -> Floats:
    """Covariance of centre, rotation and sizes, from that of the vertices."""
    step = _STEP * float(np.ptp(solid.vertices, axis=0).max())
    turn = Rotation.from_matrix(shape.rotations[0]).inv()
    columns = []
    for move in np.eye(solid.vertices.size).reshape(-1, *solid.vertices.shape):
        moved = shape_of(solid.vertices + step * move, solid.faces, tolerance)
        turns = Rotation.from_matrix(moved.rotations) * turn
        sizes = np.atleast_1d(moved.size) - np.atleast_1d(shape.size)
        turned = turns[int(turns.magnitude().argmin())].as_rotvec()
        columns.append(np.concatenate([step * move.mean(axis=0), turned, sizes]) / step)
    jacobian = np.column_stack(columns)
    return product(product(jacobian, spread), jacobian.T)
