"""Clouds: points, and what their file says of each."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from primfit._check import Floats, as_rows, integer
from primfit.viewing.shown import Shown

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

_FEW = 1000
"""Points that tell at once that coordinates are no whole numbers."""

_KILOMETRE = 1000.0
"""Metres; whole numbers beyond may be millimetres of a scene of a metre."""


@dataclass(frozen=True, eq=False)
class Cloud(Shown):
    """Points, and what their file says of each.

    Parameters
    ----------
    points : (n, 3) float64, metres
        NaN where a pixel or beam of an organised cloud has no point.
    fields : mapping of str to (n,) or (n, k) arrays
        Numbers of any type, by name. Whatever the format, what is common has one name: "color"
        (n, 3), "normal" (n, 3), "origin" (n, 3) where the sensor was, "intensity", "label",
        "ring", "time". Others are named as in the file. Units are those of the file.
    shape : (int, int) or None
        Height and width of an organised cloud, whose points are row by row.

    Raises
    ------
    ValueError
        When shapes do not match, or a name has spaces or is "x", "y" or "z".
    TypeError
        When `fields` is no mapping, or a field is no array of numbers.

    Notes
    -----
    The cloud has copies of what it was made of; its own arrays may be written to.

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
        object.__setattr__(self, "points", points)
        if not isinstance(self.fields, Mapping):
            raise TypeError(
                f"fields must be a mapping of names to arrays, not {type(self.fields).__name__}"
            )
        fields = {
            name: _as_field(name, np.array(each), len(points)) for name, each in self.fields.items()
        }
        object.__setattr__(self, "fields", MappingProxyType(fields))
        if self.shape is not None:
            try:
                height, width = self.shape
            except (TypeError, ValueError):
                raise ValueError(f"shape must be (height, width), not {self.shape!r}") from None
            shape = integer("shape[0]", height, low=0), integer("shape[1]", width, low=0)
            if shape[0] * shape[1] != len(points):
                raise ValueError(
                    f"shape must be that of {len(points)} points, not {shape[0]} x {shape[1]}"
                )
            object.__setattr__(self, "shape", shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_of, (self.points, dict(self.fields), self.shape)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: ArrayLike | slice) -> Cloud:
        """The cloud of some points only, with their fields: by mask, slice or row numbers."""
        index = rows if isinstance(rows, slice) else np.asarray(rows)
        if not isinstance(index, slice) and (index.ndim != 1 or index.dtype.kind not in "biu"):
            raise TypeError(f"rows must be a mask, a slice or row numbers, not {rows!r}")
        fields = {name: values[index] for name, values in self.fields.items()}
        return Cloud(self.points[index], fields)

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
    array = np.asarray(values)
    if array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        raise TypeError(f"fields[{name!r}] must be numbers of at most 64 bits, not {array.dtype}")
    fits = array.shape == (n, 3) or (
        name not in _VECTORS and (array.shape == (n,) or (array.ndim == 2 and len(array) == n))
    )
    if not fits:
        wanted = f"({n}, 3)" if name in _VECTORS else f"({n},) or ({n}, k)"
        raise ValueError(f"fields[{name!r}] must have shape {wanted}, not {array.shape}")
    native = np.float32 if array.dtype == np.float16 else array.dtype.newbyteorder("=")
    return array.astype(native, copy=False)


def _made_of(points: Floats, fields: Columns, shape: tuple[int, int] | None) -> Cloud:
    """The cloud that takes over arrays which are right and nobody else's."""
    cloud = object.__new__(Cloud)
    for name, value in (("points", points), ("fields", MappingProxyType(fields)), ("shape", shape)):
        object.__setattr__(cloud, name, value)
    return cloud


def columns_of(cloud: Cloud) -> Columns:
    """The cloud as columns (n,): x, y, z, then those of each field; bool as uint8.

    A field of three is name_x, name_y, name_z; one of another width k is name_0 to name_k-1.
    """
    columns = dict(zip("xyz", cloud.points.T, strict=True))
    for name, values in cloud.fields.items():
        numbers = values.astype(np.uint8) if values.dtype.kind == "b" else values
        if values.ndim == 1:
            parts = {name: numbers}
        else:
            marks = "xyz" if values.shape[1] == 3 else range(values.shape[1])
            names = _VECTORS.get(name, tuple(f"{name}_{mark}" for mark in marks))
            parts = dict(zip(names, numbers.T, strict=True))
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


def cloud_of(
    columns: Mapping[str, Field],
    shape: tuple[int, int] | None = None,
    *,
    points: Floats | None = None,
) -> Cloud:
    """The cloud that columns (n,), or (n, k), as they are in files make; it may take them over.

    Without `points` (n, 3), three columns are x, y and z.

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
    if points is None:
        missing = ", ".join(axis for axis in "xyz" if axis not in fields)
        if missing:
            raise ValueError(f"it has no {missing}, only {', '.join(columns) or 'nothing'}")
        points = np.stack([fields.pop(axis) for axis in "xyz"], axis=1, dtype=np.float64)
    for name, parts in _vectors(fields).items():
        if all(part in fields for part in parts) and name not in fields:
            fields[name] = np.stack([fields.pop(part) for part in parts], axis=1)
    color = fields.get("color")
    if color is not None and color.dtype.kind in "iu" and not np.any(color >> 8):
        fields["color"] = color.astype(np.uint8)
    return organised(points, fields, shape)


def without_packed_colors(columns: Columns) -> Columns:
    """The columns, with those of "rgb" and "rgba" in four bytes as red, green, blue and alpha.

    Blue is the lowest byte, whatever number the four bytes are said to be.
    """
    unpacked: Columns = {}
    for name, values in columns.items():
        if name in ("rgb", "rgba") and values.dtype.itemsize == 4 and values.ndim == 1:
            words = np.ascontiguousarray(values).view(np.uint32)[:, None]
            red, green, blue, alpha = (words >> [16, 8, 0, 24]).astype(np.uint8).T
            unpacked |= {"red": red, "green": green, "blue": blue}
            if name == "rgba":
                unpacked["alpha"] = alpha
        else:
            unpacked[name] = values
    return unpacked


def _vectors(fields: Columns) -> dict[str, Sequence[str]]:
    """Names of the fields that columns of one number make, with the names of these columns."""
    single = [name for name, values in fields.items() if values.ndim == 1]
    vectors: dict[str, Sequence[str]] = {
        name: parts for name, parts in _VECTORS.items() if parts[0] in single
    }
    for first in single:
        if first.endswith("_x") and len(first) > 2:
            vectors[first[:-2]] = [f"{first[:-1]}{axis}" for axis in "xyz"]
        elif first.endswith("_0") and len(first) > 2 and f"{first[:-1]}1" in fields:
            k = next(k for k in range(2, len(single) + 1) if f"{first[:-1]}{k}" not in fields)
            vectors[first[:-2]] = [f"{first[:-1]}{i}" for i in range(k)]
    return vectors


def organised(points: Floats, fields: Columns, shape: tuple[int, int] | None) -> Cloud:
    """The cloud of points and fields that a reader has made and nobody else has.

    Raises
    ------
    ValueError, TypeError
        As `Cloud` does.
    """
    own = {name: _as_field(name, values, len(points)) for name, values in fields.items()}
    if shape is not None and shape[0] * shape[1] != len(points):
        raise ValueError(f"its shape is {shape[0]} x {shape[1]}, of {len(points)} points")
    return _made_of(points, own, shape)


def common_name(name: str) -> str:
    """The name in one word, without CloudCompare's mark of a scalar field."""
    word = re.sub(r"[\s,;]+", "_", name.strip()).removeprefix("scalar_")
    known = _SYNONYMS.get(word.lower(), word.lower())
    common = {*"xyz", *_SYNONYMS.values(), "ring", "nx", "ny", "nz"}
    return known if known in common else word


def warn_of_millimetres(points: Floats) -> None:
    """Warn of coordinates that are whole numbers and large, as millimetres are."""
    middle = 0.0
    some = points[:_FEW]
    if len(some) and np.array_equal(np.rint(some), some, equal_nan=True):
        finite = points[np.isfinite(points).all(axis=1)]
        if len(finite) and np.array_equal(np.rint(finite), finite):
            middle = float(np.median(np.abs(finite).max(axis=1)))
    if middle > _KILOMETRE:
        warnings.warn(
            f"points are whole numbers, half of them beyond {middle:g} m: if these are "
            f"millimetres, divide them by 1000",
            stacklevel=4,
        )
