"""A scene as the beams see it: the room, the floor, the solids so far, and what they cost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints
from primfit.casting import RayCaster
from primfit.sampling import Posterior
from primfit.scans import Scan
from primfit.solids import Prism
from primfit.templates import Template

CAP = 12.5
"""Cost of a beam that the scene does not explain: as much as five standard deviations."""

_LEAST_SIGMA = 5e-4
"""Least standard deviation, as a fraction of the sensor's reach, for a likelihood to be climbed."""


@dataclass(frozen=True, eq=False)
class Body:
    """A solid of the scene as it stands: a guess at first, then a fitted template."""

    footprint: Floats
    top: float
    fits: tuple[tuple[Template, Posterior], ...] = ()
    gain: float = 0.0


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams that may meet a solid, with what they meet otherwise."""

    arrays: tuple[Floats, Floats, Floats, Floats, Floats]
    reach: float
    stride: int
    base: float
    n_jobs: int | None

    def costs(self, footprints: Floats, tops: Floats) -> Floats:
        """Negative log-likelihood of each candidate."""
        n = len(footprints)
        costs = _primfit.prism_costs(
            *self.arrays,
            self.reach,
            CAP,
            np.ascontiguousarray(footprints),
            np.full(n, self.base),
            np.ascontiguousarray(tops),
            self.n_jobs,
        )
        return self.stride * costs

    def __len__(self) -> int:
        return self.stride * len(self.arrays[0])


class Scene:
    """The scan and the surfaces that explain it so far."""

    def __init__(self, scan: Scan, sigma: float, base: float, n_jobs: int | None) -> None:
        self.scan = scan
        self.base = base
        self.n_jobs = n_jobs
        farthest = float(scan.ranges[scan.is_return].max(initial=0.0))
        self.reach = farthest if scan.max_range is None else scan.max_range
        self.sigma = max(sigma, _LEAST_SIGMA * self.reach)
        self.room: Floats | None = None
        self.bodies: list[Body] = []

    def background(self, without: int | None = None, rows: Any = slice(None)) -> Floats:
        """Range of the nearest surface for some beams, one body left out."""
        parts = [
            Prism(body.footprint, body.top - self.base, base=self.base).to_mesh()
            for i, body in enumerate(self.bodies)
            if i != without and body.top > self.base
        ]
        low = self.scan.origins[:, :2].min(axis=0) - 10 * self.reach
        high = self.scan.origins[:, :2].max(axis=0) + 10 * self.reach
        floor = np.array([[*low, 0], [high[0], low[1], 0], [*high, 0], [low[0], high[1], 0]], float)
        floor[:, 2] = self.base
        parts.append((floor, np.array([[0, 1, 2], [0, 2, 3]])))
        if self.room is not None:
            parts.append(Prism(self.room, 10 * self.reach, base=self.base).to_mesh())
        first = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
        mesh = (
            np.concatenate([vertices for vertices, _ in parts]),
            np.concatenate([rows + i for (_, rows), i in zip(parts, first, strict=True)]),
        )
        origins, directions = self.scan.origins[rows], self.scan.directions[rows]
        return RayCaster(mesh).cast(origins, directions, self.n_jobs)[0]

    def near(self, center: Floats, radius: float, without: int | None) -> Beams:
        """Beams that come within `radius` of a place before they meet another surface."""
        way = self.scan.directions[:, :2]
        length = np.maximum(np.hypot(*way.T), 1e-12)
        to_center = center - self.scan.origins[:, :2]
        along = np.einsum("ij,ij->i", to_center, way) / length
        off = np.abs(to_center[:, 0] * way[:, 1] - to_center[:, 1] * way[:, 0]) / length
        near = np.flatnonzero(
            (off < radius) & (along > -radius) & (along - radius < self.reach * length)
        )
        background = self.background(without, near)
        near_before = (along[near] - radius) / length[near] < background
        return self.beams(near[near_before], background[near_before])

    def beams(self, rows: Ints, background: Floats) -> Beams:
        """Some beams with what they meet."""
        scan = self.scan
        arrays = (scan.origins[rows], scan.directions[rows], scan.ranges[rows], background)
        sigmas = np.full(len(rows), self.sigma)
        o, d, r, b = (np.ascontiguousarray(array) for array in arrays)
        return Beams((o, d, r, b, sigmas), self.reach, 1, self.base, self.n_jobs)


def thinned(beams: Beams, stride: int, least_sigma: float) -> Beams:
    """Some of the beams, taken as no more exact than `least_sigma`."""
    o, d, r, b, sigmas = (np.ascontiguousarray(array[::stride]) for array in beams.arrays)
    arrays = (o, d, r, b, np.maximum(sigmas, least_sigma))
    return replace(beams, arrays=arrays, stride=beams.stride * stride)
