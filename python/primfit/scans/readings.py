"""Scans of the ranges that a real sensor, or another simulator, has logged."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import Floats, as_floats, instance
from primfit.scans.scan import Scan
from primfit.scans.scanning import as_transforms
from primfit.sensors.lidar import Lidar


def scan_of_readings(
    path: ArrayLike, lidar: Lidar, ranges: ArrayLike, sigma: ArrayLike | None
) -> Scan:
    """The scan that `Scan.from_readings` gives."""
    instance("lidar", lidar, Lidar)
    poses, _ = as_transforms(path, lidar)
    layers, columns, _ = lidar.directions.shape
    n_beams = layers * columns
    lengths = as_floats("ranges", ranges)
    shapes = [(len(poses), layers, columns), (len(poses), n_beams), (len(poses) * n_beams,)]
    shapes += [(layers, columns)] * (len(poses) == 1)
    if lengths.shape not in shapes:
        raise ValueError(
            f"ranges must have shape {shapes[0]}: poses, layers and columns; not {lengths.shape}"
        )
    lengths = lengths.reshape(-1)
    rows = np.flatnonzero(~(np.isnan(lengths) | np.isneginf(lengths)))
    pose, beam = np.divmod(rows, n_beams)
    directions = _primfit.turned(
        np.ascontiguousarray(poses.reshape(-1, 16)), lidar.directions.reshape(-1, 3)
    )
    return Scan.from_rays(
        poses[pose, :3, 3],
        directions[rows],
        lengths[rows],
        _sigma_of(lidar, lengths[rows]) if sigma is None else sigma,
        min_range=lidar.min_range,
        max_range=lidar.max_range,
        layer=beam // columns,
        column=beam % columns,
        pose_index=pose,
    )


def _sigma_of(lidar: Lidar, ranges: Floats) -> float | Floats | None:
    if lidar.noise_per_metre:
        return lidar.sigma_at(ranges)
    return lidar.sigma or None
