"""Planes of clouds by tiles, on many workers or from files larger than memory.

Square tiles seen from above, each with a halo of its neighbours' points. A tile labels its own
points; planes of two tiles are one where they label the same points of a halo and one plane
explains both. One noise, from patches of full density, holds for all tiles.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from primfit import _primfit
from primfit._check import Floats, Ints, as_vector, integer, n_jobs_or_none, number
from primfit._workers import results_of
from primfit.clouds.chunks import read_parts
from primfit.clouds.foreign import PointsLike
from primfit.planes.detection import detect_planes, fit_parts
from primfit.planes.joining import Moments, joined
from primfit.planes.outlines import Outlines
from primfit.planes.plane import Plane, Planes
from primfit.planes.ransac import Orientation
from primfit.planes.scan_planes import SIGMAS, Progress, check_enough
from primfit.planes.surfaces import flat_parts
from primfit.planes.tile_store import InFiles, InMemory, Tile, TileStore, with_halo
from primfit.scans.columns import as_sigma
from primfit.scans.recorded import as_scan
from primfit.scans.scan import Scan

_PATCHES = 9
"""Patches that tell the noise and the spacing: the median of as many is robust to four odd ones."""

_PATCH_POINTS = 8_000
"""Points of a patch: twenty of the largest neighbourhoods, so that one fits well within it."""

_INNER_POINTS = 2_000
"""Points in the middle of a patch, which reaches twice as far: their neighbourhoods are whole."""

_NEIGHBOURHOOD = 384
"""Points of the largest neighbourhood that `detect_planes` looks at around a point."""

_POINT_BYTES = 24
_MOST_TILES = 2**31
"""Columns and rows of tiles, beyond which coordinates do not tell them apart."""


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Points by tiles, and what is known of each row of the input."""

    store: TileStore
    n_rows: int
    origins: Floats | None
    sigma: float | Floats | None

    def origins_of(self, rows: Ints) -> Floats | None:
        if self.origins is None or self.origins.ndim == 1:
            return self.origins
        return self.origins[rows]


@dataclass(frozen=True, eq=False)
class _Found:
    """Planes of a tile: labels of its own points and its halo's, moments of its own points'."""

    labels: Ints
    moments: list[Moments]
    n_neighbors: int
    stride: int


def planes_by_tiles(
    points: Scan | PointsLike,
    origins: ArrayLike | None,
    sigma: ArrayLike | None,
    *,
    orientation: Any,
    max_angle: float | None,
    threshold: float | None,
    min_points: int | None,
    tiles: float,
    halo: float | None,
    executor: Executor | None,
    n_jobs: int | None,
    progress: Progress,
) -> Planes:
    """See `detect_planes`."""
    side = number("tiles", tiles, above=0.0)
    wanted = Orientation.of(orientation, max_angle)
    limit = None if threshold is None else number("threshold", threshold, above=0.0)
    least = 3 if min_points is None else integer("min_points", min_points, low=3)
    n_jobs = n_jobs_or_none(n_jobs)
    if executor is not None and not isinstance(executor, Executor):
        raise TypeError(
            f"executor must be a concurrent.futures.Executor, as client.get_executor() of Dask "
            f"gives, not {type(executor).__name__}"
        )
    if halo is not None and number("halo", halo, low=0.0) > side:
        raise ValueError(f"halo must be at most tiles, {side:g} m, not {halo!r}")
    options = {"orientation": orientation, "max_angle": max_angle, "threshold": threshold}
    options["n_jobs"] = n_jobs if executor is None else 1
    with _cloud_of(points, origins, sigma, side) as cloud:
        store = cloud.store
        check_enough(sum(store.sizes.values()))
        given = cloud.sigma
        noise, reach = (None, 0.0)
        if halo is None or (given is None and limit is None):
            noise, reach = _noise_and_reach(store, n_jobs)
        # Thus far, every point of a tile has the neighbourhood that it has in the whole.
        width = min(reach, side) if halo is None else float(halo)
        common = noise if given is None and limit is None else given

        def load(tile: Tile) -> tuple[Any, ...]:
            rows, of_tile, n_own = with_halo(store, tile, side, width)
            told = common[rows] if isinstance(common, np.ndarray) else common
            return of_tile, cloud.origins_of(rows), told, n_own, options

        found: dict[Tile, _Found] = {}
        share = (1.0 + 2.0 * width / side) ** 2
        n_bytes = {tile: int(n * share) * _POINT_BYTES for tile, n in store.sizes.items()}
        with tqdm(total=len(n_bytes), unit="tile", disable=progress is not True) as bar:
            for tile, result in results_of(executor, _search, load, n_bytes):
                found[tile] = result
                bar.update()
                if callable(progress):
                    progress(len(found), len(n_bytes))
        order = sorted(found)
        floor = float(np.median(common)) if common is not None else (limit or 0.0) / SIGMAS
        labels = _joined_labels(cloud, order, found, side, width, floor)
        spread: Any = common if common is not None else floor
        planes, thresholds = _fitted(cloud, order, labels, spread, wanted, limit, least, n_jobs)
    used = floor
    if given is None:
        rms = np.array([plane.rms for plane in planes])
        in_planes = labels[labels >= 0]
        used = float(np.median(rms[in_planes])) if len(in_planes) else floor
    settings = {
        "threshold": float(np.median(thresholds)) if len(thresholds) else SIGMAS * used,
        "n_neighbors": max(each.n_neighbors for each in found.values()),
        "stride": max(each.stride for each in found.values()),
        "min_points": least,
        "tiles": side,
        "halo": width,
        "n_tiles": len(found),
        "largest_tile": max(len(each.labels) for each in found.values()),
    }
    unknown = np.full(len(planes), np.nan)
    return Planes(tuple(planes), labels, used, thresholds, settings, unknown)


@contextmanager
def _cloud_of(
    points: Any, origins: ArrayLike | None, sigma: ArrayLike | None, side: float
) -> Iterator[_Cloud]:
    """The points by tiles; those of a LAS or LAZ file in a folder that is removed afterwards."""
    is_long = isinstance(points, str | PathLike) and Path(points).suffix.lower() in (".las", ".laz")
    if not is_long:
        scan = as_scan(points, origins, copy=False)
        given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
        rows = np.flatnonzero(scan.is_return)
        inside = scan.points if len(rows) == len(scan) else scan.points[rows]
        _check_side(inside, side)
        known = np.asarray(scan.origins) if scan.has_origins else None
        yield _Cloud(InMemory(inside, rows, side), len(scan), known, given)
        return
    origin = None if origins is None else as_vector("origins", origins, 3)
    noise = None if sigma is None else number("sigma", sigma, low=0.0)
    with TemporaryDirectory(prefix="primfit_tiles_") as folder:
        store, n_rows = InFiles(Path(folder), side), 0
        for part in read_parts(points):
            scan = as_scan(part, copy=False)
            rows = np.flatnonzero(scan.is_return)
            _check_side(scan.points[rows], side)
            store.add(scan.points[rows], n_rows + rows)
            n_rows += len(part)
        yield _Cloud(store, n_rows, origin, noise)


def _check_side(points: Floats, side: float) -> None:
    if len(points) and np.abs(points[:, :2]).max() / side > _MOST_TILES:
        raise ValueError(f"tiles must be larger for points so far from 0, not {side:g} m")


def _search(
    points: Floats, origins: Floats | None, sigma: Any, n_own: int, options: dict[str, Any]
) -> _Found:
    """The planes of one tile and its halo; the first `n_own` points are its own."""
    if len(points) < 3:
        return _Found(np.full(len(points), -1, np.int32), [], 0, 1)
    planes = detect_planes(points, origins, sigma, **options)
    own = (np.searchsorted(plane.inliers, n_own) for plane in planes)
    moments = [Moments.of(points[plane.inliers[:n]]) for plane, n in zip(planes, own, strict=True)]
    settings = planes.settings
    return _Found(
        planes.labels.astype(np.int32), moments, settings["n_neighbors"], settings["stride"]
    )


def _noise_and_reach(store: TileStore, n_jobs: int | None) -> tuple[float, float]:
    """The noise, and the radius of a neighbourhood that nine of ten do not exceed, metres.

    From patches of full density in the middle of tiles, which are spread evenly over the points
    when tiles are put in line by how many they have.
    """
    by_size = sorted(store.sizes, key=lambda tile: (store.sizes[tile], tile))
    cumulative = np.cumsum([store.sizes[tile] for tile in by_size])
    at = (np.arange(_PATCHES) + 0.5) / _PATCHES * cumulative[-1]
    chosen = np.unique(np.searchsorted(cumulative, at))
    noise, radii = [], []
    for place in chosen:
        points = store.own(by_size[place])[1]
        middle = np.median(points, axis=0)
        off = ((points[:, :2] - middle[:2]) ** 2).sum(axis=1)
        patch = np.ascontiguousarray(points[np.argsort(off, kind="stable")[:_PATCH_POINTS]])
        parts = flat_parts(patch, None, n_jobs)
        is_flat = parts.labels >= 0
        if is_flat.any():
            noise.append(float(np.median(parts.sigma[is_flat])))
        local = patch - middle
        inner = local[: min(_INNER_POINTS, len(local))]
        some = np.ascontiguousarray(inner[:: max(1, len(inner) // 1000)])
        n_near = min(_NEIGHBOURHOOD, len(local))
        distances = _primfit.PointTree(local, n_jobs).neighbors(some, n_near)[1]
        radii.append(float(np.quantile(distances[:, -1], 0.9)))
    return float(np.median(noise)) if noise else 0.0, float(np.median(radii))


def _joined_labels(
    cloud: _Cloud,
    order: list[Tile],
    found: dict[Tile, _Found],
    side: float,
    halo: float,
    noise: float,
) -> Ints:
    """A number for each row, the same where planes of tiles are one; -1 for none."""
    first = dict(zip(order, np.cumsum([0, *(len(found[t].moments) for t in order)]), strict=False))
    labels = np.full(cloud.n_rows, -1, dtype=np.int64)
    halos = []
    for tile in order:
        rows, _, n_own = with_halo(cloud.store, tile, side, halo)
        numbers = found[tile].labels.astype(np.int64)
        numbers[numbers >= 0] += first[tile]
        labels[rows[:n_own]] = numbers[:n_own]
        halos.append((rows[n_own:], numbers[n_own:]))
    pairs = [np.column_stack([numbers, labels[rows]]) for rows, numbers in halos]
    tile_of = np.repeat(np.arange(len(order)), [len(found[tile].moments) for tile in order])
    moments = [each for tile in order for each in found[tile].moments]
    group = joined(moments, np.concatenate(pairs), tile_of, noise)
    labels[labels >= 0] = group[labels[labels >= 0]]
    return labels


def _fitted(
    cloud: _Cloud,
    order: list[Tile],
    labels: Ints,
    noise: Any,
    wanted: Orientation,
    limit: float | None,
    least: int,
    n_jobs: int | None,
) -> tuple[list[Plane], Floats]:
    """The planes through the points of each number, the one with the most first.

    Changes `labels` to the numbers of planes.
    """
    n_left = np.bincount(labels[labels >= 0]) if (labels >= 0).any() else np.empty(0, np.int64)
    gathered: dict[int, list[tuple[Ints, Floats]]] = {}
    outlines = Outlines(n_jobs)
    fitted: list[tuple[Plane, float]] = []
    for tile in order:
        rows, points = cloud.store.own(tile)
        of_tile = labels[rows]
        for number_ in np.unique(of_tile[of_tile >= 0]).tolist():
            is_in = of_tile == number_
            gathered.setdefault(number_, []).append((rows[is_in], points[is_in]))
            n_left[number_] -= is_in.sum()
            if not n_left[number_]:
                parts = zip(*gathered.pop(number_), strict=True)
                all_rows, all_points = (np.concatenate(each) for each in parts)
                rising = np.argsort(all_rows)
                plane = _plane(
                    cloud, all_rows[rising], all_points[rising], noise, wanted, limit, outlines
                )
                if plane is not None and len(plane[0].inliers) >= least:
                    fitted.append(plane)
    fitted.sort(key=lambda each: (-len(each[0].inliers), each[0].inliers[0]))
    labels[:] = -1
    for number_, (found, _) in enumerate(fitted):
        labels[found.inliers] = number_
    return [plane for plane, _ in fitted], np.array([reach for _, reach in fitted])


def _plane(
    cloud: _Cloud,
    rows: Ints,
    points: Floats,
    noise: Any,
    wanted: Orientation,
    limit: float | None,
    outlines: Outlines,
) -> tuple[Plane, float] | None:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    origins = cloud.origins_of(rows)
    directions = None
    if origins is not None:
        directions = np.ascontiguousarray(Scan.from_points(points, origins).directions)
    local = points - middle
    sigma = noise[rows] if isinstance(noise, np.ndarray) else np.full(len(rows), float(noise))
    labels = np.zeros(len(rows), dtype=np.int64)
    (fitted,) = fit_parts(local, directions, labels, sigma, wanted, limit, 1)
    if fitted is None or not len(fitted[2]):
        return None
    (equation, covariance, rms), reach, near = fitted
    outline = outlines.of(equation, local, near)
    plane = Plane(
        equation=equation,
        inliers=rows[near],
        boundary=outline.boundary,
        area=outline.area,
        rms=rms,
        covariance=covariance,
        holes=outline.holes,
    )
    return plane.moved(middle), reach
