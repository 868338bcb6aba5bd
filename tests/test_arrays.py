"""What is handed out: arrays that others take, results that are copied; rows without a point."""

from __future__ import annotations

import copy
import pickle
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import primfit


def arrays_in(result, seen=()):
    """Name and array of all that a result holds or derives."""
    names = {name for name in dir(result) if not name.startswith("_")}
    for name in sorted(
        names - {"T", "scan", "planes", "solids", "world", "arena", "floor", "report"}
    ):
        value = getattr(result, name)
        if isinstance(value, np.ndarray):
            yield name, value


def equal(one, other):
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif is_dataclass(one):
        assert type(one) is type(other)
        for each in fields(one):
            equal(getattr(one, each.name), getattr(other, each.name))
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            equal(a, b)
    elif hasattr(one, "keys"):
        assert list(one) == list(other)
        for key in one:
            equal(one[key], other[key])
    else:
        assert one == other or (one != one and other != other) or repr(one) == repr(other)


@pytest.fixture(scope="module")
def box():
    rng, size = np.random.default_rng(1), np.array([3.0, 2.0, 1.0])
    face = np.arange(6000) % 6
    points = size * rng.random((6000, 3))
    points[np.arange(6000), face // 2] = face % 2 * size[face // 2]
    return points


@pytest.fixture(scope="module")
def results(world, scan, found, small_world, small_scan, box):
    planes = primfit.detect_planes(box)
    cloud = primfit.Cloud(box[:6], {"label": np.arange(6), "normal": np.eye(6, 3)}, (2, 3))
    return {
        "cloud": cloud,
        "world": world,
        "lidar": primfit.Lidar(),
        "scan": scan,
        "scan of points": primfit.Scan.from_points(box, (9, 9, 9)),
        "planes": planes,
        "plane": planes[0],
        "polyhedra": primfit.find_polyhedra(planes, box),
        "box": primfit.fit_box(planes[:3] if isinstance(planes, tuple) else list(planes)[:3], box),
        "paper": found,
        "likelihood": primfit.detect(small_scan, rng=1),
        "detection by planes": primfit.detect(box),
        "report": primfit.evaluate(found, world),
        "segmentation": primfit.evaluate_segmentation(planes.labels, planes.labels),
        "settings": primfit.PaperSettings(),
    }


NAMES = ["cloud", "world", "lidar", "scan", "scan of points", "planes", "plane", "polyhedra", "box"]
NAMES += ["paper", "likelihood", "detection by planes", "report", "segmentation", "settings"]


@pytest.mark.parametrize("name", NAMES)
def test_results_are_pickled_and_copied(name, results):
    result = results[name]
    for again in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        equal(result, again)
        assert repr(again) == repr(result)


@pytest.mark.parametrize("mesh", [True, False])
def test_casters_are_pickled_and_copied(mesh, world):
    if mesh:
        rng = np.random.default_rng(0)
        caster = primfit.RayCaster((rng.random((3000, 3)), rng.integers(0, 3000, (5000, 3))))
    else:
        caster = primfit.RayCaster(world)
    rng = np.random.default_rng(1)
    rays = rng.uniform(0, 2, (500, 3)), rng.normal(size=(500, 3))
    for again in (pickle.loads(pickle.dumps(caster)), copy.deepcopy(caster)):
        for one, other in zip(caster.cast(*rays), again.cast(*rays), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "name",
    ["cloud", "scan", "planes", "plane", "polyhedra", "box", "paper", "likelihood", "segmentation"],
)
def test_arrays_may_be_written_to(name, results):
    """As Open3D and PyTorch ask."""
    found = dict(arrays_in(results[name]))
    assert found
    for each, array in found.items():
        assert array.flags.writeable, each


def test_arrays_of_parts_may_be_written_to(results, world):
    for name in ("paper", "likelihood", "detection by planes"):
        found = results[name]
        for part in (*found.planes, *found.solids):
            for each, array in arrays_in(part):
                assert array.flags.writeable, each


def test_arrays_of_worlds_and_sensors_may_be_written_to(world):
    box = primfit.Polyhedron.box(1, 1, 1)
    for part in (world.solids[0], world.arena, box, primfit.Lidar()):
        for each, array in arrays_in(part):
            assert array.flags.writeable, each
    for solid in (world.solids[0], box):
        assert solid.vertices.flags.writeable
        assert all(array.flags.writeable for array in solid.to_mesh())
    assert primfit.Lidar().directions.flags.writeable
    for hand_out in (lambda: world.to_mesh()[0], lambda: world.mask, lambda: world.matrix):
        array = hand_out()
        array[:] = 0
        assert hand_out().any()


def test_fields_of_clouds_may_be_written_to(results):
    cloud = results["cloud"]
    assert all(values.flags.writeable for values in cloud.fields.values())


def test_what_was_given_is_not_changed(box):
    points, label = box.copy(), np.arange(len(box))
    cloud, scan = primfit.Cloud(points, {"label": label}), primfit.Scan.from_points(points)
    rays = primfit.Scan.from_rays(points, points + 1, np.ones(len(points)), np.ones(len(points)))
    for array in (
        cloud.points,
        cloud.fields["label"],
        scan.points,
        rays.origins,
        rays.ranges,
        rays.sigma,
    ):
        array[:] = 7
    np.testing.assert_array_equal(points, box)
    np.testing.assert_array_equal(label, np.arange(len(box)))


@pytest.fixture(scope="module")
def image(box):
    """Points of an organised cloud, and which rows shall have one."""
    return box + np.array([0.0, 0.0, 5.0]), np.arange(len(box)) % 10 != 3


class TestRowsWithoutAPoint:
    @pytest.mark.parametrize("blank", [[np.nan] * 3, [np.inf, 0, 0], [0, 0, 0]])
    @pytest.mark.parametrize("origins", [None, (1.5, 1.0, -9.0)])
    @pytest.mark.parametrize("method", ["planes", "paper", "likelihood", None])
    def test_get_no_label_in_any_detection(self, image, blank, origins, method):
        points, is_point = image
        if method == "likelihood" and origins is None:
            pytest.skip("it asks where the beams began")
        whole = primfit.Cloud(np.where(is_point[:, None], points, blank), shape=(60, 100))
        if method is None:
            found = primfit.detect_planes(whole, origins)
            alone = primfit.detect_planes(points[is_point], origins)
        else:
            scans = (primfit.Scan.from_points(each, origins) for each in (whole, points[is_point]))
            found, alone = (primfit.detect(scan, method, rng=1) for scan in scans)
            assert len(found.solids) == len(alone.solids)
        assert (found.labels[~is_point] == -1).all()
        np.testing.assert_array_equal(found.labels[is_point], alone.labels)
        for one, other in zip(found.planes, alone.planes, strict=True):
            np.testing.assert_array_equal(one.inliers, np.flatnonzero(is_point)[other.inliers])
            np.testing.assert_array_equal(one.equation, other.equation)

    def test_zero_is_a_point_of_a_bare_cloud(self):
        grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(
            -1, 3
        )
        assert primfit.detect_planes(grid).labels.tolist() == [0] * 400
        assert primfit.Scan.from_points(grid).is_return.all()
        scan = primfit.Scan.from_points(grid, (1, 1, 9))
        assert np.flatnonzero(scan.is_blank).tolist() == [0]
        each = primfit.Scan.from_points(grid, np.full((400, 3), 9.0))
        assert each.is_return.all()

    def test_beams_that_did_not_return_are_not_blank(self):
        scan = primfit.Scan.from_rays((0, 0, 0), np.eye(3), [1, np.inf, 2])
        assert not scan.is_blank.any()
        assert scan.is_return.tolist() == [True, False, True]


class TestPlanesOfOtherClouds:
    @pytest.mark.parametrize("call", [primfit.find_polyhedra, primfit.fit_box])
    def test_are_named(self, call, box):
        planes = list(primfit.detect_planes(box))
        with pytest.raises(
            ValueError, match=r"planes\[0\] must be of points, but has row \d+ of 50"
        ):
            call(planes, box[:50])
        with pytest.raises(TypeError, match=r"planes\[1\] must be a Plane, not NoneType"):
            call([planes[0], None], box)
        with pytest.raises(TypeError, match="planes must be an iterable of Plane, not int"):
            call(3, box)
