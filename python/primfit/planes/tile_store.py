"""Points by the square tile that they lie in, in memory or in files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import numpy as np

from primfit._check import Floats, Ints

Tile = tuple[int, int]
"""Column and row of a square, counted from x = 0 and y = 0."""


class TileStore(Protocol):
    """Points of tiles; `sizes` has the number of points of each tile that has any."""

    sizes: dict[Tile, int]

    def own(self, tile: Tile) -> tuple[Ints, Floats]:
        """Rows of the input, rising, and points (n, 3) of a tile; none where there is no tile."""
        ...


def tiles_of(points: Floats, side: float) -> Ints:
    """The tile (n, 2) of each point."""
    return np.floor(points[:, :2] / side).astype(np.int64)


def groups(points: Floats, side: float) -> Iterable[tuple[Tile, Ints]]:
    """Each tile of some points with the places of its points, rising."""
    at = tiles_of(points, side)
    order = np.lexsort(at.T)
    is_new = np.ones(len(order), dtype=bool)
    is_new[1:] = (np.diff(at[order], axis=0) != 0).any(axis=1)
    starts = np.flatnonzero(is_new)
    for places in np.split(order, starts[1:]) if len(order) else ():
        column, row = at[places[0]].tolist()
        yield (column, row), places


def with_halo(store: TileStore, tile: Tile, side: float, halo: float) -> tuple[Ints, Floats, int]:
    """Rows and points of a tile, and after them those of its neighbours no farther off than `halo`.

    Returns
    -------
    rows, points : (n,) int64, (n, 3) float64
    n_own : int
        How many of them are the tile's own.
    """
    parts = [store.own(tile)]
    low = np.array(tile) * side - halo
    high = (np.array(tile) + 1) * side + halo
    for column in (-1, 0, 1):
        for row in (-1, 0, 1):
            if column or row:
                rows, points = store.own((tile[0] + column, tile[1] + row))
                is_near = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
                parts.append((rows[is_near], points[is_near]))
    rows, points = (np.concatenate(each) for each in zip(*parts, strict=True))
    return rows, points, len(parts[0][0])


class InMemory:
    """Tiles of points that are in memory; `rows` are theirs in the input."""

    def __init__(self, points: Floats, rows: Ints, side: float) -> None:
        self._points, self._rows = points, rows
        self._places = dict(groups(points, side))
        self.sizes = {tile: len(places) for tile, places in self._places.items()}

    def own(self, tile: Tile) -> tuple[Ints, Floats]:
        """As `TileStore` has it."""
        places = self._places.get(tile, np.empty(0, dtype=np.int64))
        return self._rows[places], self._points[places]


class InFiles:
    """Tiles of points that come in parts, each tile in a file of a folder."""

    _RECORD = np.dtype([("row", "<i8"), ("point", "<f8", 3)])

    def __init__(self, folder: Path, side: float) -> None:
        self._folder, self._side = folder, side
        self.sizes: dict[Tile, int] = {}

    def add(self, points: Floats, rows: Ints) -> None:
        """Take in some more points, whose rows are above those before."""
        for tile, places in groups(points, self._side):
            records = np.empty(len(places), self._RECORD)
            records["row"], records["point"] = rows[places], points[places]
            with self._file(tile).open("ab") as file:
                records.tofile(file)
            self.sizes[tile] = self.sizes.get(tile, 0) + len(places)

    def own(self, tile: Tile) -> tuple[Ints, Floats]:
        """As `TileStore` has it."""
        if tile not in self.sizes:
            return np.empty(0, dtype=np.int64), np.empty((0, 3))
        records = np.fromfile(self._file(tile), self._RECORD)
        return np.ascontiguousarray(records["row"]), np.ascontiguousarray(records["point"])

    def _file(self, tile: Tile) -> Path:
        return self._folder / f"{tile[0]}_{tile[1]}.tile"
