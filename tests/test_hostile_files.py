"""Files whose headers say what is not there: refused, and before memory or time is spent."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import struct
import subprocess
import sys
import time
import zipfile
import zlib
from pathlib import Path

import laspy
import numpy as np
import pytest
from test_files import a_cloud

import primfit
from primfit.clouds.formats.e57_header import check_description

FUZZ = Path(__file__).parent.parent / "fuzz"


def refused(file, content, message):
    file.write_bytes(content)
    start = time.process_time()
    with pytest.raises(ValueError, match=message) as told:
        primfit.read_cloud(file)
    assert str(told.value).startswith(f"{file} is not readable as ")
    assert time.process_time() - start < 1.0


@pytest.fixture(autouse=True)
def _little_memory():
    """Room for files of this size, not for what they claim."""
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    old = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + (1 << 30), old[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, old)


def a_las(folder, suffix, *, point_format=6, version="1.4", n=500):
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.vlrs.append(laspy.VLR("someone", 7, "note", b"content"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(1).uniform(0, 50, (3, n))
    if version == "1.4":
        las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("someone", 8, "more", b"content")])
    las.write(folder / f"valid{suffix}")
    content = bytearray((folder / f"valid{suffix}").read_bytes())
    assert len(primfit.read_points(folder / f"valid{suffix}")) == n
    return content


class TestLas:
    @pytest.mark.parametrize("suffix", [".las", ".laz"])
    @pytest.mark.parametrize(
        ("place", "value", "message"),
        [
            ((100, "<I"), 0x3FB99999, "it is said to have 1069128089 records before its points"),
            ((243, "<I"), 0x3FB99999, "it is said to have 1069128089 records from byte"),
            ((235, "<Q"), 2**62, "it is said to have 1 records from byte"),
            ((247, "<Q"), 2**40, r"of 1099511627776 points|says 1099511627776 points"),
            ((96, "<I"), 2**31, "its points begin at byte 2147483648 of"),
            ((94, "<H"), 0, "its header takes 0 bytes"),
            ((395, "<H"), 65535, "record 0 takes 65535 bytes, where"),
            ((105, "<H"), 3, "its points are of format 6 and 3 bytes"),
            ((104, "<B"), 60, "its points are of format 60"),
            ((25, "<B"), 9, r"its version is 1\.9, not 1\.0 to 1\.5"),
            ((131, "<d"), 0.0, "its scales must be finite and not 0"),
            ((139, "<d"), np.nan, "its scales must be finite and not 0"),
            ((155, "<d"), np.inf, "its offsets must be finite"),
        ],
    )
    def test_numbers_of_the_header(self, suffix, place, value, message, tmp_path):
        content = a_las(tmp_path, suffix)
        struct.pack_into(place[1], content, place[0], value)
        refused(tmp_path / f"bad{suffix}", content, message)

    @pytest.mark.parametrize(
        ("at", "value", "message"),
        [
            ("table", 0xFFFFFFF0, "bytes for 4294967280 chunks of points"),
            ("chunk", 0xFFFFFFF0, "it has a chunk of 4294967280 points in layers"),
            ("layer", 0xFFFFFFF0, "in layers of 429496"),
            ("place", 0, "it has no table of its chunks: it may be cut short"),
            ("size", 1, "chunks of 1, where its header says 500 points"),
            ("kind", 7, "its compression is of kind 7"),
            ("item", 99, "its compression has an item of kind 99"),
        ],
    )
    def test_numbers_of_the_compression(self, at, value, message, tmp_path):
        content = a_las(tmp_path, ".laz")
        (start,) = struct.unpack_from("<I", content, 96)
        (table,) = struct.unpack_from("<q", content, start)
        record = content.index(b"laszip encoded") + 52
        places = {
            "table": (table + 4, "<I"),
            "chunk": (start + 8 + 30, "<I"),
            "layer": (start + 8 + 34, "<I"),
            "place": (start, "<q"),
            "size": (record + 12, "<I"),
            "kind": (record, "<H"),
            "item": (record + 34, "<H"),
        }
        place, kind = places[at]
        struct.pack_into(kind, content, place, value)
        refused(tmp_path / "bad.laz", content, message)

    def test_damaged_points_are_an_error_of_python(self, tmp_path):
        content = a_las(tmp_path, ".laz", point_format=3, version="1.2")
        (start,) = struct.unpack_from("<I", content, 96)
        rng = np.random.default_rng(0)
        n_refused = 0
        for _ in range(100):
            damaged = bytearray(content)
            damaged[start + 8 + 34 : start + 400] = rng.bytes(366 - 34 - 8)
            (tmp_path / "bad.laz").write_bytes(damaged)
            try:
                primfit.read_cloud(tmp_path / "bad.laz")
            except ValueError:
                n_refused += 1
        assert n_refused > 50

    @pytest.mark.parametrize("suffix", [".las", ".laz"])
    def test_whose_writer_died(self, suffix, tmp_path):
        """The header says 0 points until all are written."""
        content = a_las(tmp_path, suffix)
        (start,) = struct.unpack_from("<I", content, 96)
        struct.pack_into("<Q", content, 247, 0)
        struct.pack_into("<QI", content, 235, 0, 0)
        if suffix == ".laz":
            struct.pack_into("<q", content, start, -1)
        refused(tmp_path / f"torn{suffix}", content[: start + 2000], "it may be cut short")

    def test_undeclared_bytes_and_pairs_are_fields(self, tmp_path):
        header = laspy.LasHeader(point_format=1, version="1.2")
        header.add_extra_dims([laspy.ExtraBytesParams("pair", "2i2")])
        las = laspy.LasData(header)
        las.x, las.y, las.z = np.arange(30.0).reshape(3, 10)
        las["pair"] = np.arange(20).reshape(10, 2)
        for suffix in (".las", ".laz"):
            las.write(tmp_path / f"a{suffix}")
            cloud = primfit.read_cloud(tmp_path / f"a{suffix}")
            assert cloud.fields["pair"].tolist() == np.arange(20).reshape(10, 2).tolist()
        content = (tmp_path / "a.las").read_bytes()
        (start,), (size,) = (
            struct.unpack_from("<I", content, 96),
            struct.unpack_from("<H", content, 105),
        )
        rows = np.frombuffer(content[start:], np.uint8).reshape(10, size)
        wide = np.column_stack([rows, np.full((10, 4), 9, np.uint8)]).tobytes()
        longer = content[:105] + struct.pack("<H", size + 4) + content[107:start] + wide
        (tmp_path / "b.las").write_bytes(longer)
        cloud = primfit.read_cloud(tmp_path / "b.las")
        assert cloud.fields["ExtraBytes"].tolist() == [[9] * 4] * 10
        np.testing.assert_array_equal(cloud.points, las.xyz)

    def test_chunks_of_several_sizes(self, tmp_path):
        """More points than a chunk holds."""
        points = np.random.default_rng(2).uniform(0, 9, (120_001, 3))
        primfit.write_points(tmp_path / "a.laz", points)
        np.testing.assert_allclose(primfit.read_points(tmp_path / "a.laz"), points, atol=1e-6)
        assert laspy.read(tmp_path / "a.laz").header.point_count == 120_001


class TestPcd:
    HEAD = "VERSION {v}\nFIELDS x y z {f}\nSIZE 4 4 4 {s}\nTYPE F F F {t}\n{c}WIDTH {w}\nHEIGHT 1\nPOINTS 2\nDATA {d}\n"

    def head(self, *, v=".7", f="", s="", t="", c="", w="2", d="ascii"):
        return self.HEAD.format(v=v, f=f, s=s, t=t, c=c, w=w, d=d)

    @pytest.mark.parametrize("version", [".5", ".6", "0.7", ".7"])
    @pytest.mark.parametrize("count", ["", "COUNT 1 1 1\n", "COUNT 0 0 0\n"])
    @pytest.mark.parametrize(
        "rows",
        ["1  2  3\n4 5 6\n", "1\t2\t3\n4\t5\t6", " 1 2 3 \r\n\r\n4 5 6 \r\n", "1,2,3\n4,5,6\n"],
    )
    def test_text_as_others_write_it(self, version, count, rows, tmp_path):
        (tmp_path / "a.pcd").write_text(self.head(v=version, c=count) + rows)
        assert primfit.read_points(tmp_path / "a.pcd").tolist() == [[1, 2, 3], [4, 5, 6]]

    @pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
    def test_fields_of_several_numbers(self, data, tmp_path):
        head = self.head(f="fpfh _", s="8 1", t="F U", c="COUNT 1 1 1 3 2\n", d=data)
        kind = np.dtype([("p", "<f4", 3), ("fpfh", "<f8", 3), ("_", "u1", 2)])
        rows = np.array(
            [((1, 2, 3), (0.1, 0.2, 0.3), (0, 0)), ((4, 5, 6), (1, 2, 3), (0, 0))], kind
        )
        body = rows.tobytes()
        if data == "ascii":
            body = b"1 2 3 0.1 0.2 0.3 0 0\n4 5 6 1 2 3 0 0\n"
        elif data == "binary_compressed":
            lzf = pytest.importorskip("lzf")
            columns = rows["p"].T.tobytes() + rows["fpfh"].tobytes() + rows["_"].tobytes()
            packed = lzf.compress(columns, 200)
            body = struct.pack("<II", len(packed), len(columns)) + packed
        (tmp_path / "a.pcd").write_bytes(head.encode() + body)
        cloud = primfit.read_cloud(tmp_path / "a.pcd")
        np.testing.assert_array_equal(cloud.points, rows["p"])
        np.testing.assert_array_equal(cloud.fields["fpfh"], rows["fpfh"])
        assert list(cloud.fields) == ["fpfh"]

    def test_whole_numbers_of_64_bits(self, tmp_path):
        head = self.head(f="c d", s="8 8", t="I U")
        (tmp_path / "a.pcd").write_text(head + f"1 2 3 {-(2**63)} 9\n4 5 6 7 {2**64 - 1}\n")
        fields = primfit.read_cloud(tmp_path / "a.pcd").fields
        assert fields["c"].tolist() == [-(2**63), 7]
        assert fields["d"].tolist() == [9, 2**64 - 1]

    @pytest.mark.parametrize(
        ("changes", "body", "message"),
        [
            (
                {"f": "q", "s": "4", "t": "F", "c": "COUNT 1 1 1 100000000\n", "d": "binary"},
                "",
                "it has 0 of",
            ),
            (
                {"f": "q", "s": "4", "t": "F", "c": "COUNT 1 1 1 100000000\n"},
                "1 2 3",
                "5 bytes for 2 x",
            ),
            ({"w": "4000000000"}, "", "POINTS must be WIDTH x HEIGHT, 4000000000 x 1, not 2"),
            ({"w": "-2"}, "", "WIDTH must be a whole number of at least 0, not '-2'"),
            ({"c": "COUNT 1 1\n"}, "", "COUNT must have 3 values, as FIELDS has, not 2"),
            ({"f": "q", "s": "3", "t": "F"}, "", "TYPE, SIZE must be I or U"),
            ({"d": "zip"}, "", "DATA must be ascii, binary or binary_compressed, not 'zip'"),
            ({}, "1 2 3\n4 5 6\n7 8 9", "it holds 3 points where POINTS is 2"),
            ({}, "1 2 3\n4 5 six", 'line 10 has "six" in column 3'),
            (
                {"f": "a", "s": "1", "t": "U"},
                "1 2 3 4\n1 2 3 256",
                "field a has values that are no uint8",
            ),
            (
                {"d": "binary_compressed"},
                "\1\0\0\0\xff\xff\xff\xff?",
                "1 compressed bytes are said to be 4294967295",
            ),
            ({"d": "binary_compressed"}, "\1\0\0", "it ends before the two sizes"),
        ],
    )
    def test_bad_ones(self, changes, body, message, tmp_path):
        refused(tmp_path / "a.pcd", self.head(**changes).encode() + body.encode("latin-1"), message)


class TestPly:
    XYZ = "property float x\nproperty float y\nproperty float z\n"

    @pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
    def test_lists_anywhere(self, order, tmp_path):
        head = (
            f"ply\r\nformat {order} 1.0\r\nelement face 2\nproperty list uchar int vertex_indices\n"
        )
        head += f"element vertex 2\n{self.XYZ}property list ushort double feature\nproperty bool ok\nend_header\n"
        text = "\n3 0 1 1\n\n4 0 1 1 0\n1 2 3 2 0.5 0.5 1\n\n4 5 6 0 0"
        mark = ">" if "big" in order else "<"
        raw = struct.pack(f"{mark}B3iB4i", 3, 0, 1, 1, 4, 0, 1, 1, 0)
        raw += struct.pack(f"{mark}3fH2dB", 1, 2, 3, 2, 0.5, 0.5, 1) + struct.pack(
            f"{mark}3fHB", 4, 5, 6, 0, 0
        )
        (tmp_path / "a.ply").write_bytes(
            head.encode() + (text.encode() if order == "ascii" else raw)
        )
        cloud = primfit.read_cloud(tmp_path / "a.ply")
        assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
        assert cloud.fields["ok"].tolist() == [1, 0]

    @pytest.mark.parametrize(
        ("count", "more", "order", "message"),
        [
            (
                2**31,
                "",
                "binary_little_endian",
                "element vertex: it ends after 2 of 2147483648 rows",
            ),
            (2**62, "", "ascii", "element vertex: it ends after"),
            (
                2**62,
                "property list uchar int i\n",
                "binary_little_endian",
                "it ends after 3 of 4611686018427387904",
            ),
            ("two", "", "ascii", "must have 'element name count', not 'element vertex two'"),
            (
                2,
                "property list float int i\n",
                "binary_big_endian",
                "row 0 has a list whose length is no whole",
            ),
            (2, "property list uchar complex i\n", "ascii", "a (type|property of type) 'complex'"),
            (2, "property float x\n", "ascii", "two properties 'x' of one element"),
            (2, "property uchar c\n", "ascii", "property c has values that are no char|no uchar"),
        ],
    )
    def test_bad_ones(self, count, more, order, message, tmp_path):
        head = f"ply\nformat {order} 1.0\nelement vertex {count}\n{self.XYZ}{more}end_header\n"
        body = b"1 2 3 400\n4 5 6 7\n" if order == "ascii" else bytes(24 if not more else 40)
        refused(tmp_path / "a.ply", head.encode() + body, message)


def an_npy(header):
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


class TestArrays:
    @pytest.mark.parametrize(
        ("header", "message"),
        [
            (
                "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 3)}",
                "takes 24000000000 bytes",
            ),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3)}", "where 0 follow"),
            ("{'descr': '|O', 'fortran_order': False, 'shape': (1, 3)}", "it holds Python objects"),
            ("(" * 9000, "is not readable as .npy"),
            ("{'descr': '<f8'", "is not readable as .npy"),
        ],
    )
    def test_headers(self, header, message, tmp_path):
        refused(tmp_path / "a.npy", an_npy(header), message)
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
            archive.writestr("points.npy", an_npy(header))
        refused(
            tmp_path / "a.npz", (tmp_path / "a.zip").read_bytes(), message.replace("npy", "npz")
        )

    def test_kinds_and_shapes(self, tmp_path):
        for array, message in (
            (np.zeros((4, 3), complex), "its array holds complex128, not numbers"),
            (np.zeros((3, 40, 50)), r"shape \(3, 40, 50\), as if x, y and z were its rows"),
            (np.zeros((3, 400)), r"shape \(3, 400\), as if x, y and z were its rows"),
        ):
            np.save(tmp_path / "a.npy", array)
            refused(tmp_path / "a.npy", (tmp_path / "a.npy").read_bytes(), message)

    def test_named_columns_of_any_width(self, tmp_path):
        kind = [
            ("x", "f8"),
            ("y", "f8"),
            ("z", "f8"),
            ("rgb", "u1", 3),
            ("name", "U3"),
            ("h", "f4", (2, 2)),
        ]
        rows = np.zeros(5, kind)
        rows["rgb"], rows["h"] = [1, 2, 3], np.arange(4).reshape(2, 2)
        np.save(tmp_path / "a.npy", rows)
        cloud = primfit.read_cloud(tmp_path / "a.npy")
        assert cloud.fields["rgb"].tolist() == [[1, 2, 3]] * 5
        assert cloud.fields["h"].tolist() == [[0, 1, 2, 3]] * 5
        assert list(cloud.fields) == ["rgb", "h"]

    def test_a_bomb_is_not_unpacked(self, tmp_path):
        array = io.BytesIO()
        np.save(array, np.zeros((2000, 3)))
        with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("points.npy", array.getvalue())
        content = bytearray((tmp_path / "a.npz").read_bytes())
        at = content.index(b"PK\x01\x02")
        struct.pack_into("<I", content, at + 24, 0xFFFFFFF0)
        refused(tmp_path / "b.npz", content, "said to be 4294967280 bytes, which .* cannot hold")


class TestE57:
    @pytest.fixture
    def content(self, tmp_path):
        primfit.write_cloud(tmp_path / "a.e57", a_cloud())
        return bytearray((tmp_path / "a.e57").read_bytes())

    def test_header(self, content, tmp_path):
        refused(
            tmp_path / "a.e57", content[:2048], r"it has 2048 of \d+ bytes: it may be cut short"
        )
        for at, value in ((24, 2**60), (32, 2**60), (40, 7)):
            changed = bytearray(content)
            struct.pack_into("<Q", changed, at, value)
            refused(tmp_path / "a.e57", changed, "its description of")

    def test_claims_and_poses(self, content, tmp_path, monkeypatch):
        monkeypatch.syspath_prepend(str(FUZZ))
        from mutations import with_checksums

        assert content.count(b'recordCount="60"') == 1
        for claim in (b"61", b"99"):
            changed = bytes(content).replace(b'recordCount="60"', b'recordCount="%s"' % claim)
            refused(tmp_path / "a.e57", with_checksums(changed), "is not readable as .e57")
        # Room for a longer number: blanks of the description, which are many.
        changed = bytes(content).replace(b'recordCount="60"', b'recordCount="9999999999"')
        blanks = changed.rindex(b"\n" + b" " * 8)
        changed = changed[: blanks + 1] + changed[blanks + 9 :]
        refused(tmp_path / "b.e57", with_checksums(changed), "is not readable as .e57")

    @pytest.mark.parametrize(
        ("description", "message"),
        [
            ("<a>" * 65 + "</a>" * 65, "more than 64 elements deep"),
            ('<a type="Structure">' + "<b/>" * 1001 + "</a>", "too many 'b' side by side"),
            ('<a type="CompressedVector" recordCount="9000"/>', "its recordCount is '9000'"),
            ('<a type="CompressedVector" recordCount="-1"/>', "its recordCount is '-1'"),
            ('<a type="CompressedVector" fileOffset="1001"/>', "its fileOffset is '1001'"),
            ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "defines entities"),
            ("<a><b></a>", "its description is no XML: mismatched tag"),
        ],
    )
    def test_descriptions(self, description, message):
        with pytest.raises(ValueError, match=message):
            check_description(description.encode(), 1000)
        check_description(b'<a type="Vector">' + b"<b/>" * 1001 + b"</a>", 1000)

    def test_deep_ones_do_not_end_the_process(self, tmp_path, monkeypatch):
        monkeypatch.syspath_prepend(str(FUZZ))
        from mutations import with_checksums

        text = b"<e57Root>" + b'<a type="Structure">' * 20_000 + b"</a>" * 20_000 + b"</e57Root>"
        stream = bytes(48) + text
        pages = b"".join(
            stream[k : k + 1020].ljust(1024, b"\0") for k in range(0, len(stream), 1020)
        )
        header = struct.pack("<8sII4Q", b"ASTM-E57", 1, 0, len(pages), 48, len(text), 1024)
        content = with_checksums(header + pages[48:])
        refused(tmp_path / "a.e57", content, "more than 64 elements deep")

    def test_a_rotation_of_nothing_is_refused(self, tmp_path):
        import pye57

        with pye57.E57(str(tmp_path / "a.e57"), "w") as e57:
            columns = {f"cartesian{axis}": np.arange(4.0) for axis in "XYZ"}
            e57.write_scan_raw(columns, rotation=np.zeros(4), translation=np.zeros(3))
        with pytest.raises(ValueError, match="a rotation that is no unit quaternion"):
            primfit.read_cloud(tmp_path / "a.e57")


class TestScanAndWorld:
    def test_damaged_scans(self, tmp_path):
        file = tmp_path / "scan.npz"
        primfit.Scan.from_points(np.random.default_rng(0).random((50, 3)), (9, 9, 9)).save(file)
        content, rng = file.read_bytes(), np.random.default_rng(1)
        for _ in range(300):
            damaged = bytearray(content)
            for at in rng.integers(len(damaged), size=3):
                damaged[at] ^= 1 << int(rng.integers(8))
            file.write_bytes(damaged)
            with contextlib.suppress(ValueError):
                primfit.Scan.load(file)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"points": np.zeros((4, 3))}, r"its array 'points' is float64 \(4, 3\)"),
            ({"ranges": np.array(["a"] * 5)}, "its array 'ranges' is <U1"),
            ({"layer": np.zeros(5)}, r"its array 'layer' is float64"),
            ({"sigma": -1.0}, "its sigma must be finite and at least 0, not -1.0"),
            ({"max_range": np.nan}, "its max_range must be finite and at least 0, not nan"),
            ({"primfit": "cloud"}, "no array 'primfit' that says 'scan'"),
            ({"origins": None}, "it lacks origins"),
        ],
    )
    def test_scans_of_other_arrays(self, changes, message, tmp_path):
        scan = primfit.Scan.from_points(np.ones((5, 3)), (9, 9, 9))
        names = ("points", "origins", "directions", "ranges")
        arrays = {"primfit": "scan", **{name: getattr(scan, name) for name in names}, **changes}
        np.savez(tmp_path / "a.npz", **{name: x for name, x in arrays.items() if x is not None})
        with pytest.raises(ValueError, match=message):
            primfit.Scan.load(tmp_path / "a.npz")

    @pytest.mark.parametrize(
        "text",
        [
            "[" * 100_000,
            "{",
            "[]",
            "null",
            "\x00\xff",
            '{"primfit": "world"}',
            '{"primfit": "world", "arena": {"size": 1e999}, "solids": []}',
            '{"primfit": "world", "arena": null, "solids": 7}',
            '{"primfit": "world", "arena": null, "solids": [{"footprint": [[0, 0]], "height": 1}]}',
        ],
    )
    def test_worlds(self, text, tmp_path):
        (tmp_path / "a.json").write_text(text, encoding="latin-1")
        with pytest.raises(ValueError, match=r"a\.json is not a world that primfit reads: "):
            primfit.World.load(tmp_path / "a.json")

    def test_that_are_not_there(self, tmp_path):
        for load in (primfit.Scan.load, primfit.World.load):
            with pytest.raises(FileNotFoundError, match="nothing"):
                load(tmp_path / "nothing")

    def test_saved_worlds_are_strict_json(self, world, tmp_path):
        world.save(tmp_path / "a.json")
        json.loads((tmp_path / "a.json").read_text(), parse_constant=pytest.fail)


def test_a_little_fuzzing():
    command = [sys.executable, str(FUZZ / "files.py"), "--inputs", "600", "--seed", "7"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "600 inputs" in result.stdout


def test_the_checksums_of_the_fuzzer_are_those_of_the_format(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(FUZZ))
    from mutations import with_checksums

    primfit.write_cloud(tmp_path / "a.e57", a_cloud())
    content = (tmp_path / "a.e57").read_bytes()
    assert with_checksums(content) == content
    assert zlib.crc32(with_checksums(bytes(1024))) != zlib.crc32(bytes(1024))
