"""Worlds: solids with known truth, standing in an arena or on an open floor."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from primfit._check import Bools, Floats, Ints, frozen, integer, number, range_of
from primfit.polyhedron import Polyhedron
from primfit.random_polyhedra import POLYHEDRA, random_polyhedron
from primfit.solids import Prism

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Solid = Prism | Polyhedron

CELL = 0.01
"""Side of a cell of `World.mask` and `World.matrix`, metres."""

OPEN_FLOOR = 100.0
"""How far the floor of a world without an arena reaches beyond its solids, metres."""

NOTHING, ARENA, FLOOR = -1, -2, -3
"""What a beam hit when it was not a solid."""

COLORS = {
    "triangle": (214, 96, 77),
    "square": (67, 147, 195),
    "rectangle": (90, 174, 97),
    "pentagon": (153, 112, 171),
    "star": (224, 168, 45),
    "box": (90, 174, 97),
    "cube": (67, 147, 195),
    "wedge": (214, 96, 77),
    "pyramid": (224, 168, 45),
    "frustum": (153, 112, 171),
}
"""Colour of each kind in `World.matrix` and in pictures (red, green, blue)."""
OTHER_COLOR = (120, 120, 120)


@dataclass(frozen=True)
class Arena:
    """Walls around a rectangle whose corner is the origin.

    The inner faces stand at 0 and `size`; the walls have no thickness, since a sensor inside
    cannot see it.

    Parameters
    ----------
    size : float or (2,), metres
        Inner width (x) and depth (y).
    height : float, metres
        Height of the walls.
    """

    size: tuple[float, float] = (2.0, 2.0)
    height: float = field(default=0.3, kw_only=True)

    def __post_init__(self) -> None:
        size = (self.size, self.size) if np.ndim(self.size) == 0 else tuple(self.size)
        if len(size) != 2:
            raise ValueError(f"size must be a number or (width, depth), not {self.size!r}")
        width, depth = (number("size", value, above=0.0) for value in size)
        object.__setattr__(self, "size", (width, depth))
        object.__setattr__(self, "height", number("height", self.height, above=0.0))

    @property
    def outline(self) -> Floats:
        """Corners (4, 2) of the inside, counter-clockwise."""
        width, depth = self.size
        return np.array([[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]])


@dataclass(frozen=True, eq=False)
class World:
    """Solids on a floor at z = 0, with or without an arena around them.

    Parameters
    ----------
    solids : sequence of Prism and Polyhedron
        They may have any height and must not be inside each other for a scan to make sense; this
        is left to the caller.
    arena : Arena or None
        None leaves the floor open.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.World([primfit.Prism.regular(4, 0.3, center=(1, 1))], primfit.Arena())
    >>> world
    World(1 solid: square; arena 2 x 2 m)
    """

    solids: Sequence[Solid] = ()
    arena: Arena | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.solids, Iterable):
            raise TypeError(
                f"solids must be a sequence of Prism and Polyhedron, not {self.solids!r}"
            )
        solids = tuple(self.solids)
        for i, solid in enumerate(solids):
            if not isinstance(solid, Solid):
                raise TypeError(
                    f"solids[{i}] must be a Prism or a Polyhedron, not {type(solid).__name__}"
                )
        if self.arena is not None and not isinstance(self.arena, Arena):
            raise TypeError(f"arena must be an Arena or None, not {type(self.arena).__name__}")
        object.__setattr__(self, "solids", solids)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (2,) of the arena, or else of all solids; metres."""
        if self.arena is not None:
            return np.zeros(2), np.array(self.arena.size)
        if not self.solids:
            return np.zeros(2), np.zeros(2)
        corners = np.concatenate([solid.vertices[:, :2] for solid in self.solids])
        return corners.min(axis=0), corners.max(axis=0)

    @cached_property
    def mask(self) -> Bools:
        """Which cells solids cover: (rows, columns), row along y, column along x.

        The centre of cell [i, j] is at ``bounds[0] + ((j + 0.5) * CELL, (i + 0.5) * CELL)``.
        """
        return frozen(self._cells >= 0)

    @cached_property
    def matrix(self) -> NDArray[np.uint8]:
        """The map as an image (rows, columns, 3) of uint8: colour by kind, black for free."""
        colors = [COLORS.get(solid.kind, OTHER_COLOR) for solid in self.solids]
        palette = np.array([*colors, (0, 0, 0)], dtype=np.uint8)
        return frozen(palette[self._cells])

    @cached_property
    def _cells(self) -> Ints:
        low, high = self.bounds
        n_columns, n_rows = np.ceil((high - low) / CELL - 1e-9).astype(int)
        x = low[0] + (np.arange(n_columns) + 0.5) * CELL
        y = low[1] + (np.arange(n_rows) + 0.5) * CELL
        cells = np.full((n_rows, n_columns), -1, dtype=np.int64)
        for i, solid in enumerate(self.solids):
            cells[shapely.contains_xy(solid.shadow, x, y[:, None])] = i
        return cells

    @cached_property
    def _mesh(self) -> tuple[Floats, Ints, Ints]:
        parts = [(*solid.to_mesh(), i) for i, solid in enumerate(self.solids)]
        low, high = self.bounds
        if self.arena is not None:
            walls = Prism(self.arena.outline, self.arena.height)
            # The first triangles of a prism are its walls; seen from inside they turn around.
            parts.append((walls.vertices, walls.to_mesh()[1][:8, ::-1], ARENA))
        else:
            low, high = low - OPEN_FLOOR, high + OPEN_FLOOR
        floor = np.array(
            [[low[0], low[1], 0], [high[0], low[1], 0], [*high, 0], [low[0], high[1], 0]]
        )
        parts.append((floor, np.array([[0, 1, 2], [0, 2, 3]]), FLOOR))
        first = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
        return (
            frozen(np.concatenate([vertices for vertices, _, _ in parts])),
            frozen(
                np.concatenate([rows + i for (_, rows, _), i in zip(parts, first, strict=False)])
            ),
            frozen(np.concatenate([np.full(len(rows), index) for _, rows, index in parts])),
        )

    def to_mesh(self) -> tuple[Floats, Ints, Ints]:
        """All surfaces as triangles.

        Returns
        -------
        vertices : (v, 3) float64, metres
        triangles : (t, 3) int64
            Rows of `vertices`, counter-clockwise from the free side.
        solid_index : (t,) int64
            What each triangle belongs to: a row of `solids`, -2 the arena, -3 the floor. The
            floor of a world without an arena is a large square (see `OPEN_FLOOR`).
        """
        return self._mesh

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the map from above; needs matplotlib."""
        from primfit import plotting

        return plotting.plot_world(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """The world as plain numbers, for JSON."""
        arena = self.arena and {"size": list(self.arena.size), "height": self.arena.height}
        return {"solids": [solid.to_dict() for solid in self.solids], "arena": arena}

    def save(self, file: str | PathLike[str]) -> None:
        """Write the world as JSON; every number survives exactly."""
        Path(file).write_text(json.dumps({"primfit": "world", **self.to_dict()}, indent=1))

    @classmethod
    def load(cls, file: str | PathLike[str]) -> World:
        """Read a world that `save` wrote.

        Raises
        ------
        ValueError
            When the file is not one.
        """
        try:
            content = json.loads(Path(file).read_text())
            if content["primfit"] != "world":
                raise KeyError("primfit")
            arena = content["arena"] and Arena(**content["arena"])
            solids = [
                Prism(**solid) if "footprint" in solid else Polyhedron(**solid)
                for solid in content["solids"]
            ]
            return cls(solids, arena)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{file} is not a world that primfit wrote: {error!r}") from None

    def __repr__(self) -> str:
        kinds = ", ".join(solid.kind for solid in self.solids) or "empty"
        where = "no arena" if self.arena is None else "arena {:g} x {:g} m".format(*self.arena.size)
        return f"World({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; {where})"


class WorldFullError(ValueError):
    """No free place was found for another solid."""


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
}
"""Range of sizes, metres: sides; short sides of rectangles; outer radii of stars and polygons."""

RATIO = 1.8
"""Long side of a random rectangle over its short one."""


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
        at half the radius), "polygon" (5 to 8 corners at random bearings and radii); and polyhedra
        (see `random_polyhedron`): "box", "cube", "wedge", "pyramid", "frustum", "prism".
    rng : None, int or numpy.random.Generator
        Same `rng`, same world.
    sizes : dict of str to (low, high), metres
        Ranges that replace those of `SIZES` and `primfit.random_polyhedra.POLYHEDRA`.
    angles : (low, high), radians
        Range of rotation.
    height : float or (low, high), metres
        Height of the solids, but for polyhedra.
    wall_height : float, metres
        Height of the arena's walls.
    wall_distance : float, metres
        Least distance of a solid's vertices to the walls.
    buffer : float, metres
        The paper's p: how far each vertex is moved away from the centre for the overlap test.
    tilted : bool
        Whether polyhedra are turned anyhow, their lowest vertex on the floor; else they rest on a
        random one of the faces that hold them, and boxes and cubes become upright prisms.
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
    rng = np.random.default_rng(rng)
    sizes = sizes or {}
    kinds = list(kinds)
    known = SIZES | POLYHEDRA
    for name, chosen in (("kinds", kinds), ("sizes", list(sizes))):
        unknown = [kind for kind in chosen if kind not in known]
        if unknown or not kinds:
            raise ValueError(
                f"{name} must be taken from {', '.join(known)}; not {unknown or kinds}"
            )
    counts = range_of("n_solids", n_solids)
    if counts[0] < 0 or counts[0] % 1 or counts[1] % 1:
        raise ValueError(f"n_solids must be a count or a range of counts, not {n_solids!r}")
    limits = {kind: range_of(f"sizes[{kind!r}]", each, above=0.0) for kind, each in sizes.items()}
    ranges = known | limits
    turns, heights = range_of("angles", angles), range_of("height", height, above=0.0)
    wall_height = number("wall_height", wall_height, above=0.0)
    max_attempts = integer("max_attempts", max_attempts, low=1)
    wall_distance = number("wall_distance", wall_distance, low=0.0)
    buffer = number("buffer", buffer, low=0.0)
    arena = Arena(size, height=wall_height)  # type: ignore[arg-type]

    solids: list[Solid] = []
    for _ in range(rng.integers(int(counts[0]), int(counts[1]) + 1)):
        kind = kinds[rng.integers(len(kinds))]
        if kind in POLYHEDRA:
            loose = random_polyhedron(kind, ranges[kind], turns, rng, tilted=tilted)
            shape = shapely.get_coordinates(loose.shadow.exterior)[:-1]
            outline = _find_place(shape, solids, arena, wall_distance, buffer, max_attempts, rng)
            solids.append(loose.moved([*(outline[0] - shape[0]), 0.0]))
            continue
        shape = _random_footprint(kind, ranges[kind], rng.uniform(*turns), rng)
        tall = float(rng.uniform(*heights))
        outline = _find_place(shape, solids, arena, wall_distance, buffer, max_attempts, rng)
        solids.append(Prism(outline, tall))
    return World(solids, arena)


def _random_footprint(
    kind: str, limits: tuple[float, float], angle: float, rng: np.random.Generator
) -> Floats:
    size = rng.uniform(*limits)
    if kind == "rectangle":
        return Prism.rectangle(RATIO * size, size, angle=angle).footprint
    if kind == "star":
        return Prism.star(5, size, size / 2, angle=angle).footprint
    if kind == "polygon":
        n = int(rng.integers(5, 9))
        bearings = angle + 2 * np.pi * (np.arange(n) + rng.uniform(0.0, 0.7, n)) / n
        radii = size * rng.uniform(0.6, 1.0, n)
        return np.stack([radii * np.cos(bearings), radii * np.sin(bearings)], axis=1)
    n = next(n for n in range(3, 9) if Prism.regular(n, 1.0).kind == kind)
    return Prism.regular(n, size, angle=angle).footprint


def _find_place(
    shape: Floats,
    solids: Sequence[Solid],
    arena: Arena,
    wall_distance: float,
    buffer: float,
    max_attempts: int,
    rng: np.random.Generator,
) -> Floats:
    """The paper's PlaceShape: same kind and angle, new positions until one is legal."""
    others = shapely.MultiPolygon([solid.shadow for solid in solids])
    shape = shape - shape.mean(axis=0)
    grown = grow(shape, buffer)
    for _ in range(max_attempts):
        center = rng.uniform(0.0, arena.size)
        outline = shape + center
        inside = (outline >= wall_distance).all() and (
            outline <= np.array(arena.size) - wall_distance
        ).all()
        if inside and not shapely.Polygon(grown + center).intersects(others):
            return outline
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
