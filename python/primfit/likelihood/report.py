"""The scene as public results: solids, planes with the returns that they explain, the room."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.footprints import wrap
from primfit.geometry.outlines import free_polygon
from primfit.likelihood.fitting import Fit
from primfit.likelihood.footprint_models import Template
from primfit.likelihood.hypotheses import Candidate, Hypothesis
from primfit.likelihood.scene import Scene
from primfit.planes.plane import Plane, hull
from primfit.results import Contradiction, Detection, FoundArena
from primfit.solids.found import FoundSolid
from primfit.worlds.world import FLOOR

_SEEN = 3
"""Returns from which a face counts as seen."""

_SIGMAS = 3.0
"""Standard deviations within which a return is explained: all but 2.7 in 1000 are."""


def to_detection(
    scene: Scene,
    floor_sigma: float | None,
    sigma: float,
    contradictions: tuple[Contradiction, ...],
) -> Detection:
    """What was found, in public terms; `floor_sigma` is None where no floor was seen."""
    scan = scene.scan
    expected, parts, faces = scene.first_hits()
    hits = scan.is_return & scene.model.is_visible(expected)
    residual = np.full(len(scan), np.inf)
    residual[hits] = scan.ranges[hits] - expected[hits]
    # The room and the floor come after the solids, whose shapes are not exact.
    errors = np.array([*(solid.model_error for solid in scene.solids), 0.0])
    sigma_of = np.hypot(scene.model.sigma, errors[np.where(parts < 0, len(errors) - 1, parts)])
    explained = np.abs(residual) <= _SIGMAS * sigma_of
    at = scan.origins + np.where(hits, expected, 0.0)[:, None] * scan.directions

    planes: list[Plane] = []
    labels = np.full(len(scan), -1, dtype=np.int64)

    def add(rows: Ints, equation: Floats, covariance: Floats, boundary: Floats) -> int:
        """Number of a new plane."""
        labels[rows] = len(planes)
        planes.append(_plane(rows, equation, covariance, boundary, residual[rows]))
        return len(planes) - 1

    def add_walls(part: int, fit: Fit, side: float) -> list[int]:
        """Numbers of the walls that returns explain; a curve has none."""
        if fit.shape.is_round:
            return []
        numbers = []
        own = np.flatnonzero(explained & (parts == part))
        for face in range(len(fit.footprint)):
            rows = own[faces[own] == face]
            if len(rows) >= _SEEN:
                top = float(at[rows, 2].max())
                wall = _wall(fit, face, scene.floor_z, top, side)
                numbers.append(add(rows, *wall))
        return numbers

    def seen_faces(part: int, n_faces: int) -> tuple[Ints, tuple[bool, ...]]:
        """Returns on a part, and which of its faces have enough of them."""
        own = np.flatnonzero(hits & (parts == part))
        return own, tuple(bool(n >= _SEEN) for n in np.bincount(faces[own], minlength=n_faces))

    solids = []
    for part, solid in enumerate(scene.solids):
        mine = add_walls(part, solid.best.fit, 1.0)
        own, seen = seen_faces(part, len(solid.footprint) + 2)
        highest = float(at[own, 2].max(initial=scene.floor_z))
        solids.append(_solid(solid, scene.floor_z, floor_sigma, highest, tuple(mine), seen))
    arena = None
    if scene.room is not None:
        part, fit, top = len(scene.solids), scene.room.fit, scene.room.top
        arena = FoundArena(
            fit.footprint,
            tuple(add_walls(part, fit, -1.0)),
            observed=seen_faces(part, len(fit.footprint))[1],
            height=top.z - scene.floor_z if np.isfinite(top.sigma) else np.nan,
        )

    floor = None
    if floor_sigma is not None:
        rows = np.flatnonzero(explained & (parts == FLOOR))
        equation = np.array([0.0, 0.0, 1.0, -scene.floor_z])
        covariance = np.diag([0.0, 0.0, 0.0, floor_sigma**2])
        boundary = at[rows][hull(at[rows, :2])[0]]
        floor = _plane(rows, equation, covariance, boundary, residual[rows])
    return Detection(
        scan=scan,
        method="likelihood",
        planes=tuple(planes),
        labels=labels,
        solids=tuple(solids),
        arena=arena,
        floor=floor,
        sigma=sigma,
        settings={
            "outliers": scene.model.outliers,
            "dropouts": scene.model.dropouts,
            "min_range": scene.model.min_range,
            "max_range": scene.model.max_range,
            "min_range_is_known": scan.min_range is not None,
            "tolerance_share": scene.settings.tolerance_share,
        },
        contradictions=contradictions,
    )


def _plane(
    rows: Ints, equation: Floats, covariance: Floats, boundary: Floats, residual: Floats
) -> Plane:
    along = boundary - boundary.mean(axis=0)
    area = 0.5 * float(np.abs(np.cross(along, np.roll(along, -1, axis=0)).sum(axis=0)).max())
    return Plane(
        equation=equation,
        inliers=rows,
        boundary=boundary,
        area=area,
        rms=float(np.sqrt(np.mean(residual**2))),
        covariance=covariance,
    )


def _wall(
    fit: Fit, face: int, base: float, top: float, side: float
) -> tuple[Floats, Floats, Floats]:
    """Equation, covariance and corners of a wall; a side of -1 turns it to the inside."""
    m = len(fit.footprint)
    following = (face + 1) % m
    a, b = fit.footprint[face], fit.footprint[following]
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length
    normal = np.array([along[1], -along[0]])
    # The line turns as its ends move across it, and the normal with it.
    turn = np.zeros(2 * m)
    turn[2 * following : 2 * following + 2] -= normal / length
    turn[2 * face : 2 * face + 2] += normal / length
    change = np.zeros((4, 2 * m))
    change[:2] = np.outer(along, turn)
    change[3] = -a @ change[:2]
    change[3, 2 * face : 2 * face + 2] -= normal
    change = change @ fit.shape.frame(fit.parameters)[1]
    corners = np.array([[*a, base], [*b, base], [*b, top], [*a, top]])
    equation = side * np.array([*normal, 0.0, -normal @ a])
    return equation, change @ fit.covariance @ change.T, corners[:: int(side)].copy()


def _solid(
    solid: Hypothesis,
    base: float,
    floor_sigma: float | None,
    highest: float,
    planes: tuple[int, ...],
    seen: tuple[bool, ...],
) -> FoundSolid:
    best = solid.best
    footprint, angle, size, covariance = _measures(best)
    top_is_known = floor_sigma is not None and np.isfinite(best.top.sigma)
    m = len(footprint)
    return FoundSolid.upright(
        kind=best.fit.shape.kind,
        footprint=footprint,
        base=base,
        top=best.top.z if np.isfinite(best.top.sigma) else highest,
        angle=angle,
        size=size,
        covariance=covariance,
        planes=planes,
        observed=(*seen[:m], False, seen[m]),
        tolerance_sigma=solid.doubt * _leverage(m, best.fit.shape.n_parameters),
        height_sigma=float(np.hypot(best.top.sigma, floor_sigma or 0.0))
        if top_is_known
        else np.nan,
    )


def _leverage(n_corners: int, n_parameters: int) -> float:
    """How far the centre of a shape is off, where its walls are off by one after it was fitted.

    Corners that are off by c along x and y each take the walls off by c times the root of 2/3, of
    which the fit of some of the 2 m coordinates takes a part; the centre is off by c over the root
    of m.
    """
    left = max(1.0 - n_parameters / (2.0 * n_corners), 0.25)
    return float(np.sqrt(1.5 / left / n_corners))


def _measures(
    candidate: Candidate,
) -> tuple[Floats, float, float | tuple[float, float], Floats]:
    """Footprint, angle, size, and the covariance of centre, angle and size."""
    fit = candidate.fit
    if not isinstance(fit.shape, Template):
        _, corners = fit.shape.frame(fit.parameters)
        outline = free_polygon(fit.footprint, corners @ fit.covariance @ corners.T)
        return outline.footprint, outline.angle, outline.size, outline.covariance
    place, sizes = fit.shape.apart(fit.parameters)
    size = float(sizes[0]) if len(sizes) == 1 else (float(sizes[0]), float(sizes[1]))
    if not fit.shape.has_angle:
        # The angle of a circle is zero by definition.
        rest = np.insert(np.insert(fit.covariance, 2, 0.0, axis=0), 2, 0.0, axis=1)
        return fit.footprint, 0.0, size, rest
    return fit.footprint, wrap(float(place[2]), fit.shape.period), size, fit.covariance
