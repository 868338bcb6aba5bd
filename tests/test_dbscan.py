"""Clusters against scikit-learn's, the slow twin, and inputs that make grids slow."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

import primfit

MANY = 400_000
"""Points whose pairs no machine looks at within the time that a test may take."""


def directions(rng, n):
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def ball(rng, n, radius):
    return directions(rng, n) * radius * np.cbrt(rng.uniform(size=(n, 1)))


def shuffled(rng, *parts):
    return rng.permutation(np.concatenate(parts))


def assert_equals_scikit_learn(points, eps, min_samples):
    expected = DBSCAN(eps=eps, min_samples=min_samples).fit_predict(points)
    np.testing.assert_array_equal(primfit.dbscan(points, eps, min_samples), expected)


@pytest.mark.parametrize("min_samples", [1, 2, 4, 10])
@pytest.mark.parametrize("eps", [0.02, 0.05, 0.2, 3.0])
def test_labels_equal_scikit_learn(eps, min_samples):
    rng = np.random.default_rng(7)
    blobs = rng.normal(scale=0.05, size=(1500, 3)) + rng.integers(0, 3, (1500, 1)) * 0.6
    points = shuffled(rng, blobs, rng.uniform(-1, 3, (300, 3)))
    assert_equals_scikit_learn(points, eps, min_samples)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 600),
    n_blobs=st.integers(1, 8),
    spread=st.sampled_from([0.25, 1.0, 4.0]),
    on_lattice=st.booleans(),
    eighths=st.integers(1, 24),
    min_samples=st.sampled_from([1, 2, 3, 5, 10, 40, 300]),
    offset=st.sampled_from([0.0, -1024.0, 2.0**20]),
)
def test_blobs_and_lattices_equal_scikit_learn(
    seed, n, n_blobs, spread, on_lattice, eighths, min_samples, offset
):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-4, 4, (n_blobs, 3))
    points = places[rng.integers(n_blobs, size=n)] + spread * rng.normal(size=(n, 3))
    if on_lattice:
        points = np.round(8 * points) / 8  # equal points, and pairs at exactly eps
    assert_equals_scikit_learn(points + offset, eighths / 8, min_samples)


@pytest.mark.parametrize("min_samples", [1, 10, 500, 1500, 6000])
@pytest.mark.parametrize("eps", [0.6, 1.1])
def test_crowded_cells_equal_scikit_learn(eps, min_samples):
    rng = np.random.default_rng(8)
    sheet = np.column_stack([rng.uniform(-1, 1, (1500, 2)), np.full(1500, 1.1 + 0.5 * eps)])
    noise = rng.uniform(-2, 2, (500, 3))
    points = shuffled(rng, ball(rng, 4000, 1.0), sheet, noise)
    assert_equals_scikit_learn(points, eps, min_samples)


@pytest.mark.parametrize("min_samples", [1, 2, 5])
@pytest.mark.parametrize("distance", [1e4, 1e7, 1e9])
def test_extents_that_need_wide_keys_equal_scikit_learn(distance, min_samples):
    rng = np.random.default_rng(9)
    corners = distance * rng.integers(-1, 2, (3000, 3))
    points = corners + rng.uniform(0, 0.05, (3000, 3))
    assert_equals_scikit_learn(points, 0.01, min_samples)


@pytest.mark.parametrize("min_samples", [1, 3, 30])
def test_cells_as_wide_as_the_rounding_of_their_places(min_samples):
    """At 5e11 eps from the lowest corner coordinates are multiples of 1e-4 eps."""
    rng = np.random.default_rng(10)
    steps = rng.integers(0, 40_000, (500, 3))
    points = 2.0**33 + 2.0**-19 * steps
    points[0] = 0.0
    eps = 2.0**-19 * 8192
    labels = primfit.dbscan(points, eps, min_samples)
    np.testing.assert_array_equal(labels, reference.dbscan(points, eps, min_samples))
    assert labels.max() >= 0


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 120),
    st.integers(1, 6),
    st.sampled_from([0.0, 1e-3, 0.11, 0.5, 10.0]),
)
def test_twin(seed, n, min_samples, grain):
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(n, 3))
    if grain:
        points = np.round(points / grain) * grain  # equal points and exact distances
    labels = primfit.dbscan(points, 0.11, min_samples)
    np.testing.assert_array_equal(labels, reference.dbscan(points, 0.11, min_samples))


def test_two_dimensions_equal_points_and_far_outlier():
    flat = np.zeros((50, 2))
    flat[-1] = 1e9
    labels = primfit.dbscan(flat, 0.1, 2)
    np.testing.assert_array_equal(labels, [0] * 49 + [-1])


def test_large_coordinates():
    points = np.random.default_rng(8).uniform(size=(500, 3))
    np.testing.assert_array_equal(
        primfit.dbscan(points, 0.08, 3), primfit.dbscan(points + 2.0**22, 0.08, 3)
    )


@pytest.mark.timeout(120)
class TestNotQuadratic:
    """None of these ends in time if all pairs of points, or a good part of them, are looked at."""

    @pytest.mark.parametrize("min_samples", [1, 10])
    def test_two_blobs_just_beyond_reach(self, min_samples):
        rng = np.random.default_rng(11)
        points = ball(rng, 2 * MANY, 0.1)
        points[MANY:, 0] += 1.2 + 1e-6
        labels = primfit.dbscan(points, 1.0, min_samples)
        np.testing.assert_array_equal(labels, np.repeat([0, 1], MANY))

    @pytest.mark.parametrize("min_samples", [1, 10])
    def test_two_tilted_walls_just_beyond_reach(self, min_samples):
        rng = np.random.default_rng(12)
        flat = np.column_stack([rng.uniform(0, 0.4, (2 * MANY, 2)), np.repeat([0, 1.001], MANY)])
        tilt = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        labels = primfit.dbscan(flat @ tilt, 1.0, min_samples)
        np.testing.assert_array_equal(labels, np.repeat([0, 1], MANY))

    @pytest.mark.parametrize("min_samples", [1, 10])
    def test_a_blob_within_a_hollow_sphere(self, min_samples):
        rng = np.random.default_rng(13)
        points = np.concatenate([ball(rng, MANY, 0.1), 1.101 * directions(rng, MANY)])
        labels = primfit.dbscan(points, 1.0, min_samples)
        np.testing.assert_array_equal(labels, np.repeat([0, 1], MANY))

    @pytest.mark.parametrize("share", [0.999, 1.0, 1.001])
    def test_a_ball_in_a_shell_of_noise_with_min_samples_about_n(self, share):
        rng = np.random.default_rng(14)
        shell = 1.3 * directions(rng, 5000)
        points = np.concatenate([ball(rng, MANY, 0.25), shell])
        labels = primfit.dbscan(points, 1.0, int(share * MANY))
        assert (labels[:MANY] == (-1 if share > 1 else 0)).all()
        assert (labels[MANY:] == -1).all()

    @pytest.mark.parametrize("min_samples", [1, 10, 2 * MANY, 2 * MANY + 1])
    def test_all_points_equal(self, min_samples):
        labels = primfit.dbscan(np.ones((2 * MANY, 3)), 0.1, min_samples)
        assert (labels == (0 if min_samples <= 2 * MANY else -1)).all()

    @pytest.mark.parametrize("min_samples", [1, 10])
    def test_one_far_outlier(self, min_samples):
        rng = np.random.default_rng(15)
        points = np.concatenate([ball(rng, MANY, 1.0), [[1e9, 0, 0]]])
        labels = primfit.dbscan(points, 0.1, min_samples)
        assert (labels[:-1] == 0).all()
        assert labels[-1] == (1 if min_samples == 1 else -1)

    def test_huge_extents(self):
        points = np.random.default_rng(16).uniform(-1e9, 1e9, (MANY, 3))
        assert (primfit.dbscan(points, 0.01, 2) == -1).all()
        np.testing.assert_array_equal(primfit.dbscan(points, 0.01, 1), np.arange(MANY))


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_stops_within_a_crowded_cell():
    points = ball(np.random.default_rng(17), 2 * MANY, 1.0)
    timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        primfit.dbscan(points, 1.0, MANY)
    timer.join()


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss has other units elsewhere")
@pytest.mark.parametrize(("eps", "min_samples"), [(0.005, 1), (0.005, 10), (0.02, 10), (1e-9, 2)])
def test_memory_is_at_most_four_times_the_points(eps, min_samples):
    program = f"""
import resource, numpy as np, primfit
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
points = np.random.default_rng(1).uniform(size=(1_000_000, 3))
primfit.dbscan(points[:10_000], {eps}, {min_samples})
before = peak()
primfit.dbscan(points, {eps}, {min_samples})
print((peak() - before) / points.nbytes)
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert float(run.stdout) <= 4.0
