"""Balls."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from primfit._check import Floats, number
from primfit.geometry.revolution import circle_points
from primfit.solids.round import OUTLINE, Round


@dataclass(frozen=True, eq=False, repr=False)
class Sphere(Round):
    """A ball.

    Parameters
    ----------
    radius : float, metres
    center : (3,) or (2,) float64 or None, metres
        (2,) is where it lies on the floor, None at the origin.

    Raises
    ------
    ValueError
        When the radius is not positive.

    Examples
    --------
    >>> import primfit
    >>> ball = primfit.Sphere(0.2, center=(1, 1))
    >>> ball
    Sphere(center=(1.0000, 1.0000, 0.2000), radius=0.2 m)
    >>> world = primfit.World([ball])
    >>> primfit.RayCaster(world).cast([[0, 1, 0.2]], [[1, 0, 0]])
    (array([0.8]), array([0]))
    """

    type_name = "sphere"

    radius: float
    center: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number("radius", self.radius, above=0.0))
        self._settle_center()

    @property
    def axis(self) -> Floats:
        """(0, 0, 1): all axes are alike."""
        return np.array([0.0, 0.0, 1.0])

    @property
    def circles(self) -> tuple[tuple[float, float], ...]:
        """The centre."""
        return ((0.0, 0.0),)

    @property
    def tube(self) -> float:
        """The radius, metres."""
        return self.radius

    @property
    def row(self) -> Floats:
        """The numbers (10,) by which the ray caster knows it."""
        return np.array([0.0, *self.center, 0.0, 0.0, 0.0, self.radius, 0.0, 0.0])

    @property
    def size(self) -> float:
        """Radius, metres."""
        return self.radius

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """The diameter, thrice; metres."""
        return (2.0 * self.radius,) * 3

    @property
    def volume(self) -> float:
        """Volume, cubic metres."""
        return float(4.0 / 3.0 * np.pi * self.radius**3)

    @property
    def centroid(self) -> Floats:
        """Centroid of the volume (3,), metres."""
        return self.center.copy()

    @cached_property
    def shadow(self) -> shapely.Polygon:
        """What it covers as seen from above, a polygon of 256 corners."""
        return shapely.Polygon(self.center[:2] + self.radius * circle_points(OUTLINE))

    def surfaces(self, points: Floats) -> tuple[Floats, Floats]:
        """Distances (n, 1) outwards, and normals (n, 1, 3)."""
        arms = points - self.center
        distances = np.sqrt((arms * arms).sum(axis=1))
        out = arms / np.where(distances > 0.0, distances, 1.0)[:, None]
        return (distances - self.radius)[:, None], out[:, None]

    def _profile(self, segments: int) -> Floats:
        stacks = max(2, segments // 2)
        angles = np.pi * np.arange(stacks + 1) / stacks
        distances = self.radius * np.sin(angles)
        distances[[0, -1]] = 0.0
        return np.stack([distances, -self.radius * np.cos(angles)], axis=1)

    def __repr__(self) -> str:
        return self._text(f"radius={self.radius:g} m")
