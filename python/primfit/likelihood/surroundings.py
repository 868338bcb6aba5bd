"""What is around the solids: the floor under them and the walls of the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from primfit._check import Floats
from primfit.likelihood.beams import LEAST_SIGMA, Noise
from primfit.likelihood.fitting import Fit, Top, approach, climb, settle
from primfit.likelihood.sampling import QUICK
from primfit.likelihood.scene import Obstacle, Scene
from primfit.likelihood.templates import RECTANGLE

_BEAMS = 20_000
"""Beams that tell whether there is a room, and where."""

_LEAST_GAIN = 10.0
"""Log-likelihood that walls must gain over none, as a multiple of the logarithm of the beams."""

_STRIDES = (16, 4, 1)
"""One beam in so many, by which the room is found ever more exactly; the last the second time."""

_CONTAMINATED = 4.0
"""Standard deviations beyond which a residual does not count for the floor."""


def find_room(scene: Scene, free: Floats) -> Fit | None:
    """The rectangle around the free space (n, 2), if walls explain the scan better than none."""
    if len(free) < 3:
        return None
    # A line through all has their hull too, and is made much faster than a set of points.
    around = shapely.minimum_rotated_rectangle(shapely.linestrings(free))
    corners = shapely.get_coordinates(around)[:4]
    if len(corners) < 4:
        return None
    sides = np.diff(corners, axis=0)[:2]
    lengths = np.linalg.norm(sides, axis=1)
    way = sides[int(lengths.argmax())]
    start = np.array([*corners.mean(axis=0), np.arctan2(*way[::-1]), lengths.max(), lengths.min()])
    rows = np.arange(0, len(scene.scan), max(1, len(scene.scan) // _BEAMS))
    beams = scene.beams(rows, scene.background(rows=rows))
    tall = scene.ceiling
    fit = approach(beams, RECTANGLE, start, tall, float(lengths.min()))
    nothing = beams.costs(corners[None], np.array([scene.base]))[0]
    return fit if nothing - fit.cost > _LEAST_GAIN * np.log(len(rows)) else None


def survey(
    scene: Scene,
    room: Fit | None,
    has_floor: bool,
    measure_sigma: bool,
    rng: np.random.Generator,
    *,
    again: bool = False,
) -> tuple[Fit | None, float | None]:
    """Refine room, floor and noise of a scene by its beams, with the solids where they are.

    The first time some of the beams are enough; the second time it starts from there.

    Returns
    -------
    room : Fit or None
    base_sigma : float or None, metres
        Standard deviation of the floor's z.
    """
    coarse, fine, all_beams = _STRIDES
    stride = all_beams if again else fine
    if room is not None:
        scene.room = None
        rows = slice(None, None, stride)
        beams = scene.beams(rows, scene.background(rows=rows), stride)
        if not again:
            some = beams.thinned(coarse // fine, 0.0)
            room = climb(some, room.shape, room.parameters, scene.ceiling)
        # Walls at the end of the reach hold a climb where it begins.
        for here in (all_beams,) if again else (coarse, fine):
            room, _, _ = settle(beams.some(here), room, Top(scene.ceiling, np.nan), rng, QUICK)
        scene.room = Obstacle(room.footprint, scene.ceiling)
    base_sigma = None
    if has_floor:
        scene.base, base_sigma = level_floor(scene, stride)
    scene.noise = measure_noise(scene, measure_sigma, stride)
    return room, base_sigma


def level_floor(scene: Scene, stride: int) -> tuple[float, float]:
    """z of the floor, metres, by the ranges of beams that should end on it, and its sigma.

    Which beams these are is told by where they go, not by their ranges, whose noise would take
    some away on one side.
    """
    scan, noise = scene.scan, scene.noise
    some = slice(None, None, stride)
    down = stride * np.flatnonzero(scan.is_return[some] & (scan.directions[some, 2] < 0.0))
    nearest = scene.background(rows=down, floor=False)
    slope = scan.directions[down, 2]
    base, sigma = scene.base, np.inf
    for _ in range(3):
        expected = (base - scan.origins[down, 2]) / slope
        meets = (expected < nearest) & (expected <= noise.reach) & (expected > 0.0)
        residual = scan.ranges[down] - expected
        meets &= np.abs(residual) <= _CONTAMINATED * noise.sigma[down]
        weights = np.where(meets, (slope * noise.sigma[down]) ** -2, 0.0)
        if not meets.any():
            break
        base += float((weights * residual * slope).sum() / weights.sum())
        sigma = float(weights.sum() ** -0.5)
    return base, sigma


def measure_noise(scene: Scene, measure_sigma: bool, stride: int) -> Noise:
    """Noise by the ranges that the scene foresees: their spread, if wanted, and their losses.

    The spread is that of residuals within `_CONTAMINATED` standard deviations, which a Gaussian
    hardly leaves.
    """
    scan, noise = scene.scan, scene.noise
    # Near a solid that is not well known yet, what is off is no outlier.
    rows = scene.clear_rows(stride)
    expected = scene.background(rows=rows)
    foreseen = expected <= noise.reach
    hits = foreseen & scan.is_return[rows]
    residual = np.abs(scan.ranges[rows][hits] - expected[hits])
    sigma = noise.sigma
    if measure_sigma and len(residual):
        spread = float(np.median(residual)) * 1.4826
        for _ in range(10):
            near = residual[residual <= _CONTAMINATED * spread]
            spread = float(np.sqrt(np.mean(near**2)))
        sigma = np.full(len(scan), max(spread, LEAST_SIGMA * noise.reach))
    within = residual <= 5.0 * np.median(sigma)
    return replace(
        noise,
        sigma=sigma,
        outliers=float(1.0 - within.mean()) if len(within) else 0.0,
        lost=float((foreseen & ~hits).sum() / max(foreseen.sum(), 1)),
    )
