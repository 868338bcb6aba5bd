"""What beams may meet: how near and how far a tolerance lets it be, and what is inside."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import primfit
from primfit.likelihood.obstacles import Obstacle

SQUARE = np.array([[1.0, 2.0], [1.4, 2.0], [1.4, 2.4], [1.0, 2.4]])


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize(("top", "rise"), [(1.0, 0.03), (0.1, 0.03 * 0.25), (0.4, 0.03)])
def test_a_square_within_a_tolerance(is_open, top, rise):
    """All walls move by the tolerance; a low top by as large a share of its height."""
    near, far = Obstacle(SQUARE, top, is_open).within(0.03, 0.0)
    out = -0.03 if is_open else 0.03
    for each, by, z in ((near, out, top + rise), (far, -out, top - rise)):
        assert each.top == pytest.approx(z)
        assert each.is_open == is_open
        assert each.size == pytest.approx(0.4 + 2 * by)
        np.testing.assert_allclose(np.ptp(each.footprint, axis=0), 0.4 + 2 * by)
        np.testing.assert_allclose(each.center, [1.2, 2.2])


def test_the_floor_counts_in_the_height():
    near, _ = Obstacle(SQUARE, 0.9).within(0.04, 0.8)
    assert near.top == pytest.approx(0.9 + 0.04 * 0.25)


def test_what_a_tolerance_would_take_away_stays():
    thin = Obstacle(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.05], [0.0, 0.05]]), 0.3)
    near, far = thin.within(0.03, 0.0)
    np.testing.assert_allclose(far.footprint, thin.footprint)
    np.testing.assert_allclose(np.ptp(near.footprint, axis=0), [1.06, 0.11])


@given(st.integers(3, 8), st.floats(0.001, 0.02), st.floats(0.0, 6.0), st.floats(0.4, 1.0))
def test_walls_move_by_the_tolerance(n, tolerance, angle, squeeze):
    corners = primfit.Prism.regular(n, 0.3, angle=angle).footprint * [1.0, squeeze]
    here = shapely.Polygon(corners)
    near, far = (
        shapely.Polygon(each.footprint) for each in Obstacle(corners, 0.2).within(tolerance, 0.0)
    )
    assert near.contains(here)
    assert here.contains(far)
    assert near.exterior.distance(here.exterior) == pytest.approx(tolerance)
    assert far.exterior.distance(here.exterior) == pytest.approx(tolerance)


def test_swallowed_places_are_in_a_solid_or_behind_the_walls_of_a_room():
    ell = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    places = np.array(
        [[0.5, 0.5, 0.1], [1.5, 1.5, 0.1], [0.5, 1.5, 0.1], [0.5, 0.5, 0.4], [9.0, 9.0, 0.1]]
    )
    inside = [True, False, True, False, False]
    assert Obstacle(ell, 0.3).swallows(places).tolist() == inside
    behind = [False, True, False, False, True]
    assert Obstacle(ell, 0.3, is_open=True).swallows(places).tolist() == behind


def test_an_open_obstacle_has_walls_alone():
    closed, walls = Obstacle(SQUARE, 0.3), Obstacle(SQUARE, 0.3, is_open=True)
    assert sorted(set(closed.unit[2])) == [0, 1, 2, 3, 4, 5]
    assert sorted(set(walls.unit[2])) == [0, 1, 2, 3]
    assert len(walls.unit[1]) == 8
