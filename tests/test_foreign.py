"""Points of every kind that users have give the same as the bare array."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import primfit

H, W = 20, 30


@pytest.fixture(scope="module")
def points():
    """Three faces of a box, noisy, in float64."""
    rng = np.random.default_rng(5)
    rows = rng.uniform(0.0, 0.5, (H * W, 3))
    rows[np.arange(H * W), np.arange(H * W) % 3] = 0.0
    return rows + rng.normal(0.0, 0.001, rows.shape)


def structured(points):
    table = np.zeros(len(points), [("i", "u2"), ("y", "f8"), ("x", "f8"), ("z", "f8"), ("s", "U3")])
    table["x"], table["y"], table["z"] = points.T
    return table


def pandas_frame(points):
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame(points, columns=["X", "Y", "Z"])
    return frame.assign(name="a", intensity=np.arange(len(points)))


def polars_frame(points):
    pl = pytest.importorskip("polars")
    columns = dict(zip("xyz", points.T, strict=True))
    return pl.DataFrame(
        {"intensity": np.arange(len(points)), **columns, "name": ["a"] * len(points)}
    )


def open3d():
    # It also needs libraries of the system.
    return pytest.importorskip("open3d", exc_type=ImportError)


def open3d_cloud(points):
    o3d = open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.paint_uniform_color([1.0, 0.5, 0.0])
    return cloud


def open3d_tensor(points):
    return open3d().core.Tensor(points)


def open3d_tensor_cloud(points):
    o3d = open3d()
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    cloud.point.intensity = o3d.core.Tensor(np.arange(len(points))[:, None])
    return cloud


def trimesh_cloud(points):
    return pytest.importorskip("trimesh").PointCloud(points, colors=np.full((len(points), 4), 9))


def torch_tensor(points):
    return pytest.importorskip("torch").tensor(points, requires_grad=True)


class FarTensor:
    """A tensor as PyTorch has one: with a gradient and on another device, which NumPy refuses."""

    def __init__(self, values, steps=("detach", "cpu")):
        self.values, self.steps = values, steps
        self.shape, self.dtype = values.shape, "torch.float64"

    def detach(self):
        return FarTensor(self.values, [step for step in self.steps if step != "detach"])

    def cpu(self):
        return FarTensor(self.values, [step for step in self.steps if step != "cpu"])

    def numpy(self):
        if self.steps:
            raise RuntimeError(f"call {self.steps} first")
        return self.values

    __array__ = numpy


def message(points, *, order="<", rows=1, padding=4):
    """A PointCloud2 with padding between points and after rows, and fields of many types."""
    names = ["x", "y", "z", "ring", "intensity", "rgb"]
    kind = np.dtype(
        {
            "names": names,
            "formats": [order + each for each in ("f8", "f8", "f8", "u2", "f4", "f4")],
            "offsets": [0, 8, 16, 28, 32, 36],
            "itemsize": 40 + padding,
        }
    )
    table = np.zeros(len(points), kind)
    table["x"], table["y"], table["z"] = points.T
    table["ring"] = np.arange(len(points)) % 16
    table["intensity"] = 0.25
    table["rgb"] = np.array([0x00FF8001], "u4").view("f4")
    width = len(points) // rows
    after = b"\xff" * 12
    content = b"".join(part.tobytes() + after for part in table.reshape(rows, width))
    numbers = {"f8": 8, "f4": 7, "u2": 4}
    fields = [
        SimpleNamespace(
            name=name,
            offset=kind.fields[name][1],
            datatype=numbers[kind[name].str[1:]],
            count=1,
        )
        for name in names
    ]
    return SimpleNamespace(
        height=rows,
        width=width,
        fields=fields,
        is_bigendian=order == ">",
        point_step=kind.itemsize,
        row_step=width * kind.itemsize + len(after),
        data=np.frombuffer(content, np.uint8),
        is_dense=True,
    )


def file_of(suffix):
    def of(points, folder):
        primfit.write_points(folder / f"points{suffix}", points)
        return folder / f"points{suffix}"

    return of


KINDS = {
    "Cloud": primfit.Cloud,
    "Scan": primfit.Scan.from_points,
    "list": lambda points: points.tolist(),
    "float64 in Fortran order": np.asfortranarray,
    "big endian": lambda points: points.astype(">f8"),
    "(n, 5)": lambda points: np.column_stack([points, points[:, :2]]),
    "(h, w, 3)": lambda points: points.reshape(H, W, 3),
    "(h, w, 4)": lambda points: np.insert(points, 3, 1.0, axis=1).reshape(H, W, 4),
    "masked": lambda points: np.ma.masked_array(points),
    "structured": structured,
    "structured (h, w)": lambda points: structured(points).reshape(H, W),
    "mapping": lambda points: dict(zip("xyz", points.T, strict=True)),
    "pandas": pandas_frame,
    "pandas without names": lambda points: pytest.importorskip("pandas").DataFrame(points),
    "polars": polars_frame,
    "open3d legacy": open3d_cloud,
    "open3d points": lambda points: open3d_cloud(points).points,
    "open3d tensor": open3d_tensor,
    "open3d tensor cloud": open3d_tensor_cloud,
    "trimesh": trimesh_cloud,
    "trimesh vertices": lambda points: trimesh_cloud(points).vertices,
    "torch": torch_tensor,
    "tensor elsewhere": FarTensor,
    "PointCloud2": message,
    "PointCloud2, big endian": lambda points: message(points, order=">"),
    "PointCloud2, organised": lambda points: message(points, rows=H),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_gives_the_same_bits(kind, points):
    given = KINDS[kind](points)
    cloud = primfit.as_cloud(given)
    assert cloud.points.dtype == np.float64
    np.testing.assert_array_equal(cloud.points, points)
    planes = primfit.detect_planes(points)
    assert len(planes) == 3
    again = primfit.detect_planes(given)
    np.testing.assert_array_equal(again.labels, planes.labels)
    assert again.equations.tobytes() == planes.equations.tobytes()


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".ply", ".pcd"])
def test_paths_give_the_same_bits(suffix, points, tmp_path):
    path = file_of(suffix)(points, tmp_path)
    planes = primfit.detect_planes(points)
    for given in (path, str(path)):
        again = primfit.detect_planes(given)
        np.testing.assert_array_equal(again.labels, planes.labels)


def test_laspy_gives_the_same_bits_as_its_own_numbers(points, tmp_path):
    laspy = pytest.importorskip("laspy")
    fields = {"intensity": np.arange(len(points), dtype=np.uint16), "nearby": points[:, 0]}
    primfit.write_cloud(tmp_path / "points.las", primfit.Cloud(points, fields))
    las = laspy.read(tmp_path / "points.las")
    cloud, read = primfit.as_cloud(las), primfit.read_cloud(tmp_path / "points.las")
    assert list(cloud.fields) == list(read.fields)
    np.testing.assert_array_equal(cloud.points, read.points)
    planes = primfit.detect_planes(np.array(las.xyz))
    np.testing.assert_array_equal(primfit.detect_planes(las).labels, planes.labels)
    np.testing.assert_array_equal(primfit.detect_planes(las.xyz).labels, planes.labels)


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.float16, bool])
def test_other_numbers_are_as_float64(dtype, points):
    own = (100 * points).astype(dtype)
    np.testing.assert_array_equal(primfit.as_cloud(own).points, own.astype(np.float64))


def test_every_function_takes_them(points, tmp_path):
    frame = polars_frame(points) if "polars" in sys.modules else structured(points)
    planes = primfit.detect_planes(points)
    same = np.testing.assert_array_equal
    same(primfit.dbscan(frame, 0.05), primfit.dbscan(points, 0.05))
    same(primfit.estimate_normals(frame), primfit.estimate_normals(points))
    same(primfit.Scan.from_points(frame).points, points)
    same(primfit.detect(frame, rng=7).labels, primfit.detect(points, rng=7).labels)
    assert primfit.choose_method(frame) == primfit.choose_method(points)
    same(primfit.fit_box(planes, frame).box.vertices, primfit.fit_box(planes, points).box.vertices)
    assert len(primfit.find_polyhedra(planes, frame).solids) == len(
        primfit.find_polyhedra(planes, points).solids
    )
    box = primfit.Polyhedron.box(0.4, 0.3, 0.2)
    same(box.contains(frame), box.contains(points))
    prism = primfit.Prism.rectangle(0.4, 0.3)
    same(prism.contains(frame), prism.contains(points))
    primfit.write_points(tmp_path / "a.npy", frame)
    same(primfit.read_points(tmp_path / "a.npy"), points)
    primfit.write_cloud(tmp_path / "b.npy", frame)
    assert "i" in primfit.read_cloud(tmp_path / "b.npy").fields or frame is not structured


def test_scans_are_read_of_their_files(small_scan, tmp_path):
    small_scan.save(tmp_path / "scan.npz")
    assert primfit.choose_method(tmp_path / "scan.npz") == primfit.choose_method(small_scan)
    with pytest.raises(ValueError, match="origins must be None for a Scan"):
        primfit.detect_planes(tmp_path / "scan.npz", (0, 0, 0))


class TestFields:
    def test_columns_beyond_are_fields(self, points):
        cloud = primfit.as_cloud(np.column_stack([points, points[:, :2]]))
        np.testing.assert_array_equal(cloud.fields["column_5"], points[:, 1])

    def test_of_frames(self, points):
        cloud = primfit.as_cloud(pandas_frame(points))
        assert list(cloud.fields) == ["intensity"]

    def test_missing_numbers_are_no_points(self):
        pd = pytest.importorskip("pandas")
        frame = pd.DataFrame({"x": [0, None, 1], "y": [1, 1, 2], "z": [0, 0, 0]}).convert_dtypes()
        np.testing.assert_array_equal(
            primfit.as_cloud(frame).points, [[0, 1, 0], [np.nan, 1, 0], [1, 2, 0]]
        )
        masked = np.ma.masked_array(np.ones((2, 3)), [[0, 0, 0], [1, 1, 1]])
        assert np.isnan(primfit.as_cloud(masked).points[1]).all()

    def test_of_open3d(self, points):
        cloud = open3d_cloud(points)
        cloud.estimate_normals()
        fields = primfit.as_cloud(cloud).fields
        assert fields["color"][0].tolist() == [255, 128, 0]
        np.testing.assert_array_equal(fields["normal"], np.asarray(cloud.normals))
        assert list(primfit.as_cloud(open3d_tensor_cloud(points)).fields) == ["intensity"]
        o3d = open3d()
        o3d.utility.Vector3dVector(primfit.as_cloud(cloud).points)

    def test_of_messages(self, points):
        cloud = primfit.as_cloud(message(points, rows=H))
        assert cloud.shape == (H, W)
        assert cloud.fields["ring"].tolist()[:17] == [*range(16), 0]
        assert cloud.fields["color"][3].tolist() == [255, 128, 1]

    def test_are_copies(self, points):
        cloud = primfit.as_cloud(points)
        cloud.points[:] = 0.0
        assert points.any()


@pytest.mark.parametrize(
    ("given", "kind", "told"),
    [
        (3, TypeError, "not int"),
        (None, TypeError, "not NoneType"),
        (np.zeros((4, 2)), ValueError, r"numpy.ndarray of shape \(4, 2\) of float64 is none"),
        (np.zeros((3, 500)), ValueError, "as if x, y and z were its rows"),
        (np.array([["a", "b", "c"]]), TypeError, "its array holds <U1, not numbers"),
        ({"x": [1.0], "y": [2.0]}, ValueError, "it has no z, only x, y"),
        (primfit.World(), TypeError, "not primfit.World"),
        (SimpleNamespace(vertices=np.zeros((3, 3)), faces=[[0, 1, 2]]), TypeError, "a mesh has"),
    ],
)
def test_what_has_no_points_is_refused(given, kind, told):
    with pytest.raises(kind, match=rf"points must be an array \(n, 3 or more\).*{told}"):
        primfit.detect_planes(given)


def test_short_messages_are_refused(points):
    short = message(points)
    short.data = short.data[:-60]
    with pytest.raises(ValueError, match="too few for 1 rows of 600 points"):
        primfit.as_cloud(short)
    outside = message(points)
    outside.fields[0].offset = 41
    with pytest.raises(ValueError, match="field 'x' is outside a point of 44 bytes"):
        primfit.as_cloud(outside)


def test_nothing_is_imported_for_it():
    code = """
import sys, primfit, numpy as np
primfit.detect_planes
before = set(sys.modules)
primfit.as_cloud(np.zeros((3, 3))), primfit.as_cloud({"x": [1], "y": [1], "z": [1]})
print({"pandas", "polars", "torch", "open3d", "trimesh", "laspy", "rosbags"} & set(sys.modules))
"""
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "set()"
