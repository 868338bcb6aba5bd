"""Seeds of solids: what is left when the space that beams passed is carved away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from primfit._check import Bools, Floats
from primfit.scans import Scan

_CLEAR = 3.0
"""Standard deviations by which a beam must end beyond a cell to have passed it."""

_LEAST_BEAMS, _LEAST_SHARE = 3, 0.02
"""Beams, and share of the beams of a cell, that must have passed for it to be free."""

_BEAMS_AT_ONCE = 1 << 14


@dataclass(frozen=True, eq=False)
class Seed:
    """A piece of space that no beam passed.

    Attributes
    ----------
    center : (2,) float64, metres
    area : float, square metres
    outline : (m, 2) float64, metres
        Convex hull, counter-clockwise.
    """

    center: Floats
    area: float
    outline: Floats


@dataclass(frozen=True, eq=False)
class Carving:
    """A grid seen from above: which cells beams crossed, and which of them they passed.

    Attributes
    ----------
    low : (2,) float64, metres
        Corner of cell [0, 0].
    cell : float, metres
    is_crossed, is_free : (nx, ny) bool
    """

    low: Floats
    cell: float
    is_crossed: Bools
    is_free: Bools

    def seeds(self, within: Bools | None = None) -> list[Seed]:
        """Connected pieces that are crossed but not free, without those of a few cells."""
        occupied = self.is_crossed & ~self.is_free
        if within is not None:
            occupied &= within
        labels, _ = ndimage.label(ndimage.binary_opening(occupied))
        seeds = []
        for number in range(1, int(labels.max(initial=0)) + 1):
            at = np.argwhere(labels == number)
            if len(at) >= 8:
                around = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
                corners = self.low + self.cell * (at[:, None] + around).reshape(-1, 2)
                center = self.low + self.cell * (at.mean(axis=0) + 0.5)
                hull = corners[ConvexHull(corners).vertices]
                seeds.append(Seed(center, len(at) * self.cell**2, hull))
        return seeds

    def centers(self) -> Floats:
        """Middle of every cell (nx, ny, 2), metres."""
        index = np.moveaxis(np.indices(self.is_free.shape), 0, -1)
        return self.low + self.cell * (index + 0.5)


def carve(scan: Scan, sigma: float, *, bottom: float, top: float, reach: float) -> Carving:
    """Carve the layer between two heights.

    A cell is free when enough of the beams that cross it ended well beyond it; whether a beam
    that ended before ever got there does not matter. Unseen cells are neither crossed nor free.

    Parameters
    ----------
    scan : Scan
        With origins.
    sigma : float, metres
        Of the ranges.
    bottom, top : float, metres
        z of the layer.
    reach : float, metres
        How far the sensor sees.
    """
    cell = reach / 50.0
    low = scan.origins[:, :2].min(axis=0) - reach
    shape = np.ceil((scan.origins[:, :2].max(axis=0) + reach - low) / cell).astype(int) + 1
    steps = (np.arange(int(np.ceil(reach / cell))) + 0.5) * cell
    certain = np.where(np.isfinite(scan.ranges), scan.ranges - _CLEAR * sigma, reach)
    crossed, passed = np.zeros((2, *shape), dtype=np.int64)
    for first in range(0, len(scan), _BEAMS_AT_ONCE):
        rows = slice(first, first + _BEAMS_AT_ONCE)
        at = scan.origins[rows, None] + steps[:, None] * scan.directions[rows, None]
        layer = (at[..., 2] >= bottom) & (at[..., 2] <= top)
        index = ((at[..., :2] - low) / cell).astype(np.int64)
        flat = index[..., 0] * shape[1] + index[..., 1]
        beyond = layer & (steps < certain[rows, None])
        crossed += np.bincount(flat[layer], minlength=crossed.size).reshape(shape)
        passed += np.bincount(flat[beyond], minlength=passed.size).reshape(shape)
    is_free = (passed >= _LEAST_BEAMS) & (passed > _LEAST_SHARE * crossed)
    return Carving(low, cell, crossed > 0, is_free)
