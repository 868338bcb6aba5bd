"""Closed surfaces of flat faces: their half-edges, checks and repairs.

A face is a row of vertex numbers around it, counter-clockwise from outside. A half-edge is a side
of a face: it starts at a vertex, another one of the face follows, and its twin is the same side of
the neighbouring face.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.products import dot, dots

Faces = tuple[Ints, ...]

FLAT = 1e-6
"""Distance from flatness, relative to the size, that still counts as flat: far above rounding."""


@dataclass(frozen=True, eq=False)
class Shell:
    """The half-edges (h,) of an oriented surface: start vertex, face, following one, twin."""

    start: Ints
    face: Ints
    following: Ints
    twin: Ints

    @classmethod
    def of(cls, faces: Sequence[Ints]) -> Shell:
        """The half-edges of faces that are closed and oriented alike."""
        sizes = [len(face) for face in faces]
        first = np.repeat(np.cumsum([0, *sizes[:-1]]), sizes)
        start = np.concatenate(faces)
        following = first + np.concatenate([np.roll(np.arange(size), -1) for size in sizes])
        ends = list(zip(start.tolist(), start[following].tolist(), strict=True))
        row = {end: h for h, end in enumerate(ends)}
        twin = [row[b, a] for a, b in ends]
        return cls(start, np.repeat(np.arange(len(faces)), sizes), following, np.array(twin))

    def walk(self, first: int) -> tuple[Ints, Ints]:
        """All half-edges in the order in which a walk from one of them meets them.

        Returns
        -------
        order : (h,) int64
        pattern : (h, 2) int64
            Places in that order of the following one and the twin of each. Two walks with one
            pattern lay the surfaces onto each other.
        """
        neighbors = list(zip(self.following.tolist(), self.twin.tolist(), strict=True))
        place = {first: 0}
        order = [first]
        for h in order:
            for other in neighbors[h]:
                if other not in place:
                    place[other] = len(order)
                    order.append(other)
        pattern = [[place[other] for other in neighbors[h]] for h in order]
        return np.array(order), np.array(pattern)


def as_faces(values: object, n_vertices: int) -> Faces:
    """Faces as arrays, each of three or more different vertices that exist."""
    try:
        faces = tuple(np.array(face) for face in values)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise TypeError(f"faces must be sequences of vertex numbers, not {values!r}") from None
    for i, face in enumerate(faces):
        if face.ndim != 1 or face.dtype.kind not in "iu":
            raise TypeError(f"faces[{i}] must be a sequence of vertex numbers, not {face.tolist()}")
        if len(face) < 3 or len(set(face.tolist())) < len(face):
            raise ValueError(f"faces[{i}] must have 3 or more different vertices: {face.tolist()}")
        if face.min() < 0 or face.max() >= n_vertices:
            raise ValueError(f"faces[{i}] must name rows of {n_vertices} vertices: {face.tolist()}")
    if len(faces) < 4:
        raise ValueError(f"faces must be at least 4, not {len(faces)}")
    unused = set(range(n_vertices)) - set(np.concatenate(faces).tolist())
    if unused:
        raise ValueError(f"vertices must be in faces, but row {min(unused)} is in none")
    return tuple(face.astype(np.int64) for face in faces)


def oriented(faces: Faces) -> Faces:
    """The faces turned alike; still all of them may look inwards.

    Raises
    ------
    ValueError
        When they leave an edge open, meet more than two at one, meet at a vertex only, cannot be
        turned alike, or are several surfaces.
    """
    sides: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for i, face in enumerate(faces):
        for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
            sides.setdefault((min(a, b), max(a, b)), []).append((i, a < b))
    for edge, users in sides.items():
        if len(users) != 2:
            what = "close" if len(users) == 1 else "meet in pairs"
            raise ValueError(f"faces must {what}, but the edge {edge} is in {len(users)} of them")
    neighbors: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for (i, forth), (j, other) in sides.values():
        neighbors[i].append((j, forth == other))
        neighbors[j].append((i, forth == other))
    turned = {0: False}
    waiting = deque([0])
    while waiting:
        i = waiting.popleft()
        for j, differs in neighbors[i]:
            if j not in turned:
                turned[j] = turned[i] ^ differs
                waiting.append(j)
            elif turned[j] != turned[i] ^ differs:
                raise ValueError("faces must have an inside and an outside, but are one-sided")
    if len(turned) < len(faces):
        raise ValueError(f"faces must be one surface, but {len(turned)} of them are apart")
    result = tuple(face[::-1].copy() if turned[i] else face for i, face in enumerate(faces))
    _check_fans(result)
    return result


def _check_fans(faces: Faces) -> None:
    """Refuse a vertex at which faces meet that share no edge there."""
    shell = Shell.of(faces)
    around = shell.following[shell.twin]
    n_ways = Counter(shell.start.tolist())
    for h, vertex in enumerate(shell.start.tolist()):
        n_met, other = 1, around[h]
        while other != h:
            n_met, other = n_met + 1, around[other]
        if n_met < n_ways[vertex]:
            raise ValueError(f"faces must meet along edges, but some only touch at vertex {vertex}")


def area_vectors(vertices: Floats, faces: Faces) -> Floats:
    """Normals (f, 3) of the faces as long as their areas; outwards for oriented faces."""
    sizes = [len(face) for face in faces]
    first = np.cumsum([0, *sizes[:-1]])
    arms = vertices[np.concatenate(faces)]
    arms -= np.repeat(arms[first], sizes, axis=0)
    following = vertices[np.concatenate([np.roll(face, -1) for face in faces])]
    following -= np.repeat(vertices[[face[0] for face in faces]], sizes, axis=0)
    return 0.5 * np.add.reduceat(np.cross(arms, following), first, axis=0)


def merged(vertices: Floats, faces: Faces) -> tuple[Floats, Faces]:
    """The surface with flat neighbours as one face, and without vertices in the middle of edges.

    Neighbours around a hole stay apart, since a face has one outline.
    """
    shell = Shell.of(faces)
    normals = area_vectors(vertices, faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    size = np.ptp(vertices, axis=0).max()
    group = np.arange(len(faces))
    for h, t in enumerate(shell.twin):
        i, j = shell.face[h], shell.face[t]
        if group[i] == group[j]:
            continue
        # The neighbour's vertices lie in the plane of the face, and it looks the same way.
        off = dots(vertices[faces[j]] - vertices[faces[i][0]], normals[i])
        if dot(normals[i], normals[j]) > 0.0 and np.abs(off).max() <= FLAT * size:
            group[group == group[j]] = group[i]
    inner = group[shell.face] == group[shell.face[shell.twin]]
    result: list[Ints] = []
    for g in np.unique(group):
        members = np.flatnonzero(group == g)
        rim = np.flatnonzero(~inner & (group[shell.face] == g))
        outline = _outline(shell, inner, int(rim[0]))
        if len(members) > 1 and len(outline) == len(rim) == len(set(shell.start[rim].tolist())):
            result.append(shell.start[outline])
        else:
            result.extend(faces[i] for i in members)
    n_faces = Counter(np.concatenate(result).tolist())
    kept = np.array(sorted(vertex for vertex, n in n_faces.items() if n > 2))
    row = np.full(len(vertices), -1)
    row[kept] = np.arange(len(kept))
    return vertices[kept], tuple(row[face][row[face] >= 0] for face in result)


def _outline(shell: Shell, inner: np.ndarray, first: int) -> list[int]:
    """Half-edges along the rim of a group of faces, from one of them around."""
    outline, h = [first], int(shell.following[first])
    while h != first:
        if inner[h]:
            h = int(shell.following[shell.twin[h]])
        else:
            outline.append(h)
            h = int(shell.following[h])
    return outline
