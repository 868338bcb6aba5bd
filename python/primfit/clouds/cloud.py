"""Clouds: points, and what their file says of each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from primfit._check import Floats, as_rows, frozen, integer

Field = NDArray[Any]
Columns = dict[str, Field]

_VECTORS = {"color": ("red", "green", "blue"), "normal": ("nx", "ny", "nz")}
"""Columns of the fields of three that have names of their own; others are name_x and so on."""

_SYNONYMS = {
    "r": "red",
    "g": "green",
    "b": "blue",
    "i": "intensity",
    "labels": "label",
    "t": "time",
    "timestamp": "time",
    "stamp": "time",
    "gps_time": "time",
    "gpstime": "time",
}
"""Names in files, in small letters, for what is one thing."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points, and what their file says of each.

    Parameters
    ----------
    points : (n, 3) float64, metres
        NaN where a pixel or beam of an organised cloud has no point.
    fields : mapping of str to (n,) or (n, 3) arrays
        Numbers of any type, by name. Whatever the format, what is common has one name: "color"
        (n, 3), "normal" (n, 3), "origin" (n, 3) where the sensor was, "intensity", "label",
        "ring", "time". Others are named as in the file. Units are those of the file.
    shape : (int, int) or None
        Height and width of an organised cloud, whose points are row by row.

    Raises
    ------
    ValueError
        When shapes do not match, or a name has spaces or is "x", "y" or "z".

    Examples
    --------
    >>> import primfit
    >>> cloud = primfit.Cloud([[0, 0, 1], [1, 0, 1]], {"label": [4, 7]})
    >>> cloud
    Cloud(2 points: label)
    >>> cloud.points[cloud.fields["label"] == 7]
    array([[1., 0., 1.]])
    """

    points: Floats
    fields: Mapping[str, Field] = field(default_factory=dict)
    shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        points = np.array(as_rows("points", self.points, 3, finite=False))
        object.__setattr__(self, "points", frozen(points))
        fields = {name: _as_field(name, each, len(points)) for name, each in self.fields.items()}
        object.__setattr__(self, "fields", MappingProxyType(fields))
        if self.shape is not None:
            try:
                height, width = self.shape
            except (TypeError, ValueError):
                raise ValueError(f"shape must be (height, width), not {self.shape!r}") from None
            shape = integer("height", height, low=0), integer("width", width, low=0)
            if shape[0] * shape[1] != len(points):
                raise ValueError(
                    f"shape must be that of {len(points)} points, not {shape[0]} x {shape[1]}"
                )
            object.__setattr__(self, "shape", shape)

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """The points: a cloud may be given wherever points are asked for."""
        return np.array(self.points, dtype, copy=copy)

    def __repr__(self) -> str:
        count = f"{len(self)} point{'s' * (len(self) != 1)}"
        if self.shape is not None:
            n_finite = int(np.isfinite(self.points).all(axis=1).sum())
            count = f"{self.shape[0]} x {self.shape[1]} points, {n_finite} finite"
        names = ", ".join(self.fields)
        return f"Cloud({count}{': ' * bool(names)}{names})"


def _as_field(name: str, values: ArrayLike, n: int) -> Field:
    if not isinstance(name, str) or not re.fullmatch(r"[^\s,;]+", name) or name in ("x", "y", "z"):
        raise ValueError(f"fields must have names without spaces, other than x y z, not {name!r}")
    array = np.array(values)
    if array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        raise TypeError(f"fields[{name!r}] must be numbers of at most 64 bits, not {array.dtype}")
    if array.shape not in ((n,), (n, 3)) or (name in _VECTORS and array.ndim == 1):
        wanted = f"({n}, 3)" if name in _VECTORS else f"({n},) or ({n}, 3)"
        raise ValueError(f"fields[{name!r}] must have shape {wanted}, not {array.shape}")
    native = np.float32 if array.dtype == np.float16 else array.dtype.newbyteorder("=")
    return frozen(array.astype(native, copy=False))


def columns_of(cloud: Cloud) -> Columns:
    """The cloud as columns (n,): x, y, z, then one or three for each field; bool as uint8."""
    columns = dict(zip("xyz", cloud.points.T, strict=True))
    for name, values in cloud.fields.items():
        numbers = values.astype(np.uint8) if values.dtype.kind == "b" else values
        names = _VECTORS.get(name, tuple(f"{name}_{axis}" for axis in "xyz"))
        parts = {name: numbers} if values.ndim == 1 else dict(zip(names, numbers.T, strict=True))
        for column in parts.keys() & columns.keys():
            raise ValueError(f"fields has two that need a column named {column!r}")
        columns |= parts
    return columns


def table_of(columns: Columns) -> NDArray[np.void]:
    """The columns as one array (n,) with named columns."""
    n = len(columns["x"])
    table = np.zeros(n, [(name, each.dtype.newbyteorder("<")) for name, each in columns.items()])
    for name, each in columns.items():
        table[name] = each
    return table


def cloud_of(columns: Mapping[str, Field], shape: tuple[int, int] | None = None) -> Cloud:
    """The cloud that columns as they are in files make.

    Raises
    ------
    ValueError
        When x, y or z is missing.
    """
    fields: Columns = {}
    for name, values in columns.items():
        key = common_name(name)
        key = f"{key}_value" if key in _VECTORS else key
        fields[key if key not in fields else name] = values
    missing = [axis for axis in "xyz" if axis not in fields]
    if missing:
        raise ValueError(f"it has no {', '.join(missing)}, only {', '.join(columns) or 'nothing'}")
    points = np.stack([fields.pop(axis).astype(np.float64) for axis in "xyz"], axis=1)
    triples = {name: parts for name, parts in _VECTORS.items() if parts[0] in fields}
    for first in fields:
        if first.endswith("_x") and len(first) > 2:
            triples[first[:-2]] = (first, f"{first[:-1]}y", f"{first[:-1]}z")
    for name, parts in triples.items():
        if all(part in fields for part in parts) and name not in fields:
            fields[name] = np.stack([fields.pop(part) for part in parts], axis=1)
    color = fields.get("color")
    if color is not None and color.dtype.kind in "iu" and not np.any(color >> 8):
        fields["color"] = color.astype(np.uint8)
    return Cloud(points, fields, shape)


def common_name(name: str) -> str:
    """The name in one word, without CloudCompare's mark of a scalar field."""
    word = re.sub(r"[\s,;]+", "_", name.strip()).removeprefix("scalar_")
    known = _SYNONYMS.get(word.lower(), word.lower())
    common = {*"xyz", *_SYNONYMS.values(), "ring", "nx", "ny", "nz"}
    return known if known in common else word
