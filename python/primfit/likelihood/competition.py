"""Kinds compete for a seed: the one that the beams around it make most likely wins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from primfit._check import Floats
from primfit.likelihood.beams import Beams
from primfit.likelihood.carving import Seed
from primfit.likelihood.fitting import Fit, Top, approach, climb, find_top, settle
from primfit.likelihood.sampling import QUICK, THOROUGH, Effort
from primfit.likelihood.scene import Obstacle, Scene
from primfit.likelihood.templates import RECTANGLE, TEMPLATES, FreePolygon, Shape, Template, kin

_OUT = 0.1
"""How far a solid may leave its seed, beyond a cell, as a fraction of the seed's size and area."""

SOME = 4
"""One beam in so many is enough to tell which kinds are worth sampling."""

_ROUGH = 2
"""One of these in so many is enough to tell kinds roughly apart."""

_BLUR = 0.05
"""Least standard deviation of a rough fit, as a fraction of the size."""

_STEPS = 5
"""Of a rough fit."""

_TURNS = 0.17
"""Steps of the angle in which a guess is sought, radians."""

_SHARES = (0.75, 0.95)
"""Areas of guesses, as shares of the seed's, which is never too small."""

_CUT_SHARES = (0.3, 0.5, *_SHARES)
"""The same of a part of a seed."""

_CUT_MOVES = 0.2 * np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)])
"""Where the centre of its solid is sought from its own, in its size."""

_SHORTLIST = 5
"""Kinds that are fitted well after a rough fit."""

_RIVALS = 15.0
"""Log-evidence that a kind may lack against the best to stay in the competition."""

_LOOSE = 20.0
"""Log-evidence by which that of a free polygon may be too large: it is an upper bound, and the
looser the freer a corner is, as one is that may slide along a wall."""

_BEHIND = 1500.0
"""Log-likelihood by which a climb may be behind the best to be sampled: silhouettes hold climbs."""

_LOST = 20.0
"""Log-likelihood by which the best draw with few beams may be behind to be sampled with more."""

_AWAY = 2.0
"""How far corners may be from the centre of a body, in its radius."""

_LEVELS = ((4 * SOME,), (SOME, 1))
"""One beam in so many by which bodies are sampled, in passes: neighbours are known better by the
second."""


@dataclass(frozen=True, eq=False)
class Contender:
    """A kind, and what the beams tell of it.

    Attributes
    ----------
    fit : Fit
        Mean and covariance of its posterior, once it is sampled.
    top : Top
    best : (d,) float64
        Parameters of the least cost seen.
    evidence : float
        Logarithm of the likelihood of the kind, whatever its parameters; before it is sampled,
        that of the fit.
    stride : int
        One beam in so many was sampled; 0 before.
    """

    fit: Fit
    top: Top
    best: Floats
    evidence: float
    stride: int = 0


@dataclass(frozen=True, eq=False)
class Body:
    """A solid of the scene, as its beams tell it.

    Attributes
    ----------
    contenders : tuple of Contender
        The most likely first.
    seed : Seed
        What it grew from.
    """

    contenders: tuple[Contender, ...]
    seed: Seed

    @property
    def footprint(self) -> Floats:
        """Corners (m, 2) of the most likely kind, metres."""
        return self.contenders[0].fit.footprint

    @cached_property
    def obstacle(self) -> Obstacle:
        """What it is to beams."""
        return Obstacle(self.footprint, self.top.z)

    @property
    def top(self) -> Top:
        """Of the most likely kind."""
        return self.contenders[0].top


def first_guesses(beams: Beams, template: Template, seed: Seed, top: float) -> list[Floats]:
    """The best of a grid of angles and sizes about a seed, and the best at another angle."""
    shares = _CUT_SHARES if seed.is_cut else _SHARES
    moves = float(np.sqrt(seed.area)) * _CUT_MOVES if seed.is_cut else np.zeros((1, 2))
    n_turns = int(np.ceil(template.period / _TURNS))
    guesses = np.array(
        [
            [*center, angle, *sizes]
            for center in seed.center + moves
            for angle in np.arange(n_turns) / n_turns * template.period
            for share in shares
            for sizes in template.sizes_of_area(share * seed.area)
        ]
    )
    costs = beams.costs(template.footprints(guesses), np.full(len(guesses), top))
    best = guesses[int(np.argmin(costs))]
    turn = (guesses[:, 2] - best[2] + template.period / 2) % template.period - template.period / 2
    costs[np.abs(turn) < template.period / 5] = np.inf
    return [best, guesses[int(np.argmin(costs))]]


def sketch(scene: Scene, i: int, seed: Seed) -> Body:
    """All kinds fitted roughly to the beams around a seed, which is obstacle i of the scene."""
    beams, top, rough = _around(scene, i, seed, seed.outline)
    fits = [_rough_fit(rough, template, seed, top.z) for template in TEMPLATES]
    fits = _sorted_within(scene, seed, fits)
    return as_body(fits, find_top(beams, fits[0].footprint), seed)


def compete(scene: Scene, i: int, body: Body) -> Body:
    """The kinds of a sketch, body i, on beams that know the neighbours; the better ones well."""
    seed = body.seed
    beams, top, rough = _around(scene, i, seed, body.footprint)
    known = {each.fit.shape: each.fit.parameters for each in body.contenders}
    fits = [
        climb(rough, template, known[template], top.z, steps=_STEPS)
        if template in known
        else _rough_fit(rough, template, seed, top.z)
        for template in TEMPLATES
    ]
    fits = _sorted_within(scene, seed, fits)[:_SHORTLIST]
    size = float(np.sqrt(seed.area))
    fits = [approach(beams, fit.shape, fit.parameters, top.z, size) for fit in fits]
    fits = _sorted_within(scene, seed, fits)
    fits = [fit for fit in fits if fit.cost <= fits[0].cost + 2.0 * _BEHIND]
    return as_body(fits, find_top(beams, fits[0].footprint), seed)


def _rough_fit(beams: Beams, template: Template, seed: Seed, top: float) -> Fit:
    guesses = first_guesses(beams, template, seed, top)
    climbs = [climb(beams, template, guess, top, steps=_STEPS) for guess in guesses]
    return min(climbs, key=lambda fit: fit.cost)


def _around(scene: Scene, i: int, seed: Seed, footprint: Floats) -> tuple[Beams, Top, Beams]:
    """Some beams around a seed, the top over a rough footprint, and fewer beams, blurred."""
    beams = scene.near(seed.center, 1.3 * seed.radius, i, SOME)
    blur = _BLUR * float(np.sqrt(seed.area))
    return beams, find_top(beams.thinned(1, blur), footprint), beams.thinned(_ROUGH, blur)


def _sorted_within(scene: Scene, seed: Seed, fits: list[Fit]) -> list[Fit]:
    """Fits by cost, without those that leave the seed, in which the solid is, or the room.

    Those that leave it explain what another solid should explain. When all do, the one that leaves
    it least stays.
    """
    place = shapely.Polygon(seed.hull).buffer(_OUT * float(np.sqrt(seed.area)) + seed.cell)
    if scene.room is not None:
        place = place.intersection(shapely.Polygon(scene.room.footprint))
    outlines = [shapely.make_valid(shapely.Polygon(fit.footprint)) for fit in fits]
    out = shapely.area(shapely.difference(outlines, place))
    within = [fit for fit, area in zip(fits, out, strict=True) if area < _OUT * seed.area]
    return sorted(within, key=lambda fit: fit.cost) or [fits[int(np.argmin(out))]]


def as_body(fits: list[Fit], top: Top, seed: Seed) -> Body:
    """Fits that have not been sampled as a body, the best first."""
    return Body(tuple(_unsampled(fit, top) for fit in fits), seed)


def _unsampled(fit: Fit, top: Top) -> Contender:
    return Contender(fit, top, fit.parameters, -fit.cost)


def compete_finely(scene: Scene, bodies: list[Body], first: int, rng: np.random.Generator) -> None:
    """Sample the contenders of the bodies of a scene from the first on, in place."""
    for levels in _LEVELS:
        for i in range(first, len(bodies)):
            bodies[i] = _compete_again(scene, i, bodies[i], rng, levels)
            scene.obstacles[i] = bodies[i].obstacle


def _compete_again(
    scene: Scene,
    i: int,
    body: Body,
    rng: np.random.Generator,
    levels: tuple[int, ...],
) -> Body:
    """The contenders of body i again, sampled, on beams that know the neighbours better.

    They are sampled with few of the beams first, which know less narrowly where to go, then with
    more; kinds that fall behind are given up.
    """
    beams = _near(scene, i, body, min(SOME, levels[-1]))
    starts = [each for each in body.contenders if each.stride]
    if not starts:
        top = find_top(beams, body.footprint)
        fits = [each.fit for each in body.contenders]
        climbs = [climb(beams, fit.shape, fit.parameters, top.z) for fit in fits]
        fits = [fit for fit in climbs if _is_around(fit, body.obstacle)] or fits
        least = min(fit.cost for fit in fits)
        fits = with_kin(beams, fits, top.z)
        starts = [_unsampled(fit, top) for fit in fits if fit.cost <= least + _BEHIND]
    for stride in levels:
        some, contenders, worst = beams.some(stride), [], np.inf
        for start in starts:
            contenders.append(_sampled(scene, some, start, stride, rng, QUICK, worst))
            worst = min(worst, contenders[-1].fit.cost + _LOST)
        starts = [each for each in contenders if each.fit.cost <= worst]
    contenders.sort(key=lambda each: -each.evidence)
    best = contenders[0].evidence
    return Body(tuple(each for each in contenders if each.evidence >= best - _RIVALS), body.seed)


def weigh(scene: Scene, i: int, body: Body, rng: np.random.Generator) -> Body:
    """The best contender of body i alone, sampled as well as a report needs it.

    It meets its rivals once more, since neighbours were known less when it beat them, and its kin
    from where it is, since each may have been sampled in a mode of its own.
    """
    beams = _near(scene, i, body, 1)
    # All start from one top: few beams tell little of it, and one may hold a sampler where it is.
    top = find_top(beams, body.footprint)
    rivals = [
        _sampled(scene, beams, replace(each, top=top), 1, rng, THOROUGH) for each in body.contenders
    ]
    winner = None
    while (best := _simplest(rivals)) is not winner:
        winner = best
        costs = {each.fit.shape: each.fit.cost for each in rivals}
        # Between corners that may slide along a wall, a mean is no good place to start from.
        for shape, start in kin(best.fit.shape, best.best):
            if costs.get(shape, np.inf) > best.fit.cost:
                relative = _unsampled(climb(beams, shape, start, top.z), top)
                relative = _sampled(scene, beams, relative, 1, rng, QUICK)
                rivals.append(_sampled(scene, beams, relative, 1, rng, THOROUGH))
    return Body((replace(best, fit=_longest_first(best.fit)),), body.seed)


def _simplest(rivals: list[Contender]) -> Contender:
    """The most likely one; of free polygons about as likely, the one with the fewest corners."""
    winner = max(rivals, key=lambda each: each.evidence)
    if not isinstance(winner.fit.shape, FreePolygon):
        return winner
    as_likely = [
        each
        for each in rivals
        if isinstance(each.fit.shape, FreePolygon) and each.evidence >= winner.evidence - _LOOSE
    ]
    return min(as_likely, key=lambda each: each.fit.shape.n_parameters)


def _longest_first(fit: Fit) -> Fit:
    """A rectangle whose first size is the larger one."""
    if fit.shape is not RECTANGLE or fit.parameters[3] >= fit.parameters[4]:
        return fit
    order = [0, 1, 2, 4, 3]
    turned = fit.parameters[order] + [0.0, 0.0, np.pi / 2, 0.0, 0.0]
    return replace(fit, parameters=turned, covariance=fit.covariance[np.ix_(order, order)])


def _near(scene: Scene, i: int, body: Body, stride: int) -> Beams:
    place = body.obstacle
    return scene.near(place.center, 1.2 * place.radius, i, stride)


def _is_around(fit: Fit, place: Obstacle) -> bool:
    """Whether a fit is where the beams near a place tell of it: some climb into nowhere."""
    away = np.linalg.norm(fit.footprint - place.center, axis=1).max()
    return bool(away < _AWAY * place.radius)


def _sampled(
    scene: Scene,
    beams: Beams,
    start: Contender,
    stride: int,
    rng: np.random.Generator,
    effort: Effort,
    worst: float = np.inf,
) -> Contender:
    """A contender sampled with one beam in `stride`, from what is known of it.

    It starts as wide as it is known with fewer beams, lest it miss a mode.
    """
    fit, top, found = settle(beams, start.fit, start.top, rng, effort, worst)
    evidence = found.log_evidence + fit.shape.log_prior(scene.noise.reach)
    return Contender(fit, top, found.best[: fit.shape.n_parameters], evidence, stride)


def with_kin(beams: Beams, fits: list[Fit], top: float) -> list[Fit]:
    """Fits, and their kin fitted from where they are, since the one is a case of the other.

    Each may have climbed to a place of its own; the better of each kind stays.
    """
    found = list(fits)
    for fit in fits:
        found += [climb(beams, *start, top) for start in kin(fit.shape, fit.parameters)]
    best: dict[Shape, Fit] = {}
    for fit in sorted(found, key=lambda each: each.cost):
        best.setdefault(fit.shape, fit)
    return list(best.values())
