"""Whether planes come back without some of the points."""

from __future__ import annotations

import copy
import pickle

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import primfit
from primfit.planes.firmness import N_TRIALS, Firmness, similarity


def a_corner(n: int = 600, seed: int = 3) -> np.ndarray:
    """Three faces that meet, with 2 mm of noise."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(3 * n, 3))
    for axis in range(3):
        points[axis * n : (axis + 1) * n, axis] = rng.normal(scale=0.002, size=n)
    return points


labels_of_points = st.lists(st.tuples(st.integers(-1, 3), st.integers(-1, 4)), max_size=40)


@given(labels_of_points)
def test_similarity_is_that_of_sets(pairs):
    labels, others = np.array(pairs, dtype=int).reshape(-1, 2).T
    sets = [set(np.flatnonzero(others == k)) for k in range(5)]
    for k, found in enumerate(similarity(labels, others, 4)):
        own = set(np.flatnonzero(labels == k))
        assert found == max((len(own & each) / len(own | each) for each in sets if each), default=0)


def test_others_are_left_out_each_time():
    masks = []

    def parts(mask):
        masks.append(mask)
        return np.where(mask, 0, -1)

    order = np.arange(90)
    firmness = Firmness(np.zeros(100, dtype=int), 1, order, parts)()
    # The last ten points are never searched.
    assert firmness.tolist() == [1.0]
    assert len(masks) == N_TRIALS
    assert all(not mask[90:].any() for mask in masks)
    left_out = [set(order[~mask[:90]]) for mask in masks]
    assert all(4 <= len(each) <= 5 for each in left_out)
    assert not set.intersection(*left_out)


def test_planes_that_are_plain_are_firm():
    planes = primfit.detect_planes(a_corner())
    assert len(planes) == 3
    assert planes.firmness.shape == (3,)
    assert (planes.firmness > 0.95).all()


def test_order_and_later_changes_of_the_points_do_not_matter():
    points = a_corner()
    order = np.random.default_rng(5).permutation(len(points))
    shuffled = points[order]
    planes, others = primfit.detect_planes(points), primfit.detect_planes(shuffled)
    points[:] = 0.0
    np.testing.assert_array_equal(planes.firmness, others.firmness)


def test_copies_know_it_too():
    planes = primfit.detect_planes(a_corner())
    copies = pickle.loads(pickle.dumps(planes)), copy.deepcopy(planes)
    for each in copies:
        np.testing.assert_array_equal(each.firmness, planes.firmness)


def test_images_and_rows_without_points_have_it():
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 60))
    image = np.stack([x, y, np.where(x < 0, 2.0, 2.0 + x)], axis=-1)
    image[..., 2] += rng.normal(scale=0.002, size=x.shape)
    image[:5] = np.nan
    for points in (image, image.reshape(-1, 3)):
        planes = primfit.detect_planes(points)
        assert len(planes) == 2
        assert (planes.firmness > 0.9).all()


def test_a_ridge_as_low_as_the_noise_tells_is_not_firm():
    def least(slope, seed):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(-1, 1, size=(2, 2000))
        z = slope * abs(x) + rng.normal(scale=0.01, size=2000)
        return primfit.detect_planes(np.column_stack([x, y, z])).firmness.min()

    flat, low, steep = ([least(slope, seed) for seed in range(4)] for slope in (0.005, 0.025, 0.1))
    assert min(flat) > 0.99
    assert np.mean(low) < 0.75
    assert min(steep) > 0.85


def test_tiles_do_not_tell():
    points = a_corner(4000)
    planes = primfit.detect_planes(points, tiles=0.6)
    assert np.isnan(planes.firmness).all()
    assert len(planes.firmness) == len(planes)
