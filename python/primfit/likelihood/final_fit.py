"""A solid as it is reported: its kind once more, and its posterior by all beams near it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from primfit._check import Floats
from primfit.likelihood.beam_model import Beams
from primfit.likelihood.candidates import (
    beams_near,
    ranges_within_tolerance,
    ranked,
    sampled,
    tolerance_of,
    tolerant_cost,
    tolerated,
)
from primfit.likelihood.fitting import Fit, climb, find_top, is_sliver
from primfit.likelihood.footprint_models import (
    FreePolygon,
    half_seen,
    n_sizes,
    related,
)
from primfit.likelihood.hypotheses import Candidate, Hypothesis
from primfit.likelihood.obstacles import Obstacle
from primfit.likelihood.scene import Scene

_ANNEALINGS = 4
"""Times that the walls of a solid are taken as more exact."""

_STRETCHES = 8
"""Stretches of a wall: a bend or a step shows in each half, whatever its ends do."""

_BEND = 2.0
"""How far a corner may be moved, in the tolerance of the walls: that of a triangle moves twice as
far as its walls."""

_GRAZING = 6.0
"""Beams whose range the tolerance changes by more than this times itself pass by or graze: at 70
degrees to a wall and less it is below."""


def final_posterior(scene: Scene, i: int, rng: np.random.Generator) -> Hypothesis:
    """The best kind of solid i alone, sampled as well as a report needs it.

    It meets its rivals once more, since neighbours were known less when it beat them, and its
    relatives from where it is, since each may have been sampled in a mode of its own. Where its
    silhouettes contradict it, the solid is not quite of its kind: then beams that meet it or not
    depending on the tolerance do not count.
    """
    solid = scene.solids[i]
    beams = beams_near(scene, i, 1, scene.settings.sampling.most_beams)
    solid = _with_relatives(scene, beams, solid, rng)
    best, error = _annealed(scene, beams, solid.best, solid.model_error, rng)
    if _excess(beams, best) > scene.settings.refinement.misfit:
        clear = _without_silhouettes(scene, beams, best)
        best, error = _annealed(scene, clear, best, tolerance_of(scene, solid), rng)
        # Those beams tell the top all the same.
        best = replace(best, top=find_top(beams.blurred(error), best.fit.footprint))
    _, doubt = model_error(beams, best.fit, best.top.z)
    best = replace(best, fit=_longest_first(best.fit))
    most = scene.settings.fitting.model_blur * tolerance_of(scene, solid)
    candidates = (_as_doubtful(best, solid.candidates), *solid.candidates[1:])
    return replace(solid, candidates=candidates, model_error=error, doubt=min(doubt, most))


def _as_doubtful(best: Candidate, rivals: tuple[Candidate, ...]) -> Candidate:
    """The best kind with a covariance that holds the centres of its rivals, too.

    Where the beams saw a side or two of a solid, several kinds explain them; how the sides that
    they did not see stand is what these kinds differ by.
    """
    center = best.fit.footprint.mean(axis=0)
    covariance = best.fit.covariance.copy()
    if isinstance(best.fit.shape, FreePolygon):
        return best
    for rival in rivals:
        off = rival.fit.footprint.mean(axis=0) - center
        chance = np.exp(min(rival.tolerant_evidence - rivals[0].tolerant_evidence, 0.0))
        covariance[:2, :2] += chance * np.outer(off, off)
    return replace(best, fit=replace(best.fit, covariance=covariance))


def _annealed(
    scene: Scene, beams: Beams, best: Candidate, error: float, rng: np.random.Generator
) -> tuple[Candidate, float]:
    """A candidate sampled by beams that are as exact as its walls turn out to be, and that error.

    Its walls are taken as less exact at first, so that none of its beams are outliers.
    """
    sampling = scene.settings.sampling
    # A polygon has no walls but its own, and takes long to sample.
    n_annealings = 0 if isinstance(best.fit.shape, FreePolygon) else _ANNEALINGS
    for _ in range(n_annealings):
        exact = beams.blurred(error)
        start = replace(best, top=find_top(exact, best.fit.footprint))
        best = sampled(scene, exact, start, 1, rng, sampling.quick)
        measured = min(model_error(beams, best.fit, best.top.z)[0], error)
        if measured > 0.7 * error or error < 0.1 * scene.model.typical_sigma:
            break
        error = measured
    if not n_annealings:
        error = min(model_error(beams, best.fit, best.top.z)[0], error)
    exact = beams.blurred(error)
    return sampled(scene, exact, best, 1, rng, sampling.thorough), error


def _excess(beams: Beams, best: Candidate) -> float:
    """Standard deviations by which the beams that meet a solid cost more than noise explains."""
    model, (_, _, ranges, background, sigma) = beams.model, beams.arrays
    expected = _ranges(beams, best.fit, best.top.z)
    touched = expected < background
    met, limits = expected[touched], beams.limits_of(touched)
    costs = model.costs(ranges[touched], met, met, sigma[touched], limits)
    n = max(int(touched.sum()), 1)
    lapses = model.outliers * model.outlier_cost + model.dropouts * model.dropout_cost
    square = model.outliers * model.outlier_cost**2 + model.dropouts * model.dropout_cost**2
    return float((costs.sum() - (0.5 + lapses) * n) / np.sqrt((0.5 + square) * n))


def _without_silhouettes(scene: Scene, beams: Beams, best: Candidate) -> Beams:
    """The beams of which the tolerance does not decide whether they meet a solid."""
    near, far, tolerance = ranges_within_tolerance(scene, beams, best.fit.footprint, best.top.z)
    return beams.take((far <= near) | (far <= near + _GRAZING * tolerance))


def model_error(beams: Beams, fit: Fit, top: float) -> tuple[float, float]:
    """Standard deviation of the walls from a shape, metres, beyond what noise explains.

    Residuals are averaged along stretches of the walls; what their means are off by more than
    noise leaves is the shape's. Only returns that fit at all count.

    Returns
    -------
    error, most : float, metres
        As much as the beams prove, and as much as they leave possible, at two standard deviations.
    """
    origins, directions, ranges, background, sigmas = beams.arrays
    expected = _ranges(beams, fit, top)
    tolerance = beams.settings.tolerance_of(Obstacle(fit.footprint, top).size)
    hit = expected < background
    with np.errstate(invalid="ignore"):
        residual = ranges - expected
        hit &= np.abs(residual) < 3.0 * (sigmas + tolerance)
    if hit.sum() < 10:
        return tolerance, tolerance
    at = (origins[hit] + expected[hit, None] * directions[hit])[:, :2]
    wall, share, normal = _stretches(fit.footprint, at)
    across = residual[hit] * np.abs(np.einsum("ni,ni->n", directions[hit, :2], normal))
    weight = 1.0 / sigmas[hit] ** 2
    key = _STRETCHES * wall + np.minimum((_STRETCHES * share).astype(int), _STRETCHES - 1)
    total = np.bincount(key, weight)
    seen = np.bincount(key) >= 3
    if not seen.any():
        return tolerance, tolerance
    mean = np.bincount(key, weight * across)[seen] / total[seen]
    excess = float(np.mean(mean**2 - 1.0 / total[seen]))
    margin = 2.0 * float(np.sqrt(np.mean(2.0 / total[seen] ** 2) / len(mean)))
    low, high = max(excess - margin, 0.0), max(excess + margin, 0.0)
    return float(np.sqrt(low)), float(np.sqrt(high))


def _ranges(beams: Beams, fit: Fit, top: float) -> Floats:
    return beams.prism_ranges(fit.points, top, is_round=fit.shape.is_round)


def _stretches(footprint: Floats, at: Floats) -> tuple[np.ndarray, Floats, Floats]:
    """The wall that each place (n, 2) is nearest to, how far along it is, and its normal."""
    along = np.roll(footprint, -1, axis=0) - footprint
    lengths = np.linalg.norm(along, axis=1)
    ways = along / lengths[:, None]
    normals = np.stack([ways[:, 1], -ways[:, 0]], axis=1)
    nearest = np.full(len(at), np.inf)
    wall, share = np.zeros(len(at), dtype=int), np.zeros(len(at))
    for k in range(len(footprint)):
        local = at - footprint[k]
        along_it = np.clip(local @ ways[k] / lengths[k], 0.0, 1.0)
        off = np.linalg.norm(local - along_it[:, None] * along[k], axis=1)
        closer = off < nearest
        nearest[closer], wall[closer], share[closer] = off[closer], k, along_it[closer]
    return wall, share, normals[wall]


def _with_relatives(
    scene: Scene, beams: Beams, solid: Hypothesis, rng: np.random.Generator
) -> Hypothesis:
    """The candidates of a solid sampled by all beams, and the relatives of the best."""
    how, quick = scene.settings.selection, scene.settings.sampling.quick
    beams = beams.subset(-(-len(beams) // how.most_beams) or 1)
    beams = beams.blurred(scene.settings.fitting.model_blur * tolerance_of(scene, solid))
    # All start from one top: few beams tell little of it, and one may hold a sampler where it is.
    top = find_top(beams, solid.footprint)
    rivals = [replace(each, top=top) for each in solid.candidates]

    def others_than(best: Candidate) -> list[tuple[Fit, Floats]]:
        """Fits of what the best may be instead, and where they started from."""
        z = best.top.z
        most = tolerant_cost(scene, beams, best.fit.shape, best.best, z) + how.climb_gain
        known = {each.fit.shape for each in rivals if each.cost <= best.cost}
        found = []
        sigmas = np.sqrt(np.diag(best.fit.covariance))
        starts = related(best.fit.shape, best.best, scene.settings.models)
        starts += half_seen(best.fit.shape, best.best, sigmas, scene.settings.models)
        for shape, start in starts:
            # Between corners that may slide along a wall, a mean is no good place to start from.
            fit = climb(beams, shape, start, z)
            if shape in known or is_sliver(fit):
                continue
            places = (start, fit.parameters)
            if min(tolerant_cost(scene, beams, shape, each, z) for each in places) <= most:
                found.append((fit, start))
        return found

    if len(rivals) == 1 and not others_than(rivals[0]):
        return solid
    rivals = [sampled(scene, beams, each, 1, rng, quick) for each in rivals]
    winner = None
    while (best := ranked(rivals, np.inf, how)[0]) is not winner:
        winner = best
        for fit, start in others_than(best):
            relative = sampled(scene, beams, Candidate.unsampled(fit, top), 1, rng, quick)
            # The nearest shape of this kind may be the most tolerable one.
            relative = tolerated(scene, beams, relative, [start])
            if n_sizes(fit.shape) < n_sizes(best.fit.shape):
                relative = _bent(scene, beams, relative, start)
            rivals.append(relative)
    return replace(solid, candidates=ranked(rivals, how.rival_gain, how))


def _bent(scene: Scene, beams: Beams, candidate: Candidate, start: Floats) -> Candidate:
    """A candidate with the evidence if its corners were moved as far as the tolerance lets them.

    Where the noise is larger than the tolerance, a wall that is off by less has a mean residual
    that the beams tell all the same; a polygon near by shows what they would say without it.
    """
    shape, z = candidate.fit.shape, candidate.top.z
    if shape.is_round:
        return candidate
    footprint = shape.frame(start)[0]
    most = _BEND * scene.tolerance_of(Obstacle(footprint, z))
    polygon = climb(beams, FreePolygon(len(footprint)), footprint.ravel(), z)
    if np.linalg.norm(polygon.footprint - footprint, axis=1).max() > most:
        return candidate
    least = tolerant_cost(scene, beams, polygon.shape, polygon.parameters, z)
    tolerant = candidate.evidence + candidate.cost - least
    return replace(candidate, tolerant_evidence=max(tolerant, candidate.tolerant_evidence))


def _longest_first(fit: Fit) -> Fit:
    """A rectangle or an ellipse whose first size is the larger one."""
    if fit.shape.kind not in ("rectangle", "ellipse") or fit.parameters[3] >= fit.parameters[4]:
        return fit
    order = [0, 1, 2, 4, 3]
    turned = fit.parameters[order] + [0.0, 0.0, np.pi / 2, 0.0, 0.0]
    return replace(fit, parameters=turned, covariance=fit.covariance[np.ix_(order, order)])
