"""Planes of organised clouds: scans with layers and columns, depth images, clouds with a shape."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import primfit
from primfit import _primfit
from primfit.planes.organised import image_of
from primfit.scans.scan import Scan

FOCAL = 300.0


def room(layers=64, columns=512, noise=0.02, n_poses=1, rng=3):
    """A scan of a room with two boxes, and the plane of each beam."""
    boxes = [
        primfit.Prism.rectangle(1.6, 0.8, center=(2.0, 5.0), angle=0.3, height=1.0),
        primfit.Prism.rectangle(1.2, 1.0, center=(6.0, 2.0), angle=1.2, height=2.6),
    ]
    arena = primfit.Arena(size=(8.0, 7.0), height=2.8)
    world = primfit.World(solids=boxes, arena=arena)
    sensor = {
        "number_of_layers": layers,
        "vertical_field_of_view": 0.8,
        "horizontal_resolution": columns,
        "field_of_view": 2 * np.pi,
        "min_range": 0.3,
        "max_range": 50.0,
        "mount": (0.0, 0.0, 1.3),
    }
    path = [(4.2, 4.0, 0.4)] * n_poses
    scan = primfit.scan(world, path, primfit.Lidar(noise=noise / 50.0, **sensor), rng=rng)
    exact = primfit.scan(world, path, primfit.Lidar(**sensor), rng=rng).points
    faces = [(-2, (1, 0, 0, 0)), (-2, (1, 0, 0, -8)), (-2, (0, 1, 0, 0)), (-2, (0, 1, 0, -7))]
    faces.append((-3, (0, 0, 1, 0)))
    for i, box in enumerate(boxes):
        faces.append((i, (0, 0, 1, -box.height)))
        for a, b in zip(box.footprint, np.roll(box.footprint, -1, axis=0), strict=True):
            across = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            faces.append((i, (*across, 0, -across @ a)))
    truth = np.full(len(scan), -1)
    for k, (owner, equation) in enumerate(faces):
        off = np.abs(exact @ np.array(equation[:3], dtype=float) + equation[3])
        truth[(scan.solid_index == owner) & (off < 1e-6)] = k
    return scan, truth


def depth_image(depth_of, height=120, width=160):
    """Points (h, w, 3) of a depth image whose depth is a function of the rays' slopes."""
    x = (np.arange(width) - width / 2) / FOCAL
    y = (np.arange(height) - height / 2) / FOCAL
    depth = depth_of(*np.meshgrid(x, y))
    return primfit.points_of_depth(depth, FOCAL, FOCAL, width / 2, height / 2)


def corner(x, y, step=0.0, noise=0.0, rng=1):
    """Two walls that meet in a right angle before the camera, at 45 degrees to it, and a floor."""
    depth = np.minimum(3.0 / (1.0 + np.abs(x)), 0.4 / np.maximum(y, 1e-9))
    depth = depth + noise * np.random.default_rng(rng).normal(size=depth.shape)
    return np.round(depth / step) * step if step else depth


def agreement(labels, others):
    """Share of points alike when each label is taken for the one that it meets most."""
    pairs, counts = np.unique(np.stack([labels, others]), axis=1, return_counts=True)
    most = [counts[pairs[0] == label].max() for label in np.unique(labels)]
    least = [counts[pairs[1] == label].max() for label in np.unique(others)]
    return min(sum(most), sum(least)) / len(labels)


FLOOR = 4
"""Of a room: the boxes cut it in parts that do not touch in the image."""


def faces_of(truth, least):
    return [k for k in np.unique(truth[truth >= 0]) if (truth == k).sum() >= least and k != FLOOR]


def best_iou(labels, truth, k):
    own = truth == k
    return max(
        ((labels == j) & own).sum() / ((labels == j) | own).sum()
        for j in np.unique(labels[own])
        if j >= 0
    )


@pytest.fixture(scope="module")
def scanned():
    return room()


def test_faces_of_a_room_are_planes(scanned):
    scan, truth = scanned
    planes = primfit.detect_planes(scan)
    large = faces_of(truth, 300)
    assert len(large) == 8
    assert all(best_iou(planes.labels, truth, k) > 0.8 for k in large)
    assert len(planes) <= len(large) + 4
    assert planes.sigma == pytest.approx(0.02, rel=0.3)
    assert planes.settings["stride"] == 1


def test_a_wall_across_the_first_and_last_column_is_one(scanned):
    scan, truth = scanned
    labels = primfit.detect_planes(scan).labels
    first, last = scan.column == scan.column.min(), scan.column == scan.column.max()
    walls = set(truth[first & (truth < FLOOR)]) & set(truth[last & (truth < FLOOR)]) - {-1}
    assert walls
    for wall in walls:
        left = labels[first & (truth == wall)]
        right = labels[last & (truth == wall)]
        assert np.bincount(left + 1).argmax() == np.bincount(right + 1).argmax() > 0


def test_the_order_of_rows_does_not_matter(scanned):
    scan, _ = scanned
    mix = np.random.default_rng(5).permutation(len(scan))
    labels = primfit.detect_planes(scan).labels
    assert (primfit.detect_planes(scan.select(mix)).labels == labels[mix]).all()


@pytest.mark.parametrize("n_jobs", [2, 8])
def test_threads_do_not_matter(scanned, n_jobs):
    scan, _ = scanned
    one, many = (primfit.detect_planes(scan, n_jobs=n) for n in (1, n_jobs))
    assert (one.labels == many.labels).all()
    assert (one.equations == many.equations).all()


def test_a_rigid_motion_changes_nothing(scanned):
    scan, _ = scanned
    image = scan.points.reshape(64, 512, 3)
    turn = Rotation.from_euler("zyx", (1.0, 0.4, -0.3))
    moved = turn.apply(scan.points).reshape(image.shape) + np.array([5.0, -3.0, 2.0])
    labels = [primfit.detect_planes(points).labels for points in (image, moved)]
    assert agreement(*labels) > 0.999


def test_reversed_rows_give_the_same_planes(scanned):
    scan, _ = scanned
    image = scan.points.reshape(64, 512, 3)
    labels = primfit.detect_planes(image).labels.reshape(64, 512)
    flipped = primfit.detect_planes(image[::-1]).labels.reshape(64, 512)[::-1]
    assert agreement(labels.ravel(), flipped.ravel()) > 0.97


def test_rows_that_zigzag_are_put_in_line(scanned):
    scan, truth = scanned
    offsets = np.array([9, 3, -3, -9])[np.arange(64) % 4]
    image, true = scan.points.reshape(64, 512, 3), truth.reshape(64, 512)
    image, true = (
        np.stack([np.roll(row, offset, axis=0) for row, offset in zip(array, offsets, strict=True)])
        for array in (image, true)
    )
    labels = primfit.detect_planes(image).labels
    large = faces_of(truth, 1000)
    assert all(best_iou(labels, true.ravel(), k) > 0.8 for k in large)


def test_half_of_the_returns_give_the_same_faces(scanned):
    scan, truth = scanned
    image = scan.points.copy()
    image[1::2] = 0.0
    labels = primfit.detect_planes(image.reshape(64, 512, 3)).labels
    assert (labels[1::2] == -1).all()
    large = faces_of(truth, 1000)
    assert all(best_iou(labels[::2], truth[::2], k) > 0.7 for k in large)


def test_clouds_with_a_shape_and_images_are_the_same():
    points = depth_image(lambda x, y: corner(x, y, noise=0.003))
    cloud = primfit.Cloud(points.reshape(-1, 3), shape=points.shape[:2])
    found = [primfit.detect_planes(each) for each in (points, cloud, Scan.from_points(cloud))]
    assert len(found[0]) == 3
    for other in found[1:]:
        assert (other.labels == found[0].labels).all()
        assert (other.equations == found[0].equations).all()


def test_what_is_no_point_has_no_label():
    points = depth_image(lambda x, y: corner(x, y, noise=0.003))
    points[20:40, 30:50] = 0.0
    points[60:70, 100:120] = np.nan
    labels = primfit.detect_planes(points).labels.reshape(points.shape[:2])
    assert (labels[20:40, 30:50] == -1).all()
    assert (labels[60:70, 100:120] == -1).all()
    assert len(np.unique(labels[labels >= 0])) == 3


@pytest.mark.parametrize("step", [0.002, 0.005, 0.015])
def test_steps_of_depth_are_no_planes(step):
    planes = primfit.detect_planes(depth_image(lambda x, y: corner(x, y, step=step)))
    # On the floor, which is seen under 8 to 15 degrees, each row of pixels is a step or more.
    assert 3 <= len(planes) <= 4
    assert (planes.labels >= 0).mean() > 0.85
    left, right = planes.labels.reshape(120, 160)[:50].reshape(50, 2, 80).transpose(1, 0, 2)
    for wall in (left, right):
        assert np.bincount(wall.ravel() + 1).max() > 0.9 * wall.size


def test_noise_that_grows_with_the_depth():
    def depth(x, y):
        z = corner(x, y)
        noise = np.random.default_rng(2).normal(size=z.shape)
        return z + 0.002 * z**2 * noise

    planes = primfit.detect_planes(depth_image(depth))
    assert len(planes) == 3
    assert (planes.labels >= 0).mean() > 0.95


def test_noise_may_be_told():
    points = depth_image(lambda x, y: corner(x, y, noise=0.003))
    sigma = np.full(points.shape[0] * points.shape[1], 0.003)
    for told in (0.003, sigma):
        planes = primfit.detect_planes(points, sigma=told)
        assert len(planes) == 3
        assert planes.sigma == 0.003


@pytest.mark.parametrize("noise", [0.0005, 0.005, 0.02])
@pytest.mark.parametrize("is_sphere", [True, False])
def test_curved_surfaces_have_no_planes(noise, is_sphere):
    def depth(x, y):
        # A ball, or an upright cylinder, of radius 1 m at 3 m.
        a = 1.0 + x**2 + is_sphere * y**2
        root = 9.0 - 8.0 * a
        z = (3.0 - np.sqrt(np.maximum(root, 0.0))) / a
        z = z + noise * np.random.default_rng(4).normal(size=z.shape)
        return np.where(root > 0.0, z, 0.0)

    planes = primfit.detect_planes(depth_image(depth))
    assert (planes.labels >= 0).mean() < 0.02


def test_scattered_returns_are_no_planes():
    rng = np.random.default_rng(6)
    for _ in range(10):
        ranges = rng.uniform(1.0, 8.0, (64, 256))
        points = depth_image(lambda x, y, z=ranges: z, 64, 256)
        assert len(primfit.detect_planes(points)) == 0


def test_which_scans_are_images(scanned):
    scan, _ = scanned
    image = image_of(scan)
    assert image is not None
    assert image.shape == (64, 512)
    assert (scan.layer[image] == np.arange(64)[:, None]).all()
    assert image_of(room(16, 160, n_poses=2)[0]) is None
    assert image_of(Scan.from_points(scan.points)) is None
    twice = np.concatenate([np.arange(len(scan)), [0]])
    assert image_of(scan.select(twice)) is None
    some = np.sort(np.random.default_rng(1).permutation(len(scan))[: len(scan) // 2])
    part = image_of(scan.select(some))
    assert part is not None
    assert (part[part >= 0] == np.arange(len(some))).all()


def test_layers_and_columns_of_clouds_with_a_shape():
    points = depth_image(lambda x, y: corner(x, y), 10, 12)
    scan = Scan.from_points(points)
    assert (scan.layer.reshape(10, 12) == np.arange(10)[:, None]).all()
    assert (scan.column.reshape(10, 12) == np.arange(12)).all()
    assert Scan.from_points(points.reshape(-1, 3)).layer is None


def test_pixels_must_be_rows():
    with pytest.raises(ValueError, match="10 points are no rows of 3 pixels"):
        _primfit.segment_image(np.zeros((10, 3)), 3)
    with pytest.raises(ValueError, match="sigma must have as many rows as points"):
        _primfit.segment_image(np.zeros((10, 3)), 5, np.zeros(9))
    labels, sigma = _primfit.segment_image(np.full((12, 3), np.nan), 4)
    assert (labels == -1).all()
    assert (sigma >= 0.0).all()


def test_rows_that_were_only_folded_are_no_image():
    """A cloud in any order, or face after face, that somebody gave the shape of an image."""
    rng = np.random.default_rng(5)
    cloud = rng.random((4800, 3))
    face = np.sort(rng.integers(6, size=4800))
    cloud[np.arange(4800), face // 2] = face % 2
    for points in (cloud, rng.permutation(cloud), cloud[np.argsort(cloud[:, 0])]):
        folded = primfit.detect_planes(points.reshape(60, 80, 3))
        np.testing.assert_array_equal(folded.labels, primfit.detect_planes(points).labels)
        assert len(folded) == 6
