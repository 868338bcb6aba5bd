"""Kinds compete for a seed: the one that the beams around it make most likely wins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely

from primfit._check import Floats
from primfit.beams import Beams
from primfit.carving import Seed
from primfit.fitting import Fit, Top, approach, climb, find_top, settle
from primfit.sampling import Effort
from primfit.scene import Obstacle, Scene
from primfit.templates import TEMPLATES, Shape, Template, kin

_OUT = 0.1
"""How far a solid may leave its seed, as a fraction of the seed's size and of its area."""

_ROUGH = 8
"""One beam in so many is enough to tell kinds roughly apart."""

_TURNS = 0.17
"""Steps of the angle in which a guess is sought, radians."""

_SHARES = (0.75, 0.95)
"""Areas of guesses, as shares of the seed's, which is never too small."""

_SHORTLIST = 5
"""Kinds that are fitted well after a rough fit."""

_RIVALS = 15.0
"""Log-evidence that a kind may lack against the best to stay in the competition."""

_BEHIND = {16: 3000.0, 4: 1000.0, 1: 300.0}
"""Log-likelihood by which a kind may be behind the best to be sampled with one beam in so many."""

FEW_BEAMS, ALL_BEAMS = (16, 4), (1,)
"""Levels of sampling: one beam in so many."""

_WIDER = 3.0
"""By how much the variance is widened from a level to the next, which may know better."""


@dataclass(frozen=True, eq=False)
class Contender:
    """A kind, and what the beams tell of it.

    Attributes
    ----------
    fit : Fit
        Mean and covariance of its posterior, once it is sampled.
    top : Top
    evidence : float
        Logarithm of the likelihood of the kind, whatever its parameters; before it is sampled,
        that of the fit.
    size : float
        Effective number of draws; 0 before it is sampled.
    """

    fit: Fit
    top: Top
    evidence: float
    size: float = 0.0


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

    @property
    def obstacle(self) -> Obstacle:
        """What it is to beams."""
        return Obstacle(self.footprint, self.top.z)

    @property
    def top(self) -> Top:
        """Of the most likely kind."""
        return self.contenders[0].top


def first_guesses(
    beams: Beams,
    template: Template,
    seed: Seed,
    top: float,
    shares: tuple[float, ...] = _SHARES,
) -> list[Floats]:
    """The best of a grid of angles and sizes about a seed, and the best at another angle."""
    n_turns = int(np.ceil(template.period / _TURNS))
    guesses = np.array(
        [
            [*seed.center, angle, *sizes]
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


def compete(scene: Scene, i: int, seed: Seed, shortlist: int = _SHORTLIST) -> Body:
    """All kinds on the beams around a seed, which is obstacle i of the scene.

    A short list of them goes beyond a rough fit.
    """
    beams = scene.near(seed.center, 1.3 * seed.radius, without=i)
    size = float(np.sqrt(seed.area))
    top = find_top(beams, seed.outline)
    rough = beams.thinned(_ROUGH, 0.05 * size)
    fits = []
    for template in TEMPLATES:
        guesses = first_guesses(rough, template, seed, top.z)
        climbs = [climb(rough, template, guess, top.z, steps=5) for guess in guesses]
        fits.append(min(climbs, key=lambda fit: fit.cost))
    fits = _sorted_within(scene, seed, fits)[:shortlist]
    fits = [approach(beams, fit.shape, fit.parameters, top.z, size) for fit in fits]
    fits = _sorted_within(scene, seed, fits)
    return as_body(fits, find_top(beams, fits[0].footprint), seed)


def _sorted_within(scene: Scene, seed: Seed, fits: list[Fit]) -> list[Fit]:
    """Fits by cost, without those that leave the seed, in which the solid is, or the room.

    Those that leave it explain what another solid should explain. When all do, the one that leaves
    it least stays.
    """
    place = shapely.Polygon(seed.hull).buffer(_OUT * float(np.sqrt(seed.area)))
    if scene.room is not None:
        place = place.intersection(shapely.Polygon(scene.room))
    outlines = [shapely.make_valid(shapely.Polygon(fit.footprint)) for fit in fits]
    out = shapely.area(shapely.difference(outlines, place))
    within = [fit for fit, area in zip(fits, out, strict=True) if area < _OUT * seed.area]
    return sorted(within, key=lambda fit: fit.cost) or [fits[int(np.argmin(out))]]


def as_body(fits: list[Fit], top: Top, seed: Seed) -> Body:
    """Fits that have not been sampled as a body, the best first."""
    return Body(tuple(Contender(fit, top, -fit.cost) for fit in fits), seed)


def compete_again(
    scene: Scene,
    i: int,
    body: Body,
    rng: np.random.Generator,
    levels: tuple[int, ...],
    effort: Effort,
) -> Body:
    """The contenders of body i again, sampled, on beams that know the neighbours better.

    They are sampled with few of the beams first, which know less narrowly where to go, then with
    more; kinds that fall behind are given up.
    """
    place = body.obstacle
    beams = scene.near(place.center, 1.2 * place.radius, without=i)
    tops = {each.fit.shape: each.top for each in body.contenders if each.size}
    top = body.top if tops else find_top(beams, body.footprint)
    fits = [
        replace(each.fit, cost=_cost(beams, each.fit, each.top))
        if each.size
        else climb(beams, each.fit.shape, each.fit.parameters, top.z)
        for each in body.contenders
    ]
    states = [(fit, tops.get(fit.shape, top)) for fit in with_kin(beams, fits, top.z)]
    contenders: list[Contender] = []
    for stride in levels:
        least = min(fit.cost for fit, _ in states)
        some = beams.some(stride)
        contenders = [
            _settled(scene, some, fit, top, rng, effort)
            for fit, top in states
            if fit.cost <= least + _BEHIND[stride]
        ]
        states = [_widened(beams, each.fit, each.top) for each in contenders]
    contenders.sort(key=lambda each: -each.evidence)
    best = contenders[0].evidence
    return Body(tuple(each for each in contenders if each.evidence >= best - _RIVALS), body.seed)


def _settled(
    scene: Scene, beams: Beams, fit: Fit, top: Top, rng: np.random.Generator, effort: Effort
) -> Contender:
    fit, top, found = settle(beams, fit, top, rng, effort)
    evidence = found.log_evidence + fit.shape.log_prior(scene.noise.reach)
    return Contender(fit, top, evidence, found.size)


def _widened(beams: Beams, fit: Fit, top: Top) -> tuple[Fit, Top]:
    """A fit to some of the beams, as a place to start from with more of them."""
    return replace(fit, cost=_cost(beams, fit, top), covariance=_WIDER * fit.covariance), top


def _cost(beams: Beams, fit: Fit, top: Top) -> float:
    return float(beams.costs(fit.footprint[None], np.array([top.z]))[0])


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
