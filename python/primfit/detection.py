"""The call that finds planes and solids, by one of three methods."""

from __future__ import annotations

from inspect import signature
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from primfit._check import choice
from primfit.likelihood.detection import detect_likelihood
from primfit.paper.detection import detect_paper
from primfit.polyhedra.detection import detect_by_planes
from primfit.results import Detection
from primfit.scans.scan import Scan

_METHODS = {"likelihood": detect_likelihood, "planes": detect_by_planes, "paper": detect_paper}


def detect(
    scan: Scan | ArrayLike,
    method: str | None = None,
    *,
    rng: Any = None,
    **options: Any,
) -> Detection:
    """Planes and solids of a scan.

    Parameters
    ----------
    scan : Scan, Cloud or (n, 3) float64, metres
        The raw scan, floor returns included, or a bare cloud.
    method : str or None
        "likelihood": solids that explain all ranges, returned or not, which stands noise as large
        as the solids (see `detect_likelihood`); it asks where the beams began, and should know how
        far the sensor sees.
        "planes": planes in any direction, and the solids that they enclose, in any position and of
        any shape (see `detect_by_planes`).
        "paper": RANSAC, DBSCAN, intersections and cycles, with repairs (see `detect_paper`): for
        upright solids; where nobody saw their tops, it tells more of them than "planes".
        None is "likelihood" for a scan with origins and `max_range`, else "planes".
    rng : None, int or numpy.random.Generator
        Same `rng`, same result, at any number of threads.
    **options
        Passed to the method.

    Returns
    -------
    Detection

    Raises
    ------
    ValueError
        When the method is unknown, or the scan is empty or not finite.
    TypeError
        When the method does not know an option.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> scan = primfit.scan(world, primfit.grid_path(world, 0.25, rng=7), rng=7)
    >>> primfit.detect(scan, rng=7)
    Detection(1 solid: square; an arena; 8 planes; sigma 0 mm)
    """
    if isinstance(scan, str | PathLike):
        raise TypeError(
            f"scan must be a Scan or points, as Scan.load or read_points read, not {scan!r}"
        )
    recorded = scan if isinstance(scan, Scan) else Scan.from_points(scan)
    if method is None:
        passed_is_known = recorded.has_origins and recorded.max_range is not None
        method = "likelihood" if passed_is_known else "planes"
    run = _METHODS[choice("method", method, list(_METHODS))]
    known = [
        name for name, each in signature(run).parameters.items() if each.kind == each.KEYWORD_ONLY
    ]
    for name in options:
        if name not in known:
            raise TypeError(f"options of method={method!r} are {', '.join(known)}; not {name}")
    offset = recorded.far_offset
    return run(recorded.moved(-offset), rng, **options).moved(offset, recorded)
