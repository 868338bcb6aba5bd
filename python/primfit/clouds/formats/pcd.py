"""PCD, through pypcd4."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from primfit.clouds.cloud import Cloud, Columns, cloud_of, columns_of

_NORMAL = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}


def read(path: Path) -> Cloud:
    """All fields of one number; packed colours are unpacked."""
    import pypcd4

    pcd = pypcd4.PointCloud.from_path(path)
    head, table = pcd.metadata, np.atleast_1d(pcd.pc_data)
    if len(table) != head.points or head.width * head.height != head.points:
        raise ValueError(
            f"it holds {len(table)} points where its header says {head.points} "
            f"({head.width} x {head.height})"
        )
    columns: Columns = {}
    for name, count in zip(head.fields, head.count, strict=True):
        if count != 1 or name.startswith("#"):
            continue
        values = table[name]
        if name in ("rgb", "rgba") and values.dtype.itemsize == 4:
            # Blue is the lowest byte, whatever number the four bytes are said to be.
            parts = np.ascontiguousarray(values).view("<u4")[:, None] >> [16, 8, 0, 24]
            red, green, blue, alpha = parts.astype(np.uint8).T
            columns |= {"red": red, "green": green, "blue": blue}
            if name == "rgba":
                columns["alpha"] = alpha
        else:
            columns[name] = values
    return cloud_of(columns, (head.height, head.width) if head.height > 1 else None)


def write(path: Path, cloud: Cloud) -> None:
    """Compressed binary PCD: coordinates in float64, fields in their own types."""
    import pypcd4

    columns = {_NORMAL.get(name, name): each for name, each in columns_of(cloud).items()}
    color = cloud.fields.get("color")
    if color is not None and color.dtype == np.uint8:
        for name in ("red", "green", "blue"):
            del columns[name]
        columns["rgb"] = pypcd4.PointCloud.encode_rgb(color).ravel()
    pcd = pypcd4.PointCloud.from_points(
        list(columns.values()), tuple(columns), [each.dtype for each in columns.values()]
    )
    if cloud.shape is not None:
        height, width = cloud.shape
        pcd.metadata = pcd.metadata.derive(height=height, width=width)
    pcd.save(path)
