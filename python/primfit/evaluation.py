"""Detections against the truth: the paper's table, and what it leaves out."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from primfit._check import Floats, choice, instance, number
from primfit._tables import html_table
from primfit.geometry.footprints import symmetry_angle
from primfit.geometry.motions import Motion
from primfit.geometry.shapes import turn_between
from primfit.results import Detection
from primfit.solids.found import FoundSolid
from primfit.solids.polyhedron import Polyhedron
from primfit.solids.prism import Prism
from primfit.solids.round import Round
from primfit.solids.solid import Solid
from primfit.worlds.world import World

if TYPE_CHECKING:
    from pandas import DataFrame


_ROUNDS = 3
"""Times that solids are paired and laid on each other; the pairs hardly change after that."""


@dataclass(frozen=True, slots=True)
class Row:
    """One solid of the truth, and what was found of it.

    Attributes
    ----------
    truth : str
        Kind of the solid.
    found : str or None
        Kind that was found; None when it was missed.
    center_error_mm : float
        Distance of the centres; seen from above for upright prisms.
    angle_error_deg : float
        Difference of the angles on the circle, or for solids that are not upright prisms the angle
        of the turn between them, or between the axes of round ones; modulo the true symmetry of the
        solid. NaN for a circle or sphere, where only one is round, and where
        outlines with different numbers of corners, or faces that meet otherwise, have no angle in
        common.
    size_error_mm : float
        Largest difference of the sizes (of an upright cylinder the radius); NaN when the kinds
        differ.
    solid, detection : int
        Rows of `world.solids` and of `found.solids` (-1 for none).
    """

    truth: str
    found: str | None
    center_error_mm: float
    angle_error_deg: float
    size_error_mm: float
    solid: int
    detection: int


_HEAD = (
    "Ground Truth",
    "Detected",
    "Center Error (mm)",
    "Angle Error (deg)",
    "Size Error (mm)",
)


@dataclass(frozen=True, slots=True)
class Report:
    """How well a world was found.

    Attributes
    ----------
    rows : tuple of Row
        One a solid of the truth, in order.
    spurious : tuple of int
        Rows of `found.solids` that are no solid of the truth.
    n_planes, n_planes_true : int
        Upright planes found; walls of solids and arena.
    """

    rows: tuple[Row, ...]
    spurious: tuple[int, ...]
    n_planes: int
    n_planes_true: int

    @property
    def missed(self) -> tuple[int, ...]:
        """Rows of `world.solids` that were not found."""
        return tuple(row.solid for row in self.rows if row.found is None)

    @property
    def n_right(self) -> int:
        """How many solids were found with the right kind."""
        return sum(row.found == row.truth for row in self.rows)

    @property
    def all_right(self) -> bool:
        """Whether every solid was found with the right kind, and nothing else."""
        return self.n_right == len(self.rows) and not self.spurious

    def to_frame(self) -> DataFrame:
        """The rows as a pandas data frame.

        Raises
        ------
        ModuleNotFoundError
            When the extra ``tables`` is not installed.
        """
        try:
            import pandas as pd
        except ModuleNotFoundError:
            raise ModuleNotFoundError(
                "data frames need pandas: install it with pip install 'primfit[tables]'"
            ) from None

        return pd.DataFrame([asdict(row) for row in self.rows])

    def to_dict(self) -> dict[str, Any]:
        """The report as plain numbers, for JSON; NaN becomes None."""
        rows = [
            {key: None if value != value else value for key, value in asdict(row).items()}
            for row in self.rows
        ]
        return {
            "primfit": "report",
            "rows": rows,
            "missed": list(self.missed),
            "spurious": list(self.spurious),
            "n_planes": self.n_planes,
            "n_planes_true": self.n_planes_true,
        }

    def to_json(self) -> str:
        """The report as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False)

    def __repr__(self) -> str:
        return (
            f"Report({self.n_right} of {len(self.rows)} right, {len(self.missed)} missed, "
            f"{len(self.spurious)} spurious)"
        )

    def _table(self) -> list[tuple[str, ...]]:
        """The paper's table, with the size beside it: its head, then a row a solid."""
        table: list[tuple[str, ...]] = [_HEAD]
        for row in self.rows:
            errors = (row.center_error_mm, row.angle_error_deg, row.size_error_mm)
            shown = tuple("-" if np.isnan(error) else f"{error:.6f}" for error in errors)
            table.append((row.truth, row.found or "missed", *shown))
        return table

    @property
    def verdict(self) -> str:
        """How many are right, missed and spurious, in a line."""
        return (
            f"{self.n_right} of {len(self.rows)} right, {len(self.missed)} missed, "
            f"{len(self.spurious)} spurious; {self.n_planes} planes for {self.n_planes_true}"
        )

    def _repr_html_(self) -> str:
        head, *rows = self._table()
        return html_table(head, rows, self.verdict)

    def __str__(self) -> str:
        table, head = self._table(), _HEAD
        widths = [max(len(line[k]) for line in table) for k in range(len(head))]
        lines = [
            "  ".join(
                cell.ljust(width) if k < 2 else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in table
        ]
        lines.insert(1, "  ".join("-" * width for width in widths))
        lines.append(self.verdict)
        return "\n".join(lines)


def evaluate(
    found: Detection, world: World, *, max_distance: float = 0.1, frame: str = "world"
) -> Report:
    """How well the solids of a world were found.

    Solids are matched one to one, so that the sum of the distances between their centres, seen
    from above, is least; pairs farther apart than `max_distance` do not match.

    Parameters
    ----------
    found : Detection
    world : World
    max_distance : float, metres
    frame : "world" or "arena"
        Where poses were not exact, neither is where the map as a whole lies. "world" compares
        places as they are; "arena" first lays the found arena on the true one, corner by corner,
        or, where one of them is missing or has other corners, the found solids on the true ones.

    Returns
    -------
    Report

    Raises
    ------
    ValueError
        When `frame` is neither.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.random_world(1, 1.0, ["square"], rng=7)
    >>> scan = primfit.scan(world, primfit.grid_path(world, rng=7), rng=7)
    >>> primfit.evaluate(primfit.detect(scan, rng=7), world).all_right
    True
    """
    instance("found", found, Detection)
    instance("world", world, World)
    max_distance = number("max_distance", max_distance, above=0.0)
    choice("frame", frame, ["world", "arena"])
    if frame == "arena":
        found = _laid(found, _motion(found, world, max_distance))
    truth = np.array([solid.center[:2] for solid in world.solids]).reshape(-1, 2)
    centers = np.array([solid.center[:2] for solid in found.solids]).reshape(-1, 2)
    distance = np.linalg.norm(truth[:, None] - centers, axis=-1)
    far = 1e3 * (max_distance + distance.max(initial=0.0))
    pairs = linear_sum_assignment(np.where(distance <= max_distance, distance, far))
    match = {int(i): int(j) for i, j in zip(*pairs, strict=True) if distance[i, j] <= max_distance}
    rows = tuple(
        _compare(i, solid, match.get(i, -1), found) for i, solid in enumerate(world.solids)
    )
    spurious = tuple(j for j in range(len(found.solids)) if j not in match.values())
    n_walls = sum(_n_upright_faces(solid) for solid in world.solids)
    n_walls += 0 if world.arena is None else len(world.arena.outline)
    upright = sum(abs(plane.equation[2]) < 0.5 for plane in found.planes)
    return Report(rows, spurious, int(upright), n_walls)


def _motion(found: Detection, world: World, max_distance: float) -> Motion:
    """What lays the found arena on the true one, or the solids."""
    if found.arena is not None and world.arena is not None:
        corners, outline = found.arena.footprint, np.asarray(world.arena.outline)
        if len(corners) == len(outline):
            turns = [np.roll(corners, -k, axis=0) for k in range(len(corners))]
            # A square lies on itself in four ways: the one that moves its corners least.
            nearest = min(turns, key=lambda each: float(((each - outline) ** 2).sum()))
            return Motion.laying(nearest, outline)
    truth = np.array([solid.center[:2] for solid in world.solids]).reshape(-1, 2)
    centers = np.array([solid.center[:2] for solid in found.solids]).reshape(-1, 2)
    motion = Motion(0.0, np.zeros(2))
    for _ in range(_ROUNDS):
        off = np.linalg.norm(motion.of(centers)[:, None] - truth, axis=-1)
        rows, columns = linear_sum_assignment(np.minimum(off, max_distance))
        near = off[rows, columns] < max_distance
        if near.sum() < 2:
            break
        motion = Motion.laying(centers[rows[near]], truth[columns[near]])
    return motion


def _laid(found: Detection, motion: Motion) -> Detection:
    """The detection with its solids where a motion brings them."""
    return replace(found, solids=tuple(solid.laid(motion) for solid in found.solids))


def _n_upright_faces(solid: Solid) -> int:
    if isinstance(solid, Prism):
        return len(solid.footprint)
    return int((np.abs(solid.normals[:, 2]) < 0.5).sum())


def _compare(i: int, solid: Solid, j: int, found: Detection) -> Row:
    if j < 0:
        return Row(solid.kind, None, np.nan, np.nan, np.nan, i, j)
    other = found.solids[j]
    size_error = np.nan
    if other.kind == solid.kind:
        size_error = 1e3 * float(np.abs(np.subtract(other.size, solid.size)).max())
    difference = other.center - solid.center
    if solid.footprint is not None or np.isnan(difference[2]):
        difference = difference[:2]
    return Row(
        truth=solid.kind,
        found=other.kind,
        center_error_mm=1e3 * float(np.linalg.norm(difference)),
        angle_error_deg=float(np.degrees(_angle_error(solid, other))),
        size_error_mm=size_error,
        solid=i,
        detection=j,
    )


def _angle_error(solid: Solid, other: FoundSolid | Solid) -> float:
    """Difference of two angles modulo the symmetry of the true solid, radians.

    Without a kind in common the outlines themselves are laid over each other, and without an
    outline in common the faces.
    """
    if isinstance(solid, Round) and solid.footprint is None:
        return _angle_of_axes(solid, other)
    if solid.footprint is None or other.footprint is None:
        if not isinstance(solid, Polyhedron):
            solid = Polyhedron(solid.vertices, solid.faces)
        pose = solid.vertices, solid.faces, solid.symmetry
        return turn_between(*pose, other.vertices, other.faces)
    if "circle" in (solid.kind, other.kind):
        return np.nan
    period = symmetry_angle(solid.footprint)
    if other.kind == solid.kind and solid.kind != "polygon":
        turn = other.angle - solid.angle
    elif len(other.footprint) == len(solid.footprint):
        turn = _alignment(solid.footprint, other.footprint)
    else:
        return np.nan
    return float(abs((turn + period / 2) % period - period / 2))


def _angle_of_axes(solid: Round, other: FoundSolid | Solid) -> float:
    """Angle between the axes of two round solids, radians; NaN where one of them has none.

    A cone is told from one that points the other way, other solids are not.
    """
    what = other.solid if isinstance(other, FoundSolid) else other
    if not isinstance(what, Round) or solid.solid_kind == "sphere":
        return np.nan
    cosine, sine = np.dot(solid.axis, what.axis), np.linalg.norm(np.cross(solid.axis, what.axis))
    return float(np.arctan2(sine, cosine if solid.solid_kind == "cone" else abs(cosine)))


def _alignment(footprint: Floats, other: Floats) -> float:
    """Turn that lays one outline best onto another with as many corners, radians."""
    a, b = (outline - outline.mean(axis=0) for outline in (footprint, other))
    za, zb = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    products = [np.vdot(za, np.roll(zb, -shift)) for shift in range(len(za))]
    return float(np.angle(max(products, key=abs)))
