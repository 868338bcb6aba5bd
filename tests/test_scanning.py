"""Lidars and scans."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

import primfit
from primfit.scans import scanning
from primfit.sensors.mounts import E_PUCK_TURRET

EMPTY = primfit.World(arena=primfit.Arena((1, 1)))


class TestLidar:
    def test_defaults_are_the_papers(self):
        lidar = primfit.Lidar()
        assert lidar.directions.shape == (8, 100, 3)
        assert (lidar.max_range, lidar.min_range, lidar.noise) == (1.0, 0.01, 0.0)

    def test_layers_and_columns(self):
        directions = primfit.Lidar(3, 0.4, 40, 1.0).directions
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
        elevation = np.arcsin(directions[..., 2])
        np.testing.assert_allclose(elevation[:, 0], [0.2, 0.0, -0.2], atol=1e-12)
        azimuth = np.arctan2(directions[..., 1], directions[..., 0])
        np.testing.assert_allclose(azimuth[0], 0.5 - (np.arange(40) + 0.5) / 40)

    def test_one_level_layer_and_a_full_turn(self):
        level = primfit.Lidar(1, horizontal_resolution=360, field_of_view=2 * np.pi)
        assert not level.directions[..., 2].any()
        assert np.abs(level.directions.sum(axis=(0, 1))).max() < 1e-9
        assert primfit.Lidar.vlp16(mount=(0, 0, 1)).directions.shape == (16, 1800, 3)

    @pytest.mark.parametrize(
        ("preset", "sigma"),
        [
            ("vlp16", 0.03),
            ("hdl32e", 0.02),
            ("os1_64", 0.03),
            ("rplidar_a1", 0.02),
            ("rosette", 0.02),
        ],
    )
    def test_presets_keep_their_noise_when_the_range_changes(self, preset, sigma):
        make = getattr(primfit.Lidar, preset)
        for changes in ({}, {"max_range": 10.0}):
            lidar = make(mount=(0, 0, 1), **changes)
            assert lidar.noise * lidar.max_range == pytest.approx(sigma)
        assert make(mount=(0, 0, 1), noise=0.0).noise == 0.0
        with pytest.raises(TypeError, match="mount"):
            make()
        with pytest.raises(ValueError, match="max_range must be greater than 0"):
            make(mount=(0, 0, 1), max_range=0.0)

    def test_beams_of_any_directions(self):
        hdl = primfit.Lidar.hdl32e(mount=(0, 0, 1))
        elevation = np.degrees(np.arcsin(hdl.directions[..., 2]))
        np.testing.assert_allclose(elevation[[0, 8, 31], 5], [10.67, 0.0, -30.67], atol=5e-3)
        assert hdl.vertical_field_of_view == pytest.approx(np.radians(41.34))
        rosette = primfit.Lidar.rosette(mount=(0, 0, 1), seconds=1.0)
        off = np.degrees(np.arccos(rosette.directions[..., 0]))
        assert 19.1 < off.max() <= 19.2
        assert off.min() < 0.1
        # The far end of each of the petals is at another place.
        assert len(np.unique(np.round(rosette.directions, 9), axis=1)[0]) > 90_000
        grid = primfit.Lidar()
        same = primfit.Lidar(beams=3.0 * grid.directions)
        np.testing.assert_allclose(same.directions, grid.directions, atol=1e-15)
        assert same != grid
        assert same == primfit.Lidar(beams=3.0 * grid.directions)
        assert hash(same) == hash(primfit.Lidar(beams=3.0 * grid.directions))
        world = primfit.World(arena=primfit.Arena((2, 2)))
        ranges = [primfit.scan(world, (1, 1, 0), each, rng=1).ranges for each in (grid, same)]
        np.testing.assert_allclose(*ranges, atol=1e-12)
        for bad, message in ((np.zeros((2, 3)), "shape"), (np.zeros((1, 2, 3)), "length greater")):
            with pytest.raises(ValueError, match=message):
                primfit.Lidar(beams=bad)

    def test_mounts(self):
        np.testing.assert_array_equal(primfit.Lidar(mount="e-puck").mount[:3, 3], E_PUCK_TURRET)
        np.testing.assert_array_equal(primfit.Lidar(mount=np.eye(4)).mount, np.eye(4))

    def test_sigma_has_noise_and_rounding(self):
        lidar = primfit.Lidar(noise=0.01, max_range=2.0, resolution=0.06)
        assert lidar.sigma == pytest.approx(np.hypot(0.02, 0.06 / np.sqrt(12)))

    def test_outside_the_domain_of_webots(self):
        with pytest.warns(UserWarning, match="outside the domain that Webots documents"):
            primfit.Lidar(horizontal_resolution=1)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            primfit.Lidar(horizontal_resolution=32)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"number_of_layers": 0}, "number_of_layers must be at least 1"),
            ({"horizontal_resolution": -5}, "horizontal_resolution must be at least 1"),
            ({"field_of_view": 7.0}, "field_of_view must be at most 2 pi"),
            ({"field_of_view": 0.0}, "field_of_view must be greater than 0"),
            ({"vertical_field_of_view": 0.0}, "vertical_field_of_view must be greater than 0"),
            ({"vertical_field_of_view": 4.0}, "vertical_field_of_view must be less than pi"),
            ({"min_range": 2.0}, "min_range must be less than max_range=1"),
            ({"max_range": -1.0}, "max_range must be greater than 0"),
            ({"noise": -0.1}, "noise must be at least 0"),
            ({"noise": np.nan}, "noise must be finite"),
            ({"resolution": 0.0}, "resolution must be positive, or -1"),
            ({"mount": "roof"}, 'mount must be .3,., .4, 4. or "e-puck"'),
            ({"mount": 2 * np.eye(4)}, "mount must be rigid transforms"),
            ({"mount": (1, 2)}, "mount must be rigid transforms"),
        ],
    )
    def test_lidars_that_cannot_exist(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            primfit.Lidar(**arguments)


class TestScan:
    def test_level_beam_closed_form(self):
        lidar = primfit.Lidar(1, horizontal_resolution=90, field_of_view=np.pi / 2)
        scan = primfit.scan(EMPTY, (0.3, 0.5, 0.0), lidar)
        azimuth = (0.5 - (np.arange(90) + 0.5) / 90) * np.pi / 2
        with np.errstate(divide="ignore"):
            expected = np.minimum(0.7 / np.cos(azimuth), 0.5 / np.abs(np.sin(azimuth)))
        np.testing.assert_allclose(
            scan.ranges, np.where(expected <= 1, expected, np.inf), atol=1e-9
        )
        assert set(scan.solid_index.tolist()) <= {-2, -1}

    def test_rows_are_poses_layers_columns(self, scan):
        assert len(scan) == 800 * len(np.unique(scan.pose_index))
        np.testing.assert_array_equal(scan.layer[:200], np.repeat([0, 1], 100))
        np.testing.assert_array_equal(scan.column[:200], np.tile(np.arange(100), 2))
        np.testing.assert_array_equal(scan.pose_index[:800], 0)

    def test_what_follows_from_the_path_is_made_when_asked_for(self, world):
        path = primfit.grid_path(world, 0.5, rng=1)
        asked, unasked = (primfit.scan(world, path, rng=1) for _ in range(2))
        fields = ("origins", "directions", "layer", "column", "pose_index")
        arrays = [getattr(asked, name) for name in fields]
        assert all(
            getattr(asked, name) is array for name, array in zip(fields, arrays, strict=True)
        )
        for copy in (pickle.loads(pickle.dumps(unasked)), unasked.select(np.arange(len(unasked)))):
            for name, array in zip(fields, arrays, strict=True):
                assert array.flags.writeable
                np.testing.assert_array_equal(getattr(copy, name), array)

    def test_points_are_where_the_beams_end(self, scan):
        rows = scan.is_return
        np.testing.assert_allclose(
            scan.points[rows],
            scan.origins[rows] + scan.ranges[rows, None] * scan.directions[rows],
        )
        assert np.isnan(scan.points[~rows]).all()
        assert np.isinf(scan.ranges[~rows]).all()

    def test_truth_index(self, world, scan):
        for i, solid in enumerate(world.solids):
            hits = scan.points[(scan.solid_index == i) & scan.is_return]
            assert len(hits) > 100
            low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
            assert (hits >= low - 1e-9).all()
            assert (hits <= high + 1e-9).all()
        assert np.abs(scan.points[(scan.solid_index == -3) & scan.is_return][:, 2]).max() < 1e-12

    def test_noise_is_along_the_beam_after_the_gate(self):
        path = primfit.grid_path(EMPTY, rng=1)
        true = primfit.scan(EMPTY, path)
        noisy = primfit.scan(EMPTY, path, primfit.Lidar(noise=0.3), rng=1)
        rows = true.is_return
        np.testing.assert_array_equal(rows, noisy.is_return)
        error = noisy.ranges[rows] - true.ranges[rows]
        assert abs(error.mean()) < 5 * 0.3 / np.sqrt(rows.sum())
        assert error.std() == pytest.approx(0.3, rel=0.02)
        assert noisy.ranges[rows].min() < 0.0
        assert noisy.ranges[rows].max() > 1.0
        assert noisy.sigma == pytest.approx(0.3)

    def test_range_gate(self):
        lidar = primfit.Lidar(1, min_range=0.4, max_range=0.6, field_of_view=2 * np.pi)
        scan = primfit.scan(EMPTY, (0.3, 0.5, 0.0), lidar)
        finite = scan.ranges[scan.is_return]
        assert 0.4 <= finite.min() <= finite.max() <= 0.6
        assert not scan.is_return.all()

    def test_resolution(self):
        scan = primfit.scan(EMPTY, (0.3, 0.5, 0.0), primfit.Lidar(resolution=0.01))
        steps = scan.ranges[scan.is_return] / 0.01
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)

    def test_same_rng_same_bits_at_any_number_of_threads(self, world):
        path = primfit.grid_path(world, 0.5, rng=1)
        lidar = primfit.Lidar(noise=0.02)
        scans = [primfit.scan(world, path, lidar, rng=4, n_jobs=n) for n in (1, 2, 8, None)]
        for other in scans[1:]:
            np.testing.assert_array_equal(scans[0].ranges, other.ranges)
            np.testing.assert_array_equal(scans[0].solid_index, other.solid_index)

    def test_noise_of_a_beam_follows_from_rng_and_its_row(self, world, monkeypatch):
        path = primfit.grid_path(world, 0.5, rng=1)
        lidar = primfit.Lidar(noise=0.02)
        whole, part, other = (
            primfit.scan(world, poses, lidar, rng=rng)
            for poses, rng in ((path, 4), (path[:3], 4), (path[:3], 5))
        )
        np.testing.assert_array_equal(whole.ranges[: len(part)], part.ranges)
        assert (other.ranges != part.ranges)[part.is_return].all()
        monkeypatch.setattr(scanning, "_BEAMS_AT_ONCE", 1)
        np.testing.assert_array_equal(primfit.scan(world, path, lidar, rng=4).ranges, whole.ranges)

    def test_poses_in_all_forms(self):
        planar = primfit.scan(EMPTY, [(0.5, 0.5, 1.0)])
        full = np.eye(4)
        full[:2, :2] = [[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]]
        full[:3, 3] = 0.5, 0.5, 0.06
        np.testing.assert_allclose(primfit.scan(EMPTY, full).ranges, planar.ranges)
        np.testing.assert_allclose(primfit.scan(EMPTY, full[None]).ranges, planar.ranges)

    def test_poses_inside_solids_and_outside_the_arena_are_left_out(self, world):
        x, y, _ = world.solids[0].center
        path = [(x, y, 0.0), (0.05, 0.05, 0.0), (9.0, 9.0, 0.0)]
        with pytest.warns(UserWarning, match="path has 2 of 3 poses inside a solid"):
            assert np.unique(primfit.scan(world, path).pose_index).tolist() == [1]
        with pytest.raises(ValueError, match="path has no valid pose: all 1 are inside a solid"):
            primfit.scan(world, path[0])

    def test_above_a_solid_is_not_inside(self):
        world = primfit.World([primfit.Prism.regular(4, 0.3, height=0.1)])
        pose = np.eye(4)
        pose[2, 3] = 0.2
        assert len(primfit.scan(world, pose)) == 800

    def test_without_an_arena_the_floor_goes_on(self):
        lidar = primfit.Lidar(max_range=50.0)
        scan = primfit.scan(primfit.World(), (0, 0, 0.0), lidar)
        assert set(scan.solid_index.tolist()) == {-1, -3}

    @pytest.mark.parametrize(
        ("path", "message"),
        [
            ([[0, 0]], "path must have shape"),
            ([[0, 0, np.nan]], "path must be finite"),
            (2 * np.eye(4), "path must be rigid transforms"),
            (np.empty((0, 3)), "path has no valid pose"),
        ],
    )
    def test_bad_paths(self, path, message):
        with pytest.raises(ValueError, match=message):
            primfit.scan(EMPTY, path)

    def test_progress(self, capsys):
        seen = []
        primfit.scan(EMPTY, (0.5, 0.5, 0), progress=lambda *done: seen.append(done))
        assert seen[-1] == (1, 1)
        primfit.scan(EMPTY, (0.5, 0.5, 0), progress=True)
        assert "pose" in capsys.readouterr().err


class TestRecorded:
    def test_from_rays(self):
        scan = primfit.Scan.from_rays(
            (0, 0, 1),
            [[2, 0, 0], [0, 0.5, 0], [1, 0, 0]],
            [1.5, np.inf, -0.1],
            sigma=0.1,
            max_range=1,
        )
        np.testing.assert_allclose(scan.points[0], [1.5, 0, 1])
        np.testing.assert_allclose(scan.points[2], [-0.1, 0, 1])
        np.testing.assert_array_equal(scan.is_return, [True, False, True])
        assert scan.has_origins

    def test_from_points(self):
        points = np.random.default_rng(1).normal(size=(10, 3)) + 5
        known = primfit.Scan.from_points(points, (0, 0, 0), sigma=np.full(10, 0.1))
        np.testing.assert_allclose(known.ranges, np.linalg.norm(points, axis=1))
        unknown = primfit.Scan.from_points(points)
        assert not unknown.has_origins
        assert unknown.is_return.all()
        assert unknown.origins.shape == (10, 3)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (
                lambda s: s.from_rays((0, 0, 0), [[1, 0, 0]], [np.nan]),
                "ranges must be finite, or inf",
            ),
            (
                lambda s: s.from_rays((0, 0, 0), [[1, 0, 0]], [-np.inf]),
                "ranges must be finite, or inf",
            ),
            (lambda s: s.from_rays((0, 0, 0), [[0, 0, 0]], [1]), "directions must not be zero"),
            (lambda s: s.from_rays([[0, 0, 0]] * 2, [[1, 0, 0]], [1]), "origins must have shape"),
            (
                lambda s: s.from_rays((0, 0, 0), [[1, 0, 0]], [1, 2]),
                "ranges must be a number or have",
            ),
            (
                lambda s: s.from_rays((0, 0, 0), [[1, 0, 0]], [1], sigma=-1),
                "sigma must be at least 0",
            ),
            (
                lambda s: s.from_rays((0, 0, 0), [[1, 0, 0]], [1], layer=[0, 1]),
                "layer must have shape",
            ),
            (lambda s: s.from_points([[0, 0]]), "points must be an array"),
            (lambda s: s.from_points([[0, 0, 1]], (0, 0, 1)), "origins must differ from points"),
            (lambda s: s.from_points([[0, 0, 1]], sigma=[1, 2]), "sigma must be a number or have"),
        ],
    )
    def test_bad_recordings(self, call, message):
        with pytest.raises(ValueError, match=message):
            call(primfit.Scan)

    def test_save_and_load(self, small_scan, tmp_path):
        file = tmp_path / "scan.npz"
        small_scan.save(file)
        again = primfit.Scan.load(file)
        for name in ("points", "origins", "directions", "ranges", "layer", "solid_index"):
            np.testing.assert_array_equal(getattr(again, name), getattr(small_scan, name))
        assert again.sigma == small_scan.sigma
        assert again.max_range == small_scan.max_range
        assert again.min_range == small_scan.min_range == 0.01
        assert again.select([0, 1]).min_range == 0.01

    @pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"text"])
    def test_foreign_files(self, content, tmp_path):
        file = tmp_path / "scan.npz"
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"scan\.npz is not a scan"):
            primfit.Scan.load(file)
        np.savez(file, points=np.zeros((3, 3)))
        with pytest.raises(ValueError, match=r"scan\.npz is not a scan"):
            primfit.Scan.load(file)

    def test_z_filter_and_select(self, scan):
        above = scan.filter_z(low=0.02)
        assert above.points[:, 2].min() >= 0.02
        assert above.is_return.all()
        some = scan.select(np.arange(10))
        assert len(some) == 10
        np.testing.assert_array_equal(some.ranges, scan.ranges[:10])
