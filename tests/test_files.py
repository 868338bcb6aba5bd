"""Clouds in files: round trips, real files, foreign and broken ones, depth images."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit

SUFFIXES = [".ply", ".pcd", ".las", ".laz", ".e57", ".xyz", ".pts", ".txt", ".npy", ".npz"]
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
        elif n == 0 and suffix in (".xyz", ".txt"):
            primfit.write_cloud(tmp_path / f"cloud{suffix}", cloud)
            with pytest.raises(ValueError, match="it holds no point"):
                primfit.read_cloud(tmp_path / f"cloud{suffix}")
        else:
            again = written_and_read(cloud, tmp_path / f"cloud{suffix}")
            np.testing.assert_array_equal(again.points, cloud.points)

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


class TestForeignFiles:
    def test_ply_of_every_order_and_type(self, tmp_path):
        rows = [(1.5, -2, 3, 200, -7), (4.25, 5, -6, 0, 9)]
        header = "ply\nformat {} 1.0\ncomment made by hand\nelement camera 1\nproperty int id\n"
        header += "element vertex 2\nproperty float x\nproperty float64 y\nproperty short z\n"
        header += "property uint8 red\nproperty int scalar_Label\nelement face 2\n"
        header += "property list uchar int vertex_indices\nend_header\n"
        kinds = [("x", "f4"), ("y", "f8"), ("z", "i2"), ("red", "u1"), ("label", "i4")]
        for order, mark in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
            table = np.array(rows, dtype=[(name, mark + kind) for name, kind in kinds])
            # A triangle and a quadrilateral follow.
            faces = b"\x03" + bytes(12) + b"\x04" + bytes(16)
            content = header.format(order).encode() + bytes(4) + table.tobytes() + faces
            (tmp_path / f"{order}.ply").write_bytes(content)
        text = "\n".join(" ".join(map(str, row)) for row in rows)
        content = header.format("ascii") + f"0\n{text}\n3 0 1 1\n4 0 1 1 0\n"
        (tmp_path / "ascii.ply").write_text(content)
        for order in ("ascii", "binary_little_endian", "binary_big_endian"):
            cloud = primfit.read_cloud(tmp_path / f"{order}.ply")
            np.testing.assert_array_equal(cloud.points, [row[:3] for row in rows])
            np.testing.assert_array_equal(cloud.fields["red"], [200, 0])
            np.testing.assert_array_equal(cloud.fields["label"], [-7, 9])

    def test_ply_equals_trimesh(self, tmp_path):
        import trimesh

        sphere = trimesh.creation.icosphere(subdivisions=2)
        for encoding in ("ascii", "binary"):
            file = tmp_path / f"{encoding}.ply"
            sphere.export(file, encoding=encoding)
            theirs = trimesh.load(file, process=False)
            np.testing.assert_array_equal(primfit.read_points(file), theirs.vertices)
        primfit.write_points(tmp_path / "ours.ply", sphere.vertices)
        theirs = trimesh.load(tmp_path / "ours.ply", process=False)
        np.testing.assert_array_equal(theirs.vertices, sphere.vertices)

    def test_pcd_with_fields_of_several_numbers_and_padding(self, tmp_path):
        file = tmp_path / "cloud.pcd"
        file.write_text(
            "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z _\nSIZE 4 4 4 4 4 4 1\n"
            "TYPE F F F F F F U\nCOUNT 1 1 1 1 1 1 1\nWIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
            "POINTS 1\nDATA ascii\n1 2 nan 0 0 1 0\n"
        )
        cloud = primfit.read_cloud(file)
        np.testing.assert_array_equal(cloud.points, [[1, 2, np.nan]])
        np.testing.assert_array_equal(cloud.fields["normal"], [[0, 0, 1]])
        assert list(cloud.fields) == ["normal"]

    @pytest.mark.parametrize(
        ("suffix", "text", "names"),
        [
            (".pts", "2\n1 2 3 0.5\n4 5 6 0.5\n", ["intensity"]),
            (".pts", "1,2,3\n4,5,6\n", []),
            (".pts", "1 2 3 9 8 7 6\n4 5 6 9 8 7 6\n", ["intensity", "color"]),
            (".xyz", "//X Y Z R G B Label\n1 2 3 9 8 7 6\n4 5 6 9 8 7 6\n", ["color", "label"]),
            (".xyz", "X;Y;Z;GPSTime\n1;2;3;0.1\n4;5;6;0.2\n", ["time"]),
            (".txt", "# x y z color _x\n1 2 3 9 8\n4 5 6 9 8\n", ["color_value", "_x"]),
            (".txt", "# a comment\n\n1 2 3 tree 5\n4 5 6 wall 5\n", ["column_5"]),
            (".txt", "1.0\t2.0\t3.0\t1e3\r\n4\t5\t6\t1e3\r\n", ["column_4"]),
        ],
    )
    def test_text(self, suffix, text, names, tmp_path):
        file = tmp_path / f"cloud{suffix}"
        file.write_bytes(text.encode())
        cloud = primfit.read_cloud(file)
        np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
        assert set(cloud.fields) == set(names)

    def test_e57_of_several_scans_with_poses(self, tmp_path):
        import pye57

        rng = np.random.default_rng(1)
        file = tmp_path / "scans.e57"
        local = [rng.normal(size=(n, 3)).astype(np.float32).astype(float) for n in (5, 8)]
        half = np.sqrt(0.5)
        with pye57.E57(str(file), "w") as e57:
            for points, rotation, place in zip(
                local, ([1, 0, 0, 0], [half, 0, 0, half]), ([0, 0, 1], [5e5, 6e6, 2]), strict=True
            ):
                columns = dict(
                    zip(("cartesianX", "cartesianY", "cartesianZ"), points.T, strict=True)
                )
                columns["intensity"] = np.linspace(0, 1, len(points))
                e57.write_scan_raw(
                    columns, rotation=np.array(rotation), translation=np.array(place)
                )
        cloud = primfit.read_cloud(file)
        assert list(cloud.fields) == ["intensity", "scan", "origin"]
        np.testing.assert_allclose(cloud.points[:5], local[0] + [0, 0, 1], atol=1e-12)
        x, y, z = local[1].T
        np.testing.assert_allclose(
            cloud.points[5:], np.stack([5e5 - y, 6e6 + x, 2 + z], axis=1), atol=2e-9
        )
        np.testing.assert_array_equal(cloud.fields["origin"][[0, 5]], [[0, 0, 1], [5e5, 6e6, 2]])
        np.testing.assert_array_equal(cloud.fields["scan"], [0] * 5 + [1] * 8)
        with pye57.E57(str(tmp_path / "scans.e57")) as e57:
            assert e57.scan_count == 2

    def test_others_read_our_e57(self, tmp_path):
        import pye57

        cloud = a_cloud(offset=NATIONAL_GRID)
        primfit.write_cloud(tmp_path / "ours.e57", cloud)
        with pye57.E57(str(tmp_path / "ours.e57")) as e57:
            scan = e57.read_scan_raw(0, ignore_unsupported_fields=True)
        np.testing.assert_array_equal(scan["cartesianX"], cloud.points[:, 0])
        np.testing.assert_array_equal(scan["colorGreen"], cloud.fields["color"][:, 1])

    def test_scan_of_primfit(self, small_scan, tmp_path):
        small_scan.save(tmp_path / "scan.npz")
        cloud = primfit.read_cloud(tmp_path / "scan.npz")
        np.testing.assert_array_equal(cloud.points, small_scan.points)
        np.testing.assert_array_equal(cloud.fields["origins"], small_scan.origins)
        np.testing.assert_array_equal(cloud.fields["layer"], small_scan.layer)

    def test_plain_arrays(self, tmp_path):
        image = np.arange(24.0).reshape(2, 3, 4)
        np.save(tmp_path / "image.npy", image)
        cloud = primfit.read_cloud(tmp_path / "image.npy")
        assert cloud.shape == (2, 3)
        np.testing.assert_array_equal(cloud.points, image.reshape(-1, 4)[:, :3])
        np.testing.assert_array_equal(cloud.fields["column_4"], image[..., 3].ravel())
        np.save(tmp_path / "list.npy", image[0, :, :3].astype(np.float32))
        assert primfit.read_points(tmp_path / "list.npy").dtype == np.float64


class TestBadFiles:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("content", [b"", b"\x00garbage\xff\n" * 5], ids=["empty", "garbage"])
    def test_empty_and_foreign(self, suffix, content, tmp_path):
        file = tmp_path / f"cloud{suffix}"
        file.write_bytes(content)
        with pytest.raises(ValueError, match=f"is not readable as {suffix}"):
            primfit.read_cloud(file)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("share", [0.3, 0.9])
    def test_truncated(self, suffix, share, tmp_path):
        file = tmp_path / f"cloud{suffix}"
        primfit.write_points(file, a_cloud(n=5000).points)
        content = file.read_bytes()
        cut = int(share * len(content))
        if suffix in (".xyz", ".txt"):
            # Nothing tells that whole lines are missing.
            cut = content[:cut].rindex(b" ")
        file.write_bytes(content[:cut])
        with pytest.raises(ValueError, match=f"is not readable as {suffix}"):
            primfit.read_cloud(file)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("other", SUFFIXES)
    def test_wrong_suffix(self, suffix, other, tmp_path):
        families = [{".las", ".laz"}, {".xyz", ".txt", ".pts"}]
        if suffix == other or any({suffix, other} <= family for family in families):
            return
        file = tmp_path / f"cloud{suffix}"
        primfit.write_points(file, a_cloud().points)
        wrong = file.rename(tmp_path / f"wrong{other}")
        with pytest.raises(ValueError, match=f"is not readable as {other}"):
            primfit.read_cloud(wrong)

    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            (
                "a.ply",
                "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n",
                "it has no x, y, z",
            ),
            ("a.ply", "ply\nformat odd 1.0\nelement vertex 1\nend_header\n", "its format is 'odd'"),
            ("a.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element vertex"),
            ("a.ply", "ply\nformat ascii 1.0\n", "its header has no end"),
            ("a.pts", "3\n1 2 3\n4 5 6\n", "it holds 2 points where it says 3"),
            ("a.xyz", "# nothing\n", "it holds no point"),
            ("a.xyz", "1 2 3\n4 5\n", "is not readable as .xyz"),
        ],
    )
    def test_what_is_wrong_is_said(self, name, content, message, tmp_path):
        (tmp_path / name).write_text(content)
        with pytest.raises(ValueError, match=message):
            primfit.read_cloud(tmp_path / name)

    def test_bad_arrays(self, tmp_path):
        np.save(tmp_path / "a.npy", np.zeros((4, 2)))
        with pytest.raises(ValueError, match=r"its array has shape \(4, 2\)"):
            primfit.read_cloud(tmp_path / "a.npy")
        np.savez(tmp_path / "a.npz", other=np.zeros((4, 3)))
        with pytest.raises(ValueError, match="it has no array 'points', only other"):
            primfit.read_cloud(tmp_path / "a.npz")
        np.savez(tmp_path / "b.npz", points=np.zeros((3, 2)))
        with pytest.raises(ValueError, match=r"its array 'points' has shape \(3, 2\)"):
            primfit.read_cloud(tmp_path / "b.npz")
        np.savez(tmp_path / "c.npz", points=np.zeros((2, 3)), note="hello", names=["a", "b"])
        assert not primfit.read_cloud(tmp_path / "c.npz").fields
        np.save(tmp_path / "b.npy", np.array([["a", "b", "c"]]))
        with pytest.raises(ValueError, match=r"is not readable as \.npy"):
            primfit.read_cloud(tmp_path / "b.npy")

    def test_unknown_and_missing_files(self, tmp_path):
        with pytest.raises(FileNotFoundError, match="there is no file"):
            primfit.read_points(tmp_path / "nothing.ply")
        (tmp_path / "cloud.doc").write_text("")
        with pytest.raises(ValueError, match="file must end in one of"):
            primfit.read_points(tmp_path / "cloud.doc")
        with pytest.raises(ValueError, match="file must end in one of"):
            primfit.write_points(tmp_path / "cloud.doc", np.zeros((1, 3)))
        primfit.write_points(tmp_path / "cloud.ply", np.zeros((1, 3)))
        with pytest.raises(ValueError, match="columns are for text files"):
            primfit.read_cloud(tmp_path / "cloud.ply", columns=("x", "y", "z"))
        primfit.write_points(tmp_path / "cloud.xyz", np.zeros((1, 3)))
        with pytest.raises(ValueError, match="columns must name the 3 of its lines, not 2"):
            primfit.read_cloud(tmp_path / "cloud.xyz", columns=("x", "y"))


class TestCloud:
    def test_is_frozen_and_says_what_it_is(self):
        points = np.zeros((2, 3))
        cloud = primfit.Cloud(points, {"label": [1, 2]}, (1, 2))
        points[0] = 1.0
        assert not cloud.points.any()
        for array in (cloud.points, cloud.fields["label"]):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 5
        with pytest.raises(TypeError):
            cloud.fields["label"] = 1
        assert repr(cloud) == "Cloud(1 x 2 points, 2 finite: label)"

    @pytest.mark.parametrize(
        ("fields", "shape", "error", "message"),
        [
            ({"label": [1]}, None, ValueError, r"must have shape \(2,\) or \(2, 3\), not \(1,\)"),
            ({"color": [1, 2]}, None, ValueError, r"fields\['color'\] must have shape \(2, 3\)"),
            ({"my label": [1, 2]}, None, ValueError, "names without spaces"),
            ({"x": [1, 2]}, None, ValueError, "other than x y z"),
            ({"label": ["a", "b"]}, None, TypeError, "must be numbers"),
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
            (np.zeros((2, 3)), r"must have shape \(1, 3\)"),
            ([[0, 0, 256]], "whole numbers from 0 to 255"),
            ([[0, 0, 0.5]], "whole numbers from 0 to 255"),
        ):
            with pytest.raises(ValueError, match=message):
                primfit.write_points(tmp_path / "cloud.ply", np.zeros((1, 3)), colors=colors)


class TestDepth:
    @settings(max_examples=30, deadline=None)
    @given(st.integers(0, 10**6))
    def test_projection_of_the_points_is_the_image(self, seed):
        rng = np.random.default_rng(seed)
        depth = rng.uniform(0.5, 5.0, (7, 9))
        fx, fy, cx, cy = *rng.uniform(5, 20, 2), *rng.uniform(0, 9, 2)
        points = primfit.points_of_depth(depth, fx, fy, cx, cy)
        u = fx * points[..., 0] / points[..., 2] + cx
        v = fy * points[..., 1] / points[..., 2] + cy
        np.testing.assert_allclose(u, np.broadcast_to(np.arange(9), (7, 9)), atol=1e-9)
        np.testing.assert_allclose(v, np.broadcast_to(np.arange(7)[:, None], (7, 9)), atol=1e-9)
        np.testing.assert_array_equal(points[..., 2], depth)

    def test_pixels_without_depth(self):
        depth = np.array([[1.0, 0.0, np.nan], [np.inf, -1.0, 2.0]])
        points = primfit.points_of_depth(depth, 1, 1, 0, 0)
        np.testing.assert_array_equal(
            np.isfinite(points).all(axis=-1), [[True, False, False], [False, False, True]]
        )

    @pytest.mark.parametrize(
        ("arguments", "error", "message"),
        [
            ((np.zeros(3), 1, 1, 0, 0), ValueError, r"depth must have shape \(h, w\), not \(3,\)"),
            ((np.zeros((2, 2)), 0, 1, 0, 0), ValueError, "fx must not be zero"),
            ((np.zeros((2, 2)), 1, np.nan, 0, 0), ValueError, "fy must be finite"),
            ((np.array([["a"]]), 1, 1, 0, 0), TypeError, "depth must be an array of numbers"),
        ],
    )
    def test_bad_arguments(self, arguments, error, message):
        with pytest.raises(error, match=message):
            primfit.points_of_depth(*arguments)
        with pytest.raises(ValueError, match="scale must be greater than 0"):
            primfit.points_of_depth(np.zeros((2, 2)), 1, 1, 0, 0, scale=0)
