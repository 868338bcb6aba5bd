"""Scenes that are hard to explain by the likelihood: concave, close, crowded, or said to be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import primfit

CONCAVE = {
    "U": [(3, 3), (8, 3), (8, 8), (6.5, 8), (6.5, 4.5), (4.5, 4.5), (4.5, 8), (3, 8)],
    "T": [(3, 7), (5, 7), (5, 3), (7, 3), (7, 7), (9, 7), (9, 8.5), (3, 8.5)],
    "arrow": [(3, 5), (6, 5), (6, 3.5), (9, 6), (6, 8.5), (6, 7), (3, 7)],
}


def scanned(world, noise, seed, spacing):
    path = primfit.grid_path(world, spacing, rng=seed)
    return primfit.scan(world, path, primfit.Lidar(noise=noise), rng=seed)


@pytest.mark.parametrize("name", CONCAVE)
def test_concave_footprints_have_their_corners_in_noise(name):
    solid = primfit.Prism(np.array(CONCAVE[name]) / 10.0, 0.2)
    world = primfit.World([solid], primfit.Arena((1.2, 1.2)))
    found = primfit.detect(scanned(world, 0.05, 1, 0.2), rng=1)
    assert [each.kind for each in found.solids] == ["polygon"]
    footprint = found.solids[0].footprint
    assert len(footprint) == len(solid.footprint)
    gaps = np.linalg.norm(footprint[:, None] - solid.footprint, axis=-1)
    assert gaps.min(axis=0).max() < 5e-3
    assert primfit.evaluate(found, world).rows[0].center_error_mm < 2.0


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_two_squares_two_centimetres_apart(noise):
    solids = [primfit.Prism.regular(4, 0.2, center=(x, 0.5)) for x in (0.4, 0.62)]
    world = primfit.World(solids, primfit.Arena((1, 1)))
    report = primfit.evaluate(primfit.detect(scanned(world, noise, 1, 0.125), rng=1), world)
    assert report.all_right
    assert max(row.center_error_mm for row in report.rows) < 1.5


def test_a_crowd():
    world = primfit.random_world(12, 2.5, rng=31)
    report = primfit.evaluate(primfit.detect(scanned(world, 0.05, 31, 0.25), rng=1), world)
    assert report.all_right
    assert report.n_planes == report.n_planes_true


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_sigma_said_wrong_by_a_factor(factor):
    world = primfit.random_world(3, 1.5, rng=12)
    scan = scanned(world, 0.05, 12, 0.25)
    found = primfit.detect(replace(scan, sigma=0.05 * factor), rng=1)
    assert primfit.evaluate(found, world).all_right


def test_a_room_is_not_held_by_walls_at_the_end_of_the_reach():
    world = primfit.World([], primfit.Arena((2, 2)))
    found = primfit.detect(scanned(world, 0.2, 3, 0.25), rng=1)
    assert not found.solids
    np.testing.assert_allclose(
        np.sort(found.arena.footprint, axis=0)[[0, -1]], [[0, 0], [2, 2]], atol=3e-3
    )
