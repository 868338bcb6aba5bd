"""Sensors as they are: footprints, noise of range and incidence, lost returns, motion in a turn."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import primfit
from primfit.scans import imperfections
from primfit.scans.imperfections import RAYS, RINGS, footprint

ROOM = primfit.World(arena=primfit.Arena((8, 6), height=3.0))
BLOCK = primfit.Prism([[4.5, 2.5], [5.5, 2.5], [5.5, 3.5], [4.5, 3.5]], 1.0)
BOX = primfit.World([BLOCK], ROOM.arena)
POSE = (2.0, 3.0, 0.0)
EVERYTHING = {
    "noise": 0.001,
    "noise_per_metre": 0.004,
    "beam_divergence": 0.01,
    "dropout": 0.1,
    "detection_range": 15.0,
    "motion_distortion": 0.5,
    "resolution": 0.002,
}


def sensor(**changes):
    grid = {"number_of_layers": 4, "vertical_field_of_view": 0.3, "horizontal_resolution": 300}
    grid |= {"field_of_view": 2 * np.pi, "max_range": 20.0, "mount": (0, 0, 0.5)}
    return primfit.Lidar(**(grid | changes))


def one_beam(*direction, **changes):
    return primfit.Lidar(beams=[[direction]], max_range=20.0, mount=(0, 0, 0.5), **changes)


def test_the_truth_is_what_a_perfect_sensor_reads():
    path = primfit.grid_path(BOX, 1.5, rng=1)
    perfect = primfit.scan(BOX, path, sensor(), rng=2)
    for changes in ({"dropout": 0.3}, {"noise_per_metre": 0.01}, {"beam_divergence": 0.004}):
        scan = primfit.scan(BOX, path, sensor(**changes), rng=2)
        np.testing.assert_array_equal(scan.true_ranges, perfect.ranges)
        np.testing.assert_allclose(scan.true_points, perfect.points, atol=1e-12)
        for name in ("origins", "directions", "solid_index", "layer", "column", "pose_index"):
            np.testing.assert_array_equal(getattr(scan, name), getattr(perfect, name))
        on_beam = scan.origins + scan.ranges[:, None] * scan.directions
        kept = scan.is_return
        np.testing.assert_allclose(scan.points[kept], on_beam[kept], atol=1e-12)
    assert perfect.true_ranges is perfect.true_points is perfect.is_mixed is None


def test_dropouts():
    scan = primfit.scan(ROOM, np.tile(POSE, (50, 1)), sensor(dropout=0.2), rng=3)
    n = len(scan)
    assert abs(np.mean(~scan.is_return) - 0.2) < 5 * np.sqrt(0.2 * 0.8 / n)
    assert np.isfinite(scan.true_ranges).all()
    assert (scan.solid_index != -1).all()
    kept = scan.is_return
    np.testing.assert_array_equal(scan.ranges[kept], scan.true_ranges[kept])
    assert scan.sigma == 0.0
    # As many neighbours are lost together as chance has it.
    pairs = np.mean(~kept[1:] & ~kept[:-1])
    assert abs(pairs - 0.04) < 5 * np.sqrt(0.04 / n)
    assert not primfit.scan(ROOM, POSE, sensor(dropout=1.0), rng=3).is_return.any()


def test_noise_grows_with_the_range():
    lidar = sensor(noise=0.0005, noise_per_metre=0.01, resolution=0.004)
    scan = primfit.scan(ROOM, np.tile(POSE, (60, 1)), lidar, rng=4)
    expected = np.sqrt(0.01**2 + (0.01 * scan.true_ranges) ** 2 + 0.004**2 / 12)
    np.testing.assert_allclose(scan.sigma, expected, rtol=1e-12)
    np.testing.assert_allclose(lidar.sigma_at(scan.true_ranges), expected, rtol=1e-12)
    normal = (scan.ranges - scan.true_ranges) / scan.sigma
    for rows in np.array_split(np.argsort(scan.true_ranges), 4):
        some = normal[rows]
        assert abs(some.mean()) < 5 / np.sqrt(len(some))
        assert abs(some.std() - 1) < 5 / np.sqrt(2 * len(some))
    np.testing.assert_allclose(scan.ranges / 0.004, np.rint(scan.ranges / 0.004), atol=1e-9)


def test_noise_is_the_same_with_other_losses():
    path = np.tile(POSE, (5, 1))
    whole = primfit.scan(ROOM, path, sensor(noise_per_metre=0.01), rng=5)
    some = primfit.scan(ROOM, path, sensor(noise_per_metre=0.01, dropout=0.5), rng=5)
    kept = some.is_return
    assert 0.4 < kept.mean() < 0.6
    np.testing.assert_array_equal(some.ranges[kept], whole.ranges[kept])


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.2])
def test_noise_grows_with_incidence(angle):
    lidar = one_beam(np.cos(angle), np.sin(angle), 0.0, beam_divergence=0.008)
    scan = primfit.scan(ROOM, np.tile((6.0, 0.5, 0.0), (20_000, 1)), lidar, rng=6)
    reach = 2.0 / np.cos(angle)
    np.testing.assert_allclose(scan.true_ranges, reach)
    expected = reach * 0.002 * np.tan(angle)
    np.testing.assert_allclose(scan.sigma, expected, rtol=1e-4, atol=1e-5)
    # The mean over the footprint is longer by a small share, of the square of the divergence.
    errors = scan.ranges - scan.true_ranges
    assert abs(errors.std() - expected) < 5 * expected / np.sqrt(2 * len(errors)) + 1e-12
    longer = reach * (0.004**2 / 4) * (1.0 + np.tan(angle) ** 2)
    assert abs(errors.mean() - longer) < 5 * expected / np.sqrt(len(errors)) + 0.1 * longer


def test_grazing_incidence():
    lidar = sensor(beam_divergence=0.01)
    grazing = lidar.noise_at(np.array([10.0]), np.array([np.pi / 2]))
    assert grazing[0] == pytest.approx(5.0, rel=1e-4)
    scan = primfit.scan(ROOM, POSE, sensor(detection_range=4.0), rng=1)
    at = np.flatnonzero(np.isfinite(scan.true_ranges))
    normals = np.where(scan.solid_index[:, None] == -3, [0.0, 0.0, 1.0], np.nan)
    wall = np.abs(scan.true_points[:, 0] - 4.0) > 4.0 - 1e-9
    normals[wall & (scan.solid_index == -2)] = [1.0, 0.0, 0.0]
    normals[~wall & (scan.solid_index == -2)] = [0.0, 1.0, 0.0]
    cosine = np.abs((normals * scan.directions).sum(axis=1))[at]
    expected = scan.true_ranges[at] <= 4.0 * np.sqrt(cosine)
    np.testing.assert_array_equal(scan.is_return[at], expected)
    assert 0.1 < expected.mean() < 0.9


def test_footprints_are_evenly_lit_discs():
    beams = primfit.Lidar.vlp16(mount=(0, 0, 1)).directions
    rays = footprint(beams, 0.02)
    assert rays.shape == (RINGS * RAYS, *beams.shape)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    off = np.arccos(np.clip((rays * beams).sum(axis=-1), -1, 1))
    assert (off < 0.01).all()
    # Second and fourth moments of a disc of radius R: R^2 / 2 and R^4 / 3.
    np.testing.assert_allclose((off**2).mean(axis=0), 0.01**2 / 2, rtol=1e-5)
    np.testing.assert_allclose((off**4).mean(axis=0), 0.01**4 / 3, rtol=1e-5)
    np.testing.assert_allclose(rays.mean(axis=0), beams, atol=1e-4)


class TestMixedPixels:
    """Beams across the vertical edge of a box, 2.5 m in front of a wall."""

    EDGE = np.arctan2(0.5, 2.5)

    def scan(self, **changes):
        azimuth = self.EDGE + np.linspace(-0.02, 0.02, 400)
        beams = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(400)], axis=1)
        lidar = primfit.Lidar(
            beams=beams[None], max_range=20.0, mount=(0, 0, 0.5), beam_divergence=0.01, **changes
        )
        return azimuth, primfit.scan(BOX, POSE, lidar, rng=1)

    def test_lie_between_the_surfaces(self):
        azimuth, scan = self.scan(pulse_length_ns=np.inf)
        near, far = 2.5 / np.cos(azimuth), 6.0 / np.cos(azimuth)
        # The share of the disc on the side of the wall, in closed form.
        h = np.clip((self.EDGE - azimuth) / 0.005, -1, 1)
        share = (np.arccos(h) - h * np.sqrt(1 - h * h)) / np.pi
        expected = near + share * (far - near)
        noise = np.abs(scan.ranges - expected)
        # Shares come by sixteenths.
        assert noise.max() < (far - near).max() * 1.25 / 16 + 5 * scan.sigma.max()
        is_across = np.abs(azimuth - self.EDGE) < 0.0035
        assert scan.is_mixed[is_across].all()
        assert not scan.is_mixed[np.abs(azimuth - self.EDGE) > 0.005].any()
        between = (scan.ranges > near + 0.2) & (scan.ranges < far - 0.2)
        assert between[is_across].all()
        assert not between[~scan.is_mixed].any()
        # The truth is that of the axis.
        np.testing.assert_allclose(scan.true_ranges, np.where(azimuth < self.EDGE, near, far))
        assert scan.solid_index.tolist() == [0 if a < self.EDGE else -2 for a in azimuth]

    def test_pulses_tell_surfaces_apart(self):
        azimuth, scan = self.scan()
        assert not scan.is_mixed.any()
        near, far = 2.5 / np.cos(azimuth), 6.0 / np.cos(azimuth)
        is_near = np.abs(scan.ranges - near) < 0.1
        is_far = np.abs(scan.ranges - far) < 0.1
        assert (is_near ^ is_far).all()
        sure = np.abs(azimuth - self.EDGE) > 0.002
        np.testing.assert_array_equal(is_near[sure], azimuth[sure] < self.EDGE)
        # 3.5 m is half of the way of light in 23.4 ns.
        assert not self.scan(pulse_length_ns=20.0)[1].is_mixed.any()
        assert self.scan(pulse_length_ns=27.0)[1].is_mixed.any()

    def test_beside_a_solid_in_the_open(self):
        world = primfit.World([BLOCK])
        over = one_beam(1.0, 0.0, 0.52 / 2.5, beam_divergence=0.02)
        scan = primfit.scan(world, POSE, over, rng=1)
        assert (scan.solid_index[0], scan.true_ranges[0]) == (-1, np.inf)
        assert scan.ranges[0] == pytest.approx(2.55, abs=0.02)
        assert not scan.is_mixed[0]


class TestMotion:
    def test_beams_leave_from_between_the_poses(self):
        path = np.array([[2.0, 2.0, 3.0], [2.4, 2.2, -3.0], [2.4, 2.6, -2.6]])
        lidar = sensor(motion_distortion=0.5, mount=(0.1, 0.0, 0.5))
        scan = primfit.scan(ROOM, path, lidar, rng=1)
        assert (scan.path == path).all()
        steps = np.diff(path, axis=0)
        steps[0, 2] += 2 * np.pi
        steps = np.concatenate([steps, steps[-1:]])
        for row in np.random.default_rng(1).integers(len(scan), size=200):
            pose, column = scan.pose_index[row], scan.column[row]
            there = path[pose] + 0.5 * column / 300 * steps[pose]
            one = primfit.scan(ROOM, there, sensor(mount=(0.1, 0.0, 0.5)), rng=1)
            at = scan.layer[row] * 300 + column
            np.testing.assert_allclose(scan.true_points[row], one.points[at], atol=1e-9)
            assert scan.ranges[row] == pytest.approx(one.ranges[at])
        still = primfit.scan(ROOM, path, sensor(mount=(0.1, 0.0, 0.5)), rng=1)
        np.testing.assert_array_equal(scan.origins, still.origins)
        np.testing.assert_array_equal(scan.directions, still.directions)
        first = scan.column == 0
        np.testing.assert_allclose(scan.points[first], still.points[first], atol=1e-12)
        assert np.abs(scan.points - scan.true_points).max() > 0.1

    def test_transforms_move_as_the_planar_path(self):
        path = np.array([[2.0, 2.0, 0.0], [2.4, 2.2, 0.3], [2.4, 2.6, 0.2]])
        mount = np.eye(4)
        mount[2, 3] = 0.5
        transforms = np.tile(np.eye(4), (3, 1, 1))
        for pose, (x, y, yaw) in zip(transforms, path, strict=True):
            c, s = np.cos(yaw), np.sin(yaw)
            pose[:2] = [[c, -s, 0, x], [s, c, 0, y]]
        lidar = sensor(motion_distortion=1.0)
        planar = primfit.scan(ROOM, path, lidar, rng=1)
        spatial = primfit.scan(ROOM, transforms @ mount, lidar, rng=1)
        np.testing.assert_allclose(spatial.points, planar.points, atol=1e-9)
        np.testing.assert_allclose(spatial.true_points, planar.true_points, atol=1e-9)

    def test_a_single_pose_stands_still(self):
        still = primfit.scan(ROOM, POSE, sensor(), rng=1)
        moving = primfit.scan(ROOM, POSE, sensor(motion_distortion=1.0), rng=1)
        np.testing.assert_allclose(moving.points, still.points, atol=1e-12)

    def test_with_noise_of_poses(self):
        path = np.array([[2.0, 2.0, 0.0], [2.4, 2.2, 0.3], [2.4, 2.6, 0.2]])
        exact = primfit.scan(ROOM, path, sensor(motion_distortion=1.0), rng=1)
        lost = primfit.scan(ROOM, path, sensor(motion_distortion=1.0), rng=1, step_noise=(0.1, 0.1))
        np.testing.assert_array_equal(lost.ranges, exact.ranges)
        np.testing.assert_array_equal(lost.true_points, exact.true_points)
        assert np.abs(lost.points - exact.points).max() > 0.05


def test_same_rng_same_bits(monkeypatch):
    path = primfit.grid_path(BOX, 1.0, rng=1)[:6]
    lidar = sensor(**EVERYTHING)
    names = ("points", "ranges", "solid_index", "true_ranges", "true_points", "is_mixed", "sigma")
    one = primfit.scan(BOX, path, lidar, rng=7, n_jobs=1)
    for n_jobs, at_once in ((4, 1 << 18), (2, 1 << 14)):
        monkeypatch.setattr(imperfections, "_RAYS_AT_ONCE", at_once)
        again = primfit.scan(BOX, path, lidar, rng=7, n_jobs=n_jobs)
        for name in names:
            assert getattr(one, name).tobytes() == getattr(again, name).tobytes(), name
    other = primfit.scan(BOX, path, lidar, rng=8)
    assert (other.ranges != one.ranges).any()


def test_save_load_pickle_select(tmp_path):
    scan = primfit.scan(BOX, POSE, sensor(**EVERYTHING), rng=7)
    scan.save(tmp_path / "scan.npz")
    for again in (primfit.Scan.load(tmp_path / "scan.npz"), pickle.loads(pickle.dumps(scan))):
        for name in ("true_ranges", "true_points", "is_mixed", "sigma", "points"):
            np.testing.assert_array_equal(getattr(again, name), getattr(scan, name))
        assert again.is_mixed.dtype == bool
    some = scan.select(scan.is_mixed)
    assert some.is_mixed.all()
    assert len(some.true_points) == len(some) == scan.is_mixed.sum()
    lidar = sensor(**EVERYTHING)
    assert pickle.loads(pickle.dumps(lidar)) == lidar
    assert hash(lidar) == hash(sensor(**EVERYTHING)) != hash(sensor())
    assert "dropout=0.1" in repr(lidar)
    bad = dict(np.load(tmp_path / "scan.npz"))
    bad["is_mixed"] = bad["is_mixed"].astype(float)
    np.savez(tmp_path / "bad.npz", **bad)
    with pytest.raises(ValueError, match="its array 'is_mixed' is float64"):
        primfit.Scan.load(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dropout": 1.5}, "dropout must be at most 1 a share of the returns, not 1.5"),
        ({"dropout": -0.1}, "dropout must be at least 0, not -0.1"),
        ({"noise_per_metre": 5}, "noise_per_metre must be at most 1 metre per metre, not 5"),
        ({"beam_divergence": 3.0}, "beam_divergence must be at most 0.5 radians"),
        ({"pulse_length_ns": -1}, "pulse_length_ns must be at least 0, not -1"),
        ({"pulse_length_ns": np.nan}, "pulse_length_ns must be finite, not nan"),
        ({"detection_range": 0.0}, "detection_range must be greater than 0, not 0.0"),
        ({"motion_distortion": 2}, "motion_distortion must be at most 1 a share of the step"),
    ],
)
def test_sensors_that_cannot_exist(changes, message):
    with pytest.raises(ValueError, match=message):
        sensor(**changes)
    with pytest.raises(TypeError, match=f"{next(iter(changes))} must be a number, not 'much'"):
        sensor(**dict.fromkeys(changes, "much"))


def test_webots_has_no_such_sensors(tmp_path):
    with pytest.raises(ValueError, match="no imperfections that Webots does not know"):
        primfit.export_webots(ROOM, tmp_path, POSE, sensor(dropout=0.1))


def test_readings_take_the_noise_of_their_range():
    lidar = sensor(noise_per_metre=0.01)
    scan = primfit.scan(ROOM, POSE, lidar, rng=1)
    read = primfit.Scan.from_readings(POSE, lidar, scan.ranges)
    np.testing.assert_allclose(read.sigma, lidar.sigma_at(scan.ranges))
    np.testing.assert_allclose(read.sigma, scan.sigma, rtol=0.1)


@pytest.mark.parametrize("method", ["planes", "likelihood"])
def test_detection_with_the_noise_of_each_beam(method):
    path = np.array([[3.5, 1.5, 0.0], [3.5, 4.5, 0.0], [6.5, 1.5, 0.0], [6.5, 4.5, 0.0]])
    layers = {"number_of_layers": 16, "vertical_field_of_view": 0.5}
    lidar = sensor(noise=0.0001, noise_per_metre=0.005, dropout=0.1, **layers)
    scan = primfit.scan(BOX, path, lidar, rng=2)
    assert scan.sigma.shape == (len(scan),)
    found = primfit.detect(scan, method=method, rng=3)
    near = [s for s in found.solids if np.hypot(*(s.center[:2] - [5.0, 3.0])) < 0.05]
    assert len(near) == len(found.solids) == 1
    if method == "planes":
        planes = primfit.detect_planes(scan)
        # Thresholds follow the noise of each point.
        assert np.std(scan.sigma[scan.is_return]) > 0.001
        assert planes.sigma == pytest.approx(np.median(scan.sigma))
