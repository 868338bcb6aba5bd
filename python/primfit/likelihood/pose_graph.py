"""What is known of the poses before any beam: each by itself, or each step from one to the next.

The normal equations of such poses are blocks of three beside the diagonal, so they are eliminated
by a banded Cholesky factorisation, whatever their number. Dellaert, Kaess: Factor graphs for robot
perception, Foundations and Trends in Robotics 6, 2017.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solveh_banded

from primfit._check import Floats
from primfit.geometry.motions import Motion, turned, wrapped
from primfit.scans.path_errors import steps_of

_HELD = 1e-9
"""Standard deviation of what is exact, metres and radians: ranges tell no pose to a thousandth of
a micrometre."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """A symmetric matrix of the poses: blocks on the diagonal, and those of successive poses.

    Attributes
    ----------
    diagonal : (p, 3, 3) float64
    below : (p - 1, 3, 3) float64 or None
        Rows of pose i + 1, columns of pose i; None for zero.
    """

    diagonal: Floats
    below: Floats | None = None

    def plus(self, diagonal: Floats) -> Blocks:
        """With more on the diagonal."""
        return Blocks(self.diagonal + diagonal, self.below)

    def solve(self, right: Floats) -> Floats:
        """What times the matrix is a right side (p, 3, k)."""
        p, _, k = right.shape
        width = 3 if self.below is None else 6
        band = np.zeros((width, 3 * p))
        for i in range(3):
            for j in range(3):
                if i >= j:
                    band[i - j, j::3] = self.diagonal[:, i, j]
                if self.below is not None:
                    band[3 + i - j, j : 3 * (p - 1) : 3] = self.below[:, i, j]
        solution: Floats = solveh_banded(band, right.reshape(3 * p, k), lower=True)
        return solution.reshape(p, 3, k)

    def inverse_diagonal(self) -> Floats:
        """Blocks (p, 3, 3) on the diagonal of the inverse: what comes from either side adds."""
        if self.below is None:
            return _inverses(self.diagonal)
        p = len(self.diagonal)
        forward, backward = self.diagonal.copy(), self.diagonal.copy()
        for i in range(1, p):
            b = self.below[i - 1]
            forward[i] -= b @ np.linalg.solve(forward[i - 1], b.T)
        for i in range(p - 2, -1, -1):
            b = self.below[i]
            backward[i] -= b.T @ np.linalg.solve(backward[i + 1], b)
        return _inverses(forward + backward - self.diagonal)


def _inverses(blocks: Floats) -> Floats:
    return np.asarray(np.linalg.inv(blocks), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """Poses as they are believed, and how well.

    Attributes
    ----------
    believed : (p, 3) float64
        x, y, metres, and yaw, radians.
    sigmas : (p, 3) or (p - 1, 3) float64
        Standard deviations of each pose by itself, or of each step in the robot's frame.
    is_chain : bool
        Whether steps are known: then the first pose is exact, as it says where the map is.
    """

    believed: Floats
    sigmas: Floats
    is_chain: bool

    @cached_property
    def _steps(self) -> Floats:
        return steps_of(self.believed)

    @cached_property
    def _scales(self) -> Floats:
        return np.maximum(self.sigmas, _HELD)

    def costs(self, poses: Floats) -> Floats:
        """Half the squared distance (p,) from what is believed, in sigmas; of steps half each."""
        if not self.is_chain:
            return 0.5 * (self._off(poses) ** 2).sum(axis=1)
        each = 0.25 * (self._step_off(poses) ** 2).sum(axis=1)
        held = 0.5 * (((poses[0] - self.believed[0]) / _HELD) ** 2).sum()
        costs = np.append(each, 0.0) + np.append(0.0, each)
        costs[0] += held
        return costs

    def _off(self, poses: Floats) -> Floats:
        off = poses - self.believed
        off[:, 2] = wrapped(off[:, 2])
        return off / self._scales

    def _step_off(self, poses: Floats) -> Floats:
        off = steps_of(poses) - self._steps
        off[:, 2] = wrapped(off[:, 2])
        return off / self._scales

    def normal(self, poses: Floats) -> tuple[Blocks, Floats]:
        """Information, and the way downhill (p, 3)."""
        if not self.is_chain:
            information = np.zeros((len(poses), 3, 3))
            information[:, [0, 1, 2], [0, 1, 2]] = self._scales**-2
            return Blocks(information), -self._off(poses) / self._scales
        before, after = self._step_slopes(poses)
        off = self._step_off(poses)
        p = len(poses)
        information, descent = np.zeros((p, 3, 3)), np.zeros((p, 3))
        information[:-1] += before.transpose(0, 2, 1) @ before
        information[1:] += after.transpose(0, 2, 1) @ after
        information[0] += np.eye(3) / _HELD**2
        descent[:-1] -= np.einsum("pij,pi->pj", before, off)
        descent[1:] -= np.einsum("pij,pi->pj", after, off)
        descent[0] -= (poses[0] - self.believed[0]) / _HELD**2
        return Blocks(information, after.transpose(0, 2, 1) @ before), descent

    def _step_slopes(self, poses: Floats) -> tuple[Floats, Floats]:
        """How steps in sigmas (p - 1, 3) change with the pose before and with that after."""
        steps, yaw = steps_of(poses), poses[:-1, 2]
        p = len(steps)
        before, after = np.zeros((p, 3, 3)), np.zeros((p, 3, 3))
        after[:, :2, 0] = turned(np.tile([1.0, 0.0], (p, 1)), -yaw)
        after[:, :2, 1] = turned(np.tile([0.0, 1.0], (p, 1)), -yaw)
        after[:, 2, 2] = 1.0
        before[:, :, :] = -after
        before[:, 0, 2], before[:, 1, 2] = steps[:, 1], -steps[:, 0]
        return before / self._scales[:, :, None], after / self._scales[:, :, None]

    def motion(self, poses: Floats) -> Motion:
        """The rigid motion of all poses that agrees best with what is believed, by one step.

        None where steps are known: the first pose says where the map is.
        """
        if self.is_chain:
            return Motion(0.0, np.zeros(2))
        blocks, descent = self.normal(poses)
        middle = poses[:, :2].mean(axis=0)
        slopes = np.tile(np.eye(3), (len(poses), 1, 1))
        slopes[:, :2, 2] = (poses[:, :2] - middle)[:, ::-1] * [-1.0, 1.0]
        information = np.einsum("pia,pij,pjb->ab", slopes, blocks.diagonal, slopes)
        step = np.linalg.solve(information, np.einsum("pia,pi->a", slopes, descent))
        turn = float(step[2])
        return Motion(turn, middle + step[:2] - turned(middle[None], turn)[0])

    @cached_property
    def covariances(self) -> Floats:
        """Covariance (p, 3, 3) of each pose as believed."""
        return self.normal(self.believed)[0].inverse_diagonal()

    def alone(self, poses: Floats) -> tuple[Floats, Floats]:
        """Place of each pose (p, 3) by its neighbours alone, and its covariance (p, 3, 3)."""
        blocks, descent = self.normal(poses)
        covariances = _inverses(blocks.diagonal)
        return poses + np.einsum("pij,pj->pi", covariances, descent), covariances
