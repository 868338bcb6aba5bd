"""Depth cameras: the pinhole, the gate by depth, noise, disparity and shadow, and what is made of it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import depth_readings

import primfit
from primfit.planes.passages import passages
from primfit.sensors.depth_camera import OPTICAL
from primfit.sensors.sensor import RangeGate, Sensor

ARENA = primfit.Arena((4, 4), height=2.0)
ROOM = primfit.World(arena=ARENA)
BOARD = primfit.Prism([[2.0, 1.6], [2.1, 1.6], [2.1, 2.2], [2.0, 2.2]], 1.5)
BOXED = primfit.World([BOARD, primfit.Prism.regular(5, 0.3, center=(2.8, 3.2), height=0.4)], ARENA)
AXIAL = (0.0012, 0.0019, 0.4)


def looking(x, y, z, tilt=0.0):
    """A camera that looks along x, and down by a tilt."""
    pose = np.eye(4)
    cos, sin = np.cos(tilt), np.sin(tilt)
    pose[:3, :3] = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]) @ OPTICAL
    pose[:3, 3] = x, y, z
    return pose


POSE = looking(0.5, 2.0, 0.7, 0.1)


def camera(**changes):
    return primfit.DepthCamera(
        **({"width": 120, "height": 90, "fx": 100.0, "fy": 100.0, "max_depth": 9.0} | changes)
    )


def points_of(scan, sensor, pose, of=0):
    """The points of a depth image of a scan in the world."""
    depth = scan.image("depth")[of]
    points = primfit.points_of_depth(depth, sensor.fx, sensor.fy, sensor.cx, sensor.cy)
    return points.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]


class TestGeometry:
    @settings(max_examples=25, deadline=None)
    @given(st.integers(0, 10**6), st.booleans())
    def test_points_of_the_image_are_those_of_the_scan(self, seed, is_upside_down):
        rng = np.random.default_rng(seed)
        focal = rng.uniform(10, 60, 2) * [1.0, -1.0 if is_upside_down else 1.0]
        sensor = primfit.DepthCamera(
            23, 17, *focal, *rng.uniform(0, 20, 2), max_depth=rng.uniform(0.5, 4), axial_noise=AXIAL
        )
        pose = looking(*rng.uniform(0.5, 1.5, 3), tilt=rng.uniform(-1, 1))
        scan = primfit.scan(BOXED, pose, sensor, rng=seed)
        points = points_of(scan, sensor, pose)
        np.testing.assert_array_equal(np.isnan(points), np.isnan(scan.points))
        np.testing.assert_allclose(points, scan.points, rtol=0, atol=1e-12)

    def test_planar_poses_look_ahead(self):
        sensor = camera(mount=(0.1, 0.0, 0.5))
        scan = primfit.scan(ROOM, (1.0, 2.0, np.pi / 2), sensor)
        axis = scan.image("points")[0].reshape(90, 120, 3)[44:46, 59:61].mean(axis=(0, 1))
        np.testing.assert_allclose(axis, [1.0, 4.0, 0.5], atol=1e-9)
        left, right = scan.image("points")[0, 45, [0, -1]]
        assert left[0] < right[0]
        top, bottom = scan.image("points")[0, [0, -1], 60]
        assert top[2] > bottom[2]
        same = primfit.scan(
            ROOM, (1.0, 2.0, np.pi / 2), replace(sensor, mount=looking(0.1, 0.0, 0.5))
        )
        np.testing.assert_array_equal(same.points, scan.points)

    def test_a_wall_across_the_axis_has_one_depth(self):
        scan = primfit.scan(ROOM, looking(1.0, 2.0, 1.0), camera())
        depth, where = scan.image("depth")[0], scan.image("solid_index")[0]
        wall = np.abs(scan.image("points")[0][..., 0] - 4.0) < 1e-9
        assert wall.sum() > 3000
        np.testing.assert_allclose(depth[wall], 3.0, atol=1e-12)
        assert (where[wall] == -2).all()
        np.testing.assert_allclose(
            scan.image("range")[0], depth / camera().directions[..., 2], rtol=1e-15
        )


class TestGate:
    def test_limits_are_of_depth(self):
        sensor = camera(min_depth=1.2, max_depth=2.5)
        scan = primfit.scan(BOXED, POSE, sensor)
        every = primfit.scan(BOXED, POSE, camera(min_depth=0.0, max_depth=99.0))
        is_within = (every.depths >= 1.2) & (every.depths <= 2.5)
        np.testing.assert_array_equal(scan.is_return, is_within)
        assert 0.1 < is_within.mean() < 0.9
        np.testing.assert_array_equal(scan.ranges[is_within], every.ranges[is_within])
        assert np.isinf(scan.ranges[~is_within]).all()
        cosines = sensor.directions[..., 2].ravel()
        np.testing.assert_allclose(scan.min_range * cosines, 1.2)
        np.testing.assert_allclose(scan.max_range * cosines, 2.5)
        beyond = every.ranges > scan.max_range
        np.testing.assert_array_equal(beyond, every.depths > 2.5)

    @pytest.mark.parametrize(
        "changes",
        [
            {},
            {"axial_noise": 0.01},
            {"axial_noise": AXIAL, "resolution": 0.004},
            {"axial_noise": AXIAL, "baseline": 0.1, "disparity_step": 0.25},
            {"baseline": 0.1, "disparity_noise": 0.2, "shadow": True},
            {"baseline": -0.1, "disparity_noise": 0.1, "disparity_step": 0.1, "shadow": True},
            {"baseline": 0.2, "stereo": True},
            {"baseline": -0.2, "stereo": True, "shadow": True, "axial_noise": AXIAL},
            {"baseline": 0.01, "disparity_step": 1.0},
        ],
    )
    def test_readings_are_those_of_the_twin(self, changes):
        """With the noise that a lidar of the same beams has."""
        sensor = camera(min_depth=0.3, max_depth=3.2, **changes)
        exact = {
            "beams": sensor.directions,
            "min_range": 0.0,
            "max_range": 100.0,
            "mount": np.eye(4),
        }
        poses = np.stack([POSE, looking(1.0, 1.5, 0.4)])
        true = primfit.scan(BOXED, poses, primfit.Lidar(**exact), rng=5)
        noisy = primfit.scan(BOXED, poses, primfit.Lidar(**exact, noise=0.01), rng=5)
        normal = (noisy.ranges - true.ranges).reshape(2 * 90, 120)
        cosines = sensor.directions[..., 2]
        depths = (true.ranges.reshape(2, 90, 120) * cosines).reshape(-1, 120)
        expected = depth_readings(depths, sensor.gate, normal).reshape(2, 90, 120)
        scans = [primfit.scan(BOXED, poses, sensor, rng=5, n_jobs=n) for n in (1, 2, 5)]
        got = scans[0].image("depth")
        assert 0.2 < np.isfinite(got).mean() < 1.0
        # A step that lies just between two is rounded to either.
        is_same = np.isclose(got, expected, rtol=1e-12, atol=1e-12, equal_nan=True)
        assert is_same.mean() > 0.9998
        if not changes.get("disparity_step"):
            assert is_same.all()
        for other in scans[1:]:
            np.testing.assert_array_equal(other.ranges, scans[0].ranges)
            np.testing.assert_array_equal(other.points, scans[0].points)

    @pytest.mark.parametrize("name", ["kinect", "realsense_d435"])
    def test_depths_are_as_noisy_as_the_camera_says(self, name):
        noisy = getattr(primfit.DepthCamera, name)(min_depth=0.2, max_depth=5.0)
        intrinsics = noisy.width, noisy.height, noisy.fx, noisy.fy
        exact = primfit.DepthCamera(*intrinsics, min_depth=0.2, max_depth=5.0)
        poses = np.stack([looking(0.4, y, 0.5) for y in (1.0, 2.0, 3.0)])
        measured = primfit.scan(BOXED, poses, noisy, rng=2).image("depth")
        true = primfit.scan(BOXED, poses, exact, rng=2).image("depth")
        known = np.isfinite(measured)
        error, depth = measured[known] - true[known], true[known]
        told = noisy.sigma_at(depth)
        counted = 0
        for low, high in ((0.5, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 4.0)):
            some = (depth >= low) & (depth < high)
            if some.sum() < 20_000:
                continue
            counted += 1
            rms, sigma = (np.sqrt(np.mean(x[some] ** 2)) for x in (error, told))
            assert rms == pytest.approx(sigma, rel=0.02), (low, high)
        assert counted >= 3

    def test_sigma_of_a_beam_is_that_of_its_depth_along_it(self):
        sensor = camera(
            axial_noise=(0.001, 0.002, 0.5), baseline=0.1, disparity_noise=0.3, disparity_step=0.5
        )
        scan = primfit.scan(BOXED, POSE, sensor, rng=1)
        z, cosines = scan.image("depth")[0], sensor.directions[..., 2]
        pixels = np.hypot(0.3, 0.5 / np.sqrt(12)) * z**2 / 10.0
        expected = np.hypot(0.001 + 0.002 * (z - 0.5) ** 2, pixels) / cosines
        known = np.isfinite(z)
        np.testing.assert_allclose(scan.image("sigma")[0][known], expected[known], rtol=1e-12)
        assert np.isfinite(scan.sigma).all()
        assert primfit.scan(BOXED, POSE, camera()).sigma == 0.0
        rounding = camera(resolution=0.012).sigma_at([1.0])
        np.testing.assert_allclose(rounding, 0.012 / np.sqrt(12))
        np.testing.assert_allclose(
            sensor.sigma_at([np.inf, np.nan, -1.0])[:2], sensor.sigma_at(9.0)
        )

    @pytest.mark.parametrize("baseline", [0.1, -0.1])
    def test_the_shadow_is_what_the_second_eye_does_not_see(self, baseline):
        sensor = camera(width=400, height=60, fx=400.0, baseline=baseline, shadow=True)
        pose = looking(0.5, 2.0, 0.7)
        scan = primfit.scan(BOXED, pose, sensor)
        whole = primfit.scan(BOXED, pose, replace(sensor, shadow=False))
        lost = whole.is_return & ~scan.is_return
        eye = pose[:3, 3] + baseline * pose[:3, 0]
        ways = whole.points - eye
        reach, _ = primfit.RayCaster(BOXED).cast(np.tile(eye, (len(ways), 1)), ways)
        hidden = reach < np.linalg.norm(ways, axis=1) - 1e-6
        # To a pixel at either end of a shadow.
        assert (lost != hidden).mean() < 0.2 * hidden.mean() + 1e-3
        near, far = (whole.image("depth")[0, 30][k] for k in (200, 0))
        width = 400 * 0.1 * (1 / near - 1 / far)
        board = lost.reshape(60, 400)[30]
        assert abs(board.sum() - width) <= 1.5
        columns = np.flatnonzero(board)
        edges = np.flatnonzero(np.abs(np.diff(whole.image("depth")[0, 30])) > 0.5)
        at = columns.max() if baseline > 0 else columns.min() - 1
        assert np.abs(edges - at).min() <= 1

    def test_a_pixel_that_a_second_eye_may_miss_tells_nothing(self):
        far = {"max_depth": 2.0, "min_depth": 0.1}
        one, two = camera(**far), camera(**far, baseline=0.05, shadow=True)
        alone, with_eye = (primfit.scan(BOXED, POSE, each) for each in (one, two))
        assert not alone.is_blank.any()
        np.testing.assert_array_equal(with_eye.is_blank, ~with_eye.is_return)
        assert np.isnan(with_eye.ranges[~with_eye.is_return]).all()
        image = with_eye.image("depth")[0]
        for sensor, blank in ((one, 0), (two, int((~with_eye.is_return).sum()))):
            for missing in (0.0, np.nan, np.inf):
                recorded = sensor.scan(np.where(np.isfinite(image), image, missing), POSE)
                assert recorded.is_blank.sum() == blank

    def test_stereo_has_no_depth_beside_what_its_second_camera_sees(self):
        sensor = camera(baseline=0.2, stereo=True)
        depth = primfit.scan(ROOM, looking(1.0, 2.0, 1.0), sensor).image("depth")[0]
        # 20 pixels metres over 3 m.
        row = depth[45]
        assert np.flatnonzero(np.isfinite(row))[0] == 7
        assert np.isfinite(row[7:]).all()


class TestRecorded:
    @pytest.fixture(scope="class")
    @classmethod
    def images(cls):
        sensor = camera(axial_noise=AXIAL)
        poses = np.stack([POSE, looking(1.0, 1.0, 0.5)])
        return sensor, poses, primfit.scan(BOXED, poses, sensor, rng=3)

    def test_images_are_scans_again(self, images):
        sensor, poses, scan = images
        again = sensor.scan(scan.image("depth"), poses)
        np.testing.assert_allclose(again.points, scan.points, atol=1e-12)
        for name in ("origins", "directions", "layer", "column", "pose_index", "max_range"):
            np.testing.assert_array_equal(getattr(again, name), getattr(scan, name))
        np.testing.assert_allclose(again.sigma, scan.sigma, rtol=1e-9)
        assert again.solid_index is None

    def test_units_of_images(self, images):
        sensor, poses, scan = images
        depth = scan.image("depth")[0]
        known = np.isfinite(depth)
        words = np.where(known, np.rint(1000 * np.where(known, depth, 0)), 0).astype(np.uint16)
        millimetres = sensor.scan(words, poses[0])
        np.testing.assert_array_equal(millimetres.is_return, known.ravel())
        np.testing.assert_allclose(millimetres.depths[known.ravel()], depth[known], atol=5.1e-4)
        scaled = sensor.scan(5 * words, poses[0], scale=1 / 5000)
        np.testing.assert_allclose(scaled.points, millimetres.points, atol=1e-12)
        alone = sensor.scan(words)
        np.testing.assert_array_equal(alone.origins, 0.0)
        grid = primfit.points_of_depth(words, 100, 100, 59.5, 44.5, scale=0.001)
        np.testing.assert_allclose(alone.points, grid.reshape(-1, 3), atol=1e-12)

    def test_a_camera_without_noise_does_not_say_that_there_is_none(self, images):
        _, poses, scan = images
        assert camera().scan(scan.image("depth"), poses).sigma is None
        planar = camera().scan(scan.image("depth")[0], (1.0, 2.0, 0.0))
        np.testing.assert_array_equal(planar.path, [[1.0, 2.0, 0.0]])
        np.testing.assert_allclose(planar.origins[0], [1.0, 2.0, 0.06])

    def test_planes_of_an_image_take_the_organised_path(self, images):
        sensor, _, scan = images
        depth = scan.image("depth")[0]
        found = primfit.detect_planes(sensor.scan(depth))
        grid = primfit.points_of_depth(depth, 100, 100, 59.5, 44.5)
        sigma = sensor.scan(depth).sigma
        same = primfit.detect_planes(grid, (0, 0, 0), sigma)
        assert len(found) >= 2
        np.testing.assert_array_equal(found.labels, same.labels)
        np.testing.assert_allclose(found.equations, same.equations, atol=1e-9)

    def test_ranges_that_were_logged(self, images):
        sensor, poses, scan = images
        ranges = scan.image("range")
        ranges[0, 3, :5] = np.nan
        logged = primfit.Scan.from_readings(poses, sensor, ranges)
        rows = np.flatnonzero(~np.isnan(ranges.ravel()))
        assert len(logged) == len(scan) - 5
        for name in ("depths", "sigma", "min_range", "max_range", "layer", "column"):
            np.testing.assert_allclose(getattr(logged, name), getattr(scan, name)[rows], rtol=1e-12)

    def test_errors(self, images):
        sensor, poses, scan = images
        depth = scan.image("depth")
        for arguments, message in [
            ((depth[0, 1:], poses), r"depth_images must have shape \(90, 120\) or \(p, 90, 120\)"),
            ((depth,), "poses must be given, one for each of 2 images"),
            ((depth, poses[:1]), "poses must be one for each of 2 images, not 1"),
        ]:
            with pytest.raises(ValueError, match=message):
                sensor.scan(*arguments)
        with pytest.raises(TypeError, match="depth must be an array of numbers"):
            sensor.scan(np.full((90, 120), "a"))
        with pytest.raises(ValueError, match="scale must be greater than 0"):
            sensor.scan(depth[0], scale=0.0)


class TestScans:
    @pytest.fixture(scope="class")
    @classmethod
    def scan(cls):
        sensor = camera(max_depth=2.5, baseline=0.05, disparity_noise=0.2, shadow=True)
        poses = np.stack([POSE, looking(1.0, 1.0, 0.5)])
        return primfit.scan(BOXED, poses, sensor, rng=3)

    def test_survive_files_and_processes(self, scan, tmp_path):
        scan.save(tmp_path / "scan.npz")
        for again in (primfit.Scan.load(tmp_path / "scan.npz"), pickle.loads(pickle.dumps(scan))):
            for name in ("points", "ranges", "depths", "sigma", "min_range", "max_range"):
                np.testing.assert_array_equal(getattr(again, name), getattr(scan, name))
            assert repr(again) == repr(scan)

    def test_some_of_their_beams(self, scan):
        rows = np.arange(5, len(scan), 7)
        some = scan.select(rows)
        for name in ("depths", "sigma", "min_range", "max_range"):
            np.testing.assert_array_equal(getattr(some, name), getattr(scan, name)[rows])
        moved = some.moved(np.array([1.0, 2.0, 3.0]))
        np.testing.assert_array_equal(moved.depths, some.depths)
        image = some.image("depth")
        known = np.zeros(scan.image().shape, dtype=bool)
        known.ravel()[rows] = True
        np.testing.assert_array_equal(image[known], some.depths)
        assert np.isnan(image[~known]).all()
        assert (some.image("solid_index")[~known] == -1).all()

    def test_images_of_other_scans(self, scan):
        lidar = primfit.scan(BOXED, (1, 1, 0), primfit.Lidar())
        assert lidar.image("range").shape == (1, 8, 100)
        with pytest.raises(ValueError, match="it has no depths"):
            lidar.image()
        with pytest.raises(ValueError, match="which layer and column"):
            primfit.Scan.from_rays((0, 0, 0), np.eye(3), [1, 2, 3]).image("range")
        with pytest.raises(ValueError, match="one beam in each pose, layer and column"):
            scan.select([3, 3]).image()
        with pytest.raises(ValueError, match="of must be one of 'depth'"):
            scan.image("color")

    def test_limits_of_beams(self):
        rays = (0, 0, 0), np.eye(3), [1, np.inf, 3]
        limits = {"min_range": [0.1, 0.2, 0.3], "max_range": [2, 4, 6]}
        scan = primfit.Scan.from_rays(*rays, **limits)
        np.testing.assert_array_equal(scan.select([2, 0]).max_range, [6, 2])
        np.testing.assert_array_equal(
            primfit.Scan.from_points(np.eye(3), (0, 0, 0), **limits).min_range, [0.1, 0.2, 0.3]
        )
        for changes, message in [
            ({"max_range": [2, 0.1, 6]}, "min_range must be less than max_range, but row 1 is not"),
            ({"max_range": 0.25}, "min_range must be less than max_range, but row 2 is not"),
            ({"max_range": [2, 4]}, r"max_range must be a number or have shape \(3,\)"),
            ({"max_range": [2, np.nan, 6]}, "max_range must be finite"),
            ({"min_range": [-1, 0, 0]}, "min_range, the least of its rows, must be at least 0"),
        ]:
            with pytest.raises(ValueError, match=message):
                primfit.Scan.from_rays(*rays, **(limits | changes))

    def test_beams_go_as_far_as_their_own_limit(self):
        """Down on the floor: those without return passed it where they see far enough."""
        down = np.tile([0.0, 0.0, -1.0], (4, 1))
        starts = [[x, 0.0, 1.0] for x in range(4)]
        ranges = [np.inf, np.inf, 1.0, 3.0]
        scan = primfit.Scan.from_rays(starts, down, ranges, max_range=[0.5, 2.0, 2.0, 2.0])
        places = passages(scan, np.array([0, 0, 1.0, 0]), np.eye(3)[:2], 0.01)
        np.testing.assert_array_equal(places[:, 0], [1.0, 3.0])
        blank = replace(scan, ranges=np.array([np.nan, np.nan, 1.0, 3.0]))
        places = passages(blank, np.array([0, 0, 1.0, 0]), np.eye(3)[:2], 0.01)
        np.testing.assert_array_equal(places[:, 0], [3.0])

    @pytest.mark.parametrize("shadow", [False, True])
    def test_solids_of_a_camera(self, shadow):
        """Nothing is lost, though pixels end at different ranges."""
        world = primfit.random_world(2, 1.2, ["square", "pentagon"], rng=3)
        eye = {"baseline": 0.02, "shadow": True, "disparity_step": 0.02} if shadow else {}
        focal = 26.0
        sensor = primfit.DepthCamera(
            40, 30, focal, focal, min_depth=0.05, max_depth=0.8, axial_noise=AXIAL, **eye
        )
        scan = primfit.scan(world, primfit.grid_path(world, 0.2, rng=3), sensor, rng=3)
        found = primfit.detect(scan, rng=1)
        report = primfit.evaluate(found, world)
        assert [row.found for row in report.rows] == [row.truth for row in report.rows]
        assert max(row.center_error_mm for row in report.rows) < 1.0
        assert not report.spurious
        assert found.settings["dropouts"] < 0.001
        assert len(found.labels) == len(scan)
        if not shadow:
            # What one limit for all would make of it.
            alike = replace(scan, max_range=float(np.max(scan.max_range)))
            assert primfit.detect(alike, rng=1).settings["dropouts"] > 0.01

    def test_poses_of_a_camera(self):
        world = primfit.random_world(2, 1.2, ["square", "pentagon"], rng=3)
        sensor = primfit.DepthCamera(
            40, 8, 26.0, 26.0, min_depth=0.05, max_depth=0.8, axial_noise=AXIAL
        )
        path = primfit.grid_path(world, 0.2, rng=3)
        scan = primfit.scan(world, path, sensor, rng=3, pose_noise=(0.005, 0.01))
        found = primfit.detect(scan, rng=1, pose_sigma=(0.005, 0.01))
        assert len(found.solids) == 2
        off, was = (
            np.linalg.norm(each[:, :2] - path[:, :2], axis=1) for each in (found.path, scan.path)
        )
        assert np.median(off) < 0.5 * np.median(was)


class TestCameras:
    def test_presets(self):
        kinect = primfit.DepthCamera.kinect()
        edges = np.degrees(2 * np.arctan(320 / kinect.fx))
        assert edges == pytest.approx(57.0)
        np.testing.assert_allclose(kinect.axial_noise, AXIAL)
        # Depths at 2 m come in steps of z**2 / (f b) / 8.
        scan = primfit.scan(ROOM, looking(1.0, 2.0, 1.0), replace(kinect, axial_noise=0.0))
        steps = kinect.fx * 0.075 * 8 / scan.depths[scan.is_return]
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
        stereo = primfit.DepthCamera.realsense_d435()
        # Distance^2 x subpixel / (focal length x baseline), as its makers have it.
        alone = replace(stereo, disparity_step=0.0)
        assert float(alone.sigma_at(2.0)) == pytest.approx(4.0 * 0.08 / (424.0 * 0.05))
        finder = primfit.DepthCamera.range_finder(width=65, height=33, noise=0.02, max_range=4.0)
        assert finder.axial_noise[0] == 0.08
        up, down = finder.directions[[0, -1], 32]
        vertical = np.arctan(down[1] / down[2]) - np.arctan(up[1] / up[2])
        whole = 2 * np.arctan(np.tan(0.7854 / 2) * 33 / 65)
        # Between the middles of the outer pixels.
        assert np.tan(vertical / 2) == pytest.approx(np.tan(whole / 2) * 32 / 33)
        assert primfit.DepthCamera.kinect(shadow=False, mount=(0, 0, 1)).mount[2, 3] == 1.0

    def test_are_values(self):
        one, same = camera(axial_noise=0.01), camera(axial_noise=(0.01, 0, 0))
        assert one == same
        assert hash(one) == hash(same)
        assert one != camera()
        assert one != primfit.Lidar()
        assert pickle.loads(pickle.dumps(one)) == one
        assert "DepthCamera(width=120, height=90" in repr(one)
        assert not one.directions.flags.writeable

    @pytest.mark.parametrize(
        ("changes", "error", "message"),
        [
            ({"width": 0}, ValueError, "width must be at least 1"),
            ({"height": 2.5}, TypeError, "height must be an integer"),
            ({"fx": 0.0}, ValueError, "fx must not be zero"),
            ({"fx": -9.0}, ValueError, "fx must be positive"),
            ({"cx": np.nan}, ValueError, "cx must be finite"),
            ({"min_depth": 9.0}, ValueError, "min_depth must be less than max_depth=9"),
            ({"min_depth": -1.0}, ValueError, "min_depth must be at least 0"),
            ({"axial_noise": -1.0}, ValueError, "axial_noise must be at least 0"),
            ({"axial_noise": (1, 2)}, ValueError, r"axial_noise must be a number or \(constant"),
            ({"axial_noise": (0, -1, 0)}, ValueError, "axial_noise must have a constant"),
            ({"disparity_step": 0.1}, ValueError, "baseline must not be 0 with disparity_step"),
            ({"shadow": True}, ValueError, "baseline must not be 0 with shadow"),
            ({"shadow": 2, "baseline": 1}, TypeError, "shadow must be True or False"),
            ({"resolution": 0.0}, ValueError, "resolution must be positive, or -1"),
            ({"mount": (1, 2)}, ValueError, "mount must be"),
        ],
    )
    def test_that_cannot_be(self, changes, error, message):
        with pytest.raises(error, match=message):
            camera(**changes)

    def test_range_finders_that_cannot_be(self):
        with pytest.raises(ValueError, match="field_of_view must be less than pi"):
            primfit.DepthCamera.range_finder(field_of_view=3.2)
        with pytest.raises(ValueError, match="min_range must be less than max_range=1"):
            primfit.DepthCamera.range_finder(min_range=2.0)


def test_sensors_of_others():
    """A sensor is what has directions, a gate, a sigma and a mount."""

    @dataclass(frozen=True, eq=False)
    class Whiskers(Sensor):
        mount: Any = None

        @cached_property
        def directions(self):
            return primfit.Lidar(3, horizontal_resolution=40).directions

        @property
        def gate(self):
            return RangeGate(max_range=2.0, sigma=0.01)

        def sigma_of(self, ranges):
            return np.full(ranges.shape, 0.01)

    sensor = Whiskers(np.eye(4))
    scan = primfit.scan(ROOM, [(1, 1, 0), (2, 2, 0)], sensor, rng=1)
    lidar = primfit.Lidar(
        3, horizontal_resolution=40, min_range=0, max_range=2.0, noise=0.005, mount=(0, 0, 0)
    )
    same = primfit.scan(ROOM, [(1, 1, 0), (2, 2, 0)], lidar, rng=1)
    np.testing.assert_array_equal(scan.points, same.points)
    np.testing.assert_array_equal(scan.sigma, np.full(240, 0.01))
    readings = primfit.Scan.from_readings([(1, 1, 0)], sensor, np.ones((3, 40)))
    assert readings.max_range == 2.0
    assert sensor == Whiskers(np.eye(4))
    with pytest.raises(TypeError, match="lidar must be a Sensor, not str"):
        primfit.scan(ROOM, (1, 1, 0), "kinect")
