"""Clouds that are pixels of a camera in the origin, and others; boxes among them."""

from __future__ import annotations

import numpy as np
import pytest
from depth_boxes import seen_box

import primfit
from primfit.clouds.pinhole import is_of_pinhole

SIZE = np.array([0.53, 0.33, 0.28])


@pytest.fixture(scope="module")
def carton():
    rng = np.random.default_rng(3)
    return seen_box(rng, SIZE, 1.47, 0.002)


def test_pixels_are_told_in_any_order_precision_and_axes(carton):
    points = carton
    rng = np.random.default_rng(1)
    assert is_of_pinhole(points)
    assert is_of_pinhole(points[rng.permutation(len(points))][:5_000])
    assert is_of_pinhole(points.astype(np.float32).astype(float))
    assert is_of_pinhole(points * [1, -1, -1])


def test_others_are_not(carton):
    points = carton
    rng = np.random.default_rng(1)
    assert not is_of_pinhole(points + np.array([0.01, 0.0, 0.0]))
    assert not is_of_pinhole(points @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1.0]]))
    assert not is_of_pinhole(np.concatenate([points, points[:9] * 1.1]))
    assert not is_of_pinhole(rng.random((5_000, 3)) + np.array([0, 0, 1]))
    assert not is_of_pinhole(np.empty((0, 3)))
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 2, [1.0]), axis=-1).reshape(-1, 3)
    assert not is_of_pinhole(grid)


def test_a_carton_cut_out_of_a_depth_image_is_a_box(carton):
    points = carton
    found = primfit.detect(points, sigma=0.003)
    assert found.settings["camera_in_origin"]
    (box,) = found.solids
    assert box.kind == "box"
    sigmas = np.array([box.sigmas[name] for name in ("size", "size_2", "size_3")])
    off = np.sort(box.size)[::-1] - SIZE
    assert (np.abs(off) < 4.0 * sigmas).all()
    assert sigmas.max() < 0.02
    np.testing.assert_allclose(box.center, [0.0, 0.0, 1.47], atol=0.02)


def test_the_corner_of_a_room_is_none():
    rng = np.random.default_rng(0)
    points = seen_box(rng, np.array([0.6, 0.5, 0.4]), 1.5, 0.002, inside=True)
    found = primfit.detect(points, sigma=0.004)
    assert found.settings["camera_in_origin"]
    assert not found.solids
