"""Footprints of prisms: simple polygons in the plane, their names and their symmetry.

A footprint is an (m, 2) float64 array, counter-clockwise, not closed, without collinear vertices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Floats, Ints, as_rows
from primfit.geometry.products import dot, product

NAMES = {3: "triangle", 4: "square", 5: "pentagon", 6: "hexagon", 7: "heptagon", 8: "octagon"}
NAMES |= {9: "nonagon", 10: "decagon", 11: "hendecagon", 12: "dodecagon"}
"""Regular polygons by their number of vertices; beyond twelve it is "13-gon" and so on."""

ROUND_VERTICES = 64
"""Vertices of the polygon that stands for a circle or an ellipse."""

FEWEST_ROUND_VERTICES = 24
"""A regular polygon with so many vertices is a circle: its sides are within 0.6 % of the radius."""

TOLERANCE = 1e-6
"""Relative difference of sides and angles that still counts as equal: far above rounding."""


def regular_name(n_vertices: int) -> str:
    """Name of the regular polygon with ``n_vertices`` vertices."""
    return NAMES.get(n_vertices, f"{n_vertices}-gon")


def clean_footprint(vertices: ArrayLike, name: str = "footprint") -> Floats:
    """Outline as a footprint: checked, counter-clockwise, without collinear vertices.

    Parameters
    ----------
    vertices : (m, 2) float64, metres
        Corners in order, in either direction, closed or not.
    name : str
        What messages call it.

    Raises
    ------
    ValueError
        When it has fewer than three corners, crosses or touches itself, or has no area.
    """
    outline = as_rows(name, vertices, 2)
    if len(outline):
        span = np.ptp(outline, axis=0).max()
        rounding = 4.0 * np.finfo(float).eps * np.abs(outline).max()
        step = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)
        outline = outline[step > 1e-9 * span + rounding]
    if len(outline) < 3:
        raise ValueError(f"{name} must have at least 3 distinct vertices, not {len(outline)}")
    polygon = shapely.Polygon(outline)
    if not polygon.is_valid:
        why = shapely.is_valid_reason(polygon)
        raise ValueError(f"{name} must be a simple polygon that does not cross itself: {why}")
    if polygon.area <= 1e-12 * span**2:
        raise ValueError(f"{name} must enclose an area, but its vertices lie on a line")
    if not polygon.exterior.is_ccw:
        outline = outline[::-1]
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    straight = 1e-12 * lengths + 2.0 * rounding * np.sqrt(np.maximum(lengths, rounding**2))
    return np.array(outline[np.abs(turn) > straight])


def sides(footprint: Floats) -> Floats:
    """Vectors (m, 2) from each vertex to the next."""
    return np.roll(footprint, -1, axis=0) - footprint


def signed_area(outline: Floats) -> float:
    """Area of a closed outline: positive when it runs counter-clockwise."""
    x, y = (outline - outline[0]).T
    return 0.5 * float((x * np.roll(y, -1)).sum() - (y * np.roll(x, -1)).sum())


def area_centroid(footprint: Floats) -> Floats:
    """Centroid (2,) of the area of a footprint."""
    local = footprint - footprint[0]
    following = np.roll(local, -1, axis=0)
    weight = local[:, 0] * following[:, 1] - local[:, 1] * following[:, 0]
    mean: Floats = product(weight[None], local + following)[0] / (3.0 * weight.sum())
    return footprint[0] + mean


def symmetry(footprint: Floats, tolerance: float = TOLERANCE) -> tuple[int, int]:
    """First side and order of the rotation symmetry of a footprint.

    The first side is the longest; where sides are equally long, the one whose run of sides and
    turns comes last in dictionary order. It turns with the footprint, so its direction tells the
    angle; the angle is known modulo a full turn over the order.

    Returns
    -------
    first, order : int
    """
    vectors = sides(footprint)
    lengths = np.linalg.norm(vectors, axis=1)
    headings = np.arctan2(vectors[:, 1], vectors[:, 0])
    turns = np.mod(np.roll(headings, -1) - headings + np.pi, 2 * np.pi)
    words = np.rint(np.stack([lengths / lengths.max(), turns / np.pi], axis=1) / tolerance)
    # Equal numbers may fall on either side of a rounding step: give neighbours one name.
    for column in words.T:
        order = np.argsort(column, kind="stable")
        steps = np.diff(column[order], prepend=column[order[0]]) > 2
        column[order] = np.cumsum(steps)
    runs = [tuple(np.roll(words, -i, axis=0).ravel()) for i in range(len(footprint))]
    best = max(runs)
    return runs.index(best), runs.count(best)


def kind_of(footprint: Floats, tolerance: float = TOLERANCE) -> str:
    """Name of a footprint: "triangle", "square", "rectangle", ..., "star" or "polygon".

    Triangle, square, pentagon and so on are regular; a star has alternating radii. A regular
    polygon of `FEWEST_ROUND_VERTICES` or more is a "circle", its affine image an "ellipse".
    """
    n = len(footprint)
    if n >= FEWEST_ROUND_VERTICES:
        fit = fit_ellipse(footprint)
        if fit.misfit <= tolerance * fit.long:
            return "circle" if fit.long - fit.short <= tolerance * fit.long else "ellipse"
    order = symmetry(footprint, tolerance)[1]
    if order == n:
        return regular_name(n)
    if n == 4 and order == 2:
        a, b = sides(footprint)[:2]
        square_corner = abs(dot(a, b)) <= tolerance * np.hypot(*a) * np.hypot(*b)
        return "rectangle" if square_corner else "polygon"
    if n >= 6 and 2 * order == n and _is_mirrored(footprint, tolerance):
        return "star"
    return "polygon"


class EllipseFit(NamedTuple):
    """An ellipse with the area of the polygon that stands for it.

    Attributes
    ----------
    long, short : float, metres
        Semi-axes.
    angle : float, radians
        Of the long axis to +x, from zero up to pi; without meaning for a circle.
    misfit : float, metres
        Largest distance of a vertex to that of the polygon that stands for the ellipse.
    """

    long: float
    short: float
    angle: float
    misfit: float


def fit_ellipse(footprint: Floats) -> EllipseFit:
    """The ellipse whose polygon is nearest to a footprint, by least squares of the vertices.

    The polygon that stands for an ellipse is the affine image of a regular one with as many
    vertices; as complex numbers its vertices have, besides their mean, only the first harmonic of
    either sense.
    """
    n = len(footprint)
    local = footprint - footprint.mean(axis=0)
    z = local[:, 0] + 1j * local[:, 1]
    harmonics = np.fft.fft(z) / n
    forward, backward = harmonics[1], harmonics[-1]
    steps = np.exp(2j * np.pi * np.arange(n) / n)
    misfit = np.abs(z - forward * steps - backward * steps.conj()).max()
    shrunk = 1.0 / _round_excess(n)
    return EllipseFit(
        long=float(shrunk * (abs(forward) + abs(backward))),
        short=float(shrunk * abs(abs(forward) - abs(backward))),
        angle=wrap(float(np.angle(forward) + np.angle(backward)) / 2, np.pi),
        misfit=float(misfit),
    )


def _round_excess(n: int) -> float:
    """Radius of a regular polygon's vertices over that of the circle with the same area."""
    return float(np.sqrt(2 * np.pi / (n * np.sin(2 * np.pi / n))))


def _is_mirrored(footprint: Floats, tolerance: float) -> bool:
    """Whether all sides are equally long, as in a star and not in a pinwheel."""
    lengths = np.linalg.norm(sides(footprint), axis=1)
    return bool(np.ptp(lengths) <= tolerance * lengths.max())


def angle_of(footprint: Floats, kind: str | None = None, tolerance: float = TOLERANCE) -> float:
    """Angle of a footprint, radians, from zero up to its symmetry (see `symmetry_angle`).

    Zero when the lowest side lies along +x; for a rectangle a long side, for a star when a tip
    points to +y, for an ellipse when the long axis lies along +x, for other polygons the first side
    of `symmetry`. A circle has none, which is zero.
    """
    kind = kind or kind_of(footprint)
    if kind == "circle":
        return 0.0
    if kind == "ellipse":
        return fit_ellipse(footprint).angle
    first, order = symmetry(footprint, tolerance)
    if kind == "star":
        arms = footprint - footprint.mean(axis=0)
        tip = arms[int(np.argmax(np.linalg.norm(arms, axis=1)))]
        heading = np.arctan2(tip[1], tip[0]) - np.pi / 2
    else:
        side = sides(footprint)[first]
        heading = np.arctan2(side[1], side[0])
    return wrap(float(heading), 2 * np.pi / order)


def wrap(angle: float, period: float) -> float:
    """``angle`` modulo ``period``, from zero up to but not including the period."""
    wrapped = angle % period
    return 0.0 if period - wrapped < 1e-12 else wrapped


def symmetry_angle(footprint: Floats) -> float:
    """The smallest turn, radians, that lays the footprint onto itself; zero for a circle."""
    if kind_of(footprint) == "circle":
        return 0.0
    return 2 * np.pi / symmetry(footprint)[1]


def size_of(footprint: Floats, kind: str | None = None) -> float | tuple[float, float]:
    """Size of a footprint, metres.

    The side of a regular polygon, (long, short) side of a rectangle, (outer, inner) radius of a
    star, radius of a circle, (long, short) semi-axis of an ellipse, and for other polygons (long,
    short) side of the smallest rectangle around it.
    """
    kind = kind or kind_of(footprint)
    if kind in ("circle", "ellipse"):
        fit = fit_ellipse(footprint)
        return float(np.sqrt(fit.long * fit.short)) if kind == "circle" else fit[:2]
    footprint = footprint - footprint[0]
    if kind == "star":
        radii = np.linalg.norm(footprint - footprint.mean(axis=0), axis=1)
        return float(radii.max()), float(radii.min())
    if kind in ("rectangle", "polygon"):
        around = shapely.minimum_rotated_rectangle(shapely.Polygon(footprint))
        lengths = np.linalg.norm(np.diff(shapely.get_coordinates(around), axis=0), axis=1)
        return float(lengths.max()), float(lengths.min())
    return float(np.linalg.norm(sides(footprint), axis=1).mean())


def regular_footprint(n: int, side: float, center: Floats, angle: float) -> Floats:
    """Vertices (n, 2) of a regular polygon."""
    radius = side / (2 * np.sin(np.pi / n))
    bearings = 2 * np.pi * np.arange(n) / n - np.pi / 2 - np.pi / n
    return _place(radius * np.exp(1j * bearings), center, angle)


def rectangle_footprint(long: float, short: float, center: Floats, angle: float) -> Floats:
    """Vertices (4, 2) of a rectangle."""
    corners = np.array([-long - 1j * short, long - 1j * short, long + 1j * short])
    return _place(np.append(corners, -long + 1j * short) / 2, center, angle)


def star_footprint(n: int, outer: float, inner: float, center: Floats, angle: float) -> Floats:
    """Vertices (2n, 2) of a star with n tips."""
    radii = np.tile([outer, inner], n)
    return _place(radii * np.exp(1j * (np.pi / 2 + np.pi * np.arange(2 * n) / n)), center, angle)


def ellipse_footprint(long: float, short: float, center: Floats, angle: float) -> Floats:
    """Vertices (`ROUND_VERTICES`, 2) of the polygon that stands for an ellipse of its area."""
    bearings = 2 * np.pi * np.arange(ROUND_VERTICES) / ROUND_VERTICES
    outline = long * np.cos(bearings) + 1j * short * np.sin(bearings)
    return _place(_round_excess(ROUND_VERTICES) * outline, center, angle)


def rectangle_frame(outline: Floats) -> Floats:
    """Axes (2, 2) of the rectangle of least perimeter around a convex or other outline.

    One is along a side of the outline, the longest of those that are as good.
    """
    sides = np.roll(outline, -1, axis=0) - outline
    lengths = np.linalg.norm(sides, axis=1)
    x = sides / lengths[:, None]
    frames = np.stack([x, np.stack([-x[:, 1], x[:, 0]], axis=1)], axis=1)
    spans = np.ptp(np.einsum("fij,mj->fmi", frames, outline), axis=1).sum(axis=1)
    good = np.flatnonzero(spans <= spans.min() + TOLERANCE * spans.max())
    best: Floats = frames[good[np.argmax(lengths[good])]]
    return best


def _place(local: np.ndarray, center: Floats, angle: float) -> Floats:
    turned = local * np.exp(1j * angle)
    return np.stack([turned.real, turned.imag], axis=1) + center


def triangulate(footprint: Floats) -> Ints:
    """Triangles (t, 3) of a footprint, counter-clockwise, without new corners."""
    pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(footprint))
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    distance = np.abs(corners[:, :, None] - footprint).sum(axis=-1)
    triangles: Ints = distance.argmin(axis=-1)
    a, b, c = np.moveaxis(footprint[triangles], 1, 0)
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (
        c[:, 0] - a[:, 0]
    )
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return triangles
