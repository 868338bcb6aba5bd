"""What a polyhedron is called, and how it is turned: kind, size, orientation, symmetry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from primfit._check import Floats, Ints
from primfit.geometry import footprints
from primfit.geometry.footprints import TOLERANCE
from primfit.geometry.motions import Motion, turned
from primfit.geometry.products import lengths_of, product
from primfit.geometry.shells import Faces, Shell, area_vectors


@dataclass(frozen=True, eq=False)
class Shape:
    """What a solid is.

    Attributes
    ----------
    kind : str
        "box", "cube", "wedge", "pyramid", "frustum", "prism", "polyhedron"; for an upright prism
        the name of its footprint.
    footprint : (m, 2) float64 or None, metres
        Of an upright prism.
    angle : float, radians
        Yaw of the footprint; NaN without one.
    size : float or (2,) or (3,), metres
    solid_kind : str
        As `kind`, but the same at any tilt; a right prism over a circle is a "cylinder".
    dimensions : (3,), metres
        Length, width and height along the own axes.
    rotations : (s, 3, 3) float64
        Turns of the solid's own frame that look alike, the smallest first; their number is the
        order of its symmetry. Of a solid that tells its frame itself there may be none.
    """

    kind: str
    footprint: Floats | None
    angle: float
    size: float | tuple[float, ...]
    solid_kind: str
    dimensions: tuple[float, float, float]
    rotations: Floats

    def laid(self, motion: Motion) -> Shape:
        """What it is after a motion about the vertical."""
        footprint, rotations = self.footprint, self.rotations.copy()
        for axes in rotations:
            axes[:2] = turned(axes[:2].T, motion.turn).T
        return replace(
            self,
            footprint=None if footprint is None else motion.of(footprint),
            angle=self.angle + motion.turn,
            rotations=rotations,
        )


def shape_of(vertices: Floats, faces: Faces, tolerance: float = TOLERANCE) -> Shape:
    """Kind, size and orientation of a closed surface, oriented outwards and without flat edges.

    Lengths that differ by less than `tolerance` of the size are equal, and angles by less than
    `tolerance` radians.

    The own frame has its z axis from the base into the solid, and its x axis along a side of the
    base. The base is that of a pyramid, frustum or prism, and the largest face of others; the side
    is that along which the rectangle around the base has the least perimeter, the longest of
    those. Among equals the vertices decide that come last in dictionary order, as the frame sees
    them on a walk from that side.
    """
    center = vertices.mean(axis=0)
    vertices = vertices - center
    scale = float(np.abs(vertices).max())
    solid_kind, bases, footprint = _kind(vertices, faces, scale, tolerance)
    kind = solid_kind if solid_kind != "cylinder" else "prism"
    if footprint is not None:
        kind = footprints.kind_of(footprint, tolerance)
    shell = Shell.of(faces)
    flags, frames = _candidates(vertices, faces, shell, bases, scale * tolerance)
    walks = [shell.walk(int(flag)) for flag in flags]
    words = [
        np.append(pattern.ravel(), (product(vertices[shell.start[order]], frame) / scale).ravel())
        for (order, pattern), frame in zip(walks, frames, strict=True)
    ]
    last = words[0]
    for word in words:
        different = np.flatnonzero(np.abs(word - last) > tolerance)
        if len(different) and word[different[0]] > last[different[0]]:
            last = word
    rotations = frames[[np.abs(word - last).max() <= tolerance for word in words]]
    turns = np.rint(Rotation.from_matrix(rotations).magnitude() / tolerance)
    rotations = rotations[np.argsort(turns, kind="stable")]
    own = product(vertices, rotations[0])
    is_box = kind in ("box", "cube")
    # Half of the vertices of a box are on either side: their mean is less noisy than the extremes.
    extents = np.sort(2.0 * np.abs(own).mean(axis=0) if is_box else np.ptp(own, axis=0))[::-1]
    if footprint is not None:
        footprint = footprint + center[:2]
        size: float | tuple[float, ...] = footprints.size_of(footprint, kind)
    elif kind == "cube":
        size = float(extents.mean())
    else:
        size = tuple(extents.tolist())
    if solid_kind == "cylinder":
        base = product(vertices[faces[bases[0]]], rotations[0])[:, :2]
        length = width = 2.0 * float(footprints.size_of(base, "circle"))  # type: ignore[arg-type]
        dimensions = (length, width, float(np.ptp(own[:, 2])))
    else:
        dimensions = dimensions_of(own, solid_kind)
    angle = np.nan if footprint is None else footprints.angle_of(footprint, kind, tolerance)
    return Shape(kind, footprint, angle, size, solid_kind, dimensions, rotations)


def upright_shape(
    kind: str, footprint: Floats, angle: float, size: float | tuple[float, float], height: float
) -> Shape:
    """The shape of an upright prism of which kind, angle and size are known; the height may be NaN.

    The prism tells its own frame.
    """
    solid_kind = upright_name(kind, len(footprint), size, height)
    dimensions = upright_dimensions(kind, footprint, size, height)
    return Shape(kind, footprint, angle, size, solid_kind, dimensions, np.empty((0, 3, 3)))


def upright_name(
    kind: str, n_corners: int, size: float | tuple[float, float], height: float
) -> str:
    """Name at any tilt of an upright prism over a footprint of this kind."""
    if kind == "square":
        return "cube" if abs(height - np.max(size)) <= TOLERANCE * height else "box"
    if n_corners == 3:
        return "wedge"
    return {"rectangle": "box", "circle": "cylinder"}.get(kind, "prism")


def upright_dimensions(
    kind: str, footprint: Floats, size: float | tuple[float, float], height: float
) -> tuple[float, float, float]:
    """Length, width and height along the own axes of an upright prism, metres."""
    if kind == "circle":
        diameter = 2.0 * float(np.max(size))
        return diameter, diameter, height
    if kind in ("square", "rectangle"):
        sides = np.broadcast_to(size, 2).tolist()
        # A height that is not known stays in its place.
        high, middle, low = [*sides, height] if np.isnan(height) else sorted([*sides, height])[::-1]
        return high, middle, low
    across = np.ptp(product(footprint, footprints.rectangle_frame(footprint)[:2, :2].T), axis=0)
    return float(across.max()), float(across.min()), height


def dimensions_of(own: Floats, solid_kind: str) -> tuple[float, float, float]:
    """Length, width and height of a solid whose vertices (v, 3) are in its own frame."""
    if solid_kind in ("box", "cube"):
        high, middle, low = np.sort(2.0 * np.abs(own - own.mean(axis=0)).mean(axis=0))[::-1]
        return float(high), float(middle), float(low)
    x, y, z = np.ptp(own, axis=0).tolist()
    return max(x, y), min(x, y), z


def _candidates(
    vertices: Floats, faces: Faces, shell: Shell, bases: list[int], slack: float
) -> tuple[Ints, Floats]:
    """Sides (half-edges) of bases that may carry the own x axis, and their frames."""
    flags = np.flatnonzero(np.isin(shell.face, bases))
    across = area_vectors(vertices, faces)
    areas = np.linalg.norm(across, axis=1)
    z = -(across / areas[:, None])[shell.face[flags]]
    # From outside a face runs counter-clockwise, from inside clockwise.
    x = vertices[shell.start[flags]] - vertices[shell.start[shell.following[flags]]]
    lengths = np.linalg.norm(x, axis=1)
    x -= np.einsum("ij,ij->i", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(z, x), z], axis=2)
    perimeters = np.array(
        [
            np.ptp(product(vertices[faces[face]], frame), axis=0).sum()
            for face, frame in zip(shell.face[flags], frames, strict=True)
        ]
    )
    left = np.arange(len(flags))
    for measure in (np.sqrt(areas[shell.face[flags]]), -perimeters, lengths):
        left = left[measure[left] >= measure[left].max() - slack]
    return flags[left], frames[left]


def _kind(
    vertices: Floats, faces: Faces, scale: float, tolerance: float
) -> tuple[str, list[int], Floats | None]:
    """Name at any tilt, the faces that may be its base, and the footprint of an upright prism."""
    found: dict[str, list[int]] = {}
    footprint = None
    for i, j, ratio, shift in _pairs_of_bases(vertices, faces, scale * tolerance):
        normal = area_vectors(vertices, faces[i : i + 1])[0]
        normal /= lengths_of(normal)
        if abs(ratio - 1.0) > tolerance:
            found.setdefault("frustum", []).append(i if ratio < 1.0 else j)
        elif lengths_of(np.cross(shift, normal)) > tolerance * scale:
            found.setdefault("oblique", []).extend((i, j))
        else:
            base = footprints.kind_of(_in_plane(vertices[faces[i]], normal), tolerance)
            found.setdefault(base, []).extend((i, j))
            if abs(normal[2]) >= 1.0 - tolerance**2:
                low = faces[i if normal[2] < 0.0 else j]
                footprint = footprints.clean_footprint(vertices[low, :2])
    return *_name(found, vertices, faces), footprint


def _name(found: dict[str, list[int]], vertices: Floats, faces: Faces) -> tuple[str, list[int]]:
    """Name and bases, however the solid is turned, from the bases found by what is over them."""
    every = list(range(len(faces)))
    if "square" in found or "rectangle" in found:
        return ("cube" if len(found.get("square", ())) == 6 else "box"), every
    right = [name for name in found if name not in ("frustum", "oblique")]
    if right:
        bases = found[right[0]]
        if right[0] == "circle":
            return "cylinder", bases
        return ("wedge" if len(faces[bases[0]]) == 3 else "prism"), bases
    apexes = [face for face in every if len(faces[face]) == len(faces) - 1 == len(vertices) - 1]
    if apexes:
        return "pyramid", apexes
    if "frustum" in found:
        return "frustum", found["frustum"]
    if "oblique" in found:
        return "prism", found["oblique"]
    return "polyhedron", every


def _in_plane(corners: Floats, normal: Floats) -> Floats:
    """Corners (m, 2) of a face in its own plane, counter-clockwise as seen against the normal."""
    side = corners[1] - corners[0]
    x = side / lengths_of(side)
    return product(corners - corners[0], np.stack([x, np.cross(normal, x)], axis=1))


def _pairs_of_bases(
    vertices: Floats, faces: Faces, slack: float
) -> Iterator[tuple[int, int, float, Floats]]:
    """Faces (i, j) that all others join, with one the other moved and scaled.

    With them come the scale of j over i, and the shift from the middle of i to that of j.
    """
    n = len(faces) - 2
    if len(vertices) != 2 * n:
        return
    shell = Shell.of(faces)
    edges = set(zip(shell.start.tolist(), shell.start[shell.following].tolist(), strict=True))
    candidates = [i for i, face in enumerate(faces) if len(face) == n]
    for k, i in enumerate(candidates):
        for j in candidates[k + 1 :]:
            bottom, top = faces[i], set(faces[j].tolist())
            if top & set(bottom.tolist()):
                continue
            joined = [[b for b in top if (int(a), b) in edges] for a in bottom]
            if any(len(each) != 1 for each in joined):
                continue
            low, high = vertices[bottom], vertices[[each[0] for each in joined]]
            low_arms, high_arms = low - low.mean(axis=0), high - high.mean(axis=0)
            ratio = float((low_arms * high_arms).sum() / (low_arms**2).sum())
            off = np.abs(high_arms - ratio * low_arms).max()
            if ratio > 0.0 and off <= slack:
                yield i, j, ratio, high.mean(axis=0) - low.mean(axis=0)


def turn_between(
    vertices: Floats, faces: Faces, symmetry: Floats, others: Floats, other_faces: Faces
) -> float:
    """Angle, radians, of the turn that lays one polyhedron onto another; NaN if none can.

    Of all ways to lay faces onto faces the one that fits best counts, and of all turns that look
    alike, as the `symmetry` (s, 3, 3) of the first tells, the smallest.
    """
    a, b = Shell.of(faces), Shell.of(other_faces)
    if len(a.start) != len(b.start):
        return np.nan
    order, pattern = a.walk(0)
    p = _about_center(vertices[a.start[order]])
    best, turn = -np.inf, None
    for flag in range(len(b.start)):
        other_order, other_pattern = b.walk(flag)
        if np.array_equal(pattern, other_pattern):
            q = _about_center(others[b.start[other_order]])
            # The turn of least squares (Kabsch); what it explains of the product tells the fit.
            u, explained, v = np.linalg.svd(q.T @ p)
            hand = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
            if explained @ hand > best:
                best, turn = float(explained @ hand), (u * hand) @ v
    if turn is None:
        return np.nan
    # Turned by its own symmetry first, the solid looks the same.
    return float(Rotation.from_matrix(turn @ symmetry).magnitude().min())


def _about_center(points: Floats) -> Floats:
    return points - points.mean(axis=0)
