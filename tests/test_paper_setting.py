"""The setting of the paper's authors: worlds, walls, path and sensor."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import shapely

import primfit
from primfit.worlds.random_worlds import grow

KINDS = ("triangle", "square", "rectangle", "pentagon", "star")


@pytest.mark.parametrize("seed", range(12))
def test_worlds_keep_the_rules_of_the_authors(seed):
    world = primfit.paper_world(rng=seed, kinds=KINDS)
    assert 5 <= len(world.solids) <= 7
    assert world.arena == primfit.Arena((10.0, 10.0), height=0.05)
    standing = []
    for solid in world.solids:
        assert solid.height == 0.05
        grown = grow(solid.footprint, 1.0)
        assert (grown >= 0.3).all()
        assert (grown <= 9.7).all()
        assert not any(shapely.Polygon(grown).intersects(other) for other in standing)
        standing.append(shapely.Polygon(solid.footprint))
        size = 2 * solid.size[0] if solid.kind == "star" else np.max(solid.size)
        assert 0.8 - 1e-9 <= size <= 1.1 + 1e-9
        assert abs(1000 * size - round(1000 * size)) < 1e-6
        if solid.kind == "rectangle":
            assert 0.25 <= solid.size[1] / solid.size[0] <= 0.75
        degrees = np.degrees(solid.angle)
        assert abs(degrees - round(degrees)) < 1e-6
        largest = {"triangle": 60, "square": 45, "rectangle": 45}.get(solid.kind, 36)
        assert degrees <= largest + 1e-6


def test_same_rng_same_world():
    assert primfit.paper_world(rng=5).to_dict() == primfit.paper_world(rng=5).to_dict()
    assert primfit.paper_world(rng=5).to_dict() != primfit.paper_world(rng=6).to_dict()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kinds": ["hexagon"]}, r"kinds must be taken from triangle, .*; not \['hexagon'\]"),
        ({"kinds": []}, "kinds must be taken from triangle"),
        ({"n_solids": 1.5}, "n_solids must be a count"),
        ({"n_solids": 60, "max_attempts": 50}, "no place for solid .* after max_attempts=50"),
    ],
)
def test_mistakes(arguments, message):
    with pytest.raises(ValueError, match=message):
        primfit.paper_world(**{"rng": 1, **arguments})


def test_walls_around_right_angles_are_exact():
    solid = primfit.Prism.rectangle(1.0, 0.6, center=(2, 3), angle=0.3, height=0.05)
    world = primfit.built_of_walls(primfit.World([solid], primfit.Arena()))
    (built,) = world.solids
    assert world.arena == primfit.Arena()
    assert built.kind == "rectangle"
    np.testing.assert_allclose(built.size, (1.05, 0.65))
    np.testing.assert_allclose(built.center, solid.center)
    assert built.angle == pytest.approx(0.3)


@pytest.mark.parametrize("solid", [primfit.Prism.regular(3, 0.9), primfit.Prism.regular(5, 0.9)])
@pytest.mark.parametrize("thickness", [0.05, 0.02])
def test_walls_around_other_corners(solid, thickness):
    (built,) = primfit.built_of_walls(primfit.World([solid]), thickness).solids
    outline, boundary = shapely.Polygon(solid.footprint), shapely.Polygon(built.footprint)
    assert boundary.contains(outline)
    # Along its sides the boundary stands half a wall outside, at its corners up to 1.42 times that.
    middles = (solid.footprint + np.roll(solid.footprint, -1, axis=0)) / 2
    distance = shapely.distance(shapely.points(middles), boundary.exterior)
    np.testing.assert_allclose(distance, thickness / 2)
    corners = shapely.distance(outline, shapely.points(built.footprint))
    assert corners.max() <= thickness / np.sqrt(2) + 1e-9
    # It is what a walker sees who asks of each spot whether it is in one of the walls.
    spots = np.random.default_rng(1).uniform(-0.9, 0.9, size=(4000, 2))
    inside = shapely.contains_xy(outline, spots)
    for a, b in zip(solid.footprint, np.roll(solid.footprint, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        s, t = (spots - a) @ along, (spots - a) @ [-along[1], along[0]]
        on = (s > -thickness / 2) & (s < np.linalg.norm(b - a) + thickness / 2)
        inside |= on & (np.abs(t) < thickness / 2)
    np.testing.assert_array_equal(shapely.contains_xy(boundary, spots), inside)


def test_walls_are_for_prisms():
    with pytest.raises(TypeError, match=r"world.solids\[0\] must be a Prism, not Polyhedron"):
        primfit.built_of_walls(primfit.World([primfit.Polyhedron.box(1, 1, 1)]))
    with pytest.raises(ValueError, match="thickness must be greater than 0"):
        primfit.built_of_walls(primfit.World(), 0.0)


def test_the_path_goes_there_and_back():
    world = primfit.paper_world(rng=3)
    path = primfit.paper_path(world)
    empty = primfit.paper_path(primfit.World(arena=world.arena))
    assert len(empty) == 2500
    assert 2300 <= len(path) < 2500
    assert not path[:, 2].any()
    np.testing.assert_allclose(empty[:2], [[0.1, 0.1, 0], [0.3, 0.1, 0]])
    np.testing.assert_allclose(empty[49:52, :2], [[9.9, 0.1], [9.9, 0.3], [9.7, 0.3]])
    solids = shapely.union_all([shapely.Polygon(solid.footprint) for solid in world.solids])
    assert shapely.distance(solids, shapely.points(path[:, :2])).min() > 0
    with pytest.raises(ValueError, match="no valid pose"):
        primfit.paper_path(primfit.World([primfit.Prism.regular(4, 1.0)]), 0.4)


def test_the_sensor_does_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lidar = primfit.Lidar.paper(noise=0.01)
        few = primfit.Lidar.paper(horizontal_resolution=8)
    assert lidar.sigma == pytest.approx(0.03)
    assert (lidar.min_range, lidar.max_range) == (0.04, 3.0)
    assert lidar.mount[2, 3] == 0.03
    assert few.horizontal_resolution == 8
    with pytest.warns(UserWarning, match="outside the domain that Webots documents"):
        primfit.Lidar(field_of_view=2 * np.pi)


def test_most_beams_pass_over_the_walls():
    """The sensor is 2 cm below the tops: what rises meets a wall only from near by."""
    world = primfit.paper_world(rng=2)
    built = primfit.built_of_walls(world)
    scan = primfit.scan(built, primfit.paper_path(built, 0.4), primfit.Lidar.paper(), rng=1)
    on_walls = np.isin(scan.solid_index, [*range(len(world.solids)), -2]) & scan.is_return
    flat = np.hypot(*(scan.points - scan.origins)[on_walls, :2].T)
    assert flat.max() <= 0.03 / np.tan(0.2 / 7) + 1e-9
    rising = on_walls & (scan.directions[:, 2] > 0)
    flat = np.hypot(*(scan.points - scan.origins)[rising, :2].T)
    assert flat.max() <= 0.02 / np.tan(0.2 / 7) + 1e-9
