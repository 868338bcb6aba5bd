"""Bodies that do not explain their beams: other ways to fill their place are tried."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import shapely

from primfit._check import Ints
from primfit.likelihood.carving import Seed
from primfit.likelihood.competition import Body, as_body, compete, compete_finely, sketch
from primfit.likelihood.fitting import find_top
from primfit.likelihood.polygons import fit_polygon
from primfit.likelihood.scene import Obstacle, Scene

MISFIT = 3.5
"""Standard deviations by which the beams of a body may fit worse than their noise explains."""

LEAST_GAIN = 25.0
"""Log-likelihood that a solid must gain over nothing, beyond what its parameters cost."""

_AROUND = 1.3
"""Radius within which beams tell of a body, as a multiple of its seed's."""

_TOUCHING = 0.02
"""Distance, as a fraction of the size, below which parts of a seed are one solid."""

_LEAST_CELLS = 9
"""Cells of the smallest part of a seed."""

_ROUNDS = 3
"""Times that parts are sought once more."""

_RIM = 0.1
"""Width of what a body leaves of a seed around it, in the size of the seed, that may be nothing."""

Alternative = Callable[[Scene, list[Body], Body, float], list[Body]]


def repair(scene: Scene, bodies: list[Body], cell: float, rng: np.random.Generator) -> None:
    """Replace bodies, in place, by others where these explain more.

    Nothing, another kind, now that the neighbours are known, the parts of the seed, and a free
    polygon compete by the Bayesian information criterion on the beams that come near. Since what
    one body lacks often is the fault of another, all have a try at another kind first, the worst
    before the others.
    """
    for alternatives in (_ALTERNATIVES[:1], _ALTERNATIVES):
        queue = [body for body in bodies if _misfit(scene, body) > MISFIT]
        if not queue:
            return
        queue.sort(key=lambda body: -_misfit(scene, body))
        while queue:
            body = queue.pop(0)
            if _misfit(scene, body) <= MISFIT:
                continue
            others = [each for each in bodies if each is not body]
            best = _instead(scene, others, body, cell, rng, alternatives)
            bodies[:] = others + best
            scene.obstacles = [each.obstacle for each in bodies]
            if len(best) > 1:
                queue += best


def gain(scene: Scene, bodies: list[Body], i: int) -> float:
    """Log-likelihood that body i gains over nothing, beyond what its parameters cost."""
    body, others = bodies[i], bodies[:i] + bodies[i + 1 :]
    rows = scene.rows_near(body.seed.center, _AROUND * body.seed.radius)
    gained = _score(scene, others, [], rows) - _score(scene, others, [body], rows)
    scene.obstacles = [each.obstacle for each in bodies]
    return gained


def _instead(
    scene: Scene,
    others: list[Body],
    body: Body,
    cell: float,
    rng: np.random.Generator,
    alternatives: tuple[Alternative, ...],
) -> list[Body]:
    """What explains the beams best in the place of a body."""
    rows = scene.rows_near(body.seed.center, _AROUND * body.seed.radius)
    best: list[Body] = []
    least = _score(scene, others, best, rows) - LEAST_GAIN
    is_enough = _misfit(scene, body) <= MISFIT
    whole = _score(scene, others, [body], rows)
    if whole < least:
        best, least = [body], whole
    elif is_enough:
        return []
    for alternative in alternatives:
        option = alternative(scene, others, body, cell)
        option = _needed(scene, others, _settled(scene, others, option, rng), rows)
        if len(option) > 1 and _score(scene, others, option, rows) < whole:
            option = _refined(scene, others, option, body.seed, rows, rng)
        if not option or _touch(option, float(np.sqrt(body.seed.area))):
            continue
        score = _score(scene, others, option, rows)
        if score < least:
            best, least = option, score
            if _misfit(scene, body) <= MISFIT:
                break
    return best


def _refined(
    scene: Scene,
    others: list[Body],
    parts: list[Body],
    seed: Seed,
    rows: Ints,
    rng: np.random.Generator,
) -> list[Body]:
    """Parts sought once more, in turns, as long as they do not explain their beams."""
    for _ in range(_ROUNDS):
        scene.obstacles = [each.obstacle for each in others + parts]
        if all(_misfit(scene, part) <= MISFIT for part in parts):
            break
        again = _parts_anew(scene, others, parts, seed, rows)
        if again == parts:
            break
        again = _settled(scene, others, again, rng)
        parts = min(parts, again, key=lambda each: _score(scene, others, each, rows))
    return parts


def _settled(
    scene: Scene, others: list[Body], option: list[Body], rng: np.random.Generator
) -> list[Body]:
    """Bodies sampled among others."""
    tried = others + option
    scene.obstacles = [each.obstacle for each in tried]
    compete_finely(scene, tried, len(others), rng)
    return tried[len(others) :]


def _needed(scene: Scene, others: list[Body], option: list[Body], rows: Ints) -> list[Body]:
    """Parts without those that the others leave next to nothing to explain, the smallest first."""
    for part in sorted(option, key=lambda each: each.seed.area)[:-1]:
        rest = [each for each in option if each is not part]
        if _score(scene, others, rest, rows) < _score(scene, others, option, rows) + LEAST_GAIN:
            option = rest
    scene.obstacles = [each.obstacle for each in others + option]
    return option


def _misfit(scene: Scene, body: Body) -> float:
    return scene.misfit(body.seed.center, _AROUND * body.seed.radius)


def _score(scene: Scene, others: list[Body], bodies: list[Body], rows: Ints) -> float:
    scene.obstacles = [body.obstacle for body in others + bodies]
    n_parameters = sum(body.contenders[0].fit.shape.n_parameters for body in bodies)
    cost = float(scene.costs(rows).sum())
    return cost + 0.5 * float(np.log(len(rows))) * n_parameters


def _afresh(scene: Scene, others: list[Body], body: Body, _: float) -> list[Body]:
    """The best kind for the body's seed, among neighbours that were seeds when it was found."""
    scene.obstacles = [each.obstacle for each in [*others, body]]
    return [_anew(scene, len(others), body.seed)]


def _anew(scene: Scene, i: int, seed: Seed) -> Body:
    return compete(scene, i, sketch(scene, i, seed))


def _parts_anew(
    scene: Scene, others: list[Body], parts: list[Body], seed: Seed, rows: Ints
) -> list[Body]:
    """Parts of a seed, each once more where that is better, since the others are known by now."""
    parts = list(parts)
    for j in sorted(range(len(parts)), key=lambda j: -_misfit(scene, parts[j])):
        tries = [parts[j]]
        for place in (parts[j].seed, _left(seed, parts[:j] + parts[j + 1 :])):
            scene.obstacles = [each.obstacle for each in others + parts]
            if place is not None:
                tries.append(_anew(scene, len(others) + j, place))
        options = [[*parts[:j], each, *parts[j + 1 :]] for each in tries]
        parts = min(options, key=lambda each: _score(scene, others, each, rows))
    scene.obstacles = [each.obstacle for each in others + parts]
    return parts


def _left(seed: Seed, bodies: list[Body]) -> Seed | None:
    """The largest piece of a seed that bodies leave, without the rims around them."""
    rim = _RIM * float(np.sqrt(seed.area))
    covered = shapely.union_all([shapely.Polygon(each.footprint) for each in bodies])
    left = shapely.Polygon(seed.outline).difference(covered).buffer(-rim).buffer(rim)
    piece = max(shapely.get_parts(left), key=shapely.area, default=shapely.Polygon())
    if piece.area <= _LEAST_CELLS * seed.cell**2:
        return None
    return Seed.of_polygon(piece, seed.cell, is_cut=True)


def _as_polygon(scene: Scene, others: list[Body], body: Body, _: float) -> list[Body]:
    """The body as a free polygon, or as a known kind where that is."""
    seed, top = body.seed, body.obstacle.top
    scene.obstacles = [each.obstacle for each in others]
    beams = scene.near(seed.center, _AROUND * seed.radius, without=None)
    size = float(np.sqrt(seed.area))
    polygon = fit_polygon(beams, [seed.outline, body.footprint], top, size)
    if polygon is None:
        return []
    # The polygon may tell the place of a known kind better than the seed.
    place = Seed.of_polygon(shapely.Polygon(polygon.footprint), 0.0, is_cut=False)
    scene.obstacles.append(Obstacle(place.outline, top))
    kinds = [each.fit for each in _anew(scene, len(others), place).contenders]
    return [as_body([polygon, *kinds], find_top(beams, polygon.footprint), seed)]


def _at_necks(scene: Scene, others: list[Body], body: Body, cell: float) -> list[Body]:
    """Bodies from the parts of a body's seed between its necks."""
    return _from_parts(scene, others, body.seed.parts, cell)


def _in_halves(scene: Scene, others: list[Body], body: Body, cell: float) -> list[Body]:
    """Bodies from the halves of a body's seed."""
    return _from_parts(scene, others, body.seed.halves(), cell)


def _from_parts(
    scene: Scene, others: list[Body], parts: tuple[Seed, ...], cell: float
) -> list[Body]:
    parts = tuple(part for part in parts if part.area > _LEAST_CELLS * cell**2)
    if len(parts) < 2:
        return []
    first = len(others)
    top = 2.0 * scene.middle - scene.base
    scene.obstacles = [body.obstacle for body in others]
    scene.obstacles += [Obstacle(part.hull, top) for part in parts]
    bodies: list[Body] = []
    for j, part in enumerate(parts):
        bodies.append(sketch(scene, first + j, part))
        scene.obstacles[first + j] = bodies[j].obstacle
    for j, body in enumerate(bodies):
        bodies[j] = compete(scene, first + j, body)
        scene.obstacles[first + j] = bodies[j].obstacle
    return bodies


_ALTERNATIVES: tuple[Alternative, ...] = (_afresh, _at_necks, _in_halves, _as_polygon)


def _touch(bodies: list[Body], size: float) -> bool:
    """Whether some of several bodies touch: together they are one solid."""
    outlines = [shapely.Polygon(each.footprint) for each in bodies]
    return any(a.distance(b) < _TOUCHING * size for a, b in combinations(outlines, 2))
