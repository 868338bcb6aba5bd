"""What is around the solids: the floor under them, the walls of the room, the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from primfit._check import Floats
from primfit.geometry.footprints import signed_area
from primfit.likelihood.beam_model import BeamModel, Beams
from primfit.likelihood.fitting import (
    Fit,
    Top,
    climb,
    coarse_to_fine,
    find_top,
    sample_posterior,
)
from primfit.likelihood.footprint_models import RECTANGLE, FootprintModel, FreePolygon
from primfit.likelihood.free_space import FreeSpace
from primfit.likelihood.hypotheses import Candidate
from primfit.likelihood.scene import Recording, Scene
from primfit.likelihood.settings import LikelihoodSettings
from primfit.scans.scan import Scan

_LEAST_CLEAR = 0.05
"""Share of the beams that tell outliers and dropouts, if they are clear of all solids."""

_FLOOR_BEAMS = 5000
"""Descending beams by which the floor is sought."""

_LEAST_FLOOR = 0.01
"""Share of the descending returns that a floor must explain."""

_MOST_BELOW = 0.1
"""Returns from below the floor, in those from it, at the most: as many as outliers may be."""

_FLOOR_STEPS = 12
"""Steps to the floor's height: which beams meet it depends on it."""

_INSIDE = 0.99
"""Share of the sensor's places that must be within the room: a wall may be off at first."""

_WHOLE = 0.97
"""Share of its smallest rectangle that an outline covers if it is a rectangle."""


def initial_scene(
    scan: Scan, sigma: Floats, settings: LikelihoodSettings, n_jobs: int | None
) -> tuple[Scene, bool]:
    """A scene without solids: limits of the ranges, noise and floor; and whether there is one.

    Where the shortest range is not known, it is that of the returns. The longest is not taken as
    much longer than that of the returns, so nothing depends on how far the sensor could have seen.
    """
    ranges = scan.ranges[scan.is_return]
    longest = settings.noise.range_margin * float(np.quantile(ranges, 0.999))
    longest += settings.noise.contamination_sigmas * float(np.median(sigma))
    shortest = max(float(np.quantile(ranges, 0.001)), 0.0)
    if scan.min_range is not None:
        shortest = float(np.min(scan.min_range))
    if scan.max_range is not None:
        longest = min(longest, float(np.max(scan.max_range)))
    sigmas = np.maximum(np.broadcast_to(sigma, len(scan)), settings.noise.least_sigma * longest)
    model = BeamModel(
        sigma=sigmas,
        min_range=shortest,
        max_range=longest,
        beam_limits=limits_of(scan, shortest, longest),
        settings=settings.noise,
    )
    floor_z = find_floor(scan, model)
    lowest = min(float(scan.points[scan.is_return, 2].min()), float(scan.origins[:, 2].min()))
    scene = Scene(
        recording=Recording.of(scan),
        model=model,
        floor_z=lowest - model.least_sigma if floor_z is None else floor_z,
        settings=settings,
        n_jobs=n_jobs,
    )
    return scene, floor_z is not None


def limits_of(scan: Scan, shortest: float, longest: float) -> Floats | None:
    """Limits (2, n) of the ranges of each beam, up to `longest`; None where all beams share them.

    Where a limit is not known, it is the given one.
    """
    nearest, farthest = scan.min_range, scan.max_range
    if not (isinstance(nearest, np.ndarray) or isinstance(farthest, np.ndarray)):
        return None
    low = shortest if nearest is None else nearest
    high = longest if farthest is None else np.minimum(longest, farthest)
    return np.stack([np.broadcast_to(each, len(scan)) for each in (low, high)])


def find_floor(scan: Scan, model: BeamModel) -> float | None:
    """z of the lowest level plane on which many descending beams end; None where there is none.

    Heights compete by the ranges of the beams that would meet them within the sensor's limits, each
    within three of its standard deviations (MSAC). The lowest one is taken that at least half as
    many agree with as with any other.
    """
    down = np.flatnonzero(scan.is_return & (scan.directions[:, 2] < 0.0))
    down = down[:: max(1, len(down) // _FLOOR_BEAMS)]
    if len(down) < 10:
        return None
    z, slope = scan.points[down, 2], scan.directions[down, 2]
    heights, ranges, sigma = scan.origins[down, 2], scan.ranges[down], model.sigma[down]

    def residuals(at: float) -> Floats:
        """Standard deviations by which ranges exceed those of a floor, NaN for none in range."""
        expected = (at - heights) / slope
        return np.where(model.is_visible(expected, down), (ranges - expected) / sigma, np.nan)

    grid = np.concatenate([np.quantile(z, np.linspace(0.0, 1.0, 150)), np.linspace(*_span(z), 150)])
    grid = np.unique(grid)
    scores = np.array([np.nansum(np.maximum(9.0 - residuals(at) ** 2, 0.0)) for at in grid])
    at = float(grid[int(np.argmax(scores >= 0.5 * scores.max()))])
    for _ in range(20):
        off = residuals(at)
        weights = np.where(np.abs(off) <= 3.0, (slope * sigma) ** -2, 0.0)
        if not weights.any():
            return None
        at += float((weights * np.nan_to_num(off) * sigma * slope).sum() / weights.sum())
    off = residuals(at)
    is_below = off > 2.0 * model.settings.contamination_sigmas
    agreeing = float((np.abs(off) <= 3.0).mean())
    if agreeing < _LEAST_FLOOR or is_below.mean() > _MOST_BELOW * agreeing:
        return None
    return at


def _span(z: Floats) -> tuple[float, float]:
    return float(z.min()), float(z.max())


def find_room(scene: Scene, space: FreeSpace, slack: float = 0.0) -> Candidate | None:
    """Walls around the free space, if they explain the scan better than none.

    Rectangles and, where the free space has another outline, polygons compete, each with the
    height that the beams tell. The sensor's places may be `slack` outside, metres.
    """
    how = scene.settings.room
    rows = np.arange(0, len(scene.scan), max(1, len(scene.scan) // how.beams))
    beams = scene.beams(rows, scene.expected(rows), is_open=True)
    starts = _room_starts(scene, space)
    if not starts:
        return None
    triangle = starts[0][2][:3]
    nothing = float(beams.costs(triangle[None], np.array([scene.floor_z - 1.0]))[0])
    found = []
    for model, parameters, outline in starts:
        size = float(np.ptp(outline, axis=0).min())
        for top in (scene.ceiling, space.heights[-1], space.heights[-2]):
            rough = beams.costs(outline[None], np.array([top]))[0]
            found.append((float(rough), model, parameters, float(top), size))
    found.sort(key=lambda each: (isinstance(each[1], FreePolygon), each[0]))

    def price(fit: Fit) -> float:
        """What a corner beyond four must gain."""
        return max(how.polygon_gain, how.polygon_share * (nothing - fit.cost))

    best: Candidate | None = None
    kept = _best_of_each(found)
    for _, model, parameters, top, size in kept:
        fit = coarse_to_fine(beams, model, parameters, top, size)
        height = find_top(beams, fit.footprint)
        z = height.z if np.isfinite(height.sigma) else scene.ceiling
        fit = climb(beams, model, fit.parameters, z)
        if not model.is_proper(fit.parameters[None])[0]:
            continue
        if isinstance(model, FreePolygon):
            # Without needless corners it explains no more than with them.
            if best is not None and fit.cost + price(fit) > best.fit.cost:
                continue
            fit = _without_needless_corners(beams, fit, z, price(fit))
        if not _is_around(scene, fit, slack):
            continue
        each = Candidate.unsampled(fit, Top(z, height.sigma))
        if best is None or _priced(fit, price(fit)) < _priced(best.fit, price(fit)):
            best = each
    if best is None or nothing - best.fit.cost < how.least_gain * np.log(len(rows)):
        return None
    return best


def _is_around(scene: Scene, fit: Fit, slack: float) -> bool:
    """Whether the sensor was within walls, or hardly outside, wherever it was."""
    x, y, _ = scene.recording.places.T
    room = shapely.make_valid(shapely.Polygon(fit.footprint))
    room = room.buffer(slack) if slack > 0.0 else room
    return bool(shapely.contains_xy(room, x, y).mean() > _INSIDE)


def _priced(fit: Fit, price: float) -> float:
    """Cost of a room with that of its corners beyond four."""
    return fit.cost + price * max(len(fit.footprint) - 4, 0)


def _without_needless_corners(beams: Beams, fit: Fit, top: float, price: float) -> Fit:
    """A polygon without corners that explain next to nothing, the flattest first."""
    footprint = fit.footprint
    before, after = np.roll(footprint, 1, axis=0) - footprint, np.roll(footprint, -1, axis=0)
    after = after - footprint
    areas = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    if len(footprint) <= 3:
        return fit
    for k in np.argsort(areas):
        rest = np.delete(footprint, k, axis=0)
        model = FreePolygon(len(rest))
        if not model.is_proper(rest.reshape(1, -1))[0]:
            continue
        simpler = climb(beams, model, rest.ravel(), top)
        if _priced(simpler, price) < _priced(fit, price):
            return _without_needless_corners(beams, simpler, top, price)
    return fit


def _best_of_each(
    found: list[tuple[float, FootprintModel, Floats, float, float]],
) -> list[tuple[float, FootprintModel, Floats, float, float]]:
    """The two best starts of each model."""
    kept, counts = [], dict[FootprintModel, int]()
    for each in found:
        counts[each[1]] = counts.get(each[1], 0) + 1
        if counts[each[1]] <= 2:
            kept.append(each)
    return kept


def _room_starts(scene: Scene, space: FreeSpace) -> list[tuple[FootprintModel, Floats, Floats]]:
    """Rectangles and polygons about the free space below each height."""
    starts: list[tuple[FootprintModel, Floats, Floats]] = []
    for outline in space.outlines():
        polygon = shapely.Polygon(outline)
        around = shapely.get_coordinates(polygon.minimum_rotated_rectangle)[:4]
        if len(around) < 4 or polygon.area <= 0.0:
            continue
        starts.append(_rectangle_start(around))
        simple = polygon.simplify(3.0 * space.cell)
        ring = shapely.get_coordinates(shapely.orient_polygons(simple).exterior)[:-1]
        is_whole = polygon.area > _WHOLE * shapely.Polygon(around).area
        if not is_whole and 3 <= len(ring) <= 24:
            starts.append((FreePolygon(len(ring)), ring.ravel(), ring))
    return starts


def _rectangle_start(corners: Floats) -> tuple[FootprintModel, Floats, Floats]:
    if signed_area(corners) < 0.0:
        corners = corners[::-1]
    sides = np.diff(corners, axis=0)[:2]
    lengths = np.linalg.norm(sides, axis=1)
    way = sides[int(lengths.argmax())]
    parameters = [*corners.mean(axis=0), np.arctan2(way[1], way[0]), lengths.max(), lengths.min()]
    return RECTANGLE, np.array(parameters), corners


def refine_environment(
    scene: Scene, *, has_floor: bool, measure_sigma: bool, rng: np.random.Generator, stride: int
) -> tuple[Scene, float | None]:
    """Room, floor and noise of a scene by some of its beams, with the solids where they are.

    Returns
    -------
    scene : Scene
    floor_sigma : float or None, metres
        Standard deviation of the floor's z.
    """
    stride = max(stride, len(scene.scan) // scene.settings.room.survey_beams)
    if scene.room is not None:
        empty = replace(scene, room=None)
        rows = slice(None, None, stride)
        beams = empty.beams(rows, empty.expected(rows), stride, is_open=True)
        scene = replace(scene, room=_sampled_room(beams, scene.room, rng))
    floor_sigma = None
    if has_floor:
        floor_z, floor_sigma = level_floor(scene, stride)
        scene = replace(scene, floor_z=floor_z)
    return replace(scene, model=measure_noise(scene, measure_sigma, stride)), floor_sigma


def _sampled_room(beams: Beams, room: Candidate, rng: np.random.Generator) -> Candidate:
    fit = climb(beams.thinned(4, 0.0), room.fit.shape, room.fit.parameters, room.top.z)
    top = find_top(beams, fit.footprint)
    top = top if np.isfinite(top.sigma) else room.top
    # Walls at the end of the range hold a climb where it begins; few beams tell where to go.
    effort, d = beams.settings.sampling.quick, fit.shape.n_parameters
    for stride in (4 * beams.stride, beams.stride):
        fit, top, found = sample_posterior(beams.subset(stride), fit, top, rng, effort)
    return Candidate(fit, top, found.best[:d], found.log_evidence, 0.0, found.cost, 1)


def level_floor(scene: Scene, stride: int) -> tuple[float, float]:
    """z of the floor, metres, by the ranges of beams that should end on it, and its sigma.

    Which beams these are follows from where they go, not from their ranges, whose noise would take
    some away on one side.
    """
    scan, model = scene.scan, scene.model
    some = slice(None, None, stride)
    down = stride * np.flatnonzero(scan.is_return[some] & (scan.directions[some, 2] < 0.0))
    nearest = scene.expected(down, floor=False)
    slope, heights = scan.directions[down, 2], scan.origins[down, 2]
    ranges, sigmas = scan.ranges[down], model.sigma[down]
    floor_z, sigma = scene.floor_z, np.inf
    for _ in range(_FLOOR_STEPS):
        expected = (floor_z - heights) / slope
        meets = (expected < nearest) & model.is_visible(expected, down)
        residual = ranges - expected
        meets &= np.abs(residual) <= model.settings.contamination_sigmas * sigmas
        weights = np.where(meets, (slope * sigmas) ** -2, 0.0)
        if not meets.any():
            break
        step = float((weights * residual * slope).sum() / weights.sum())
        floor_z += step
        sigma = float(weights.sum() ** -0.5)
        if abs(step) < 0.1 * sigma:
            break
    return floor_z, sigma


def measure_noise(scene: Scene, measure_sigma: bool, stride: int) -> BeamModel:
    """Noise by the ranges that the scene foresees: their spread, if wanted, and their lapses.

    The spread is that of residuals within a few standard deviations, which a Gaussian hardly
    leaves. Near a solid that is not well known yet, what is off is no outlier.
    """
    scan, model = scene.scan, scene.model
    rows = scene.clear_rows(stride, _LEAST_CLEAR)
    expected = scene.expected(rows)
    foreseen = model.is_visible(expected, rows)
    hits = foreseen & scan.is_return[rows]
    residual = np.abs(scan.ranges[rows][hits] - expected[hits])
    sigma = model.sigma
    if measure_sigma and len(residual):
        spread = float(np.median(residual)) * 1.4826
        for _ in range(10):
            near = residual[residual <= model.settings.contamination_sigmas * spread]
            spread = float(np.sqrt(np.mean(near**2))) if len(near) else spread
        sigma = np.full(len(scan), max(spread, model.least_sigma))
    within = residual <= 5.0 * np.median(sigma)
    return replace(
        model,
        sigma=sigma,
        outliers=float(1.0 - within.mean()) if len(within) else 0.0,
        dropouts=float((foreseen & ~hits).sum() / max(foreseen.sum(), 1)),
    )
