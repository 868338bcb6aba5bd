"""Poses between those that are recorded, and along the trees of frames of ROS (TF)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from primfit._check import Bools, Floats

PosesAt = Callable[[Floats], tuple[Bools, Floats]]
"""Of times (n,), seconds: which have a pose (n,), and these (m, 4, 4)."""


def between(stamps: Any, places: Any, quaternions: Any) -> PosesAt:
    """Poses between those at given times: places linearly, turns along the shortest way.

    Parameters
    ----------
    stamps : (k,) float64, seconds
        In any order; of equal ones the first counts.
    places : (k, 3) float64, metres
    quaternions : (k, 4) float64
        x, y, z, w.
    """
    from scipy.spatial.transform import Rotation, Slerp

    stamps, first = np.unique(stamps, return_index=True)
    places = np.asarray(places, dtype=np.float64)[first]
    turns = Rotation.from_quat(np.asarray(quaternions, dtype=np.float64)[first])
    turn_at = Slerp(stamps, turns) if len(stamps) > 1 else lambda times: turns[[0] * len(times)]

    def poses_at(times: Floats) -> tuple[Bools, Floats]:
        is_known = (times >= stamps[0]) & (times <= stamps[-1])
        times = times[is_known]
        transforms = np.zeros((len(times), 4, 4))
        transforms[:, 3, 3] = 1.0
        if len(times):
            transforms[:, :3, :3] = turn_at(times).as_matrix()
            for k in range(3):
                transforms[:, k, 3] = np.interp(times, stamps, places[:, k])
        return is_known, transforms

    return poses_at


class FrameTree:
    """Frames, each with the pose in its parent: at some times, or, where static, at all.

    Parameters
    ----------
    transforms : iterable of (TransformStamped, bool)
        And whether it is static.

    Raises
    ------
    ValueError
        When a frame has two parents, or is its own ancestor.
    """

    def __init__(self, transforms: Iterable[tuple[Any, bool]]) -> None:
        self._parents: dict[str, str] = {}
        recorded: dict[str, list[tuple[float, list[float], list[float]]]] = {}
        static: set[str] = set()
        for each, is_static in transforms:
            child, parent = _name(each.child_frame_id), _name(each.header.frame_id)
            if self._parents.setdefault(child, parent) != parent:
                raise ValueError(
                    f"frame {child!r} has two parents, {self._parents[child]!r} and {parent!r}"
                )
            if is_static:
                static.add(child)
                recorded[child] = []
            place, turn = each.transform.translation, each.transform.rotation
            stamp = each.header.stamp
            recorded.setdefault(child, []).append(
                (
                    stamp.sec + 1e-9 * stamp.nanosec,
                    [place.x, place.y, place.z],
                    [turn.x, turn.y, turn.z, turn.w],
                )
            )
        self._poses = {
            child: (_always if child in static else between)(*zip(*of_child, strict=True))
            for child, of_child in recorded.items()
        }

    def __str__(self) -> str:
        return ", ".join(sorted(f"{parent} -> {child}" for child, parent in self._parents.items()))

    def chain(self, frame: str) -> list[str]:
        """A frame, its parent, and so on to the root."""
        names = [_name(frame)]
        while names[-1] in self._parents:
            names.append(self._parents[names[-1]])
            if names[-1] in names[:-1]:
                raise ValueError(f"frame {names[-1]!r} is its own ancestor")
        return names

    def poses(self, frame: str, fixed: str) -> PosesAt:
        """Poses of a frame in another.

        Raises
        ------
        ValueError
            When nothing connects them.
        """
        upward, downward = self.chain(frame), self.chain(fixed)
        if upward[-1] != downward[-1]:
            raise ValueError(
                f"no transforms lead from {_name(frame)!r} to {_name(fixed)!r}; those recorded "
                f"are {self}"
            )
        while upward and downward and upward[-1] == downward[-1]:
            upward.pop()
            downward.pop()

        def poses_at(times: Floats) -> tuple[Bools, Floats]:
            is_known = np.ones(len(times), dtype=bool)
            for name in (*upward, *downward):
                is_known &= self._poses[name](times)[0]
            some = times[is_known]
            transforms = np.tile(np.eye(4), (len(some), 1, 1))
            for name in downward:
                transforms = transforms @ np.linalg.inv(self._poses[name](some)[1])
            for name in reversed(upward):
                transforms = transforms @ self._poses[name](some)[1]
            return is_known, transforms

        return poses_at


def _always(_: Any, places: Any, quaternions: Any) -> PosesAt:
    """The last one of some poses at any time."""
    (pose,) = between([0.0], places[-1:], quaternions[-1:])(np.zeros(1))[1]

    def poses_at(times: Floats) -> tuple[Bools, Floats]:
        return np.ones(len(times), dtype=bool), np.broadcast_to(pose, (len(times), 4, 4))

    return poses_at


def _name(frame: str) -> str:
    """ROS 1 may begin names of frames with a slash."""
    return frame.removeprefix("/")
