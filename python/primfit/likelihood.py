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
import shapely

from primfit._check import Floats, Ints, n_jobs_or_none
from primfit.carving import Seed, carve
from primfit.detection import Detection, FoundArena, FoundSolid
from primfit.footprints import angle_of, signed_area
from primfit.peeling import Patch
from primfit.planes import SIGMAS, Plane, bounded, check_enough, cloud_of, find_floor
from primfit.ransac import Cloud, Orientation, fit
from primfit.sampling import Posterior, sample
from primfit.scans import Scan, as_sigma
from primfit.scene import CAP, Beams, Body, Scene, thinned
from primfit.templates import TEMPLATES, Template

_ROUGH = 8
"""One beam in so many is enough to tell kinds roughly apart."""

_BLUR = 0.05
"""Standard deviation over the size of a seed with which its kind is sought at first."""

_LEAST_GAIN = 25.0
"""Log-likelihood that a solid must gain over nothing, beyond what its parameters cost."""

_KINDS = {template.kind: template for template in TEMPLATES}

_TALL = 1e6
"""Height of walls whose top no beam tells, metres."""


def _cost_of(beams: Beams, template: Template) -> Any:
    def cost(parameters: Floats) -> Floats:
        tops = np.maximum(parameters[:, -1], beams.base)
        costs = beams.costs(template.footprints(parameters), tops)
        # Where no beam tells the height, it stays about as high as the sensor sees far.
        costs += 0.5 * np.square((tops - beams.base) / beams.reach)
        return np.where(template.is_proper(parameters), costs, costs + 1e9)

    return cost


def _first_guesses(beams: Beams, template: Template, seed: Seed, top: float) -> list[Floats]:
    """The best of a grid of angles and sizes about a seed, and the best at another angle."""
    angles = np.arange(24) / 24 * template.period
    guesses = np.array(
        [
            [*seed.center, angle, *sizes, top]
            for angle in angles
            for share in (0.8, 0.95)
            for sizes in template.sizes_of_area(share * seed.area)
        ]
    )
    costs = _cost_of(beams, template)(guesses)
    best = guesses[int(np.argmin(costs))]
    turn = (guesses[:, 2] - best[2] + template.period / 2) % template.period - template.period / 2
    costs[np.abs(turn) < template.period / 5] = np.inf
    return [best, guesses[int(np.argmin(costs))]]


def _first_top(beams: Beams, seed: Seed) -> float:
    """The height at which a seed explains its beams best."""
    z = beams.arrays[0][:, 2] + np.minimum(beams.arrays[3], beams.reach) * beams.arrays[1][:, 2]
    tops = np.linspace(beams.base, float(z.max()), 25)[1:]
    costs = beams.costs(np.broadcast_to(seed.outline, (len(tops), *seed.outline.shape)), tops)
    return float(tops[int(np.argmin(costs))])


def _spread(template: Template, area: float) -> Floats:
    """Covariance (d, d) of a first guess."""
    size = np.sqrt(area)
    sizes = [0.1 * size] * template.n_sizes
    return np.diag(np.square([0.05 * size, 0.05 * size, template.period / 24, *sizes, 0.05 * size]))


def _fit_seed(scene: Scene, i: int, seed: Seed, rng: np.random.Generator) -> Body:
    """The kind and parameters that explain the beams about a seed best."""
    radius = 1.15 * float(np.linalg.norm(seed.outline - seed.center, axis=1).max())
    beams = scene.near(seed.center, radius, without=i)
    blur = _BLUR * float(np.sqrt(seed.area))
    rough = thinned(beams, _ROUGH, blur)
    top = _first_top(rough, seed)
    penalty = 0.5 * np.log(max(len(beams), 2))
    tries: list[tuple[float, Template, Posterior]] = []
    for template in TEMPLATES:
        starts = _first_guesses(rough, template, seed, top)
        found = min(
            (
                sample(
                    _cost_of(rough, template),
                    start,
                    _spread(template, seed.area),
                    rng,
                    n=48,
                    generations=10,
                )
                for start in starts
            ),
            key=lambda posterior: posterior.cost,
        )
        tries.append((found.cost + penalty * len(found.mean), template, found))
    tries.sort(key=lambda each: each[0])
    settled: list[tuple[float, Template, Posterior]] = []
    for _, template, found in tries[:3]:
        # Sharpened step by step: an exact likelihood is flat but for a spike.
        sigma = blur / 3.0
        while sigma > scene.sigma:
            sharper = thinned(beams, _ROUGH // 2, sigma)
            found = sample(
                _cost_of(sharper, template),
                found.mean,
                2.0 * found.covariance,
                rng,
                n=48,
                generations=10,
            )
            sigma /= 3.0
        found = sample(
            _cost_of(beams, template), found.mean, 2.0 * found.covariance, rng, generations=30
        )
        settled.append((found.cost + penalty * len(found.mean), template, found))
    settled.sort(key=lambda each: each[0])
    return _body(scene, beams, settled)


def _body(scene: Scene, beams: Beams, settled: list[tuple[float, Template, Posterior]]) -> Body:
    """The best of some fits, with the next one as a rival and what it gains over nothing."""
    score, template, found = settled[0]
    parameters = found.mean if found.temperature == 1.0 else found.best
    footprint = template.footprints(parameters[None])[0]
    nothing = beams.costs(footprint[None], np.array([scene.base]))[0]
    fits = tuple((each, posterior) for _, each, posterior in settled[:2])
    return Body(footprint, float(parameters[-1]), fits, float(nothing - score))


def _refit(scene: Scene, i: int, rng: np.random.Generator) -> Body:
    """The best two kinds again, among the neighbours as they are now."""
    body = scene.bodies[i]
    center = body.footprint.mean(axis=0)
    radius = 1.15 * float(np.linalg.norm(body.footprint - center, axis=1).max())
    beams = scene.near(center, radius, without=i)
    area = abs(signed_area(body.footprint))
    rivals = list(body.fits)
    kinds = [template.kind for template, _ in rivals]
    if "rectangle" in kinds and "square" not in kinds:
        rectangle = rivals[kinds.index("rectangle")][1]
        rivals.append((_KINDS["square"], _as_square(rectangle)))
    penalty = 0.5 * np.log(max(len(beams), 2))
    settled = []
    for template, before in rivals:
        found = sample(
            _cost_of(beams, template),
            before.best,
            before.covariance + 0.01 * _spread(template, area),
            rng,
            n=96,
            generations=40,
        )
        settled.append((found.cost + penalty * len(found.mean), template, found))
    settled.sort(key=lambda each: each[0])
    return _body(scene, beams, settled)


def _as_square(rectangle: Posterior) -> Posterior:
    """A rectangle's posterior as that of a square, to start from."""
    to_square = np.zeros((5, 6))
    to_square[[0, 1, 2, 4], [0, 1, 2, 5]] = 1.0
    to_square[3, 3:5] = 0.5
    covariance = to_square @ rectangle.covariance @ to_square.T
    spread = np.square(rectangle.best[3] - rectangle.best[4])
    covariance[3, 3] += spread
    return replace(
        rectangle,
        mean=to_square @ rectangle.mean,
        best=to_square @ rectangle.best,
        covariance=covariance,
    )


def _find_room(scene: Scene, free: Floats, rng: np.random.Generator) -> Floats | None:
    """The rectangle around the free space, if walls explain the scan better than none."""
    hull = shapely.MultiPoint(free).convex_hull
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(hull))[:4]
    if len(corners) < 4:
        return None
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)[:2]
    way = np.diff(corners, axis=0)[int(sides[1] > sides[0])]
    start = np.array([*corners.mean(axis=0), np.arctan2(way[1], way[0]), sides.max(), sides.min()])
    rows = np.arange(0, len(scene.scan), max(1, len(scene.scan) // 20_000))
    beams = scene.beams(rows, scene.background(rows=rows))
    template = _KINDS["rectangle"]

    def cost(parameters: Floats) -> Floats:
        tall = np.full(len(parameters), _TALL)
        return beams.costs(template.footprints(parameters), tall)

    spread = np.diag(np.square([0.03, 0.03, 0.03, 0.05, 0.05]) * scene.reach**2)
    found = sample(cost, start, spread, rng, generations=40)
    nothing = beams.costs(corners[None], np.array([scene.base]))[0]
    if nothing - found.cost < 10.0 * np.log(len(rows)):
        return None
    return template.footprints(found.best[None])[0]


def detect_likelihood(
    scan: Scan,
    rng: Any = None,
    *,
    sigma: float | None = None,
    n_jobs: int | None = None,
) -> Detection:
    """Planes and solids by the likelihood of all ranges.

    Space that beams passed is carved away; each piece that is left is the seed of a solid. Around
    a seed, triangle, square, rectangle, pentagon, hexagon and five-tipped star compete by the
    Bayesian information criterion, each fitted by sampling the exact likelihood of the beams that
    end on it, pass it, or pass over it. A rectangular room around all is found the same way.
    Solids of other kinds come out as the nearest of these.

    Parameters
    ----------
    scan : Scan
        With origins; beams without return count as much as others.
    rng : None, int or numpy.random.Generator
        Same `rng`, same result, at any number of threads.
    sigma : float or None, metres
        Noise; None takes the scan's, or else is estimated.
    n_jobs : int or None
        Threads; None for all.

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
            "scan must have origins for method='likelihood', which asks where beams passed; "
            "use method='paper' for a bare cloud"
        )
    rng = np.random.default_rng(rng)
    threads = n_jobs_or_none(n_jobs)
    rows = np.flatnonzero(scan.is_return)
    check_enough(rows)
    cloud, used_sigma = cloud_of(
        scan, rows, scan.sigma if sigma is None else as_sigma(sigma, len(scan)), rng
    )
    floor = find_floor(cloud, rows, rng)
    base = 0.0 if floor is None else -float(floor.equation[3] / floor.equation[2])
    scene = Scene(scan, used_sigma, base, threads)
    mount = float(np.median(scan.origins[:, 2])) - base
    layer = base + 0.3 * mount, base + 1.7 * mount
    carving = carve(scan, scene.sigma, bottom=layer[0], top=layer[1], reach=scene.reach)
    centers = carving.centers()
    scene.room = _find_room(scene, centers[carving.is_free], rng)
    within = None
    if scene.room is not None:
        inner = shapely.Polygon(scene.room).buffer(-2.5 * carving.cell)
        within = shapely.contains_xy(inner, centers[..., 0], centers[..., 1])
    seeds = carving.seeds(within)
    scene.bodies = [Body(seed.outline, layer[1]) for seed in seeds]
    for i, seed in enumerate(seeds):
        scene.bodies[i] = _fit_seed(scene, i, seed, rng)
    scene.bodies = [body for body in scene.bodies if body.gain > _LEAST_GAIN]
    for i in range(len(scene.bodies)):
        scene.bodies[i] = _refit(scene, i, rng)
    scene.bodies = [body for body in scene.bodies if body.gain > _LEAST_GAIN]
    return _detection(scene, cloud, rows, floor, used_sigma)


def _detection(
    scene: Scene, cloud: Cloud, rows: Ints, floor: Plane | None, sigma: float
) -> Detection:
    """The scene as public results: each wall with the returns that it explains."""
    scan = scene.scan
    outlines = [body.footprint for body in scene.bodies]
    if scene.room is not None:
        outlines.append(scene.room[::-1])
    expected = scene.background(rows=rows)
    horizontal = np.hypot(*scan.directions[rows, :2].T)
    limit = np.maximum(cloud.limit, SIGMAS * scene.sigma)
    explained = np.abs(scan.ranges[rows] - expected) <= limit
    upright = Orientation.of("vertical")
    patches: list[Patch] = []
    walls: list[tuple[int, ...]] = []
    for outline in outlines:
        numbers: list[int] = []
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            way = (b - a) / np.linalg.norm(b - a)
            equation = np.array([way[1], -way[0], 0.0, way[0] * a[1] - way[1] * a[0]])
            feet = cloud.feet(equation)[:, :2]
            distance = np.linalg.norm(feet - scan.origins[rows, :2], axis=1)
            along = (feet - a) @ way
            on_wall = (along >= 0.0) & (along <= np.linalg.norm(b - a))
            nearest = np.isclose(distance, expected * horizontal, rtol=0.0, atol=1e-6 * scene.reach)
            members = np.flatnonzero(on_wall & nearest & explained)
            model = fit(cloud.take(members), equation, upright)
            if model is not None:
                numbers.append(len(patches))
                patches.append(Patch.of(cloud, model, members))
        walls.append(tuple(numbers))
    planes, labels = bounded(patches, cloud, rows, len(scan))
    solids = []
    for body, mine in zip(scene.bodies, walls, strict=False):
        template, posterior = body.fits[0]
        n_sizes = template.n_sizes
        sizes = tuple(float(size) for size in posterior.mean[3 : 3 + n_sizes])
        parameters = posterior.covariance
        n_walls = len(body.footprint)
        solids.append(
            FoundSolid(
                kind=template.kind,
                footprint=body.footprint,
                base=scene.base,
                top=body.top,
                angle=angle_of(body.footprint, template.kind),
                size=sizes[0] if n_sizes == 1 else (sizes[0], sizes[1]),
                covariance=parameters[:-1, :-1],
                planes=mine,
                observed=(len(mine) == n_walls,) * n_walls + (False, False),
                height_sigma=float(np.sqrt(parameters[-1, -1])),
            )
        )
    arena = None if scene.room is None else FoundArena(scene.room, walls[-1])
    return Detection(
        scan=scan,
        method="likelihood",
        planes=planes,
        labels=labels,
        solids=tuple(solids),
        arena=arena,
        floor=floor,
        sigma=sigma,
        settings={"cap": CAP, "cell": scene.reach / 50.0, "least_sigma": scene.sigma},
    )
