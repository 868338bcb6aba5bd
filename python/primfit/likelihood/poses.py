"""Detection by the likelihood of all ranges where the poses are not exact.

Poses and map are estimated together: first with the room alone, whose walls tell the headings
before any solid is sought; then with the solids that are found at the poses known by then; and
again, once these have told the poses better. What is reported is where all ranges agree best, with
the covariance of the map after the poses were eliminated.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from primfit._check import Bools, Floats, Ints
from primfit.likelihood.beam_model import BeamModel
from primfit.likelihood.bundle import Problem, Robust, settled, sharpened
from primfit.likelihood.candidates import beams_near, tolerance_of
from primfit.likelihood.environment import (
    find_room,
    initial_scene,
    level_floor,
    limits_of,
    measure_noise,
)
from primfit.likelihood.final_fit import model_error
from primfit.likelihood.hypotheses import Hypothesis
from primfit.likelihood.incidence import Divergence, with_divergence
from primfit.likelihood.joint_selection import (
    is_well_known,
    mended,
    simplest_kinds,
    with_two_sizes,
)
from primfit.likelihood.model_selection import fit_regions, sample_candidates
from primfit.likelihood.refinement import merge_overlapping, prune
from primfit.likelihood.report import to_detection
from primfit.likelihood.scene import Recording, Scene
from primfit.likelihood.settings import LikelihoodSettings
from primfit.likelihood.space_carving import carve, with_room
from primfit.likelihood.tracks import Track
from primfit.results import Detection

_OUTSIDE = 3.0
"""Standard deviations by which a robot that is within a room may seem to be outside."""


@dataclass(frozen=True, eq=False)
class Task:
    """What does not change while poses and map are sought.

    Attributes
    ----------
    spread : float or (n,) float64, metres
        Noise of the ranges.
    measure_sigma : bool
        Whether it is to be measured once the scene is known.
    free : tuple of int
        Which of what is common to all beams is sought.
    by_incidence : bool
        Whether noise may grow where beams graze.
    """

    spread: Floats
    measure_sigma: bool
    free: tuple[int, ...]
    by_incidence: bool
    settings: LikelihoodSettings
    rng: np.random.Generator
    n_jobs: int | None


def detect_with_poses(track: Track, task: Task, tell: Any) -> Detection:
    """Solids and poses of a track; `tell` is told of ten stages."""
    scene, problem = _with_room(track, task)
    tell(2)
    for stage in (3, 4, 5):
        covariances = _pose_covariances(problem)
        scene = _found_at(problem, covariances, task, is_first=stage == 3)
        problem = _bundled(problem, scene, covariances, task)
        tell(stage)
        if stage > 3 and _share_of_suspects(problem) < task.settings.poses.most_suspects:
            break
    problem, lost, unfit = _without_lost(problem, task)
    problem, divergence = _measured(problem, task)
    tell(7)
    problem = settled(with_two_sizes(problem), task.settings.poses)
    tell(8)
    repaired = mended(problem, task.rng)
    if repaired is not problem and lost.any():
        # What fitted nothing may fit what was mended.
        repaired, lost, unfit = _without_lost(replace(repaired, lost=None), task)
        repaired = settled(repaired, task.settings.poses)
    problem = simplest_kinds(repaired)
    _warn_of(problem.track.numbers[unfit], len(lost))
    tell(9)
    detection = _reported(problem, lost, task)
    if divergence is not None:
        told = {"divergence": divergence.value, "divergence_sigma": divergence.sigma}
        detection = replace(detection, calibration={**detection.calibration, **told})
    tell(10)
    return detection


def _scene_at(
    track: Track, covariances: Floats, task: Task, some: Bools | None = None
) -> tuple[Scene, bool]:
    """A scene of a track where it is known by now, whose ranges are as exact as its poses."""
    scan = track.moved()
    sigma = np.hypot(task.spread, track.added_sigma(covariances))
    if some is not None:
        rows = np.flatnonzero(track.each(some))
        scan, sigma = scan.select(rows), sigma[rows]
    return initial_scene(scan, sigma, task.settings, task.n_jobs)


def _with_room(track: Track, task: Task) -> tuple[Scene, Problem]:
    """The room alone and the poses that it tells; the solids are outliers to it."""
    covariances = track.graph.covariances
    if task.free:
        covariances = covariances + _by_shared(track, task)
    scene, _ = _scene_at(track, covariances, task)
    slack = _OUTSIDE * float(np.sqrt(np.median(covariances[:, 0, 0] + covariances[:, 1, 1])))
    scene = replace(scene, room=find_room(scene, carve(scene), slack))
    problem = Problem(track, _exact(scene, track, task), task.free)
    if scene.room is None:
        return scene, problem
    how = task.settings.poses
    return scene, sharpened(problem, _blur(track, covariances, problem.scene, how.widest_blur), how)


def _by_shared(track: Track, task: Task) -> Floats:
    """What bias and mount may be off, as a covariance (3, 3) of each pose."""
    sigmas = np.array(task.settings.poses.shared_sigmas)
    sigmas[:3] *= float(np.max(track.scan.ranges[track.scan.is_return]))
    variances = np.where(np.isin(np.arange(4), task.free), sigmas**2, 0.0)
    return np.diag([variances[:2].sum(), variances[0] + variances[2], variances[3]])


def _exact(scene: Scene, track: Track, task: Task) -> Scene:
    """The scene of all beams, as exact as their noise."""
    least = task.settings.noise.least_sigma * scene.model.max_range
    sigma = np.maximum(np.broadcast_to(task.spread, len(track.scan)), least)
    model = BeamModel(
        sigma=sigma,
        min_range=scene.model.min_range,
        max_range=scene.model.max_range,
        beam_limits=limits_of(track.scan, scene.model.min_range, scene.model.max_range),
        settings=task.settings.noise,
    )
    return replace(scene, model=model)


def _blur(track: Track, covariances: Floats, scene: Scene, share: float) -> float:
    """What the poses add to ranges, as a rule, but no more than a share of what is around."""
    added = float(np.median(track.added_sigma(covariances)))
    return min(
        added, share * max(float(np.ptp(each.footprint, axis=0).min()) for each in scene.obstacles)
    )


def _pose_covariances(problem: Problem) -> Floats:
    """Of each pose with the map as it is known by now."""
    how = problem.scene.settings.poses
    if not problem.scene.obstacles:
        return problem.track.graph.covariances
    robust = (0.0, how.soft_scale, how.soft_cut)
    return problem.normal(robust).covariances()[1]


def _found_at(problem: Problem, covariances: Floats, task: Task, *, is_first: bool) -> Scene:
    """Solids at the poses as they are known by now; those that are badly known do not take part."""
    track, rng = problem.track, task.rng
    how = task.settings.poses
    robust = (0.0, how.soft_scale, how.soft_cut)
    some = None if is_first else is_well_known(problem, problem.normal(robust))
    scene, has_floor = _scene_at(track, covariances, task, some)
    space = carve(scene)
    room = problem.scene.room
    scene = replace(scene, room=room if room is not None else find_room(scene, space))
    stride = task.settings.selection.stride
    scene = replace(scene, model=measure_noise(scene, False, stride))
    space = with_room(space, scene)
    walls = None if scene.room is None else scene.room.fit.footprint
    scene = scene.with_solids([Hypothesis(region) for region in space.regions(walls)])
    scene = fit_regions(scene)
    missed = task.settings.refinement.missed_factor * task.settings.refinement.misfit
    scene = prune(scene, missed)
    if has_floor:
        scene = replace(scene, floor_z=level_floor(scene, stride)[0])
    if not is_first:
        scene = sample_candidates(scene, rng)
        scene = merge_overlapping(scene, rng)
        scene = prune(scene)
    return scene


def _bundled(problem: Problem, scene: Scene, covariances: Floats, task: Task) -> Problem:
    """Poses, room and solids together, poses that fit nothing sought anew."""
    how = task.settings.poses
    exact = _exact(scene, problem.track, task)
    problem = Problem(problem.track, replace(exact, recording=problem.scene.recording), task.free)
    if not exact.obstacles:
        return problem
    blur = _blur(problem.track, covariances, exact, how.widest_blur)
    problem = _sought_anew(problem, blur, task.rng)
    return sharpened(problem, blur, how)


def _sought_anew(problem: Problem, blur: float, rng: np.random.Generator) -> Problem:
    """Poses whose beams cost much more than the others' where draws of their prior cost least.

    The draws and the blur that they leave shrink from round to round.
    """
    how, track = problem.scene.settings.poses, problem.track
    firm = np.inf, how.cut
    here = problem.normal((blur, *firm))
    suspects = np.flatnonzero(problem.is_suspect(here.beam_costs))
    if not len(suspects):
        return problem
    centers, covariances = track.graph.alone(track.poses)
    roots = np.linalg.cholesky(covariances[suspects])
    best, spread, coarse = centers[suspects], 1.0, blur
    n_draws = int(np.clip(how.search_places // len(suspects), *how.search_draws))
    # As far as the nearest of the draws is from the best place in three dimensions.
    gap = n_draws ** (-1.0 / 3.0) * float(np.median(track.added_sigma(covariances)))
    for _ in range(how.search_rounds):
        draws = rng.normal(size=(len(suspects), n_draws, 3))
        draws[:, 0] = 0.0
        places = best[:, None] + spread * np.einsum("kij,knj->kni", roots, draws)
        coarse = max(blur, spread * gap)
        costs = _costs_near(problem, suspects, places, centers, covariances, (coarse, *firm))
        best = places[np.arange(len(suspects)), costs.argmin(axis=1)]
        spread *= how.search_shrinking
    both = np.stack([best, track.poses[suspects]], axis=1)
    costs = _costs_near(problem, suspects, both, centers, covariances, (coarse, *firm))
    poses, is_better = track.poses.copy(), costs[:, 0] < costs[:, 1]
    poses[suspects[is_better]] = best[is_better]
    return problem.at(problem.scene, poses, track.shared)


def _share_of_suspects(problem: Problem) -> float:
    how = problem.scene.settings.poses
    here = problem.normal((0.0, np.inf, how.cut))
    return float(problem.is_suspect(here.beam_costs).mean())


def _costs_near(
    problem: Problem,
    which: Ints,
    places: Floats,
    centers: Floats,
    covariances: Floats,
    robust: Robust,
) -> Floats:
    """What the beams of some poses cost at places (k, n, 3), with what their neighbours say."""
    n = places.shape[1]
    stride = problem.scene.settings.poses.search_stride
    costs = problem.costs_at(np.repeat(which, n), places.reshape(-1, 3), robust, stride)
    off = places - centers[which][:, None]
    information = np.linalg.inv(covariances[which])
    return costs.reshape(-1, n) + 0.5 * np.einsum("kni,kij,knj->kn", off, information, off)


def _without_lost(problem: Problem, task: Task) -> tuple[Problem, Bools, Bools]:
    """Poses that fit worse than the others sought anew, and left out if that did not help.

    Which these are, and of which of them a tenth of the beams fit nothing.
    """
    how = problem.scene.settings.poses
    added = float(np.median(problem.track.added_sigma(problem.track.graph.covariances)))
    problem = _sought_anew(problem, 0.0, task.rng)
    problem = sharpened(problem, how.search_shrinking**how.search_rounds * added, how)
    costs = problem.normal((0.0, np.inf, how.cut)).beam_costs
    lost = problem.is_suspect(costs)
    unfit = lost & (problem.excess(costs) > how.most_lost * 0.5 * how.cut**2)
    return (replace(problem, lost=lost) if lost.any() else problem), lost, unfit


def _warn_of(numbers: Ints, n_poses: int) -> None:
    """Poses whose beams fit nothing."""
    if len(numbers):
        names = ", ".join(map(str, numbers))
        warnings.warn(
            f"the beams of {len(numbers)} of {n_poses} poses fit nothing near where "
            f"they are believed to be, and do not count: poses {names}",
            stacklevel=5,
        )


def _measured(problem: Problem, task: Task) -> tuple[Problem, Divergence | None]:
    """With the noise that residuals have, if it was not given, and by incidence, if wanted."""
    if not (task.measure_sigma or task.by_incidence):
        return problem, None
    scene = replace(problem.scene, recording=Recording.of(problem.track.moved()))
    if task.measure_sigma:
        scene = replace(scene, model=measure_noise(scene, True, 1))
    if not task.by_incidence:
        return replace(problem, scene=scene), None
    model, divergence = with_divergence(scene, task.measure_sigma)
    return replace(problem, scene=replace(scene, model=model)), divergence


def _reported(problem: Problem, lost: Bools, task: Task) -> Detection:
    """What was found, with the covariances after the poses were eliminated."""
    how, track = task.settings.poses, problem.track
    normal = problem.normal((0.0, np.inf, how.cut))
    of_map, of_poses = normal.covariances()
    scene, at, solids = problem.scene, 0, []
    for solid in scene.solids:
        some = slice(at, at + solid.best.fit.shape.n_parameters)
        fit = replace(solid.best.fit, covariance=of_map[some, some])
        solids.append(replace(solid, candidates=(replace(solid.best, fit=fit),)))
        at = some.stop
    room = scene.room
    if room is not None:
        some = slice(at, at + room.fit.shape.n_parameters)
        room = replace(room, fit=replace(room.fit, covariance=of_map[some, some]))
    model = replace(scene.model, sigma=np.hypot(scene.model.sigma, track.added_sigma(of_poses)))
    scan = track.moved()
    scene = replace(
        scene, solids=tuple(solids), room=room, recording=Recording.of(scan), model=model
    )
    scene, floor_sigma = _levelled(scene)
    scene = replace(scene, model=measure_noise(scene, False, 1))
    scene = scene.with_solids([_doubted(scene, i) for i in range(len(scene.solids))])
    sigma = float(np.median(problem.scene.model.sigma))
    detection = to_detection(scene, floor_sigma, sigma, ())
    n_map = of_map.shape[0] - len(problem.free)
    shared = np.sqrt(np.diag(of_map)[n_map:])
    names = ("bias", "mount_x", "mount_y", "mount_yaw")
    found = {names[k]: float(track.shared[k]) for k in problem.free}
    found |= {
        f"{names[k]}_sigma": float(sigma) for k, sigma in zip(problem.free, shared, strict=True)
    }
    return replace(
        detection,
        path=track.path,
        path_covariance=_by_path(track, of_poses),
        lost_poses=tuple(int(k) for k in track.numbers[lost]),
        calibration=found,
    )


def _doubted(scene: Scene, i: int) -> Hypothesis:
    """A solid with what its walls may be off its shape, as far as the beams leave that open."""
    solid, how = scene.solids[i], scene.settings
    beams = beams_near(scene, i, 1, how.sampling.most_beams)
    error, doubt = model_error(beams, solid.best.fit, solid.top)
    most = how.fitting.model_blur * tolerance_of(scene, solid)
    return replace(solid, model_error=min(error, most), doubt=min(doubt, most))


def _levelled(scene: Scene) -> tuple[Scene, float | None]:
    """The scene with the floor where its beams say, and the standard deviation of that."""
    down = scene.scan.is_return & (scene.scan.directions[:, 2] < 0.0)
    if not down.any():
        return scene, None
    floor_z, sigma = level_floor(scene, 1)
    if not np.isfinite(sigma):
        return scene, None
    return replace(scene, floor_z=floor_z), sigma


def _by_path(track: Track, covariances: Floats) -> Floats:
    """Covariances row by row of the path; NaN for poses without beams."""
    if track.scan.path is None:
        return covariances
    rows = np.full((len(track.scan.path), 3, 3), np.nan)
    rows[track.numbers] = covariances
    return rows
