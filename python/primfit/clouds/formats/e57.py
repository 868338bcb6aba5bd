"""E57, through pye57."""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from primfit.clouds.cloud import Cloud, Columns, cloud_of, columns_of
from primfit.clouds.formats.e57_header import check_file

if TYPE_CHECKING:
    from pye57 import E57, ScanHeader

_NAMES = {
    "cartesianX": "x",
    "cartesianY": "y",
    "cartesianZ": "z",
    "colorRed": "red",
    "colorGreen": "green",
    "colorBlue": "blue",
    "timeStamp": "time",
    "rowIndex": "row",
    "columnIndex": "column",
    "intensity": "intensity",
    "nor:normalX": "nx",
    "nor:normalY": "ny",
    "nor:normalZ": "nz",
}
"""Names of the standard, and of its extension for normals."""

_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_EXTENSIONS = {
    "nor": "http://www.libe57.org/E57_NOR_surface_normals.txt",
    "primfit": "urn:primfit:fields",
}


_UNIT = 1e-3
"""How far the length of a quaternion may be off one: writers round it."""


def read(path: Path) -> Cloud:
    """All scans, moved to the frame of the file; fields that one of them lacks are left out.

    A scan whose pose is known has its position as the field "origin"; of several, "scan" is the
    number. Points that are marked as invalid are NaN.
    """
    import pye57

    check_file(path)
    with pye57.E57(str(path)) as file:
        scans = [_read_scan(file, i) for i in range(file.scan_count)]
    if not scans:
        raise ValueError("it holds no scan")
    if len(scans) > 1:
        for i, scan in enumerate(scans):
            scan["scan"] = np.full(len(scan["x"]), i)
    names = [name for name in scans[0] if all(name in scan for scan in scans)]
    return cloud_of({name: np.concatenate([scan[name] for scan in scans]) for name in names})


def _read_scan(file: E57, i: int) -> Columns:
    header = file.get_header(i)
    raw = _read_columns(file, header)
    columns = {_NAMES.get(name, name.removeprefix("primfit:")): each for name, each in raw.items()}
    if "x" in columns:
        points = np.stack([columns[axis] for axis in "xyz"], axis=1)
    elif all(name in raw for name in _SPHERICAL):
        radius, azimuth, elevation = (columns.pop(name) for name in _SPHERICAL)
        flat = radius * np.cos(elevation)
        points = np.stack(
            [flat * np.cos(azimuth), flat * np.sin(azimuth), radius * np.sin(elevation)], axis=1
        )
    else:
        raise ValueError(f"a scan has no coordinates, only {', '.join(raw)}")
    for name in ("cartesianInvalidState", "sphericalInvalidState"):
        if name in columns:
            points[columns.pop(name) != 0] = np.nan
    if header.has_pose():
        if not np.isclose(np.linalg.norm(header.rotation), 1.0, rtol=0.0, atol=_UNIT):
            raise ValueError(f"a scan has a rotation that is no unit quaternion: {header.rotation}")
        rotation, translation = header.rotation_matrix, header.translation
        points = points @ rotation.T + translation
        columns |= {
            f"origin_{axis}": np.full(len(points), t)
            for axis, t in zip("xyz", translation, strict=True)
        }
    return columns | dict(zip("xyz", points.T, strict=True))


def _read_columns(file: E57, header: ScanHeader) -> Columns:
    from pye57 import libe57
    from pye57.utils import get_node

    prototype = libe57.StructureNode(header.points.prototype())
    n = header.point_count
    columns: Columns = {}
    buffers = libe57.VectorSourceDestBuffer()
    for name in header.point_fields:
        node = get_node(prototype, name)
        if isinstance(node, libe57.StringNode):
            continue
        kind: Any = np.float64
        if isinstance(node, libe57.IntegerNode):
            kind = np.longlong  # int64 by another name: the library takes its usual one for int32
        elif isinstance(node, libe57.FloatNode) and node.precision() == libe57.E57_SINGLE:
            kind = np.float32
        columns[name] = np.zeros(n, kind)
        buffers.append(libe57.SourceDestBuffer(file.image_file, name, columns[name], n, True, True))
    n_read = header.points.reader(buffers).read() if n else 0
    if n_read < n:
        raise ValueError(f"a scan holds {n_read} of {n} points")
    return columns


def write(path: Path, cloud: Cloud) -> None:
    """One scan in the frame of the file: coordinates in float64, fields in their own types.

    The library's own writer rounds coordinates to float32 and knows few fields.
    """
    import pye57
    from pye57 import libe57

    if not len(cloud):
        raise ValueError("E57 keeps no cloud without points")
    own = {name: standard for standard, name in _NAMES.items()}
    columns = {own.get(name, f"primfit:{name}"): each for name, each in columns_of(cloud).items()}
    invalid = ~np.isfinite(cloud.points).all(axis=1)
    if invalid.any():
        columns["cartesianInvalidState"] = np.where(invalid, 2, 0)
        for name in ("cartesianX", "cartesianY", "cartesianZ"):
            columns[name] = np.where(invalid, 0.0, columns[name])
    with pye57.E57(str(path), "w") as file:
        image = file.image_file
        for prefix, uri in _EXTENSIONS.items():
            image.extensionsAdd(prefix, uri)
        prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
        kept = []
        for name, values in columns.items():
            if values.dtype.kind == "f":
                precision = libe57.E57_DOUBLE if values.dtype.itemsize == 8 else libe57.E57_SINGLE
                prototype.set(name, libe57.FloatNode(image, 0.0, precision))
                kept.append(np.ascontiguousarray(values))
            else:
                low, high = int(values.min()), int(values.max())
                prototype.set(name, libe57.IntegerNode(image, low, low, high))
                kept.append(values.astype(np.longlong))
            buffers.append(libe57.SourceDestBuffer(image, name, kept[-1], len(cloud), True, True))
        scan = libe57.StructureNode(image)
        scan.set("guid", libe57.StringNode(image, f"{{{uuid.uuid4()}}}"))
        points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
        scan.set("points", points)
        file.data3d.append(scan)
        writer = points.writer(buffers)
        writer.write(len(cloud))
        writer.close()
