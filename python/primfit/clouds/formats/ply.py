"""PLY: vertices in text or in binary of either byte order.

Written here, since the permissive libraries cannot read meshes that mix triangles and
quadrilaterals, and write no float64.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from primfit import _primfit
from primfit._check import Ints
from primfit.clouds.cloud import Cloud, Columns, Field, cloud_of, columns_of, table_of

_TYPES = {
    "i1": ("char", "int8"),
    "u1": ("uchar", "uint8", "bool"),
    "i2": ("short", "int16"),
    "u2": ("ushort", "uint16"),
    "i4": ("int", "int32"),
    "u4": ("uint", "uint32"),
    "f4": ("float", "float32"),
    "f8": ("double", "float64"),
}
_CODES = {name: code for code, names in _TYPES.items() for name in names}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

Properties = dict[str, tuple[str, str]]
"""Of each property the types of the length of a list, "" for none, and of its numbers, as "u1"."""


def read(path: Path) -> Cloud:
    """All properties of the vertices but lists; what is before and after them is passed over."""
    content = path.read_bytes()
    encoding, elements, at = _header_of(content)
    if encoding not in _ORDERS:
        raise ValueError(f"its format is {encoding!r}, not one of {', '.join(_ORDERS)}")
    for name, count, properties in elements:
        try:
            columns, at = _rows_of(content, at, encoding, count, properties)
        except ValueError as error:
            raise ValueError(f"element {name}: {error}") from None
        if name == "vertex":
            return cloud_of(columns)
    raise ValueError("it has no element vertex")


def _header_of(content: bytes) -> tuple[str, list[tuple[str, int, Properties]], int]:
    """Format; of each element its name, number of rows and properties; where the rows begin."""
    encoding = ""
    elements: list[tuple[str, int, Properties]] = []
    at = 0
    while (end := content.find(b"\n", at)) >= 0:
        line, is_first = content[at:end].decode("ascii", "replace").strip(), at == 0
        at = end + 1
        if is_first and line != "ply":
            break
        match line.split():
            case ["end_header"]:
                return encoding, elements, at
            case ["format", name, _]:
                encoding = name
            case ["element", name, count] if count.isdecimal():
                elements.append((name, int(count), {}))
            case ["element", *_]:
                raise ValueError(f"its header must have 'element name count', not {line[:60]!r}")
            case ["property", "list", length, kind, name] if elements:
                elements[-1][2][_new(name, elements[-1][2])] = (_code(length), _code(kind))
            case ["property", kind, name] if elements:
                elements[-1][2][_new(name, elements[-1][2])] = ("", _code(kind))
            case ["property", *_]:
                raise ValueError(f"its header must have 'property type name', not {line[:60]!r}")
    if not content.startswith(b"ply"):
        raise ValueError("it does not begin with 'ply'")
    raise ValueError("its header has no end")


def _code(kind: str) -> str:
    if kind not in _CODES:
        raise ValueError(
            f"its header has a property of type {kind[:40]!r}, not {', '.join(_CODES)}"
        )
    return _CODES[kind]


def _new(name: str, properties: Properties) -> str:
    if name in properties:
        raise ValueError(f"its header has two properties {name!r} of one element")
    return name


def _rows_of(
    content: bytes, at: int, encoding: str, count: int, properties: Properties
) -> tuple[Columns, int]:
    """The columns of an element, without lists, and where the next one begins."""
    single = {name: code for name, (length, code) in properties.items() if not length}
    kinds = list(properties.values())
    row = np.dtype([(name, _ORDERS[encoding] + code) for name, code in single.items()])
    if encoding == "ascii":
        numbers, at = _primfit.ply_words(content, at, count, kinds)
        table = numbers.reshape(-1, len(single)) if single else np.zeros((count, 0))
        columns = zip(single.items(), table.T, strict=True)
        return {name: _of_type(name, values, code) for (name, code), values in columns}, at
    if len(single) < len(properties):
        packed, at = _primfit.ply_bytes(content, at, count, kinds, encoding == "binary_big_endian")
        rows = np.frombuffer(packed, row) if single else np.zeros(0, row)
    else:
        n_rows = (len(content) - at) // row.itemsize if row.itemsize else count
        if n_rows < count:
            raise ValueError(f"it ends after {n_rows} of {count} rows")
        rows = np.frombuffer(content, row, count, at) if row.itemsize else np.zeros(0, row)
        at += count * row.itemsize
    return {name: rows[name] for name in single}, at


def _of_type(name: str, values: Field, code: str) -> Field:
    with np.errstate(invalid="ignore", over="ignore"):
        typed = values.astype(code)
    if typed.dtype.kind != "f" and not np.array_equal(typed, values):
        raise ValueError(f"property {name} has values that are no {_TYPES[code][0]}")
    return typed


def write(path: Path, cloud: Cloud, triangles: Ints | None = None) -> None:
    """Binary PLY: coordinates in float64, fields in their own types, triangles if given."""
    columns = {name: _narrowed(name, each) for name, each in columns_of(cloud).items()}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property {_TYPES[x.dtype.str[1:]][0]} {name}" for name, x in columns.items()]
    faces = np.zeros(0 if triangles is None else len(triangles), [("n", "u1"), ("rows", "<i4", 3)])
    if triangles is not None:
        faces["n"], faces["rows"] = 3, triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with open(path, "wb") as stream:
        stream.write("\n".join([*header, "end_header", ""]).encode())
        table_of(columns).tofile(stream)
        faces.tofile(stream)


def _narrowed(name: str, values: Field) -> Field:
    """The column in a type that PLY has, which are those without 64-bit integers."""
    if values.dtype.str[1:] in _TYPES:
        return values
    for kind in (np.int32, np.uint32):
        narrow = values.astype(kind)
        if np.array_equal(narrow, values):
            return narrow
    raise ValueError(f"PLY keeps whole numbers of up to 32 bits, but {name!r} has larger ones")
