"""Planes of a point cloud of which nothing is known: the call that finds nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from primfit import _primfit
from primfit._check import Floats, Ints, generator, integer, n_jobs_or_none, number
from primfit.clouds.foreign import PointsLike
from primfit.planes.firmness import Firmness
from primfit.planes.organised import image_of
from primfit.planes.outlines import Outlines
from primfit.planes.plane import Plane, Planes
from primfit.planes.ransac import Orientation
from primfit.planes.scan_planes import SIGMAS, Progress, check_enough
from primfit.planes.search import Search
from primfit.planes.surfaces import FlatParts
from primfit.scans.columns import as_sigma
from primfit.scans.recorded import as_scan
from primfit.scans.scan import Scan


def detect_planes(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | Callable[[Floats], ArrayLike] | None = None,
    rng: Any = None,
    *,
    orientation: Any = "any",
    max_angle: float | None = None,
    threshold: float | None = None,
    min_points: int | None = None,
    tiles: float | None = None,
    halo: float | None = None,
    executor: Executor | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Planes:
    """Planes of a point cloud of any kind and scale; nothing needs to be told.

    The smallest flat neighbourhood of each point tells the noise there; parts grow from the
    flattest ones, compete for the points and are put together where one plane explains two (see
    `primfit.planes.surfaces`). Curved surfaces and scattered points stay without a plane. Coplanar
    parts with a gap between them are planes of their own.

    An organised cloud, of at least 8 rows and columns, has a faster path of its own: its image
    tells which points are neighbours (see `primfit.planes.organised`). It is one as
    (h, w, 3), which `points_of_depth` gives, as a `Cloud` with a shape, which `read_cloud` makes of
    a PCD file of several rows, or as a `Scan` of a single pose with layers and columns. There,
    parts of a plane that do not touch in the image, since something in front hides what is between,
    are planes of their own. ``points.reshape(-1, 3)`` takes the path of other clouds.

    Parameters
    ----------
    points : Scan, or (n, 3) or (h, w, 3) float64, metres, or whatever `as_cloud` takes
        Pixels without a point are NaN or 0 0 0; labels and inliers count pixels row by row.
    origins : (n, 3), (3,) or None, metres
        Where the sensor was; with it planes are fitted to the ranges, and their normals point to
        the sensor. Else the largest component of each normal is positive.
    sigma : float, (n,), callable or None, metres
        Noise: one, one per point, or a function of the points (n, 3) that gives either, such as
        ``lambda points: 0.003 * points[:, 2] ** 2`` of a depth camera. None is estimated around
        each point. Of an image (h, w), n is h * w.
    rng : None, int or numpy.random.Generator
        Taken as everywhere else; nothing is drawn at random here.
    orientation : str or (3,)
        "any", "vertical", "horizontal", or the axis of the normal. It holds for the fitted plane;
        parts that do not lie on such a plane as well as on their own are left out.
    max_angle : float or None, radians
        How far a normal may be off the orientation; None for 0.
    threshold : float or None, metres
        Greatest distance of an inlier, for all planes; stands for three sigma. None: each plane's
        own, which `Planes.thresholds` reports.
    min_points : int or None
        Least inliers; None for 10, and as many as make a plane unlikely to be chance.
    tiles : float or None, metres
        Side of square tiles, seen from above, that the cloud is worked on by, for clouds that one
        machine or its memory is too small for (see `primfit.planes.tiles`). LAS and LAZ files, COPC
        among them, are then never held whole: tiles wait in a temporary folder. All are taken as
        clouds that are not organised, ``origins`` and ``sigma`` of a file are one for all.
    halo : float or None, metres
        How far beyond its border a tile sees, at most `tiles`; None for twice the radius of 384
        neighbours.
    executor : concurrent.futures.Executor or None
        Where tiles are worked on, with one thread each: a pool of processes, ``get_executor()`` of
        a client of Dask, Ray's or MPI's. None for here, one after the other. A tile whose worker is
        lost is tried again. The result does not depend on it.
    n_jobs : int or None
        Threads; None for all. The result does not depend on them.
    progress : bool or callable
        True shows a bar; a callable gets the number of planes done and in all, or of tiles.

    Returns
    -------
    Planes
        Takes about 300 bytes a point beyond the input, and keeps 48 a point for its firmness; by
        tiles, 16 bytes a point and 100 a point of the largest plane, and each worker 300 a point of
        its tile. With tiles `settings` tells
        "tiles" and "halo", metres, "n_tiles" and the points in the "largest_tile".

    Raises
    ------
    ValueError
        When points are fewer than a plane needs, or farther than float64 can compute with. Rows
        that are no points (see `Scan.from_points`) get label -1. When `halo` or `executor` is given
        without `tiles`.
    RuntimeError
        When workers are lost three times on the same tile.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> xy = np.random.default_rng(1).uniform(size=(500, 2))
    >>> planes = primfit.detect_planes(np.column_stack([xy, np.ones(500)]))
    >>> len(planes), f"{planes[0].rms:.6f}"
    (1, '0.000000')
    """
    if tiles is not None:
        from primfit.planes.tiles import planes_by_tiles

        if callable(sigma):
            raise TypeError("sigma must be a number or (n,) where tiles are given, no function")
        generator(rng)
        return planes_by_tiles(
            points,
            origins,
            sigma,
            orientation=orientation,
            max_angle=max_angle,
            threshold=threshold,
            min_points=min_points,
            tiles=tiles,
            halo=halo,
            executor=executor,
            n_jobs=n_jobs,
            progress=progress,
        )
    for name, value in (("halo", halo), ("executor", executor)):
        if value is not None:
            raise ValueError(f"{name} is for tiles, which must be given with it")
    # Nobody sees the scan, so it need not own its points.
    scan = as_scan(points, origins, copy=False)
    if callable(sigma):
        sigma = sigma(np.asarray(scan.points))
    generator(rng)
    return find_planes(
        scan,
        sigma,
        orientation=orientation,
        max_angle=max_angle,
        threshold=threshold,
        min_points=min_points,
        n_jobs=n_jobs,
        progress=progress,
    )[0]


def find_planes(
    scan: Scan,
    sigma: ArrayLike | None,
    *,
    orientation: Any,
    max_angle: float | None,
    threshold: float | None,
    min_points: int | None,
    n_jobs: int | None,
    progress: Progress,
) -> tuple[Planes, FlatParts | None]:
    """The planes of a scan as `detect_planes` finds them, and the flat parts that they come from.

    Those of an image, or by a threshold, are None: their noise is not what `flat_parts` tells.
    """
    offset = scan.far_offset
    scan = scan.moved(-offset)
    wanted = Orientation.of(orientation, max_angle)
    returns = scan.is_return
    n_returns = int(returns.sum())
    check_enough(n_returns)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    limit = None if threshold is None else number("threshold", threshold, above=0.0)
    least = 3 if min_points is None else integer("min_points", min_points, low=3)
    n_jobs = n_jobs_or_none(n_jobs)
    noise = given if limit is None else limit / SIGMAS
    if noise is not None:
        noise = np.array(np.broadcast_to(np.asarray(noise, dtype=float), len(scan)))
        if not noise[returns].any():
            noise = None
    cloud = np.ascontiguousarray(scan.points)
    search = Search(cloud, image_of(scan), noise, n_jobs)
    parts = search(returns)
    # Sums and outlines take the points in an order that does not depend on that of the rows.
    order = parts.order
    is_sorted = len(order) == len(scan) and np.array_equal(order, np.arange(len(order)))
    cloud = cloud if is_sorted else cloud[order]
    directions = None
    if scan.has_origins:
        directions = np.ascontiguousarray(scan.directions if is_sorted else scan.directions[order])
    fitted = fit_parts(
        cloud,
        directions,
        parts.labels if is_sorted else parts.labels[order],
        parts.sigma if is_sorted else parts.sigma[order],
        wanted,
        limit,
        n_jobs,
    )
    outlines = Outlines(n_jobs)
    planes: list[Plane] = []
    thresholds: list[float] = []
    labels = np.full(len(scan), -1, dtype=np.int64)
    for number_, part in enumerate(tqdm(fitted, unit="plane", disable=progress is not True)):
        if callable(progress):
            progress(number_ + 1, len(fitted))
        if part is None or len(part[2]) < least:
            continue
        (equation, covariance, rms), reach, near = part
        inliers = np.sort(order[near])
        labels[inliers] = len(planes)
        outline = outlines.of(equation, cloud, near)
        plane = Plane(
            equation=equation,
            inliers=inliers,
            boundary=outline.boundary,
            area=outline.area,
            rms=rms,
            covariance=covariance,
            holes=outline.holes,
        )
        planes.append(plane.moved(offset))
        thresholds.append(reach)
    if given is not None:
        used = float(np.median(given))
    elif planes:
        sizes = [len(plane.inliers) for plane in planes]
        used = float(np.median(np.repeat([plane.rms for plane in planes], sizes)))
    else:
        used = float(np.median(parts.sigma[returns]))
    settings = {
        "threshold": float(np.median(thresholds)) if thresholds else SIGMAS * used,
        "n_neighbors": parts.n_neighbors,
        "stride": parts.stride,
        "min_points": least,
    }
    # The points may be changed before someone asks.
    again = replace(search, cloud=search.cloud.copy())
    firmness = Firmness(labels, len(planes), order[returns[order]], again.labels)
    found = Planes(tuple(planes), labels, used, np.array(thresholds), settings, firmness)
    return found, parts if search.image is None and limit is None else None


Part = tuple[tuple[Floats, Floats, float], float, Ints]
"""Equation, covariance and rms of a plane; how near points are to it; and the rows of those."""


def fit_parts(
    points: Floats,
    directions: Floats | None,
    labels: Ints,
    sigma: Floats,
    wanted: Orientation,
    limit: float | None,
    n_jobs: int | None,
) -> list[Part | None]:
    """The wanted plane through the points of each label; None where there is none."""
    cosines = math.cos(wanted.high), math.cos(wanted.low)
    return _primfit.fit_parts(
        points, directions, labels, sigma, wanted.normal_space, wanted.axis, cosines, limit, n_jobs
    )
