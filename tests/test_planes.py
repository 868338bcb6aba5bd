"""Planes of bare clouds of any kind and scale, nothing told."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull

import primfit
from primfit._primfit import thinned
from primfit.planes.plane import axes_of


def cube(n=1500, sigma=0.003, seed=1):
    rng = np.random.default_rng(seed)
    uv = rng.uniform(size=(6, n, 2))
    faces = [np.insert(uv[k], k // 2, float(k % 2), axis=1) for k in range(6)]
    return np.concatenate(faces) + sigma * rng.normal(size=(6 * n, 3))


def iou(labels, truth):
    """Of each true plane with the found one that covers it best."""
    best = []
    for t in range(truth.max() + 1):
        own = truth == t
        found = np.unique(labels[own & (labels >= 0)])
        best.append(
            max(((labels == k) & own).sum() / ((labels == k) | own).sum() for k in [*found, -2])
        )
    return np.array(best)


def share_alike(labels, others):
    """Share of the points in the same part of two partitions, however their parts are numbered."""
    table = np.zeros((labels.max() + 2, others.max() + 2), dtype=int)
    np.add.at(table, (labels + 1, others + 1), 1)
    parts = table[1:, 1:]
    same = table[0, 0] + parts[linear_sum_assignment(-parts)].sum()
    return same / len(labels)


class TestClouds:
    def test_cube(self):
        planes = primfit.detect_planes(cube())
        assert len(planes) == 6
        assert iou(planes.labels, np.repeat(np.arange(6), 1500)).min() > 0.95
        np.testing.assert_allclose(planes.thresholds, 0.012, rtol=0.15)
        np.testing.assert_allclose([plane.area for plane in planes], 1.0, rtol=0.08)
        for plane in planes:
            middle = np.where(np.abs(plane.equation[:3]) > 0.9, np.round(plane.centroid), 0.5)
            np.testing.assert_allclose(plane.centroid, middle, atol=0.02)

    def test_perfect_cube(self):
        side = np.linspace(0, 1, 21)
        grid = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
        shell = grid[(np.abs(grid - 0.5) == 0.5).any(axis=1)]
        planes = primfit.detect_planes(shell)
        assert len(planes) == 6
        assert max(plane.rms for plane in planes) < 1e-9

    @pytest.mark.parametrize(
        "points",
        [
            np.ones((1000, 3)),
            np.outer(np.linspace(0, 1, 1000), [1, 2, 3]),
            np.outer(np.linspace(0, 1, 1000), [1, 2, 3]) + 1e5,
            np.tile(np.eye(3), (50, 1)),
            np.random.default_rng(1).normal(size=(3000, 3)),
            np.random.default_rng(1).uniform(size=(3000, 3)),
        ],
        ids=["equal", "line", "far line", "three", "normal", "uniform"],
    )
    def test_no_plane(self, points):
        planes = primfit.detect_planes(points)
        assert len(planes) == 0
        assert (planes.labels == -1).all()
        assert planes.equations.shape == (0, 4)

    def test_copies_count_once_and_share_the_label(self):
        cloud = cube(400)
        twice = np.repeat(cloud, 2, axis=0)
        once, both = primfit.detect_planes(cloud), primfit.detect_planes(twice)
        np.testing.assert_array_equal(both.labels, np.repeat(once.labels, 2))

    def test_curved_surfaces_stay_without_a_plane(self):
        rng = np.random.default_rng(2)
        n = 8000
        turn, up = 2 * np.pi * rng.uniform(size=n), rng.uniform(size=n)
        cylinder = np.column_stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), up])
        sphere = rng.normal(size=(n, 3))
        sphere *= 0.4 / np.linalg.norm(sphere, axis=1, keepdims=True)
        cylinder += (1, 1, 0.2)
        sphere += (-1, -1, 0.7)
        floor = np.column_stack([rng.uniform(-2, 2, (n, 2)), np.zeros(n)])
        cloud = np.concatenate([floor, cylinder, sphere])
        planes = primfit.detect_planes(cloud + 0.005 * rng.normal(size=cloud.shape))
        truth = np.repeat([0, 1, 2], n)
        assert iou(planes.labels, np.where(truth == 0, 0, -1)).min() > 0.98
        assert len(planes) == 1

    def test_a_step_of_five_sigma_is_two_planes(self):
        rng = np.random.default_rng(3)
        xy = rng.uniform(size=(6000, 2))
        z = np.where(xy[:, 0] < 0.5, 0.0, 0.025) + 0.005 * rng.normal(size=6000)
        planes = primfit.detect_planes(np.column_stack([xy, z]))
        assert iou(planes.labels, (xy[:, 0] > 0.5).astype(int)).min() > 0.9


def rectangle(corner, u, v, n, sigma, rng):
    """Points scattered over a rectangle, with noise across it."""
    corner, u, v = (np.array(x, float) for x in (corner, u, v))
    at, normal = rng.uniform(size=(n, 2)), np.cross(u, v)
    off = rng.normal(0, sigma, (n, 1)) * normal / np.linalg.norm(normal)
    return corner + at[:, :1] * u + at[:, 1:] * v + off


class TestLayersAndGaps:
    @pytest.mark.parametrize(("apart", "sigma"), [(0.1, 0.01), (0.02, 0.001)])
    def test_two_sheets_ten_sigma_apart_are_two_planes(self, apart, sigma):
        rng = np.random.default_rng(3)
        sheets = [
            rectangle([0, y, 0], [5, 0, 0], [0, 0, 2.5], 6000, sigma, rng) for y in (0, apart)
        ]
        planes = primfit.detect_planes(np.concatenate(sheets))
        assert len(planes) == 2
        assert iou(planes.labels, np.repeat([0, 1], 6000)).min() > 0.99
        assert planes.sigma == pytest.approx(sigma, rel=0.1)

    def test_one_thick_sheet_is_one_plane(self):
        rng = np.random.default_rng(3)
        sheet = rectangle([0, 0, 0], [5, 0, 0], [0, 0, 2.5], 12_000, 0.05, rng)
        assert len(primfit.detect_planes(sheet)) == 1

    @pytest.mark.parametrize(("nx", "ny"), [(3, 1), (6, 1), (3, 3)])
    def test_equal_gaps_are_all_cut(self, nx, ny):
        rng = np.random.default_rng(4)
        parts = [
            rectangle([1.3 * i, 1.3 * j, 0], [1, 0, 0], [0, 1, 0], 1000, 0.003, rng)
            for i in range(nx)
            for j in range(ny)
        ]
        planes = primfit.detect_planes(np.concatenate(parts))
        assert len(planes) == nx * ny
        assert iou(planes.labels, np.repeat(np.arange(nx * ny), 1000)).min() > 0.95


class TestClutterAndCurves:
    def test_a_tank_has_hardly_a_plane(self):
        rng = np.random.default_rng(3)
        turn, z = rng.uniform(0, 2 * np.pi, 20_000), rng.uniform(0, 5, 20_000)
        radius = 10 + rng.normal(0, 0.02, 20_000)
        tank = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])
        planes = primfit.detect_planes(tank)
        assert len(planes) <= 2
        assert (planes.labels >= 0).mean() < 0.02

    @pytest.mark.parametrize("seed", [1, 4, 5, 7])
    def test_returns_scattered_around_a_sensor_are_no_plane(self, seed):
        rng = np.random.default_rng(seed)
        around, up = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(-0.4, 0.4, 2000)
        ranges = 20 * rng.uniform(size=2000) ** (1 / 3)
        directions = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
        assert len(primfit.detect_planes((ranges * np.array(directions)).T)) == 0


@pytest.fixture(scope="module")
def turns():
    def block(x, y, width, depth, height):
        return primfit.Prism(
            np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [width, depth] + [x, y], height
        )

    solids = [block(1.4, 1.1, 1.2, 0.8, 0.8), block(5.5, 3.7, 1.0, 0.6, 1.6)]
    world = primfit.World(solids, arena=primfit.Arena((8, 6), height=3.0))
    lidar = primfit.Lidar(
        16, 0.5236, 1800, 2 * np.pi, max_range=100.0, noise=1e-4, mount=(0, 0, 1.2)
    )
    scan = primfit.scan(world, np.tile([3.7, 2.8, 0.3], (10, 1)), lidar, rng=1)
    points = scan.points[scan.is_return]
    x, y, _ = points.T
    sides = [x < 0.1, x > 7.9, y < 0.1, y > 5.9]
    of_arena = scan.solid_index[scan.is_return] == -2
    return points, np.select([of_arena & side for side in sides], range(4), -1), 28800


class TestRows:
    """Turns of a spinning sensor that stands still: points crowd along each row of its layers."""

    @pytest.mark.parametrize("sigma", [None, 0.01])
    def test_ten_turns_have_the_planes_of_one(self, turns, sigma):
        points, truth, n_once = turns
        once = primfit.detect_planes(points[:n_once], sigma=sigma)
        planes = primfit.detect_planes(points, sigma=sigma)
        assert once.settings["stride"] == 1
        assert 5 <= planes.settings["stride"] <= 20
        assert len(planes) <= len(once) + 3
        assert iou(planes.labels, truth).min() > 0.95

    def test_beams_measured_again_and_again_have_the_planes_of_one_turn(self):
        """Layers as close as columns: points crowd at each beam, not along rows."""
        block = primfit.Prism.regular(4, 1.0, center=(1.5, 1.5), height=1.0)
        world = primfit.World([block], primfit.Arena((5, 4), height=2.5))
        lidar = primfit.Lidar(
            48, 0.8, 380, 2 * np.pi, max_range=100.0, noise=1e-4, mount=(0, 0, 1.2)
        )
        scan = primfit.scan(world, np.tile([3.5, 2.0, 0.3], (10, 1)), lidar, rng=1)
        once = primfit.detect_planes(scan.points[: 48 * 380][scan.is_return[: 48 * 380]])
        planes = primfit.detect_planes(scan.points[scan.is_return])
        assert once.settings["stride"] == 1
        assert 4 <= planes.settings["stride"] <= 10
        assert len(planes) <= len(once) + 2

    @pytest.mark.parametrize("rng", [0, 2, 3])
    def test_low_walls_of_a_large_room_are_no_rows(self, rng):
        """Band by band they look like the rows of a floor whose noise is as thick as they are high."""
        world = primfit.random_world(6, size=8.0, rng=3)
        lidar = primfit.Lidar(32, 0.6, 720, 6.28, max_range=30.0, noise=5e-4)
        path = primfit.grid_path(world, spacing=3.0, headings=1, rng=rng)[:2]
        scan = primfit.scan(world, path, lidar, rng=1)
        planes = primfit.detect_planes(scan.points[scan.is_return])
        assert planes.settings["stride"] == 1
        hit, (x, y, _) = scan.solid_index[scan.is_return], scan.points[scan.is_return].T
        walls = [(hit == -2) & side for side in (x < 0.1, x > 7.9, y < 0.1, y > 7.9)]
        assert iou(planes.labels, np.select(walls, range(4), -1)).min() > 0.9

    def test_scale_place_and_threads(self, turns):
        points = turns[0]
        here = primfit.detect_planes(points, n_jobs=1)
        there = primfit.detect_planes(100 * points + 5e5, n_jobs=2)
        np.testing.assert_array_equal(primfit.detect_planes(points, n_jobs=2).labels, here.labels)
        assert there.settings["stride"] == here.settings["stride"]
        assert share_alike(here.labels, there.labels) > 0.99


class TestInvariance:
    @pytest.mark.parametrize(
        ("scale", "shift"), [(0.01, 0.0), (100.0, 0.0), (1.0, 5e6), (100.0, 5e6)]
    )
    def test_scale_and_place(self, scale, shift):
        cloud = cube(600)
        here = primfit.detect_planes(cloud)
        there = primfit.detect_planes(cloud * scale + shift)
        assert (here.labels == there.labels).mean() > 0.999
        np.testing.assert_allclose(
            [plane.area for plane in there],
            [plane.area * scale**2 for plane in here],
            rtol=1e-2,
        )

    def test_threads(self):
        cloud = cube()
        one = primfit.detect_planes(cloud, n_jobs=1)
        for n_jobs in (2, 8):
            many = primfit.detect_planes(cloud, n_jobs=n_jobs)
            np.testing.assert_array_equal(many.labels, one.labels)
            np.testing.assert_array_equal(many.equations, one.equations)


class TestOrder:
    @pytest.mark.parametrize("step", [0.0, 0.004])
    def test_the_order_of_rows_decides_nothing(self, step):
        """Also where coordinates come in steps, so that distances are alike and points repeat."""
        cloud = cube(300, sigma=0.01)
        if step:
            cloud = np.round(cloud / step) * step
        here = primfit.detect_planes(cloud)
        assert len(here) >= 6
        for seed in range(3):
            order = np.random.default_rng(seed).permutation(len(cloud))
            there = primfit.detect_planes(cloud[order])
            np.testing.assert_array_equal(there.labels, here.labels[order])
            np.testing.assert_array_equal(there.equations, here.equations)


class TestArguments:
    def test_sigma_is_a_number_one_a_point_or_a_function(self):
        cloud = cube(300)
        one = primfit.detect_planes(cloud, sigma=0.003)
        for sigma in (np.full(len(cloud), 0.003), lambda points: np.full(len(points), 0.003)):
            np.testing.assert_array_equal(
                primfit.detect_planes(cloud, sigma=sigma).labels, one.labels
            )

    def test_threshold_and_sigma(self):
        cloud = cube()
        told = primfit.detect_planes(cloud, threshold=0.006)
        assert (told.thresholds == 0.006).all()
        for plane in told:
            distance = cloud[plane.inliers] @ plane.equation[:3] + plane.equation[3]
            assert np.abs(distance).max() <= 0.006
        assert len(primfit.detect_planes(cloud, sigma=0.003)) == 6
        assert primfit.detect_planes(cloud, sigma=0.003).sigma == 0.003

    def test_least_points(self):
        cloud = np.concatenate([cube(), 0.2 * cube(60) + 5])
        assert len(primfit.detect_planes(cloud, min_points=500)) == 6
        assert len(primfit.detect_planes(cloud)) > 6

    def test_orientation_keeps_what_lies_on_wanted_planes(self):
        cloud = cube()
        upright = primfit.detect_planes(cloud, orientation="vertical")
        level = primfit.detect_planes(cloud, orientation=(0, 0, 1))
        assert (len(upright), len(level)) == (4, 2)
        np.testing.assert_allclose(upright.equations[:, 2], 0.0, atol=1e-12)
        np.testing.assert_allclose(level.equations[:, 2], 1.0, atol=1e-12)

    def test_origins_turn_normals_and_give_ranges(self):
        world = primfit.World(
            [primfit.Prism.rectangle(0.4, 0.3, center=(1, 1))], primfit.Arena((2, 2))
        )
        lidar = primfit.Lidar(noise=0.003, horizontal_resolution=200, number_of_layers=16)
        scan = primfit.scan(world, [(0.4, 0.4, 0.8), (1.6, 1.6, -2.3)], lidar=lidar, rng=1)
        planes = primfit.detect_planes(scan)
        rows = np.flatnonzero(scan.is_return)
        again = primfit.detect_planes(scan.points[rows], scan.origins[rows], scan.sigma)
        np.testing.assert_array_equal(planes.labels[rows], again.labels)
        assert len(planes) >= 5
        for plane in planes:
            towards = (scan.directions[plane.inliers] @ plane.equation[:3] < 0).mean()
            assert towards > 0.97
            assert np.isfinite(plane.covariance).all()


class TestOutlines:
    def test_a_hole_and_a_concave_side(self):
        rng = np.random.default_rng(4)
        xy = rng.uniform(size=(20_000, 2)) * 4
        window = (np.abs(xy - [1, 1]) < 0.5).all(axis=1)
        notch = (xy > 2.5).all(axis=1)
        xy = xy[~window & ~notch]
        cloud = np.column_stack([xy, 0.01 * rng.normal(size=len(xy)) + 2])
        (plane,) = primfit.detect_planes(cloud)
        assert len(plane.holes) == 1
        assert plane.area == pytest.approx(16 - 1 - 2.25, rel=0.03)
        ring = shapely.LinearRing(plane.boundary @ axes_of(plane.equation[:3]).T)
        hole = shapely.LinearRing(plane.holes[0] @ axes_of(plane.equation[:3]).T)
        assert (ring.is_ccw, hole.is_ccw) == (True, False)
        np.testing.assert_allclose(plane.boundary[:, 2], 2.0, atol=0.01)
        np.testing.assert_allclose(np.ptp(plane.holes[0], axis=0), [1, 1, 0], atol=0.1)
        area = np.array([12.75, 1, 2.25])
        expected = (16 * 2 - area[1] * 1 - area[2] * 3.25) / area[0]
        np.testing.assert_allclose(plane.centroid, [expected, expected, 2], atol=0.02)

    @pytest.mark.parametrize("n", [5_000, 50_000])
    @pytest.mark.parametrize("shape", ["square", "disc", "slanted", "frame", "lines"])
    def test_many_points_are_thinned_but_for_the_corners_of_their_hull(self, n, shape):
        rng = np.random.default_rng(n)
        at = rng.uniform(size=(n, 2))
        radius = np.abs(at - 0.5).max(axis=1)
        at = {
            "square": at,
            "disc": rng.normal(size=(n, 2)),
            "slanted": at @ np.array([[1.0, 0.9], [0.0, 0.02]]),
            "frame": at[radius > 0.4],
            "lines": np.column_stack([np.round(5 * at[:, 0]), at[:, 1]]),
        }[shape]
        few = thinned(at)
        assert len(few) < len(at) or len(at) < 4_000
        assert set(map(tuple, few)) <= set(map(tuple, at))
        assert ConvexHull(few).volume == pytest.approx(ConvexHull(at).volume, rel=1e-12)

    def test_covariance_is_honest(self):
        z = []
        for seed in range(60):
            rng = np.random.default_rng(seed)
            xy = rng.uniform(size=(400, 2))
            cloud = np.column_stack([xy, 0.01 * rng.normal(size=400)])
            plane = primfit.detect_planes(cloud, min_points=200)[0]
            spread = np.sqrt(np.diag(plane.covariance))
            z += [plane.equation[0] / spread[0], plane.equation[1] / spread[1]]
        assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


class TestRecorded:
    def test_roofs(self, data):
        scores = []
        for name in ("Pyramid_roof_1054136", "Two-sided_hip_roof_17234", "building3d_22523"):
            if name.startswith("building"):
                table = np.loadtxt(data / f"roofs/{name}.txt")
                cloud, truth = table[:, :3], table[:, 3].astype(int)
            else:
                cloud = np.loadtxt(data / f"roofs/{name}.pts")[:, :3]
                truth = np.loadtxt(data / f"roofs/{name}.seg", dtype=int) - 1
                truth[truth == 4] = -1
            planes = primfit.detect_planes(cloud)
            right = (iou(planes.labels, truth) >= 0.75).sum()
            scores.append(2 * right / (truth.max() + 1 + len(planes)))
        assert np.mean(scores) >= 0.95

    def test_board_in_every_pose(self, data):
        sizes, poses = [], (3, 16, 38)
        for pose in poses:
            cloud = primfit.read_points(data / f"vlp16_board/pose{pose}_full.pcd")
            board = {
                tuple(p)
                for p in primfit.read_points(data / f"vlp16_board/pose{pose}_target.pcd").tolist()
            }
            truth = np.array([0 if tuple(p) in board else -1 for p in cloud.tolist()])
            planes = primfit.detect_planes(cloud, origins=(0, 0, 0))
            assert iou(planes.labels, truth)[0] >= 0.95
            plane = planes[np.bincount(planes.labels[(truth == 0) & (planes.labels >= 0)]).argmax()]
            flat = (plane.boundary - plane.centroid) @ axes_of(plane.equation[:3]).T
            corners = shapely.get_coordinates(
                shapely.minimum_rotated_rectangle(shapely.Polygon(flat))
            )
            sizes.append(np.sort(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)))
            assert plane.equation[:3] @ plane.centroid < 0
        np.testing.assert_allclose(np.median(sizes, axis=0), [0.610, 0.850], rtol=0.03)

    def test_walls_and_floor_of_a_scan_are_in_one_piece(self, data):
        cloud = primfit.read_points(data / "vlp16_board/pose3_full.pcd")
        planes = primfit.detect_planes(cloud)
        large = [plane for plane in planes if len(plane.inliers) > 500]
        for i, a in enumerate(large):
            for b in large[:i]:
                is_along = abs(a.equation[:3] @ b.equation[:3]) > np.cos(np.radians(10))
                off = np.abs(cloud[b.inliers] @ a.equation[:3] + a.equation[3])
                assert not is_along or np.median(off) > planes.thresholds[0]
        # Beams of one ring lie in a plane, or on a cone, of their own.
        assert len(planes) < 50

    @pytest.mark.parametrize(("scale", "shift"), [(0.01, 0.0), (100.0, 0.0), (1.0, 5e6)])
    def test_board_scaled_and_moved(self, data, scale, shift):
        cloud = primfit.read_points(data / "vlp16_board/pose3_full.pcd")
        here = primfit.detect_planes(cloud).labels
        there = primfit.detect_planes(cloud * scale + shift).labels
        assert share_alike(here, there) > 0.95


class TestClutter:
    def test_scattered_points_do_not_swallow_planes(self):
        rng = np.random.default_rng(4)
        planes = []
        for k in range(6):
            flat = np.insert(rng.uniform(0.0, 2.0, (4000, 2)), k % 3, 0.0, axis=1)
            planes.append(flat + np.array([5.0 * (k % 3), 5.0 * (k // 3), k % 2]))
        planes = np.concatenate(planes) + 0.01 * rng.normal(size=(24_000, 3))
        clutter = rng.uniform(planes.min(axis=0), planes.max(axis=0), (6000, 3))
        truth = np.repeat([*range(6), -1], [4000] * 6 + [6000])
        found = primfit.detect_planes(np.concatenate([planes, clutter]))
        report = primfit.evaluate_segmentation(found.labels, truth, min_iou=0.8, unlabeled=-1)
        assert (report.recall, report.precision) == (1.0, 1.0)
        assert found.sigma == pytest.approx(0.01, rel=0.1)

    def test_two_walls_in_noise_as_wide_as_a_third_of_them(self):
        rng = np.random.default_rng(5)
        walls = [np.insert(rng.uniform(0.0, 0.3, (600, 2)), k, 0.0, axis=1) for k in range(2)]
        cloud = np.concatenate(walls) + 0.025 * rng.normal(size=(1200, 3))
        found = primfit.detect_planes(cloud, sigma=0.025)
        report = primfit.evaluate_segmentation(
            found.labels, np.repeat([0, 1], 600), min_iou=0.5, unlabeled=-1
        )
        assert (report.recall, report.precision) == (1.0, 1.0)


def test_a_plane_without_noise_beside_noisy_ones():
    rng = np.random.default_rng(1)
    walls = [np.insert(rng.uniform(1, 2, (800, 2)), k, 1.0, axis=1) for k in (0, 1)]
    noisy = np.concatenate(walls) + rng.normal(0, 0.002, (1600, 3))
    exact = np.insert(rng.uniform(1, 2, (800, 2)), 0, 2.0, axis=1)
    assert len(primfit.detect_planes(np.concatenate([noisy, exact]))) == 3


def test_the_rims_of_a_thin_leaf_are_planes_across_gaps_that_chance_leaves():
    rng = np.random.default_rng(0)
    size = np.array([2.0, 1.0, 0.04])
    faces = []
    for face in range(6):
        axis, upper = divmod(face, 2)
        n = int(5000 * size.prod() / size[axis])
        some = size * rng.random((n, 3))
        some[:, axis] = upper * size[axis] + rng.normal(0, 0.001, n)
        faces.append(some)
    planes = primfit.detect_planes(np.concatenate(faces), sigma=0.001)
    truth = np.repeat(np.arange(6), [len(some) for some in faces])
    report = primfit.evaluate_segmentation(planes.labels, truth, min_iou=0.8, unlabeled=-1)
    assert (report.recall, report.precision) == (1.0, 1.0)
    assert len(primfit.detect(np.concatenate(faces), sigma=0.001).solids) == 1
