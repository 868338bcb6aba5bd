"""Kinds compete for a region: the simplest one that explains the beams around it wins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from primfit._check import Floats
from primfit.likelihood.beam_model import Beams
from primfit.likelihood.candidates import beams_near, ranked, sampled, tolerance_of
from primfit.likelihood.fitting import Fit, climb, coarse_to_fine, find_top, is_sliver
from primfit.likelihood.footprint_models import TEMPLATES, FootprintModel, Template, related
from primfit.likelihood.hypotheses import Candidate, Hypothesis, Region
from primfit.likelihood.obstacles import Obstacle
from primfit.likelihood.scene import Scene


def initial_fit(scene: Scene, i: int) -> Hypothesis:
    """All kinds fitted roughly to the beams around the region of solid i."""
    region = scene.solids[i].region
    beams, rough = _around(scene, i)
    top = find_top(rough, region.outline)
    fits = [_rough_fit(rough, template, region, top.z) for template in TEMPLATES]
    fits = _sorted_within(scene, region, fits)
    return Hypothesis.of_fits(region, fits, find_top(beams, fits[0].footprint))


def select_coarse(scene: Scene, i: int) -> Hypothesis:
    """The kinds of solid i on beams that know its neighbours; the better ones fitted well."""
    how, solid = scene.settings.selection, scene.solids[i]
    region = solid.region
    beams, rough = _around(scene, i)
    top = find_top(rough, solid.footprint)
    known = {each.fit.shape: each.fit.parameters for each in solid.candidates}
    fits = [
        climb(rough, template, known[template], top.z, steps=how.rough_steps)
        if template in known
        else _rough_fit(rough, template, region, top.z)
        for template in TEMPLATES
    ]
    fits = _sorted_within(scene, region, fits)[: how.shortlist]
    fits = [coarse_to_fine(beams, fit.shape, fit.parameters, top.z, region.size) for fit in fits]
    fits = _sorted_within(scene, region, fits)
    fits = [fit for fit in fits if fit.cost <= fits[0].cost + 2.0 * how.climb_gain]
    return Hypothesis.of_fits(region, fits, find_top(beams, fits[0].footprint))


def fit_region(scene: Scene, i: int) -> Hypothesis:
    """The best kinds for the region of solid i from the beginning."""
    region = scene.solids[i].region
    scene = scene.with_solid(i, Hypothesis(region))
    return select_coarse(scene.with_solid(i, initial_fit(scene, i)), i)


def fit_regions(scene: Scene, first: int = 0) -> Scene:
    """All solids from the first on, while the others stand as they are known by then."""
    for fit in (initial_fit, select_coarse):
        # The second time the neighbours are more than regions.
        for i in range(first, len(scene.solids)):
            scene = scene.with_solid(i, fit(scene, i))
    return scene


def sample_candidates(scene: Scene, rng: np.random.Generator, first: int = 0) -> Scene:
    """Sample the kinds of the solids from the first on, with ever more beams.

    With few of them the posterior is wide, and tells where to go; kinds that fall behind are
    given up. In the last pass the neighbours are known better.
    """
    stride = scene.settings.selection.stride
    for strides in ((4 * stride,), (stride, 1)):
        for i in range(first, len(scene.solids)):
            scene = scene.with_solid(i, _select(scene, i, rng, strides))
    return scene


def with_related(beams: Beams, fits: list[Fit], top: float) -> list[Fit]:
    """Fits, and their relatives fitted from where they are, since the one is a case of the other.

    Each may have climbed to a place of its own; the better of each kind stays.
    """
    found = list(fits)
    for fit in fits:
        starts = related(fit.shape, fit.parameters, beams.settings.models)
        found += [climb(beams, *start, top) for start in starts]
    best: dict[FootprintModel, Fit] = {}
    for fit in sorted(found, key=lambda each: each.cost):
        best.setdefault(fit.shape, fit)
    return list(best.values())


def _rough_fit(beams: Beams, template: Template, region: Region, top: float) -> Fit:
    guesses = _first_guesses(beams, template, region, top)
    steps = beams.settings.selection.rough_steps
    climbs = [climb(beams, template, guess, top, steps=steps) for guess in guesses]
    return min(climbs, key=lambda fit: fit.cost)


def _first_guesses(beams: Beams, template: Template, region: Region, top: float) -> list[Floats]:
    """The best of a grid of angles and sizes about a region, and the best at another angle."""
    how = beams.settings.selection
    shares, moves = how.shares, np.zeros((1, 2))
    if region.is_cut:
        steps = [[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)]
        shares, moves = how.cut_shares, how.move * region.size * np.array(steps)
    n_turns = max(int(np.ceil(template.period / how.turn)), 1)
    guesses = np.array(
        [
            template.together(np.array([*center, angle]), np.array(sizes))
            for center in region.center + moves
            for angle in np.arange(n_turns) / n_turns * template.period
            for share in shares
            for sizes in template.sizes_of_area(share * region.area)
        ]
    )
    tops = np.full(len(guesses), top)
    costs = beams.costs(template.points(guesses), tops, is_round=template.is_round)
    best = guesses[int(np.argmin(costs))]
    if not template.has_angle:
        return [best]
    turn = (guesses[:, 2] - best[2] + template.period / 2) % template.period - template.period / 2
    costs[np.abs(turn) < template.period / 5] = np.inf
    if not np.isfinite(costs).any():
        return [best]
    return [best, guesses[int(np.argmin(costs))]]


def _around(scene: Scene, i: int) -> tuple[Beams, Beams]:
    """Some beams around the region of solid i, and fewer of them, blurred."""
    how, solid = scene.settings.selection, scene.solids[i]
    region = solid.region
    place = scene.place_of(solid)
    beams = scene.near(*place, i, how.stride, how.most_beams // how.stride)
    blur = scene.settings.fitting.blur * region.size
    return beams, beams.thinned(how.rough_stride, blur)


def _sorted_within(scene: Scene, region: Region, fits: list[Fit]) -> list[Fit]:
    """Fits by cost, without those that leave the region, in which the solid is, or the room.

    Those that leave it explain what another solid should explain. When all do, the one that leaves
    it least stays.
    """
    share = scene.settings.selection.overhang
    place = shapely.Polygon(region.hull).buffer(share * region.size + region.cell)
    if scene.room is not None:
        place = place.intersection(shapely.make_valid(shapely.Polygon(scene.room.fit.footprint)))
    outlines = [shapely.make_valid(shapely.Polygon(fit.footprint)) for fit in fits]
    out = shapely.area(shapely.difference(outlines, place))
    within = [fit for fit, area in zip(fits, out, strict=True) if area < share * region.area]
    return sorted(within, key=lambda fit: fit.cost) or [fits[int(np.argmin(out))]]


def _select(scene: Scene, i: int, rng: np.random.Generator, strides: tuple[int, ...]) -> Hypothesis:
    """The kinds of solid i, sampled, on beams that know the neighbours better."""
    how, solid = scene.settings.selection, scene.solids[i]
    stride = min(how.stride, strides[-1])
    beams = beams_near(scene, i, stride, how.most_beams // stride)
    beams = beams.blurred(scene.settings.fitting.model_blur * tolerance_of(scene, solid))
    starts = [each for each in solid.candidates if each.stride]
    if not starts:
        top = find_top(beams, solid.footprint)
        fits = [each.fit for each in solid.candidates]
        climbs = [climb(beams, fit.shape, fit.parameters, top.z) for fit in fits]
        place = solid.obstacle
        fits = [fit for fit in climbs if _is_around(fit, place, how.away)] or fits
        least = min(fit.cost for fit in fits)
        fits = [fit for fit in with_related(beams, fits, top.z) if not is_sliver(fit)] or fits
        starts = [
            Candidate.unsampled(fit, top) for fit in fits if fit.cost <= least + how.climb_gain
        ]
    quick = scene.settings.sampling.quick
    for stride in strides:
        some, found, worst = beams.subset(stride), [], np.inf
        for start in starts:
            found.append(sampled(scene, some, start, stride, rng, quick, worst))
            if not is_sliver(found[-1].fit):
                worst = min(worst, found[-1].fit.cost + how.draw_gain)
        tolerable = max(each.tolerant_evidence for each in found) - how.draw_gain
        starts = [
            each for each in found if each.fit.cost <= worst or each.tolerant_evidence >= tolerable
        ]
    return replace(
        solid,
        candidates=ranked(found, how.rival_gain, how),
        model_error=tolerance_of(scene, solid),
    )


def _is_around(fit: Fit, place: Obstacle, away: float) -> bool:
    """Whether a fit is where the beams near a place tell of it: some climb into nowhere."""
    farthest = np.linalg.norm(fit.footprint - place.center, axis=1).max()
    return bool(farthest < away * place.radius)
