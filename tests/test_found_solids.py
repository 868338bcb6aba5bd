"""What is found has a solid, whichever method found it."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import primfit
from primfit.geometry.motions import Motion

TILT = Rotation.from_rotvec([0.3, 0.2, 0.5])


def box_cloud(size, turn, center, n=6000):
    rng = np.random.default_rng(1)
    points = np.array(size) * rng.random((n, 3))
    face = np.arange(n) % 6
    points[np.arange(n), face // 2] = face % 2 * np.array(size)[face // 2]
    points += rng.normal(0.0, 0.001, points.shape)
    return turn.apply(points - np.array(size) / 2) + center


@pytest.fixture(scope="module", params=["likelihood", "paper", "planes"])
def found(request, small_scan):
    if request.param == "planes":
        cloud = box_cloud((0.6, 0.4, 0.2), TILT, (1.0, 2.0, 3.0))
        return primfit.detect(cloud, method="planes", rng=1)
    return primfit.detect(small_scan, method=request.param, rng=1)


def test_all_methods_find_one_class(found):
    assert found.solids
    for solid in found.solids:
        assert type(solid) is primfit.FoundSolid
        assert isinstance(solid.solid, primfit.Solid)
        np.testing.assert_array_equal(solid.vertices, solid.solid.vertices)
        assert len(solid.faces) == len(solid.observed)
        assert list(solid.sigmas)[: len(solid.parameters)] == list(solid.parameters)
        assert len(solid.parameters) == len(solid.covariance)
        assert solid.solid.contains(solid.solid.centroid[None])[0]


def test_the_pose_is_that_of_the_own_axes(found):
    for solid in found.solids:
        pose = solid.T_world_solid
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        np.testing.assert_array_equal(pose[:3, 3], solid.center)
        np.testing.assert_allclose(
            Rotation.from_quat(solid.quat_xyzw).as_matrix(), pose[:3, :3], atol=1e-12
        )
        if np.isfinite(solid.height):
            own = (solid.vertices - solid.center) @ pose[:3, :3]
            extents = np.sort(np.ptp(own, axis=0))
            np.testing.assert_allclose(extents, np.sort(solid.dimensions), rtol=0.03)


def test_laid_elsewhere_and_back(found):
    there = Motion(0.7, np.array([3.0, -2.0]))
    for solid in found.solids:
        moved = solid.laid(there, 0.5)
        np.testing.assert_allclose(moved.center[:2], there.of(solid.center[None, :2])[0])
        assert moved.kind == solid.kind
        assert moved.size == solid.size
        corner = moved.covariance[:2, :2]
        turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
        np.testing.assert_allclose(corner, turn @ solid.covariance[:2, :2] @ turn.T)
        np.testing.assert_allclose(
            moved.T_world_solid[2], [*solid.T_world_solid[2, :3], moved.center[2]]
        )
        back = moved.laid(Motion(-0.7, -Motion(-0.7, np.zeros(2)).of(there.move[None])[0]), -0.5)
        far = back.laid(Motion(0.0, np.zeros(2)))
        np.testing.assert_allclose(far.vertices[:, 2], solid.vertices[:, 2], atol=1e-12)
        there_again = far.moved(np.array([0.1, 0.2, 0.3]))
        np.testing.assert_allclose(
            there_again.vertices - far.vertices, [[0.1, 0.2, 0.3]] * len(far.vertices)
        )


def test_in_json_is_what_it_is_and_what_is_known(found):
    for row, solid in zip(json.loads(found.to_json())["solids"], found.solids, strict=True):
        assert row["type"] == solid.solid.type_name
        assert row["kind"] == solid.kind
        assert row["solid_kind"] == solid.solid_kind
        assert row["planes"] == list(solid.planes)
        names = solid.solid.to_dict()
        again = primfit.Solid.from_dict({name: names[name] for name in names})
        np.testing.assert_allclose(again.volume, solid.solid.volume)


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 0.1, 1.0])
def test_what_a_box_is_called_does_not_hang_on_its_tilt(tilt):
    turn = Rotation.from_rotvec([tilt, 0.5 * tilt, 0.4])
    found = primfit.detect(box_cloud((0.6, 0.4, 0.2), turn, (1.0, 2.0, 3.0)), rng=1)
    (solid,) = found.solids
    assert solid.solid_kind == "box"
    np.testing.assert_allclose(solid.dimensions, (0.6, 0.4, 0.2), atol=1e-3)
    assert repr(solid).startswith("FoundSolid(box, center=(")
    assert "1 solid: box" in repr(found)


def test_of_an_unknown_height_nothing_is_told():
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    solid = primfit.FoundSolid.upright(
        "square", np.array(square), 0.0, 0.4, 0.0, 1.0, 1e-6 * np.eye(4), (0, 1, 2, 3), (True,) * 6
    )
    assert np.isnan([solid.height, solid.center[2], solid.centroid[2], solid.dimensions[2]]).all()
    assert (solid.solid_kind, solid.top, solid.vertices[:, 2].max()) == ("box", 0.4, 0.4)
    assert solid.to_dict()["height"] is None


def test_the_old_name_still_works_and_says_so():
    with pytest.warns(DeprecationWarning, match=r"FoundPolyhedron is now primfit\.FoundSolid"):
        assert primfit.FoundPolyhedron is primfit.FoundSolid


def test_a_found_cylinder_is_compared_by_its_axis():
    world = primfit.World([primfit.Cylinder(0.1, 0.5, (0, 0, 1), axis=(1, 0, 1))])
    leaning = primfit.Cylinder(0.1, 0.5, (0, 0, 1), axis=(1, 0, 1.1))
    solid = primfit.FoundSolid(
        leaning, leaning.shape, ("radius",), np.array([[1e-6]]), (), (True,) * 3, (0,)
    )
    nothing = primfit.Scan.from_points(np.zeros((1, 3)))
    found = primfit.Detection(nothing, "planes", (), np.array([-1]), (solid,), None, None, 0.0, {})
    (row,) = primfit.evaluate(found, world, max_distance=1.0).rows
    assert row.found == "cylinder"
    assert row.angle_error_deg == pytest.approx(np.degrees(np.arctan(1.0) - np.arctan(1.0 / 1.1)))
