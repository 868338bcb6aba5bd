"""Kinds compared, and misfits mended, with the poses free to follow.

The errors of a pose are common to its beams, so what beams near one solid say at fixed poses would
count for too much. After Gauss-Newton steps of poses and map together, the cost of a scene is that
with the poses marginalised, but for the same factor in all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from primfit._check import Bools, Floats
from primfit.likelihood.bundle import Normal, Problem, Robust, descend, settled
from primfit.likelihood.candidates import tolerance_of
from primfit.likelihood.fitting import Fit
from primfit.likelihood.footprint_models import NESTED, FootprintModel, Template, n_sizes
from primfit.likelihood.hypotheses import Hypothesis
from primfit.likelihood.refinement import ALTERNATIVES, best_instead, prune
from primfit.likelihood.scene import Recording, Scene
from primfit.likelihood.settings import LikelihoodSettings


def mended(problem: Problem, rng: np.random.Generator) -> Problem:
    """Solids that do not explain the beams of well known poses replaced, if all beams agree."""
    how = problem.scene.settings
    if not problem.scene.solids:
        return problem
    scene = _judged(problem)
    pruned = prune(scene)
    if len(pruned.solids) < len(scene.solids):
        problem = _settled(problem, replace(problem.scene, solids=pruned.solids))
        scene = _judged(problem)
    misfits = {id(solid): scene.misfit(solid) for solid in scene.solids}
    suspects = [each for each in scene.solids if misfits[id(each)] > how.refinement.misfit]
    for solid in sorted(suspects, key=lambda each: -misfits[id(each)]):
        places = [k for k, each in enumerate(problem.scene.solids) if each.region is solid.region]
        if not places:
            continue
        others = scene.without(places[0])
        best = best_instead(others, scene.solids[places[0]], ALTERNATIVES, rng)
        tried = _settled(problem, replace(problem.scene, solids=(*others.solids, *best)))
        # Where beams leave silhouettes, costs jump by a few of them.
        if _price(tried) < _price(problem) - how.refinement.certain_gain:
            problem, scene = tried, _judged(tried)
    return problem


def with_two_sizes(problem: Problem) -> Problem:
    """Solids with one size as the kind with two that they may be a case of."""
    solids = tuple(_with_two_sizes(each) for each in problem.scene.solids)
    scene = replace(problem.scene, solids=solids)
    return problem.at(scene, problem.track.poses, problem.track.shared)


def simplest_kinds(problem: Problem) -> Problem:
    """Solids with two sizes as the kind with one where these are equal.

    By how far the sizes differ in their standard deviations with the poses marginalised (Wald's
    test): costs themselves jump where beams leave a silhouette.
    """
    covariance = problem.normal(_final(problem)).covariances()[0]
    simpler, at = [], 0
    for solid in problem.scene.solids:
        n = solid.best.fit.shape.n_parameters
        simpler.append(_simpler(problem.scene, solid, covariance[at : at + n, at : at + n]))
        at += n
    if all(a is b for a, b in zip(simpler, problem.scene.solids, strict=True)):
        return problem
    scene = replace(problem.scene, solids=tuple(simpler))
    tried = problem.at(scene, problem.track.poses, problem.track.shared)
    return settled(tried, scene.settings.poses)


def _with_two_sizes(solid: Hypothesis) -> Hypothesis:
    """A solid as its rival of which it is a special case, if it has such a rival."""
    for rival in solid.candidates[1:]:
        one, two = solid.best.fit.shape, rival.fit.shape
        if isinstance(one, Template) and isinstance(two, Template) and NESTED.get(two) is one:
            place, sizes = one.apart(solid.best.fit.parameters)
            return _as_kind(solid, two, two.together(place, np.repeat(sizes, 2)))
    return solid


def _simpler(scene: Scene, solid: Hypothesis, covariance: Floats) -> Hypothesis:
    """A solid with two sizes as one with one, if these are equal but for noise and tolerance."""
    shape, parameters = solid.best.fit.shape, solid.best.fit.parameters
    if not isinstance(shape, Template) or shape not in NESTED:
        return solid
    place, sizes = shape.apart(parameters)
    variance = float(covariance[3, 3] - 2.0 * covariance[3, 4] + covariance[4, 4])
    off = max(abs(sizes[0] - sizes[1]) - 2.0 * tolerance_of(scene, solid), 0.0)
    if 0.5 * off**2 > scene.settings.selection.size_price * variance:
        return solid
    simpler = NESTED[shape]
    return _as_kind(solid, simpler, simpler.together(place, np.sqrt(sizes[:1] * sizes[1:])))


def _as_kind(solid: Hypothesis, shape: FootprintModel, parameters: Floats) -> Hypothesis:
    n = len(parameters)
    fit = Fit(shape, parameters, np.zeros((n, n)), solid.best.fit.cost)
    best = replace(solid.best, fit=fit, best=parameters)
    return replace(solid, candidates=(best, *solid.candidates[1:]))


def _settled(problem: Problem, scene: Scene) -> Problem:
    """Another scene where poses and map balance."""
    how = scene.settings.poses
    tried = problem.at(scene, problem.track.poses, problem.track.shared)
    tried = descend(tried, (0.0, how.soft_scale, how.soft_cut), how.level_steps, how)
    return settled(tried, how)


def _price(problem: Problem) -> float:
    """What all beams cost, and the parameters of the solids."""
    fits = [solid.best.fit for solid in problem.scene.solids]
    sizes = sum(3 + n_sizes(fit.shape) for fit in fits)
    price = problem.scene.settings.selection.size_price
    return problem.normal(_final(problem)).cost + price * sizes


def _final(problem: Problem) -> Robust:
    return (0.0, np.inf, problem.scene.settings.poses.cut)


def _judged(problem: Problem) -> Scene:
    """The scene as the beams of well known poses see it."""
    track = problem.track
    normal = problem.normal(_final(problem))
    covariances = normal.covariances()[1]
    rows = np.flatnonzero(track.each(is_well_known(problem, normal)))
    model = problem.scene.model
    sigma = np.hypot(model.sigma, track.added_sigma(covariances))
    slack = 2.0 * float(np.median(track.added_sigma(covariances)[rows]))
    return replace(
        problem.scene,
        recording=Recording.of(track.moved().select(rows)),
        model=replace(model, sigma=sigma).of_beams(rows),
        settings=_tolerant(problem.scene, slack),
    )


def _tolerant(scene: Scene, slack: float) -> LikelihoodSettings:
    """Settings with as much more tolerance as poses may move what the beams see of a wall."""
    how = scene.settings
    if how.tolerance is not None:
        return replace(how, tolerance=how.tolerance + slack)
    sizes = [solid.obstacle.size for solid in scene.solids]
    return replace(how, tolerance_share=how.tolerance_share + slack / np.median(sizes))


def is_well_known(problem: Problem, normal: Normal) -> Bools:
    """Poses that the map tells about as well as the others, and that fit it as well.

    Where many fit it worse than the others the map is at fault, and they tell that.
    """
    how, covariances = problem.scene.settings.poses, normal.covariances()[1]
    reach = problem.track.typical_range
    variance = covariances[:, 0, 0] + covariances[:, 1, 1] + reach**2 * covariances[:, 2, 2]
    is_known = variance <= how.best_known**2 * np.median(variance)
    suspects = problem.is_suspect(normal.beam_costs)
    return is_known & ~suspects if suspects.mean() < how.most_suspects else is_known
