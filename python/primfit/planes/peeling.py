"""All planes of a cloud: found one after the other, then in competition for the points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from primfit import _primfit
from primfit._check import Bools, Floats, Ints
from primfit.clouds.noise import spacing
from primfit.geometry.extents import bounds, extent
from primfit.geometry.products import dot, lengths_of, product
from primfit.planes.passages import MOST_PASSING, passages
from primfit.planes.plane import axes_of
from primfit.planes.ransac import Nearby, NoisyPoints, Orientation, PlaneModel, find_plane, fit
from primfit.scans.scan import Scan

_CLAIM = 1.5
"""Times the limit within which a found plane takes points out of the pool: one plane a surface."""

_FAILURES = 3
"""Fruitless searches after which no plane is left."""

_LEAST_COSINE = 0.9
"""Cosine of the angle between two planes from which they may be pieces of one."""

_APART = 0.1
"""Share of its length by which a piece may lie off the plane of another; else no fit is tried."""

_SWEEPS = 4
"""Most rounds of competition; the second usually changes little."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A plane with the points that support it, and how far they reach.

    Attributes
    ----------
    model : PlaneModel
    inliers : (m,) int64
        Rows of the cloud.
    axes : (2, 3) float64
        Directions within the plane; for an upright plane along it, seen from outside a solid to
        the right, and up.
    low, high : (2,) float64, metres
        Where the supporting beams meet the plane, along the axes.
    """

    model: PlaneModel
    inliers: Ints
    axes: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(cls, cloud: NoisyPoints, model: PlaneModel, inliers: Ints) -> Patch:
        """The patch that some points of a cloud support."""
        axes = axes_of(model.equation[:3])
        at = product(cloud.take(inliers).feet(model.equation), axes.T)
        return cls(model, inliers, axes, *bounds(at))

    @property
    def corners(self) -> Floats:
        """Corners (4, 3) of its reach, metres."""
        (a, b), (c, d) = zip(self.low, self.high, strict=True)
        offset = self.model.equation[3] * self.model.equation[:3]
        at: Floats = product(np.array([[a, c], [b, c], [b, d], [a, d]]), self.axes) - offset
        return at

    @property
    def center(self) -> Floats:
        """Middle of its reach (3,), metres."""
        middle: Floats = self.corners.mean(axis=0)
        return middle

    def covers(self, cloud: NoisyPoints, margin: float) -> Bools:
        """Which points meet the plane within `margin` of the patch's reach."""
        at = product(cloud.feet(self.model.equation), self.axes.T)
        above, below = at >= self.low - margin, at <= self.high + margin
        return above[:, 0] & above[:, 1] & below[:, 0] & below[:, 1]


@dataclass(frozen=True, kw_only=True)
class Peeling:
    """How `find_planes` works; lengths in metres.

    Attributes
    ----------
    orientation : Orientation
    eps : float or None
        Of DBSCAN. None: the `spacing` of the points that are left, but at least the limit.
    min_points : int
        Least inliers of a plane.
    max_trials : int
        Most hypotheses for one plane.
    local, msac, refit, compete : bool
        Draw hypotheses from neighbours; score them by MSAC; refit planes; let them compete.
    """

    orientation: Orientation
    eps: float | None
    min_points: int
    max_trials: int
    local: bool
    msac: bool
    refit: bool
    compete: bool


def find_planes(
    cloud: NoisyPoints,
    how: Peeling,
    rng: np.random.Generator,
    *,
    scan: Scan | None = None,
    n_jobs: int | None = None,
    on_plane: Callable[[int, int], None] | None = None,
) -> tuple[list[Patch], float]:
    """Planes one after the other, each from the points that the others left (Algorithm 3, 1-9).

    With `scan`, all beams that the cloud comes from, pieces of a plane are put together only
    where no beam passed between them.

    Returns
    -------
    patches : list of Patch
    eps : float, metres
        Of DBSCAN, at the first plane.
    """
    if not len(cloud):
        return [], 0.0 if how.eps is None else how.eps
    tree = _primfit.PointTree(cloud.points)
    limit = cloud.typical_limit
    first_eps = eps = max(spacing(cloud.points, tree), limit) if how.eps is None else how.eps
    shortest = max(eps / 4, limit)
    longest = max(extent(cloud.points) / 2, 2 * shortest)
    near = Nearby(cloud.points, tree, shortest, longest) if how.local else None
    patches: list[Patch] = []
    rest, failures = np.arange(len(cloud)), 0
    while len(rest) >= how.min_points and failures < _FAILURES:
        pool = cloud.take(rest)
        found = find_plane(
            pool,
            how.orientation,
            rng,
            near=near,
            eps=eps,
            min_points=how.min_points,
            max_trials=how.max_trials,
            msac=how.msac,
            refit=how.refit,
            n_jobs=n_jobs,
        )
        if found is None:
            failures += 1
            if how.eps is None:
                # What is left lies sparser than the whole.
                eps = max(eps, spacing(pool.points))
            continue
        model, inliers = found
        patch = Patch.of(pool, model, inliers)
        patches.append(replace(patch, inliers=rest[inliers]))
        taken = np.zeros(len(rest), dtype=bool)
        taken[inliers] = True
        if how.compete:
            close = np.flatnonzero(np.abs(pool.residuals(model.equation)) <= _CLAIM * pool.limit)
            taken[close[patch.covers(pool.take(close), eps)]] = True
        rest = rest[~taken]
        if on_plane is not None:
            on_plane(len(cloud) - len(rest), len(cloud))
    if how.compete:
        for _ in range(_SWEEPS):
            before = [patch.inliers for patch in patches]
            if scan is not None:
                patches = _split(cloud, patches, how, scan, first_eps)
            patches = _merge(cloud, patches, how, scan, first_eps)
            patches = _compete(cloud, patches, how, first_eps)
            after = [patch.inliers for patch in patches]
            if len(before) == len(after) and all(map(np.array_equal, before, after)):
                break
    return patches, first_eps


def _split(
    cloud: NoisyPoints, patches: list[Patch], how: Peeling, scan: Scan, eps: float
) -> list[Patch]:
    """Cut patches along their first axis where more beams pass than end on them."""
    pieces = []
    for patch in patches:
        at = product(cloud.take(patch.inliers).feet(patch.model.equation), patch.axes.T)
        passed = passages(scan, patch.model.equation, patch.axes, cloud.typical_sigma)
        level = (passed[:, 1] >= patch.low[1]) & (passed[:, 1] <= patch.high[1])
        n_bins = max(1, int((patch.high[0] - patch.low[0]) / eps))
        bins = np.linspace(patch.low[0], patch.high[0], n_bins + 1)
        is_open = np.histogram(passed[level, 0], bins)[0] > np.histogram(at[:, 0], bins)[0]
        if not is_open.any():
            pieces.append(patch)
            continue
        run = np.cumsum(np.diff(is_open, prepend=is_open[0]) != 0)
        place = np.clip(np.searchsorted(bins, at[:, 0], side="right") - 1, 0, n_bins - 1)
        for number in np.unique(run[~is_open]):
            rows = patch.inliers[run[place] == number]
            model = fit(cloud.take(rows), patch.model.equation, how.orientation)
            if model is not None and len(rows) >= how.min_points:
                pieces.append(Patch.of(cloud, model, rows))
    return pieces


def _merge(
    cloud: NoisyPoints, patches: list[Patch], how: Peeling, scan: Scan | None, eps: float
) -> list[Patch]:
    """Put together what one plane explains as well as two (Bayesian information criterion).

    The pieces lie beside each other, no farther apart than the larger one is long.
    """
    apart: set[tuple[Patch, Patch]] = set()
    merged = True
    while merged:
        merged = False
        normals = np.reshape([patch.model.equation[:3] for patch in patches], (-1, 3))
        alike = np.triu(product(normals, normals.T) >= _LEAST_COSINE, 1)
        for a, b in ((patches[i], patches[j]) for i, j in np.argwhere(alike)):
            if (a, b) in apart:
                continue
            together = _union(cloud, a, b, how, scan, eps)
            if together is not None:
                patches = [patch for patch in patches if patch is not a and patch is not b]
                patches.append(together)
                merged = True
                break
            apart.add((a, b))
    return patches


def _union(
    cloud: NoisyPoints, a: Patch, b: Patch, how: Peeling, scan: Scan | None, eps: float
) -> Patch | None:
    if len(a.inliers) < len(b.inliers):
        a, b = b, a
    other = product(b.corners, a.axes.T)
    gap_low = np.minimum(a.high, other.max(axis=0))
    gap_high = np.maximum(a.low, other.min(axis=0))
    gap = gap_high - gap_low
    if (gap > np.maximum(a.high - a.low, b.high - b.low).max()).any():
        return None
    between = abs(dot(a.model.equation[:3], b.center) + a.model.equation[3])
    if between > 2.0 * cloud.typical_limit + _APART * lengths_of(b.high - b.low):
        return None
    rows = np.union1d(a.inliers, b.inliers)
    model = fit(cloud.take(rows), a.model.equation, how.orientation)
    if model is None:
        return None

    def cost(model: PlaneModel, rows: Ints) -> float:
        some = cloud.take(rows)
        far = (_CLAIM * some.limit / some.sigma) ** 2
        return float(np.minimum((some.residuals(model.equation) / some.sigma) ** 2, far).sum())

    rise = cost(model, rows) - cost(a.model, a.inliers) - cost(b.model, b.inliers)
    n_parameters = len(how.orientation.normal_space)
    if rise > 2.0 * n_parameters * np.log(len(rows)):
        return None
    if scan is not None and (gap > eps).any():
        # The axis along which they are apart; along the other they overlap.
        low, high = (
            np.where(gap > 0.0, gap_low + eps / 4, gap_high),
            np.where(gap > 0.0, gap_high - eps / 4, gap_low),
        )
        at = passages(scan, a.model.equation, a.axes, cloud.typical_sigma)
        if ((at >= low) & (at <= high)).all(axis=1).sum() > MOST_PASSING:
            return None
    return Patch.of(cloud, model, rows)


def _compete(cloud: NoisyPoints, patches: list[Patch], how: Peeling, eps: float) -> list[Patch]:
    """Give each point to the nearest plane, drop planes that others make needless, refit.

    A plane is needless when the points that it explains better than the others do not pay for
    its parameters and for saying which points are its own (Bayesian information criterion).
    """
    numbers, points, ratios = [], [], []
    for number, patch in enumerate(patches):
        ratio = np.abs(cloud.residuals(patch.model.equation)) / cloud.limit
        near = np.flatnonzero(ratio < _CLAIM)
        near = near[patch.covers(cloud.take(near), eps)]
        numbers.append(np.full(len(near), number))
        points.append(near)
        ratios.append(ratio[near])
    if not patches:
        return []
    # All pairs of a plane and a point near it: point by point, the nearest plane first.
    plane, point, ratio = (np.concatenate(parts) for parts in (numbers, points, ratios))
    order = np.lexsort((ratio, point))
    plane, point, ratio = plane[order], point[order], ratio[order]
    n_parameters = len(how.orientation.normal_space)
    in_sigmas = float(np.median(cloud.limit / cloud.sigma)) ** 2
    is_kept = np.ones(len(patches), dtype=bool)
    while True:
        is_first = np.diff(point, prepend=-1) != 0
        first = np.flatnonzero(is_first)
        owner, best = plane[first], ratio[first]
        second = np.append(np.where(is_first, _CLAIM, ratio), _CLAIM)[first + 1]
        rise = np.bincount(owner, in_sigmas * (second**2 - best**2), len(patches))
        n_own = np.bincount(owner, minlength=len(patches))
        n_near = np.bincount(plane[ratio <= 1.0], minlength=len(patches))
        share = np.clip(n_own / np.maximum(n_near, 1), 1e-12, 1.0 - 1e-12)
        n_other = np.maximum(n_near - n_own, 0)
        names = -2.0 * (n_own * np.log(share) + n_other * np.log1p(-share))
        gain = rise - names - 2.0 * n_parameters * np.log(len(cloud))
        gain[n_own < how.min_points] = -np.inf
        gain[~is_kept] = np.inf
        worst = int(np.argmin(gain))
        if gain[worst] >= 0.0:
            break
        is_kept[worst] = False
        others = plane != worst
        plane, point, ratio = plane[others], point[others], ratio[others]
    winners = []
    for winner in np.flatnonzero(is_kept):
        inliers = point[first[(owner == winner) & (best <= 1.0)]]
        model = fit(cloud.take(inliers), patches[winner].model.equation, how.orientation)
        if model is not None and len(inliers) >= how.min_points:
            winners.append(Patch.of(cloud, model, inliers))
    return winners
