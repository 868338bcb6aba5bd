"""Solids that some poses see from within the sensor's shortest range, whence nothing returns."""

from __future__ import annotations

import numpy as np
import pytest
from small_maps import in_room, rays_of

import primfit

SHORTEST = 0.08
SOLIDS = (
    primfit.Prism.regular(4, 0.22, center=(0.35, 0.4), angle=0.3),
    primfit.Prism.regular(3, 0.25, center=(0.8, 0.75), angle=0.8),
)


def near_scan(world, noise):
    """From a grid, and from poses a centimetre or more from a wall of each solid."""
    grid = primfit.grid_path(world, 0.25, rng=1)
    near = []
    for solid in world.solids:
        along = np.roll(solid.footprint, -1, axis=0) - solid.footprint
        out = np.stack([along[:, 1], -along[:, 0]], axis=1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        for share in (0.3, 0.5, 0.7):
            for distance in (0.01, 0.03, 0.06):
                xy = solid.footprint + share * along + distance * out
                poses = np.column_stack([xy, np.arctan2(-out[:, 1], -out[:, 0])])
                near.append(poses[:1])
    path = np.concatenate([grid, *near])
    lidar = primfit.Lidar(min_range=SHORTEST, noise=noise)
    scan = primfit.scan(world, path, lidar, rng=1)
    is_near = scan.pose_index >= len(grid)
    assert (~scan.is_return[is_near]).mean() > 0.5
    assert len(scan) < 150_000
    return scan


@pytest.mark.parametrize(("noise", "is_known"), [(0.0, True), (0.02, True), (0.0, False)])
def test_a_pose_within_the_shortest_range_costs_no_solid(noise, is_known):
    world = in_room(*SOLIDS, size=1.2)
    scan = near_scan(world, noise)
    scan = scan if is_known else rays_of(scan, min_range=None)
    found = primfit.detect(scan, rng=1)
    report = primfit.evaluate(found, world)
    assert report.all_right
    assert not report.spurious
    assert max(row.center_error_mm for row in report.rows) < 0.5
    assert max(row.size_error_mm for row in report.rows) < 1.0
    if is_known:
        assert found.settings["min_range"] == SHORTEST
    else:
        # The shortest returns tell it.
        shortest = np.quantile(scan.ranges[scan.is_return], 0.001)
        assert found.settings["min_range"] == shortest
