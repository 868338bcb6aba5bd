"""The beams of a scan as its robot carries them, so that they go with its poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from primfit import _primfit
from primfit._check import Floats, Ints, check_finite
from primfit.geometry.motions import turned
from primfit.likelihood.beam_model import BeamModel
from primfit.likelihood.pose_graph import PoseGraph
from primfit.scans.scan import Scan

T = TypeVar("T", bound=np.generic)

SHARED = {"bias": (0,), "mount": (1, 2, 3)}
"""What is common to all beams, by name, and where it is among the four numbers: bias of the ranges,
x, y and turn of the mount."""

_FEWEST = 3
"""Beams a pose, as a rule, below which they do not tell it."""


@dataclass(frozen=True, eq=False)
class Track:
    """Poses, and the beams of each in the frame of the robot.

    Attributes
    ----------
    scan : Scan
        As believed.
    order : (n,) int64
        Rows of the scan, pose by pose.
    starts : (p + 1,) int64
        First of these of each pose, and their number.
    numbers : (p,) int64
        `pose_index` of each pose.
    origins, directions : (n, 3) float64
        In the robot's frame, in that order; z as in the world.
    graph : PoseGraph
        What is known of the poses beforehand.
    poses : (p, 3) float64
        As known by now.
    shared : (4,) float64
        Bias of the ranges, x and y of the mount, metres, and its turn, radians, as known by now.
    """

    scan: Scan
    order: Ints
    starts: Ints
    numbers: Ints
    origins: Floats
    directions: Floats
    graph: PoseGraph
    poses: Floats
    shared: Floats

    @classmethod
    def of(cls, scan: Scan, pose_sigma: Any, step_sigma: Any) -> Track:
        """The track of a scan, of which poses or steps have standard deviations.

        Raises
        ------
        ValueError
            When it is not known which beams were taken from one pose, or the standard deviations
            are none.
        """
        index = _pose_of_each(scan)
        order = np.argsort(index, kind="stable")
        numbers, firsts = np.unique(index[order], return_index=True)
        starts = np.append(firsts, len(order)).astype(np.int64)
        believed = _believed(scan, order, starts, numbers)
        p = len(believed)
        if step_sigma is None:
            graph = PoseGraph(believed, _sigmas("pose_sigma", pose_sigma, p, numbers), False)
        else:
            graph = PoseGraph(believed, _steps("step_sigma", step_sigma, p), True)
        each = np.repeat(np.arange(p), np.diff(starts))
        yaw = believed[each, 2]
        origins, directions = scan.origins[order], scan.directions[order]
        origins[:, :2] = turned(origins[:, :2] - believed[each, :2], -yaw)
        directions[:, :2] = turned(directions[:, :2], -yaw)
        arrays = order, starts, numbers, origins, directions
        return cls(scan, *arrays, graph, believed, np.zeros(4))

    def moved(self) -> Scan:
        """The scan with the beams where the poses are known to be by now, and without bias."""
        each = np.repeat(np.arange(len(self.poses)), np.diff(self.starts))
        x, y, yaw = self.poses[each].T
        bias, *mount, turn = self.shared
        origins, directions = np.empty_like(self.origins), np.empty_like(self.directions)
        level = turned(self.origins[:, :2] + mount, yaw) + np.column_stack([x, y])
        origins[self.order] = np.column_stack([level, self.origins[:, 2]])
        level = turned(self.directions[:, :2], yaw + turn)
        directions[self.order] = np.column_stack([level, self.directions[:, 2]])
        ranges = self.scan.ranges - bias
        reach = np.where(np.isfinite(ranges), ranges, np.nan)[:, None]
        return replace(
            self.scan,
            points=origins + reach * directions,
            origins=origins,
            directions=directions,
            ranges=ranges,
            path=self.path,
        )

    @property
    def path(self) -> Floats:
        """Poses as known by now, row by `pose_index` where the scan has a path."""
        if self.scan.path is None:
            return self.poses
        path = self.scan.path.copy()
        path[self.numbers] = self.poses
        return path

    @cached_property
    def typical_range(self) -> float:
        """Median of the ranges, metres."""
        ranges = self.scan.ranges
        return float(np.median(ranges[np.isfinite(ranges)]))

    def each(self, values: NDArray[T]) -> NDArray[T]:
        """Values of the poses (p, ...) as values of the scan's rows."""
        spread = np.empty((len(self.order), *values.shape[1:]), dtype=values.dtype)
        spread[self.order] = np.repeat(values, np.diff(self.starts), axis=0)
        return spread

    def core(self, model: BeamModel) -> _primfit.PoseBeams:
        """The kernel of these beams."""
        limits = model.limits(self.order)
        return _primfit.PoseBeams(
            self.starts.tolist(),
            self.origins,
            self.directions,
            np.ascontiguousarray(self.scan.ranges[self.order]),
            np.ascontiguousarray(model.sigma[self.order]),
            np.ascontiguousarray(limits) if isinstance(limits, np.ndarray) else limits,
        )

    def added_sigma(self, covariances: Floats) -> Floats:
        """Standard deviation (n,) of the range of each row that covariances of poses add, metres.

        As of a wall that the beam meets at right angles, and of one along it, in the mean.
        """
        place = self.each(0.5 * (covariances[:, 0, 0] + covariances[:, 1, 1]))
        turn = self.each(covariances[:, 2, 2])
        ranges = self.scan.ranges
        reach = np.where(np.isfinite(ranges), ranges, np.nanmax(ranges[np.isfinite(ranges)]))
        return np.sqrt(place + reach**2 * turn)


def _pose_of_each(scan: Scan) -> Ints:
    """Which pose each row was taken from: as the scan says, or by where the sensor was."""
    if scan.pose_index is not None:
        return scan.pose_index
    moves = (np.diff(scan.origins, axis=0) != 0.0).any(axis=1)
    index = np.concatenate([[0], np.cumsum(moves)])
    if len(scan) < _FEWEST * (index[-1] + 1):
        raise ValueError(
            "scan must say which beams were taken from one pose (pose_index), since their origins "
            f"are {index[-1] + 1} for {len(scan)} beams; give pose_index to Scan.from_rays"
        )
    return index


def _believed(scan: Scan, order: Ints, starts: Ints, numbers: Ints) -> Floats:
    """The path where the scan has one; else the sensor's places, and where their first beams go.

    Only how poses differ from what they are believed to be matters, so any beam may be ahead.
    """
    if scan.path is not None:
        return scan.path[numbers]
    firsts = order[starts[:-1]]
    x, y, _ = scan.directions[firsts].T
    return np.column_stack([scan.origins[firsts, :2], np.arctan2(y, x)])


def _sigmas(name: str, values: ArrayLike, p: int, numbers: Ints) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 2 and len(array) != p and len(array) > numbers.max():
        array = array[numbers]
    return _rows(name, array, p, "pose")


def _steps(name: str, values: ArrayLike, p: int) -> Floats:
    return _rows(name, np.asarray(values, dtype=np.float64), p - 1, "step")


def _rows(name: str, array: Floats, p: int, what: str) -> Floats:
    """Standard deviations (p, 3) from (position, heading) or (x, y, heading) of all or of each."""
    if array.shape not in ((2,), (3,), (p, 2), (p, 3)):
        raise ValueError(
            f"{name} must be (position, heading) or (x, y, heading), in metres and radians, for "
            f"all or in a row for each {what}: shape (2,), (3,), ({p}, 2) or ({p}, 3), not "
            f"{array.shape}"
        )
    check_finite(name, array)
    if (array < 0.0).any():
        raise ValueError(f"{name} must be at least 0, not {array.min()}")
    if array.shape[-1] == 2:
        array = array[..., [0, 0, 1]]
    return np.array(np.broadcast_to(array, (p, 3)))
