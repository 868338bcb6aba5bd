"""Random worlds (the paper's Algorithm 1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from primfit._check import Floats, generator, integer, number, range_of
from primfit.solids.prism import Prism
from primfit.solids.solid import Solid
from primfit.worlds.arena import Arena
from primfit.worlds.random_polyhedra import POLYHEDRA, random_polyhedron
from primfit.worlds.random_rounds import ROUNDS, random_round
from primfit.worlds.world import World

SIZES: dict[str, tuple[float, float]] = {
    "triangle": (0.18, 0.32),
    "square": (0.18, 0.32),
    "rectangle": (0.14, 0.22),
    "pentagon": (0.14, 0.22),
    "hexagon": (0.12, 0.18),
    "heptagon": (0.10, 0.16),
    "octagon": (0.09, 0.14),
    "star": (0.20, 0.24),
    "polygon": (0.12, 0.20),
    "circle": (0.10, 0.17),
    "ellipse": (0.07, 0.11),
}
"""Range of sizes, metres: sides; short sides of rectangles; outer radii of stars and polygons;
radii of circles; short semi-axes of ellipses."""

_MOST_SOLIDS = 1_000_000
"""More are taken for a mistake: they would take days to place."""

RATIO = 1.8
"""Long side of a random rectangle over its short one, and long axis of an ellipse likewise."""


class WorldFullError(ValueError):
    """No free place was found for another solid."""


def random_world(
    n_solids: int | tuple[int, int] = (5, 7),
    size: float | tuple[float, float] = 2.0,
    kinds: Sequence[str] = ("triangle", "square", "rectangle", "pentagon"),
    rng: Any = None,
    *,
    sizes: dict[str, tuple[float, float]] | None = None,
    angles: tuple[float, float] = (0.0, 2 * np.pi),
    height: float | tuple[float, float] = 0.2,
    wall_height: float = 0.3,
    wall_distance: float = 0.12,
    buffer: float = 0.06,
    tilted: bool = True,
    max_attempts: int = 10_000,
) -> World:
    """A random world (the paper's Algorithm 1, equations 1 to 7).

    A solid has a random kind, size and angle; it gets random positions until all its vertices are
    inside the arena, at least `wall_distance` from the walls, and its outline, grown by `buffer`,
    overlaps no other solid.

    Parameters
    ----------
    n_solids : int or (int, int)
        How many; a range includes both ends.
    size : float or (2,), metres
        Inner size of the arena.
    kinds : sequence of str
        Kinds to choose from, alike likely: "triangle", "square", "pentagon" to "octagon",
        "rectangle" (its long side is `RATIO` times the short one), "star" (five tips, the notches
        at half the radius), "polygon" (5 to 8 corners at random bearings and radii), "circle",
        "ellipse" (its long axis is `RATIO` times the short one); and polyhedra (see
        `random_polyhedron`): "box", "cube", "wedge", "pyramid", "frustum", "prism"; and round
        solids (see `random_round`): "cylinder", "cone", "sphere".
    rng : None, int or numpy.random.Generator
        Same `rng`, same world.
    sizes : dict of str to (low, high), metres
        Ranges that replace those of `SIZES`, `random_polyhedra.POLYHEDRA` and
        `random_rounds.ROUNDS`.
    angles : (low, high), radians
        Range of rotation.
    height : float or (low, high), metres
        Height of the solids, but for polyhedra and round ones.
    wall_height : float, metres
        Height of the arena's walls.
    wall_distance : float, metres
        Least distance of a solid's vertices to the walls.
    buffer : float, metres
        The paper's p: how far each vertex is moved away from the centre for the overlap test.
    tilted : bool
        Whether polyhedra and round solids are turned anyhow, their lowest point on the floor; else
        polyhedra rest on a random one of the faces that hold them, boxes and cubes become upright
        prisms, and cylinders and cones stand on their base.
    max_attempts : int
        Positions to try for one solid.

    Returns
    -------
    World

    Raises
    ------
    WorldFullError
        When no place is found for a solid; it is a ValueError.

    Examples
    --------
    >>> import primfit
    >>> primfit.random_world(3, rng=1)
    World(3 solids: square, rectangle, square; arena 2 x 2 m)
    """
    rng = generator(rng)
    if not isinstance(sizes, Mapping | None):
        raise TypeError(f"sizes must be a mapping of kinds to sizes, not {sizes!r}")
    sizes = sizes or {}
    known = SIZES | POLYHEDRA | ROUNDS
    kinds = kinds_of("kinds", kinds, known)
    if sizes:
        kinds_of("sizes", sizes, known)
    fewest, most = counts_of(n_solids)
    limits = {kind: range_of(f"sizes[{kind!r}]", each, above=0.0) for kind, each in sizes.items()}
    ranges = known | limits
    turns, heights = range_of("angles", angles), range_of("height", height, above=0.0)
    wall_height = number("wall_height", wall_height, above=0.0)
    max_attempts = integer("max_attempts", max_attempts, low=1)
    wall_distance = number("wall_distance", wall_distance, low=0.0)
    buffer = number("buffer", buffer, low=0.0)
    arena = Arena(size, height=wall_height)  # type: ignore[arg-type]

    solids: list[Solid] = []
    for _ in range(rng.integers(fewest, most + 1)):
        kind = kinds[rng.integers(len(kinds))]
        if kind in POLYHEDRA or kind in ROUNDS:
            loose = (
                random_polyhedron(kind, ranges[kind], turns, rng, tilted=tilted)
                if kind in POLYHEDRA
                else random_round(kind, ranges[kind], rng, tilted=tilted)
            )
            shape = shapely.get_coordinates(loose.shadow.exterior)[:-1]
            outline = find_place(shape, solids, arena, wall_distance, buffer, max_attempts, rng)
            solids.append(loose.moved([*(outline[0] - shape[0]), 0.0]))
            continue
        shape = _random_footprint(kind, ranges[kind], rng.uniform(*turns), rng)
        tall = float(rng.uniform(*heights))
        outline = find_place(shape, solids, arena, wall_distance, buffer, max_attempts, rng)
        solids.append(Prism(outline, tall))
    return World(solids, arena)


def kinds_of(name: str, kinds: Iterable[str], known: Iterable[str]) -> list[str]:
    """The kinds that an argument names: at least one, all of them known."""
    if not isinstance(kinds, Iterable) or isinstance(kinds, np.ndarray):
        raise TypeError(f"{name} must be a sequence of names, not {kinds!r}")
    kinds, known = list(kinds), list(known)
    if not all(isinstance(kind, str) for kind in kinds):
        raise TypeError(f"{name} must be a sequence of names, not {kinds!r}")
    unknown = [kind for kind in kinds if kind not in known]
    if unknown or not kinds:
        raise ValueError(f"{name} must be taken from {', '.join(known)}; not {unknown or kinds}")
    return kinds


def counts_of(n_solids: int | tuple[int, int]) -> tuple[int, int]:
    """Least and largest number of solids that an argument `n_solids` allows."""
    low, high = range_of("n_solids", n_solids)
    if low < 0 or low % 1 or high % 1 or high > _MOST_SOLIDS:
        raise ValueError(
            f"n_solids must be a count or a range of counts up to {_MOST_SOLIDS}, not {n_solids!r}"
        )
    return int(low), int(high)


def _random_footprint(
    kind: str, limits: tuple[float, float], angle: float, rng: np.random.Generator
) -> Floats:
    size = rng.uniform(*limits)
    if kind == "rectangle":
        return Prism.rectangle(RATIO * size, size, angle=angle).footprint
    if kind == "circle":
        return Prism.circle(size).footprint
    if kind == "ellipse":
        return Prism.ellipse(RATIO * size, size, angle=angle).footprint
    if kind == "star":
        return Prism.star(5, size, size / 2, angle=angle).footprint
    if kind == "polygon":
        n = int(rng.integers(5, 9))
        bearings = angle + 2 * np.pi * (np.arange(n) + rng.uniform(0.0, 0.7, n)) / n
        radii = size * rng.uniform(0.6, 1.0, n)
        return np.stack([radii * np.cos(bearings), radii * np.sin(bearings)], axis=1)
    n = next(n for n in range(3, 9) if Prism.regular(n, 1.0).kind == kind)
    return Prism.regular(n, size, angle=angle).footprint


def find_place(
    shape: Floats,
    solids: Sequence[Solid],
    arena: Arena,
    wall_distance: float,
    buffer: float,
    max_attempts: int,
    rng: np.random.Generator,
    *,
    grown_inside: bool = False,
) -> Floats:
    """The paper's PlaceShape: same kind and angle, new positions until one is legal.

    `grown_inside` asks that the outline grown by `buffer` keep the distance to the walls, too.
    """
    others = shapely.MultiPolygon([solid.shadow for solid in solids])
    shape = shape - shape.mean(axis=0)
    grown = grow(shape, buffer)
    for _ in range(max_attempts):
        center = rng.uniform(0.0, arena.size)
        kept = (grown if grown_inside else shape) + center
        inside = (kept >= wall_distance).all() and (
            kept <= np.array(arena.size) - wall_distance
        ).all()
        if inside and not shapely.Polygon(grown + center).intersects(others):
            return shape + center
    raise WorldFullError(
        f"no place for solid {len(solids) + 1} after max_attempts={max_attempts} positions in an "
        f"arena of {arena.size[0]:g} x {arena.size[1]:g} m: ask for fewer (n_solids) or smaller "
        f"solids (sizes), a larger arena (size), or less wall_distance ({wall_distance:g} m) or "
        f"buffer ({buffer:g} m)"
    )


def grow(footprint: ArrayLike, buffer: float) -> Floats:
    """Outline (m, 2) with every vertex moved away from the mean by `buffer` (equations 3 to 7)."""
    outline = np.asarray(footprint, dtype=float)
    center = outline.mean(axis=0)
    delta = outline - center
    distance = np.linalg.norm(delta, axis=1, keepdims=True)
    grown: Floats = center + delta * (distance + buffer) / distance
    return grown
