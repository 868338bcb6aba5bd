"""Depth images."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit


class TestDepth:
    @settings(max_examples=30, deadline=None)
    @given(st.integers(0, 10**6))
    def test_projection_of_the_points_is_the_image(self, seed):
        rng = np.random.default_rng(seed)
        depth = rng.uniform(0.5, 5.0, (7, 9))
        fx, fy, cx, cy = *rng.uniform(5, 20, 2), *rng.uniform(0, 9, 2)
        points = primfit.points_of_depth(depth, fx, fy, cx, cy)
        u = fx * points[..., 0] / points[..., 2] + cx
        v = fy * points[..., 1] / points[..., 2] + cy
        np.testing.assert_allclose(u, np.broadcast_to(np.arange(9), (7, 9)), atol=1e-9)
        np.testing.assert_allclose(v, np.broadcast_to(np.arange(7)[:, None], (7, 9)), atol=1e-9)
        np.testing.assert_array_equal(points[..., 2], depth)

    def test_pixels_without_depth(self):
        depth = np.array([[1.0, 0.0, np.nan], [np.inf, -1.0, 2.0]])
        points = primfit.points_of_depth(depth, 1, 1, 0, 0)
        np.testing.assert_array_equal(
            np.isfinite(points).all(axis=-1), [[True, False, False], [False, False, True]]
        )

    @pytest.mark.parametrize(
        ("arguments", "error", "message"),
        [
            ((np.zeros(3), 1, 1, 0, 0), ValueError, r"depth must have shape \(h, w\), not \(3,\)"),
            ((np.zeros((2, 2)), 0, 1, 0, 0), ValueError, "fx must not be zero"),
            ((np.zeros((2, 2)), 1, np.nan, 0, 0), ValueError, "fy must be finite"),
            ((np.array([["a"]]), 1, 1, 0, 0), TypeError, "depth must be an array of numbers"),
        ],
    )
    def test_bad_arguments(self, arguments, error, message):
        with pytest.raises(error, match=message):
            primfit.points_of_depth(*arguments)
        with pytest.raises(ValueError, match="scale must be greater than 0"):
            primfit.points_of_depth(np.zeros((2, 2)), 1, 1, 0, 0, scale=0)
