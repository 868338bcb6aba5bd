"""Clouds that came out of a depth image: their own coordinates tell where the camera was."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats

_ROUNDING = 1e-5
"""Differences of x / z that are none, over the greatest: those of coordinates in float32 are up to
2e-7, and an image has fewer than 10 000 columns."""

_OFF = 0.02
"""How far steps between columns may be off whole numbers of them, in columns."""

_FILLED = 0.05
"""Share of the pixels of their frame that must have a point: what lies askew in it has more, and
columns that are none, of a cloud that was moved, are many times as many."""

_FEWEST = 8
"""Columns and rows that must be seen: fewer may be a chance."""


def is_of_pinhole(points: Floats) -> bool:
    """Whether points (n, 3) are those of pixels of a camera in the origin that looks along z.

    Then x / z and y / z are whole numbers of pixels, and each pixel has one point. No other sensor
    leaves that in its points, and no scene but one that lies across the z axis.

    Examples
    --------
    >>> import numpy as np
    >>> from primfit.clouds.pinhole import is_of_pinhole
    >>> v, u = np.mgrid[:20, :30]
    >>> depth = 1.0 + 0.01 * u + 0.02 * v
    >>> points = np.stack([depth * u / 500.0, depth * v / 500.0, depth], axis=-1).reshape(-1, 3)
    >>> is_of_pinhole(points), is_of_pinhole(points + 0.1)
    (True, False)
    """
    z = points[:, 2]
    if not len(z) or z.min() * z.max() <= 0.0 or np.ptp(z) <= _ROUNDING * np.abs(z).max():
        return False
    columns, rows = (_columns(points[:, k] / z) for k in (0, 1))
    if columns is None or rows is None:
        return False
    frame = (1.0 + np.ptp(columns)) * (1.0 + np.ptp(rows))
    if len(points) < _FILLED * frame:
        return False
    return len(np.unique(np.column_stack([columns, rows]), axis=0)) == len(points)


def _columns(places: Floats) -> Floats | None:
    """Whole number of the column of each place, when there are columns."""
    order = np.argsort(places, kind="stable")
    steps = np.diff(places[order])
    is_next = steps > _ROUNDING * np.abs(places).max()
    n_columns = 1 + int(is_next.sum())
    if not _FEWEST <= n_columns <= len(places) // _FEWEST:
        return None
    whole = steps[is_next] / steps[is_next].min()
    if np.abs(whole - np.rint(whole)).max() > _OFF:
        return None
    columns = np.empty(len(places))
    numbers = np.zeros(len(steps))
    numbers[is_next] = np.rint(whole)
    columns[order] = np.concatenate([[0.0], np.cumsum(numbers)])
    return columns
