"""The rim of an open surface, and the unseen faces beyond it, where the seen ones force them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from primfit._check import Bools, Floats, Ints
from primfit.geometry.decompositions import eigen_of
from primfit.polyhedra.adjacency import OPEN

_STRETCH, _PLANE = 40.0, 20.0
"""What one more stretch, and one more plane, must lower the sum of squares by, in its units."""

_ASIDE = 0.25
"""Least sine of the angle between an unseen face and a seen one at whose rim it begins."""

_PLACES = 60
"""Places, about, where one unseen face may follow another."""


@dataclass(frozen=True, eq=False)
class Unseen:
    """A face beyond a rim.

    Attributes
    ----------
    equation : (4,) float64
    plane : int
        The one whose part it is, or `OPEN`.
    samples : int array
        The samples of the rim that it ends in, in order.
    """

    equation: Floats
    plane: int
    samples: Ints


def unseen_faces(
    samples: Floats,
    owner: Ints,
    seen: Floats,
    known: dict[int, Floats],
    unit: float,
    most: int,
) -> list[Unseen]:
    """The faces in which a rim ends, in its order; none when it does not tell.

    The rim is cut into stretches of which each lies in one plane: as few as explain it. A stretch
    along one seen face only, or along a line, tells no plane, but may lie in a known one.

    Parameters
    ----------
    samples : (n, 3) float64, metres
        Points of the rim, in order around it.
    owner : (n,) int64
        Row of `seen` of the face at whose rim each is.
    seen : (k, 4) float64
        Equations of the faces along the rim.
    known : dict of int to (4,) float64
        Planes in which the rim may end: they may be some way beyond it.
    unit : float, metres
        Deviation of samples from where a face ends.
    most : int
        Greatest number of faces, from 1 to 3; more would meet in vertices of which nothing is
        known.
    """
    n = len(samples)
    places = _places(samples, owner, unit)
    first, last = np.meshgrid(places, places, indexing="ij")
    last = np.where(last > first, last, last + n)
    stretch = _Stretches.of(samples, owner, len(seen))
    costs, equations = stretch.free(first, last, seen, unit)
    planes = np.full(costs.shape, OPEN)
    for plane, equation in known.items():
        cost = stretch.along(first, last, equation, seen, unit)
        better = cost < costs
        costs[better], planes[better], equations[better] = cost[better], plane, equation
    cuts = _cheapest(costs, most)
    return [
        Unseen(equations[i, j], int(planes[i, j]), np.arange(first[i, j], last[i, j]) % n)
        for i, j in zip(cuts, np.roll(cuts, -1), strict=True)
    ]


def _places(samples: Floats, owner: Ints, unit: float) -> Ints:
    """Samples before which a stretch may begin: where the owner changes, or far from there."""
    changes = np.flatnonzero(owner != np.roll(owner, 1))
    step = max(1, len(samples) // _PLACES)
    others = np.arange(0, len(samples), step)
    away = np.linalg.norm(samples[others, None] - samples[changes], axis=2).min(axis=1)
    return np.union1d(changes, others[away > 2.0 * unit])


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Sums over the samples before each, around the rim twice."""

    moments: Floats
    owned: Ints

    @classmethod
    def of(cls, samples: Floats, owner: Ints, n_owners: int) -> _Stretches:
        rows = np.column_stack([samples, np.ones(len(samples))])
        outer = np.tile(rows[:, :, None] * rows[:, None, :], (2, 1, 1))
        owned = np.tile(owner, 2)[:, None] == np.arange(n_owners)
        sums = (np.concatenate([0 * each[:1], each.cumsum(axis=0)]) for each in (outer, owned))
        return cls(*sums)

    def free(self, first: Ints, last: Ints, seen: Floats, unit: float) -> tuple[Floats, Floats]:
        """Cost of the plane of least squares through each stretch, and its equation."""
        moments = self.moments[last] - self.moments[first]
        count = moments[..., 3, 3]
        mean = moments[..., :3, 3] / count[..., None]
        scatter = moments[..., :3, :3] - mean[..., :, None] * moments[..., 3, None, :3]
        values, vectors = eigen_of(scatter)
        normal = vectors[..., 0]
        offset = -np.einsum("...i,...i->...", normal, mean)
        told = (values[..., 1] > count * unit**2) & self._is_aside(first, last, normal, seen)
        cost = np.where(told, values[..., 0].clip(0.0) / unit**2 + _STRETCH + _PLANE, np.inf)
        return cost, np.concatenate([normal, offset[..., None]], axis=-1)

    def along(self, first: Ints, last: Ints, equation: Floats, seen: Floats, unit: float) -> Floats:
        """Cost of a known plane, from which all samples may be as far away as one may be."""
        moments = self.moments[last] - self.moments[first]
        mean = np.einsum("...i,i->...", moments[..., 3], equation) / moments[..., 3, 3]
        squares = np.einsum("i,...ij,j->...", equation, moments, equation)
        squares -= moments[..., 3, 3] * mean**2
        normal = np.broadcast_to(equation[:3], (*first.shape, 3))
        near = (np.abs(mean) <= 3.0 * unit) & self._is_aside(first, last, normal, seen)
        return np.where(near, squares.clip(0.0) / unit**2 + _STRETCH, np.inf)

    def _is_aside(self, first: Ints, last: Ints, normal: Floats, seen: Floats) -> Bools:
        """Whether planes stand off those of the faces along whose rim they are."""
        along = self.owned[last] > self.owned[first]
        cosine = np.abs(np.einsum("...i,ki->...k", normal, seen[:, :3]))
        return (~along | (cosine <= np.sqrt(1.0 - _ASIDE**2))).all(axis=-1)


def _cheapest(costs: Floats, most: int) -> list[int]:
    """Places of the cuts (rows of `costs`, at which stretches begin and end) that cost least.

    One stretch goes around from a place to itself.
    """
    ways = [costs.diagonal()]
    if most > 1:
        i, j = np.ogrid[[slice(len(costs))] * 2]
        ways.append(np.where(i < j, costs + costs.T, np.inf))
    if most > 2:
        i, j, k = np.ogrid[[slice(len(costs))] * 3]
        triples = costs[:, :, None] + costs[None, :, :] + costs.T[:, None, :]
        ways.append(np.where((i < j) & (j < k), triples, np.inf))
    best = min(ways, key=lambda way: float(way.min()))
    if not np.isfinite(best.min()):
        return []
    return [int(cut) for cut in np.unravel_index(best.argmin(), best.shape)]
