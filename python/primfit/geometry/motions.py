"""Rigid motions in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit._check import Floats


def turned(vectors: Floats, angles: Floats | float) -> Floats:
    """Vectors (n, 2) turned by an angle, or by one each, radians."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = vectors.T
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def wrapped(angles: Floats) -> Floats:
    """Angles from -pi up to pi."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True, eq=False)
class Motion:
    """A turn about the origin and then a move.

    Attributes
    ----------
    turn : float, radians
    move : (2,) float64, metres
    """

    turn: float
    move: Floats

    @classmethod
    def laying(cls, places: Floats, others: Floats) -> Motion:
        """The motion that lays places (n, 2) on others with the least sum of squares."""
        middle, other = places.mean(axis=0), others.mean(axis=0)
        arms, theirs = ((x - x.mean(axis=0)) @ [1.0, 1.0j] for x in (places, others))
        turn = float(np.angle(np.vdot(arms, theirs)))
        return cls(turn, other - turned(middle[None], turn)[0])

    def of(self, places: Floats) -> Floats:
        """Places (n, 2) where it brings them."""
        return turned(places, self.turn) + self.move
