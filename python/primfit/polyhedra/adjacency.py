"""Which bounded planes meet, and along which stretches of their outlines."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely

from primfit._check import Floats
from primfit.planes.plane import Plane

OPEN = -1
"""Neighbour of a side at which no plane was found."""


_STEPS = 2
"""Samples to either side between which the direction of an outline is taken."""

_ASIDE = 2.0
"""How far from an edge the outline seems to be that runs across it, in reaches."""


@dataclass(eq=False)
class Side:
    """A stretch of a face's outline along which it meets one neighbour.

    Attributes
    ----------
    neighbor : int
        Plane, or `OPEN`.
    samples : (k, 3) float64
        Points of the outline there, in its direction.
    """

    neighbor: int
    samples: Floats

    @property
    def along(self) -> Floats:
        """From its first sample to the last (3,), metres."""
        return self.samples[-1] - self.samples[0]

    @property
    def length(self) -> float:
        """Of `along`, metres."""
        return float(np.linalg.norm(self.along))


@dataclass(eq=False)
class Face:
    """A bounded plane: equation, points, outline in its plane, and what it meets around it."""

    equation: Floats
    points: Floats
    boundary: Floats
    axes: Floats
    polygon: shapely.Polygon
    spacing: float
    rms: float
    sides: list[Side] = field(default_factory=list)

    @classmethod
    def of(cls, plane: Plane, points: Floats) -> Face:
        """A plane, with its points of a cloud (n, 3)."""
        own = points[plane.inliers]
        normal = plane.equation[:3]
        x = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(normal, x)], axis=1)
        boundary = plane.boundary
        residuals = own @ normal + plane.equation[3]
        return cls(
            equation=plane.equation,
            points=own,
            boundary=boundary,
            axes=axes,
            polygon=shapely.Polygon(boundary @ axes if plane.area > 0.0 else None),
            spacing=float(np.sqrt(plane.area / max(len(own), 1))),
            rms=float(np.sqrt((residuals**2).mean())) if len(own) else 0.0,
        )

    @property
    def reach(self) -> float:
        """How far from an edge the outline may end, metres."""
        return 3.0 * self.spacing + 3.0 * self.rms

    @cached_property
    def width(self) -> float:
        """Of the outline, where it is slimmest, metres."""
        if self.polygon.is_empty:
            return 0.0
        box = shapely.get_coordinates(self.polygon.minimum_rotated_rectangle)
        return float(np.linalg.norm(np.diff(box[:3], axis=0), axis=1).min())


def meet(faces: list[Face]) -> list[tuple[int, int]]:
    """Pairs of faces that name each other along their outlines, rising; sets `Face.sides`."""
    for i, face in enumerate(faces):
        face.sides = _sides(i, faces)
    lengths = {
        (i, side.neighbor): side.length for i, face in enumerate(faces) for side in face.sides
    }
    clear = {pair for pair, length in lengths.items() if length >= 1.5 * faces[pair[0]].reach}
    for i, face in enumerate(faces):
        face.sides = _joined(
            [side for side in face.sides if _is_clear(i, side, face.reach, lengths, clear)]
        )
    return [
        (i, side.neighbor)
        for i, face in enumerate(faces)
        for side in face.sides
        if i < side.neighbor and any(other.neighbor == i for other in faces[side.neighbor].sides)
    ]


def _sides(i: int, faces: list[Face]) -> list[Side]:
    """The neighbours around a face, in the direction of its boundary."""
    face = faces[i]
    if face.polygon.is_empty:
        return []
    ring = np.vstack([face.boundary, face.boundary[:1]])
    steps = np.maximum(1, np.ceil(np.linalg.norm(np.diff(ring, axis=0), axis=1) / face.spacing))
    samples = np.concatenate(
        [
            a + (b - a) * np.arange(int(n))[:, None] / n
            for a, b, n in zip(ring[:-1], ring[1:], steps, strict=True)
        ]
    )
    along = np.roll(samples, -_STEPS, axis=0) - np.roll(samples, _STEPS, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
    nearest = np.full(len(samples), OPEN)
    least = np.full(len(samples), np.inf)
    for j, other in enumerate(faces):
        edge = np.cross(face.equation[:3], other.equation[:3])
        sine = float(np.linalg.norm(edge))
        reach = max(face.reach, other.reach)
        # What is slimmer than edges are told apart does not tell which of its sides meets what.
        if j == i or sine < 0.1 or min(face.width, other.width) < reach:
            continue
        off = np.abs(samples @ other.equation[:3] + other.equation[3]) / sine
        off += _ASIDE * reach * (1.0 - np.abs(along @ edge) / sine)
        near = np.flatnonzero((off <= reach) & (off < least))
        outline = shapely.distance(other.polygon, shapely.points(samples[near] @ other.axes))
        near = near[outline <= reach]
        nearest[near], least[near] = j, off[near]
    starts = np.flatnonzero(nearest != np.roll(nearest, 1))
    if not len(starts):
        return [Side(int(nearest[0]), samples)]
    samples, nearest = np.roll(samples, -starts[0], axis=0), np.roll(nearest, -starts[0])
    pieces = np.split(np.arange(len(samples)), starts[1:] - starts[0])
    sides = [Side(int(nearest[piece[0]]), samples[piece]) for piece in pieces]
    return _joined([side for side in sides if side.length >= 0.5 * face.reach])


def _is_clear(
    i: int,
    side: Side,
    reach: float,
    lengths: dict[tuple[int, int], float],
    clear: set[tuple[int, int]],
) -> bool:
    """Whether a side is no chance meeting near a corner.

    Neighbours that name each other may be short on one of the two, which may have few points; one
    that does not must be long. Where nothing is near, the corners have already been left out.
    """
    if side.neighbor == OPEN:
        return True
    if (side.neighbor, i) not in lengths:
        return side.length >= 2.0 * reach
    return (i, side.neighbor) in clear or (side.neighbor, i) in clear


def _joined(sides: list[Side]) -> list[Side]:
    """Sides around a face, with those one that follow each other along one neighbour.

    Where nothing is near between two such stretches, the outline has a bay.
    """
    bays = [
        side.neighbor == OPEN and sides[k - 1].neighbor == sides[(k + 1) % len(sides)].neighbor
        for k, side in enumerate(sides)
    ]
    joined: list[Side] = []
    for side in (side for side, is_bay in zip(sides, bays, strict=True) if not is_bay):
        if joined and joined[-1].neighbor == side.neighbor:
            joined[-1] = Side(side.neighbor, np.vstack([joined[-1].samples, side.samples]))
        else:
            joined.append(side)
    if len(joined) > 1 and joined[0].neighbor == joined[-1].neighbor:
        last = joined.pop()
        joined[0] = Side(last.neighbor, np.vstack([last.samples, joined[0].samples]))
    return joined
