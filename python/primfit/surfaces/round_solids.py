"""Solids that curved surfaces close, alone or with flat ends: balls, pipes, cans, rings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from primfit._check import Floats, Ints
from primfit.geometry.footprints import ellipse_footprint
from primfit.geometry.products import lengths_of, product
from primfit.geometry.shapes import Shape
from primfit.planes.plane import Plane
from primfit.planes.scan_planes import SIGMAS
from primfit.solids.found import EQUAL, FoundSolid
from primfit.solids.frusta import Cone, Cylinder
from primfit.solids.round import Round
from primfit.solids.sphere import Sphere
from primfit.solids.torus import Torus
from primfit.surfaces.ends import End, Wall, ends_of
from primfit.surfaces.kinds import (
    N_PARAMETERS,
    ConeSurface,
    CurvedSurface,
    CylinderSurface,
    SphereSurface,
    TorusSurface,
)
from primfit.surfaces.surface import Surface

_LEAST_ARC = 2.0 * np.pi / 3.0
"""Least angle about the axis, radians, that must be seen of a pipe: as much is in view from two
radii off its axis. A rounded edge of a box shows a quarter of a turn."""

_LEAST_SHARE = 0.25
"""Least share of a sphere's area that must be seen of a ball: as much is in view from two radii off
its centre."""

_LEAST_TURN = 1.5 * np.pi
"""Least angle about the axis, radians, of a ring: the bends of pipes turn by half at most."""

_COARSEST = 0.05
"""Most noise of a solid, as a share of its radius, or of the height of a cone: beyond it the bias
of the last fit nears its standard deviation (docs/surfaces.md), and clutter passes for round. And
most standard deviation of its radius."""

_STRANGE = 0.01
"""Share of its points that may be inside: outliers."""

_EXACT = 1e-9
"""Share of the size by which points are off at least: coordinates are rounded."""

_STEP = 1e-6
"""Share of a number by which it is moved to see what follows."""


def round_solids(
    surfaces: Sequence[CurvedSurface],
    planes: Sequence[Plane],
    points: Floats,
    noise: Floats | float | None = None,
) -> list[FoundSolid]:
    """The closed solids among curved surfaces.

    A surface is that of a solid when it was not seen from inside, as much of it was seen as is in
    view from two radii away, no other plane runs into it, nothing is within, and the planes that
    tile it do not explain the points better. It ends at a plane across its axis where there is one,
    be it its own flat end or the floor on which it stands, else at its last points.

    Parameters
    ----------
    surfaces : sequence of SphereSurface, CylinderSurface, ConeSurface and TorusSurface
    planes : sequence of Plane
    points : (n, 3) float64, metres
        The cloud of whose rows their `inliers` are.
    noise : float, (n,) or None, metres
        Standard deviation of the distances, where it is known: then a surface must fit as well as
        that says, but for 2 % of its radius by which a real solid may be off.

    Returns
    -------
    list of FoundSolid
        Their `planes` are the flat ends, base and top, -1 for none.
    """
    walls = [Wall.of(number, plane) for number, plane in enumerate(planes)]
    found = []
    for number, surface in enumerate(surfaces):
        if surface.is_convex is False or not _shows_enough(surface):
            continue
        if noise is not None and not _fits(surface, np.broadcast_to(noise, len(points))):
            continue
        ends = ends_of(surface, points, planes, walls)
        solid, parameters, covariance = _closed(surface, ends)
        if not _is_known(solid, parameters, covariance):
            continue
        own = tuple(end.plane for end in ends)
        tiles = tiles_of([surface], planes)
        others = [
            wall for wall in walls if wall.number not in own and planes[wall.number] not in tiles
        ]
        if (
            _is_cut(solid, surface, others)
            or _holds_others(solid, surface, points)
            or not _explains_more(solid, surface, tiles)
        ):
            continue
        found.append(
            FoundSolid(
                solid=solid,
                shape=_shape(solid),
                parameters=parameters,
                covariance=covariance,
                planes=own,
                observed=(True, *(end.is_seen for end in ends)),
                surfaces=(number,),
            )
        )
    return found


def _fits(surface: CurvedSurface, noise: Floats) -> bool:
    """Whether the surface is as near to its points as their noise says, and chance allows."""
    n = len(surface.inliers) / surface.correlation_area
    told = float(np.mean(noise[surface.inliers] ** 2)) * (1.0 + SIGMAS * np.sqrt(2.0 / n))
    return bool(surface.rms**2 <= told + (EQUAL * _narrowest(surface)) ** 2)


def _is_known(solid: Round, parameters: tuple[str, ...], covariance: Floats) -> bool:
    """Whether its radii are told: strips of what is bent otherwise leave them open."""
    deviations = dict(zip(parameters, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    radii = [name for name in ("radius", "major_radius") if name in deviations]
    return all(deviations[name] <= _COARSEST * getattr(solid, name) for name in radii)


def _narrowest(surface: CurvedSurface) -> float:
    """The radius, metres, or the height of a flat cone."""
    if isinstance(surface, ConeSurface):
        return min(surface.radii[1], surface.length)
    return surface.radius


def _shows_enough(surface: CurvedSurface) -> bool:
    if surface.rms > _COARSEST * _narrowest(surface):
        return False
    # Of what may have been seen from inside, a half at most can be a trough, a vault or a bowl.
    is_outside = surface.is_convex is True
    if isinstance(surface, SphereSurface):
        share = _LEAST_SHARE if is_outside else 0.5
        return surface.area > share * 4.0 * np.pi * surface.radius**2
    if isinstance(surface, TorusSurface):
        return surface.arc >= _LEAST_TURN and surface.radius < surface.major_radius
    return surface.arc > (_LEAST_ARC if is_outside else np.pi)


def _closed(surface: CurvedSurface, ends: list[End]) -> tuple[Round, tuple[str, ...], Floats]:
    """The solid of a surface between its ends, what is known of it, and how well."""
    told = np.concatenate([surface.parameters, np.zeros(len(ends))])
    spread = np.zeros((len(told), len(told)))
    n = len(surface.parameters)
    spread[:n, :n] = surface.covariance
    spread[range(n, len(told)), range(n, len(told))] = [end.variance for end in ends]
    values = _values(surface, told, ends)
    steps = _STEP * np.maximum(np.abs(told), 1.0)
    jacobian = np.stack(
        [(_values(surface, told + step, ends) - values) / step.max() for step in np.diag(steps)],
        axis=1,
    )
    center, axis, sizes = values[:3], values[3:6], values[6:]
    # A change of the axis is a turn about what is across both.
    turn = np.cross(axis, jacobian[3:6].T).T
    names = tuple(f"center_{x}" for x in "xyz")
    rows = [jacobian[:3], turn, jacobian[6:]]
    if isinstance(surface, SphereSurface):
        solid: Round = Sphere(float(sizes[0]), center)
        names, rows = (*names, "radius"), [rows[0], rows[2]]
    else:
        names += tuple(f"rotation_{x}" for x in "xyz")
        if isinstance(surface, CylinderSurface):
            radius, height = sizes.tolist()
            solid, lengths = Cylinder(radius, height, center, axis), ["radius", "height"]
        elif isinstance(surface, TorusSurface):
            major, minor = sizes.tolist()
            solid, lengths = Torus(major, minor, center, axis), ["major_radius", "radius"]
        else:
            radius, height, top = sizes.tolist()
            solid = Cone(radius, height, center, axis, top_radius=top)
            lengths = ["radius", "height", "top_radius"][: 3 if top > 0.0 else 2]
            rows[2] = rows[2][: len(lengths)]
        names = (*names, *lengths)
    change = np.concatenate(rows)
    return solid, names, product(product(change, spread), change.T)


def _shape(solid: Round) -> Shape:
    """What the solid is: what leans by nothing that counts is upright."""
    shape = solid.shape
    if isinstance(solid, Cylinder) and abs(solid.axis[2]) >= 1.0 - EQUAL**2:
        outline = ellipse_footprint(solid.radius, solid.radius, solid.center[:2], 0.0)
        return replace(shape, kind="circle", footprint=outline, angle=0.0, size=solid.radius)
    return shape


def _values(surface: CurvedSurface, told: Floats, ends: list[End]) -> Floats:
    """Centre, axis and lengths of the solid, from the numbers of its surface and moves of its ends.

    The ends stay where they were seen when the surface moves.
    """
    place, axis = told[:3], told[3:6]
    if isinstance(surface, SphereSurface):
        return np.concatenate([place, [0.0, 0.0, 1.0], told[3:]])
    if isinstance(surface, TorusSurface):
        return told
    axis = axis / lengths_of(axis)
    size = told[6]
    low, high = (
        0.0 if end.place is None else float((end.place - place) @ axis) + move
        for end, move in zip(ends, told[7:].tolist(), strict=True)
    )
    middle = place + 0.5 * (low + high) * axis
    if isinstance(surface, CylinderSurface):
        return np.concatenate([middle, axis, [size, high - low]])
    slope = np.tan(size)
    return np.concatenate([middle, -axis, [high * slope, high - low, low * slope]])


def _is_cut(solid: Round, surface: CurvedSurface, walls: list[Wall]) -> bool:
    """Whether a plane runs up to where it would be within the solid, as to a half column."""
    for wall in walls:
        off = product(solid.vertices, wall.equation[:3, None])[:, 0] + wall.equation[3]
        deep = min(float(off.max()), float(-off.min()))
        if deep <= EQUAL * max(solid.dimensions) + SIGMAS * surface.rms:
            continue
        section = _section(solid.vertices, solid.faces, off)
        within = shapely.MultiPoint(product(section, wall.axes)).convex_hull
        if wall.polygon.distance(within) <= wall.reach:
            return True
    return False


def _section(vertices: Floats, faces: tuple[Ints, ...], off: Floats) -> Floats:
    """Where edges meet a plane (k, 3), from the distances of the vertices to it."""
    starts = np.concatenate(faces)
    ends = np.concatenate([np.roll(face, -1) for face in faces])
    crossing = (off[starts] < 0.0) != (off[ends] < 0.0)
    starts, ends = starts[crossing], ends[crossing]
    share = off[starts] / (off[starts] - off[ends])
    return vertices[starts] + share[:, None] * (vertices[ends] - vertices[starts])


def _holds_others(solid: Round, surface: CurvedSurface, points: Floats) -> bool:
    """Whether more points than outliers are inside, as those of a bowl's other side are."""
    low, high = solid.bounds
    near = points[((points > low) & (points < high)).all(axis=1)]
    deep = EQUAL * min(solid.dimensions) + SIGMAS * surface.rms
    inside = (solid.surfaces(near)[0] < -deep).all(axis=1).sum()
    return bool(inside > _STRANGE * len(surface.inliers))


def _explains_more(solid: Round, surface: CurvedSurface, tiles: Sequence[Plane]) -> bool:
    """Whether the surface tells more of the points than the planes that tile it.

    By the length of the shortest description: a point on a surface costs the logarithm of the
    width in which it lies, one on none that of the whole solid, and a parameter half the logarithm
    of the number of points (Rissanen, Modeling by shortest data description, 1978). Points whose
    errors are one count as one.
    """
    on_any = np.unique(np.concatenate([surface.inliers, *(tile.inliers for tile in tiles)]))
    size = max(solid.dimensions)

    def cost(parts: Sequence[Surface], n_parameters: int) -> float:
        on = [len(part.inliers) for part in parts]
        widths = [max(part.rms / size, _EXACT) * np.sqrt(2.0 * np.pi * np.e) for part in parts]
        price = float(np.dot(on, np.log(np.minimum(widths, 1.0)))) if parts else 0.0
        n = max(len(on_any) / surface.correlation_area, 1.0)
        return price / surface.correlation_area + 0.5 * n_parameters * float(np.log(n))

    return cost([surface], N_PARAMETERS[surface.kind]) < cost(tiles, 3 * len(tiles))


def tiles_of(surfaces: Sequence[Surface], planes: Sequence[Plane]) -> list[Plane]:
    """Planes more than half of whose points are on some surfaces."""
    on_it = [surface.inliers for surface in surfaces]
    return [
        plane
        for plane in planes
        if 2 * np.isin(plane.inliers, np.concatenate(on_it)).sum() > len(plane.inliers)
    ]
