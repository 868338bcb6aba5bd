"""Clouds of whatever has points: arrays, frames, tensors, other libraries' clouds, messages, files.

Nothing is imported for it: what is given is told by what it has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from primfit._check import Floats, as_rows
from primfit.clouds.cloud import Cloud, Columns, cloud_of, common_name, organised
from primfit.clouds.formats.arrays import cloud_of_array
from primfit.clouds.messages import cloud_of_message

PointsLike: TypeAlias = Any
"""What `as_cloud` takes."""

_WANTED = (
    "an array (n, 3 or more) or (h, w, 3 or more), named columns x y z (structured array, pandas, "
    "polars, mapping), a tensor, a cloud of Open3D, trimesh or laspy, a PointCloud2, a Cloud, a "
    "Scan, or a path"
)


def as_cloud(points: PointsLike) -> Cloud:
    """The points, and what else is told of each, of anything that has some.

    Every function that takes points takes the same.

    Parameters
    ----------
    points : anything with points, metres
        - An array, or what NumPy makes one of: (n, 3), or (h, w, 3) of an organised cloud, which
          gives rows in row-major order. Columns beyond x, y and z are fields "column_4" and so on.
        - Named columns x, y and z: a structured array, a pandas, polars or Arrow table, a mapping
          of names to arrays. Other columns of numbers are fields. A table without these names
          must have three columns, or be numbered from 0.
        - A tensor of PyTorch, Open3D or another library, on whatever device.
        - A cloud of Open3D (legacy or tensor), trimesh or laspy, with colours, normals and
          other attributes; whatever else has its coordinates in `points` or `vertices`.
        - A PointCloud2 message of ROS, by any library.
        - A `Cloud`, a `Scan`, or the path of a file in a format of `read_cloud`.

    Returns
    -------
    Cloud
        With copies; float32 becomes float64 without a change.

    Raises
    ------
    TypeError
        When it has no points, or they are no numbers.
    ValueError
        When the shape is another.
    OSError, ModuleNotFoundError
        Of a path, as `read_cloud` does.

    Examples
    --------
    >>> import numpy as np, primfit
    >>> primfit.as_cloud(np.zeros((480, 640, 3)))
    Cloud(480 x 640 points, 307200 finite)
    >>> primfit.as_cloud({"x": [1.0], "y": [2.0], "z": [3.0], "intensity": [7]})
    Cloud(1 point: intensity)
    """
    cloud = borrowed("points", points)
    return Cloud(cloud.points, cloud.fields, cloud.shape)


def points_of(name: str, points: PointsLike, *, finite: bool = True) -> Floats:
    """The points (n, 3) float64 of anything that has some; not always a copy."""
    return as_rows(name, borrowed(name, points).points, 3, finite=finite)


def read_only(name: str, points: PointsLike) -> Cloud:
    """The cloud of anything that has points, with points that nobody can write to through it."""
    cloud = borrowed(name, points)
    view = cloud.points.view()
    view.setflags(write=False)
    return organised(view, dict(cloud.fields), cloud.shape)


def borrowed(name: str, points: PointsLike) -> Cloud:
    """The cloud of anything that has points; it may share its arrays with what was given."""
    if isinstance(points, Cloud):
        return points
    read = next((read for is_such, read in _SOURCES if is_such(points)), None)
    if read is None:
        raise TypeError(f"{name} must be {_WANTED}; not {_told(points)}")
    try:
        return read(points)
    except (OSError, MemoryError, ModuleNotFoundError):
        raise
    except (TypeError, ValueError) as error:
        if isinstance(points, str | PathLike):
            raise
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"{name} must be {_WANTED}; {_told(points)} is none: {error}") from None


def _told(points: Any) -> str:
    """What it is, in a few words."""
    kind = f"{type(points).__module__.partition('.')[0]}.{type(points).__qualname__}"
    shape, dtype = getattr(points, "shape", None), getattr(points, "dtype", None)
    return (
        kind.removeprefix("builtins.")
        + (f" of shape {tuple(shape)}" if isinstance(shape, tuple | list) else "")
        + (f" of {dtype}" if dtype is not None else "")
    )


def _is_path(points: Any) -> bool:
    return isinstance(points, str | PathLike)


def _of_path(points: Any) -> Cloud:
    from primfit.clouds.files import read_cloud

    return read_cloud(points)


def _is_table(points: Any) -> bool:
    return isinstance(points, Mapping) or hasattr(points, "columns")


def _of_table(points: Any) -> Cloud:
    names = getattr(points, "column_names", None) or getattr(points, "columns", points)
    columns = {name: _numbers(points[name], common_name(str(name))) for name in names}
    has_axes = {"x", "y", "z"} & {common_name(str(name)) for name in columns}
    if not has_axes and (len(columns) == 3 or list(columns) == list(range(len(columns)))):
        return cloud_of_array(np.stack([_given(each) for each in columns.values()], axis=1))
    return cloud_of({str(name): each for name, each in columns.items() if each is not None})


def _numbers(column: Any, name: str) -> Any:
    """The column as an array (n,), or None when it is no column of numbers."""
    values = np.asarray(column)
    if values.dtype.kind == "O" and name in ("x", "y", "z"):
        # What may be missing, as in columns that can hold it, is no point.
        values = np.array([np.nan if each is None else each for each in values], np.float64)
    is_number = values.ndim == 1 and values.dtype.kind in "biuf" and values.dtype.itemsize <= 8
    return values if is_number else None


def _given(column: Any) -> Any:
    if column is None:
        raise TypeError("its columns are not all of numbers")
    return column


def _is_las(points: Any) -> bool:
    return hasattr(points, "point_format") and hasattr(points, "xyz")


def _of_las(points: Any) -> Cloud:
    from primfit.clouds.formats.las import cloud_of_record

    return cloud_of_record(points.points, np.asarray(points.xyz, dtype=np.float64))


def _is_tensor_cloud(points: Any) -> bool:
    """As of `open3d.t.geometry`."""
    return hasattr(getattr(points, "point", None), "positions")


def _of_tensor_cloud(points: Any) -> Cloud:
    attributes = {name: _array(points.point[name]) for name in points.point}
    places = cloud_of_array(attributes.pop("positions")).points
    fields: Columns = {}
    for name, values in attributes.items():
        short = {"colors": "color", "normals": "normal"}.get(name, common_name(name))
        fields[short] = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if "color" in fields:
        fields["color"] = _bytes(fields["color"])
    return organised(places, fields, None)


def _is_object_cloud(points: Any) -> bool:
    return hasattr(points, "points") or hasattr(points, "vertices")


def _of_object_cloud(points: Any) -> Cloud:
    if hasattr(points, "faces") or hasattr(points, "triangles"):
        raise TypeError("a mesh has surfaces; give points on them, as the library samples them")
    places = _array(points.points if hasattr(points, "points") else points.vertices)
    cloud = cloud_of_array(places)
    fields = dict(cloud.fields)
    for name, theirs in (("color", "colors"), ("normal", "normals")):
        values = _array(getattr(points, theirs, ()))
        if values.ndim == 2 and len(values) == len(places) and values.shape[1] >= 3:
            fields[name] = _bytes(values[:, :3]) if name == "color" else values[:, :3]
    return organised(cloud.points, fields, cloud.shape)


def _bytes(colors: Any) -> Any:
    """Colours from 0 to 1 as numbers from 0 to 255; whole numbers stay."""
    if colors.dtype.kind != "f":
        return colors
    return np.rint(255.0 * np.clip(np.nan_to_num(colors), 0.0, 1.0)).astype(np.uint8)


def _array(points: Any) -> Any:
    """An array of what NumPy takes, and of tensors that other devices or gradients hold."""
    if isinstance(points, np.ndarray):
        return points
    for step in ("detach", "cpu", "get"):
        # A mapping, as a series may be taken for, gets by a key.
        if hasattr(points, step) and hasattr(points, "dtype") and not hasattr(points, "keys"):
            points = getattr(points, step)()
    if callable(getattr(points, "numpy", None)):
        points = points.numpy()
    elif not hasattr(points, "__array__") and hasattr(points, "__dlpack__"):
        points = np.from_dlpack(points)
    return np.asarray(points)


def _of_array(points: Any) -> Cloud:
    if isinstance(points, np.ma.MaskedArray) and points.dtype.names is None:
        # What is masked is no point.
        points = np.ma.filled(points.astype(np.float64), np.nan)
    return cloud_of_array(_array(points))


def _is_array(points: Any) -> bool:
    is_sequence = hasattr(points, "__len__") and hasattr(points, "__getitem__")
    ways = ("__array__", "__array_interface__", "__dlpack__", "numpy")
    return is_sequence or any(hasattr(points, way) for way in ways)


_SOURCES: list[tuple[Callable[[Any], bool], Callable[[Any], Cloud]]] = [
    (lambda points: isinstance(points, np.ndarray), _of_array),
    (_is_path, _of_path),
    (_is_las, _of_las),
    (lambda points: hasattr(points, "point_step"), cloud_of_message),
    (_is_tensor_cloud, _of_tensor_cloud),
    (_is_table, _of_table),
    (_is_object_cloud, _of_object_cloud),
    (_is_array, _of_array),
]
"""How each kind is told from those below it, and read."""
