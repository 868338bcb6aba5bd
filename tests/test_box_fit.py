"""One box fitted to planes: exact ones, bent ones, and a recorded carton."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import primfit

SIZE = np.array([0.5, 0.3, 0.2])


def corner(faces, bend=0.0, sigma=0.0, n=1500):
    """Points on faces of a turned box, one of them bent, with a plane for each."""
    rng = np.random.default_rng(4)
    turn = Rotation.from_rotvec([0.4, -0.7, 0.3]).as_matrix()
    points = []
    for face in faces:
        some = SIZE * (rng.random((n, 3)) - 0.5)
        some[:, face // 2] = SIZE[face // 2] * (face % 2 - 0.5)
        if face == faces[0]:
            some = some @ Rotation.from_rotvec([0.0, bend, 0.0]).as_matrix().T
        points.append(some + sigma * rng.normal(size=some.shape))
    cloud = np.concatenate(points) @ turn.T + [5.0, 4.0, 3.0]
    planes = []
    for k in range(len(faces)):
        (plane,) = primfit.detect_planes(cloud[k * n : (k + 1) * n])
        planes.append(replace(plane, inliers=plane.inliers + k * n))
    return planes, cloud, turn


def symmetry_angle(box, turn):
    """Angle between the box's axes and the columns of a turn, in any order and direction."""
    own = Rotation.from_quat(box.quat_xyzw).as_matrix()
    return np.arccos(np.clip(np.abs(own.T @ turn).max(axis=1), 0.0, 1.0)).max()


@pytest.mark.parametrize("faces", [range(6), (1, 3, 5), (0, 2, 5, 4), (3, 4)])
def test_an_exact_box_is_found_exactly(faces):
    planes, cloud, turn = corner(faces)
    fit = primfit.fit_box(planes, cloud)
    assert sum(fit.observed) == len(faces)
    assert fit.rms < 1e-9
    assert np.abs(fit.tilts).max() < 1e-6
    assert symmetry_angle(fit.box, turn) < 1e-6
    # Where no opposite plane is, it ends with the points.
    np.testing.assert_allclose(fit.box.size, SIZE, atol=1e-9 if len(faces) == 6 else 0.01)
    np.testing.assert_allclose(fit.box.center, [5, 4, 3], atol=1e-9 if len(faces) == 6 else 0.01)


def test_noise_is_reported_and_averaged():
    planes, cloud, turn = corner(range(6), sigma=0.003)
    fit = primfit.fit_box(planes, cloud)
    assert fit.rms == pytest.approx(0.003, rel=0.05)
    assert symmetry_angle(fit.box, turn) < np.radians(0.1)
    np.testing.assert_allclose(fit.box.size, SIZE, atol=5e-4)


def test_a_bent_face_costs_what_is_reported():
    bend = np.radians(4.0)
    planes, cloud, _ = corner((0, 3, 5), bend)
    fit = primfit.fit_box(planes, cloud)
    off = np.abs(fit.angles - np.pi / 2)
    # Turned about the box's y axis, the face is off the one across z only.
    assert np.nanmax(off) == pytest.approx(bend, abs=1e-6)
    assert np.nanmin(off) == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < fit.tilts.max() < bend
    assert fit.rms == pytest.approx(np.sqrt((fit.face_rms**2).mean()))
    assert "off by up to 4.00 deg" in repr(fit)


def test_what_is_no_box():
    planes, cloud, _ = corner((0, 1, 2))
    for chosen, message in (
        (planes[:1], "2 to 6, the faces of a box, not 1"),
        (planes[:2], "all are parallel"),
        ([planes[0], planes[0], planes[2]], "two are the same"),
    ):
        with pytest.raises(ValueError, match=message):
            primfit.fit_box(chosen, cloud)


def test_a_recorded_carton(data):
    points = primfit.read_points(data / "boxes" / "caixa.ply")
    planes = primfit.detect_planes(points)
    fit = primfit.fit_box(planes.planes[:3], points)
    assert sum(fit.observed) == 3
    assert 0.005 < fit.rms < 0.02
    free = np.degrees(fit.angles[np.triu_indices(3, 1)])
    assert (free > 80).all()
    assert (free < 90).all()
