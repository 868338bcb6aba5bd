"""Solids of any shape in any position, from the planes and curved surfaces of a cloud."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from primfit._check import Ints, choice, generator, instance, integer, n_jobs_or_none, number
from primfit.clouds.pinhole import is_of_pinhole
from primfit.planes.detection import find_planes
from primfit.planes.plane import Plane
from primfit.planes.ransac import Orientation
from primfit.planes.scan_planes import Progress
from primfit.polyhedra.assembly import find_polyhedra
from primfit.results import Detection
from primfit.scans.columns import as_sigma
from primfit.scans.scan import Scan
from primfit.solids.found import FoundSolid
from primfit.surfaces.detection import KINDS, LEAST, find_surfaces
from primfit.surfaces.kinds import CurvedSurface
from primfit.surfaces.round_solids import round_solids, tiles_of


@dataclass(frozen=True)
class PlaneSettings:
    """How `primfit.detect` by planes runs; lengths in metres.

    Attributes
    ----------
    orientation : str or (3,)
        "any", "vertical", "horizontal", or the axis of the normal.
    max_angle : float or None, radians
        How far a normal may be off the orientation.
    threshold : float or None
        Greatest distance of an inlier, for all planes; None: each plane's own.
    min_points : int or None
        Least inliers; None for 10, and as many as make a plane unlikely to be chance.
    kinds : tuple of str
        Surfaces that are looked for: "plane", and of "sphere", "cylinder", "cone", "torus" those
        that may be solids.
    """

    orientation: Any = "any"
    max_angle: float | None = None
    threshold: float | None = None
    min_points: int | None = None
    kinds: Sequence[str] = KINDS

    def __post_init__(self) -> None:
        Orientation.of(self.orientation, self.max_angle)
        if self.threshold is not None:
            number("threshold", self.threshold, above=0.0)
        if self.min_points is not None:
            integer("min_points", self.min_points, low=3)
        kinds = [self.kinds] if isinstance(self.kinds, str) else self.kinds
        if not isinstance(kinds, Collection):
            raise TypeError(f"kinds must be names out of {', '.join(KINDS)}; not {kinds!r}")
        chosen = {choice("kinds", each, KINDS) for each in kinds}
        if "plane" not in chosen:
            raise ValueError(f"kinds must hold 'plane', not {', '.join(sorted(chosen)) or 'none'}")
        object.__setattr__(self, "kinds", tuple(kind for kind in KINDS if kind in chosen))


def detect_by_planes(
    scan: Scan,
    rng: Any = None,
    *,
    settings: PlaneSettings | None = None,
    orientation: Any = None,
    max_angle: float | None = None,
    sigma: Any = None,
    threshold: float | None = None,
    min_points: int | None = None,
    kinds: Sequence[str] | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Detection:
    """Planes by `detect_planes` and curved surfaces by `detect_surfaces`, and what they enclose.

    Nothing is assumed of the scene: not which way is up, no floor and no arena, which are planes
    as others are. A solid must be seen from around, but for faces that the seen ones force
    (see `find_polyhedra`); what a scan with origins sees from inside, as the walls of a room, is
    none. Round solids are those of which a surface shows as much as is in view from two radii away
    (pipes, cans, balls, columns, rings; see `primfit.surfaces.round_solids`); flat parts that tile
    the surface of one are no planes then.

    Parameters
    ----------
    scan : Scan
        With origins or without, as recorded. Points without origins that are pixels of a camera
        tell themselves that it was in the origin (`settings["camera_in_origin"]`): then normals
        point to it, and what was seen from outside is told from what was seen from inside.
    rng, sigma, n_jobs, progress
        As those of `detect_planes`.
    settings : PlaneSettings or None
        None for the defaults.
    orientation, max_angle, threshold, min_points, kinds
        As in the settings, instead of which each may be given alone.

    Returns
    -------
    Detection
        Its solids are named at any tilt.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> size, face = np.array([3.0, 2.0, 1.0]), np.arange(6000) % 6
    >>> points = size * np.random.default_rng(1).random((6000, 3))
    >>> points[np.arange(6000), face // 2] = face % 2 * size[face // 2]
    >>> primfit.detect(points)
    Detection(1 solid: box; no arena; 6 planes; sigma 0 mm)
    """
    how = PlaneSettings() if settings is None else settings
    instance("settings", how, PlaneSettings)
    wishes = {"orientation": orientation, "max_angle": max_angle}
    wishes |= {"threshold": threshold, "min_points": min_points, "kinds": kinds}
    how = replace(how, **{name: wish for name, wish in wishes.items() if wish is not None})
    if callable(sigma):
        sigma = sigma(np.asarray(scan.points))
    is_of_camera = not scan.has_origins and is_of_pinhole(scan.points[scan.is_return])
    seen = Scan.from_points(scan.points, np.zeros(3), scan.sigma) if is_of_camera else scan
    generator(rng)
    planes, parts = find_planes(
        seen,
        sigma,
        orientation=how.orientation,
        max_angle=how.max_angle,
        threshold=how.threshold,
        min_points=how.min_points,
        n_jobs=n_jobs,
        progress=progress,
    )
    flat, labels = planes.planes, planes.labels
    curved: tuple[CurvedSurface, ...] = ()
    rounds: list[FoundSolid] = []
    wanted = [kind for kind in how.kinds if kind != "plane"]
    if wanted:
        found = find_surfaces(seen, sigma, wanted, LEAST, n_jobs_or_none(n_jobs), parts=parts)
        curved = tuple(each for each in found if not isinstance(each, Plane))
        noise = seen.sigma if sigma is None else as_sigma(sigma, len(seen))
        rounds = round_solids(curved, flat, scan.points, noise if np.any(noise) else None)
        if rounds:
            flat, labels, rounds = _without_tiles(flat, labels, curved, rounds)
    polyhedra = find_polyhedra(flat, scan.points, facing=seen.has_origins)
    return Detection(
        scan=scan,
        method="planes",
        planes=flat,
        labels=labels,
        solids=(*polyhedra.solids, *rounds),
        arena=None,
        floor=None,
        sigma=planes.sigma,
        settings=planes.settings | {"camera_in_origin": is_of_camera},
        shells=polyhedra.shells,
        surfaces=curved,
    )


def _without_tiles(
    planes: tuple[Plane, ...],
    labels: Ints,
    curved: tuple[CurvedSurface, ...],
    rounds: list[FoundSolid],
) -> tuple[tuple[Plane, ...], Ints, list[FoundSolid]]:
    """Planes but for those that tile round solids, their labels, and the solids that name them."""
    tiles = tiles_of([curved[i] for solid in rounds for i in solid.surfaces], planes)
    kept = [i for i, plane in enumerate(planes) if plane not in tiles]
    numbers = np.full(len(planes) + 1, -1, dtype=np.int64)
    numbers[kept] = np.arange(len(kept))
    solids = [replace(each, planes=tuple(numbers[list(each.planes)].tolist())) for each in rounds]
    return tuple(planes[i] for i in kept), numbers[labels], solids
