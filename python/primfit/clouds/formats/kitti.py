"""The .bin files of KITTI: x, y, z and intensity in single precision, nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from primfit.clouds.cloud import Cloud, cloud_of

_ROW = 16
"""Bytes of a point."""


def read(path: Path) -> Cloud:
    """Points and intensity; the sensor was at the origin."""
    size = path.stat().st_size
    if size % _ROW:
        raise ValueError(f"it has {size} bytes, not {_ROW} for each point: x y z intensity float32")
    table = np.fromfile(path, "<f4").reshape(-1, 4)
    if not len(table):
        raise ValueError("it holds no point")
    return cloud_of(dict(zip(("x", "y", "z", "intensity"), table.T, strict=True)))
