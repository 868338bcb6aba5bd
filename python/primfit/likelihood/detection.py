"""Detection by the likelihood of all ranges.

A beam meets the nearest surface of the scene; its measured range is that range with Gaussian noise
along the beam, and a beam whose true range is outside the sensor's limits comes back empty. So
every beam speaks: those that ended on a solid by their range, those that passed or were stopped by
their silhouette. A few of any kind may be outliers; their cost is capped.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import choice, generator, instance, n_jobs_or_none, number
from primfit._progress import Progress, reporting
from primfit.clouds.noise import estimate_range_sigma
from primfit.likelihood.consistency import find_contradictions
from primfit.likelihood.environment import (
    find_room,
    initial_scene,
    measure_noise,
    refine_environment,
)
from primfit.likelihood.hypotheses import Hypothesis
from primfit.likelihood.model_selection import fit_regions, sample_candidates
from primfit.likelihood.poses import Task, detect_with_poses
from primfit.likelihood.refinement import finish, merge_overlapping, prune, refine
from primfit.likelihood.report import to_detection
from primfit.likelihood.settings import LikelihoodSettings
from primfit.likelihood.space_carving import carve, with_room
from primfit.likelihood.tracks import SHARED, Track
from primfit.results import Detection
from primfit.scans.columns import as_sigma
from primfit.scans.scan import Scan

_INCIDENCE = "incidence"
"""Name of what is estimated of the noise of beams that graze."""


def detect_likelihood(
    scan: Scan,
    rng: Any = None,
    *,
    sigma: Any = None,
    tolerance: float | None = None,
    settings: LikelihoodSettings | None = None,
    pose_sigma: ArrayLike | None = None,
    step_sigma: ArrayLike | None = None,
    estimate: Collection[str] = (),
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Detection:
    """Planes and solids by the likelihood of all ranges.

    Space that beams passed is carved away; each piece that is left is the region of a solid.
    Around a region, regular polygons, rectangle, stars, circle and ellipse compete by the evidence
    for each, fitted to the ranges by Gauss-Newton steps and then sampled by the exact likelihood of
    the beams that end on it, pass it, or pass over it. Where none of them explains the beams, the
    region is cut in two, and free polygons are tried. The walls of a room around all, a rectangle
    or another polygon, are found the same way. The page on the likelihood in the documentation
    derives the model.

    Parameters
    ----------
    scan : Scan
        With origins; beams without return count as much as others.
    rng : None, int or numpy.random.Generator
        Same `rng`, same result, at any number of threads.
    sigma : float, (n,) or None, metres
        Noise; None takes the scan's, or else is estimated.
    tolerance : float or None, metres
        By how much the walls of a real solid may be off the shape that it is called by: the
        simplest shape within it wins. None is 2 % of its size, the square root of the area of its
        footprint.
    settings : LikelihoodSettings or None
        All other numbers that the method depends on.
    pose_sigma : (position, heading), (x, y, heading), (p, 2), (p, 3) or None
        Standard deviations, metres and radians, of the poses from which the scan believes it was
        taken, each by itself: poses and solids are then estimated together. None is exact, unless
        `step_sigma` is given.
    step_sigma : the same of (p - 1) steps, or None
        The same of each step from one pose to the next, in the robot's frame; the first pose is
        exact then, since it says where the map is.
    estimate : tuple of str
        What else is estimated, where poses are not exact: "bias", by how much all ranges are too
        long, "mount", where on the robot the sensor sits, beyond what the scan believes, and
        "incidence", by how much the noise grows where beams graze: their divergence.
    n_jobs : int or None
        Threads; None for all.
    progress : bool or callable
        True shows a bar; a callable gets the number of stages done and in all.

    Returns
    -------
    Detection
        Each solid has the mean and covariance of its posterior. Where poses are not exact, that is
        where all ranges agree best, with the poses marginalised; `path` and `path_covariance` are
        those of the poses.

    Raises
    ------
    ValueError
        When the scan has no returns or no origins, or it is not known which beams were taken from
        one pose.

    Warns
    -----
    UserWarning
        For places of which beams contradict each other, and poses whose beams fit nothing.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> path = primfit.grid_path(world, 0.25, rng=7)
    >>> scan = primfit.scan(world, path, primfit.Lidar(noise=0.05), rng=7)
    >>> primfit.detect(scan, method="likelihood", rng=7)
    Detection(1 solid: square; an arena; 8 planes; sigma 50 mm)
    """
    _check(scan)
    how = LikelihoodSettings() if settings is None else settings
    instance("settings", how, LikelihoodSettings)
    if tolerance is not None:
        how = replace(how, tolerance=number("tolerance", tolerance, low=0.0))
    rng = generator(rng)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    spread = estimate_range_sigma(scan, rng) if given is None else given

    free, by_incidence = _shared(estimate)
    if pose_sigma is not None or step_sigma is not None:
        if pose_sigma is not None and step_sigma is not None:
            raise ValueError("pose_sigma and step_sigma exclude each other: give one of them")
        task = Task(
            np.asarray(spread), given is None, free, by_incidence, how, rng, n_jobs_or_none(n_jobs)
        )
        with reporting(progress, 10, "stage") as tell:
            return detect_with_poses(Track.of(scan, pose_sigma, step_sigma), task, tell)
    if free or by_incidence:
        raise ValueError(
            "estimate needs pose_sigma or step_sigma: what is common to all beams is sought with "
            "the poses"
        )

    with reporting(progress, 10, "stage") as tell:
        scene, has_floor = initial_scene(scan, np.asarray(spread), how, n_jobs_or_none(n_jobs))
        tell(1)
        space = carve(scene)
        scene = replace(scene, room=find_room(scene, space))
        stride = how.selection.stride
        dropouts = measure_noise(scene, False, stride).dropouts
        scene = replace(scene, model=replace(scene.model, dropouts=dropouts))
        space = with_room(space, scene)
        tell(2)
        walls = None if scene.room is None else scene.room.fit.footprint
        scene = scene.with_solids([Hypothesis(region) for region in space.regions(walls)])
        scene = fit_regions(scene)
        tell(3)
        missed = how.refinement.missed_factor * how.refinement.misfit
        scene = prune(scene, missed)
        around = {"has_floor": has_floor, "measure_sigma": given is None, "rng": rng}
        scene, floor_sigma = refine_environment(scene, **around, stride=stride)
        scene = prune(scene, missed)
        tell(4)
        scene = sample_candidates(scene, rng)
        tell(5)
        scene = merge_overlapping(scene, rng)
        tell(6)
        scene = refine(scene, rng)
        tell(7)
        scene = prune(scene)
        scene, floor_sigma = refine_environment(scene, **around, stride=1)
        tell(8)
        scene = finish(scene, rng)
        tell(9)
        scene = prune(scene)
        used = scene.model.sigma if given is None else spread
        scene, contradictions = find_contradictions(scene, space)
        sigma = float(np.median(used))
        detection = to_detection(scene, floor_sigma, sigma, tuple(contradictions))
        tell(10)
    return detection


def _shared(estimate: Collection[str]) -> tuple[tuple[int, ...], bool]:
    """Which of what is common to all beams is sought, and whether noise is by incidence."""
    names = (estimate,) if isinstance(estimate, str) else tuple(estimate)
    for name in names:
        choice("estimate", name, [*SHARED, _INCIDENCE])
    free = tuple(sorted({k for name in names for k in SHARED.get(name, ())}))
    return free, _INCIDENCE in names


def _check(scan: Scan) -> None:
    if not scan.has_origins:
        raise ValueError(
            "scan must have origins for method='likelihood', which asks where beams passed; give "
            "them to Scan.from_points, or use method='planes' for a bare cloud"
        )
    n_returns = int(scan.is_return.sum())
    if n_returns < 3:
        raise ValueError(
            f"points must hold at least 3 returns, since a plane needs as many, not {n_returns}"
        )
