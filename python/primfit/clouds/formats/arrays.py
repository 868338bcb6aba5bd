"""NPY and NPZ, the formats of NumPy."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from primfit.clouds.cloud import (
    Cloud,
    Columns,
    Field,
    cloud_of,
    columns_of,
    common_name,
    organised,
    table_of,
)
from primfit.clouds.formats.archive import Archive, read_array

_WIDE = 16
"""Columns from which three rows are taken for x, y and z along the first axis."""


def read(path: Path) -> Cloud:
    """An array whose last axis, or whose named columns, are x, y, z and more; or an archive.

    An archive has an array "points"; its others of as many rows are fields. Two axes of points
    make an organised cloud.
    """
    if path.suffix.lower() == ".npz":
        with Archive(path) as archive:
            return _of_archive(archive)
    return cloud_of_array(read_array(path))


def cloud_of_array(content: Field) -> Cloud:
    """The cloud of an array whose last axis, or whose named columns, are x, y, z and more.

    Two axes of points make an organised cloud. It may share its numbers with the array.

    Raises
    ------
    TypeError
        When it holds no numbers.
    ValueError
        When its shape is another.
    """
    if content.dtype.names is not None:
        return _of_named(content)
    if content.dtype.kind not in "biuf" and content.size:
        raise TypeError(f"its array holds {content.dtype}, not numbers")
    if content.ndim not in (2, 3) or content.shape[-1] < 3:
        raise ValueError(f"its array has shape {content.shape}, not (n, 3) or (h, w, 3)")
    if content.shape[0] == 3 and content.shape[-1] > _WIDE:
        raise ValueError(
            f"its array has shape {content.shape}, as if x, y and z were its rows: the last axis "
            f"must be x, y, z and more"
        )
    width = content.shape[-1]
    rows = content.reshape(math.prod(content.shape[:-1]), width)
    fields = {f"column_{k + 1}": _at_most_64_bits(rows[:, k]) for k in range(3, width)}
    return organised(rows[:, :3].astype(np.float64, copy=False), fields, _pixels(content[..., 0]))


def _of_named(content: Field) -> Cloud:
    """A cloud of named columns; those that are no numbers are left out."""
    columns: Columns = {}
    for name in content.dtype.names or ():
        values = content[name]
        if values.dtype.kind in "biuf":
            values = values.reshape(content.size, math.prod(values.shape[content.ndim :]))
            columns[name] = _at_most_64_bits(values[:, 0] if values.shape[1] == 1 else values)
    return cloud_of(columns, _pixels(content))


def _pixels(pixels: Field) -> tuple[int, int] | None:
    return (pixels.shape[0], pixels.shape[1]) if pixels.ndim == 2 else None


def _at_most_64_bits(values: Field) -> Field:
    return values.astype(np.float64) if values.dtype.itemsize > 8 else values


def _of_archive(archive: Archive) -> Cloud:
    if "points" not in archive:
        raise ValueError(f"it has no array 'points', only {', '.join(archive) or 'nothing'}")
    shape = archive.shape("points")
    if len(shape) not in (2, 3) or shape[-1] != 3:
        raise ValueError(f"its array 'points' has shape {shape}, not (n, 3) or (h, w, 3)")
    points = archive["points"]
    if points.dtype.kind not in "biuf":
        raise ValueError(f"its array 'points' holds {points.dtype}, not numbers")
    points, pixels = points.reshape(-1, 3).astype(np.float64), shape[:-1]
    fields: Columns = {}
    for name in archive:
        own = archive.shape(name)
        is_field = own[: len(pixels)] == pixels and len(own) - len(pixels) in (0, 1)
        if name not in ("points", "x", "y", "z") and is_field:
            values = archive[name]
            if values.dtype.kind in "biuf":
                values = _at_most_64_bits(values)
                fields[common_name(name)] = values.reshape(len(points), *own[len(pixels) :])
    return organised(points, fields, (shape[0], shape[1]) if len(shape) == 3 else None)


def write(path: Path, cloud: Cloud) -> None:
    """An archive of arrays; or one array, with named columns where there are fields."""
    pixels = cloud.shape or (len(cloud),)
    with open(path, "wb") as stream:
        if path.suffix.lower() == ".npz":
            each = {"points": cloud.points, **cloud.fields}
            content: Any = {name: x.reshape(*pixels, *x.shape[1:]) for name, x in each.items()}
            np.savez_compressed(stream, **content)
        elif not cloud.fields:
            np.save(stream, cloud.points.reshape(*pixels, 3))
        else:
            np.save(stream, table_of(columns_of(cloud)).reshape(pixels))
