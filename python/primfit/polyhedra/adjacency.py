"""Which bounded planes meet, and along which stretches of their outlines."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely

from primfit._check import Floats, Ints
from primfit.geometry.products import dots, lengths_of, product
from primfit.planes.outlines import Outlines
from primfit.planes.plane import Plane

OPEN = -1
"""Neighbour of a side at which no plane was found."""

_LEAST_SINE = 0.1
"""Of the angle between faces that meet in an edge: with less, noise moves the edge by reaches."""

_STEPS = 2
"""Samples to either side between which the direction of an outline is taken."""

_ASIDE = 2.0
"""How far from an edge the outline seems to be that runs across it, in reaches."""


_SLIMMEST = 2.0 / 3.0
"""Width of a face whose two sides are told apart, in reaches: a spacing and noise for each."""

_EDGE = 4.0
"""Standard deviations from the plane of a neighbour within which a point may be its own."""


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
        return float(lengths_of(self.along))


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
        x /= lengths_of(x)
        axes = np.stack([x, np.cross(normal, x)], axis=1)
        boundary = plane.boundary
        residuals = dots(own, normal) + plane.equation[3]
        return cls(
            equation=plane.equation,
            points=own,
            boundary=boundary,
            axes=axes,
            polygon=shapely.Polygon(product(boundary, axes) if plane.area > 0.0 else None),
            spacing=float(np.sqrt(plane.area / max(len(own), 1))),
            rms=float(np.sqrt((residuals**2).mean())) if len(own) else 0.0,
        )

    @classmethod
    def through(cls, equation: Floats, points: Floats) -> Face:
        """A plane with its points (n, 3), and their outline."""
        rows = np.arange(len(points))
        outline = Outlines().of(equation, np.ascontiguousarray(points), rows)
        nothing = np.full((4, 4), np.nan)
        plane = Plane(equation, rows, outline.boundary, outline.area, 0.0, nothing)
        return cls.of(plane, points)

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
        return float(lengths_of(np.diff(box[:3], axis=0)).min())


def clear_of(points: Floats, equations: Floats, rms: Floats, edge: float = _EDGE) -> Floats:
    """The points of a plane away from its neighbours, or all where more than half are near one.

    Near an edge, neighbours take those on one side of it: within `edge` of their deviations.
    """
    off = np.abs(product(points, equations[:, :3].T) + equations[:, 3])
    clear = points[(off > edge * rms).all(axis=1)]
    return clear if 2 * len(clear) > len(points) else points


def meet(faces: list[Face]) -> list[tuple[int, int]]:
    """Pairs of faces that name each other along their outlines, rising; sets `Face.sides`."""
    near = _near(faces)
    for i, face in enumerate(faces):
        face.sides = _sides(i, faces, near[i])
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


def _near(faces: list[Face]) -> list[Ints]:
    """The faces that each may meet: across it, wide enough, and no farther away than it reaches."""
    if not faces:
        return []
    normals = np.stack([face.equation[:3] for face in faces])
    reach = np.array([face.reach for face in faces])
    width = np.array([face.width for face in faces])
    is_face = np.array([not face.polygon.is_empty for face in faces])
    nowhere = np.full((1, 3), np.nan)
    rings = [face.boundary if is_face[i] else nowhere for i, face in enumerate(faces)]
    low, high = (np.stack([f(ring, axis=0) for ring in rings]) for f in (np.min, np.max))
    near = []
    for i in range(len(faces)):
        most = np.maximum(reach[i], reach)
        # What is slimmer than edges are told apart does not tell which of its sides meets what: an
        # outline ends within a third of its reach from the edge, at the one side and at the other.
        may_meet = (lengths_of(np.cross(normals[i], normals)) >= _LEAST_SINE) & is_face
        may_meet &= is_face[i] & (np.minimum(width[i], width) >= _SLIMMEST * most)
        # As far as two reaches at right angles, and no less for rounding.
        slack = 1.5 * most[:, None]
        may_meet &= ((low[i] <= high + slack) & (high[i] >= low - slack)).all(axis=1)
        may_meet[i] = False
        near.append(np.flatnonzero(may_meet))
    return near


def _sides(i: int, faces: list[Face], near: Ints) -> list[Side]:
    """The neighbours around a face, of those near it, in the direction of its boundary."""
    face = faces[i]
    if face.polygon.is_empty:
        return []
    samples = _sampled(face.boundary, face.spacing)
    nearest = _nearest(samples, face, [faces[j] for j in near])
    nearest = np.append(near, OPEN)[nearest]
    starts = np.flatnonzero(nearest != np.roll(nearest, 1))
    if not len(starts):
        return [Side(int(nearest[0]), samples)]
    samples, nearest = np.roll(samples, -starts[0], axis=0), np.roll(nearest, -starts[0])
    pieces = np.split(np.arange(len(samples)), starts[1:] - starts[0])
    sides = [Side(int(nearest[piece[0]]), samples[piece]) for piece in pieces]
    return _joined([side for side in sides if side.length >= 0.5 * face.reach])


def _sampled(boundary: Floats, spacing: float) -> Floats:
    """Points along an outline, its corners among them, no farther apart than that."""
    steps = np.roll(boundary, -1, axis=0) - boundary
    n = np.maximum(1, np.ceil(lengths_of(steps) / spacing)).astype(np.int64)
    k = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    samples: Floats = (
        boundary.repeat(n, axis=0) + steps.repeat(n, axis=0) * k[:, None] / (n.repeat(n)[:, None])
    )
    return samples


def _nearest(samples: Floats, face: Face, others: list[Face]) -> Ints:
    """Which of the other faces each sample of a face's outline meets, the last number for none."""
    nearest = np.full(len(samples), len(others))
    if not others:
        return nearest
    along = np.roll(samples, -_STEPS, axis=0) - np.roll(samples, _STEPS, axis=0)
    along /= np.maximum(lengths_of(along)[:, None], np.finfo(float).tiny)
    equations = np.stack([other.equation for other in others])
    edges = np.cross(face.equation[:3], equations[:, :3])
    sine = lengths_of(edges)
    reach = np.array([max(face.reach, other.reach) for other in others])
    off = np.abs(product(samples, equations[:, :3].T) + equations[:, 3]) / sine
    off += _ASIDE * reach * (1.0 - np.abs(product(along, edges.T)) / sine)
    row, column = np.nonzero(off <= reach)
    # The nearest first, of two the one that comes first: the first whose outline reaches there.
    order = np.lexsort((column, off[row, column], row))
    row, column = row[order], column[order]
    while len(row):
        first = np.flatnonzero(np.diff(row, prepend=-1))
        i, j = row[first], column[first]
        meets = np.zeros(len(first), dtype=bool)
        for k in np.unique(j):
            own = j == k
            flat = shapely.points(product(samples[i[own]], others[k].axes))
            meets[own] = shapely.distance(others[k].polygon, flat) <= reach[k]
        nearest[i[meets]] = j[meets]
        rest = np.ones(len(row), dtype=bool)
        rest[first] = False
        rest &= nearest[row] == len(others)
        row, column = row[rest], column[rest]
    return nearest


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
