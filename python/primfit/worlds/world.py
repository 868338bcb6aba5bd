"""Worlds: solids with known truth, standing in an arena or on an open floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from primfit._check import Bools, Floats, Ints
from primfit._files import as_path, replacing
from primfit.geometry.footprints import clean_footprint, triangulate
from primfit.solids.prism import Prism
from primfit.solids.solid import Solid
from primfit.viewing.shown import Shown
from primfit.worlds.arena import Arena
from primfit.worlds.meshes import as_solid, solids_of_mesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    "circle": (53, 151, 143),
    "ellipse": (197, 27, 125),
    "box": (90, 174, 97),
    "cube": (67, 147, 195),
    "wedge": (214, 96, 77),
    "pyramid": (224, 168, 45),
    "frustum": (153, 112, 171),
    "cylinder": (53, 151, 143),
    "cone": (140, 81, 10),
    "sphere": (197, 27, 125),
    "torus": (118, 42, 131),
}
"""Colour of each kind in `World.matrix` and in pictures (red, green, blue)."""
OTHER_COLOR = (120, 120, 120)
OUTSIDE_COLOR = (60, 60, 60)


@dataclass(frozen=True, eq=False)
class World(Shown):
    """Solids on a floor at z = 0, with or without an arena around them.

    Parameters
    ----------
    solids : sequence of Solid
        Prisms, polyhedra, cylinders, cones, spheres and tori; also what `detect` found, or closed
        meshes, as those of trimesh. They may have any height
        and must not be inside each other for a scan to make sense; this is left to the caller.
    arena : Arena or None
        None leaves the floor open.
    left_out : mapping of str to int
        How many nodes of which kind the file had that are no solids, as a robot.

    Examples
    --------
    >>> import primfit
    >>> world = primfit.World([primfit.Prism.regular(4, 0.3, center=(1, 1))], primfit.Arena())
    >>> world
    World(1 solid: square; arena 2 x 2 m)
    """

    solids: Sequence[Solid] = ()
    arena: Arena | None = None
    left_out: Mapping[str, int] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        try:
            solids = tuple(self.solids)
        except TypeError:
            raise TypeError(
                f"solids must be a sequence of Prism, Polyhedron and others, not {self.solids!r}"
            ) from None
        taken: list[Solid] = []
        for i, given in enumerate(solids):
            solid = as_solid(given)
            if solid is None:
                raise TypeError(
                    f"solids[{i}] must be a Prism, a Polyhedron or another solid, not "
                    f"{type(given).__name__}"
                )
            taken.append(solid)
        if self.arena is not None and not isinstance(self.arena, Arena):
            raise TypeError(f"arena must be an Arena or None, not {type(self.arena).__name__}")
        object.__setattr__(self, "solids", tuple(taken))

    @classmethod
    def from_mesh(cls, mesh: Any, arena: Arena | None = None) -> World:
        """The world whose solids are the connected parts of a mesh.

        Parameters
        ----------
        mesh : (vertices (v, 3), triangles (t, 3)), or a mesh of trimesh or Open3D
            Each part must be closed; vertices of one place are one. Metres, z up.
        arena : Arena or None

        Raises
        ------
        TypeError, ValueError
            When it is no mesh, or a part encloses nothing.

        Examples
        --------
        >>> import primfit
        >>> boxes = [primfit.Polyhedron.box(0.3, 0.2, 0.1, center=(x, 0, 0.05)) for x in (0, 1)]
        >>> vertices, triangles, of = primfit.World(boxes).to_mesh()
        >>> primfit.World.from_mesh((vertices, triangles[of >= 0]))
        World(2 solids: rectangle, rectangle; no arena)
        """
        return cls(solids_of_mesh(mesh), arena)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (2,) of the arena, or else of all solids; metres."""
        if self.arena is not None:
            return self.arena.bounds
        if not self.solids:
            return np.zeros(2), np.zeros(2)
        lows, highs = zip(*(solid.bounds for solid in self.solids), strict=True)
        return np.min(lows, axis=0)[:2], np.max(highs, axis=0)[:2]

    @property
    def mask(self) -> Bools:
        """Which cells are not free: (rows, columns), row along y, column along x.

        These are the cells that solids cover, and those outside an arena that does not fill its
        bounds. The centre of cell [i, j] is at
        ``bounds[0] + ((j + 0.5) * CELL, (i + 0.5) * CELL)``.
        """
        return self._cells != NOTHING

    @property
    def matrix(self) -> NDArray[np.uint8]:
        """The map as an image (rows, columns, 3) of uint8: colour by kind, black for free.

        Grey is outside of the arena.
        """
        colors = [COLORS.get(solid.kind, OTHER_COLOR) for solid in self.solids]
        # The last two are those of the arena, -2, and of nothing, -1.
        palette = np.array([*colors, OUTSIDE_COLOR, (0, 0, 0)], dtype=np.uint8)
        return palette[self._cells]

    @cached_property
    def _cells(self) -> Ints:
        """What covers each cell: row of a solid, the arena where outside of it, or nothing."""
        low, high = self.bounds
        n_columns, n_rows = np.ceil((high - low) / CELL - 1e-9).astype(int)
        x = low[0] + (np.arange(n_columns) + 0.5) * CELL
        y = low[1] + (np.arange(n_rows) + 0.5) * CELL
        cells = np.full((n_rows, n_columns), NOTHING, dtype=np.int64)
        if self.arena is not None and not self.arena.is_rectangle_of_size:
            cells[~shapely.contains_xy(self.arena.shadow, x, y[:, None])] = ARENA
        for i, solid in enumerate(self.solids):
            cells[shapely.contains_xy(solid.shadow, x, y[:, None])] = i
        return cells

    @cached_property
    def _mesh(self) -> tuple[Floats, Ints, Ints]:
        parts = [(*solid.to_mesh(), i) for i, solid in enumerate(self.solids)]
        if self.arena is not None:
            walls = Prism(self.arena.outline, self.arena.height)
            # The first triangles of a prism are its walls; seen from inside they turn around.
            n = 2 * len(self.arena.outline)
            parts.append((walls.vertices, walls.to_mesh()[1][:n, ::-1], ARENA))
            floor = self.arena.outline
        else:
            low, high = self.bounds
            around = shapely.box(*(low - OPEN_FLOOR), *(high + OPEN_FLOOR))
            floor = clean_footprint(shapely.get_coordinates(around))
        parts.append((np.insert(floor, 2, 0.0, axis=1), triangulate(floor), FLOOR))
        first = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
        return (
            np.concatenate([vertices for vertices, _, _ in parts]),
            np.concatenate([rows + i for (_, rows, _), i in zip(parts, first, strict=False)]),
            np.concatenate([np.full(len(rows), index) for _, rows, index in parts]),
        )

    def to_mesh(self) -> tuple[Floats, Ints, Ints]:
        """All surfaces as triangles; of round solids those of the meshes that stand for them.

        Returns
        -------
        vertices : (v, 3) float64, metres
        triangles : (t, 3) int64
            Rows of `vertices`, counter-clockwise from the free side.
        solid_index : (t,) int64
            What each triangle belongs to: a row of `solids`, -2 the arena, -3 the floor. The
            floor of a world without an arena is a large square (see `OPEN_FLOOR`).
        """
        vertices, triangles, solid_index = self._mesh
        return vertices.copy(), triangles.copy(), solid_index.copy()

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the map from above; needs matplotlib."""
        from primfit import plotting

        return plotting.plot_world(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """The world as plain numbers, for JSON."""
        return {
            "solids": [solid.to_dict() for solid in self.solids],
            "arena": self.arena and self.arena.to_dict(),
        }

    def save(self, file: str | PathLike[str]) -> None:
        """Write the world in the format of the suffix; every number survives exactly.

        Parameters
        ----------
        file : path
            .json; .wbt of Webots (R2023b and later); .xml, the MJCF of MuJoCo, whose static geoms
            are called "solid-0", "wall-0" and "floor"; .glb, which is only written.

        Raises
        ------
        OSError
            When there is no such folder, or no room.
        ValueError
            When the suffix is another.
        ModuleNotFoundError
            For .glb, when the extra ``files`` is not installed.
        """
        path = as_path(file)
        module = _format_of(path)
        with replacing(path) as part:
            module.write(part, self)

    @classmethod
    def load(cls, file: str | PathLike[str]) -> World:
        """Read a world that `save` wrote, or one of Webots.

        Parameters
        ----------
        file : path
            .json; .wbt of any release, with y or z up, of which solids and arena are taken: boxes,
            cylinders, spheres, cones and closed meshes in nodes that place them, RectangleArena,
            Wall, SolidBox, CardboardBox and WoodenBox. The floor of the arena is at z = 0 then.
            What else there is, as a robot, is counted in `left_out`. .xml, if `save` wrote it.

        Raises
        ------
        OSError
            When the file cannot be opened.
        ValueError
            When it is no such world.
        """
        path = as_path(file)
        path.open("rb").close()
        try:
            module = _format_of(path)
            if not hasattr(module, "read"):
                raise ValueError(f"{path.suffix} is only written")
            world: World = module.read(path)
            return world
        except MemoryError:
            raise
        except Exception as error:
            # What is wrong with numbers and nesting is found in many a place.
            why = f"it lacks {error}" if isinstance(error, KeyError) else error
            raise ValueError(f"{file} is not a world that primfit reads: {why}") from None

    def __repr__(self) -> str:
        kinds = ", ".join(solid.kind for solid in self.solids) or "empty"
        where = "no arena" if self.arena is None else f"arena {self.arena.description}"
        return f"World({len(self.solids)} solid{'s' * (len(self.solids) != 1)}: {kinds}; {where})"


def _format_of(path: Path) -> Any:
    """The module for the suffix of a file."""
    from primfit.worlds.formats import glb, mjcf, plain, wbt

    formats = {".json": plain, ".wbt": wbt, ".xml": mjcf, ".glb": glb}
    if path.suffix.lower() not in formats:
        raise ValueError(f"file must end in one of {', '.join(formats)}, not {path.name!r}")
    return formats[path.suffix.lower()]
