"""Scans of the ranges that a real sensor, or another simulator, has logged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from primfit import _primfit
from primfit._check import as_floats, instance
from primfit.scans.scan import Scan
from primfit.scans.scanning import as_transforms
from primfit.sensors.sensor import RangeGate, Sensor


def scan_of_readings(
    path: ArrayLike, lidar: Sensor, ranges: ArrayLike, sigma: ArrayLike | None
) -> Scan:
    """The scan that `Scan.from_readings` gives."""
    instance("lidar", lidar, Sensor)
    poses, _ = as_transforms(path, lidar)
    beams = lidar.directions
    layers, columns, _ = beams.shape
    n_beams = layers * columns
    lengths = as_floats("ranges", ranges)
    shapes = [(len(poses), layers, columns), (len(poses), n_beams), (len(poses) * n_beams,)]
    shapes += [(layers, columns)] * (len(poses) == 1)
    if lengths.shape not in shapes:
        raise ValueError(
            f"ranges must have shape {shapes[0]}: poses, layers and columns; not {lengths.shape}"
        )
    lengths = lengths.reshape(len(poses), layers, columns)
    rows = np.flatnonzero(~(np.isnan(lengths) | np.isneginf(lengths)))
    pose, beam = np.divmod(rows, n_beams)
    if sigma is None:
        sigma = lidar.sigma_of(lengths)
        sigma = np.ravel(sigma)[rows] if np.ndim(sigma) else sigma
        # A sensor of which no noise is known is not without any.
        sigma = sigma if np.any(sigma) else None
    directions = _primfit.turned(
        np.ascontiguousarray(poses.reshape(-1, 16)), np.ascontiguousarray(beams.reshape(-1, 3))
    )
    nearest, farthest = (
        np.ravel(limit)[beam] if np.ndim(limit) else limit for limit in lidar.limits
    )
    scan = Scan.from_rays(
        poses[pose, :3, 3],
        directions[rows],
        lengths.ravel()[rows],
        sigma,
        min_range=nearest,
        max_range=farthest,
        layer=beam // columns,
        column=beam % columns,
        pose_index=pose,
    )
    if isinstance(lidar.gate, RangeGate):
        return scan
    return replace(scan, depths=scan.ranges * beams[..., 2].ravel()[beam])
