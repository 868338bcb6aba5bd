"""LAS and LAZ, through laspy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from primfit.clouds.cloud import Cloud, Columns, cloud_of, columns_of

_FINEST = 1e-6
"""Least step of a coordinate, metres."""

_COLOR = ("red", "green", "blue")


def read(path: Path) -> Cloud:
    """All dimensions; those of the format that are zero throughout are left out."""
    import laspy

    las = laspy.read(path)
    if len(las.points) != las.header.point_count:
        raise ValueError(f"it holds {len(las.points)} of {las.header.point_count} points")
    columns: Columns = dict(zip("xyz", np.asarray(las.xyz).T, strict=True))
    own = set(las.point_format.extra_dimension_names)
    for name in las.point_format.dimension_names:
        if name not in ("X", "Y", "Z"):
            values = np.asarray(las[name])
            if name in own or values.any():
                columns[name] = values
    if any(name in columns for name in _COLOR):
        wide = [np.asarray(las[name]) for name in _COLOR]
        # Eight bits fill sixteen when they are written twice.
        is_narrow = all((each % 257 == 0).all() for each in wide)
        columns |= dict(zip(_COLOR, [x // 257 for x in wide] if is_narrow else wide, strict=True))
    return cloud_of(columns)


def write(path: Path, cloud: Cloud) -> None:
    """LAS 1.4; fields that the format does not know become extra dimensions.

    A coordinate is a 32-bit count of steps of a power of ten: of a micrometre for spans of up to
    4 km, of more for longer ones.
    """
    import laspy

    if not np.isfinite(cloud.points).all():
        raise ValueError("LAS keeps no points that are not finite")
    columns = columns_of(cloud)
    for axis in "xyz":
        del columns[axis]
    if "time" in columns:
        columns["gps_time"] = columns.pop("time")
    color = cloud.fields.get("color")
    if color is not None and color.dtype == np.uint8:
        columns |= dict(zip(_COLOR, color.astype(np.uint16).T * 257, strict=True))
    header = laspy.LasHeader(point_format=6 if color is None else 7, version="1.4")
    known = set(header.point_format.dimension_names)
    extra = [name for name in columns if name not in known]
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, columns[name].dtype.str[1:]) for name in extra]
    )
    low, high = (cloud.points.min(axis=0), cloud.points.max(axis=0)) if len(cloud) else (0.0, 0.0)
    span = float(np.max(np.subtract(high, low)))
    header.offsets = np.floor(np.add(low, high) / 2) + np.zeros(3)
    header.scales = np.full(3, max(_FINEST, 10.0 ** np.ceil(np.log10(max(span, 1.0) / 4.2e9))))
    las = laspy.LasData(header)
    las.xyz = cloud.points
    for name, values in columns.items():
        las[name] = values
        if not np.array_equal(las[name], values, equal_nan=values.dtype.kind == "f"):
            raise ValueError(f"LAS keeps {name} as {las[name].dtype}, which changes its values")
    las.write(path)
