"""NPY and NPZ, the formats of NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from primfit.clouds.cloud import Cloud, Field, cloud_of, columns_of, common_name, table_of


def read(path: Path) -> Cloud:
    """An array whose last axis, or whose named columns, are x, y, z and more; or an archive.

    An archive has an array "points"; its others of as many rows are fields. Two axes of points
    make an organised cloud.
    """
    with open(path, "rb") as stream:
        content = np.load(stream, allow_pickle=False)
        is_archive = path.suffix.lower() == ".npz"
        if is_archive == isinstance(content, np.ndarray):
            raise ValueError(f"it is {'an array' if is_archive else 'an archive of arrays'}")
        if is_archive:
            return _of_archive({name: content[name] for name in content.files})
    if content.dtype.names is not None:
        columns = {name: content[name] for name in content.dtype.names}
        return cloud_of({name: each.ravel() for name, each in columns.items()}, _shape(content))
    if content.ndim not in (2, 3) or content.shape[-1] < 3:
        raise ValueError(f"its array has shape {content.shape}, not (n, 3) or (h, w, 3)")
    names = [*"xyz", *(f"column_{k}" for k in range(4, content.shape[-1] + 1))]
    rows = content.reshape(-1, len(names))
    return cloud_of(dict(zip(names, rows.T, strict=True)), _shape(content[..., 0]))


def _shape(pixels: Field) -> tuple[int, int] | None:
    return (pixels.shape[0], pixels.shape[1]) if pixels.ndim == 2 else None


def _of_archive(arrays: Mapping[str, Field]) -> Cloud:
    if "points" not in arrays:
        raise ValueError(f"it has no array 'points', only {', '.join(arrays) or 'nothing'}")
    points = arrays["points"]
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise ValueError(f"its array 'points' has shape {points.shape}, not (n, 3) or (h, w, 3)")
    points, shape = points.reshape(-1, 3), points.shape
    fields = {
        common_name(name): each.reshape(len(points), *each.shape[len(shape) - 1 :])
        for name, each in arrays.items()
        if name not in ("points", "x", "y", "z")
        and each.dtype.kind in "biuf"
        and each.shape in (shape, shape[:-1])
    }
    return Cloud(points, fields, (shape[0], shape[1]) if len(shape) == 3 else None)


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
