"""Circles and ellipses, and polygons that are nearly round."""

from __future__ import annotations

import numpy as np
import pytest
from small_maps import in_room, scanned

import primfit


def sigmas_off(found, truth):
    """Distance of the centres in the standard deviations of noise and tolerance together."""
    variance = np.diag(found.covariance)[:2] + found.tolerance_sigma**2
    return np.abs(found.center - truth.center)[:2] / np.sqrt(variance)


@pytest.mark.parametrize(
    ("radius", "noise"), [(0.08, 0.0), (0.15, 0.0), (0.08, 0.01), (0.08, 0.05), (0.15, 0.05)]
)
def test_a_circle(radius, noise):
    solid = primfit.Prism.circle(radius, center=(0.52, 0.47))
    found = primfit.detect(scanned(in_room(solid), noise, 1), rng=1)
    assert [each.kind for each in found.solids] == ["circle"]
    (circle,) = found.solids
    assert circle.size == pytest.approx(radius, rel=0.01)
    assert circle.angle == 0.0
    assert (sigmas_off(circle, solid) < 5.0).all()
    assert circle.top <= 0.2 + 1e-3


def test_a_pillar_in_a_larger_room():
    solid = primfit.Prism.circle(0.3, center=(3.0, 1.0), height=0.4)
    world = primfit.World([solid], primfit.Arena((4, 4), height=2.0))
    lidar = primfit.Lidar(max_range=100.0, noise=0.0002, mount=(0, 0, 0.4), min_range=0.1)
    path = primfit.grid_path(world, 1.0, clearance=0.15, rng=1)
    found = primfit.detect(primfit.scan(world, path, lidar, rng=1), rng=1)
    assert [each.kind for each in found.solids] == ["circle"]
    assert (sigmas_off(found.solids[0], solid) < 5.0).all()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_an_ellipse(noise):
    solid = primfit.Prism.ellipse(0.2, 0.12, center=(0.52, 0.47), angle=0.7)
    found = primfit.detect(scanned(in_room(solid), noise, 1), rng=1)
    assert [each.kind for each in found.solids] == ["ellipse"]
    (ellipse,) = found.solids
    np.testing.assert_allclose(ellipse.size, solid.size, rtol=0.01)
    assert ellipse.angle == pytest.approx(0.7, abs=0.02)
    assert (sigmas_off(ellipse, solid) < 5.0).all()


@pytest.mark.parametrize("n", [6, 8])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_polygon_of_many_corners_stays_one(n, noise):
    solid = primfit.Prism.regular(n, 1.2 / n, center=(0.52, 0.47), angle=0.2)
    found = primfit.detect(scanned(in_room(solid), noise, 1), rng=1)
    assert [each.kind for each in found.solids] == [solid.kind]
    assert found.solids[0].size == pytest.approx(solid.size, rel=0.01)
