"""The paper's method: its steps, its repairs, its own rules."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import primfit
from primfit import PaperSettings
from primfit.clouds.noise import estimate_sigma
from primfit.paper import topology
from primfit.paper.classification import classify_by_sides
from primfit.planes.ransac import NoisyPoints, Orientation, draw_hypotheses

detect = partial(primfit.detect, method="paper")

SINGLES = ["triangle", "square", "rectangle", "pentagon", "star"]


def single(kind, seed, noise=0.0, size=None):
    world = primfit.random_world(1, size or (1.2 if kind == "star" else 1.0), [kind], rng=seed)
    path = primfit.grid_path(world, 0.125, rng=seed)
    return world, primfit.scan(world, path, primfit.Lidar(noise=noise), rng=seed)


class TestMaps:
    @pytest.mark.parametrize("seed", [101, 102, 103])
    def test_a_map_without_noise_is_found_exactly(self, seed):
        world = primfit.random_world(rng=seed)
        scan = primfit.scan(world, primfit.grid_path(world, rng=seed), rng=seed)
        found = detect(scan, rng=seed)
        report = primfit.evaluate(found, world)
        assert report.all_right
        assert report.n_planes == report.n_planes_true
        assert max(row.center_error_mm for row in report.rows) < 1e-3
        assert max(row.angle_error_deg for row in report.rows) < 1e-3
        np.testing.assert_allclose(found.arena.size, (2.0, 2.0), atol=1e-6)
        assert found.floor is not None
        np.testing.assert_allclose(found.floor.equation, [0, 0, 1, 0], atol=1e-9)
        for solid in found.solids:
            assert solid.base == pytest.approx(0.0, abs=1e-9)
            assert solid.height == pytest.approx(0.2, abs=0.005)

    def test_labels_and_inliers_agree_with_the_truth(self, scan, found):
        for i, plane in enumerate(found.planes):
            np.testing.assert_array_equal(np.flatnonzero(found.labels == i), plane.inliers)
            truth = scan.solid_index[plane.inliers]
            assert (truth == truth[0]).all()
        walls = scan.is_return & (scan.solid_index != -3)
        assert (found.labels[walls] >= 0).mean() > 0.999
        assert (found.labels[scan.solid_index == -3] == -1).all()

    def test_normals_point_to_the_free_side(self, scan, found):
        for plane in found.planes:
            towards = scan.directions[plane.inliers] @ plane.equation[:3]
            assert (towards < 0).all()
            assert np.linalg.norm(plane.equation[:3]) == pytest.approx(1.0)

    def test_boundaries_lie_on_their_planes(self, found):
        for plane in found.planes:
            distance = plane.boundary @ plane.equation[:3] + plane.equation[3]
            np.testing.assert_allclose(distance, 0.0, atol=1e-9)
            assert plane.area > 0.0

    @pytest.mark.parametrize("n_jobs", [2, 8])
    def test_bits_do_not_depend_on_threads(self, small_scan, n_jobs):
        one = detect(small_scan, rng=1, n_jobs=1)
        many = detect(small_scan, rng=1, n_jobs=n_jobs)
        np.testing.assert_array_equal(one.labels, many.labels)
        for a, b in zip(one.planes, many.planes, strict=True):
            np.testing.assert_array_equal(a.equation, b.equation)
            np.testing.assert_array_equal(a.covariance, b.covariance)
        assert one.to_json() == many.to_json()

    def test_order_of_rows_and_layers_do_not_matter(self, small_world, small_scan):
        shuffled = small_scan.select(np.random.default_rng(1).permutation(len(small_scan)))
        plain = primfit.Scan.from_rays(
            shuffled.origins,
            shuffled.directions,
            shuffled.ranges,
            sigma=shuffled.sigma,
            max_range=shuffled.max_range,
        )
        report = primfit.evaluate(detect(plain, rng=1), small_world)
        assert report.all_right
        assert report.rows[0].center_error_mm < 1.0


class TestSingles:
    @pytest.mark.parametrize("kind", SINGLES)
    def test_exact_without_noise(self, kind):
        world, scan = single(kind, 11)
        report = primfit.evaluate(detect(scan, rng=1), world)
        assert report.all_right, str(report)
        assert report.rows[0].center_error_mm < 1e-3
        assert report.rows[0].size_error_mm < 1e-2

    @pytest.mark.parametrize("kind", SINGLES[:4])
    @pytest.mark.parametrize("noise", [0.01, 0.025])
    def test_noise(self, kind, noise):
        world, scan = single(kind, 12, noise)
        found = detect(scan, rng=1)
        report = primfit.evaluate(found, world)
        assert report.all_right, str(report)
        assert report.rows[0].center_error_mm < 100 * noise
        assert found.sigma == noise

    @pytest.mark.parametrize("noise", [0.05, 0.06, 0.2])
    def test_too_much_noise_is_a_result_too(self, noise):
        _, scan = single("square", 13, noise)
        found = detect(scan, rng=1)
        assert isinstance(repr(found), str)
        assert len(found.labels) == len(scan)

    def test_sigma_is_estimated(self):
        world, scan = single("square", 14, 0.01)
        unknown = primfit.Scan.from_rays(
            scan.origins, scan.directions, scan.ranges, max_range=scan.max_range
        )
        found = detect(unknown, rng=1)
        assert found.sigma == pytest.approx(0.01, rel=0.25)
        assert primfit.evaluate(found, world).all_right

    def test_a_bare_cloud(self):
        world, scan = single("pentagon", 15)
        found = detect(scan.points[scan.is_return], rng=1)
        report = primfit.evaluate(found, world)
        assert report.all_right
        assert report.rows[0].center_error_mm < 1e-3
        assert found.arena is not None

    def test_without_an_arena(self):
        solid = primfit.Prism.regular(4, 0.3, center=(0.2, 0.1), angle=0.4)
        world = primfit.World([solid])
        path = primfit.grid_path(world, 0.2, rng=1)
        found = detect(primfit.scan(world, path, rng=1), rng=1)
        assert found.arena is None
        assert primfit.evaluate(found, world).all_right

    @pytest.mark.parametrize("columns", [100, 16, 4])
    @pytest.mark.filterwarnings("ignore:number_of_layers")
    def test_horizontal_resolution(self, columns):
        world = primfit.random_world(1, 1.0, ["square"], rng=16)
        path = primfit.grid_path(world, 0.125, rng=16)
        scan = primfit.scan(world, path, primfit.Lidar(horizontal_resolution=columns), rng=16)
        assert primfit.evaluate(detect(scan, rng=1), world).all_right

    def test_concave_footprints(self):
        ell = [(0.3, 0.3), (0.7, 0.3), (0.7, 0.45), (0.5, 0.45), (0.5, 0.7), (0.3, 0.7)]
        world = primfit.World([primfit.Prism(ell)], primfit.Arena((1, 1)))
        scan = primfit.scan(world, primfit.grid_path(world, 0.125, rng=1), rng=1)
        found = detect(scan, rng=1)
        report = primfit.evaluate(found, world)
        assert report.all_right
        np.testing.assert_allclose(
            found.solids[0].centroid[:2], world.solids[0].centroid[:2], atol=1e-6
        )
        assert report.rows[0].angle_error_deg < 1e-3


class TestLiteral:
    def test_the_papers_rules_find_a_noise_free_square(self):
        world, scan = single("square", 21)
        found = detect(scan, rng=1, settings=PaperSettings.literal())
        report = primfit.evaluate(found, world)
        assert report.n_right == 1
        assert report.rows[0].center_error_mm < 2.0

    def test_the_star_has_ten_vertices_and_no_name(self):
        _, scan = single("star", 22)
        found = detect(scan, rng=1, settings=PaperSettings.literal())
        assert [(solid.kind, len(solid.footprint)) for solid in found.solids] == [("polygon", 10)]

    def test_sixteen_planes_for_eight(self):
        """A threshold of one sigma peels each wall more than once."""
        _, scan = single("square", 23, 0.01)
        literal = detect(scan, rng=1, settings=PaperSettings.literal(threshold=0.01))
        assert len(literal.planes) > 12
        assert len(detect(scan, rng=1).planes) == 8

    @pytest.mark.parametrize(
        "change",
        [
            {"local": False, "max_trials": 2000},
            {"along_beams": False},
            {"msac": False},
            {"refit": False},
            {"compete": False},
            {"chain": False, "close": 0.03},
            {"model_selection": False},
            {"find_floor": False, "z_low": 0.02},
            {"eps": 0.1},
            {"threshold": 0.002},
        ],
    )
    def test_each_repair_can_be_taken_back_alone(self, change):
        world, scan = single("square", 24)
        found = detect(scan, rng=1, settings=PaperSettings(**change))
        assert primfit.evaluate(found, world).n_right == 1

    def test_settings_are_reported_and_checked(self, small_scan):
        found = detect(small_scan, rng=1)
        assert found.settings["threshold"] == pytest.approx(0.015)
        assert {"eps", "close", "min_points", "max_trials"} <= set(found.settings)
        with pytest.raises(ValueError, match="threshold must be greater than 0"):
            PaperSettings(threshold=-1.0)
        with pytest.raises(ValueError, match="min_points must be at least 3"):
            PaperSettings(min_points=2)


class TestSteps:
    @pytest.mark.parametrize("orientation", ["vertical", "horizontal", "any", (1, 1, 0)])
    def test_hypotheses_have_the_orientation(self, orientation):
        points = np.random.default_rng(1).uniform(size=(200, 3))
        ones = np.ones(200)
        wanted = Orientation.of(orientation)
        equations = draw_hypotheses(
            NoisyPoints(points, None, ones, ones), 100, wanted, np.random.default_rng(2)
        )
        assert len(equations) > 90
        np.testing.assert_allclose(np.linalg.norm(equations[:, :3], axis=1), 1.0)
        assert wanted.admits(equations[:, :3]).all()
        if orientation == "vertical":
            np.testing.assert_allclose(equations[:, 2], 0.0, atol=1e-12)

    def test_axis_with_an_angle(self):
        wanted = Orientation.of((0, 0, 2.0), max_angle=np.radians(10))
        tilted = [[0, np.sin(a), np.cos(a)] for a in np.radians([5, 9.9, 10.1, 90])]
        np.testing.assert_array_equal(wanted.admits(tilted), [True, True, False, False])
        for bad in ("sideways", (0, 0, 0), (1, 2)):
            with pytest.raises(ValueError, match="orientation must"):
                Orientation.of(bad)

    def test_degenerate_samples_are_skipped(self):
        same = np.ones((50, 3))
        ones = np.ones(50)
        cloud = NoisyPoints(same, None, ones, ones)
        assert len(draw_hypotheses(cloud, 20, Orientation.of("any"), np.random.default_rng(1))) == 0

    def test_same_set_of_points_counts_once(self):
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
        edges = [(i, (i + 1) % 4, corners[[i, (i + 1) % 4]]) for i in range(4)]
        outlines = topology.simple_cycles(edges)
        assert len(outlines) == 1
        np.testing.assert_allclose(outlines[0].mean(axis=0), [0.5, 0.5])
        # A diagonal adds two triangles; the two other ways around share their points.
        assert len(topology.simple_cycles([*edges, (0, 2, corners[[0, 2]])])) == 3

    def test_side_rule_and_angle_rule(self):
        square = primfit.Prism.regular(4, 1.0, angle=0.2).footprint
        outline = classify_by_sides(square, 0.05)
        assert (outline.kind, outline.angle) == ("square", pytest.approx(0.2))
        triangle = primfit.Prism.regular(3, 1.0, angle=np.radians(70)).footprint
        assert np.degrees(classify_by_sides(triangle, 0.05).angle) % 60 == pytest.approx(10)
        slim = primfit.Prism.rectangle(2.0, 1.0).footprint
        assert classify_by_sides(slim, 0.05).kind == "rectangle"
        assert classify_by_sides(slim, 2.0).kind == "square"
        odd = np.array([[0, 0], [2, 0], [1, 3]], float)
        assert classify_by_sides(odd, 0.05).kind == "polygon"

    @pytest.mark.parametrize(("noise", "rel"), [(0.003, 0.1), (0.01, 0.1), (0.02, 0.2)])
    def test_noise_is_estimated(self, world, noise, rel):
        path = primfit.grid_path(world, rng=1)
        sigmas = []
        for seed in range(5):
            scan = primfit.scan(world, path, primfit.Lidar(noise=noise), rng=seed)
            points, directions = scan.points[scan.is_return], scan.directions[scan.is_return]
            sigmas.append(estimate_sigma(points, directions, np.random.default_rng(seed)))
        assert np.median(sigmas) == pytest.approx(noise, rel=rel)


class TestUncertainty:
    def test_centre_and_angle_are_within_their_sigmas(self):
        z = []
        for seed in range(12):
            world, scan = single("square", 300 + seed, 0.01)
            found = detect(scan, rng=1)
            row = primfit.evaluate(found, world).rows[0]
            assert row.found == "square"
            solid = found.solids[0]
            difference = solid.center - world.solids[0].center
            z += [
                difference[0] / solid.sigmas["center_x"],
                difference[1] / solid.sigmas["center_y"],
            ]
            z.append(np.radians(row.angle_error_deg) / solid.sigmas["angle"])
            z.append((solid.size - world.solids[0].size) / solid.sigmas["size"])
        assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.6


class TestDetectPlanes:
    def test_three_faces_of_a_noisy_box(self):
        rng = np.random.default_rng(1)
        uv = rng.uniform(size=(3, 2000, 2))
        faces = [np.insert(uv[k], k, 0.0, axis=1) for k in range(3)]
        cloud = np.concatenate(faces) + 0.003 * rng.normal(size=(6000, 3))
        planes = primfit.detect_planes(cloud, rng=1)
        assert len(planes) == 3
        assert planes.sigma == pytest.approx(0.003, rel=0.3)
        alignment = np.abs(planes.equations[:, :3]).max(axis=1)
        assert (np.degrees(np.arccos(alignment)) < 0.2).all()
        np.testing.assert_allclose([plane.area for plane in planes], 1.0, rtol=0.1)
        truth = np.repeat([0, 1, 2], 2000)
        for i in range(3):
            assert np.bincount(truth[planes.labels == i]).max() > 0.98 * (planes.labels == i).sum()

    @pytest.mark.parametrize("orientation", ["vertical", "horizontal"])
    def test_orientation_holds_after_the_refit(self, orientation):
        rng = np.random.default_rng(2)
        uv = rng.uniform(size=(3, 1000, 2))
        faces = [np.insert(uv[k], k, 0.0, axis=1) for k in range(3)]
        cloud = np.concatenate(faces) + 0.01 * rng.normal(size=(3000, 3))
        planes = primfit.detect_planes(cloud, rng=1, orientation=orientation)
        expected = 1 if orientation == "horizontal" else 2
        large = [plane for plane in planes if len(plane.inliers) > 500]
        assert len(large) == expected
        z = np.abs(planes.equations[:, 2])
        np.testing.assert_allclose(z, 1.0 if orientation == "horizontal" else 0.0, atol=1e-9)

    @pytest.mark.parametrize("shift", [0.0, 5e6])
    @pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
    def test_scale_and_place(self, scale, shift):
        rng = np.random.default_rng(3)
        uv = rng.uniform(size=(2, 1500, 2))
        faces = [np.insert(uv[k], k, 0.0, axis=1) for k in range(2)]
        cloud = np.concatenate(faces) + 0.003 * rng.normal(size=(3000, 3))
        planes = primfit.detect_planes(cloud * scale + shift, rng=1)
        assert len(planes) == 2

    @pytest.mark.parametrize(
        ("points", "message"),
        [
            (np.empty((0, 3)), "points must hold at least 3 returns"),
            (np.zeros((2, 3)), "points must hold at least 3 returns"),
            (np.full((9, 3), np.nan), "points must hold at least 3 returns"),
            (np.zeros((9, 2)), "points must be an array"),
        ],
    )
    def test_clouds_that_cannot_hold_a_plane(self, points, message):
        with pytest.raises(ValueError, match=message):
            primfit.detect_planes(points)
        with pytest.raises(ValueError, match=message):
            detect(points)

    @pytest.mark.parametrize(
        "points", [np.ones((50, 3)), np.outer(np.linspace(0, 1, 50), [1, 2, 3]), np.eye(3)]
    )
    def test_degenerate_clouds_give_no_plane(self, points):
        assert len(primfit.detect_planes(points, rng=1)) == 0
        assert detect(points, rng=1).solids == ()

    def test_one_perfect_plane(self):
        xy = np.random.default_rng(4).uniform(size=(400, 2))
        planes = primfit.detect_planes(np.column_stack([xy, 1 + xy @ [0.1, 0.2]]), rng=1)
        assert len(planes) == 1
        assert (planes.labels == 0).all()
        assert planes[0].rms < 1e-9
        assert "1 planes" in repr(planes)

    def test_arguments(self):
        cloud = np.random.default_rng(5).uniform(size=(50, 3))
        for bad in ({"threshold": 0}, {"min_points": 2}, {"n_jobs": 0}):
            with pytest.raises(ValueError, match=next(iter(bad))):
                primfit.detect_planes(cloud, rng=1, **bad)
        with pytest.raises(ValueError, match="method must be one of"):
            primfit.detect(cloud, method="magic")

    @pytest.mark.parametrize("sigma", [-1.0, np.nan, np.inf, [0.1, 0.1]])
    def test_bad_sigma(self, small_scan, sigma):
        for call in (primfit.detect, primfit.detect_planes):
            with pytest.raises(ValueError, match="sigma must be"):
                call(small_scan, sigma=sigma, rng=1)
        with pytest.raises(ValueError, match="n_jobs must be"):
            detect(small_scan, n_jobs=0)
        with pytest.raises(TypeError, match="settings must be a PaperSettings"):
            detect(small_scan, settings={"eps": 0.1})

    def test_progress(self, small_scan):
        seen = []
        detect(small_scan, rng=1, progress=lambda *done: seen.append(done))
        assert len(seen) >= 8
        assert seen[-1][0] <= seen[-1][1]
