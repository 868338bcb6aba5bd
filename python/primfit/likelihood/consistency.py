"""Places of which the beams contradict each other by when they were taken.

A solid that was moved, came or went while the sensor was on its way stopped beams at one time and
let them pass at another. No scene without time explains that, so such places are named.
"""

from __future__ import annotations

import warnings

import numpy as np
import shapely
from scipy import ndimage
from scipy.special import xlogy

from primfit._check import Bools, Floats, Ints
from primfit.likelihood.free_space import FreeSpace
from primfit.likelihood.scene import Scene
from primfit.results import Contradiction

_GAP = 3
"""Cells between returns of one place, on the sides of a solid that the sensor saw."""


def find_contradictions(scene: Scene, space: FreeSpace) -> tuple[Scene, list[Contradiction]]:
    """The scene without solids that stood for a time only, and the places where some did.

    A place is that of a solid, or one where beams ended that the scene does not explain. Of the
    beams through its middle, those that ended there and those that passed are counted in the order
    of the poses; where one share before some pose and another after it explain the counts much
    better than one share for all, the place is named.

    Warns
    -----
    UserWarning
        For each place.
    """
    solids, found = [], []
    for solid in scene.solids:
        each = _changed(scene, solid.obstacle.footprint, solid.top)
        if each is None:
            solids.append(solid)
        else:
            found.append(each)
    rest = scene.with_solids(solids)
    for outline, top in _unexplained_places(rest, space):
        each = _changed(rest, outline, top)
        if each is not None:
            found.append(each)
    found = _joined(found)
    for each in found:
        x, y = each.center
        warnings.warn(
            f"beams contradict each other at ({x:.3f}, {y:.3f}): {each.shares[0]:.0%} of them "
            f"ended there before pose {each.pose} and {each.shares[1]:.0%} from then on, so what "
            f"stood there moved, came or went; it is in contradictions and not in solids",
            stacklevel=4,
        )
    return rest, found


def _changed(scene: Scene, outline: Floats, top: float) -> Contradiction | None:
    """The place within an outline if beams ended there before some pose and not after, or so."""
    how = scene.settings.consistency
    polygon = shapely.Polygon(outline).convex_hull
    center = shapely.get_coordinates(polygon.centroid)[0]
    depth = float(shapely.distance(polygon.exterior, shapely.Point(center)))
    rows = scene.rows_near(center, how.core * depth)
    stopped, passed = _ended_or_passed(scene, rows, center, depth, top)
    told = np.flatnonzero(stopped | passed)
    order, poses = _in_time(scene, rows[told])
    n_stopped = np.cumsum(stopped[told][order], dtype=np.int64)
    n = len(n_stopped)
    if n < how.least_beams:
        return None
    n_before = np.arange(1, n + 1)
    gain = (
        _log_likelihood(n_stopped, n_before)
        + _log_likelihood(n_stopped[-1] - n_stopped, n - n_before)
        - _log_likelihood(n_stopped[-1:], np.array([n]))
    )
    k = int(np.argmax(gain[:-1])) if n > 1 else 0
    before = n_stopped[k] / n_before[k]
    after = (n_stopped[-1] - n_stopped[k]) / max(n - n_before[k], 1)
    if gain[k] < how.least_gain or abs(after - before) < how.least_change:
        return None
    return Contradiction(
        center=center,
        footprint=np.array(shapely.get_coordinates(polygon.exterior)[:-1]),
        pose=int(poses[k + 1]),
        shares=(float(before), float(after)),
    )


def _joined(places: list[Contradiction]) -> list[Contradiction]:
    """Places as one where they are near each other, in their size, and changed the same way."""
    for i, one in enumerate(places):
        for other in places[i + 1 :]:
            outlines = shapely.Polygon(one.footprint), shapely.Polygon(other.footprint)
            distance = max(float(np.sqrt(outline.area)) for outline in outlines)
            is_same = (one.shares[0] < one.shares[1]) == (other.shares[0] < other.shares[1])
            if is_same and outlines[0].distance(outlines[1]) < distance:
                hull = shapely.union(*outlines).convex_hull
                largest = max((one, other), key=lambda each: shapely.Polygon(each.footprint).area)
                joined = Contradiction(
                    center=shapely.get_coordinates(hull.centroid)[0],
                    footprint=shapely.get_coordinates(hull.exterior)[:-1],
                    pose=largest.pose,
                    shares=largest.shares,
                )
                rest = [each for each in places if each is not one and each is not other]
                return _joined([*rest, joined])
    return places


def _log_likelihood(hits: Ints, n: Ints) -> Floats:
    """Most that the logarithm of a binomial likelihood can be."""
    share = hits / np.maximum(n, 1)
    log_likelihood: Floats = xlogy(hits, share) + xlogy(n - hits, 1.0 - share)
    return log_likelihood


def _ended_or_passed(
    scene: Scene, rows: Ints, center: Floats, depth: float, top: float
) -> tuple[Bools, Bools]:
    """Which of the beams that come near the middle of a place ended there, and which passed it.

    Beams that something before it stops, that pass over it, or that end too near by for their
    noise tell nothing.
    """
    scan, model = scene.scan, scene.model
    origins, directions = scan.origins.take(rows, axis=0), scan.directions.take(rows, axis=0)
    ranges, clearance = scan.ranges[rows], 3.0 * model.sigma[rows]
    level = np.linalg.norm(directions[:, :2], axis=1)
    along = ((center - origins[:, :2]) * directions[:, :2]).sum(axis=1) / level**2
    reach = depth / level
    z = origins[:, 2] + (along - reach) * directions[:, 2]
    # What the scene has elsewhere, so that a solid found here does not count.
    elsewhere = [k for k, each in enumerate(scene.solids) if not _is_at(each.footprint, center)]
    others = scene.with_solids([scene.solids[k] for k in elsewhere])
    beyond = others.expected(rows)
    could = (along > reach) & (beyond > along + reach + clearance) & (z < top)
    shortest, longest = model.limits(rows)
    could &= along + reach < longest
    could &= along - 2.0 * reach > shortest
    passed = could & (ranges > along + reach + clearance)
    with np.errstate(invalid="ignore"):
        stopped = could & (np.abs(ranges - along) <= 2.0 * reach + clearance)
    stopped &= ranges < beyond - clearance
    return stopped & ~passed, passed


def _is_at(footprint: Floats, place: Floats) -> bool:
    return bool(shapely.contains_xy(shapely.Polygon(footprint), *place))


def _in_time(scene: Scene, rows: Ints) -> tuple[Ints, Ints]:
    """The order in which some beams were taken, and their poses in that order.

    By the index of the pose, or else by rows, each of which counts as a pose.
    """
    index = scene.scan.pose_index
    poses = rows if index is None else index[rows]
    order = np.argsort(poses, kind="stable")
    return order, poses[order]


def _unexplained_places(scene: Scene, space: FreeSpace) -> list[tuple[Floats, float]]:
    """Outline and top of places where many beams ended that should have gone on."""
    how, scan, model = scene.settings.consistency, scene.scan, scene.model
    rows = np.flatnonzero(scan.is_return)
    rows = rows[:: max(1, len(rows) // how.most_beams)]
    short = scene.expected(rows) - scan.ranges[rows]
    points = scan.points[rows[short > 3.0 * model.sigma[rows] + 2.0 * space.cell]]
    if len(points) < how.least_returns:
        return []
    step = max(2.0 * space.cell, model.typical_sigma)
    low = points[:, :2].min(axis=0)
    bins = np.floor((points[:, :2] - low) / step).astype(int)
    counts = np.zeros(bins.max(axis=0) + 1)
    np.add.at(counts, tuple(bins.T), 1)
    usual = len(points) / counts.size
    is_crowded = np.pad(counts > how.crowding * usual + 2.0, _GAP)
    closed = ndimage.binary_closing(is_crowded, np.ones((3, 3)), iterations=_GAP)
    labels, n = ndimage.label(closed, structure=np.ones((3, 3)))
    labels = labels[_GAP:-_GAP, _GAP:-_GAP]
    number = labels[tuple(bins.T)]
    places = []
    for k in range(1, n + 1):
        own = points[number == k]
        if len(own) < how.least_returns:
            continue
        hull = shapely.MultiPoint(own[:, :2]).convex_hull
        if hull.geom_type == "Polygon" and hull.area > space.cell**2:
            outline = shapely.get_coordinates(hull.exterior)[:-1]
            places.append((outline, float(np.quantile(own[:, 2], 0.9))))
    return places
