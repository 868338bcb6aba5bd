"""Scans as images: what each pixel of a camera, or each beam of a layer, measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from primfit._check import choice
from primfit.scans.scan import Scan

_FIELDS = {
    "depth": ("depths", np.nan),
    "range": ("ranges", np.nan),
    "sigma": ("sigma", np.nan),
    "points": ("points", np.nan),
    "solid_index": ("solid_index", -1),
}
"""Where what images are of is in a scan, and what stands where there is no beam."""


def images_of(scan: Scan, of: str) -> NDArray[Any]:
    """The images that `Scan.image` gives."""
    name, missing = _FIELDS[choice("of", of, list(_FIELDS))]
    values = getattr(scan, name)
    if values is None:
        raise ValueError(f"of must be what the scan knows, and it has no {name}")
    if scan.layer is None or scan.column is None or not len(scan):
        raise ValueError("scan must say which layer and column each beam is of")
    pose = np.zeros(len(scan), dtype=np.int64)
    if scan.pose_index is not None:
        pose = np.unique(scan.pose_index, return_inverse=True)[1]
    shape = tuple(int(each.max()) + 1 for each in (pose, scan.layer, scan.column))
    if min(int(scan.layer.min()), int(scan.column.min())) < 0:
        raise ValueError("scan must have layers and columns from 0 on")
    rows = np.broadcast_to(values, len(scan)) if np.ndim(values) == 0 else values
    place = np.ravel_multi_index((pose, scan.layer, scan.column), shape)
    if np.array_equal(place, np.arange(len(scan))) and len(scan) == np.prod(shape):
        return np.array(rows).reshape(*shape, *rows.shape[1:])
    if len(np.unique(place)) < len(scan):
        raise ValueError("scan must have one beam in each pose, layer and column")
    images = np.full((int(np.prod(shape)), *rows.shape[1:]), missing, dtype=rows.dtype)
    images[place] = rows
    return images.reshape(*shape, *rows.shape[1:])
