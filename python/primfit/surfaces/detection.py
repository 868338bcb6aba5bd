"""Planes and curved surfaces of a point cloud of which nothing is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Floats, Ints, choice, generator, integer, n_jobs_or_none
from primfit._progress import Progress, reporting
from primfit.clouds.foreign import PointsLike
from primfit.geometry.extents import extent
from primfit.geometry.products import dots
from primfit.planes.detection import fit_parts
from primfit.planes.outlines import Outlines
from primfit.planes.plane import Plane
from primfit.planes.ransac import Orientation
from primfit.planes.scan_planes import SIGMAS, check_enough
from primfit.planes.surfaces import FlatParts, flat_parts
from primfit.scans.columns import as_sigma
from primfit.scans.recorded import as_scan
from primfit.scans.scan import Scan
from primfit.surfaces.kinds import (
    ConeSurface,
    CurvedSurface,
    CylinderSurface,
    SphereSurface,
    TorusSurface,
)
from primfit.surfaces.last_fit import Measured, last_fit

KINDS = ("plane", "sphere", "cylinder", "cone", "torus")

LEAST = 50
"""Fewest points of a surface: seven for each parameter of a torus."""

_TELLS_ROUGHNESS = 150
"""Points of a flat part that tells how rough surfaces are."""

_ROUGHEST = 4.0
"""Most by which surfaces are rougher than neighbouring points tell."""

_FLOOR = 1e-6
"""Least noise as a share of the extent: coordinates are stored rounded."""

_OUTLIERS = 0.01
"""Share of a surface's points that may be others': those at its border."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The surfaces of a cloud, the one with the most points first.

    Attributes
    ----------
    surfaces : tuple of Plane, SphereSurface, CylinderSurface, ConeSurface and TorusSurface
    labels : (n,) int64
        Surface of each point, -1 for none.
    sigma : float, metres
        Noise, given or estimated: the median over the points.
    thresholds : (k,) float64, metres
        Distance within which each surface takes points: three times its noise.
    settings : dict
        What the search used: "min_points"; "roughness", by which the noise of surfaces exceeds that
        of neighbouring points.
    """

    surfaces: tuple[Plane | CurvedSurface, ...]
    labels: Ints
    sigma: float
    thresholds: Floats
    settings: dict[str, Any]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each surface."""
        return tuple("plane" if isinstance(s, Plane) else s.kind for s in self.surfaces)

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Those that are planes."""
        return tuple(s for s in self.surfaces if isinstance(s, Plane))

    @property
    def spheres(self) -> tuple[SphereSurface, ...]:
        """Those that are spheres."""
        return tuple(s for s in self.surfaces if isinstance(s, SphereSurface))

    @property
    def cylinders(self) -> tuple[CylinderSurface, ...]:
        """Those that are cylinders."""
        return tuple(s for s in self.surfaces if isinstance(s, CylinderSurface))

    @property
    def cones(self) -> tuple[ConeSurface, ...]:
        """Those that are cones."""
        return tuple(s for s in self.surfaces if isinstance(s, ConeSurface))

    @property
    def tori(self) -> tuple[TorusSurface, ...]:
        """Those that are tori."""
        return tuple(s for s in self.surfaces if isinstance(s, TorusSurface))

    def __len__(self) -> int:
        return len(self.surfaces)

    def __getitem__(self, i: int) -> Plane | CurvedSurface:
        return self.surfaces[i]

    def __iter__(self) -> Iterator[Plane | CurvedSurface]:
        return iter(self.surfaces)

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{n} {kind if n == 1 else _PLURALS[kind]}"
            for kind in KINDS
            if (n := self.kinds.count(kind))
        )
        share = float((self.labels >= 0).mean()) if len(self.labels) else 0.0
        return (
            f"Surfaces({counts or 'none'}; {share:.0%} of {len(self.labels)} points, "
            f"sigma {self.sigma * 1000:.3g} mm)"
        )


_PLURALS = {
    "plane": "planes",
    "sphere": "spheres",
    "cylinder": "cylinders",
    "cone": "cones",
    "torus": "tori",
}


def detect_surfaces(
    points: Scan | PointsLike,
    origins: ArrayLike | None = None,
    sigma: ArrayLike | Callable[[Floats], ArrayLike] | None = None,
    rng: Any = None,
    *,
    kinds: Sequence[str] = KINDS,
    min_points: int | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Surfaces:
    """Planes, spheres, cylinders, cones and tori of a point cloud; nothing needs to be told.

    Noise and flat parts are those of `detect_planes`. Around some hundred places surfaces of all
    kinds are fitted at several scales; where one explains its points, all grow from there, and the
    simplest that explains what any of them took is kept. Surfaces then compete for the points, are
    put together where one explains two, and are fitted once more as `fit_cylinder` does: without
    bias, with a covariance.

    Parameters
    ----------
    points : Scan, or (n, 3) or (h, w, 3) float64, metres, or whatever `as_cloud` takes
        Rows without a point get label -1.
    origins : (n, 3), (3,) or None, metres
        Where the sensor was: surfaces are fitted to the ranges, and tell whether they were seen
        from outside.
    sigma : float, (n,), callable or None, metres
        Standard deviation of the noise, or a function of the points (n, 3) that gives it; None is
        estimated around each point.
    rng : None, int or numpy.random.Generator
        Taken as everywhere else; nothing is drawn at random here.
    kinds : sequence of str
        Which are wanted, of "plane", "sphere", "cylinder", "cone" and "torus". All compete; the
        points of those that are not wanted stay without label.
    min_points : int or None
        Least points of a surface, at least 10; None for 50.
    n_jobs : int or None
        Threads; None for all. The result does not depend on them.
    progress : bool or callable
        True shows a bar; a callable gets the number of surfaces fitted and in all.

    Returns
    -------
    Surfaces
        Takes about 700 bytes a point beyond the input.

    Raises
    ------
    ValueError
        When points are fewer than 3, or `kinds` are none of those.

    References
    ----------
    Schnabel, Wahl, Klein: Efficient RANSAC for point-cloud shape detection, Computer Graphics Forum
    26, 2007. Pottmann, Randrup: Rotational and helical surface approximation for reverse
    engineering, Computing 60, 1998.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> rng = np.random.default_rng(1)
    >>> angle, z = rng.uniform([0, 0], [2 * np.pi, 1.0], (3000, 2)).T
    >>> pipe = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), z])
    >>> floor = np.column_stack([rng.uniform(-1, 1, (5000, 2)), np.zeros(5000)])
    >>> found = primfit.detect_surfaces(np.vstack([pipe, floor]) + rng.normal(0, 0.002, (8000, 3)))
    >>> found.kinds, round(found.cylinders[0].radius, 3)
    (('plane', 'cylinder'), 0.2)
    """
    wanted = [
        choice("kinds", kind, KINDS) for kind in ([kinds] if isinstance(kinds, str) else kinds)
    ]
    if not wanted:
        raise ValueError(f"kinds must name at least one of {', '.join(KINDS)}")
    least = LEAST if min_points is None else integer("min_points", min_points, low=10)
    generator(rng)
    threads = n_jobs_or_none(n_jobs)
    scan = as_scan(points, origins, copy=False)
    if callable(sigma):
        sigma = sigma(np.asarray(scan.points))
    return find_surfaces(scan, sigma, wanted, least, threads, progress)


def find_surfaces(
    scan: Scan,
    sigma: ArrayLike | None,
    kinds: Sequence[str],
    min_points: int,
    n_jobs: int | None,
    progress: Progress = False,
    parts: FlatParts | None = None,
) -> Surfaces:
    """The surfaces of a scan as `detect_surfaces` finds them, from its flat parts if known."""
    offset = scan.far_offset
    scan = scan.moved(-offset)
    rows = np.flatnonzero(scan.is_return)
    check_enough(len(rows))
    rows = rows[np.lexsort(scan.points[rows].T[::-1])]
    cloud = np.ascontiguousarray(scan.points[rows])
    size = extent(cloud)
    given = scan.sigma if sigma is None else as_sigma(sigma, len(scan))
    noise = None
    if given is not None and np.any(np.asarray(given) > 0.0):
        noise = np.array(np.broadcast_to(np.asarray(given, dtype=float), len(scan))[rows])
        noise = np.maximum(noise, _FLOOR * size)
    beams = np.ascontiguousarray(scan.directions[rows]) if scan.has_origins else None
    measured = Measured(cloud, noise, beams, size)
    if parts is None:
        parts = flat_parts(cloud, noise, n_jobs)
    else:
        parts = replace(parts, labels=parts.labels[rows], sigma=parts.sigma[rows])
    rough = 1.0 if noise is not None else _roughness(cloud, parts, n_jobs)
    around = np.maximum(parts.sigma * rough, _FLOOR * size)
    tree = _primfit.PointTree(cloud, n_jobs)
    order = tree.order()
    found, sorted_labels, sorted_shared = _primfit.detect_surfaces(
        tree,
        np.ascontiguousarray(around[order]),
        np.ascontiguousarray(parts.labels[order]),
        min_points,
        n_jobs,
    )
    belongs = np.empty(len(cloud), dtype=np.int64)
    belongs[order] = sorted_labels
    is_shared = np.empty(len(cloud), dtype=bool)
    is_shared[order] = sorted_shared
    surfaces: list[Plane | CurvedSurface] = []
    thresholds: list[float] = []
    labels = np.full(len(scan), -1, dtype=np.int64)
    outlines = Outlines(n_jobs)
    with reporting(progress, len(found), "surface") as tell:
        for number, (kind, numbers) in enumerate(found):
            tell(number + 1)
            if kind not in kinds:
                continue
            own = np.flatnonzero(belongs == number)
            fitted: Plane | CurvedSurface | None = None
            if kind == "plane":
                fitted = _plane(own, rows, measured, around, outlines, n_jobs)
            else:
                some = measured.among(own)
                fit = last_fit(kind, np.array(numbers), some, _OUTLIERS, n_jobs, is_shared[own])
                # What it shares with others may be nearly all of it.
                if not fit.is_determined:
                    fit = last_fit(kind, np.array(numbers), some, _OUTLIERS, n_jobs)
                if fit.is_determined and fit.is_inlier.sum() >= min_points:
                    fitted = fit.found(rows[own], n_jobs)
            if fitted is None:
                continue
            labels[fitted.inliers] = len(surfaces)
            surfaces.append(fitted.moved(offset))
            thresholds.append(SIGMAS * fitted.rms)
    return Surfaces(
        tuple(surfaces),
        labels,
        float(np.median(around if noise is None else noise)),
        np.array(thresholds),
        {"min_points": min_points, "roughness": rough},
    )


def _roughness(points: Floats, parts: FlatParts, n_jobs: int | None) -> float:
    """By how much flat parts are thicker than the noise of their points."""
    fitted = _planes(points, None, parts.labels, parts.sigma, n_jobs)
    ratios, sizes = [], []
    for label, part in enumerate(fitted):
        if part is None or len(part[2]) < _TELLS_ROUGHNESS:
            continue
        equation = part[0][0]
        own = points[part[2]]
        off = np.abs(np.einsum("ni,i->n", own, equation[:3]) + equation[3])
        noise = float(np.median(parts.sigma[parts.labels == label]))
        ratios.append(float(np.median(off)) / 0.6745 / noise if noise > 0.0 else 1.0)
        sizes.append(len(own))
    if not ratios:
        return 1.0
    rising = np.argsort(ratios)
    shares = np.cumsum(np.array(sizes)[rising])
    middle = rising[np.searchsorted(shares, shares[-1] / 2.0)]
    return float(np.clip(ratios[middle], 1.0, _ROUGHEST))


def _planes(
    points: Floats, beams: Floats | None, labels: Ints, sigma: Floats, n_jobs: int | None
) -> Any:
    return fit_parts(points, beams, labels, sigma, Orientation.of("any"), None, n_jobs)


def _plane(
    own: Ints,
    rows: Ints,
    measured: Measured,
    around: Floats,
    outlines: Outlines,
    n_jobs: int | None,
) -> Plane | None:
    """The plane through some points, as `detect_planes` fits it."""
    some = measured.among(own)
    zeros = np.zeros(len(own), dtype=np.int64)
    (part,) = _planes(some.points, some.beams, zeros, around[own], n_jobs)
    if part is None:
        return None
    (equation, covariance, rms), _, near = part
    if some.beams is None:
        off = dots(some.points[near], equation[:3]) + equation[3]
        rms = float(np.sqrt(np.mean(off**2)))
    outline = outlines.of(equation, some.points, near)
    return Plane(
        equation=equation,
        inliers=np.sort(rows[own[near]]),
        boundary=outline.boundary,
        area=outline.area,
        rms=rms,
        covariance=covariance,
        holes=outline.holes,
    )
