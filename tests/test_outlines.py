"""Outlines of planes: of known shapes, drawn late, whatever the order of the points."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit
from primfit import _primfit
from primfit.planes.outlines import Outlines

LEVEL = np.array([0.0, 0.0, 1.0, -2.0])
ELL = shapely.Polygon([(0, 0), (2, 0), (2, 0.6), (0.7, 0.6), (0.7, 2), (0, 2)])
FRAME = shapely.box(0, 0, 2, 2) - shapely.box(0.5, 0.5, 1.5, 1.2)


def inside(shape, n, rng):
    """Points (n, 3) of a shape at a height of 2 m."""
    low, high = np.reshape(shape.bounds, (2, 2))
    flat = low + (high - low) * rng.random((20 * n, 2))
    flat = flat[shapely.contains_xy(shape, flat)][:n]
    return np.column_stack([flat, np.full(len(flat), 2.0)])


def drawn(points):
    """The outline of level points as a polygon."""
    outline = Outlines().of(LEVEL, points, np.arange(len(points)))
    shape = shapely.Polygon(outline.boundary()[:, :2], [hole[:, :2] for hole in outline.holes()])
    assert shape.is_valid
    assert outline.area() == pytest.approx(shape.area)
    np.testing.assert_allclose(outline.boundary()[:, 2], 2.0)
    return shape


def overlap(a, b):
    return a.intersection(b).area / a.union(b).area


@pytest.mark.parametrize("n", [1_000, 4_000, 40_000])
@pytest.mark.parametrize(
    "shape", [shapely.box(0, 0, 2, 1), ELL, FRAME], ids=["box", "ell", "frame"]
)
def test_known_shapes(shape, n):
    found = drawn(inside(shape, n, np.random.default_rng(n)))
    assert overlap(found, shape) > (0.9 if n == 1_000 else 0.955)
    assert len(found.interiors) == len(shape.interiors)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n_corners=st.integers(3, 11))
def test_any_polygon(seed, n_corners):
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(n_corners) + 0.8 * rng.random(n_corners)) / n_corners
    radius = rng.uniform(0.5, 1.0, n_corners)
    shape = shapely.Polygon(np.column_stack([radius * np.cos(turn), radius * np.sin(turn)]))
    points = inside(shape, 2_000, rng)
    found = drawn(points)
    assert overlap(found, shape) > 0.85
    # In other orders, and of points that are there twice, it is the very same.
    again = np.concatenate([points, points[:50]])[rng.permutation(2_050)]
    again = Outlines().of(LEVEL, again, np.arange(2_050))
    np.testing.assert_array_equal(
        again.boundary()[:, :2], shapely.get_coordinates(found.exterior)[:-1]
    )


def test_points_without_area():
    line = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.full(50, 2.0)])
    for points in (line, line[:1], line[:2], np.repeat(line[:1], 9, axis=0)):
        outline = Outlines().of(LEVEL, points, np.arange(len(points)))
        assert outline.boundary().shape == (0, 3)
        assert outline.area() == 0.0


def test_planes_draw_theirs_together_when_one_is_asked_for(monkeypatch):
    calls = []
    true = _primfit.outlines
    monkeypatch.setattr(
        _primfit, "outlines", lambda *args: (calls.append(len(args[0])), true(*args))[1]
    )
    rng = np.random.default_rng(1)
    cloud = np.concatenate([inside(ELL, 800, rng), inside(FRAME, 900, rng) + np.array([5, 0, 3])])
    planes = primfit.detect_planes(cloud)
    moved = [plane.moved(np.array([1.0, 2.0, 3.0])) for plane in planes]
    assert len(planes) == 2
    assert not calls
    # What is done to the points afterwards does not matter.
    cloud[:] = 0.0
    areas = sorted(plane.area for plane in planes)
    assert calls == [2]
    np.testing.assert_allclose(areas, [ELL.area, FRAME.area], rtol=0.1)
    for plane, other in zip(planes, moved, strict=True):
        np.testing.assert_array_equal(other.boundary, plane.boundary + np.array([1, 2, 3]))
        assert other.area == plane.area
        assert len(other.holes) == len(plane.holes)
    assert calls == [2]


@pytest.mark.parametrize(
    "copied",
    [copy.deepcopy, copy.copy, replace, lambda plane: pickle.loads(pickle.dumps(plane))],
    ids=["deepcopy", "copy", "replace", "pickle"],
)
def test_planes_that_were_not_drawn_can_be_copied(copied):
    cloud = inside(FRAME, 900, np.random.default_rng(1))
    (plane,) = primfit.detect_planes(cloud)
    other = copied(plane)
    assert other is not plane
    np.testing.assert_array_equal(other.boundary, plane.boundary)
    np.testing.assert_array_equal(other.holes[0], plane.holes[0])
    assert other.area == plane.area
    other.boundary[0] += 1.0
