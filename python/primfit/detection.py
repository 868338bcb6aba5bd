"""The call that finds planes and solids, by one of three methods."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, Ints, choice
from primfit._later import replaced
from primfit.clouds.foreign import PointsLike
from primfit.clouds.upright import uprightness
from primfit.likelihood.detection import detect_likelihood
from primfit.likelihood.settings import LikelihoodSettings
from primfit.paper.detection import PaperSettings, detect_paper
from primfit.planes.plane import Plane
from primfit.planes.scan_planes import Progress
from primfit.polyhedra.detection import PlaneSettings, detect_by_planes
from primfit.results import Detection
from primfit.scans.recorded import as_scan
from primfit.scans.scan import Scan
from primfit.surfaces.detection import detect_surfaces

Settings = LikelihoodSettings | PlaneSettings | PaperSettings
"""How a method runs; each is that of one method."""


@dataclass(frozen=True)
class _Method:
    """A kind of settings, and the function that detects by them.

    The function takes a scan that is near the origin and has a point or a miss in each row, `rng`,
    and as keywords `settings`, `sigma`, `n_jobs`, `progress` and what it wants to know of the scan.
    """

    settings: type[Settings]
    function: Callable[..., Detection]

    @property
    def options(self) -> list[str]:
        """What may be given by keyword."""
        parameters = signature(self.function).parameters
        return [name for name, each in parameters.items() if each.kind == each.KEYWORD_ONLY]


_METHODS = {
    "likelihood": _Method(LikelihoodSettings, detect_likelihood),
    "planes": _Method(PlaneSettings, detect_by_planes),
    "paper": _Method(PaperSettings, detect_paper),
}


class _Common(TypedDict, total=False):
    """Options of every method."""

    rng: Any
    sigma: ArrayLike | None
    n_jobs: int | None
    progress: Progress


class _OfLikelihood(_Common, total=False):
    tolerance: float | None
    pose_sigma: ArrayLike | None
    step_sigma: ArrayLike | None
    estimate: Collection[str]
    settings: LikelihoodSettings | None


class _OfPlanes(_Common, total=False):
    settings: PlaneSettings | None
    orientation: Any
    max_angle: float | None
    threshold: float | None
    min_points: int | None
    kinds: Sequence[str]


class _OfPaper(_Common, total=False):
    orientation: Any
    max_angle: float | None
    settings: PaperSettings | None


class _OfAny(_Common, total=False):
    orientation: Any
    max_angle: float | None
    threshold: float | None
    min_points: int | None
    kinds: Sequence[str]
    tolerance: float | None
    pose_sigma: ArrayLike | None
    step_sigma: ArrayLike | None
    estimate: Collection[str]
    settings: Settings | None


@overload
def detect(
    scan: Scan | PointsLike, method: Literal["likelihood"], **options: Unpack[_OfLikelihood]
) -> Detection: ...


@overload
def detect(
    scan: Scan | PointsLike, method: Literal["planes"], **options: Unpack[_OfPlanes]
) -> Detection: ...


@overload
def detect(
    scan: Scan | PointsLike, method: Literal["paper"], **options: Unpack[_OfPaper]
) -> Detection: ...


@overload
def detect(
    scan: Scan | PointsLike, method: Settings | None = None, **options: Unpack[_OfAny]
) -> Detection: ...


def detect(
    scan: Scan | PointsLike,
    method: str | Settings | None = None,
    *,
    rng: Any = None,
    **options: Any,
) -> Detection:
    """Planes and solids of a scan.

    Parameters
    ----------
    scan : Scan, or (n, 3) or (h, w, 3) float64, metres, or whatever `as_cloud` takes
        The raw scan, floor returns included, or a cloud, bare or organised, or the path of either.
        Rows without a point, as those of depth cameras (see `Scan.from_points`), get label -1.
    method : str, LikelihoodSettings, PlaneSettings, PaperSettings or None
        Its name, or its settings, which name it.
        "likelihood": solids that explain all ranges, returned or not, which stands noise as large
        as the solids (see `detect_likelihood`); it asks where the beams began, and should know how
        far the sensor sees.
        "planes": planes in any direction and curved surfaces, and the solids that they enclose, in
        any position and of any shape (see `detect_by_planes`).
        "paper": RANSAC, DBSCAN, intersections and cycles, with repairs (see `detect_paper`): for
        upright solids; where nobody saw their tops, it tells more of them than "planes".
        None is what `choose_method` says.
    rng : None, int or numpy.random.Generator
        Same `rng`, same result, at any number of threads.
    **options
        Of the method: `settings`, `sigma`, `n_jobs` and `progress` of each; of "planes" and "paper"
        `orientation` and `max_angle`; `threshold`, `min_points` and `kinds` of "planes";
        `tolerance`, `pose_sigma`, `step_sigma` and `estimate` of "likelihood". The page of each
        method tells of them.

    Returns
    -------
    Detection
        Its `method` and `settings["method_reason"]` tell by which method, and why.

    Raises
    ------
    ValueError
        When the method is unknown, or the scan is empty or not finite.
    TypeError
        When the method does not know an option, or both it and an option are settings.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> scan = primfit.scan(world, primfit.grid_path(world, 0.25, rng=7), rng=7)
    >>> primfit.detect(scan, rng=7)
    Detection(1 solid: square; an arena; 8 planes; sigma 0 mm)
    >>> primfit.detect(scan, primfit.PlaneSettings(min_points=30), rng=7).method
    'planes'
    """
    if method is not None and not isinstance(method, str):
        if options.get("settings") is not None:
            raise TypeError("settings must not be given twice, as method and as settings")
        options["settings"] = method
        method = _named_by(method)
    recorded = as_scan(scan)
    rows = None
    whole = recorded
    if recorded.is_blank.any():
        rows = np.flatnonzero(~recorded.is_blank)
        recorded = recorded.select(rows)
    if method is None:
        method, reason = choose_method(recorded)
    else:
        choice("method", method, list(_METHODS))
        reason = "asked for"
    known = _METHODS[method].options
    for name in options:
        if name not in known:
            others = [repr(each) for each, other in _METHODS.items() if name in other.options]
            hint = f", which {' and '.join(others)} would take" if others else ""
            raise TypeError(
                f"options of method={method!r} are {', '.join(known)}; not {name}{hint} "
                f"(why this method: {reason})"
            )
    offset = recorded.far_offset
    found = _METHODS[method].function(recorded.moved(-offset), rng, **options)
    if rows is not None:
        found = _of_rows(found, rows, len(whole))
    found = found.moved(offset, whole if found.path is None else _seen(found, rows, whole, offset))
    return replace(found, settings=found.settings | {"method_reason": reason})


_THINNED = 5000
"""Points that tell whether upright walls are flat."""


def _are_round(points: Floats) -> bool:
    """Whether most of the points on upright walls are on curved ones, as those of a pipe are."""
    distinct = np.unique(points, axis=0)
    found = detect_surfaces(distinct[:: -(-len(distinct) // _THINNED)])
    curved = sum(len(each.inliers) for each in found if not isinstance(each, Plane))
    flat = sum(len(each.inliers) for each in found.planes if abs(each.equation[2]) < 0.5)
    return curved > flat


def _named_by(settings: object) -> str:
    for name, method in _METHODS.items():
        if isinstance(settings, method.settings):
            return name
    known = ", ".join(method.settings.__name__ for method in _METHODS.values())
    raise TypeError(f"method must be a name, None, or one of {known}; not {settings!r}")


def _seen(found: Detection, rows: Ints | None, whole: Scan, offset: Floats) -> Scan:
    """The whole scan with beams from where they were found to begin."""
    seen = found.scan.moved(offset)
    if rows is None:
        return seen
    names = ("points", "origins", "directions", "ranges")
    arrays: dict[str, Any] = {name: np.array(getattr(whole, name)) for name in names}
    for name, array in arrays.items():
        array[rows] = getattr(seen, name)
    return replace(whole, **arrays, path=seen.path)


def _of_rows(found: Detection, rows: Ints, n: int) -> Detection:
    """The detection in some rows of a scan as one in the scan of `n` rows."""
    labels = np.full(n, -1, dtype=np.int64)
    labels[rows] = found.labels
    planes = tuple(replaced(plane, inliers=rows[plane.inliers]) for plane in found.planes)
    surfaces = tuple(replaced(each, inliers=rows[each.inliers]) for each in found.surfaces)
    floor = found.floor and replaced(found.floor, inliers=rows[found.floor.inliers])
    return replace(found, labels=labels, planes=planes, surfaces=surfaces, floor=floor)


def choose_method(scan: Scan | PointsLike) -> tuple[str, str]:
    """The method that `detect` takes by itself, and why.

    "likelihood" for a scan that knows where its beams began, and either how far the sensor sees
    or which beams did not return. Of returns alone, what the cloud holds decides: upright walls,
    most of them flat, with nothing level or leaning but a floor are "likelihood" where the origins
    are known, and "paper" where not, since solids whose tops nobody saw do not close; all others
    are "planes".

    Parameters
    ----------
    scan : Scan, or (n, 3) float64, metres, or whatever `as_cloud` takes

    Returns
    -------
    method, reason : str

    Examples
    --------
    >>> import numpy as np, primfit
    >>> box = primfit.Polyhedron.box(0.4, 0.3, 0.2, quat_xyzw=(0.2, 0.1, 0, 1))
    >>> scan = primfit.scan(primfit.World([box]), [(-0.6, 0.0, 0.0), (0.0, 0.7, -1.6)], rng=7)
    >>> primfit.choose_method(scan)
    ('likelihood', 'origins and reach of the beams are known')
    >>> primfit.choose_method(scan.points[scan.is_return])
    ('planes', 'a cloud not of upright walls alone')
    """
    recorded = as_scan(scan)
    recorded = recorded.select(~recorded.is_blank)
    if recorded.has_origins and recorded.max_range is not None:
        return "likelihood", "origins and reach of the beams are known"
    if recorded.has_origins and not recorded.is_return.all():
        return "likelihood", "origins of the beams are known, and which did not return"
    points = recorded.points[recorded.is_return]
    if (
        len(points)
        and np.isfinite(points).all()
        and uprightness(points).has_only_walls
        and not _are_round(points)
    ):
        if recorded.has_origins:
            return "likelihood", "upright walls, no tops seen, and origins of the beams are known"
        return "paper", "a cloud of upright walls, no tops seen"
    return "planes", "a cloud not of upright walls alone"
