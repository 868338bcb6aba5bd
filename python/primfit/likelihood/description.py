"""The scene as public results: solids, planes with the returns that they explain, the room."""

from __future__ import annotations

import numpy as np

from primfit._check import Floats, Ints, frozen
from primfit.geometry.footprints import wrap
from primfit.likelihood.competition import Body, Contender
from primfit.likelihood.fitting import Fit
from primfit.likelihood.scene import Scene
from primfit.likelihood.templates import Template
from primfit.paper.classification import free_polygon
from primfit.planes.plane import Plane, hull
from primfit.planes.scan_planes import SIGMAS
from primfit.results import Detection, FoundArena, FoundSolid
from primfit.worlds.world import FLOOR

_SEEN = 3
"""Returns from which a face counts as seen."""


def describe(
    scene: Scene,
    bodies: list[Body],
    room: Fit | None,
    base_sigma: float | None,
    sigma: float,
) -> Detection:
    """What was found, in public terms; `base_sigma` is None where no floor was seen."""
    scan = scene.scan
    expected, parts, faces = scene.first_hits()
    hits = scan.is_return & (expected <= scene.noise.reach)
    residual = np.full(len(scan), np.inf)
    residual[hits] = scan.ranges[hits] - expected[hits]
    explained = np.abs(residual) <= SIGMAS * scene.noise.sigma
    at = scan.origins + np.where(hits, expected, 0.0)[:, None] * scan.directions

    planes: list[Plane] = []
    labels = np.full(len(scan), -1, dtype=np.int64)

    def add(rows: Ints, equation: Floats, covariance: Floats, boundary: Floats) -> int:
        """Number of a new plane."""
        labels[rows] = len(planes)
        planes.append(_plane(rows, equation, covariance, boundary, residual[rows]))
        return len(planes) - 1

    def add_walls(part: int, fit: Fit, side: float) -> list[int]:
        """Numbers of the walls that returns explain."""
        numbers = []
        own = np.flatnonzero(explained & (parts == part))
        for face in range(len(fit.footprint)):
            rows = own[faces[own] == face]
            if len(rows) >= _SEEN:
                top = float(at[rows, 2].max())
                wall = _wall(fit, face, scene.base, top, side)
                numbers.append(add(rows, *wall))
        return numbers

    solids = []
    for part, body in enumerate(bodies):
        mine = add_walls(part, body.contenders[0].fit, 1.0)
        m = len(body.footprint)
        own = np.flatnonzero(hits & (parts == part))
        seen = tuple(bool(n >= _SEEN) for n in np.bincount(faces[own], minlength=m + 2))
        highest = float(at[own, 2].max(initial=scene.base))
        solids.append(_solid(body, scene.base, base_sigma, highest, tuple(mine), seen))
    arena = None
    if room is not None:
        arena = FoundArena(room.footprint, tuple(add_walls(len(bodies), room, -1.0)))

    floor = None
    if base_sigma is not None:
        rows = np.flatnonzero(explained & (parts == FLOOR))
        equation = np.array([0.0, 0.0, 1.0, -scene.base])
        covariance = np.diag([0.0, 0.0, 0.0, base_sigma**2])
        boundary = at[rows][hull(at[rows, :2])[0]]
        floor = _plane(rows, equation, covariance, boundary, residual[rows])
    return Detection(
        scan=scan,
        method="likelihood",
        planes=tuple(planes),
        labels=frozen(labels),
        solids=tuple(solids),
        arena=arena,
        floor=floor,
        sigma=sigma,
        settings={
            "outliers": scene.noise.outliers,
            "lost": scene.noise.lost,
            "reach": scene.noise.reach,
        },
    )


def _plane(
    rows: Ints, equation: Floats, covariance: Floats, boundary: Floats, residual: Floats
) -> Plane:
    along = boundary - boundary.mean(axis=0)
    area = 0.5 * float(np.abs(np.cross(along, np.roll(along, -1, axis=0)).sum(axis=0)).max())
    return Plane(
        equation=frozen(equation),
        inliers=frozen(rows),
        boundary=frozen(boundary),
        area=area,
        rms=float(np.sqrt(np.mean(residual**2))),
        covariance=frozen(covariance),
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
    body: Body,
    base: float,
    base_sigma: float | None,
    highest: float,
    planes: tuple[int, ...],
    seen: tuple[bool, ...],
) -> FoundSolid:
    best = body.contenders[0]
    footprint, angle, size, covariance = _measures(best)
    top_is_known = base_sigma is not None and np.isfinite(body.top.sigma)
    m = len(footprint)
    return FoundSolid(
        kind=best.fit.shape.kind,
        footprint=footprint,
        base=base,
        top=body.top.z if np.isfinite(body.top.sigma) else highest,
        angle=angle,
        size=size,
        covariance=covariance,
        planes=planes,
        observed=(*seen[:m], False, seen[m]),
        height_sigma=float(np.hypot(body.top.sigma, base_sigma or 0.0)) if top_is_known else np.nan,
    )


def _measures(
    contender: Contender,
) -> tuple[Floats, float, float | tuple[float, float], Floats]:
    """Footprint, angle, size, and the covariance of centre, angle and size."""
    fit = contender.fit
    if not isinstance(fit.shape, Template):
        _, corners = fit.shape.frame(fit.parameters)
        outline = free_polygon(fit.footprint, corners @ fit.covariance @ corners.T)
        return outline.footprint, outline.angle, outline.size, outline.covariance
    sizes = tuple(float(size) for size in fit.parameters[3:])
    angle = wrap(float(fit.parameters[2]), fit.shape.period)
    size = sizes[0] if len(sizes) == 1 else (sizes[0], sizes[1])
    return fit.footprint, angle, size, fit.covariance
