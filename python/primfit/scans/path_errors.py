"""Where a robot believes it was: its true path with the errors of a compass or of its wheels."""

from __future__ import annotations

from typing import Any

import numpy as np

from primfit._check import Floats, check_finite
from primfit.geometry.motions import turned, wrapped


def as_pose_sigmas(name: str, values: Any) -> Floats:
    """Standard deviations (3,) along x, y and in yaw of (position, heading) or of three numbers.

    Raises
    ------
    ValueError
        When there are not two or three, or one is negative or not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape not in ((2,), (3,)):
        raise ValueError(
            f"{name} must be (position, heading) in metres and radians, or (x, y, heading), not of "
            f"shape {array.shape}"
        )
    check_finite(name, array)
    if (array < 0.0).any():
        raise ValueError(f"{name} must be at least 0, not {array.tolist()}")
    return array if len(array) == 3 else array[[0, 0, 1]]


def misplaced(poses: Floats, sigmas: Floats, rng: np.random.Generator) -> Floats:
    """Poses (p, 3), each with an error of its own."""
    return poses + sigmas * rng.normal(size=poses.shape)


def drifted(poses: Floats, sigmas: Floats, rng: np.random.Generator) -> Floats:
    """Poses (p, 3) added up from steps with errors in the robot's frame; the first one is exact."""
    steps = steps_of(poses) + sigmas * rng.normal(size=(len(poses) - 1, 3))
    return added_up(poses[0], steps)


def steps_of(poses: Floats) -> Floats:
    """Steps (p - 1, 3) from each pose to the next, in the frame of the former."""
    moves = turned(np.diff(poses[:, :2], axis=0), -poses[:-1, 2])
    return np.column_stack([moves, wrapped(np.diff(poses[:, 2]))])


def added_up(first: Floats, steps: Floats) -> Floats:
    """Poses (p, 3) that begin at the first one and follow from each other by steps (p - 1, 3)."""
    yaw = first[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    places = first[:2] + np.concatenate(
        [np.zeros((1, 2)), np.cumsum(turned(steps[:, :2], yaw[:-1]), axis=0)]
    )
    return np.column_stack([places, yaw])


def carried_along(path: Floats, used: np.ndarray, believed: Floats) -> Floats:
    """A whole path (n, 3) of which some poses are believed to be elsewhere.

    The others are moved as the last one before them was, those before all as the first.
    """
    last = np.maximum(np.searchsorted(used, np.arange(len(path)), side="right") - 1, 0)
    turn = believed[last, 2] - path[used[last], 2]
    places = believed[last, :2] + turned(path[:, :2] - path[used[last], :2], turn)
    moved = np.column_stack([places, path[:, 2] + turn])
    moved[used] = believed
    return moved
