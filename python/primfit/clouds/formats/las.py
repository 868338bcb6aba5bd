"""LAS and LAZ, through laspy."""

from __future__ import annotations

import io
import mmap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from primfit._check import Floats, Ints
from primfit.clouds.cloud import Cloud, Columns, cloud_of, columns_of
from primfit.clouds.formats.las_header import LasHeader, read_header
from primfit.clouds.formats.laz import decompressed
from primfit.geometry.extents import bounds

_FINEST = 1e-6
"""Least step of a coordinate, metres."""

_AT_ONCE = 1 << 26
"""Bytes of points that are read at once."""

_COLOR = ("red", "green", "blue")


def read(path: Path) -> Cloud:
    """All dimensions; those of the format that are zero throughout are left out."""
    import laspy

    content = memoryview(path.read_bytes())
    checked = read_header(content)
    header = laspy.LasHeader.read_from(io.BytesIO(content[: checked.start]))
    if checked.compression is None:
        points = content[checked.start : checked.start + checked.n_points * checked.point_size]
    else:
        whole = bytearray()
        for part in decompressed(content, checked, checked.compression):
            whole += part
        points = memoryview(whole)
    record = laspy.point.record.ScaleAwarePointRecord(
        np.frombuffer(points, header.point_format.dtype()),
        header.point_format,
        header.scales,
        header.offsets,
    )
    places = _places([record.array[axis] for axis in "XYZ"], checked)
    ever = _ever_set(points, checked.point_size)
    used = {
        name
        for name, (kind, at) in (header.point_format.dtype().fields or {}).items()
        if any(ever[at : at + kind.itemsize])
    }
    return cloud_of_record(record, places, used)


def read_parts(path: Path) -> Iterator[Floats]:
    """The points alone (n, 3), metres, some at a time and in order."""
    with path.open("rb") as file:
        content = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    header = read_header(content)
    for part in _parts(content, header):
        rows = np.frombuffer(part, np.uint8).reshape(-1, header.point_size)
        yield _places(list(np.ascontiguousarray(rows[:, :12]).view("<i4").T), header)


def _parts(content: memoryview, header: LasHeader) -> Iterator[bytes | bytearray]:
    if header.compression is not None:
        yield from decompressed(content, header, header.compression)
        return
    at_once = max(1, _AT_ONCE // header.point_size) * header.point_size
    end = header.start + header.n_points * header.point_size
    for first in range(header.start, end, at_once):
        yield bytes(content[first : min(first + at_once, end)])


def _places(counts: Sequence[Ints], header: LasHeader) -> Floats:
    """Where counts of steps of the three coordinates are (n, 3), metres."""
    places = np.empty((len(counts[0]), 3))
    for k, (scale, offset) in enumerate(zip(header.scales, header.offsets, strict=True)):
        np.multiply(counts[k], scale, out=places[:, k])
        places[:, k] += offset
    return places


def cloud_of_record(record: Any, places: Floats, used: set[str] | None = None) -> Cloud:
    """The cloud of points of laspy at their places (n, 3); may be told what is not zero."""
    layout = record.point_format
    own = set(layout.extra_dimension_names)
    columns: Columns = {}
    for name in layout.dimension_names:
        bytes_of = record.sub_fields_dict.get(name, (name,))[0]
        may_be_used = name in own or used is None or bytes_of in used
        if name not in ("X", "Y", "Z") and may_be_used:
            values = np.asarray(record[name])
            if name in own or values.any():
                columns[name] = values
    if any(name in columns for name in _COLOR):
        wide = [np.asarray(record[name]) for name in _COLOR]
        # Eight bits fill sixteen when they are written twice.
        is_narrow = all((each % 257 == 0).all() for each in wide)
        columns |= dict(zip(_COLOR, [x // 257 for x in wide] if is_narrow else wide, strict=True))
    return cloud_of(columns, points=places)


def _ever_set(points: memoryview, size: int) -> bytes:
    """For each byte of a point, the bits that are set in any of the points."""
    rows = np.frombuffer(points, np.uint8)
    # Eight points are a whole number of words, which are faster to go through.
    n_whole = len(rows) // (8 * size) * 8 * size
    words = np.bitwise_or.reduce(rows[:n_whole].view(np.uint64).reshape(-1, size), axis=0)
    rest = np.bitwise_or.reduce(rows[n_whole:].reshape(-1, size), axis=0)
    eight = np.bitwise_or.reduce(words.view(np.uint8).reshape(8, size), axis=0)
    return bytes(eight | rest)


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
    low, high = bounds(cloud.points) if len(cloud) else (np.zeros(3), np.zeros(3))
    span = float(np.max(high - low))
    header.offsets = np.floor((low + high) / 2)
    header.scales = np.full(3, max(_FINEST, 10.0 ** np.ceil(np.log10(max(span, 1.0) / 4.2e9))))
    record = laspy.ScaleAwarePointRecord.zeros(len(cloud), header=header)
    for k, axis in enumerate("XYZ"):
        steps = (cloud.points[:, k] - header.offsets[k]) / header.scales[k]
        record.array[axis] = np.rint(steps, out=steps)
    las = laspy.LasData(header, record)
    for name, values in columns.items():
        las[name] = values
        if not np.array_equal(las[name], values, equal_nan=values.dtype.kind == "f"):
            raise ValueError(f"LAS keeps {name} as {las[name].dtype}, which changes its values")
    las.write(path)
