"""Recorded scans: planes are found, and nothing unreasonable happens."""

from __future__ import annotations

import json

import numpy as np
import pytest
from test_cli import primfit_command

import primfit


@pytest.mark.parametrize("pose", [3, 16, 38])
def test_vlp16_board(data, pose):
    cloud = primfit.read_points(data / f"vlp16_board/pose{pose}_full.pcd")
    board = primfit.read_points(data / f"vlp16_board/pose{pose}_target.pcd")
    found = primfit.detect(cloud, rng=1)
    assert found.method == "planes"
    assert 5 <= len(found.planes) <= 100
    assert 0.003 < found.sigma < 0.03
    on_board = (np.abs(cloud[:, None] - board).max(axis=-1) == 0).any(axis=1)
    overlap = max(
        (on_board & (found.labels == i)).sum() / on_board.sum() for i in range(len(found.planes))
    )
    assert overlap > 0.9


@pytest.mark.parametrize(
    "name",
    [
        "vlp16_board/pose3_full.pcd",
        "boxes/caixa3.ply",
    ],
)
def test_detect_command_on_a_lidar_scan_and_a_depth_camera(data, tmp_path, name):
    result = primfit_command("detect", data / name, "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    for file in content["written"]:
        assert (tmp_path / file).stat().st_size > 0
    assert len(content["planes"]) >= 3
