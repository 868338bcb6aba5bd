"""A detection against the scene that it is of: what counts, what is right, how sure it was.

A solid counts if the beams can tell it: at least `SHARE` of its walls, or of twelve arcs of a
round one, returned `RETURNS` beams or more each. Solids are paired one to one, the nearest first in
units of the true size, which is the larger extent of the footprint.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scenes import Scene
from scipy.stats import chi2

import primfit

FOUND, EXCUSED = 0.1, 0.5
"""Distance of centres, in sizes, at which a solid is found; up to which what was found instead is
an error about that solid, not a spurious one."""

SHARE, RETURNS = 2 / 3, 10
RIM = 0.1
"""Share of a wall at either end that tells nothing: noise brings returns there from the next."""

MOST_CORNERS, ARCS = 12, 12
"""Footprints of more corners are round, and seen by arcs instead of walls."""

ROOM_OVERLAP, ROOM_DEVIATION = 0.96, 0.02
"""Least intersection over union, and largest deviation in the extent, of a room that is right."""

CONTRADICTIONS = 500
"""Beams that a change must concern, in either half of the path, to be warned of."""

SURE = float(np.sqrt(chi2.ppf(0.95, 2)))
"""Sigmas that hold 95 % of a normal distribution in the plane."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What was right in one scene.

    Attributes
    ----------
    n_solids, counting, found, kind, spurious : int
        Solids in all; those that count, of these found, and of these with the right kind; found
        solids that are none.
    seen, reported : int
        Solids of which the beams tell a wall or an arc at least; of these paired with one that was
        found, however far off.
    unsure : int
        Solids that count, were not found, and have one of which the centre is within their 95 %
        region, tolerance included.
    room : str
        "right", "WRONG", "MISSED", "INVENTED", or "-" for none where there is none; "in part" if a
        wall without returns is wrong or missing and all others are right.
    centers_mm, sizes : tuple of float
        Errors of the centres of solids found, as lengths and in sizes.
    sigmas, tolerant_sigmas : tuple of float
        The same in standard deviations, of any solid that was paired at all, by the covariance
        alone and with the tolerance; those that have a covariance.
    warned : bool
        Whether a warning tells of something that moved.
    should_warn : bool or None
        Whether one should; None where the beams tell too little.
    warnings : tuple of (str, str)
        Category and text of each warning of the detection.
    wrong_kinds : tuple of (str, str)
        What a solid is and as what it was found.
    """

    n_solids: int
    counting: int
    found: int
    kind: int
    spurious: int
    seen: int
    reported: int
    unsure: int
    room: str
    centers_mm: tuple[float, ...]
    sizes: tuple[float, ...]
    sigmas: tuple[float, ...]
    tolerant_sigmas: tuple[float, ...]
    should_warn: bool | None
    warnings: tuple[tuple[str, str], ...]
    wrong_kinds: tuple[tuple[str, str], ...]

    @property
    def warned(self) -> bool:
        return any(tells_of_motion(text) for _, text in self.warnings)


def tells_of_motion(text: str) -> bool:
    """Whether a warning is about something that did not stand still."""
    words = r"\b(mov(e|es|ed|ing)|contradict\w*|came|went|gone|(dis)?appear\w*|not stand still)\b"
    return re.search(words, text, re.IGNORECASE) is not None


def judge(
    scene: Scene, found: primfit.Detection, warnings: Sequence[tuple[str, str]] = ()
) -> Verdict:
    """The verdict on a detection, and on the warnings (category, text) that came with it."""
    world, scan, facts = scene
    truth = world.solids
    shares = [share_seen(solid.footprint, hits_of(scan, i)) for i, solid in enumerate(truth)]
    counts = [share >= SHARE for share in shares]
    off, size = _distances(truth, found.solids)
    pairs = _paired(off / size, EXCUSED)
    is_found = {i: off[i, j] <= FOUND * size[i, 0] for i, j in pairs.items()}
    right = [i for i in pairs if counts[i] and is_found[i]]
    wrong_kinds = [
        (truth[i].kind, found.solids[pairs[i]].kind)
        for i in right
        if truth[i].kind != found.solids[pairs[i]].kind
    ]
    strict = {i: sigmas_off(truth[i], found.solids[j], False) for i, j in pairs.items()}
    tolerant = {i: sigmas_off(truth[i], found.solids[j], True) for i, j in pairs.items()}
    left = set(range(len(found.solids))) - set(pairs.values())
    # What is found of a solid that moved is an error about that one.
    excused, moved_size = _distances(facts.get("changed", []), [found.solids[j] for j in left])
    excused = _paired(excused / moved_size, EXCUSED)
    unsure = [i for i in pairs if counts[i] and not is_found[i] and tolerant[i] <= SURE]
    return Verdict(
        n_solids=len(truth),
        counting=sum(counts),
        found=len(right),
        kind=len(right) - len(wrong_kinds),
        spurious=len(left) - len(excused),
        seen=sum(share > 0.0 for share in shares),
        reported=sum(shares[i] > 0.0 for i in pairs),
        unsure=len(unsure),
        room=judge_room(world, scan, found.arena),
        centers_mm=tuple(1e3 * off[i, pairs[i]] for i in right),
        sizes=tuple(off[i, pairs[i]] / size[i, 0] for i in right),
        sigmas=tuple(value for value in strict.values() if np.isfinite(value)),
        tolerant_sigmas=tuple(value for value in tolerant.values() if np.isfinite(value)),
        should_warn=_should_warn(facts),
        warnings=tuple(warnings),
        wrong_kinds=tuple(wrong_kinds),
    )


def _should_warn(facts: dict) -> bool | None:
    if facts.get("change", "none") == "none":
        return False
    return True if facts["contradictions"] >= CONTRADICTIONS else None


def hits_of(scan: primfit.Scan, index: int) -> np.ndarray:
    """Where beams that met a solid, or the arena (-2), seemed to end (n, 2), metres."""
    return scan.points[scan.is_return & (scan.solid_index == index), :2]


def share_seen(footprint: np.ndarray, hits: np.ndarray) -> float:
    """Share of the walls, or of the arcs of a round footprint, with enough returns."""
    return float(np.mean(_returns_of_walls(footprint, hits) >= RETURNS))


def _returns_of_walls(footprint: np.ndarray, hits: np.ndarray) -> np.ndarray:
    """How many of the hits (n, 2) are nearest to each wall or arc, but for its ends."""
    ring = shapely.LinearRing(footprint)
    sides = np.linalg.norm(np.roll(footprint, -1, axis=0) - footprint, axis=1)
    ends = np.cumsum([0.0, *sides])
    if len(footprint) > MOST_CORNERS:
        ends = np.linspace(0.0, ring.length, ARCS + 1)
    at = shapely.line_locate_point(ring, shapely.points(hits))
    wall = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    share = (at - ends[wall]) / np.diff(ends)[wall]
    is_inner = (share > RIM) & (share < 1.0 - RIM)
    return np.bincount(wall[is_inner], minlength=len(ends) - 1)


def _distances(truth: Sequence, found: Sequence) -> tuple[np.ndarray, np.ndarray]:
    """Distances of centres (n, m) and true sizes (n, 1), metres."""
    a, b = (np.array([each.center[:2] for each in some]).reshape(-1, 2) for some in (truth, found))
    sizes = [np.ptp(solid.footprint, axis=0).max() for solid in truth]
    return np.linalg.norm(a[:, None] - b, axis=-1), np.array(sizes).reshape(-1, 1)


def _paired(off: np.ndarray, most: float) -> dict[int, int]:
    """Rows and columns one to one, the least first, up to the most."""
    pairs: dict[int, int] = {}
    for flat in np.argsort(off, axis=None, kind="stable"):
        i, j = (int(k) for k in np.unravel_index(flat, off.shape))
        if off[i, j] <= most and i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs


def sigmas_off(truth: primfit.Prism, found: primfit.FoundSolid, is_tolerant: bool) -> float:
    """Error of a centre in its standard deviations; NaN without a covariance.

    With the tolerance the square of `tolerance_sigma`, where a solid has it, is added to the
    variances of x and y.
    """
    block = np.array(found.covariance)[:2, :2]
    if is_tolerant:
        block = block + np.square(getattr(found, "tolerance_sigma", 0.0)) * np.eye(2)
    if not np.isfinite(block).all() or np.linalg.det(block) <= 0.0:
        return np.nan
    error = (found.center - truth.center)[:2]
    return float(np.sqrt(error @ np.linalg.solve(block, error)))


def judge_room(world: primfit.World, scan: primfit.Scan, found: primfit.FoundArena | None) -> str:
    """Whether the room is the true one (see `Verdict.room`)."""
    if world.arena is None:
        return "-" if found is None else "INVENTED"
    outline = np.asarray(world.arena.outline)
    most = ROOM_DEVIATION * max(world.arena.size)
    other = None if found is None else shapely.Polygon(found.footprint)
    if other is not None and other.is_valid:
        truth = world.arena.shadow
        overlap = truth.intersection(other).area / truth.union(other).area
        deviation = shapely.hausdorff_distance(truth.exterior, other.exterior, densify=0.02)
        if overlap >= ROOM_OVERLAP and deviation <= most:
            return "right"
    is_seen = _returns_of_walls(outline, hits_of(scan, -2)) >= RETURNS
    if is_seen.all():
        return "MISSED" if found is None else "WRONG"
    if found is None:
        return "in part"
    following = np.roll(outline, -1, axis=0)
    along = np.linspace(0.05, 0.95, 19)[:, None, None]
    places = (outline + along * (following - outline))[:, is_seen].reshape(-1, 2)
    off = shapely.distance(shapely.LinearRing(found.footprint), shapely.points(places))
    return "in part" if off.max(initial=0.0) <= most else "WRONG"
