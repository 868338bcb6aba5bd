"""Worlds and scans that several tests look at."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import primfit

QUICK = """
    test_bags test_convex test_depth test_files test_foreign_files test_hostile_files test_kernels
    test_neighbors test_round_footprints test_sampling test_scanning test_segmentation
    test_space_carving test_start test_text_files test_viewing test_warnings test_worlds
"""
"""Files of the tier `make quick`: some of each part, together less than a minute of CPU."""


def pytest_collection_modifyitems(items):
    for item in items:
        if item.path.stem in QUICK.split():
            item.add_marker(pytest.mark.quick)


@pytest.fixture(scope="session")
def world():
    return primfit.random_world(rng=7)


@pytest.fixture(scope="session")
def scan(world):
    return primfit.scan(world, primfit.grid_path(world, rng=7), rng=7)


@pytest.fixture(scope="session")
def found(scan):
    return primfit.detect(scan, method="paper", rng=7)


@pytest.fixture(scope="session")
def small_world():
    return primfit.random_world(1, 1.0, ["square"], rng=3)


@pytest.fixture(scope="session")
def small_scan(small_world):
    path = primfit.grid_path(small_world, rng=3)
    return primfit.scan(small_world, path, primfit.Lidar(noise=0.005), rng=3)


@pytest.fixture(scope="session")
def data() -> Path:
    root = Path(__file__).parent.parent
    folder = Path(os.environ.get("PRIMFIT_DATA", root.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real scans: PRIMFIT_DATA or {folder} must name their folder")
    return folder
