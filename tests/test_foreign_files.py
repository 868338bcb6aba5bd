"""Files of others, and broken ones."""

from __future__ import annotations

import numpy as np
import pytest
from test_files import NATIONAL_GRID, SUFFIXES, a_cloud

import primfit


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
        if suffix in (".xyz", ".txt", ".asc", ".csv"):
            # Nothing tells that whole lines are missing.
            cut = content[:cut].rindex(b"," if suffix == ".csv" else b" ")
        file.write_bytes(content[:cut])
        with pytest.raises(ValueError, match=f"is not readable as {suffix}"):
            primfit.read_cloud(file)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("other", SUFFIXES)
    def test_wrong_suffix(self, suffix, other, tmp_path):
        families = [
            {".las", ".laz"},
            {".xyz", ".txt", ".pts", ".asc", ".csv"},
            {".csv.gz", ".pts.gz"},
        ]
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
