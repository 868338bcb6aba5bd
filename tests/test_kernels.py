"""The Rust kernels against closed forms, slow twins and scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import primfit
from primfit import _primfit
from primfit.scans import casting


def box(low=(0, 0, 0), high=(1, 1, 1)):
    return primfit.Prism(
        [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])],
        high[2] - low[2],
        base=low[2],
    ).to_mesh()


def random_triangles(rng, n):
    corners = rng.normal(size=(n, 1, 3)) + 0.5 * rng.normal(size=(n, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


def random_planes(rng, n):
    equations = rng.normal(size=(n, 4))
    return equations / np.linalg.norm(equations[:, :3], axis=1, keepdims=True)


class TestRays:
    @pytest.mark.parametrize("distance", [1e-3, 1.0, 1e2, 1e5])
    @pytest.mark.parametrize("offset", [0.0, 1e4])
    def test_tilted_wall_closed_form(self, distance, offset):
        rng = np.random.default_rng(1)
        normal = np.array([0.6, 0.64, 0.48])
        across = np.linalg.svd(normal[None])[2][1:]
        center = np.array([offset, -offset, offset / 2])
        reach = 10 * distance
        corners = center + distance * normal
        square = corners + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ across
        caster = primfit.RayCaster((square, [[0, 1, 2], [0, 2, 3]]))
        directions = normal + 0.5 * rng.uniform(-1, 1, (200, 2)) @ across
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        ranges, ids = caster.cast(np.tile(center, (200, 1)), directions)
        expected = distance / (directions @ normal)
        assert (ids >= 0).all()
        np.testing.assert_allclose(ranges, expected, rtol=1e-12, atol=1e-11)

    def test_twin_on_random_triangles(self):
        rng = np.random.default_rng(2)
        mesh = random_triangles(rng, 300)
        origins, directions = rng.normal(size=(2, 2000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        ranges, ids = primfit.RayCaster(mesh).cast(origins, directions)
        expected, expected_ids = reference.RayCaster(*mesh).cast(origins, directions)
        np.testing.assert_array_equal(ids, expected_ids)
        np.testing.assert_allclose(ranges, expected, atol=1e-9)
        assert 0.2 < np.isfinite(ranges).mean() < 1.0

    @pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
    @pytest.mark.parametrize("offset", [0.0, 1e6])
    def test_watertight_at_edges_corners_and_diagonals(self, scale, offset):
        rng = np.random.default_rng(3)
        star = primfit.Prism.star(5, 1.0, 0.5, angle=0.3, height=1.0)
        vertices, triangles = star.to_mesh()
        vertices = (vertices - star.center) * scale + offset
        inside = np.full(3, offset) + 0.2 * scale * rng.uniform(-1, 1, (50, 3))
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        share = rng.uniform(size=(len(edges), 3, 1))
        on_edges = (1 - share) * vertices[edges[:, :1]] + share * vertices[edges[:, 1:]]
        targets = np.concatenate([vertices, vertices[edges].mean(axis=1), on_edges.reshape(-1, 3)])
        origins = np.repeat(inside, len(targets), axis=0)
        directions = np.tile(targets, (len(inside), 1)) - origins
        ranges, ids = primfit.RayCaster((vertices, triangles)).cast(origins, directions)
        assert (ids >= 0).all()
        assert np.isfinite(ranges).all()

    def test_axis_parallel_rays_in_the_faces_of_bounding_boxes(self):
        caster = primfit.RayCaster(box())
        ranges, ids = caster.cast([[0.0, 0.5, -1], [0.5, 1.0, 2], [-1, 0, 0]], np.eye(3)[[2, 2, 0]])
        assert ids[0] >= 0  # along an edge face: the bottom has it
        assert ids[1] == -1
        assert ids[2] >= 0
        np.testing.assert_allclose(ranges[[0, 2]], 1.0)

    @pytest.mark.parametrize("distance", [1e3, 1e6, 1e9, 1e13, 1e25])
    def test_origins_far_outside(self, distance):
        rng = np.random.default_rng(4)
        way = rng.normal(size=(200, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        ranges, ids = primfit.RayCaster(box((-1, -1, -1))).cast(-distance * way, way)
        # Aimed at the middle, as well as rounding of the origin allows.
        if distance < 1e15:
            assert (ids >= 0).all()
            expected = distance - 1 / np.abs(way).max(axis=1)
            np.testing.assert_allclose(ranges, expected, rtol=4e-16, atol=1e-9)
        above = way + np.array([0, 0, distance])
        aside = primfit.RayCaster(box((-1, -1, -1))).cast(above, way * [1, 1, 0])
        assert (aside[1] == -1).all()

    @pytest.mark.parametrize("reach", [1.0, 1e3, 1e5])
    def test_ground_closed_form_to_a_nanometre(self, reach):
        rng = np.random.default_rng(5)
        corners = 2 * reach * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
        caster = primfit.RayCaster((corners, [[0, 1, 2], [0, 2, 3]]))
        origins = np.column_stack([rng.uniform(-1, 1, (500, 2)), rng.uniform(0.1, 2, 500)])
        targets = np.column_stack([reach * rng.uniform(-1, 1, (500, 2)), np.zeros(500)])
        ways = targets - origins
        expected = np.linalg.norm(ways, axis=1)
        # Where a slant ray meets the ground follows from the rounding of its direction.
        unit = ways / expected[:, None]
        expected = -origins[:, 2] / unit[:, 2]
        ranges, ids = caster.cast(origins, unit)
        assert (ids >= 0).all()
        np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)

    @pytest.mark.parametrize("seed", range(3))
    def test_neighbouring_beams_together_or_apart(self, seed):
        rng = np.random.default_rng(seed)
        mesh = random_triangles(rng, 2000)
        caster = primfit.RayCaster(mesh)
        layers, columns = rng.integers(2, 40, 2)
        elevation, azimuth = np.meshgrid(
            np.linspace(0.4, -0.4, layers), np.linspace(1.5, -1.5, columns), indexing="ij"
        )
        across = np.cos(elevation)
        beams = np.stack(
            [across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], axis=-1
        ).reshape(-1, 3)
        poses = np.tile(np.eye(4), (5, 1, 1))
        poses[:, :3, :3] = Rotation.random(5, random_state=rng).as_matrix()
        poses[:, :3, 3] = rng.normal(size=(5, 3))
        directions, ranges, ids = caster.cast_beams(poses, beams)
        np.testing.assert_allclose(
            directions, np.concatenate([beams @ pose[:3, :3].T for pose in poses]), atol=1e-15
        )
        origins = np.repeat(poses[:, :3, 3], len(beams), axis=0)
        shuffled = rng.permutation(len(origins))
        for rows in (np.arange(len(origins)), shuffled):
            again = caster.cast(origins[rows], directions[rows])
            np.testing.assert_array_equal(again[0], ranges[rows])
            np.testing.assert_array_equal(again[1], ids[rows])

    def test_a_million_triangles(self):
        axis = np.linspace(0, 1, 708)
        x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        row = np.arange(708 * 708).reshape(708, 708)
        a, b, c, d = (
            part.ravel() for part in (row[:-1, :-1], row[1:, :-1], row[1:, 1:], row[:-1, 1:])
        )
        triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        caster = primfit.RayCaster((np.column_stack([x, y, x * y]), triangles))
        rng = np.random.default_rng(6)
        places = rng.uniform(0, 1, (20_000, 2))
        # Down onto vertices, onto edges and between them.
        places[:5000] = axis[rng.integers(0, 708, (5000, 2))]
        places[5000:10_000, 0] = axis[rng.integers(0, 708, 5000)]
        origins = np.column_stack([places, np.full(20_000, 3.0)])
        ranges, ids = caster.cast(origins, np.tile([0.0, 0, -1], (20_000, 1)))
        assert (ids >= 0).all()
        assert len(caster._core) == 2 * 707**2
        np.testing.assert_allclose(3 - ranges, places.prod(axis=1), atol=1e-6)

    def test_ties_go_to_the_first_triangle(self):
        vertices, triangles = box()
        twice = np.concatenate([triangles[::-1], triangles])
        ranges, ids = primfit.RayCaster((vertices, twice)).cast([[-1, 0.3, 0.4]], [[1, 0, 0]])
        assert ranges[0] == 1.0
        assert ids[0] < len(triangles)

    def test_both_sides_and_the_origin_on_a_surface(self):
        caster = primfit.RayCaster(box())
        ranges, _ = caster.cast([[0.5, 0.4, 0.3], [0.0, 0.4, 0.3]], [[1, 0, 0], [-1, 0, 0]])
        np.testing.assert_array_equal(ranges, [0.5, 0.0])

    def test_a_ray_within_a_face_passes_it(self):
        caster = primfit.RayCaster(
            ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
        )
        directions = [[1, 0, 0], [1, 1, 0], [0.3, -0.7, 0]]
        for origin in ([-1, 0.5, 0], [0.5, 0.5, 0], [0, 0, 0]):
            ranges, ids = caster.cast(np.tile(origin, (3, 1)), directions)
            assert (ids == -1).all()
            assert np.isinf(ranges).all()

    def test_length_of_directions_does_not_matter(self):
        caster = primfit.RayCaster(box())
        directions = np.outer([1e-200, 1.0, 1e200], [1.0, 0.1, 0.2])
        ranges, _ = caster.cast(np.tile([-1, 0.3, 0.3], (3, 1)), directions)
        assert ranges[0] == ranges[1] == ranges[2]

    def test_degenerate_triangles_and_empty_meshes_are_never_hit(self):
        line = primfit.RayCaster(([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
        assert line.cast([[1, 0, 1]], [[0, 0, -1]])[1][0] == -1
        nothing = primfit.RayCaster((np.empty((0, 3)), np.empty((0, 3), int)))
        ranges, ids = nothing.cast([[1, 0, 1]], [[0, 0, -1]])
        assert ids[0] == -1
        assert np.isinf(ranges[0])

    @settings(max_examples=30, deadline=None)
    @given(st.integers(0, 2**32 - 1))
    def test_rigid_motion_leaves_ranges_unchanged(self, seed):
        rng = np.random.default_rng(seed)
        vertices, triangles = random_triangles(rng, 20)
        origins, directions = rng.normal(size=(2, 100, 3))
        turn = Rotation.random(random_state=rng).as_matrix()
        shift = rng.normal(size=3)
        before, ids = primfit.RayCaster((vertices, triangles)).cast(origins, directions)
        moved = primfit.RayCaster((vertices @ turn.T + shift, triangles))
        after, moved_ids = moved.cast(origins @ turn.T + shift, directions @ turn.T)
        same = ids == moved_ids
        assert same.mean() >= 0.99  # a ray within rounding of an edge may change sides
        np.testing.assert_allclose(after[same], before[same], atol=1e-9)


class TestProgress:
    def test_of_many_rays_comes_to_all_with_the_same_answer(self, monkeypatch):
        monkeypatch.setattr(casting, "_RAYS_AT_ONCE", 64)
        rng, seen = np.random.default_rng(3), []
        caster = primfit.RayCaster(box())
        origins, directions = rng.normal(size=(2, 150, 3))
        told = caster.cast(origins, directions, progress=lambda *done: seen.append(done))
        assert seen == [(64, 150), (128, 150), (150, 150)]
        for a, b in zip(told, caster.cast(origins, directions), strict=True):
            np.testing.assert_array_equal(a, b)

    def test_bad_rows_keep_their_numbers(self, monkeypatch):
        monkeypatch.setattr(casting, "_RAYS_AT_ONCE", 64)
        caster, directions = primfit.RayCaster(box()), np.ones((150, 3))
        directions[100] = 0
        with pytest.raises(ValueError, match="row 100"):
            caster.cast(np.ones((150, 3)), directions, progress=lambda *done: None)


class TestScores:
    @pytest.mark.parametrize("along_beams", [False, True])
    @pytest.mark.parametrize("msac", [False, True])
    @pytest.mark.parametrize("n_points", [0, 1, 1039, 1041, 20_000])
    def test_twin(self, n_points, msac, along_beams):
        rng = np.random.default_rng(4)
        points = rng.uniform(size=(n_points, 3))
        directions = rng.normal(size=(n_points, 3)) if along_beams else None
        equations = random_planes(rng, 37)
        scores = _primfit.score_planes(points, equations, 0.1, directions, msac)
        expected = reference.score_planes(points, equations, 0.1, directions, msac)
        # A point within rounding of the threshold may count on one side only.
        np.testing.assert_allclose(scores, expected, atol=1e-4 * n_points if msac else 0)
        assert n_points < 1000 or scores.max() > 10

    @pytest.mark.parametrize("msac", [False, True])
    def test_a_threshold_of_zero_counts_the_points_in_the_plane(self, msac):
        points = np.random.default_rng(5).integers(0, 3, (100, 3)).astype(float)
        scores = _primfit.score_planes(points, np.array([[0.0, 0, 1, -1]]), 0.0, None, msac)
        np.testing.assert_array_equal(scores, [(points[:, 2] == 1).sum()])

    @pytest.mark.parametrize("scale", [1e-33, 1e-10, 1e10])
    def test_scores_do_not_depend_on_the_unit_of_length(self, scale):
        rng = np.random.default_rng(5)
        points, equations = rng.uniform(size=(3000, 3)), random_planes(rng, 20)
        scaled = equations * [1, 1, 1, scale]
        expected = _primfit.score_planes(points, equations, 0.05)
        np.testing.assert_array_equal(
            _primfit.score_planes(scale * points, scaled, scale * 0.05), expected
        )

    def test_order_of_points_does_not_matter(self):
        rng = np.random.default_rng(5)
        points, equations = rng.uniform(size=(5000, 3)), random_planes(rng, 20)
        forward = _primfit.score_planes(points, equations, 0.05, None, True)
        backward = _primfit.score_planes(
            np.ascontiguousarray(points[::-1]), equations, 0.05, None, True
        )
        np.testing.assert_array_equal(forward, backward)

    def test_planes_seen_from_behind_score_nothing_but_turned_round(self):
        points = np.column_stack([np.random.default_rng(6).uniform(size=(100, 2)), np.zeros(100)])
        down = np.tile([0.0, 0.0, -1.0], (100, 1))
        equations = np.array([[0.0, 0, 1, 0], [0, 0, -1, 0]])
        scores = _primfit.score_planes(points, equations, 0.1, down)
        np.testing.assert_array_equal(scores, [100, 0, 0, 100])


class TestFits:
    def noisy_wall(self, seed=9, n=500, sigma=0.01):
        rng = np.random.default_rng(seed)
        wall = primfit.RayCaster(([[1, -9, -9], [1.5, 9, -9], [1.2, 0, 9]], [[0, 1, 2]]))
        directions = np.column_stack([np.ones(n), rng.uniform(-0.7, 0.7, (n, 2))])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        ranges, ids = wall.cast(np.zeros((n, 3)), directions)
        assert (ids == 0).all()
        return (ranges + sigma * rng.normal(size=n))[:, None] * directions, directions

    @pytest.mark.parametrize("rank", [1, 2, 3])
    def test_perpendicular_twin(self, rank):
        points, _ = self.noisy_wall()
        weights = np.random.default_rng(10).uniform(0.5, 2.0, len(points))
        space = np.eye(3)[:rank]
        got = _primfit.fit_plane(points, weights, space)
        expected = reference.fit_plane(points, weights, space)
        sign = np.sign(got[0][0] * expected[0][0])
        np.testing.assert_allclose(got[0], sign * expected[0], atol=1e-10)
        np.testing.assert_allclose(got[1], expected[1], atol=1e-12)
        assert got[2] == pytest.approx(expected[2], abs=1e-12)

    @pytest.mark.parametrize("rank", [1, 2, 3])
    def test_range_twin(self, rank):
        points, directions = self.noisy_wall()
        sigmas = np.full(len(points), 0.01)
        space = np.eye(3)[:rank]
        start = np.array([-1.0, 0.0, 0.0, 1.2])
        got = _primfit.fit_plane_to_ranges(points, directions, sigmas, start, space)
        expected = reference.fit_plane_to_ranges(points, directions, sigmas, start, space)
        np.testing.assert_allclose(got[0], expected[0], atol=1e-7)
        np.testing.assert_allclose(got[1], expected[1], rtol=1e-5, atol=1e-12)
        assert got[2] == pytest.approx(expected[2], rel=1e-6)

    def test_range_fit_is_the_least_squares_solution(self):
        points, directions = self.noisy_wall()
        ranges = np.linalg.norm(points, axis=1)

        def residuals(p):
            normal = np.array(
                [-np.cos(p[0]) * np.cos(p[1]), np.sin(p[0]) * np.cos(p[1]), np.sin(p[1])]
            )
            return ranges + p[2] / (directions @ normal)

        best = least_squares(residuals, [0.0, 0.0, 1.2], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        start = np.array([-1.0, 0.0, 0.0, 1.2])
        equation, _, rms = _primfit.fit_plane_to_ranges(
            points, directions, np.full(len(points), 0.01), start, np.eye(3)
        )
        assert equation[3] == pytest.approx(best.x[2], abs=1e-7)
        assert rms == pytest.approx(np.sqrt(np.mean(best.fun**2)), rel=1e-8)

    def test_covariance_is_honest(self):
        truth = np.linalg.solve(np.array([[1, -9, -9], [1.5, 9, -9], [1.2, 0, 9]]), np.ones(3))
        offset = 1 / np.linalg.norm(truth)
        z = []
        for seed in range(200):
            points, directions = self.noisy_wall(seed, n=100)
            equation, covariance, _ = _primfit.fit_plane_to_ranges(
                points, directions, np.full(100, 0.01), [-1.0, 0, 0, 1.2], np.eye(3)
            )
            z.append((abs(equation[3]) - offset) / np.sqrt(covariance[3, 3]))
        assert abs(np.mean(z)) < 0.25
        assert 0.85 < np.std(z) < 1.15

    def test_points_that_tell_no_plane(self):
        line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
        assert _primfit.fit_plane(line, np.ones(5), np.eye(3)) is None
        assert _primfit.fit_plane(np.ones((5, 3)), np.ones(5), np.eye(3)) is None
        assert _primfit.fit_plane(np.empty((0, 3)), np.empty(0), np.eye(3)) is None


@pytest.mark.parametrize("n_jobs", [2, 8])
def test_bits_do_not_depend_on_threads(n_jobs, world, scan):
    caster = primfit.RayCaster(world)
    one = caster.cast(scan.origins, scan.directions, n_jobs=1)
    many = caster.cast(scan.origins, scan.directions, n_jobs=n_jobs)
    for a, b in zip(one, many, strict=True):
        np.testing.assert_array_equal(a, b)
    rng = np.random.default_rng(11)
    points, equations = rng.uniform(size=(30_000, 3)), random_planes(rng, 300)
    for msac in (False, True):
        np.testing.assert_array_equal(
            _primfit.score_planes(points, equations, 0.01, None, msac, 1),
            _primfit.score_planes(points, equations, 0.01, None, msac, n_jobs),
        )
