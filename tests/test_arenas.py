"""Arenas of any outline, and what is done in them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely

import primfit
from primfit.worlds.paths import is_free

ELL = [(0, 0), (4, 0), (4, 1.5), (2, 1.5), (2, 3), (0, 3)]
CORRIDOR = [(-3, 1), (5, 1), (5, 5), (4, 5), (4, 2), (-3, 2)]


@pytest.fixture
def room():
    solid = primfit.Prism.rectangle(0.5, 0.3, center=(1, 1), angle=0.4, height=1.0)
    return primfit.World([solid], primfit.Arena(outline=ELL, height=1.0))


class TestArena:
    def test_a_rectangle_follows_from_its_size(self):
        arena = primfit.Arena((3.0, 2.0))
        np.testing.assert_array_equal(arena.outline, [[0, 0], [3, 0], [3, 2], [0, 2]])
        assert arena == primfit.Arena(outline=[(0, 0), (3, 0), (3, 2), (0, 2)])
        assert hash(arena) == hash(primfit.Arena((3, 2)))
        assert arena != primfit.Arena((3, 2), height=0.4)
        assert primfit.Arena(1.5).size == (1.5, 1.5)
        assert "outline" not in arena.to_dict()

    def test_an_outline_is_cleaned_and_tells_the_size(self):
        arena = primfit.Arena(outline=ELL[::-1])
        assert shapely.LinearRing(arena.outline).is_ccw
        assert arena.size == (4.0, 3.0)
        assert len(primfit.Arena(outline=[(0, 0), (2, 0), *ELL[1:]]).outline) == 6
        assert primfit.Arena((4, 3), outline=ELL).size == (4.0, 3.0)
        low, high = primfit.Arena(outline=CORRIDOR).bounds
        np.testing.assert_array_equal([low, high], [[-3, 1], [5, 5]])

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"outline": [(0, 0), (1, 1), (1, 0), (0, 1)]}, "outline must be a simple polygon"),
            ({"outline": [(0, 0), (1, 0)]}, "outline must have at least 3"),
            ({"outline": [(0, 0), (1, 0), (np.inf, 1)]}, "outline must be finite"),
            ({"size": (4, 2), "outline": ELL}, r"size must be left out .* 4 x 3 m, not \(4, 2\)"),
            ({"size": (4, 2, 1)}, "size must be a number or"),
            ({"size": (4, -2)}, "size must be greater than 0"),
            ({"height": 0}, "height must be greater than 0"),
        ],
    )
    def test_mistakes(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            primfit.Arena(**arguments)

    def test_clearance_is_the_signed_distance(self):
        arena = primfit.Arena(outline=ELL)
        positions = np.array([[1, 1], [3, 1], [3, 2], [-1, 1], [2, 1.5]])
        np.testing.assert_allclose(arena.clearance(positions), [1, 0.5, -0.5, -1, 0], atol=1e-12)


class TestWorldsInPolygons:
    def test_repr_says_what_it_is(self, room):
        assert repr(room) == "World(1 solid: rectangle; arena 4 x 3 m, 6 walls)"
        assert repr(room.arena) == "Arena(4 x 3 m, 6 walls, height 1 m)"

    def test_json_keeps_every_number(self, room, tmp_path):
        rng = np.random.default_rng(3)
        outline = np.array(CORRIDOR) + 0.01 * rng.normal(size=(6, 2))
        world = primfit.World(room.solids, primfit.Arena(outline=outline, height=0.7))
        world.save(tmp_path / "room.json")
        again = primfit.World.load(tmp_path / "room.json")
        assert again.arena == world.arena
        assert again.to_dict() == world.to_dict()

    def test_files_of_rectangles_are_as_before(self, tmp_path):
        content = {"primfit": "world", "solids": [], "arena": {"size": [2, 1], "height": 0.3}}
        (tmp_path / "old.json").write_text(json.dumps(content))
        assert primfit.World.load(tmp_path / "old.json").arena == primfit.Arena((2, 1))
        assert primfit.World(arena=primfit.Arena((2, 1))).to_dict()["arena"] == content["arena"]

    def test_outside_is_not_free(self, room):
        solid = shapely.Polygon(room.solids[0].footprint).area
        assert room.mask.shape == (300, 400)
        assert room.mask.mean() * 12 == pytest.approx(3 + solid, abs=0.02)
        np.testing.assert_array_equal(room.matrix.any(axis=2), room.mask)
        assert room.mask[250, 350]
        assert not room.mask[100, 350]

    def test_mesh_is_the_inside(self, room):
        vertices, triangles, index = room.to_mesh()
        corners = vertices[triangles[index == -3]]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (areas[:, 2] > 0).all()
        assert areas[:, 2].sum() / 2 == pytest.approx(9.0)
        corners = vertices[triangles[index == -2]]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.linalg.norm(areas, axis=1).sum() / 2 == pytest.approx(14.0)
        # Walls face the inside: from each a small step along its normal is in the room.
        steps = corners.mean(axis=1) + 1e-6 * areas / np.linalg.norm(areas, axis=1)[:, None]
        assert (room.arena.clearance(steps[:, :2]) > 0).all()

    @pytest.mark.parametrize("outline", [ELL, CORRIDOR])
    def test_ranges_are_those_of_the_polygon(self, outline):
        world = primfit.World(arena=primfit.Arena(outline=outline, height=5.0))
        path = primfit.grid_path(world, 0.7, headings=1, rng=2)
        lidar = primfit.Lidar(1, 0.0, 40, 2 * np.pi, max_range=100.0)
        scan = primfit.scan(world, path, lidar, rng=1)
        walls = shapely.LinearRing(outline)
        ends = scan.origins[:, :2] + 50.0 * scan.directions[:, :2]
        beams = shapely.linestrings(np.stack([scan.origins[:, :2], ends], axis=1))
        hits = shapely.intersection(beams, walls)
        expected = shapely.distance(shapely.points(scan.origins[:, :2]), hits)
        np.testing.assert_allclose(scan.ranges, expected, atol=1e-9)
        assert (scan.solid_index == -2).all()

    def test_poses_outside_are_passed_over(self, room):
        poses = [(1.0, 2.5, 0.0), (3.0, 2.5, 0.0), (1.0, 1.0, 0.0)]
        with pytest.warns(UserWarning, match="path has 2 of 3 poses inside a solid or outside"):
            scan = primfit.scan(room, poses, rng=1)
        assert np.unique(scan.pose_index).tolist() == [0]
        with pytest.raises(ValueError, match=r"no valid pose: .* arena 4 x 3 m, 6 walls"):
            primfit.scan(room, poses[1], rng=1)

    @pytest.mark.parametrize("seed", range(4))
    def test_paths_stay_inside(self, seed, room):
        grid = primfit.grid_path(room, 0.2, clearance=0.12, rng=seed)
        with pytest.warns(UserWarning, match="31 of 94 positions are nearer than clearance=0.12"):
            crossing = primfit.waypoints(room, [(0.3, 2.7), (3.7, 1.2), (3.7, 0.3)], clearance=0.12)
        inside = shapely.Polygon(ELL).buffer(-0.12 + 1e-9, join_style="mitre")
        for path in (grid, crossing):
            assert len(path) > 10
            assert shapely.intersects_xy(inside, path[:, :2]).all()
        # Nothing that keeps the distance is left out.
        spots = np.random.default_rng(seed).uniform((0, 0), (4, 3), size=(500, 2))
        solid = shapely.Polygon(room.solids[0].footprint)
        far = shapely.distance(solid, shapely.points(spots)) >= 0.12
        expected = shapely.contains_xy(inside, spots) & far
        np.testing.assert_array_equal(is_free(room, spots, 0.12), expected)

    def test_walls_are_counted_and_drawn(self, room):
        import matplotlib as mpl

        mpl.use("Agg")
        path = primfit.grid_path(room, 0.5, rng=1)
        scan = primfit.scan(room, path, primfit.Lidar(max_range=5.0), rng=1)
        found = primfit.detect(scan, "planes", rng=1)
        assert primfit.evaluate(found, room).n_planes_true == 10
        for ax in (room.plot(), found.plot(world=room)):
            drawn = [patch.get_xy() for patch in ax.patches]
            assert any(len(xy) == 7 and np.array_equal(xy[:6], ELL) for xy in drawn)
