"""Neighbours and local planes of bare clouds, against slow twins."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from scipy.spatial import KDTree

import primfit
from primfit import _primfit


def lattice():
    return np.stack(np.meshgrid(*[np.arange(7.0)] * 3), axis=-1).reshape(-1, 3)


def two_walls(n=900, sigma=0.01):
    rng = np.random.default_rng(5)
    uv = rng.uniform(size=(2, n, 2))
    walls = [np.insert(uv[k], k, 0.0, axis=1) for k in range(2)]
    return np.concatenate(walls) + sigma * rng.normal(size=(2 * n, 3))


class TestNeighbors:
    @pytest.mark.parametrize("k", [1, 2, 17, 100, 343, 500])
    def test_ties_go_to_the_lower_row(self, k):
        cloud = np.concatenate([lattice(), lattice()[:40]])
        queries = np.concatenate([cloud[::9], cloud[::9] + 0.5])
        found, distances = _primfit.PointTree(cloud).neighbors(queries, k)
        expected, expected_distances = reference.neighbors(cloud, queries, k)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(distances, expected_distances)

    @pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
    def test_scipy_agrees(self, scale):
        rng = np.random.default_rng(1)
        cloud = scale * rng.normal(size=(20_000, 3)) * [1.0, 10.0, 0.01]
        queries = cloud[::7] + scale * 0.1
        found, distances = _primfit.PointTree(cloud).neighbors(queries, 24)
        expected, rows = KDTree(cloud).query(queries, k=24)
        np.testing.assert_allclose(distances, expected, rtol=1e-12)
        np.testing.assert_array_equal(found, rows)

    def test_any_number_of_threads(self):
        cloud = np.random.default_rng(2).uniform(size=(50_000, 3))
        tree = _primfit.PointTree(cloud)
        one = tree.neighbors(cloud, 8, n_jobs=1)
        for n_jobs in (2, 8):
            for got, expected in zip(tree.neighbors(cloud, 8, n_jobs=n_jobs), one, strict=True):
                np.testing.assert_array_equal(got, expected)

    def test_order_and_small_clouds(self):
        for n in (0, 1, 15, 16, 17, 33, 1000):
            cloud = np.random.default_rng(n).uniform(size=(n, 3))
            tree = _primfit.PointTree(cloud)
            assert len(tree) == n
            np.testing.assert_array_equal(np.sort(tree.order()), np.arange(n))
            assert tree.neighbors(cloud, 4)[0].shape == (n, min(n, 4))


class TestLocalPlanes:
    @pytest.mark.parametrize("sigma", [None, 0.01])
    def test_the_twin_agrees(self, sigma):
        cloud = two_walls()
        tree = _primfit.PointTree(cloud)
        given = None if sigma is None else np.full(len(cloud), sigma)
        got = tree.local_planes(given)
        order = tree.order()
        rows = np.arange(0, len(cloud), 5)
        expected = reference.local_planes(cloud, order[rows], sigma)
        normals, noise, flatness, size, is_flat = (column[rows] for column in got)
        np.testing.assert_array_equal(size, expected[3])
        np.testing.assert_array_equal(is_flat, expected[4])
        np.testing.assert_allclose(noise, expected[1], rtol=1e-9)
        np.testing.assert_allclose(flatness, expected[2], rtol=1e-9)
        alignment = np.abs(np.einsum("ij,ij->i", normals, expected[0]))
        np.testing.assert_allclose(alignment, 1.0, rtol=1e-9)

    def test_any_number_of_threads(self):
        tree = _primfit.PointTree(two_walls())
        one = tree.local_planes(n_jobs=1)
        for got, expected in zip(tree.local_planes(n_jobs=8), one, strict=True):
            np.testing.assert_array_equal(got, expected)

    def test_noise_of_a_wall_is_what_it_was_given(self):
        tree = _primfit.PointTree(two_walls(5000, 0.003))
        _, noise, _, _, is_flat = tree.local_planes()
        assert is_flat.mean() > 0.9
        assert np.median(noise) == pytest.approx(0.003, rel=0.1)

    def test_rings_of_a_spinning_sensor(self):
        # 16 rings on a wall 4 m away: along a ring points lie 14 mm apart, rings 140 mm.
        azimuth, elevation = np.meshgrid(
            np.radians(np.arange(-30, 30, 0.2)), np.radians(np.arange(-15, 16, 2))
        )
        wall = 4.0 * np.stack(
            [np.ones_like(azimuth), np.tan(azimuth), np.tan(elevation) / np.cos(azimuth)], axis=-1
        )
        rng = np.random.default_rng(1)
        cloud = wall.reshape(-1, 3)
        cloud = cloud * (
            1
            + 0.01 * rng.normal(size=(len(cloud), 1)) / np.linalg.norm(cloud, axis=1, keepdims=True)
        )
        normals, _, _, _, is_flat = _primfit.PointTree(cloud).local_planes()
        assert is_flat.mean() > 0.9
        assert np.median(np.abs(normals[is_flat, 0])) > 0.99


class TestNormals:
    def test_a_slow_twin_agrees(self):
        cloud = two_walls()
        normals = primfit.estimate_normals(cloud, k=16)
        rows = KDTree(cloud).query(cloud, k=16)[1]
        for i in range(0, len(cloud), 50):
            near = cloud[rows[i]] - cloud[rows[i]].mean(axis=0)
            values, vectors = np.linalg.eigh(near.T @ near)
            if values[1] > 2.0 * values[0]:
                assert abs(normals[i] @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-6)

    def test_they_are_units_that_point_to_the_sensor(self):
        cloud = np.random.default_rng(3).normal(size=(500, 3))
        cloud /= np.linalg.norm(cloud, axis=1)[:, None]
        normals = primfit.estimate_normals(cloud, k=12, origins=[0.0, 0.0, 0.0])
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        assert (np.einsum("ij,ij->i", normals, -cloud) > 0.8).all()

    def test_without_a_sensor_the_largest_component_is_positive(self):
        normals = primfit.estimate_normals(two_walls())
        assert (normals[np.arange(len(normals)), np.abs(normals).argmax(axis=1)] > 0.0).all()

    def test_threads_and_bad_input(self):
        cloud = np.random.default_rng(4).uniform(size=(5000, 3))
        one = primfit.estimate_normals(cloud, n_jobs=1)
        np.testing.assert_array_equal(one, primfit.estimate_normals(cloud, n_jobs=4))
        with pytest.raises(ValueError, match="points must be at least 3"):
            primfit.estimate_normals(cloud[:2])
        with pytest.raises(ValueError, match="k must"):
            primfit.estimate_normals(cloud, k=2)
        with pytest.raises(ValueError, match="origins"):
            primfit.estimate_normals(cloud, origins=cloud[:7])
        with pytest.raises(ValueError, match="points"):
            primfit.estimate_normals(np.full((9, 3), np.nan))
