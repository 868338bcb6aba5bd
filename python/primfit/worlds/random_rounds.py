"""Random round solids on the floor."""

from __future__ import annotations

import numpy as np

from primfit.solids.frusta import Cone, Cylinder
from primfit.solids.round import Round
from primfit.solids.sphere import Sphere

ROUNDS: dict[str, tuple[float, float]] = {
    "cylinder": (0.16, 0.28),
    "cone": (0.16, 0.28),
    "sphere": (0.16, 0.28),
}
"""Kinds, and ranges of their diameters and heights, metres."""


def random_round(
    kind: str, limits: tuple[float, float], rng: np.random.Generator, *, tilted: bool
) -> Round:
    """A random round solid that is on the floor at the origin.

    Its diameter and height are within `limits`, metres. Tilted, every orientation is alike likely
    and the lowest point is on the floor; else it stands on its base.
    """
    if kind == "sphere":
        return Sphere(rng.uniform(*limits) / 2)
    diameter, height = rng.uniform(*limits, 2)
    axis = rng.normal(size=3) if tilted else np.array([0.0, 0.0, 1.0])
    if kind == "cylinder":
        return Cylinder(diameter / 2, height, axis=axis)
    return Cone(diameter / 2, height, axis=axis)
