"""How a kind is sampled in the place of a solid, and how kinds are compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from primfit._check import Floats
from primfit.likelihood.beam_model import Beams
from primfit.likelihood.fitting import is_sliver, sample_posterior
from primfit.likelihood.footprint_models import FootprintModel, FreePolygon, n_sizes
from primfit.likelihood.hypotheses import Candidate, Hypothesis
from primfit.likelihood.obstacles import Obstacle
from primfit.likelihood.scene import Scene
from primfit.likelihood.settings import Effort, SelectionSettings


def sampled(
    scene: Scene,
    beams: Beams,
    start: Candidate,
    stride: int,
    rng: np.random.Generator,
    effort: Effort,
    worst: float = np.inf,
) -> Candidate:
    """A candidate sampled with one beam in `stride`, from what is known of it.

    It starts as wide as it is known with fewer beams, or it might miss a mode.
    """
    fit, top, found = sample_posterior(beams, start.fit, start.top, rng, effort, worst)
    evidence = found.log_evidence + fit.shape.log_prior(scene.model.max_range)
    d = fit.shape.n_parameters
    best = found.best[:d]
    drawn = Candidate(fit, top, best, evidence, -np.inf, found.cost, stride)
    return tolerated(scene, beams, drawn, [best, fit.parameters])


def tolerated(scene: Scene, beams: Beams, candidate: Candidate, places: list[Floats]) -> Candidate:
    """A candidate with the evidence if what the tolerance explains costs nothing.

    By the parameters, of those given, that cost least.
    """
    shape, z = candidate.fit.shape, candidate.top.z
    least = min(tolerant_cost(scene, beams, shape, each, z) for each in places)
    tolerant = candidate.evidence + candidate.cost - least
    return replace(candidate, tolerant_evidence=max(tolerant, candidate.tolerant_evidence))


def tolerant_cost(
    scene: Scene, beams: Beams, shape: FootprintModel, parameters: Floats, top: float
) -> float:
    """What some beams cost if each wall of a prism may be anywhere within the tolerance."""
    near, far, _ = ranges_within_tolerance(scene, beams, shape.frame(parameters)[0], top)
    costs = scene.model.fair_costs(beams.arrays[2], near, far, beams.arrays[4], beams.limits)
    return beams.stride * float(costs.sum())


def ranges_within_tolerance(
    scene: Scene, beams: Beams, footprint: Floats, top: float
) -> tuple[Floats, Floats, float]:
    """Nearest and farthest range of each beam that the tolerance of a prism admits, and that."""
    place = Obstacle(footprint, top)
    tolerance = scene.tolerance_of(place)
    limits = place.within(tolerance, scene.floor_z)
    one, other = (beams.prism_ranges(each.footprint, each.top) for each in limits)
    near, far = np.minimum(one, other), np.maximum(one, other)
    near[limits[0].swallows(beams.arrays[0])] = 0.0
    return near, far, tolerance


def ranked(
    candidates: list[Candidate], most_behind: float, how: SelectionSettings
) -> tuple[Candidate, ...]:
    """Candidates, the best first, without those that are far behind.

    The evidence of the ranges decides, but for the tolerance: of kinds that are about as good if
    what walls are off within it costs nothing, the one with the fewest sizes is the best. How well
    a shape that is off could be known is no measure of what a size more is worth, so that is told
    by the Bayesian information criterion. The evidence of free polygons is an upper bound, the
    looser the freer a corner is: of those about as likely, the one with the fewest corners is best.
    """
    candidates = [each for each in candidates if not is_sliver(each.fit)] or candidates
    best = max(candidates, key=lambda each: each.evidence)
    if isinstance(best.fit.shape, FreePolygon):
        least = best.evidence - how.loose_evidence
        polygons = [
            each
            for each in candidates
            if isinstance(each.fit.shape, FreePolygon) and each.evidence >= least
        ]
        best = min(polygons, key=lambda each: each.fit.shape.n_parameters)
    n = n_sizes(best.fit.shape)
    as_good = [
        each
        for each in candidates
        if (n_less := n - n_sizes(each.fit.shape)) > 0
        and each.tolerant_cost <= best.tolerant_cost + how.size_price * n_less
    ]
    if as_good:
        best = min(as_good, key=lambda each: (n_sizes(each.fit.shape), -each.evidence))
    others = [
        each
        for each in candidates
        if each is not best
        and max(each.evidence - best.evidence, each.tolerant_evidence - best.tolerant_evidence)
        >= -most_behind
    ]
    return (best, *sorted(others, key=lambda each: -each.evidence))


def tolerance_of(scene: Scene, solid: Hypothesis) -> float:
    """By how much the walls of a solid may be off, metres."""
    return scene.tolerance_of(solid.obstacle)


def beams_near(scene: Scene, i: int, stride: int, most: int) -> Beams:
    """Beams, one in `stride` and not more than `most`, around solid i as it is known."""
    place = scene.solids[i].obstacle
    radius = scene.settings.selection.near * place.radius
    return scene.near(place.center, radius, i, stride, most)
