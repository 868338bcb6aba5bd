"""Poses and map together: Gauss-Newton steps on the ranges of all beams.

The unknowns are the poses (three each), the parameters of room and solids, and, if wanted, what is
common to all beams. The poses are eliminated (Schur complement), so each step solves for the map
alone. At first walls count as blurred by what the poses may be off, which falls from level to level
(Blake, Zisserman: Visual Reconstruction, 1987: graduated non-convexity), and residuals count less
the larger they are; in the end all within four standard deviations count in full.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.likelihood.fitting import Fit
from primfit.likelihood.pose_graph import Blocks
from primfit.likelihood.scene import Scene
from primfit.likelihood.settings import PoseSettings
from primfit.likelihood.tracks import Track

Robust = tuple[float, float, float]
"""Blur across the walls, metres; scale of the weights and cut, in standard deviations."""

_NO_WEIGHT = 1e6
"""Standard deviation, in the sensor's reach, of beams that do not count."""

_LEAST_DAMPING = 1e-6
"""Of a step, as a share of the information: none, but for unknowns of which nothing is told."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Beams by pose, and a scene whose room and solids are sought with the poses.

    Attributes
    ----------
    track : Track
    scene : Scene
        Its scan does not matter, only what beams may meet.
    free : tuple of int
        Which of what is common to all beams is sought.
    lost : (p,) bool
        Poses whose beams do not count.
    """

    track: Track
    scene: Scene
    free: tuple[int, ...] = ()
    lost: Bools | None = None

    @cached_property
    def core(self) -> _primfit.PoseBeams:
        """The kernel, in which the beams of lost poses are as good as none."""
        model = self.scene.model
        if self.lost is not None and self.lost.any():
            sigma = np.where(self.track.each(self.lost), _NO_WEIGHT * model.max_range, model.sigma)
            model = replace(model, sigma=sigma)
        return self.track.core(model)

    @property
    def fits(self) -> list[Fit]:
        """Of the solids, and of the room behind them."""
        fits = [solid.best.fit for solid in self.scene.solids]
        return fits if self.scene.room is None else [*fits, self.scene.room.fit]

    @cached_property
    def prisms(self) -> tuple[Floats, list[int], list[float], list[float], list[bool]]:
        """What beams may meet, for the kernel."""
        obstacles = self.scene.obstacles
        sizes = [len(each.footprint) for each in obstacles]
        corners = np.concatenate([np.zeros((0, 2)), *(each.footprint for each in obstacles)])
        starts = [int(k) for k in np.cumsum([0, *sizes])]
        floor = self.scene.floor_z
        tops = [each.top for each in obstacles]
        is_open = [each.is_open for each in obstacles]
        return corners, starts, [floor] * len(obstacles), tops, is_open

    @cached_property
    def slopes(self) -> Floats:
        """How the ends of each wall move along its normal (w, 2, d) with the parameters."""
        fits = self.fits
        d = sum(fit.shape.n_parameters for fit in fits)
        rows, column = [np.zeros((0, 2, d))], 0
        for fit in fits:
            corners, jacobian = fit.shape.frame(fit.parameters)
            m, k = len(corners), jacobian.shape[1]
            along = corners - np.roll(corners, 1, axis=0)
            normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
            normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
            ends = jacobian.reshape(m, 2, k)
            wall = np.zeros((m, 2, d))
            wall[:, 0, column : column + k] = np.einsum(
                "mi,mik->mk", normal, np.roll(ends, 1, axis=0)
            )
            wall[:, 1, column : column + k] = np.einsum("mi,mik->mk", normal, ends)
            rows.append(wall)
            column += k
        return np.concatenate(rows)

    def costs_at(self, of: Ints, places: Floats, robust: Robust, stride: int) -> Floats:
        """What the beams of some poses cost if these were at some places (k, 3)."""
        return self.core.costs(
            of.tolist(),
            np.ascontiguousarray(places),
            self.prisms,
            self.scene.floor_z,
            self.track.shared.tolist(),
            list(robust),
            stride,
            self.scene.n_jobs,
        )

    def normal(self, robust: Robust) -> Normal:
        """The normal equations here."""
        track = self.track
        costs, numbers, rigid, descents, cross, walls = self.core.sums(
            track.poses,
            self.prisms,
            self.scene.floor_z,
            track.shared.tolist(),
            list(robust),
            self.scene.n_jobs,
        )
        slopes, free = self.slopes, [3 + k for k in self.free]
        d, f = slopes.shape[2], len(free)
        p, w, r, _ = cross.shape
        by_pose = cross.transpose(0, 2, 1, 3).reshape(p * r, 2 * w)
        cross_map = (by_pose @ slopes.reshape(2 * w, d)).reshape(p, r, d)
        with_map = np.concatenate([cross_map[:, :3], rigid[:, :3][:, :, free]], axis=2)
        square = walls[:, [[0, 1], [1, 2]]]
        information = np.zeros((d + f, d + f))
        ends = slopes.reshape(2 * w, d)
        information[:d, :d] = ends.T @ (square @ slopes).reshape(2 * w, d)
        information[d:, :d] = cross_map[:, free].sum(axis=0)
        information[:d, d:] = information[d:, :d].T
        information[d:, d:] = rigid[:, free][:, :, free].sum(axis=0)
        downhill = np.einsum("wsd,ws->d", slopes, walls[:, 3:])
        downhill = np.append(downhill, descents[:, free].sum(axis=0))
        weak = self._weak_prior()
        downhill[d:] -= weak[d:] * track.shared[list(self.free)]
        prior, pull = track.graph.normal(track.poses)
        return Normal(
            costs=costs + track.graph.costs(track.poses),
            beam_costs=costs,
            numbers=numbers,
            poses=prior.plus(rigid[:, :3, :3]),
            pull=pull + descents[:, :3],
            cross=with_map,
            information=information + np.diag(weak),
            downhill=downhill,
        )

    def excess(self, beam_costs: Floats) -> Floats:
        """What the beams of each pose cost beyond those of the others, a beam."""
        each = beam_costs / np.maximum(np.diff(self.track.starts), 1)
        return each - np.median(each)

    def is_suspect(self, beam_costs: Floats) -> Bools:
        """Poses whose beams cost more than the others' by far more than those differ."""
        how, excess = self.scene.settings.poses, self.excess(beam_costs)
        spread = 1.4826 * float(np.median(np.abs(excess)))
        return excess > max(how.suspect_sigmas * spread, how.least_excess)

    def _weak_prior(self) -> Floats:
        """Precision of the map before any beam: nothing is larger than the sensor's reach."""
        d, reach = self.slopes.shape[2], self.scene.model.max_range
        shared = np.array(self.scene.settings.poses.shared_sigmas) * [reach, reach, reach, 1.0]
        return np.append(np.full(d, reach**-2.0), shared[list(self.free)] ** -2.0)

    def stepped(self, map_step: Floats, pose_step: Floats) -> Problem:
        """The same a step further."""
        track, fits, at = self.track, [], 0
        for fit in self.fits:
            n = fit.shape.n_parameters
            fits.append(_moved(fit, map_step[at : at + n]))
            at += n
        shared = track.shared.copy()
        shared[list(self.free)] += map_step[at:]
        return self.at(self._scene_with(fits), track.poses + pose_step, shared)

    def anchored(self) -> Problem:
        """Poses and map moved as a whole to where the poses are believed to be.

        Beams tell nothing of that. Steps that are damped, and a rule to stop that looks at all
        unknowns, would leave these three where they happen to be.
        """
        track = self.track
        motion = track.graph.motion(track.poses)
        poses = np.column_stack([motion.of(track.poses[:, :2]), track.poses[:, 2] + motion.turn])
        fits = [
            replace(fit, parameters=fit.shape.moved(fit.parameters, motion)) for fit in self.fits
        ]
        return self.at(self._scene_with(fits), poses, track.shared)

    def _scene_with(self, fits: list[Fit]) -> Scene:
        """The scene with other parameters of solids and room."""
        scene = self.scene
        solids = []
        for solid, fit in zip(scene.solids, fits, strict=False):
            best = replace(solid.best, fit=fit, best=fit.parameters)
            solids.append(replace(solid, candidates=(best, *solid.candidates[1:])))
        room = scene.room
        if room is not None:
            room = replace(room, fit=fits[-1], best=fits[-1].parameters)
        return replace(scene, solids=tuple(solids), room=room)

    def at(self, scene: Scene, poses: Floats, shared: Floats) -> Problem:
        """The same beams elsewhere, among other things."""
        track = replace(self.track, poses=poses, shared=shared)
        moved = replace(self, track=track, scene=scene)
        if scene.model is self.scene.model:
            vars(moved)["core"] = self.core
        return moved


def _moved(fit: Fit, step: Floats) -> Fit:
    """A shape with other parameters, if they are of its kind; not farther than a quarter of it."""
    reach = 0.25 * float(np.ptp(fit.footprint, axis=0).max())
    _, jacobian = fit.shape.frame(fit.parameters)
    far = np.abs(jacobian @ step).max()
    parameters = fit.parameters + step * min(1.0, reach / max(far, 1e-300))
    if not fit.shape.is_proper(parameters[None])[0]:
        return fit
    return replace(fit, parameters=parameters)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of poses and map.

    Attributes
    ----------
    costs, beam_costs, numbers : (p,) float64
        Of each pose with its prior, and of its beams alone; and how many of these count.
    poses : Blocks
    pull : (p, 3) float64
        Way downhill of the poses.
    cross : (p, 3, d) float64
    information : (d, d) float64
    downhill : (d,) float64
        Way downhill of the map.
    """

    costs: Floats
    beam_costs: Floats
    numbers: Floats
    poses: Blocks
    pull: Floats
    cross: Floats
    information: Floats
    downhill: Floats

    @property
    def cost(self) -> float:
        """Of all."""
        return float(self.costs.sum())

    def steps(self, damping: Floats, map_damping: float) -> tuple[Floats, Floats]:
        """Damped steps of map (d,) and poses (p, 3)."""
        diagonal = np.einsum("pii->pi", self.poses.diagonal)
        more = damping[:, None, None] * diagonal[:, :, None] * np.eye(3)
        poses = self.poses.plus(more)
        solved = poses.solve(np.concatenate([self.cross, self.pull[:, :, None]], axis=2))
        gain, alone = solved[:, :, :-1], solved[:, :, -1]
        information = self.information - _contracted(self.cross, gain)
        information[np.diag_indices_from(information)] += map_damping * np.diag(self.information)
        downhill = self.downhill - np.einsum("prd,pr->d", self.cross, alone)
        step = solve_scaled(information, downhill)
        return step, alone - gain @ step

    def covariances(self) -> tuple[Floats, Floats]:
        """Of the map (d, d), with the poses marginalised, and of each pose (p, 3, 3)."""
        gain = self.poses.solve(self.cross)
        information = self.information - _contracted(self.cross, gain)
        of_map = inverse_scaled(information)
        return of_map, self.poses.inverse_diagonal() + gain @ of_map @ gain.transpose(0, 2, 1)


def _contracted(first: Floats, second: Floats) -> Floats:
    """The sum over poses and their coordinates of products of columns (p, 3, d)."""
    p, r, d = first.shape
    product: Floats = first.reshape(p * r, d).T @ second.reshape(p * r, -1)
    return product


def solve_scaled(matrix: Floats, right: Floats) -> Floats:
    """The solution of symmetric equations whose unknowns have units of their own."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    try:
        factor = cho_factor(matrix * np.outer(scale, scale), lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return inverse_scaled(matrix) @ right
    solution: Floats = scale * cho_solve(factor, scale * right, check_finite=False)
    return solution


def inverse_scaled(matrix: Floats) -> Floats:
    """Inverse of an information matrix of which rounding may have left little."""
    if not len(matrix):
        return matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    root = vectors / np.sqrt(np.maximum(values, 1e-12)) / scale[:, None]
    return root @ root.T


def descend(problem: Problem, robust: Robust, most_steps: int, how: PoseSettings) -> Problem:
    """Damped Gauss-Newton steps to where the residuals balance.

    Costs jump where a beam leaves the silhouette of a solid, so they may rise a little in a step. A
    pose whose own cost rises by more goes back and is damped: what others need shall not hurl it
    away.
    """
    damping, map_damping = np.full(len(problem.track.poses), _LEAST_DAMPING), _LEAST_DAMPING
    longest = how.longest_step * np.sqrt(np.einsum("pii->pi", problem.track.graph.covariances))
    slack = how.rise * np.diff(problem.track.starts) * _most(robust)
    here = problem.normal(robust)
    n_unknowns = here.pull.size + len(here.downhill)
    for _ in range(most_steps):
        map_step, pose_step = here.steps(damping, map_damping)
        promise = float(map_step @ here.downhill + (pose_step * here.pull).sum())
        excess = np.abs(pose_step / np.maximum(longest, 1e-300)).max(axis=1)
        pose_step /= np.maximum(excess, 1.0)[:, None]
        trial = problem.stepped(map_step, pose_step)
        there = trial.normal(robust)
        rose = there.costs > here.costs + slack
        if rose.any():
            damping[rose] = np.maximum(10.0 * damping[rose], 1e-2)
            poses = np.where(rose[:, None], problem.track.poses, trial.track.poses)
            trial = trial.at(trial.scene, poses, trial.track.shared)
            there = trial.normal(robust)
        if there.cost > here.cost + slack.mean() * np.sqrt(len(slack)):
            map_damping = max(10.0 * map_damping, 1e-2)
            damping = np.maximum(10.0 * damping, 1e-2)
            continue
        damping[~rose] = np.maximum(damping[~rose] / 10.0, _LEAST_DAMPING)
        map_damping = max(map_damping / 10.0, _LEAST_DAMPING)
        problem, here = trial, there
        if promise < how.balance**2 * n_unknowns:
            break
    return problem.anchored()


def _most(robust: Robust) -> float:
    """Most that a beam costs."""
    _, scale, cut = robust
    return 0.5 * cut**2 / (1.0 + (cut / scale) ** 2)


def levels(start: float, end: float, factor: float) -> Iterable[float]:
    """Blurs from the first one down to the last."""
    while start > end:
        yield start
        start /= factor


def sharpened(problem: Problem, blur: float, how: PoseSettings) -> Problem:
    """Poses and map from as blurred as they are known to as sharp as the ranges are."""
    for each in levels(blur, 0.3 * problem.scene.model.typical_sigma, how.sharpening):
        problem = descend(problem, (each, how.soft_scale, how.soft_cut), how.level_steps, how)
    return descend(problem, (0.0, how.soft_scale, how.soft_cut), how.level_steps, how)


def settled(problem: Problem, how: PoseSettings) -> Problem:
    """Where all beams within a few standard deviations agree best."""
    return descend(problem, (0.0, np.inf, how.cut), how.last_steps, how)
