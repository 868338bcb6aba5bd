"""What moved while it was looked at is named, and is no solid."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
import shapely
from small_maps import in_room

import primfit

STAYS = primfit.Prism.regular(3, 0.25, center=(1.0, 1.0), angle=0.4)
BEFORE = primfit.Prism.regular(4, 0.2, center=(0.4, 0.5), angle=0.3)
AFTER = primfit.Prism.regular(4, 0.2, center=(0.9, 0.4), angle=1.0)


def scanned_in_halves(first, second, noise):
    """One path after the other, of which poses are counted on."""
    lidar = primfit.Lidar(noise=noise)
    scans = [
        primfit.scan(world, primfit.grid_path(world, rng=seed), lidar, rng=seed)
        for seed, world in enumerate((first, second))
    ]
    n_poses = int(scans[0].pose_index.max()) + 1
    arrays = {
        name: np.concatenate([getattr(scan, name) for scan in scans])
        for name in ("origins", "directions", "ranges")
    }
    pose_index = np.concatenate([scans[0].pose_index, n_poses + scans[1].pose_index])
    whole = primfit.Scan.from_rays(
        **arrays,
        sigma=lidar.sigma,
        min_range=lidar.min_range,
        max_range=lidar.max_range,
        pose_index=pose_index,
    )
    return whole, n_poses


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_solid_that_moved_is_named_and_no_other_one_is_invented(noise):
    first, second = (in_room(STAYS, moved, size=1.3) for moved in (BEFORE, AFTER))
    scan, n_poses = scanned_in_halves(first, second, noise)
    with pytest.warns(UserWarning, match=r"contradict each other at \(\d\.\d+, \d\.\d+\)") as told:
        found = primfit.detect(scan, rng=1)
    assert len(told) == len(found.contradictions)
    assert [each.kind for each in found.solids] == ["triangle"]
    np.testing.assert_allclose(found.solids[0].center[:2], [1.0, 1.0], atol=2e-3)
    by_x = sorted(found.contradictions, key=lambda each: each.center[0])
    assert len(by_x) == 2
    for each, solid, change in zip(by_x, (BEFORE, AFTER), (-1, 1), strict=True):
        assert np.linalg.norm(each.center - solid.center[:2]) < 0.05
        assert shapely.Polygon(each.footprint).intersects(solid.shadow)
        assert (each.shares[1] - each.shares[0]) * change > 0.5
        assert abs(each.pose - n_poses) < 0.2 * n_poses
    texts = [str(each.message) for each in told]
    assert any(f"({by_x[0].center[0]:.3f}, {by_x[0].center[1]:.3f})" in text for text in texts)
    assert len(json.loads(found.to_json())["contradictions"]) == 2


@pytest.mark.parametrize(("first", "second"), [((), (AFTER,)), ((AFTER,), ())])
def test_a_solid_that_came_or_went(first, second):
    worlds = (in_room(STAYS, *solids, size=1.3) for solids in (first, second))
    scan, _ = scanned_in_halves(*worlds, 0.01)
    with pytest.warns(UserWarning, match="moved, came or went"):
        found = primfit.detect(scan, rng=1)
    assert [each.kind for each in found.solids] == ["triangle"]
    (place,) = found.contradictions
    assert np.linalg.norm(place.center - AFTER.center[:2]) < 0.05
    assert (place.shares[0] < place.shares[1]) == (len(first) == 0)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_map_that_stays_contradicts_nothing(noise):
    world = in_room(STAYS, BEFORE, size=1.3)
    scan, _ = scanned_in_halves(world, world, noise)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = primfit.detect(scan, rng=1)
    assert found.contradictions == ()
    assert primfit.evaluate(found, world).all_right
