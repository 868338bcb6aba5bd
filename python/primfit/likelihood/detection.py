"""Detection by the likelihood of all ranges.

A beam meets the nearest surface of the scene; its measured range is that range with Gaussian noise
along the beam, and a beam whose true range is beyond the sensor's comes back empty. So every beam
speaks: those that ended on a solid by their range, those that passed or were stopped by their
silhouette. A few of any kind may be outliers; their cost is capped.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from primfit._check import generator, n_jobs_or_none
from primfit.clouds.noise import estimate_range_sigma
from primfit.likelihood.beams import LEAST_SIGMA, Noise
from primfit.likelihood.carving import Seed, carve
from primfit.likelihood.competition import SOME, Body, compete, compete_finely, sketch, weigh
from primfit.likelihood.description import describe
from primfit.likelihood.fitting import Fit
from primfit.likelihood.repair import LEAST_GAIN, MISFIT, gain, repair
from primfit.likelihood.scene import Obstacle, Scene
from primfit.likelihood.surroundings import find_room, measure_noise, survey
from primfit.planes.scan_planes import Progress, check_enough, find_floor, noisy_points
from primfit.results import Detection
from primfit.scans.scan import Scan, as_sigma

_FLOOR_POINTS = 15_000
"""Returns that tell the floor roughly."""

_LAYERS = ((0.3, 1.7), (0.1, 0.4))
"""Heights between which space is carved, as multiples of the sensor's: first where most beams are,
then low, for solids that they pass over."""

_SLIVER = 0.4
"""Size of a seed, as a multiple of the noise, below which it is a sliver that noise left."""

_MISSED = 3.0 * MISFIT
"""Misfit where a solid is missing, while its neighbours are known roughly: theirs is less."""

_WEAK = 250.0
"""Log-likelihood that a body gains by some of the beams below which all of them are asked."""

_BLURRED = 0.5
"""Noise, as a multiple of the sensor's height, beyond which the floor hides low solids."""


def detect_likelihood(
    scan: Scan,
    rng: Any = None,
    *,
    sigma: Any = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Detection:
    """Planes and solids by the likelihood of all ranges.

    Space that beams passed is carved away; each piece that is left is the seed of a solid. Around
    a seed, regular polygons, rectangle and stars compete by the evidence for each, fitted to the
    ranges by Gauss-Newton steps and then sampled by the exact likelihood of the beams that end on
    it, pass it, or pass over it. Where none of them explains the beams, the seed is cut in two,
    and free polygons are tried. A rectangular room around all is found the same way. The page
    on the likelihood in the documentation derives the model.

    Parameters
    ----------
    scan : Scan
        With origins; beams without return count as much as others.
    rng : None, int or numpy.random.Generator
        Same `rng`, same result, at any number of threads.
    sigma : float, (n,) or None, metres
        Noise; None takes the scan's, or else is estimated.
    n_jobs : int or None
        Threads; None for all.
    progress : bool or callable
        True shows a bar; a callable gets the number of solids done and in all.

    Returns
    -------
    Detection
        Each solid has the mean and covariance of its posterior.

    Raises
    ------
    ValueError
        When the scan has no returns or no origins.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> path = primfit.grid_path(world, 0.25, rng=7)
    >>> scan = primfit.scan(world, path, primfit.Lidar(noise=0.05), rng=7)
    >>> primfit.detect(scan, method="likelihood", rng=7)
    Detection(1 solid: square; an arena; 8 planes; sigma 50 mm)
    """
    if not scan.has_origins:
        raise ValueError(
            "scan must have origins for method='likelihood', which asks where beams passed; give "
            "them to Scan.from_points, or use method='planes' for a bare cloud"
        )
    rng = generator(rng)
    threads = n_jobs_or_none(n_jobs)
    rows = np.flatnonzero(scan.is_return)
    check_enough(len(rows))

    # Noise and floor, roughly.
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    spread = estimate_range_sigma(scan, rng) if given is None else given
    reach = float(scan.ranges[rows].max()) if scan.max_range is None else scan.max_range
    sigmas = np.maximum(np.broadcast_to(spread, len(scan)), LEAST_SIGMA * reach)
    some = rows[:: max(1, len(rows) // _FLOOR_POINTS)]
    floor = find_floor(noisy_points(scan, some, sigmas, rng)[0], some, rng)
    base = 0.0 if floor is None else -float(floor.equation[3] / floor.equation[2])
    scene = Scene(scan, Noise(sigma=sigmas, reach=reach), base, threads)

    # Seeds: what is left of the space around the sensor, within the room.
    mount = scene.middle - base
    layers = [(base + low * mount, base + high * mount) for low, high in _LAYERS]
    if scene.noise.typical_sigma > _BLURRED * mount:
        layers.pop()
    room: Fit | None = None
    seeds: list[Seed] = []
    for number, (bottom, top) in enumerate(layers):
        carving = carve(scan, sigmas, bottom=bottom, top=top, reach=reach, n_jobs=threads)
        centers = carving.centers()
        if number == 0:
            room = find_room(scene, centers[carving.is_free])
            scene.room = None if room is None else Obstacle(room.footprint, scene.ceiling)
            scene.noise = replace(scene.noise, lost=measure_noise(scene, False, SOME).lost)
        carving = replace(carving, lost=scene.noise.lost)
        within = carving.inside(None if room is None else room.footprint) & ~carving.covered(seeds)
        seeds += [
            seed
            for seed in carving.seeds(within)
            if seed.area > (_SLIVER * scene.noise.typical_sigma) ** 2 and seed.radius < reach / 2
        ]

    # Bodies: the best kind for each seed, while the others stand as they are known by then.
    bodies: list[Body] = []
    scene.obstacles = [Obstacle(seed.hull, scene.middle + mount) for seed in seeds]
    with tqdm(total=2 * len(seeds), unit="fit", disable=progress is not True) as bar:

        def done(n_done: int, n_all: int) -> None:
            bar.total = n_all
            bar.update(n_done - bar.n)
            if callable(progress):
                progress(n_done, n_all)

        for i, seed in enumerate(seeds):
            bodies.append(sketch(scene, i, seed))
            scene.obstacles[i] = bodies[i].obstacle
            done(i + 1, 2 * len(seeds))
        for i, body in enumerate(bodies):
            # Again, since the neighbours were no more than seeds themselves.
            bodies[i] = compete(scene, i, body)
            scene.obstacles[i] = bodies[i].obstacle
        _drop_needless(scene, bodies, _MISSED)

        # Room, floor and noise by all beams; then each body among neighbours that are known.
        room, base_sigma = survey(scene, room, floor is not None, given is None, rng)
        _drop_needless(scene, bodies, _MISSED)
        compete_finely(scene, bodies, 0, rng)
        repair(scene, bodies, carving.cell, rng)
        _drop_needless(scene, bodies)
        room, base_sigma = survey(scene, room, floor is not None, given is None, rng, again=True)
        for i in range(len(bodies)):
            bodies[i] = weigh(scene, i, bodies[i], rng)
            scene.obstacles[i] = bodies[i].obstacle
            done(len(bodies) + i + 1, 2 * len(bodies))
    _drop_needless(scene, bodies)
    used_sigma = scene.noise.sigma if given is None else spread
    return describe(scene, bodies, room, base_sigma, float(np.median(used_sigma)))


def _drop_needless(scene: Scene, bodies: list[Body], misfit: float = np.inf) -> None:
    """Take out, one by one, the body without which the scene explains the beams as well.

    A body stays if the scene without it has more than a misfit: it may be wrong, but not needless.
    """
    needed: list[Body] = []
    while len(needed) < len(bodies):
        gains = scene.gains()
        gains[[any(body is each for each in needed) for body in bodies]] = np.inf
        i = int(np.argmin(gains))
        if gains[i] > _WEAK:
            return
        if gain(scene, bodies, i) > LEAST_GAIN:
            needed.append(bodies[i])
            continue
        obstacle = scene.obstacles.pop(i)
        if scene.misfit(obstacle.center, 1.3 * obstacle.radius) < misfit:
            del bodies[i]
        else:
            scene.obstacles.insert(i, obstacle)
            needed.append(bodies[i])
