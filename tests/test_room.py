"""Walls around the scene: low ones, those of a polygon, those that nobody saw, and none."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from small_maps import scanned

import primfit

ELL = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)]
CORRIDOR = [(0.0, 0.0), (3.0, 0.0), (3.0, 0.5), (0.0, 0.5)]
TURNED = [(0.5, -0.5), (2.5, 0.5), (1.8, 1.9), (-0.2, 0.9)]


def same_outline(found, outline):
    """Largest distance of either outline from the other, metres."""
    one, other = shapely.Polygon(found).exterior, shapely.Polygon(outline).exterior
    return shapely.hausdorff_distance(one, other)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(
    ("outline", "place"),
    [(ELL, (0.5, 0.5)), (CORRIDOR, (1.5, 0.25)), (TURNED, (1.1, 0.7))],
    ids=["L", "corridor", "turned"],
)
def test_a_room_may_be_any_polygon(outline, place, noise):
    solid = primfit.Prism.regular(4, 0.18, center=place, angle=0.3)
    world = primfit.World([solid], primfit.Arena(outline=outline))
    found = primfit.detect(scanned(world, noise, 1), rng=1)
    assert len(found.arena.footprint) == len(outline)
    assert same_outline(found.arena.footprint, outline) < 0.005
    assert all(found.arena.observed)
    report = primfit.evaluate(found, world)
    assert report.all_right
    assert not report.spurious


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_walls_lower_than_the_solids(noise):
    solids = [
        primfit.Prism.regular(4, 0.2, center=(0.4, 0.4), angle=0.2, height=0.4),
        primfit.Prism.regular(3, 0.25, center=(1.0, 0.9), angle=0.5, height=0.15),
    ]
    world = primfit.World(solids, primfit.Arena((1.4, 1.3), height=0.08))
    found = primfit.detect(scanned(world, noise, 1), rng=1)
    report = primfit.evaluate(found, world)
    assert report.all_right
    assert not report.spurious
    assert same_outline(found.arena.footprint, world.arena.outline) < 0.005
    assert found.arena.height == pytest.approx(0.08, abs=0.005)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_walls_of_the_paper_are_seen_from_near_by_only(noise):
    """A corner of the paper's world: 2 cm over the sensor, which sees them up to a metre away."""
    solids = [
        primfit.Prism.regular(4, 0.7, center=(1.5, 1.4), angle=0.4, height=0.05),
        primfit.Prism.rectangle(1.0, 0.5, center=(3.0, 2.8), angle=1.0, height=0.05),
    ]
    world = primfit.World(solids, primfit.Arena((4.5, 4.0), height=0.05))
    built = primfit.built_of_walls(world)
    path = primfit.paper_path(built, 0.4)
    scan = primfit.scan(built, path, primfit.Lidar.paper(noise=noise), rng=1)
    assert len(scan) < 150_000
    found = primfit.detect(scan, rng=1)
    report = primfit.evaluate(found, built)
    assert not report.missed
    assert not report.spurious
    # The ends of the walls cross at the corners, which is within the tolerance.
    assert sorted(each.kind for each in found.solids) == ["rectangle", "square"]
    assert max(row.center_error_mm for row in report.rows) < 5.0
    assert same_outline(found.arena.footprint, world.arena.outline) < 0.02
    assert found.arena.height == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("noise", [0.005, 0.02])
def test_a_wall_that_returned_nothing_is_said_to_be_unseen(noise):
    """No beam reaches the wall at x = 4."""
    solid = primfit.Prism.regular(4, 0.25, center=(0.9, 0.8), angle=0.3)
    world = primfit.World([solid], primfit.Arena((4.0, 1.6)))
    path = primfit.grid_path(world, rng=1)
    path = path[path[:, 0] < 2.2]
    scan = primfit.scan(world, path, primfit.Lidar(noise=noise), rng=1)
    assert np.nanmax(scan.points[:, 0]) < 3.5
    found = primfit.detect(scan, rng=1)
    assert primfit.evaluate(found, world).all_right
    assert len(found.solids) == 1
    walls = found.arena.footprint
    middles = (walls + np.roll(walls, -1, axis=0)) / 2
    unseen = int(np.argmax(middles[:, 0]))
    assert [k for k, seen in enumerate(found.arena.observed) if not seen] == [unseen]
    # It is no nearer than beams went.
    assert walls[:, 0].max() > 2.9
    np.testing.assert_allclose(np.sort(walls[:, 0])[:2], 0.0, atol=0.005)
    np.testing.assert_allclose(np.sort(walls[:, 1]), [0.0, 0.0, 1.6, 1.6], atol=0.005)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_no_room_is_invented(noise):
    solids = [
        primfit.Prism.regular(4, 0.2, center=(x, y), angle=x)
        for x, y in ((0.0, 0.0), (1.0, 0.1), (0.9, 0.9), (0.0, 1.0))
    ]
    world = primfit.World(solids)
    found = primfit.detect(scanned(world, noise, 1), rng=1)
    assert found.arena is None
    report = primfit.evaluate(found, world)
    assert report.all_right
    assert not report.spurious


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_most_beams_pass_over_a_solid_lower_than_the_sensor(noise):
    solids = [
        primfit.Prism.rectangle(0.3, 0.2, center=(0.35, 0.35), angle=0.3, height=0.03),
        primfit.Prism.regular(3, 0.25, center=(0.8, 0.8), angle=0.5, height=0.2),
    ]
    world = primfit.World(solids, primfit.Arena((1.2, 1.2), height=0.1))
    found = primfit.detect(scanned(world, noise, 1, 0.2), rng=1)
    report = primfit.evaluate(found, world)
    assert report.all_right
    assert not report.spurious
    low = min(found.solids, key=lambda each: each.top)
    assert low.height == pytest.approx(0.03, abs=0.002)
    assert low.observed[-1]
