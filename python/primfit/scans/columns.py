"""What is told of each beam of a scan, checked: limits, noise, places, poses and indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, Ints, as_column, as_rows, check_finite, number


def one_or_each(name: str, values: ArrayLike, n: int) -> Floats:
    """One place for all, or one each, as rows (n, 3)."""
    array = np.asarray(values)
    if array.shape == (3,):
        array = np.broadcast_to(array, (n, 3))
    rows = as_rows(name, array, 3)
    if len(rows) != n:
        raise ValueError(f"{name} must have shape ({n}, 3) or (3,), not {rows.shape}")
    return rows


def range_limits(
    min_range: ArrayLike | None, max_range: ArrayLike | None, n: int
) -> tuple[float | Floats | None, float | Floats | None]:
    """Checked range limits of a sensor or of each of its beams, metres."""
    nearest = None if min_range is None else _limit("min_range", min_range, n, low=0.0)
    farthest = None if max_range is None else _limit("max_range", max_range, n, above=0.0)
    if nearest is None or farthest is None:
        return nearest, farthest
    if isinstance(nearest, float) and isinstance(farthest, float):
        if nearest >= farthest:
            raise ValueError(
                f"min_range must be less than max_range={farthest:g}, not {min_range!r}"
            )
    elif (is_none := np.broadcast_to(nearest >= farthest, n)).any():
        raise ValueError(
            f"min_range must be less than max_range, but row {int(np.argmax(is_none))} is not"
        )
    return nearest, farthest


def _limit(name: str, value: ArrayLike, n: int, **bounds: float) -> float | Floats:
    if np.ndim(value) == 0:
        return number(name, value, **bounds)
    column = np.array(as_column(name, value, n))
    check_finite(name, column)
    if n:
        number(f"{name}, the least of its rows,", column.min(), **bounds)
    return column


def as_sigma(sigma: ArrayLike | None, n: int) -> float | Floats | None:
    """``sigma`` as None, a number or a column (n,) of numbers, none of them negative."""
    if sigma is None:
        return None
    if np.ndim(sigma) == 0:
        return number("sigma", sigma, low=0.0)
    column = as_column("sigma", sigma, n)
    check_finite("sigma", column)
    if (column < 0.0).any():
        raise ValueError(f"sigma must be at least 0, but row {int(np.argmin(column))} is not")
    return np.array(column)


def path_of(path: ArrayLike, pose_index: Ints | None) -> Floats:
    """Checked poses (p, 3) to which all of `pose_index` refer."""
    poses = np.array(as_rows("path", path, 3))
    if pose_index is None:
        raise ValueError("path needs pose_index, which says from which pose each beam was taken")
    if len(pose_index) and not (pose_index.min() >= 0 and pose_index.max() < len(poses)):
        raise ValueError(
            f"pose_index must be rows of path, from 0 to {len(poses) - 1}, not "
            f"{pose_index.min()} to {pose_index.max()}"
        )
    return poses


def indices(name: str, values: ArrayLike | None, n: int) -> Ints | None:
    """Whole numbers (n,) of rows, poses or solids; None when they are not told."""
    if values is None:
        return None
    array = np.asarray(values)
    if array.shape != (n,):
        raise ValueError(f"{name} must have shape ({n},), not {array.shape}")
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name} must be integers, not {array.dtype}")
    return array.astype(np.int64)
