"""PCD, versions .5 to .7: text, binary, and binary compressed by LZF.

Written here, since the library for it makes a name for each number of a field before it looks
whether the file holds them, reads text with single blanks only, and no version before .7.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from primfit import _primfit
from primfit.clouds.cloud import (
    Cloud,
    Columns,
    cloud_of,
    columns_of,
    table_of,
    without_packed_colors,
)

_NORMAL = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
_TYPES = {"I": "1248", "U": "1248", "F": "48"}
"""Sizes in bytes of each type."""

_MOST_PACKED = 88
"""Bytes that LZF makes of one at most: 264 of 3."""

_TWO_SIZES = struct.Struct("<II")
"""Bytes of the data as they are compressed, and as they are not."""

_SIZES = ("WIDTH", "HEIGHT", "POINTS")
_FIRST = ("VERSION", "FIELDS", "COLUMNS", "#")
"""How a file begins."""


@dataclass(frozen=True)
class Head:
    """The header: fields with their types and widths, number of points, and where they begin."""

    fields: list[tuple[str, np.dtype[np.generic], int]]
    shape: tuple[int, int]
    data: str
    start: int

    @property
    def n_points(self) -> int:
        """How many points there should be."""
        return self.shape[0] * self.shape[1]

    @property
    def row_size(self) -> int:
        """Bytes of a point."""
        return sum(kind.itemsize * count for _, kind, count in self.fields)


def read(path: Path) -> Cloud:
    """All fields; packed colours are unpacked."""
    content = path.read_bytes()
    head = _head_of(content)
    if head.data == "ascii":
        columns = _columns_of_text(content, head)
    elif head.data == "binary":
        columns = _columns_of_rows(content, head)
    else:
        columns = _columns_of_packed(content, head)
    return cloud_of(without_packed_colors(columns), head.shape if head.shape[0] > 1 else None)


def _head_of(content: bytes) -> Head:
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries and (end := content.find(b"\n", at)) >= 0:
        words = content[at:end].decode("ascii", "replace").split()
        if at == 0 and not (words and words[0].startswith(_FIRST)):
            break
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
        at = end + 1
    if "DATA" not in entries:
        raise ValueError("its header has no line DATA")
    data = " ".join(entries["DATA"]).lower()
    if data not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA must be ascii, binary or binary_compressed, not {data[:40]!r}")
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    sizes = _values(entries, "SIZE", names, "4")
    types = _values(entries, "TYPE", names, "F")
    # Some writers count the one number of a field as 0.
    counts = [max(_whole("COUNT", each), 1) for each in _values(entries, "COUNT", names, "1")]
    for size, kind in zip(sizes, types, strict=True):
        if size not in _TYPES.get(kind.upper(), ""):
            raise ValueError(f"TYPE, SIZE must be I or U, 1 2 4 8, or F, 4 8: not {kind}, {size}")
    kinds = [np.dtype(f"<{k.lower()}{size}") for k, size in zip(types, sizes, strict=True)]
    return Head(list(zip(names, kinds, counts, strict=True)), _shape_of(entries), data, at)


def _values(entries: dict[str, list[str]], key: str, names: list[str], default: str) -> list[str]:
    values = entries.get(key, [default] * len(names))
    if len(values) != len(names):
        raise ValueError(f"{key} must have {len(names)} values, as FIELDS has, not {len(values)}")
    return values


def _shape_of(entries: dict[str, list[str]]) -> tuple[int, int]:
    """Height and width."""
    sizes = {key: _whole(key, " ".join(entries[key])) for key in _SIZES if key in entries}
    height = sizes.get("HEIGHT", 1)
    n_points = sizes.get("POINTS", height * sizes.get("WIDTH", 0))
    width = sizes.get("WIDTH", n_points // max(height, 1))
    if width * height != n_points:
        raise ValueError(f"POINTS must be WIDTH x HEIGHT, {width} x {height}, not {n_points}")
    return height, width


def _whole(key: str, text: str) -> int:
    if not text.isdecimal():
        raise ValueError(f"{key} must be a whole number of at least 0, not {text[:40]!r}")
    return int(text)


def _columns_of_text(content: bytes, head: Head) -> Columns:
    n_words = sum(count for _, _, count in head.fields)
    if head.n_points * 2 * n_words > len(content) - head.start + 1:
        raise ValueError(
            f"it has {len(content) - head.start} bytes for {head.n_points} x {n_words} numbers"
        )
    if not head.n_points:
        return _columns_of_rows(content, head)
    first = content[head.start : content.find(b"\n", head.start)]
    separator = next((mark for mark in b",;" if mark in first), None)
    line = content.count(b"\n", 0, head.start) + 1
    columns: Columns = {}
    at = 0
    for name, kind, count in head.fields:
        # Only whole numbers of 64 bits may be none of float64.
        way = kind.kind if kind.itemsize == 8 else "f"
        table = _primfit.parse_rows(
            content, head.start, line, n_words, list(range(at, at + count)), way, separator
        )
        if len(table) != head.n_points:
            raise ValueError(f"it holds {len(table)} points where POINTS is {head.n_points}")
        with np.errstate(invalid="ignore", over="ignore"):
            typed = table.astype(kind)
        if kind.kind != "f" and not np.array_equal(typed, table):
            raise ValueError(f"field {name} has values that are no {kind.name}")
        columns[_unique(name, columns)] = typed[:, 0] if count == 1 else typed
        at += count
    return _without_padding(columns)


def _columns_of_rows(content: bytes, head: Head) -> Columns:
    n_bytes = head.n_points * head.row_size
    if n_bytes > len(content) - head.start:
        raise ValueError(
            f"it has {len(content) - head.start} of {n_bytes} bytes for {head.n_points} points"
        )
    columns: Columns = {}
    at = head.start
    for name, kind, count in head.fields:
        shape, strides = (head.n_points, count), (head.row_size, kind.itemsize)
        values = np.ndarray(shape, kind, content, at if head.n_points else 0, strides)
        columns[_unique(name, columns)] = values[:, 0] if count == 1 else values
        at += kind.itemsize * count
    return _without_padding(columns)


def _columns_of_packed(content: bytes, head: Head) -> Columns:
    start = head.start + _TWO_SIZES.size
    if len(content) < start:
        raise ValueError("it ends before the two sizes of its compressed data")
    packed, size = _TWO_SIZES.unpack_from(content, head.start)
    if packed > len(content) - start:
        raise ValueError(f"it has {len(content) - start} of {packed} compressed bytes")
    if size != head.n_points * head.row_size or size > _MOST_PACKED * packed:
        raise ValueError(
            f"its {packed} compressed bytes are said to be {size}, where {head.n_points} points of "
            f"{head.row_size} bytes are meant"
        )
    data = b""
    if size:
        import lzf

        data = lzf.decompress(content[start : start + packed], size)
        if data is None or len(data) != size:
            raise ValueError(f"its compressed bytes are no {size} bytes")
    columns: Columns = {}
    at = 0
    for name, kind, count in head.fields:
        # Field after field, each point by point.
        values = np.ndarray((head.n_points, count), kind, data, at)
        columns[_unique(name, columns)] = values[:, 0] if count == 1 else values
        at += values.nbytes
    return _without_padding(columns)


def _unique(name: str, columns: Columns) -> str:
    return f"{name}_{len(columns)}" if name in columns and name != "_" else name


def _without_padding(columns: Columns) -> Columns:
    return {name: each for name, each in columns.items() if name != "_"}


def write(path: Path, cloud: Cloud) -> None:
    """Binary PCD: coordinates in float64, fields in their own types."""
    columns = {_NORMAL.get(name, name): each for name, each in columns_of(cloud).items()}
    color = cloud.fields.get("color")
    if color is not None and color.dtype == np.uint8:
        for name in ("red", "green", "blue"):
            del columns[name]
        red, green, blue = color.astype(np.uint32).T
        columns["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)
    kinds = [values.dtype for values in columns.values()]
    height, width = cloud.shape or (1, len(cloud))
    head: dict[str, list[Any]] = {
        "VERSION": ["0.7"],
        "FIELDS": list(columns),
        "SIZE": [kind.itemsize for kind in kinds],
        "TYPE": [kind.kind.upper() for kind in kinds],
        "COUNT": [1] * len(kinds),
        "WIDTH": [width],
        "HEIGHT": [height],
        "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0],
        "POINTS": [len(cloud)],
        "DATA": ["binary"],
    }
    lines = ["# .PCD v0.7", *(" ".join(map(str, (key, *each))) for key, each in head.items()), ""]
    table = table_of(columns)
    with open(path, "wb") as stream:
        stream.write("\n".join(lines).encode())
        table.tofile(stream)
