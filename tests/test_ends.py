"""Where points end: without bias, and with a standard deviation that is one."""

from __future__ import annotations

import numpy as np
import pytest

import primfit
from primfit.polyhedra.ends import end_of


@pytest.mark.parametrize("n", [200, 480, 4_000])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_ends_of_even_and_uneven_points(n, noise, slope):
    off, told = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        along = rng.random(3 * n)
        along = along[rng.random(3 * n) < 1.0 - slope * along][:n]
        along = along + noise * rng.normal(size=n)
        end, sigma = end_of(along, rng.random(n), 0.015)
        off.append(end - 1.0)
        told.append(sigma)
    # What is not known of the blur and of the slope leaves up to half a deviation.
    assert abs(np.mean(off)) < 0.5 * np.std(off) + 3.0 * np.std(off) / np.sqrt(40)
    assert 0.5 < np.sqrt(np.mean(np.square(np.divide(off, told)))) < 1.8
    # The outermost point is worse, or beyond.
    assert np.std(off) < 6.0 / n + 1.5 * noise


def test_a_stray_point_moves_no_end():
    rng = np.random.default_rng(1)
    along = rng.random(2_000)
    end, sigma = end_of(along, rng.random(2_000), 0.002)
    other, _ = end_of(np.append(along, 1.2), rng.random(2_001), 0.002)
    assert abs(other - end) < 5.0 * sigma


@pytest.mark.parametrize(
    "along", [np.array([1.0]), np.array([1.0, 1.0, 1.0]), np.array([0.0, 1.0])]
)
def test_next_to_no_points(along):
    end, sigma = end_of(along, np.zeros(len(along)), 0.0)
    assert np.isfinite([end, sigma]).all()
    assert end >= along.max() - 1e-9


@pytest.mark.parametrize("sigma", [0.002, 0.01])
def test_a_box_of_three_faces_has_its_size_on_average(sigma):
    size, off = np.array([0.6, 0.4, 0.3]), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        clouds = []
        for axis in range(3):
            others = np.delete(size, axis)
            some = size * rng.random((int(2_000 * others.prod()), 3))
            some[:, axis] = size[axis] + sigma * rng.normal(size=len(some))
            clouds.append(some)
        points = np.concatenate(clouds)
        planes = primfit.detect_planes(points, sigma=sigma)
        if len(planes) == 3:
            fit = primfit.fit_box(planes, points)
            off.append(np.atleast_1d(fit.box.size) - size)
            assert fit.end_sigmas.shape == (2, 3)
            assert (fit.end_sigmas > 0.0).all()
            assert fit.end_sigmas.max() < 0.01
    assert len(off) >= 8
    mean, error = np.mean(off, axis=0), np.std(off, axis=0) / np.sqrt(len(off))
    assert (np.abs(mean) < 3.0 * error + 1e-3).all()
