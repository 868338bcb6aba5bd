"""PLY: vertices in text or in binary of either byte order.

Written here, since the permissive libraries cannot read meshes that mix triangles and
quadrilaterals, and write no float64.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from primfit._check import Ints
from primfit.clouds.cloud import Cloud, Field, cloud_of, columns_of, table_of

_TYPES = {
    "i1": ("char", "int8"),
    "u1": ("uchar", "uint8"),
    "i2": ("short", "int16"),
    "u2": ("ushort", "uint16"),
    "i4": ("int", "int32"),
    "u4": ("uint", "uint32"),
    "f4": ("float", "float32"),
    "f8": ("double", "float64"),
}
_CODES = {name: code for code, names in _TYPES.items() for name in names}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


def read(path: Path) -> Cloud:
    """All properties of the vertices; faces are left out."""
    with open(path, "rb") as stream:
        if stream.readline().strip() != b"ply":
            raise ValueError("it does not begin with 'ply'")
        encoding, elements = _read_header(stream)
        if encoding not in _ORDERS:
            raise ValueError(f"its format is {encoding!r}, not one of {', '.join(_ORDERS)}")
        for name, count, properties in elements:
            unknown = [kind for _, kind in properties if kind not in _CODES]
            if unknown:
                raise ValueError(f"its element {name} has properties of type {unknown[0]!r}")
            row = np.dtype([(each, _ORDERS[encoding] + _CODES[kind]) for each, kind in properties])
            rows = _read_rows(stream, encoding, count, row)
            if len(rows) < count:
                raise ValueError(f"it ends after {len(rows)} of {count} rows of element {name}")
            if name == "vertex":
                return cloud_of({each: rows[each] for each, _ in properties})
    raise ValueError("it has no element vertex")


def _read_header(stream: BinaryIO) -> tuple[str, list[tuple[str, int, list[tuple[str, str]]]]]:
    """Format, and of each element name, number of rows, and properties with their types."""
    encoding = ""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in stream:
        match line.decode("ascii", "replace").split():
            case ["end_header"]:
                return encoding, elements
            case ["format", name, _]:
                encoding = name
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", *kind, name] if elements:
                elements[-1][2].append((name, " ".join(kind)))
    raise ValueError("its header has no end")


def _read_rows(
    stream: BinaryIO, encoding: str, count: int, row: np.dtype[np.void]
) -> NDArray[np.void]:
    if encoding == "ascii":
        lines = [line.decode("ascii") for line in islice(stream, count)]
        return np.loadtxt(lines, row, comments=None, ndmin=1) if lines else np.zeros(0, row)
    data = stream.read(count * row.itemsize)
    return np.frombuffer(data, row, count=len(data) // row.itemsize)


def write(path: Path, cloud: Cloud, triangles: Ints | None = None) -> None:
    """Binary PLY: coordinates in float64, fields in their own types, triangles if given."""
    columns = {name: _narrowed(name, each) for name, each in columns_of(cloud).items()}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property {_TYPES[x.dtype.str[1:]][0]} {name}" for name, x in columns.items()]
    faces = np.zeros(0 if triangles is None else len(triangles), [("n", "u1"), ("rows", "<i4", 3)])
    if triangles is not None:
        faces["n"], faces["rows"] = 3, triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    text = "\n".join([*header, "end_header", ""])
    path.write_bytes(text.encode() + table_of(columns).tobytes() + faces.tobytes())


def _narrowed(name: str, values: Field) -> Field:
    """The column in a type that PLY has, which are those without 64-bit integers."""
    if values.dtype.str[1:] in _TYPES:
        return values
    for kind in (np.int32, np.uint32):
        narrow = values.astype(kind)
        if np.array_equal(narrow, values):
            return narrow
    raise ValueError(f"PLY keeps whole numbers of up to 32 bits, but {name!r} has larger ones")
