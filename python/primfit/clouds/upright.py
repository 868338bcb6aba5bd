"""Whether a cloud holds upright walls only, as of solids whose tops nobody saw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter

from primfit._check import Floats

_EDGES = 0.005, 0.995
"""Quantiles of the coordinates that bound what is looked at: outliers do not set the scale."""

_CELLS = 100
"""Cells along the longer side of the map, and levels in which the floor is looked for."""

_CROWDED = 3.0
"""The floor is a level in the lowest fifth with so many times the points of the median level."""

_POINTS_A_CELL = 8.0
"""Points that a cell of the map would hold if they were spread over all of it."""

_WINDOW = 3
"""A cell is amid an area when the square of so many cells a side around it is filled."""

_FEW = 0.1
"""A cell with less than this share of the median of points holds but the tails of noise."""

_TALL = 0.25
"""Points of a wall stand over each other: through this share of the height of all."""

_MOST_AREA, _LEAST_TALL = 0.05, 0.8
"""Limits of `Uprightness.has_only_walls`.

Clouds of upright solids of 0.2 m without tops, in noise of up to 10 mm, had an area below 0.054 and
a tall share above 0.84; where tops or leaning faces were seen, the area was above 0.07; on single
turns of spinning sensors in rooms and yards the tall share was below 0.64.
"""


class Uprightness(NamedTuple):
    """How much of what stands over the floor is upright; the shares are NaN where nothing does.

    Attributes
    ----------
    area : float
        Share of the map's cells that are amid an area: level or leaning surfaces, since walls are
        lines as seen from above.
    tall : float
        Share of the points that have others well below or above them.
    """

    area: float
    tall: float

    @property
    def has_only_walls(self) -> bool:
        """Whether it is a cloud of upright walls, floor apart."""
        return self.area <= _MOST_AREA and self.tall >= _LEAST_TALL


def uprightness(points: Floats) -> Uprightness:
    """How much of a cloud is upright, the floor apart, as seen on a coarse map from above.

    Parameters
    ----------
    points : (n, 3) float64, metres
        z is up. Takes some 60 bytes a point.

    Returns
    -------
    Uprightness

    Examples
    --------
    >>> import numpy as np
    >>> from primfit.clouds.upright import uprightness
    >>> u, v = np.random.default_rng(1).uniform(size=(2, 5000))
    >>> wall, roof = np.column_stack([u, 0 * u, v]), np.column_stack([u, v, u])
    >>> uprightness(wall).has_only_walls, uprightness(roof).has_only_walls
    (True, False)
    """
    # Copies of points would make the map finer than what it shows.
    if len(np.unique(points[:, 0])) < 0.9 * len(points):
        points = np.unique(points, axis=0)
    low, high = np.quantile(points, _EDGES, axis=0)
    inside = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(inside):
        inside = inside[inside[:, 2] > _top_of_floor(inside[:, 2], low[2], high[2])]
    if not len(inside):
        return Uprightness(np.nan, np.nan)
    local = inside - inside.min(axis=0)
    width, depth, height = local.max(axis=0)
    spread = np.sqrt(_POINTS_A_CELL * width * depth / len(local))
    cell = max(width / _CELLS, depth / _CELLS, spread)
    if cell == 0.0 or height == 0.0:
        return Uprightness(np.nan, np.nan)
    column, row = (local[:, :2] / cell).astype(int).T
    n_columns = int(column.max()) + 1
    at = row * n_columns + column
    counts = np.bincount(at, minlength=(int(row.max()) + 1) * n_columns)
    filled = counts >= max(1.0, _FEW * np.median(counts[counts > 0]))
    around = uniform_filter(filled.reshape(-1, n_columns).astype(float), _WINDOW, mode="constant")
    area = (around.ravel()[filled] > 1.0 - 0.5 / _WINDOW**2).mean()
    lowest, highest = np.full(len(counts), np.inf), np.full(len(counts), -np.inf)
    np.minimum.at(lowest, at, local[:, 2])
    np.maximum.at(highest, at, local[:, 2])
    tall = highest[filled] - lowest[filled] > _TALL * height
    return Uprightness(float(area), float(np.average(tall, weights=counts[filled])))


def _top_of_floor(z: Floats, low: float, high: float) -> float:
    """Upper end of the lowest level where points crowd; below all points where there is none."""
    counts, edges = np.histogram(z, _CELLS, (low, high))
    crowded = counts > _CROWDED * max(np.median(counts), 1.0)
    lowest = crowded[: _CELLS // 5]
    if not lowest.any():
        return -np.inf
    first = int(np.argmax(lowest))
    return float(edges[first + int(np.argmin(np.append(crowded[first:], False)))])
