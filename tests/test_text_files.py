"""Text files as others write them."""

from __future__ import annotations

import contextlib
import gzip
import time

import numpy as np
import pytest

import primfit

POINTS = np.array([[10.5, 20, 30], [11.5, 21, 31], [12.5, 22, 32]])


def read(folder, name, text):
    content = text if isinstance(text, bytes) else text.encode()
    (folder / name).write_bytes(content)
    return primfit.read_cloud(folder / name)


def rows(pattern, separator=" "):
    """Lines whose words are numbers, or coordinates where the pattern says x, y, z."""
    lines = []
    for k, point in enumerate(POINTS):
        values = {**dict(zip("xyz", point, strict=True)), "i": k + 7}
        lines.append(separator.join(str(values.get(word, word)) for word in pattern))
    return "\n".join(lines) + "\n"


class TestTitles:
    @pytest.mark.parametrize(
        ("title", "pattern", "separator", "fields"),
        [
            ("Point Id,X,Y,Z", "ixyz", ",", ["Point_Id"]),
            ('"Point Id";"Z";"Y";"X"', "izyx", ";", ["Point_Id"]),
            ("X [m] Y [m] Z [m] label", "xyzi", " ", ["label"]),
            ("X[m],Y[m],Z[m],Intensity[-]", "xyzi", ",", ["intensity"]),
            (
                "intensity,laser_id,Points:0,Points:1,Points:2",
                "iixyz",
                ",",
                ["intensity", "laser_id"],
            ),
            ('"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2","i"', "xyzi", ",", ["intensity"]),
            ("// z y x t\n# a remark after the title", "zyxi", " ", ["time"]),
            ("# exported on Monday\n# label x y z", "ixyz", "\t", ["label"]),
            ('x,y,z,"a, b"', "xyzi", ",", ["a_b"]),
            ("x,y,z,n,n", "xyzii", ",", ["n", "n_5"]),
        ],
    )
    def test_are_understood_in_any_order(self, title, pattern, separator, fields, tmp_path):
        cloud = read(tmp_path, "a.txt", f"{title}\n{rows(pattern, separator)}")
        np.testing.assert_array_equal(cloud.points, POINTS)
        assert list(cloud.fields) == fields
        assert cloud.fields[fields[0]].tolist() == [7, 8, 9]

    @pytest.mark.parametrize(
        "title",
        ["Easting Northing Height Id", "ncols 4", "x y z", "# label y x z of the scan", "a b c d"],
    )
    def test_that_are_not_understood_are_refused(self, title, tmp_path):
        with pytest.raises(
            ValueError, match=r"a\.txt is not readable.*columns=\('id', 'x', 'y', 'z'\)"
        ):
            read(tmp_path, "a.txt", f"{title}\n{rows('ixyz')}")
        cloud = primfit.read_cloud(tmp_path / "a.txt", columns=["id", "x", "y", "z"])
        np.testing.assert_array_equal(cloud.points, POINTS)

    def test_remarks_do_no_harm(self, tmp_path):
        for remark in ("# x y z are in metres", "# made by hand", "// columns: x y z"):
            cloud = read(tmp_path, "a.xyz", f"{remark}\n{rows('xyz')}")
            np.testing.assert_array_equal(cloud.points, POINTS)

    def test_columns_must_differ(self, tmp_path):
        (tmp_path / "a.txt").write_text(rows("xyzi"))
        with pytest.raises(
            ValueError, match="columns must differ from each other, not be x, y, z, x"
        ):
            primfit.read_cloud(tmp_path / "a.txt", columns=["x", "y", "z", "x"])


class TestFirstRows:
    @pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff"])
    def test_byte_order_marks(self, mark, tmp_path):
        text = rows("xyz")
        encoding = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}.get(mark, "utf-8")
        cloud = read(tmp_path, "a.xyz", mark + text.encode(encoding))
        np.testing.assert_array_equal(cloud.points, POINTS)

    @pytest.mark.parametrize(
        "word", ["-nan(ind)", "NA", "1.0D+00", "#N/A", "1,5", "null", "1_0", "--"]
    )
    @pytest.mark.parametrize("line", [1, 2])
    def test_that_are_no_numbers_are_errors(self, word, line, tmp_path):
        lines = rows("xyz", ";").splitlines()
        lines[line - 1] = f"{word};2;3"
        with pytest.raises(ValueError, match=rf"a\.xyz is not readable as \.xyz: line {line} has "):
            read(tmp_path, "a.xyz", "\n".join(lines))

    def test_that_tell_nothing_are_errors_with_names_too(self, tmp_path):
        (tmp_path / "a.txt").write_text("NA NA NA\n" + rows("xyz"))
        with pytest.raises(ValueError, match='line 1 has "NA" in column 1, which is no number'):
            primfit.read_cloud(tmp_path / "a.txt", columns=["x", "y", "z"])

    def test_nan_is_a_point_without_place(self, tmp_path):
        cloud = read(tmp_path, "a.xyz", "nan nan nan 1\n" + rows("xyzi"))
        assert np.isnan(cloud.points[0]).all()
        assert cloud.fields["column_4"].tolist() == [1, 7, 8, 9]


class TestRows:
    def test_of_other_lengths_are_errors(self, tmp_path):
        for wrong, n in (("1 2", 2), ("1 2 3 4", 4)):
            with pytest.raises(ValueError, match=f"line 4 has {n} columns, not 3"):
                read(tmp_path, "a.xyz", rows("xyz") + wrong)

    def test_words_are_left_out_and_quotes_are_none(self, tmp_path):
        text = 'name,x,y,z\n"a, b","1",2,3\nc,4,5,6\n'
        cloud = read(tmp_path, "a.csv", text)
        np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
        assert not cloud.fields

    def test_whole_numbers_are_exact(self, tmp_path):
        large = [2**53 + 1, -(2**63), 2**63 - 1]
        text = "".join(f"1 2 3 {number}\n" for number in large)
        assert read(tmp_path, "a.xyz", text).fields["column_4"].tolist() == large
        text = f"1 2 3 {2**64 - 1}\n"
        assert read(tmp_path, "a.xyz", text).fields["column_4"].tolist() == [2**64 - 1]
        cloud = primfit.Cloud(np.zeros((2, 3)), {"count": [2**63 - 1, 2**53 + 1]})
        primfit.write_cloud(tmp_path / "b.csv", cloud)
        again = primfit.read_cloud(tmp_path / "b.csv")
        np.testing.assert_array_equal(again.fields["count"], cloud.fields["count"])

    def test_numbers_survive_in_all_their_digits(self, tmp_path):
        rng = np.random.default_rng(3)
        points = rng.normal(size=(300, 3)) * 10.0 ** rng.integers(-300, 300, (300, 3))
        points[:3, 0] = np.nan, np.inf, -np.inf
        primfit.write_points(tmp_path / "a.xyz", points)
        np.testing.assert_array_equal(primfit.read_points(tmp_path / "a.xyz"), points)

    @pytest.mark.parametrize(
        "line", ["(" * 20_000, " " * 20_000 + "(", "x y z " * 5_000, "a[" * 9_000]
    )
    def test_long_lines_take_no_long_time(self, line, tmp_path):
        start = time.process_time()
        for text in (
            f"# {line}\n1 2 3\n",
            f"{line}\n1 2 3\n",
            f"1 2 3 {2**62}\n" * 5,
            f"{2**62} " * 6000,
        ):
            (tmp_path / "a.txt").write_text(text)
            with contextlib.suppress(ValueError):
                primfit.read_cloud(tmp_path / "a.txt")
        assert time.process_time() - start < 2.0


class TestOtherFormats:
    def test_gz_is_the_same_each_time(self, tmp_path):
        cloud = primfit.Cloud(POINTS, {"label": [1, 2, 3]})
        for name in ("a.txt.gz", "b.txt.gz"):
            primfit.write_cloud(tmp_path / name, cloud)
        content = (tmp_path / "a.txt.gz").read_bytes()
        assert content == (tmp_path / "b.txt.gz").read_bytes()
        assert gzip.decompress(content).startswith(b"# x y z label\n10.5 20 30 1\n")
        (tmp_path / "a.txt.gz").write_bytes(content[:-12])
        with pytest.raises(ValueError, match=r"a\.txt\.gz is not readable as \.txt\.gz"):
            primfit.read_cloud(tmp_path / "a.txt.gz")
        with pytest.raises(ValueError, match="file must end in one of"):
            primfit.write_cloud(tmp_path / "a.las.gz", cloud)

    def test_kitti(self, tmp_path):
        table = np.arange(40, dtype="<f4").reshape(10, 4)
        table.tofile(tmp_path / "a.bin")
        cloud = primfit.read_cloud(tmp_path / "a.bin")
        np.testing.assert_array_equal(cloud.points, table[:, :3])
        np.testing.assert_array_equal(cloud.fields["intensity"], table[:, 3])
        with pytest.raises(ValueError, match=r"must not end in \.bin, which is only read"):
            primfit.write_cloud(tmp_path / "b.bin", cloud)
        (tmp_path / "a.bin").write_bytes(table.tobytes()[:-1])
        with pytest.raises(ValueError, match="it has 159 bytes, not 16 for each point"):
            primfit.read_cloud(tmp_path / "a.bin")

    def test_ptx(self, tmp_path):
        turned = "0 1 0 0\n-1 0 0 0\n0 0 1 0\n5 6 7 1\n"
        head = "3\n2\n5 6 7\n0 1 0\n-1 0 0\n0 0 1\n" + turned
        points = "1 0 0 0.5\n0 1 0 0.25\n0 0 0 0.5\n0 0 1 0\n2 0 0 1\n0 2 0 1\n"
        expected = np.array([[5, 7, 7], [4, 6, 7], [np.nan] * 3, [5, 6, 8], [5, 8, 7], [3, 6, 7]])
        cloud = read(tmp_path, "a.ptx", head + points)
        np.testing.assert_array_equal(cloud.points, expected)
        assert cloud.shape == (3, 2)
        assert cloud.fields["intensity"].tolist() == [0.5, 0.25, 0.5, 0, 1, 1]
        np.testing.assert_array_equal(cloud.fields["origin"], np.tile([5, 6, 7], (6, 1)))
        two = read(tmp_path, "b.ptx", (head + points) * 2)
        np.testing.assert_array_equal(two.points, np.tile(expected, (2, 1)))
        np.testing.assert_array_equal(two.fields["scan"], np.repeat([0, 1], 6))

    @pytest.mark.parametrize(
        ("changed", "to", "message"),
        [
            ("3\n2\n", "9000000000\n2\n", "it ends after 6 of 18000000000 points"),
            ("3\n2\n", "-3\n2\n", "line 1 must be a number of columns or rows"),
            ("1 0 0 0\n0 1", "1 0 0 0\n1 0", "scan 0 has a matrix that moves no points"),
            ("9 9 9 1\n", "9 9 x 1\n", 'line 12 has "x" in column 3'),
            ("9 9 9 1\n", "9 9 9\n", "line 12 has 3 columns, not 4"),
            ("9 9 9 1\n", "\n", "lines 11 to 16 hold 5 rows"),
        ],
    )
    def test_bad_ptx(self, changed, to, message, tmp_path):
        head = "3\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
        text = head + "1 2 3 1\n9 9 9 1\n" + "1 2 3 1\n" * 4
        with pytest.raises(ValueError, match=message):
            read(tmp_path, "a.ptx", text.replace(changed, to, 1))
