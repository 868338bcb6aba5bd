"""What a scene is made of: named parts in groups that can be switched, in metres."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import singledispatch
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import shapely

from primfit._check import Floats, Ints
from primfit.clouds.cloud import Cloud
from primfit.clouds.foreign import PointsLike, borrowed
from primfit.planes.plane import Plane, Planes, axes_of
from primfit.plotting import kind_color, plane_colors
from primfit.results import Detection
from primfit.scans.scan import Scan
from primfit.worlds.world import World

MOST_POINTS = 200_000
"""Points that a scene shows: 3 MB of them."""

_MOST_BEAMS = 2000
"""Beams that are drawn: more are a solid mass."""

_GREY = (150, 150, 150)
_DARK = (60, 60, 60)


@dataclass(frozen=True, eq=False)
class Layer:
    """A part of a scene.

    Attributes
    ----------
    name : str
        Unique in the scene.
    group : str
        What is switched together: "points", "planes", "noise", "solids", "truth", "beams" ...
    shape : str
        "points" (n, 3), "lines" (n, 2, 3) or "triangles" (n, 3, 3).
    corners : array of that shape, metres
    color : (3,) or (n, 3) uint8
    text : str
        What is told of it where the mouse is.
    label : str
        Shown at its middle.
    """

    name: str
    group: str
    shape: Literal["points", "lines", "triangles"]
    corners: Floats
    color: Any
    text: str
    label: str = ""


@singledispatch
def layers_of(thing: Any, **_: Any) -> Iterator[Layer]:
    """The layers of a world, scan, cloud, planes or detection."""
    raise TypeError(f"a scene is made of what primfit makes, not of {type(thing).__name__}")


@layers_of.register
def _of_cloud(cloud: Cloud) -> Iterator[Layer]:
    rows = _thinned(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
    points = cloud.points[rows]
    color = cloud.fields.get("color")
    shades = _by_height(points) if color is None or color.dtype != np.uint8 else color[rows]
    yield Layer("points", "points", "points", points, shades, repr(cloud))


@layers_of.register
def _of_scan(scan: Scan) -> Iterator[Layer]:
    rows = _thinned(np.flatnonzero(scan.is_return))
    points = scan.points[rows]
    yield Layer("points", "points", "points", points, _by_height(points), repr(scan))
    yield from _beams(scan)


def _beams(scan: Scan) -> Iterator[Layer]:
    if not scan.has_origins:
        return
    rows = np.flatnonzero(scan.is_return)
    some = rows[:: max(1, -(-len(rows) // _MOST_BEAMS))]
    ends = np.stack([scan.origins[some], scan.points[some]], axis=1)
    yield Layer(
        "beams", "beams", "lines", ends, (240, 160, 60), f"{len(some)} of {len(rows)} beams"
    )
    places = np.unique(scan.origins[some], axis=0)
    yield Layer("sensor", "beams", "points", places, (200, 30, 30), "where beams began")


@layers_of.register
def _of_world(world: World, *, group: str = "solids") -> Iterator[Layer]:
    vertices, triangles, index = world.to_mesh()
    corners = vertices[triangles]
    for i, solid in enumerate(world.solids):
        own = corners[index == i]
        color, text = kind_color(solid.kind), f"solid {i} of the world: {solid!r}"
        if group == "truth":
            yield Layer(f"truth-{i}", group, "lines", _edges(solid), _DARK, text)
        else:
            yield Layer(f"solid-{i}", group, "triangles", own, color, text, solid.kind)
    if world.arena is not None:
        walls = world.arena.outline
        z = [0.0, world.arena.height]
        rings = [np.insert(walls, 2, height, axis=1) for height in z]
        lines = [_ring(ring) for ring in rings] + [np.stack(rings, axis=1)]
        yield Layer(
            f"{group}-arena", "arena", "lines", np.concatenate(lines), _DARK, repr(world.arena)
        )


@layers_of.register
def _of_planes(planes: Planes, *, points: PointsLike = None) -> Iterator[Layer]:
    colors = plane_colors(len(planes))
    if points is not None:
        places = borrowed("points", points).points
        if len(places) != len(planes.labels):
            n = len(planes.labels)
            raise ValueError(f"points must be the {n} of which the planes are, not {len(places)}")
        yield from _labelled(places, planes.labels, planes.planes, colors)
    for i, plane in enumerate(planes):
        yield from _plane(f"plane-{i}", plane, colors[i], f"plane {i}", str(i))


@layers_of.register
def _of_detection(found: Detection, *, world: World | None = None) -> Iterator[Layer]:
    colors = plane_colors(len(found.planes))
    scan, labels = found.scan, found.labels.copy()
    floor = [] if found.floor is None else [found.floor]
    if floor:
        labels[floor[0].inliers] = len(found.planes)
        colors = np.insert(colors, len(found.planes), [190, 180, 160], axis=0)
    planes = (*found.planes, *floor)
    yield from _labelled(scan.points, labels, planes, colors)
    for i, plane in enumerate(found.planes):
        yield from _plane(f"plane-{i}", plane, colors[i], f"plane {i}", str(i))
    if floor:
        yield from _plane("floor", floor[0], colors[-2], "floor", "floor")
    for j, solid in enumerate(found.solids):
        text = f"solid {j}: {solid!r}"
        vertices, triangles = solid.to_mesh()
        shade = kind_color(solid.kind)
        yield Layer(
            f"solid-{j}", "solids", "triangles", vertices[triangles], shade, text, solid.kind
        )
        yield Layer(f"solid-{j}-edges", "solids", "lines", _edges(solid), _DARK, text)
    if found.arena is not None:
        outline = np.insert(found.arena.footprint, 2, 0.0, axis=1)
        yield Layer("arena", "arena", "lines", _ring(outline), _DARK, repr(found.arena))
    if world is not None:
        yield from _of_world(world, group="truth")
    yield from _beams(scan)


def _labelled(
    points: Floats, labels: Ints, planes: Iterable[Plane], colors: Any
) -> Iterator[Layer]:
    """The points of each plane, and those of none."""
    rows = _thinned(np.flatnonzero(np.isfinite(points).all(axis=1)))
    own = labels[rows]
    order = np.argsort(own, kind="stable")
    at = np.searchsorted(own[order], np.arange(-1, len(colors)))
    for i, (first, last) in enumerate(pairwise(at), -1):
        some = points[rows[order[first:last]]]
        if not len(some):
            continue
        if i < 0:
            yield Layer("noise", "noise", "points", some, _GREY, "points of no plane")
        else:
            yield Layer(f"points-{i}", "points", "points", some, colors[i], f"points of plane {i}")


def _plane(name: str, plane: Plane, color: Any, title: str, label: str) -> Iterator[Layer]:
    a, b, c, d = plane.equation
    text = (
        f"{title}: {len(plane.inliers)} inliers, {plane.area:.4f} m2, rms "
        f"{1000 * plane.rms:.3f} mm, {a:+.4f} x {b:+.4f} y {c:+.4f} z {d:+.4f} = 0"
    )
    if len(plane.boundary) < 3:
        return
    rings = [_ring(ring) for ring in (plane.boundary, *plane.holes)]
    yield Layer(f"{name}-outline", "planes", "lines", np.concatenate(rings), color, text)
    triangles = _filled(plane)
    if len(triangles):
        yield Layer(name, "planes", "triangles", triangles, color, text, label)


def _filled(plane: Plane) -> Floats:
    """Triangles (t, 3, 3) within the boundary, less the holes."""
    axes = axes_of(plane.equation[:3])
    place = plane.boundary.mean(axis=0)
    rings = [(ring - place) @ axes.T for ring in (plane.boundary, *plane.holes)]
    area = shapely.make_valid(shapely.Polygon(rings[0], rings[1:]))
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    if not len(pieces):
        return np.empty((0, 3, 3))
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    return place + corners @ axes


def _edges(solid: Any) -> Floats:
    """Edges (n, 2, 3) of what vertices and faces bound."""
    pairs = {
        (min(a, b), max(a, b))
        for face in solid.faces
        for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True)
    }
    return solid.vertices[np.array(sorted(pairs))]


def _ring(ring: Floats) -> Floats:
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def _by_height(points: Floats) -> Any:
    """Colours (n, 3) from blue, low, to yellow, high."""
    if not len(points):
        return np.empty((0, 3), np.uint8)
    low, high = np.quantile(points[:, 2], [0.02, 0.98])
    share = np.clip((points[:, 2] - low) / max(high - low, 1e-12), 0.0, 1.0)
    stops = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]])
    return np.stack(
        [np.interp(share, np.linspace(0, 1, 5), stops[:, k]) for k in range(3)], axis=1
    ).astype(np.uint8)


def _thinned(rows: Ints) -> Ints:
    return rows[:: max(1, -(-len(rows) // MOST_POINTS))]
