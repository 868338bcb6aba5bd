"""Planes of two tiles that are one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit._check import Floats, Ints

_SHARE = 0.5
"""Share of the halo's points of the lesser plane that two planes must both have: the majority."""

_WORSE = 1.5
"""How much farther from one plane than from each their own the points may lie, as where
`detect_planes` bends a part to a wanted orientation."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Number, mean (3,) and scatter (3, 3) about the mean of points."""

    n: int
    mean: Floats
    scatter: Floats

    @classmethod
    def of(cls, points: Floats) -> Moments:
        """Those of points (n, 3)."""
        if not len(points):
            return cls(0, np.zeros(3), np.zeros((3, 3)))
        mean = points.mean(axis=0)
        local = points - mean
        return cls(len(points), mean, np.einsum("ni,nj->ij", local, local))

    def __add__(self, other: Moments) -> Moments:
        n = self.n + other.n
        if not self.n or not other.n:
            return self if self.n else other
        apart = other.mean - self.mean
        scatter = self.scatter + other.scatter + np.outer(apart, apart) * (self.n * other.n / n)
        return Moments(n, self.mean + apart * (other.n / n), scatter)

    @property
    def misfit(self) -> float:
        """Sum of the squared distances from the plane through the points, square metres."""
        return max(0.0, float(np.linalg.eigvalsh(self.scatter)[0]))


def joined(moments: list[Moments], pairs: Ints, tile_of: Ints, noise: float) -> Ints:
    """The lowest number (k,) among the planes that each plane is one with.

    Parameters
    ----------
    moments : list of Moments
        Of the points that each plane has in its own tile.
    pairs : (m, 2) int64
        For each point of a halo, the plane of the tile with the halo, and that of the tile that
        the point lies in; -1 for none.
    tile_of : (k,) int64
        Tile of each plane.
    noise : float, metres
        Planes that agree within it are not told apart.
    """
    group = np.arange(len(moments))
    both = pairs[(pairs >= 0).all(axis=1)]
    if not len(both):
        return group
    ends, shared = np.unique(np.sort(both, axis=1), axis=0, return_counts=True)
    # Each plane's points in halos, by the tile on the other side where there is a plane.
    n_tiles = int(tile_of.max()) + 1
    other = np.concatenate([both, both[:, ::-1]])
    facing, counts = np.unique(other[:, 0] * n_tiles + tile_of[other[:, 1]], return_counts=True)

    def n_facing(plane: Ints, beside: Ints) -> Ints:
        at: Ints = counts[np.searchsorted(facing, plane * n_tiles + tile_of[beside])]
        return at

    a, b = ends.T
    share = shared / np.minimum(n_facing(a, b), n_facing(b, a))
    whole = list(moments)
    own = [each.misfit for each in moments]
    for i in np.lexsort((b, a, -shared)):
        if share[i] < _SHARE:
            continue
        one, two = _root(group, a[i]), _root(group, b[i])
        if one == two:
            continue
        together = whole[one] + whole[two]
        alone = own[one] + own[two]
        if together.misfit > _WORSE**2 * max(alone, together.n * noise**2):
            continue
        low, high = min(one, two), max(one, two)
        group[high] = low
        whole[low], own[low] = together, alone
    return np.array([_root(group, plane) for plane in range(len(group))])


def _root(group: Ints, plane: int) -> int:
    while group[plane] != plane:
        plane = int(group[plane])
    return int(plane)
