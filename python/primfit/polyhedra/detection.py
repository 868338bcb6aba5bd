"""Solids of any shape in any position, from the planes of a cloud."""

from __future__ import annotations

from typing import Any

import numpy as np

from primfit.clouds.pinhole import is_of_pinhole
from primfit.planes.detection import detect_planes
from primfit.planes.scan_planes import Progress
from primfit.polyhedra.assembly import find_polyhedra
from primfit.results import Detection
from primfit.scans.scan import Scan


def detect_by_planes(
    scan: Scan,
    rng: Any = None,
    *,
    orientation: Any = "any",
    max_angle: float | None = None,
    sigma: Any = None,
    threshold: float | None = None,
    min_points: int | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Detection:
    """Planes in any direction by `detect_planes`, and the solids that they enclose.

    Nothing is assumed of the scene: not which way is up, no floor and no arena, which are planes
    as others are. A solid must be seen from around, but for faces that the seen ones force
    (see `find_polyhedra`); what a scan with origins sees from inside, as the walls of a room, is
    none.

    Parameters
    ----------
    scan : Scan
        With origins or without, as recorded. Points without origins that are pixels of a camera
        tell themselves that it was in the origin (`settings["camera_in_origin"]`): then normals
        point to it, and what was seen from outside is told from what was seen from inside.
    rng, orientation, max_angle, sigma, threshold, min_points, n_jobs, progress
        As those of `detect_planes`.

    Returns
    -------
    Detection
        Its solids are `FoundPolyhedron`.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> size, face = np.array([3.0, 2.0, 1.0]), np.arange(6000) % 6
    >>> points = size * np.random.default_rng(1).random((6000, 3))
    >>> points[np.arange(6000), face // 2] = face % 2 * size[face // 2]
    >>> primfit.detect(points)
    Detection(1 solid: rectangle; no arena; 6 planes; sigma 0 mm)
    """
    is_of_camera = not scan.has_origins and is_of_pinhole(scan.points[scan.is_return])
    seen = Scan.from_points(scan.points, np.zeros(3), scan.sigma) if is_of_camera else scan
    planes = detect_planes(
        seen,
        sigma=sigma,
        rng=rng,
        orientation=orientation,
        max_angle=max_angle,
        threshold=threshold,
        min_points=min_points,
        n_jobs=n_jobs,
        progress=progress,
    )
    polyhedra = find_polyhedra(planes, scan.points, facing=seen.has_origins)
    return Detection(
        scan=scan,
        method="planes",
        planes=planes.planes,
        labels=planes.labels,
        solids=polyhedra.solids,
        arena=None,
        floor=None,
        sigma=planes.sigma,
        settings=planes.settings | {"camera_in_origin": is_of_camera},
        shells=polyhedra.shells,
    )
