"""Footprints, solids, worlds and paths."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit
from primfit.geometry import footprints
from primfit.worlds.random_worlds import SIZES, grow

angles = st.floats(0, 2 * np.pi)
places = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))


def circular(difference, period):
    return abs((difference + period / 2) % period - period / 2)


class TestFootprints:
    @settings(max_examples=100, deadline=None)
    @given(st.integers(3, 14), angles, places, st.floats(1e-2, 1e3))
    def test_regular(self, n, angle, center, side):
        solid = primfit.Prism.regular(n, side, center=center, angle=angle)
        assert solid.kind == footprints.regular_name(n)
        assert solid.size == pytest.approx(side, rel=1e-6)
        assert circular(solid.angle - angle, 2 * np.pi / n) < 1e-5
        np.testing.assert_allclose(solid.center[:2], center, atol=1e-8)

    @settings(max_examples=60, deadline=None)
    @given(angles, places, st.floats(1.01, 5))
    def test_rectangle(self, angle, center, ratio):
        solid = primfit.Prism.rectangle(ratio, 1.0, center=center, angle=angle)
        assert solid.kind == "rectangle"
        np.testing.assert_allclose(solid.size, (ratio, 1.0), rtol=1e-6)
        assert circular(solid.angle - angle, np.pi) < 1e-5

    @settings(max_examples=60, deadline=None)
    @given(st.integers(3, 9), angles, places, st.floats(0.3, 0.8))
    def test_star(self, n, angle, center, inner):
        inner *= np.cos(np.pi / n)
        solid = primfit.Prism.star(n, 1.0, inner, center=center, angle=angle)
        assert solid.kind == "star"
        np.testing.assert_allclose(solid.size, (1.0, inner), rtol=1e-6)
        assert circular(solid.angle - angle, 2 * np.pi / n) < 1e-5

    def test_conventions_at_angle_zero(self):
        triangle = primfit.Prism.regular(3, 1.0)
        low = triangle.footprint[np.argsort(triangle.footprint[:, 1])[:2]]
        assert low[0, 1] == pytest.approx(low[1, 1])
        star = primfit.Prism.star(5, 1.0, 0.5)
        np.testing.assert_allclose(star.footprint[0], [0, 1], atol=1e-12)
        rectangle = primfit.Prism.rectangle(2.0, 1.0)
        np.testing.assert_allclose(np.ptp(rectangle.footprint, axis=0), [2, 1])

    def test_other_polygons(self):
        ell = primfit.Prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 1.0)
        assert ell.kind == "polygon"
        np.testing.assert_allclose(ell.centroid, [5 / 6, 5 / 6, 0.5])
        np.testing.assert_allclose(ell.center, [1, 1, 0.5])
        rhombus = primfit.Prism([(0, 0), (2, 1), (4, 0), (2, -1)])
        assert rhombus.kind == "polygon"
        isosceles = primfit.Prism([(0, 0), (1, 0), (0.5, 3)])
        assert isosceles.kind == "polygon"

    @settings(max_examples=50, deadline=None)
    @given(angles, st.integers(0, 10**6))
    def test_the_angle_of_a_polygon_turns_with_it(self, angle, seed):
        world = primfit.random_world(1, 2.0, ["polygon"], rng=seed)
        solid = world.solids[0]
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        turned = primfit.Prism(solid.footprint @ turn)
        assert circular(turned.angle - solid.angle - angle, 2 * np.pi) < 1e-6

    def test_cleaning(self):
        messy = [(0, 0), (0, 1), (0.5, 1), (1, 1), (1, 0), (0, 0)]
        outline = primfit.Prism(messy).footprint
        assert len(outline) == 4
        assert footprints.signed_area(outline) == pytest.approx(1.0)
        assert primfit.Prism(messy).kind == "square"

    @pytest.mark.parametrize(
        ("footprint", "message"),
        [
            ([(0, 0), (1, 1), (1, 0), (0, 1)], "does not cross itself"),
            ([(0, 0), (1, 0)], "at least 3 distinct vertices"),
            ([(0, 0), (1, 0), (2, 0)], "simple polygon|enclose an area"),
            ([(0, 0), (1, 0), (np.nan, 1)], "footprint must be finite"),
            ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], r"footprint must have shape \(n, 2\)"),
        ],
    )
    def test_bad_footprints(self, footprint, message):
        with pytest.raises(ValueError, match=message):
            primfit.Prism(footprint)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: primfit.Prism.regular(2, 1.0), "n must be at least 3"),
            (lambda: primfit.Prism.regular(3, -1.0), "side must be greater than 0"),
            (lambda: primfit.Prism.rectangle(1.0, 0.0), "short must be greater than 0"),
            (lambda: primfit.Prism.star(5, 1.0, 1.0), "inner must be less than outer"),
            (lambda: primfit.Prism([(0, 0), (1, 0), (0, 1)], height=0), "height must be greater"),
        ],
    )
    def test_bad_sizes(self, call, message):
        with pytest.raises(ValueError, match=message):
            call()

    def test_meshes_are_closed_and_face_outwards(self):
        solids = [primfit.Prism.star(5, 1, 0.4), primfit.Prism.regular(7, 1)]
        solids.append(primfit.Prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 1.0))
        for solid in solids:
            vertices, triangles = solid.to_mesh()
            edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
            once = {tuple(edge) for edge in edges.tolist()}
            assert len(once) == len(edges)
            assert all((b, a) in once for a, b in once)
            a, b, c = np.moveaxis(vertices[triangles], 1, 0)
            volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
            area = shapely.Polygon(solid.footprint).area
            assert volume == pytest.approx(area * solid.height)
            assert len(solid.faces) == len(solid.footprint) + 2


class TestWorlds:
    def test_same_rng_same_world(self):
        a, b = primfit.random_world(rng=5), primfit.random_world(rng=5)
        assert a.to_dict() == b.to_dict()
        assert a.to_dict() != primfit.random_world(rng=6).to_dict()

    @pytest.mark.parametrize("seed", range(20))
    def test_placement_rules(self, seed):
        world = primfit.random_world(rng=seed)
        assert 5 <= len(world.solids) <= 7
        for i, solid in enumerate(world.solids):
            assert (solid.footprint >= 0.12).all()
            assert (solid.footprint <= 2.0 - 0.12).all()
            grown = shapely.Polygon(grow(solid.footprint, 0.06))
            for other in world.solids[:i]:
                assert not grown.intersects(shapely.Polygon(other.footprint))

    def test_growing_moves_every_vertex_by_the_buffer(self):
        square = primfit.Prism.regular(4, 1.0, center=(3, 4)).footprint
        moved = np.linalg.norm(grow(square, 0.06) - square, axis=1)
        np.testing.assert_allclose(moved, 0.06)

    @pytest.mark.parametrize("kind", list(SIZES))
    def test_kinds_and_their_sizes(self, kind):
        world = primfit.random_world(1, 2.0, [kind], rng=1, height=(0.1, 0.3))
        assert world.solids[0].kind == kind
        assert 0.1 <= world.solids[0].height <= 0.3
        if kind != "polygon":
            least = np.min(world.solids[0].size)
            low, high = SIZES[kind]
            assert low / 2 - 1e-9 <= least <= high + 1e-9

    def test_full_map(self):
        with pytest.raises(primfit.WorldFullError, match=r"no place for solid .* max_attempts=100"):
            primfit.random_world(50, 1.0, rng=1, max_attempts=100)
        assert issubclass(primfit.WorldFullError, ValueError)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"n_solids": -1}, "n_solids must be a count"),
            ({"n_solids": (3, 2)}, "n_solids must be a range"),
            ({"n_solids": 2.5}, "n_solids must be a count"),
            ({"n_solids": (1, 2, 3)}, "n_solids must be a number or"),
            ({"angles": (0, np.inf)}, "angles must be a range"),
            ({"height": "tall"}, "height must be a number or"),
            ({"sizes": {"sqare": (0.1, 0.2)}}, "sizes must be taken from"),
            ({"kinds": ["blob"]}, "kinds must be taken from"),
            ({"kinds": []}, "kinds must be taken from"),
            ({"size": -1.0}, "size must be greater than 0"),
            ({"sizes": {"square": (0.3, 0.2)}}, r"sizes\['square'\] must be a range"),
            ({"sizes": {"square": (-0.3, 0.2)}}, r"sizes\['square'\] must be a range"),
            ({"buffer": -0.1}, "buffer must be at least 0"),
            ({"wall_distance": np.nan}, "wall_distance must be finite"),
        ],
    )
    def test_bad_arguments(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            primfit.random_world(**{"rng": 1, **arguments})

    def test_mask_and_matrix(self, world):
        assert world.mask.shape == (200, 200)
        assert world.matrix.shape == (200, 200, 3)
        area = sum(shapely.Polygon(solid.footprint).area for solid in world.solids)
        assert world.mask.mean() * 4 == pytest.approx(area, rel=0.02)
        np.testing.assert_array_equal(world.matrix.any(axis=2), world.mask)
        x, y, _ = world.solids[0].center
        assert world.mask[int(y / 0.01), int(x / 0.01)]

    def test_save_and_load(self, world, tmp_path):
        file = tmp_path / "world.json"
        world.save(file)
        again = primfit.World.load(file)
        assert again.to_dict() == world.to_dict()
        np.testing.assert_array_equal(again.solids[0].footprint, world.solids[0].footprint)
        open_world = primfit.World(world.solids)
        open_world.save(file)
        assert primfit.World.load(file).arena is None

    @pytest.mark.parametrize("content", ["", "{}", "[1]", '{"primfit": "scan"}', "\x00\xff"])
    def test_foreign_files(self, content, tmp_path):
        file = tmp_path / "world.json"
        file.write_text(content, encoding="latin-1")
        with pytest.raises(ValueError, match=r"world\.json is not a world"):
            primfit.World.load(file)

    def test_wrong_parts(self):
        with pytest.raises(TypeError, match=r"solids\[0\] must be a Prism"):
            primfit.World(["square"])
        with pytest.raises(TypeError, match="arena must be an Arena"):
            primfit.World(arena=(2, 2))

    def test_mesh_names_what_each_triangle_is(self, world):
        vertices, triangles, index = world.to_mesh()
        assert set(index.tolist()) == {*range(len(world.solids)), -2, -3}
        assert len(triangles) == len(index)
        assert vertices[triangles[index == -2]][..., 2].max() == world.arena.height
        assert not vertices[triangles[index == -3]][..., 2].any()
        json.dumps(world.to_dict())


class TestPaths:
    @pytest.mark.parametrize("seed", range(5))
    def test_grid_keeps_its_distance(self, seed):
        world = primfit.random_world(rng=seed)
        path = primfit.grid_path(world, rng=seed)
        assert len(path) % 4 == 0
        points = shapely.points(path[:, :2])
        for solid in world.solids:
            assert shapely.distance(points, shapely.Polygon(solid.footprint)).min() >= 0.045
        assert (path[:, :2] >= 0.045).all()
        headings = np.sort(path[:4, 2])
        np.testing.assert_allclose(np.diff(headings), np.pi / 2)

    def test_same_rng_same_path(self, world):
        np.testing.assert_array_equal(
            primfit.grid_path(world, rng=1), primfit.grid_path(world, rng=1)
        )

    def test_without_an_arena(self):
        world = primfit.World([primfit.Prism.regular(4, 0.3, center=(5, -3))])
        path = primfit.grid_path(world, 0.2, rng=1)
        assert np.abs(path[:, :2] - [5, -3]).max() <= 0.65

    def test_waypoints(self, world):
        path = primfit.waypoints(primfit.World(), [(0, 0), (1, 0), (1, 0), (1, 2)], spacing=0.5)
        np.testing.assert_allclose(path[:, 0], [0, 0.5, 1, 1, 1, 1, 1])
        np.testing.assert_allclose(path[[0, 2, -1], 2], [0, np.pi / 2, np.pi / 2])
        turned = primfit.waypoints(world, [(0.1, 0.1)], headings=4)
        np.testing.assert_allclose(turned[:, 2], np.arange(4) * np.pi / 2)

    def test_no_valid_pose(self):
        full = primfit.World([primfit.Prism.regular(4, 5.0, center=(1, 1))], primfit.Arena())
        with pytest.raises(ValueError, match="path has no valid pose"):
            primfit.grid_path(full)
        with pytest.raises(ValueError, match="path has no valid pose"):
            primfit.waypoints(full, [(0.5, 0.5), (1.5, 1.5)])
        with pytest.raises(ValueError, match="at least one waypoint"):
            primfit.waypoints(full, np.empty((0, 2)))
        with pytest.raises(ValueError, match="spacing must be greater than 0"):
            primfit.grid_path(full, spacing=0)


def test_doubled_vertices_count_once():
    square = [(0, 0), (1, 0), (1, 0), (1, 1), (0, 1), (0, 1e-13)]
    assert primfit.Prism(square).kind == "square"
    assert len(primfit.Prism(np.repeat(square, 2, axis=0)).footprint) == 4


def test_lidars_with_the_same_numbers_are_equal():
    assert primfit.Lidar() == primfit.Lidar()
    assert primfit.Lidar() != primfit.Lidar(mount="e-puck")
    assert len({primfit.Lidar(), primfit.Lidar(), primfit.Lidar(noise=0.1)}) == 2
