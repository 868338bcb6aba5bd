"""Flat parts of organised clouds: the image of a sensor tells which points are neighbours."""

from __future__ import annotations

import numpy as np

from primfit import _primfit
from primfit._check import Floats, Ints
from primfit.planes.surfaces import FlatParts
from primfit.scans.scan import Scan

_LEAST_SIDE = 8
"""Rows and columns of an image, below which it tells no more than the points by themselves."""

_MOST_EMPTY = 4
"""Pixels of an image for each beam, above which layers and columns are no image."""

_LOOKED_AT, _FAR = 64, 8
"""Rows and columns that tell whether an image is in order, and pixels of a leap along a row."""

_LEAST_ORDER = 0.75
"""Share of pixels whose neighbour is nearer than one some pixels on: of rows without order half, of
an image all but those at edges."""


def image_of(scan: Scan) -> Ints | None:
    """The row of the scan in each pixel (h, w), -1 for none; None when it is no single image."""
    layer, column = scan.layer, scan.column
    if layer is None or column is None or not len(scan):
        return None
    if scan.pose_index is not None and (scan.pose_index != scan.pose_index[0]).any():
        return None
    low, left = int(layer.min()), int(column.min())
    height, width = int(layer.max()) - low + 1, int(column.max()) - left + 1
    if min(height, width) < _LEAST_SIDE or height * width > _MOST_EMPTY * len(scan):
        return None
    pixels = (layer - low) * width + (column - left)
    rows = np.arange(len(scan))
    if len(rows) == height * width and np.array_equal(pixels, rows):
        image = rows.reshape(height, width)
        return image if _is_in_order(scan.points, image) else None
    flat = np.full(height * width, -1, dtype=np.int64)
    flat[pixels] = rows
    # Two beams in one pixel are no image.
    if np.count_nonzero(flat >= 0) < len(scan):
        return None
    image = flat.reshape(height, width)
    return image if _is_in_order(scan.points, image) else None


def _is_in_order(points: Floats, image: Ints) -> bool:
    """Whether pixels that are neighbours are near each other, unlike rows that were only folded."""
    height, width = image.shape
    rows = np.unique(np.linspace(0, height - 2, _LOOKED_AT).astype(int))
    columns = np.unique(np.linspace(0, width - 2, _LOOKED_AT).astype(int))
    at = rows[:, None], columns
    far = min(_FAR, width // 2)
    across = rows[:, None], np.where(columns + far < width, columns + far, columns - far)
    opposite = (rows[:, None] + height // 2) % height, (columns + width // 2) % width
    beside, below = (rows[:, None], columns + 1), (rows[:, None] + 1, columns)
    for near, other in ((beside, across), (below, opposite)):
        known = (image[at] >= 0) & (image[near] >= 0) & (image[other] >= 0)
        here, step, leap = (points[image[each][known]] for each in (at, near, other))
        steps, leaps = (((there - here) ** 2).sum(axis=1) for there in (step, leap))
        told = np.isfinite(steps) & np.isfinite(leaps)
        if np.count_nonzero(steps[told] < leaps[told]) <= _LEAST_ORDER * np.count_nonzero(told):
            return False
    return True


def image_parts(
    points: Floats, image: Ints, sigma: Floats | None = None, n_jobs: int | None = None
) -> FlatParts:
    """Connected flat parts of an organised cloud, without any scale given.

    Cells of the image that are flat grow over cells beside them on the same plane, and merge while
    one plane explains both; then pixels compete. Parts that bend, or go on beyond their border on a
    surface that bends, are none (after Proenca and Gao, "Fast cylinder and plane extraction from
    depth cameras for visual odometry", IROS 2018, which has the cells). The noise comes from second
    differences along rows and columns, which a plane does not have whatever its tilt; steps of
    quantised depth, and errors that neighbours share, are found and raise it.

    Parameters
    ----------
    points : (n, 3) float64, metres
        NaN where there is none.
    image : (h, w) int64
        Row of each pixel, -1 for none. Rows of pixels may be shifted against each other, as those
        of spinning sensors whose beams point to different sides.
    sigma : (n,) float64 or None, metres
        Noise across the surfaces; None is estimated.
    n_jobs : int or None
        Threads; the result does not depend on them.
    """
    rows = image.ravel()
    if len(rows) == len(points) and (rows == np.arange(len(points))).all():
        labels, noise = _primfit.segment_image(
            np.ascontiguousarray(points), image.shape[1], sigma, n_jobs
        )
        return FlatParts(labels, noise, 4, 1, rows)
    pixels = np.where((rows >= 0)[:, None], points[rows], np.nan)
    given = None if sigma is None else np.where(rows >= 0, sigma[rows], 0.0)
    of_pixel, noise_of_pixel = _primfit.segment_image(pixels, image.shape[1], given, n_jobs)
    labels, noise = np.full(len(points), -1), np.zeros(len(points))
    order = rows[rows >= 0]
    labels[order] = of_pixel[rows >= 0]
    noise[order] = noise_of_pixel[rows >= 0]
    return FlatParts(labels, noise, 4, 1, order)
