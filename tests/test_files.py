"""Clouds in files: round trips and real files; what a cloud is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit

SUFFIXES = [".ply", ".pcd", ".las", ".laz", ".e57", ".xyz", ".pts", ".txt", ".npy", ".npz"]
SUFFIXES += [".asc", ".csv", ".csv.gz", ".pts.gz"]
MICROMETRE = {".las": 0.6e-6, ".laz": 0.6e-6}
NATIONAL_GRID = np.array([536384.39, 6582454.01, 55.21])


def a_cloud(n=60, seed=1, offset=0.0):
    rng = np.random.default_rng(seed)
    return primfit.Cloud(
        rng.uniform(-50, 50, (n, 3)) + offset,
        {
            "intensity": rng.integers(0, 256, n).astype(np.float32),
            "color": rng.integers(1, 256, (n, 3)).astype(np.uint8),
            "normal": rng.normal(size=(n, 3)),
            "label": rng.integers(-1, 50, n),
            "ring": rng.integers(0, 16, n).astype(np.uint16),
            "time": 1.6e9 + rng.uniform(0, 1, n),
            "origin": rng.normal(size=(n, 3)),
            "flagged": rng.integers(0, 2, n).astype(bool),
            "curvature": rng.normal(size=n).astype(np.float32),
            "histogram": rng.integers(0, 9, (n, 5)),
        },
    )


def written_and_read(cloud, file):
    primfit.write_cloud(file, cloud)
    return primfit.read_cloud(file)


class TestRoundTrip:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_points_and_fields(self, suffix, tmp_path):
        cloud = a_cloud()
        again = written_and_read(cloud, tmp_path / f"cloud{suffix}")
        np.testing.assert_allclose(
            again.points, cloud.points, rtol=0, atol=MICROMETRE.get(suffix, 0.0)
        )
        assert set(again.fields) == set(cloud.fields)
        for name, values in cloud.fields.items():
            kept = again.fields[name].astype(values.dtype)  # text knows no float32
            np.testing.assert_array_equal(kept, values, err_msg=name)
        assert again.fields["color"].dtype == np.uint8
        assert again.fields["label"].dtype.kind == "i"

    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_national_grid_loses_nothing(self, suffix, tmp_path):
        cloud = primfit.Cloud(a_cloud(offset=NATIONAL_GRID).points)
        again = written_and_read(cloud, tmp_path / f"far{suffix}")
        np.testing.assert_allclose(
            again.points, cloud.points, rtol=0, atol=2e-9 + MICROMETRE.get(suffix, 0.0)
        )
        # A second time nothing changes at all.
        twice = written_and_read(again, tmp_path / f"twice{suffix}")
        np.testing.assert_allclose(twice.points, again.points, rtol=0, atol=2e-9)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("n", [0, 1])
    def test_few_points(self, suffix, n, tmp_path):
        cloud = primfit.Cloud(np.ones((n, 3)), {"label": np.arange(n)})
        if n == 0 and suffix == ".e57":
            with pytest.raises(ValueError, match="E57 keeps no cloud without points"):
                primfit.write_cloud(tmp_path / "cloud.e57", cloud)
        elif (
            n == 0
            and suffix not in (".ply", ".pcd", ".las", ".laz", ".npy", ".npz")
            and "pts" not in suffix
        ):
            primfit.write_cloud(tmp_path / f"cloud{suffix}", cloud)
            with pytest.raises(ValueError, match="it holds no point"):
                primfit.read_cloud(tmp_path / f"cloud{suffix}")
        else:
            again = written_and_read(cloud, tmp_path / f"cloud{suffix}")
            np.testing.assert_array_equal(again.points, cloud.points)
            assert list(again.fields) == ["label"]

    @pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s not in (".las", ".laz")])
    def test_missing_points_keep_their_place(self, suffix, tmp_path):
        points = a_cloud().points.copy()
        points[[3, 7]] = np.nan
        cloud = primfit.Cloud(points, {"label": np.arange(60)}, (6, 10))
        again = written_and_read(cloud, tmp_path / f"cloud{suffix}")
        np.testing.assert_array_equal(again.points, points)
        np.testing.assert_array_equal(again.fields["label"], np.arange(60))
        assert again.shape == ((6, 10) if suffix in (".pcd", ".npy", ".npz") else None)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_write_points_with_colors(self, suffix, tmp_path):
        cloud = a_cloud()
        colors = cloud.fields["color"].astype(int)
        primfit.write_points(tmp_path / f"cloud{suffix}", cloud.points, colors=colors)
        again = primfit.read_cloud(tmp_path / f"cloud{suffix}")
        np.testing.assert_array_equal(again.fields["color"], colors)
        assert list(again.fields) == ["color"]

    @settings(max_examples=30, deadline=None)
    @given(st.floats(1e-3, 1e6), st.floats(-1e7, 1e7), st.integers(0, 10**6))
    def test_steps_of_las_follow_the_span(self, tmp_path_factory, span, place, seed):
        points = np.random.default_rng(seed).uniform(-span / 2, span / 2, (50, 3)) + place
        file = tmp_path_factory.mktemp("las") / "cloud.las"
        again = written_and_read(primfit.Cloud(points), file)
        step = max(1e-6, 10 * span / 4.2e9)
        np.testing.assert_allclose(again.points, points, rtol=1e-15, atol=0.5001 * step)

    def test_what_a_format_cannot_keep_is_an_error(self, tmp_path):
        nan = primfit.Cloud([[0, 0, np.nan]])
        with pytest.raises(ValueError, match="LAS keeps no points that are not finite"):
            primfit.write_cloud(tmp_path / "cloud.las", nan)
        half = primfit.Cloud([[0, 0, 0]], {"intensity": [0.5]})
        with pytest.raises(ValueError, match="LAS keeps intensity as uint16"):
            primfit.write_cloud(tmp_path / "cloud.laz", half)
        nanoseconds = primfit.Cloud([[0, 0, 0]], {"time": [1_600_000_000_123_456_789]})
        with pytest.raises(ValueError, match="PLY keeps whole numbers of up to 32 bits"):
            primfit.write_cloud(tmp_path / "cloud.ply", nanoseconds)
        again = written_and_read(nanoseconds, tmp_path / "cloud.pcd")
        assert again.fields["time"].tolist() == [1_600_000_000_123_456_789]

    def test_wide_colors(self, tmp_path):
        wide = np.array([[1, 2000, 65535], [256, 0, 3]], dtype=np.uint16)
        for suffix in SUFFIXES:
            cloud = primfit.Cloud(np.zeros((2, 3)), {"color": wide})
            again = written_and_read(cloud, tmp_path / f"cloud{suffix}")
            np.testing.assert_array_equal(again.fields["color"], wide, err_msg=suffix)


class TestRealFiles:
    def test_velodyne(self, data):
        for pose, n, n_board in ((3, 24262, 1264), (16, 24148, 684), (38, 24280, 373)):
            cloud = primfit.read_cloud(data / f"vlp16_board/pose{pose}_full.pcd")
            assert len(cloud) == n
            assert list(cloud.fields) == ["intensity", "ring"]
            np.testing.assert_array_equal(np.unique(cloud.fields["ring"]), np.arange(16))
            board = primfit.read_cloud(data / f"vlp16_board/pose{pose}_target.pcd")
            assert len(board) == n_board
            whole = {tuple(point) for point in cloud.points}
            assert all(tuple(point) in whole for point in board.points)

    @pytest.mark.parametrize(
        ("name", "n_finite", "n_labels"),
        [
            ("mosd_learn5", 199001, 4),
            ("mosd_learn40", 172285, 7),
            ("table_scene_mug_stereo_textured", 209280, None),
        ],
    )
    def test_organised_depth_cameras(self, data, name, n_finite, n_labels, tmp_path):
        cloud = primfit.read_cloud(data / f"kinect/{name}.pcd")
        assert cloud.shape == (480, 640)
        finite = np.isfinite(cloud.points).all(axis=1)
        assert finite.sum() == n_finite
        assert cloud.fields["color"].shape == (307200, 3)
        assert cloud.fields["color"][finite].std() > 10
        if n_labels:
            assert len(np.unique(cloud.fields["label"])) == n_labels
            assert not cloud.fields["label"][~finite].any()
        # Rows of the image follow each other: neighbours are near.
        image = cloud.points.reshape(480, 640, 3)
        for axis in (0, 1):
            steps = np.linalg.norm(np.diff(image, axis=axis), axis=-1)
            assert np.nanmedian(steps) < 0.01
        again = written_and_read(cloud, tmp_path / "again.pcd")
        np.testing.assert_array_equal(again.points, cloud.points)
        assert again.shape == cloud.shape
        for field, values in cloud.fields.items():
            np.testing.assert_array_equal(again.fields[field], values)

    def test_room(self, data):
        cloud = primfit.read_cloud(data / "room/room2_gt_fine.pcd")
        assert len(cloud) == 123692
        assert np.isfinite(cloud.points).all()
        assert len(np.unique(cloud.fields["label"])) == 49

    def test_boxes(self, data):
        for name, n in (("caixa", 46370), ("caixa3", 14302)):
            cloud = primfit.read_cloud(data / f"boxes/{name}.ply")
            assert len(cloud) == n
            assert list(cloud.fields) == ["color"]
            assert (np.ptp(cloud.points, axis=0) < 2.0).all()

    def test_roofs(self, data):
        for name, n in (("Pyramid_roof_1054136", 1252), ("Two-sided_hip_roof_17234", 333)):
            assert primfit.read_points(data / f"roofs/{name}.pts").shape == (n, 3)
        columns = ("x", "y", "z", "label")
        building = primfit.read_cloud(data / "roofs/building3d_22523.txt", columns=columns)
        assert len(building) == 2048
        # A centimetre of the national grid is kept.
        np.testing.assert_array_equal(building.points[1], [536392.19, 6582457.43, 54.22])
        assert building.fields["label"].dtype == np.int64
        unnamed = primfit.read_cloud(data / "roofs/building3d_22523.txt")
        np.testing.assert_array_equal(unnamed.fields["column_4"], building.fields["label"])

    def test_icl_depth_image(self, data):
        image_of = pytest.importorskip("PIL.Image").open
        depth = np.asarray(image_of(data / "icl_rendered/icl_frame0_depth.png"))
        points = primfit.points_of_depth(depth, 481.2, -480, 319.5, 239.5, scale=1 / 5000)
        labels = np.load(data / "icl_rendered/icl_frame0_labels.npz")["gt"]
        assert np.isfinite(points).all()
        for label in range(1, 18):
            plane = points[labels == label]
            singular = np.linalg.svd(plane - plane.mean(axis=0), compute_uv=False)
            assert singular[-1] / np.sqrt(len(plane)) < 0.0027


class TestCloud:
    def test_some_of_its_points(self):
        points = np.arange(12.0).reshape(4, 3)
        cloud = primfit.Cloud(points, {"label": [1, 2, 3, 4]}, (2, 2))
        for rows in ([False, True, False, True], slice(1, None, 2), [1, 3]):
            some = cloud[rows]
            np.testing.assert_array_equal(some.points, points[1::2])
            assert (some.fields["label"].tolist(), some.shape) == ([2, 4], None)
        for bad in (1, "x", [[0]], [0.5]):
            with pytest.raises(TypeError, match="rows must be a mask, a slice or row numbers"):
                cloud[bad]

    def test_owns_its_arrays_and_says_what_it_is(self):
        points, label = np.zeros((2, 3)), np.array([1, 2])
        cloud = primfit.Cloud(points, {"label": label}, (1, 2))
        points[0], label[0] = 1.0, 9
        assert not cloud.points.any()
        assert cloud.fields["label"].tolist() == [1, 2]
        with pytest.raises(TypeError):
            cloud.fields["label"] = 1
        assert repr(cloud) == "Cloud(1 x 2 points, 2 finite: label)"

    @pytest.mark.parametrize(
        ("fields", "shape", "error", "message"),
        [
            ({"label": [1]}, None, ValueError, r"must have shape \(2,\) or \(2, k\), not \(1,\)"),
            ({"color": [1, 2]}, None, ValueError, r"fields\['color'\] must have shape \(2, 3\)"),
            ({"my label": [1, 2]}, None, ValueError, "names without spaces"),
            ({"x": [1, 2]}, None, ValueError, "other than x y z"),
            ({"label": ["a", "b"]}, None, TypeError, "must be numbers"),
            (None, None, TypeError, "fields must be a mapping of names to arrays, not NoneType"),
            ({}, (2, 2), ValueError, "shape must be that of 2 points, not 2 x 2"),
            ({}, 2, ValueError, r"shape must be \(height, width\)"),
        ],
    )
    def test_bad_clouds(self, fields, shape, error, message):
        with pytest.raises(error, match=message):
            primfit.Cloud(np.zeros((2, 3)), fields, shape)

    def test_fields_that_need_one_column(self, tmp_path):
        cloud = primfit.Cloud(np.zeros((1, 3)), {"red": [1], "color": [[1, 2, 3]]})
        with pytest.raises(ValueError, match="two that need a column named 'red'"):
            primfit.write_cloud(tmp_path / "cloud.ply", cloud)

    def test_bad_colors(self, tmp_path):
        for colors, message in (
            (np.zeros((2, 3)), r"colors must have a row of three for each point, not \(2, 3\)"),
            ([[0, 0, 256]], "whole numbers from 0 to 255"),
            ([[0, 0, 0.5]], "whole numbers from 0 to 255"),
        ):
            with pytest.raises(ValueError, match=message):
                primfit.write_points(tmp_path / "cloud.ply", np.zeros((1, 3)), colors=colors)
