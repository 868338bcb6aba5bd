"""Bodies that do not explain their beams: other ways to fill their place are tried."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import shapely

from primfit._check import Ints
from primfit.carving import Seed
from primfit.competition import (
    ALL_BEAMS,
    FEW_BEAMS,
    QUICK,
    Body,
    as_body,
    compete,
    compete_again,
)
from primfit.fitting import find_top
from primfit.polygons import fit_polygons
from primfit.scene import Obstacle, Scene

MISFIT = 2.5
"""Standard deviations by which the beams of a body may fit worse than their noise explains."""

_AROUND = 1.3
"""Radius within which beams tell of a body, as a multiple of its seed's."""

_TOUCHING = 0.02
"""Distance, as a fraction of the size, below which parts of a seed are one solid."""

_LEAST_CELLS = 9
"""Cells of the smallest part of a seed."""


def repair(scene: Scene, bodies: list[Body], cell: float, rng: np.random.Generator) -> None:
    """Replace bodies, in place, by others where these explain more.

    First by themselves, with all beams. Then another kind, now that the neighbours are known, the
    parts of the seed, and a free polygon compete by the Bayesian information criterion on the beams
    that come near.
    """
    for i, body in enumerate(bodies):
        if _misfit(scene, body) > MISFIT:
            bodies[i] = compete_again(scene, i, body, rng, ALL_BEAMS, QUICK)
            scene.obstacles[i] = bodies[i].obstacle
    queue = list(range(len(bodies)))
    while queue:
        i = queue.pop(0)
        seed = bodies[i].seed
        if _misfit(scene, bodies[i]) <= MISFIT:
            continue
        rows = scene.rows_near(seed.center, _AROUND * seed.radius)
        others = bodies[:i] + bodies[i + 1 :]
        best = [bodies[i]]
        least = _score(scene, others, best, rows)
        for alternative in (_afresh, _cut, _as_polygon):
            option = alternative(scene, others, bodies[i], cell)
            scene.obstacles = [body.obstacle for body in others + option]
            for j in range(len(others), len(scene.obstacles)):
                body = _sampled(scene, j, option[j - len(others)], rng)
                option[j - len(others)] = body
                scene.obstacles[j] = body.obstacle
            if not option or _touch(option, float(np.sqrt(seed.area))):
                continue
            score = _score(scene, others, option, rows)
            if score < least:
                best, least = option, score
                scene.obstacles = [body.obstacle for body in others + option]
                if _misfit(scene, bodies[i]) <= MISFIT:
                    break
        bodies[:] = others + best
        scene.obstacles = [body.obstacle for body in bodies]
        if len(best) > 1:
            # The order has changed: the bodies behind i moved up, the new ones are last.
            queue = [k - (k > i) for k in queue] + list(range(len(others), len(bodies)))
        else:
            queue = [k - (k > i) for k in queue]


def _misfit(scene: Scene, body: Body) -> float:
    return scene.misfit(body.seed.center, _AROUND * body.seed.radius)


def _sampled(scene: Scene, i: int, body: Body, rng: np.random.Generator) -> Body:
    return compete_again(scene, i, body, rng, FEW_BEAMS + ALL_BEAMS, QUICK)


def _score(scene: Scene, others: list[Body], bodies: list[Body], rows: Ints) -> float:
    scene.obstacles = [body.obstacle for body in others + bodies]
    n_parameters = sum(body.contenders[0].fit.shape.n_parameters for body in bodies)
    cost = float(scene.costs(rows)[0].sum())
    return cost + 0.5 * float(np.log(len(rows))) * n_parameters


def _afresh(scene: Scene, others: list[Body], body: Body, _: float) -> list[Body]:
    """The best kind for the body's seed, among neighbours that were seeds when it was found."""
    scene.obstacles = [each.obstacle for each in [*others, body]]
    return [compete(scene, len(others), body.seed)]


def _as_polygon(scene: Scene, others: list[Body], body: Body, _: float) -> list[Body]:
    """The body as a free polygon, or as a known kind where that is."""
    seed, top = body.seed, body.obstacle.top
    scene.obstacles = [each.obstacle for each in others]
    beams = scene.near(seed.center, _AROUND * seed.radius, without=None)
    size = float(np.sqrt(seed.area))
    polygons = fit_polygons(beams, [seed.outline, body.footprint], top, size)
    if not polygons:
        return []
    # The polygon may tell the place of a known kind better than the seed.
    place = Seed.of_outline(polygons[0].footprint)
    scene.obstacles.append(Obstacle(place.outline, top))
    kinds = [each.fit for each in compete(scene, len(others), place).contenders]
    return [as_body(polygons + kinds, find_top(beams, polygons[0].footprint), seed)]


def _cut(scene: Scene, others: list[Body], body: Body, cell: float) -> list[Body]:
    """Two or more bodies from the parts of a body's seed."""
    parts = body.seed.parts or body.seed.halves()
    parts = tuple(part for part in parts if part.area > _LEAST_CELLS * cell**2)
    if len(parts) < 2:
        return []
    first = len(others)
    top = 2.0 * scene.middle - scene.base
    scene.obstacles = [body.obstacle for body in others]
    scene.obstacles += [Obstacle(part.hull, top) for part in parts]
    bodies: list[Body] = []
    for j, part in enumerate(parts):
        bodies.append(compete(scene, first + j, part))
        scene.obstacles[first + j] = bodies[j].obstacle
    for j in range(len(parts)):
        bodies[j] = compete(scene, first + j, parts[j])
        scene.obstacles[first + j] = bodies[j].obstacle
    return bodies


def _touch(bodies: list[Body], size: float) -> bool:
    """Whether some of several bodies touch: together they are one solid."""
    outlines = [shapely.Polygon(each.footprint) for each in bodies]
    return any(a.distance(b) < _TOUCHING * size for a, b in combinations(outlines, 2))
