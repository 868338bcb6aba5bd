"""Coordinates that are very large, or one that is: right, or refused with its row."""

from __future__ import annotations

import numpy as np
import pytest

import primfit


def cuboid(size, per_square_metre, sigma, rng):
    """Points on the six faces of a box."""
    size, faces = np.array(size, float), []
    for k in range(6):
        axis, is_upper = divmod(k, 2)
        sides = np.delete(size, axis)
        points = rng.random((int(per_square_metre * sides.prod()), 3)) * size
        points[:, axis] = is_upper * size[axis] + rng.normal(0, sigma, len(points))
        faces.append(points)
    return np.concatenate(faces)


BOX = cuboid((3, 2, 1), 300, 0.003, np.random.default_rng(5))
PLACE = np.array([536384.39, 6582454.01, 55.21])


@pytest.fixture(scope="module", params=[np.zeros(3), PLACE], ids=["near", "national grid"])
def alone(request):
    return request.param, primfit.detect_planes(BOX + request.param)


@pytest.mark.parametrize("far", [1e9, 1e12, 1e17, 1e19, 1e30, float(np.finfo(np.float32).max)])
def test_one_point_far_away_changes_nothing_else(alone, far):
    place, before = alone
    after = primfit.detect_planes(np.concatenate([BOX + place, [[far, -far / 3, 0]]]))
    np.testing.assert_array_equal(after.labels, np.append(before.labels, -1))
    assert after.sigma == pytest.approx(before.sigma, rel=1e-6)
    np.testing.assert_allclose(after.equations, before.equations, rtol=1e-6, atol=1e-6)
    assert len(primfit.detect(np.concatenate([BOX, [[far, 0, 0]]])).solids) == 1


@pytest.mark.parametrize("large", [1e51, 1e100, 1e200, 1e307])
@pytest.mark.parametrize(
    "call",
    [
        primfit.detect_planes,
        primfit.detect,
        lambda points: primfit.detect(points, method="paper"),
        lambda points: primfit.estimate_normals(points, 8),
        lambda points: primfit.dbscan(points, large_eps),
        primfit.Scan.from_points,
        lambda points: primfit.Scan.from_points(np.ones((len(points), 3)), points),
    ],
)
def test_coordinates_that_float64_cannot_compute_with_name_their_row(large, call):
    points = np.random.default_rng(0).normal(size=(40, 3))
    points[7, 1] = large
    with pytest.raises(ValueError, match=r"(points|origins) must be within 1e\+50 m, but row 7 is"):
        call(points)


large_eps = 1e300


def test_meshes_and_ranges_too():
    triangle = np.eye(3) * 1e160
    with pytest.raises(ValueError, match=r"vertices must be within 1e\+50 m, but row 0 is"):
        primfit.RayCaster((triangle, [[0, 1, 2]]))
    with pytest.raises(ValueError, match=r"ranges must be within 1e\+50 m, .* row 1 is 1e\+60"):
        primfit.Scan.from_rays((0, 0, 0), np.eye(3), [1, 1e60, np.inf])


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6, 1e12])
def test_scale_changes_nothing(scale):
    planes = primfit.detect_planes(BOX * scale)
    assert len(planes) == 6
    assert planes.sigma == pytest.approx(0.003 * scale, rel=0.2)


def test_the_range_at_a_surface_is_no_negative_zero():
    mesh = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for direction in ([0, 0, 1], [0, 0, -1]):
        ranges, _ = primfit.RayCaster(mesh).cast([[0.2, 0.2, 0.0]], [direction])
        assert ranges[0] == 0.0
        assert not np.signbit(ranges[0])


@pytest.mark.parametrize("value", [2**64, 2**63, 2**200])
def test_whole_numbers_have_an_end(value):
    for name, call in (
        ("k", lambda: primfit.estimate_normals(BOX, value)),
        ("min_samples", lambda: primfit.dbscan(BOX, 0.1, value)),
        ("min_points", lambda: primfit.detect_planes(BOX, min_points=value)),
    ):
        with pytest.raises(ValueError, match=rf"{name} must be at most 2\*\*62, not {value}"):
            call()
