"""The paper's method: Algorithms 3, 4 and 5 and the classification, to be read beside it.

RANSAC-Based Plane Detection: Improving Precision in 3D Mapping. Where the paper is open or does
not work, a repair is the default and its own rule an option of `PaperSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import shapely

from primfit._check import generator, instance, integer, n_jobs_or_none, number
from primfit.geometry.footprints import signed_area
from primfit.geometry.outlines import Outline
from primfit.paper.classification import classify, classify_by_sides
from primfit.paper.topology import (
    Wall,
    chain_walls,
    intersect_pairs,
    refine,
    simple_cycles,
    walls_of,
)
from primfit.planes.peeling import Patch, Peeling
from primfit.planes.ransac import NoisyPoints, Orientation
from primfit.planes.scan_planes import (
    Progress,
    bounded,
    check_enough,
    find_floor,
    noisy_points,
    peel_with_progress,
)
from primfit.results import Detection, FoundArena
from primfit.scans.columns import as_sigma
from primfit.scans.scan import Scan
from primfit.solids.found import FoundSolid


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """How the paper's method runs; lengths in metres.

    The defaults are the repairs; `literal` gives the paper's own rules, and each of them can be
    changed alone, to measure what it buys.

    Attributes
    ----------
    threshold : float or None
        Greatest distance of an inlier. None: three standard deviations of the noise.
    eps : float or None
        Of DBSCAN; the paper has 0.1. None: the spacing of the points that are left.
    min_points : int
        Least inliers of a plane.
    max_trials : int
        Most hypotheses for one plane.
    local : bool
        Draw the points of a hypothesis near each other; the paper draws from the whole cloud.
    along_beams : bool
        Measure distances along the beams and ask for the seen side; the paper measures
        perpendicularly.
    msac : bool
        Score hypotheses by MSAC; the paper counts.
    refit : bool
        Fit planes to their inliers; the paper keeps the sample.
    compete : bool
        Let planes compete for points, and drop needless ones; the paper keeps what comes first.
    chain : bool
        Follow each wall to the next one; the paper intersects all pairs of infinite planes.
    close : float or None
        Greatest distance of a corner to its walls. None: twice `eps` and the limit.
    model_selection : bool
        Choose the kind by the information criterion; the paper compares sides.
    side_tolerance : float
        Relative difference of sides that the paper's rule takes as equal; it gives none.
    find_floor : bool
        Find the floor and leave it out; the paper filters by z.
    z_low : float
        Where the floor is not found, points below it are left out.
    """

    threshold: float | None = None
    eps: float | None = None
    min_points: int = 10
    max_trials: int = 256
    local: bool = True
    along_beams: bool = True
    msac: bool = True
    refit: bool = True
    compete: bool = True
    chain: bool = True
    close: float | None = None
    model_selection: bool = True
    side_tolerance: float = 0.2
    find_floor: bool = True
    z_low: float = -np.inf

    def __post_init__(self) -> None:
        for name in ("threshold", "eps", "close"):
            value = getattr(self, name)
            if value is not None:
                number(name, value, above=0.0)
        integer("min_points", self.min_points, low=3)
        integer("max_trials", self.max_trials, low=1)
        number("side_tolerance", self.side_tolerance, low=0.0)
        if not (isinstance(self.z_low, float) and self.z_low == -np.inf):
            number("z_low", self.z_low)
        for field in fields(self):
            if isinstance(field.default, bool):
                instance(field.name, getattr(self, field.name), bool)

    @classmethod
    def literal(cls, **changes: Any) -> PaperSettings:
        """The paper's own rules.

        What it leaves open is as in the Python RANSAC that its Algorithm 4 resembles (1000 trials,
        100 points), with a threshold of 3 mm, at which it works best without noise.
        """
        rules = cls(
            threshold=0.003,
            eps=0.1,
            min_points=100,
            max_trials=1000,
            local=False,
            along_beams=False,
            msac=False,
            refit=False,
            compete=False,
            chain=False,
            close=0.03,
            model_selection=False,
            find_floor=False,
            z_low=0.02,
        )
        return replace(rules, **changes)


def detect_paper(
    scan: Scan,
    rng: Any = None,
    *,
    orientation: Any = "vertical",
    max_angle: float | None = None,
    sigma: Any = None,
    settings: PaperSettings | None = None,
    n_jobs: int | None = None,
    progress: Progress = False,
) -> Detection:
    """Planes and solids by the paper's method.

    Parameters
    ----------
    scan : Scan
    rng : None, int or numpy.random.Generator
    orientation : str or (3,)
        "vertical", "horizontal", "any", or the axis of the normal. Solids are upright prisms,
        from vertical planes.
    max_angle : float or None, radians
        How far a normal may be off the orientation.
    sigma : float, (n,) or None, metres
        Noise; None takes the scan's, or else is estimated.
    settings : PaperSettings or None
        None for the repaired method.
    n_jobs : int or None
        Threads; None for all.
    progress : bool or callable

    Returns
    -------
    Detection

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> scan = primfit.scan(world, primfit.grid_path(world, rng=7), rng=7)
    >>> literal = primfit.PaperSettings.literal(threshold=0.02)
    >>> len(primfit.detect(scan, method="paper", settings=literal, rng=7).planes) >= 4
    True
    """
    how = PaperSettings() if settings is None else settings
    instance("settings", how, PaperSettings)
    wanted = Orientation.of(orientation, max_angle)
    rng = generator(rng)
    rows = np.flatnonzero(scan.is_return & ~(scan.points[:, 2] < how.z_low))
    check_enough(len(rows))
    cloud, used_sigma = noisy_points(
        scan,
        rows,
        scan.sigma if sigma is None else as_sigma(sigma, len(scan)),
        rng,
        threshold=how.threshold,
        along_beams=how.along_beams,
    )
    peeling = Peeling(
        orientation=wanted,
        eps=how.eps,
        min_points=how.min_points,
        max_trials=how.max_trials,
        local=how.local,
        msac=how.msac,
        refit=how.refit,
        compete=how.compete,
    )

    # The z filter.
    floor = find_floor(cloud, rows, rng) if how.find_floor and wanted.is_upright else None
    if floor is not None:
        above = ~np.isin(rows, floor.inliers)
        rows, cloud = rows[above], cloud.take(np.flatnonzero(above))

    # Planes: RANSAC and DBSCAN, one after the other (Algorithm 3, lines 1 to 9, and 4).
    seen = scan if how.along_beams and scan.has_origins else None
    patches, eps = peel_with_progress(cloud, peeling, rng, seen, n_jobs_or_none(n_jobs), progress)

    # Corners and cycles (Algorithm 3, lines 10 to 22, and 5); kind, centre and angle.
    limit = cloud.typical_limit
    close = 2.0 * eps + limit if how.close is None else how.close
    base = None if floor is None else -float(floor.equation[3] / floor.equation[2])
    solids: list[FoundSolid] = []
    arena = None
    if wanted.is_upright:
        walls = walls_of(patches, cloud, seen)
        find_solids = _solids_by_chains if how.chain else _solids_by_pairs
        solids, arena = find_solids(walls, patches, cloud, base, close, how, wanted)

    planes, labels = bounded(patches, cloud, rows, len(scan))
    return Detection(
        scan=scan,
        method="paper",
        planes=planes,
        labels=labels,
        solids=tuple(solids),
        arena=arena,
        floor=floor,
        sigma=used_sigma,
        settings={
            "threshold": limit,
            "eps": eps,
            "close": close,
            "min_points": how.min_points,
            "max_trials": how.max_trials,
        },
    )


def _solids_by_chains(
    walls: list[Wall],
    patches: list[Patch],
    cloud: NoisyPoints,
    base: float | None,
    close: float,
    how: PaperSettings,
    wanted: Orientation,
) -> tuple[list[FoundSolid], FoundArena | None]:
    """The repaired way: each wall is followed to the next one. Refines the patches in place."""
    solids, arenas = [], []
    for cycle in chain_walls(walls, close):
        if how.refit:
            cycle = refine(cycle, cloud, wanted)
        for wall in cycle.walls:
            patches[wall.plane] = wall.patch
        numbers = tuple(wall.plane for wall in cycle.walls)
        if not cycle.is_solid:
            arenas.append(FoundArena(cycle.vertices[::-1], numbers))
            continue
        if how.model_selection and how.refit:
            # Without beams a point near a corner may be of either wall.
            slack = 0.1 * cloud.typical_limit if cloud.directions is None else 0.0
            outline = classify(cycle, slack)
        else:
            outline = classify_by_sides(cycle.vertices, how.side_tolerance)
        solids.append(_solid(outline, numbers, cloud, cycle.walls, base))
    if arenas:
        return solids, max(arenas, key=lambda arena: abs(signed_area(arena.footprint)))
    return _part_enclosing(solids, cloud, close)


def _solids_by_pairs(
    walls: list[Wall],
    patches: list[Patch],
    cloud: NoisyPoints,
    base: float | None,
    close: float,
    how: PaperSettings,
    _: Orientation,
) -> tuple[list[FoundSolid], FoundArena | None]:
    """The paper's way: all pairs of planes, all simple cycles."""
    outlines = simple_cycles(intersect_pairs(cloud, patches, walls, close))
    solids = [
        _solid(classify_by_sides(outline, how.side_tolerance), (), cloud, (), base)
        for outline in outlines
    ]
    return _part_enclosing(solids, cloud, close)


def _solid(
    outline: Outline,
    planes: tuple[int, ...],
    cloud: NoisyPoints,
    walls: tuple[Wall, ...],
    base: float | None,
) -> FoundSolid:
    """An outline as a solid; its height is between the highest hit and the lowest beam over it."""
    z = cloud.points[:, 2]
    bottom = float(z.min()) if base is None else base
    highest = max((wall.top for wall in walls), default=float(z.max()))
    cleared = min((wall.cleared for wall in walls), default=np.inf)
    is_known = base is not None and np.isfinite(cleared)
    top = (highest + cleared) / 2 if is_known else highest
    at_top = cloud.points[np.abs(z - top) <= cloud.limit, :2]
    sees_top = int(shapely.contains_xy(shapely.Polygon(outline.footprint), at_top).sum()) >= 3
    return FoundSolid.upright(
        kind=outline.kind,
        footprint=outline.footprint,
        base=bottom,
        top=top,
        angle=outline.angle,
        size=outline.size,
        covariance=outline.covariance,
        planes=planes,
        observed=(True,) * len(outline.footprint) + (False, sees_top),
        height_sigma=float(abs(cleared - highest) / np.sqrt(12.0)) if is_known else np.nan,
    )


def _part_enclosing(
    solids: list[FoundSolid], cloud: NoisyPoints, close: float
) -> tuple[list[FoundSolid], FoundArena | None]:
    """Where the seen sides are not known, the outline with the other points inside is the arena."""
    if not solids:
        return solids, None
    outer = max(solids, key=lambda solid: solid.solid.shadow.area)
    interior = outer.solid.shadow.buffer(-close)
    if shapely.contains_xy(interior, cloud.points[:, :2]).mean() < 0.01:
        return solids, None
    others = [solid for solid in solids if solid is not outer]
    return others, FoundArena(shapely.get_coordinates(outer.solid.shadow)[:-1], outer.planes)
