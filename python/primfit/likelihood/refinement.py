"""Solids that do not explain their beams: other ways to fill their place are tried."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import shapely

from primfit._check import Ints
from primfit.likelihood.final_fit import final_posterior
from primfit.likelihood.fitting import find_top
from primfit.likelihood.hypotheses import Hypothesis, Region
from primfit.likelihood.model_selection import fit_region, fit_regions, sample_candidates
from primfit.likelihood.polygons import fit_polygon
from primfit.likelihood.scene import Scene

Solids = list[Hypothesis]
Alternative = Callable[[Scene, Hypothesis], Solids]
"""Solids in the place of one, among the others, which are the solids of the scene."""


def refine(scene: Scene, rng: np.random.Generator) -> Scene:
    """Replace solids by others where these explain more.

    Nothing, another kind, now that the neighbours are known, the parts of the region, and a free
    polygon compete by the Bayesian information criterion on the beams that come near. Since what
    one solid lacks often is the fault of another, all have a try at another kind first, the worst
    before the others.
    """
    most = scene.settings.refinement.misfit
    for alternatives in (ALTERNATIVES[:1], ALTERNATIVES):
        misfits = {id(solid): scene.misfit(solid) for solid in scene.solids}
        queue = [solid for solid in scene.solids if misfits[id(solid)] > most]
        if not queue:
            break
        queue.sort(key=lambda solid: -misfits[id(solid)])
        while queue:
            solid = queue.pop(0)
            if scene.misfit(solid) <= most:
                continue
            others = scene.with_solids([each for each in scene.solids if each is not solid])
            best = best_instead(others, solid, alternatives, rng)
            scene = others.with_solids([*others.solids, *best])
            if len(best) > 1:
                queue += best
    return scene


def finish(scene: Scene, rng: np.random.Generator) -> Scene:
    """All solids sampled as well as a report needs it, and replaced where that spoilt them."""
    how, finished = scene.settings.refinement, set[int]()
    for _ in range(how.rounds):
        before = scene
        for i, solid in enumerate(scene.solids):
            if id(solid) not in finished:
                scene = scene.with_solid(i, final_posterior(scene, i, rng))
                finished.add(id(scene.solids[i]))
        misfits = [scene.misfit(solid) for solid in scene.solids]
        if not any(
            misfit > max(how.misfit, how.spoilt * before.misfit(solid))
            for misfit, solid in zip(misfits, before.solids, strict=True)
            if misfit > how.misfit
        ):
            return scene
        scene = refine(scene, rng)
    return scene


def prune(scene: Scene, most_misfit: float = np.inf) -> Scene:
    """Take out, one by one, the solid without which the scene explains the beams as well.

    One that is no higher than the floor is off goes in any case. A solid stays if the scene
    without it has more than a misfit: it may be wrong, but not needless.
    What a solid gains changes only where others near it go.
    """
    how = scene.settings.refinement
    scene = scene.with_solids([solid for solid in scene.solids if not _is_flat(scene, solid)])
    gains = {id(solid): _gain(scene, i) for i, solid in enumerate(scene.solids)}
    kept: set[int] = set()
    while True:
        doubtful = [
            (gains[id(solid)], i)
            for i, solid in enumerate(scene.solids)
            if id(solid) not in kept and gains[id(solid)] <= how.least_gain
        ]
        if not doubtful:
            return scene
        i = min(doubtful)[1]
        solid = scene.solids[i]
        rest = scene.without(i)
        if rest.misfit(solid) >= most_misfit:
            kept.add(id(solid))
            continue
        scene = rest
        center, radius = scene.place_of(solid)
        for j, other in enumerate(scene.solids):
            place, reach = scene.place_of(other)
            if np.linalg.norm(place - center) < radius + reach + 2.0 * radius:
                gains[id(other)] = _gain(scene, j)


def _is_flat(scene: Scene, solid: Hypothesis) -> bool:
    """Whether a solid is so low that the tolerance of the floor explains it."""
    if not solid.candidates or np.isnan(solid.best.top.sigma):
        return False
    least = scene.settings.refinement.least_height * scene.tolerance_of(solid.obstacle)
    return solid.top - scene.floor_z < least


def _gain(scene: Scene, i: int) -> float:
    """What solid i gains, by some of the beams near it, and by more where that is little."""
    how, stride = scene.settings.refinement, scene.settings.selection.stride
    rows = scene.rows_of(scene.solids[i])
    gain = stride * scene.gain(i, rows[::stride])
    return gain if abs(gain) > how.certain_gain else scene.gain(i, rows)


def merge_overlapping(scene: Scene, rng: np.random.Generator) -> Scene:
    """Join solids that touch or overlap where that explains the beams as well.

    One solid on the regions of both takes their place, or one of two that overlap; these have to
    explain much more than it to stay, since solids do not overlap.
    """
    how = scene.settings.refinement
    tried: set[tuple[int, int]] = set()
    while True:
        outlines = [shapely.Polygon(solid.footprint) for solid in scene.solids]
        tree = shapely.STRtree(outlines)
        pairs = []
        for i, outline in enumerate(outlines):
            distance = how.touching * float(np.sqrt(outline.area))
            for j in tree.query(outline, predicate="dwithin", distance=distance):
                key = (id(scene.solids[i]), id(scene.solids[int(j)]))
                if i < j and key not in tried:
                    pairs.append((i, int(j)))
        if not pairs:
            return scene
        i, j = pairs[0]
        first, second = scene.solids[i], scene.solids[j]
        tried.add((id(first), id(second)))
        others = scene.with_solids([each for k, each in enumerate(scene.solids) if k not in (i, j)])
        smaller = min(outlines[i].area, outlines[j].area)
        overlap = shapely.make_valid(outlines[i]).intersection(shapely.make_valid(outlines[j]))
        overlaps = overlap.area > how.overlap * smaller
        both = Hypothesis(first.region.joined(second.region))
        rows = scene.rows_of(both)
        options = [[first, second], _settled(others, _fitted(others, [both]), rng)]
        options += [[first], [second]] if overlaps else []
        scores = [others.with_solids([*others.solids, *each]).score(rows) for each in options]
        scores[0] += how.certain_gain if overlaps else 0.0
        best = options[int(np.argmin(scores))]
        if len(best) == 1:
            scene = others.with_solids([*others.solids, *best])


def best_instead(
    others: Scene,
    solid: Hypothesis,
    alternatives: tuple[Alternative, ...],
    rng: np.random.Generator,
) -> Solids:
    """What explains the beams best in the place of a solid, among the others."""
    how = others.settings.refinement
    rows = others.rows_of(solid)

    def score(option: Solids) -> float:
        return others.with_solids([*others.solids, *option]).score(rows)

    def misfit(option: Solids) -> float:
        return others.with_solids([*others.solids, *option]).misfit(solid)

    best: Solids = []
    least = score(best) - how.least_gain
    whole = score([solid])
    if whole < least:
        best, least = [solid], whole
    elif misfit([]) <= how.misfit:
        return []
    for alternative in alternatives:
        option = _settled(others, alternative(others, solid), rng)
        option = _needed(others, option, rows)
        if len(option) > 1 and score(option) < whole:
            option = _refined(others, option, solid.region, rows, rng)
        if not option or _touch(option, how.touching * solid.region.size):
            continue
        if (each := score(option)) < least:
            best, least = option, each
            if misfit(best) <= how.misfit:
                break
    return best


def _refined(
    others: Scene, parts: Solids, region: Region, rows: Ints, rng: np.random.Generator
) -> Solids:
    """Parts sought once more, in turns, as long as they do not explain their beams."""
    how = others.settings.refinement
    for _ in range(how.rounds):
        scene = others.with_solids([*others.solids, *parts])
        if all(scene.misfit(part) <= how.misfit for part in parts):
            break
        again = _parts_anew(others, parts, region, rows)
        if again == parts:
            break
        again = _settled(others, again, rng)
        both = (parts, again)
        parts = min(both, key=lambda each: others.with_solids([*others.solids, *each]).score(rows))
    return parts


def _fitted(others: Scene, option: Solids) -> Solids:
    """Regions with the kinds that fit them, among others."""
    n = len(others.solids)
    return list(fit_regions(others.with_solids([*others.solids, *option]), n).solids[n:])


def _settled(others: Scene, option: Solids, rng: np.random.Generator) -> Solids:
    """Solids sampled among others."""
    n = len(others.solids)
    return list(sample_candidates(others.with_solids([*others.solids, *option]), rng, n).solids[n:])


def _needed(others: Scene, option: Solids, rows: Ints) -> Solids:
    """Parts without those that the others leave next to nothing to explain, the smallest first."""
    least = others.settings.refinement.least_gain
    for part in sorted(option, key=lambda each: each.region.area)[:-1]:
        rest = [each for each in option if each is not part]
        scene = others.with_solids([*others.solids, *option])
        if others.with_solids([*others.solids, *rest]).score(rows) < scene.score(rows) + least:
            option = rest
    return option


def _again(others: Scene, solid: Hypothesis) -> Solids:
    """The best kind for the solid's region, among neighbours that were regions before."""
    n = len(others.solids)
    return [fit_region(others.with_solids([*others.solids, solid]), n)]


def _parts_anew(others: Scene, parts: Solids, region: Region, rows: Ints) -> Solids:
    """Parts of a region, each once more where that is better, since the others are known by now."""
    n = len(others.solids)
    scene = others.with_solids([*others.solids, *parts])
    order = sorted(range(len(parts)), key=lambda j: -scene.misfit(parts[j]))
    for j in order:
        now = scene.solids[n:]
        tries = [scene]
        left = _left(others, region, [each for k, each in enumerate(now) if k != j])
        for place in (now[j].region, left):
            if place is not None:
                there = scene.with_solid(n + j, Hypothesis(place))
                tries.append(there.with_solid(n + j, fit_region(there, n + j)))
        scene = min(tries, key=lambda each: each.score(rows))
    return list(scene.solids[n:])


def _left(scene: Scene, region: Region, solids: Solids) -> Region | None:
    """The largest piece of a region that solids leave, without the rims around them."""
    rim = scene.settings.refinement.rim * region.size
    covered = shapely.union_all([shapely.Polygon(each.footprint) for each in solids])
    left = shapely.Polygon(region.outline).difference(covered).buffer(-rim).buffer(rim)
    piece = max(shapely.get_parts(left), key=shapely.area, default=shapely.Polygon())
    if piece.area <= scene.settings.carving.least_cells * region.cell**2:
        return None
    return Region.of_polygon(piece, region.top, region.cell, is_cut=True)


def _as_polygon(others: Scene, solid: Hypothesis) -> Solids:
    """The solid as a free polygon, or as a known kind where that is."""
    region, top = solid.region, solid.top
    beams = others.near(*others.place_of(solid), most=others.settings.refinement.most_beams)
    polygon = fit_polygon(beams, [region.outline, solid.footprint], top, region.size)
    if polygon is None:
        return []
    # The polygon may tell the place of a known kind better than the region.
    place = Region.of_polygon(shapely.Polygon(polygon.footprint), top, 0.0, is_cut=False)
    n = len(others.solids)
    kinds = fit_region(others.with_solids([*others.solids, Hypothesis(place)]), n)
    fits = [polygon, *(each.fit for each in kinds.candidates)]
    return [Hypothesis.of_fits(region, fits, find_top(beams, polygon.footprint))]


def _at_necks(others: Scene, solid: Hypothesis) -> Solids:
    """Solids from the parts of a solid's region between its necks."""
    return _from_parts(others, solid.region.parts)


def _in_halves(others: Scene, solid: Hypothesis) -> Solids:
    """Solids from the halves of a solid's region."""
    return _from_parts(others, solid.region.halves())


def _from_parts(others: Scene, parts: tuple[Region, ...]) -> Solids:
    least = others.settings.carving.least_cells
    parts = tuple(part for part in parts if part.area > least * part.cell**2)
    return _fitted(others, [Hypothesis(part) for part in parts]) if len(parts) > 1 else []


ALTERNATIVES: tuple[Alternative, ...] = (_again, _at_necks, _in_halves, _as_polygon)


def _touch(solids: Solids, distance: float) -> bool:
    """Whether some of several solids touch: together they are one."""
    outlines = [shapely.Polygon(each.footprint) for each in solids]
    return any(a.distance(b) < distance for a, b in combinations(outlines, 2))
