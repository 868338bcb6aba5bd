"""Planes of a scan by RANSAC: its returns as noisy points, the search, the floor, the results."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from tqdm import tqdm

from primfit._check import Ints, number
from primfit.clouds.noise import FLOOR, estimate_sigma
from primfit.geometry.extents import extent
from primfit.geometry.products import product
from primfit.planes.peeling import Patch, Peeling, find_planes
from primfit.planes.plane import Plane, hull
from primfit.planes.ransac import NoisyPoints, Orientation, find_plane
from primfit.scans.scan import Scan

Progress = bool | Callable[[int, int], None]

SIGMAS = 3.0
"""Standard deviations within which a point counts as an inlier."""


def check_enough(n_returns: int) -> None:
    """Refuse clouds without a plane's worth of points."""
    if n_returns < 3:
        raise ValueError(
            f"points must hold at least 3 returns, since a plane needs as many, not {n_returns}"
        )


def noisy_points(
    scan: Scan,
    rows: Ints,
    sigma: Any,
    rng: np.random.Generator,
    *,
    threshold: float | None = None,
    along_beams: bool = True,
) -> tuple[NoisyPoints, float]:
    """Some returns of a scan as a cloud, and the noise that was given or estimated."""
    points = np.ascontiguousarray(scan.points[rows])
    directions = None
    if along_beams and scan.has_origins:
        directions = np.ascontiguousarray(scan.directions[rows])
    if sigma is None:
        sigma = estimate_sigma(points, directions, rng)
    spread = np.broadcast_to(np.asarray(sigma, dtype=float), len(scan))[rows]
    farthest = float(np.abs(points).max())
    least = max(FLOOR * extent(points), 4.0 * np.finfo(float).eps * farthest, 1e-100)
    each = np.maximum(spread, least)
    limit = SIGMAS * each
    if threshold is not None:
        limit = np.full(len(rows), number("threshold", threshold, above=0.0))
    return NoisyPoints(points, directions, each, limit), float(np.median(spread))


def peel_with_progress(
    cloud: NoisyPoints,
    how: Peeling,
    rng: np.random.Generator,
    scan: Scan | None,
    n_jobs: int | None,
    progress: Progress,
) -> tuple[list[Patch], float]:
    """`find_planes`, with a bar or a callable told of the points that are done."""
    with tqdm(total=len(cloud), unit="point", disable=progress is not True) as bar:

        def on_plane(n_done: int, n_all: int) -> None:
            bar.update(n_done - bar.n)
            if callable(progress):
                progress(n_done, n_all)

        return find_planes(cloud, how, rng, scan=scan, n_jobs=n_jobs, on_plane=on_plane)


def bounded(
    patches: list[Patch], cloud: NoisyPoints, rows: Ints, n: int
) -> tuple[tuple[Plane, ...], Ints]:
    """Patches as public planes, and the plane of each of n rows of the scan.

    `rows` are the scan's row numbers of the cloud. A point of two patches is the nearer one's.
    """
    owner = np.full(len(cloud), -1, dtype=np.int64)
    nearest = np.full(len(cloud), np.inf)
    for number_, patch in enumerate(patches):
        distance = np.abs(cloud.take(patch.inliers).residuals(patch.model.equation))
        closer = distance < nearest[patch.inliers]
        owner[patch.inliers[closer]] = number_
        nearest[patch.inliers[closer]] = distance[closer]
    labels = np.full(n, -1, dtype=np.int64)
    labels[rows] = owner
    planes = []
    for number_, patch in enumerate(patches):
        equation = patch.model.equation
        own = np.flatnonzero(owner == number_)
        at = product(cloud.take(own).feet(equation), patch.axes.T)
        at = at[np.isfinite(at).all(axis=1)]
        corners, area = hull(at)
        boundary = product(at[corners], patch.axes) - equation[3] * equation[:3]
        planes.append(
            Plane(
                equation=equation,
                inliers=rows[own],
                boundary=boundary,
                area=area,
                rms=patch.model.rms,
                covariance=patch.model.covariance,
            )
        )
    return tuple(planes), labels


def find_floor(cloud: NoisyPoints, rows: Ints, rng: np.random.Generator) -> Plane | None:
    """The horizontal plane that is seen from above and has next to nothing below it."""
    reach = max(extent(cloud.points), np.finfo(float).tiny)
    level = Orientation.of("horizontal")
    z = cloud.points[:, 2]
    pool = np.arange(len(cloud))
    if cloud.directions is None:
        # Without beams nothing tells the floor from a layer of the scan but that it is lowest.
        lowest = np.quantile(z, 0.01) + 3.0 * cloud.typical_limit
        pool = np.flatnonzero(z <= lowest)
    found = find_plane(
        cloud.take(pool), level, rng, near=None, eps=reach, min_points=10, max_trials=512
    )
    if found is None:
        return None
    model, inliers = found
    height = z + model.equation[3] / model.equation[2]
    below = (height < 0.0) & (np.abs(cloud.residuals(model.equation)) > 2.0 * cloud.limit)
    if model.equation[2] < 0.0 or below.mean() > 0.01 or len(inliers) < 0.02 * len(cloud):
        return None
    planes, _ = bounded([Patch.of(cloud, model, pool[inliers])], cloud, rows, int(rows[-1]) + 1)
    return planes[0] if planes[0].area > 0.0 else None
