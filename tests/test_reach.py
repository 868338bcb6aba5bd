"""Nothing depends on how far the sensor could have seen, or on the order of the threads."""

from __future__ import annotations

import numpy as np
import pytest
from small_maps import in_room, rays_of

import primfit


@pytest.fixture(scope="module")
def far_scan():
    """Walls higher than the beams rise, so that the same beams return at any reach."""
    solids = (
        primfit.Prism.regular(4, 0.5, center=(1.2, 1.3), angle=0.3, height=0.5),
        primfit.Prism.regular(5, 0.35, center=(2.8, 2.6), angle=0.8, height=1.0),
        primfit.Prism.rectangle(0.6, 0.3, center=(3.0, 1.0), angle=0.5, height=0.6),
    )
    world = primfit.World(solids, primfit.Arena((4, 4), height=2.0))
    lidar = primfit.Lidar(max_range=100.0, noise=0.0002, mount=(0, 0, 0.4), min_range=0.1)
    path = primfit.grid_path(world, 1.0, clearance=0.15, rng=1)
    return world, primfit.scan(world, path, lidar, rng=1)


def test_the_reach_changes_nothing(far_scan):
    world, scan = far_scan
    found = [primfit.detect(rays_of(scan, max_range=reach), rng=1) for reach in (10.0, 100.0, None)]
    first = found[0]
    assert primfit.evaluate(first, world).all_right
    assert first.settings["max_range"] < 10.0
    for other in found[1:]:
        assert [each.kind for each in other.solids] == [each.kind for each in first.solids]
        for one, two in zip(first.solids, other.solids, strict=True):
            off = np.abs(one.center - two.center)[:2]
            assert (off < 0.1 * np.sqrt(np.diag(one.covariance)[:2])).all()
        np.testing.assert_allclose(other.arena.footprint, first.arena.footprint, atol=1e-6)


def test_the_same_bits_at_any_number_of_threads(far_scan):
    scan = far_scan[1].select(np.arange(0, len(far_scan[1]), 2))
    one, two = (primfit.detect(scan, rng=1, n_jobs=n_jobs) for n_jobs in (1, 2))
    assert one.to_json() == two.to_json()
    for a, b in zip(one.solids, two.solids, strict=True):
        np.testing.assert_array_equal(a.covariance, b.covariance)
    np.testing.assert_array_equal(one.labels, two.labels)


def test_which_row_a_beam_stands_in_changes_no_kind():
    world = in_room(
        primfit.Prism.regular(4, 0.22, center=(0.35, 0.4), angle=0.3),
        primfit.Prism.regular(3, 0.25, center=(0.7, 0.75), angle=0.8),
    )
    lidar = primfit.Lidar(noise=0.02)
    scan = primfit.scan(world, primfit.grid_path(world, rng=1), lidar, rng=1)
    order = np.random.default_rng(1).permutation(len(scan))
    one, two = primfit.detect(scan, rng=1), primfit.detect(scan.select(order), rng=1)
    assert primfit.evaluate(one, world).all_right
    assert primfit.evaluate(two, world).all_right
    for a in one.solids:
        b = next(each for each in two.solids if each.kind == a.kind)
        sigmas = np.sqrt(np.diag(a.covariance)[:2])
        assert (np.abs(a.center - b.center)[:2] < sigmas).all()
