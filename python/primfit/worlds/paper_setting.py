"""Worlds and paths as the paper's authors had them, which the paper itself leaves open."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from primfit._check import Floats, choice, generator, instance, integer, number
from primfit.geometry.footprints import angle_of, clean_footprint, sides, size_of
from primfit.solids.prism import Prism
from primfit.worlds.arena import Arena
from primfit.worlds.paths import counts_along, is_free
from primfit.worlds.random_worlds import counts_of, find_place, kinds_of
from primfit.worlds.world import World

ARENA_SIZE = 10.0
"""Inner width and depth of the paper's arena, metres."""

HEIGHT = 0.05
"""Height of its walls and solids, metres."""

SIZES_MM = (800, 1100)
"""Range of sizes, whole millimetres: side, long side of a rectangle, diameter of a star."""

RATIOS = (0.25, 0.75)
"""Range of the short side of a rectangle over its long one."""

BUFFER, WALL_DISTANCE = 1.0, 0.3
"""The paper's p, and the least distance of outlines grown by it to the walls; metres."""

LARGEST_ANGLES_DEG = {"triangle": 60, "square": 45, "rectangle": 45, "pentagon": 36, "star": 36}
"""Kinds, with the largest angle of each, whole degrees."""


def paper_world(
    n_solids: int | tuple[int, int] = (5, 7),
    rng: Any = None,
    *,
    kinds: Sequence[str] = ("triangle", "square", "rectangle", "pentagon"),
    max_attempts: int = 10_000,
) -> World:
    """A random world as the paper's authors made them.

    An arena of 10 x 10 m, its walls 5 cm high; solids as high, of sizes from 0.80 to 1.10 m in
    whole millimetres, turned by whole degrees from zero up to 60 (triangle), 45 (square,
    rectangle) or 36 (pentagon). Outlines grown by p = 1 m stay 0.3 m from the walls and off the
    solids that stand already.

    Parameters
    ----------
    n_solids : int or (int, int)
        How many; a range includes both ends.
    rng : None, int or numpy.random.Generator
        Same `rng`, same world.
    kinds : sequence of str
        Kinds to choose from, alike likely: "triangle", "square", "rectangle" (the size is its long
        side, the short one a quarter to three quarters of it), "pentagon", and "star", which stands
        for the one that the authors drew by hand: five tips, the size across, notches at half the
        radius.
    max_attempts : int
        Positions to try for one solid.

    Returns
    -------
    World
        The outlines as they are stated; `built_of_walls` makes of them what the sensor sees.

    Raises
    ------
    WorldFullError
        When no place is found for a solid; it is a ValueError.

    Examples
    --------
    >>> import primfit
    >>> primfit.paper_world(rng=1)
    World(6 solids: rectangle, square, rectangle, triangle, pentagon, square; arena 10 x 10 m)
    """
    rng = generator(rng)
    fewest, most = counts_of(n_solids)
    kinds = kinds_of("kinds", kinds, LARGEST_ANGLES_DEG)
    max_attempts = integer("max_attempts", max_attempts, low=1)
    arena = Arena((ARENA_SIZE, ARENA_SIZE), height=HEIGHT)
    solids: list[Prism] = []
    for _ in range(rng.integers(fewest, most + 1)):
        shape = _footprint(kinds[int(rng.integers(len(kinds)))], rng)
        outline = find_place(
            shape, solids, arena, WALL_DISTANCE, BUFFER, max_attempts, rng, grown_inside=True
        )
        solids.append(Prism(outline, HEIGHT))
    return World(solids, arena)


_CORNERS = {"triangle": 3, "square": 4, "pentagon": 5}
_ROUNDED = 0.01
"""Relative difference of sides, and of angles, that whole millimetres make."""


def read_paper_map(file: str | PathLike[str]) -> World:
    """A map from the ground truth that the paper's authors publish, as a comma-separated table.

    Its corners are whole millimetres; the solids here are the exact ones that are meant, with equal
    sides or right angles, turned by whole degrees.

    Parameters
    ----------
    file : str or path
        With the columns Shape and Vertices, ``(x,y);(x,y);...`` in millimetres.

    Returns
    -------
    World

    Raises
    ------
    ValueError
        When the file is not one.
    """
    solids = []
    try:
        with Path(file).open(newline="") as stream:
            for row in csv.DictReader(stream):
                corners = [pair.strip("()").split(",") for pair in row["Vertices"].split(";")]
                solids.append(_exact(row["Shape"], np.array(corners, dtype=float) / 1000))
    except KeyError as error:
        raise ValueError(f"{file} is not a map of the paper: it lacks {error}") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{file} is not a map of the paper: {error}") from None
    return World(solids, Arena((ARENA_SIZE, ARENA_SIZE), height=HEIGHT))


def _exact(kind: str, corners: Floats) -> Prism:
    """The solid whose corners, rounded, are those given."""
    choice("Shape", kind, ["rectangle", *_CORNERS])
    outline = clean_footprint(corners, "Vertices")
    place = {
        "center": outline.mean(axis=0),
        "angle": np.radians(np.rint(np.degrees(angle_of(outline, kind, _ROUNDED)))),
        "height": HEIGHT,
    }
    size = np.atleast_1d(size_of(outline, kind)).tolist()
    if kind == "rectangle":
        return Prism.rectangle(*size, **place)
    return Prism.regular(_CORNERS[kind], *size, **place)


def _footprint(kind: str, rng: np.random.Generator) -> Floats:
    size = rng.integers(*SIZES_MM, endpoint=True) / 1000
    angle = np.radians(rng.integers(LARGEST_ANGLES_DEG[kind], endpoint=True))
    if kind == "rectangle":
        return Prism.rectangle(size, rng.uniform(*RATIOS) * size, angle=angle).footprint
    if kind == "star":
        return Prism.star(5, size / 2, size / 4, angle=angle).footprint
    return Prism.regular(_CORNERS[kind], size, angle=angle).footprint


def built_of_walls(world: World, thickness: float = 0.05) -> World:
    """The world as the paper's authors built it: each side of a prism is a wall of its own.

    The walls are centred on the sides and longer than these by the thickness, so that they cross
    at the corners. What can be seen of such a ring from outside is its outer boundary, and the
    prisms here are over that: half the thickness outside the stated outline, with exact corners
    where these are right angles, and small notches and tips elsewhere. Scan this world, and compare
    what is found with the stated one.

    Parameters
    ----------
    world : World
        Of prisms; its arena stays.
    thickness : float, metres
        Of the walls.

    Returns
    -------
    World

    Examples
    --------
    >>> import primfit
    >>> world = primfit.World([primfit.Prism.rectangle(1.0, 0.6, height=0.05)])
    >>> primfit.built_of_walls(world).solids[0]
    Prism(rectangle, center=(0.000, 0.000), size=1.050, 0.650 m, angle=0.00 deg, height=0.05 m)
    """
    instance("world", world, World)
    thickness = number("thickness", thickness, above=0.0)
    built = []
    for i, solid in enumerate(world.solids):
        if not isinstance(solid, Prism):
            raise TypeError(f"world.solids[{i}] must be a Prism, not {type(solid).__name__}")
        boundary = _ring_boundary(solid.footprint, thickness)
        built.append(Prism(boundary, solid.height, base=solid.base))
    return World(built, world.arena)


def _ring_boundary(footprint: Floats, thickness: float) -> Floats:
    """Outer boundary (m, 2) of walls along the sides of a footprint."""
    along = sides(footprint)
    reach = thickness / 2 * along / np.linalg.norm(along, axis=1, keepdims=True)
    across = reach @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    start, end = footprint - reach, footprint + along + reach
    corners = np.stack([start - across, end - across, end + across, start + across], axis=1)
    return shapely.get_coordinates(shapely.union_all(shapely.polygons(corners)).exterior)


def paper_path(world: World, spacing: float = 0.2) -> Floats:
    """The path of the paper's robot: back and forth over the whole arena, one heading.

    Positions begin half a `spacing` from the lower corner of the bounds and go along x, there and
    back; those inside a solid or outside the arena are left out.

    Parameters
    ----------
    world : World
    spacing : float, metres
        Distance between neighbouring positions; the paper's authors have 0.2.

    Returns
    -------
    path : (n, 3) float64
        x, y in metres and a yaw of zero.

    Raises
    ------
    ValueError
        When no position is free.

    Examples
    --------
    >>> import primfit
    >>> path = primfit.paper_path(primfit.paper_world(rng=1))
    >>> path[:3].round(3)
    array([[0.1, 0.1, 0. ],
           [0.3, 0.1, 0. ],
           [0.5, 0.1, 0. ]])
    """
    instance("world", world, World)
    spacing = number("spacing", spacing, above=0.0)
    low, high = world.bounds
    counts_along(high - low, spacing)
    x, y = (np.arange(low[k] + spacing / 2, high[k], spacing) for k in (0, 1))
    rows = np.stack(np.meshgrid(x, y), axis=-1)
    rows[1::2] = rows[1::2, ::-1]
    positions = rows.reshape(-1, 2)
    positions = positions[is_free(world, positions)]
    if not len(positions):
        raise ValueError(
            f"the path has no valid pose: no position with spacing={spacing:g} m is free in "
            f"{world!r}"
        )
    return np.insert(positions, 2, 0.0, axis=1)
