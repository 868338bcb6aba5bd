"""What a beam costs: limits of the range, intervals, and kernels beside the ray caster."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from small_maps import ROOM, in_room, scanned

import primfit
from primfit import _primfit
from primfit.likelihood.beam_model import BeamModel
from primfit.likelihood.obstacles import Obstacle

OUTLIER, MISSING = 12.5, 7.5
STAR = primfit.Prism.star(5, 0.24, 0.12, center=(0.5, 0.5), height=0.2)


def model(sigma=0.1, **changes):
    return BeamModel(sigma=np.full(4, sigma), **({"min_range": 0.2, "max_range": 3.0} | changes))


def blocks(scan, background, min_range, limits=None):
    sigma = np.full(len(scan), 0.05)
    arrays = (scan.origins, scan.directions, scan.ranges, background, sigma)
    limits = (min_range, 1.0) if limits is None else limits
    return _primfit.BeamBlocks(*map(np.ascontiguousarray, arrays), limits, OUTLIER, MISSING)


def cost_of(ranges, expected, min_range, max_range=1.0):
    """Cost of each beam, term by term."""
    foreseen, returned = (expected >= min_range) & (expected <= max_range), np.isfinite(ranges)
    with np.errstate(invalid="ignore"):
        explained = np.minimum(0.5 * ((ranges - expected) / 0.05) ** 2, OUTLIER)
    cost = np.where(foreseen & returned, explained, 0.0)
    cost[~foreseen & returned] = OUTLIER
    cost[foreseen & ~returned] = MISSING
    return cost


@pytest.mark.parametrize("min_range", [0.0, 0.15, 0.4])
def test_a_surface_nearer_than_the_shortest_range_returns_nothing(min_range):
    scan = scanned(in_room(STAR), 0.05, 1, min_range=min_range)
    background, _ = primfit.RayCaster(ROOM).cast(scan.origins, scan.directions)
    expected, _ = primfit.RayCaster(in_room(STAR)).cast(scan.origins, scan.directions)
    beams = blocks(scan, background, min_range)
    got = beams.costs(STAR.footprint[None], np.zeros(1), np.full(1, 0.2))
    costs = cost_of(scan.ranges, expected, min_range)
    np.testing.assert_allclose(got, costs.sum(), rtol=1e-6)
    local = beams.around(STAR.footprint, 0.0, 0.2)
    assert local.cost == pytest.approx(costs.sum(), rel=1e-6)


def test_each_beam_may_have_limits_of_its_own():
    scan = scanned(in_room(STAR), 0.05, 1)
    rng = np.random.default_rng(4)
    limits = np.sort(rng.uniform(0.0, 1.2, (2, len(scan))), axis=0)
    background, _ = primfit.RayCaster(ROOM).cast(scan.origins, scan.directions)
    expected, _ = primfit.RayCaster(in_room(STAR)).cast(scan.origins, scan.directions)
    beams = blocks(scan, background, None, limits)
    costs = cost_of(scan.ranges, expected, *limits)
    got = beams.costs(STAR.footprint[None], np.zeros(1), np.full(1, 0.2))
    np.testing.assert_allclose(got, costs.sum(), rtol=1e-6)
    assert beams.around(STAR.footprint, 0.0, 0.2).cost == pytest.approx(costs.sum(), rel=1e-6)
    noise = BeamModel(
        sigma=np.full(len(scan), 0.05), min_range=0.0, max_range=1.2, beam_limits=limits
    )
    rows = rng.integers(0, len(scan), 500)
    is_visible = (expected >= limits[0]) & (expected <= limits[1])
    np.testing.assert_array_equal(noise.is_visible(expected[rows], rows), is_visible[rows])
    met = expected[rows]
    got = noise.costs(scan.ranges[rows], met, met, np.full(500, 0.05), noise.limits(rows))
    is_explained = is_visible[rows] & scan.is_return[rows]
    np.testing.assert_allclose(got[is_explained], np.minimum(costs[rows], got.max())[is_explained])
    # The same for all is as one for all.
    alike = blocks(scan, background, None, np.tile([[0.1], [0.9]], len(scan)))
    one = blocks(scan, background, None, (0.1, 0.9))
    for each in (alike, one):
        got = each.costs(STAR.footprint[None], np.zeros(1), np.full(1, 0.2))
        np.testing.assert_array_equal(
            got, one.costs(STAR.footprint[None], np.zeros(1), np.full(1, 0.2))
        )


def test_limits_of_beams_are_as_many_as_beams():
    scan = scanned(in_room(STAR), 0.05, 1)
    with pytest.raises(ValueError, match="limits must have as many rows as origins"):
        blocks(scan, scan.ranges, None, np.ones((2, 3)))
    with pytest.raises(ValueError, match=r"limits must have shape \(2, n\)"):
        blocks(scan, scan.ranges, None, np.ones((3, len(scan))))


@pytest.mark.parametrize("height", [0.04, 0.07, 0.3])
def test_an_open_prism_is_walls_without_a_lid(height):
    arena = primfit.World([], primfit.Arena((1, 1), height=height))
    scan = scanned(arena, 0.05, 1)
    corners = arena.arena.outline
    walls = Obstacle(corners, height, is_open=True)
    vertices, triangles, _ = walls.unit
    vertices = vertices * [1.0, 1.0, height]
    nothing = np.full(len(scan), np.inf)
    expected, _ = primfit.RayCaster((vertices, triangles)).cast(scan.origins, scan.directions)
    assert np.isinf(expected).any()
    beams = blocks(scan, nothing, 0.01)
    # Seen from inside: with the floor away, beams that fall leave below the walls.
    costs = cost_of(scan.ranges, expected, 0.01).sum()
    got = beams.costs(corners[None], np.zeros(1), np.array([height]), is_open=True)
    np.testing.assert_allclose(got, costs, rtol=1e-5)
    assert beams.around(corners, 0.0, height, is_open=True).cost == pytest.approx(costs, rel=1e-5)


@pytest.mark.parametrize("height", [0.03, 0.2])
def test_ranges_of_a_prism_are_those_of_the_ray_caster(height):
    star = primfit.Prism(STAR.footprint, height)
    scan = scanned(in_room(star), 0.0, 1)
    background, _ = primfit.RayCaster(ROOM).cast(scan.origins, scan.directions)
    expected, _ = primfit.RayCaster(in_room(star)).cast(scan.origins, scan.directions)
    met = blocks(scan, background, 0.01).prism_ranges(star.footprint, 0.0, height)
    got = np.minimum(met, background)
    close = np.isclose(got, expected, atol=1e-6)
    # Single precision may put a beam on the other side of an edge.
    assert close.mean() > 0.9999
    assert (expected < background).sum() > 1000


@pytest.mark.parametrize(
    ("measured", "near", "far", "cost"),
    [
        (1.0, 1.0, 1.0, 0.0),
        (1.2, 1.0, 1.0, 2.0),
        (1.2, 0.9, 1.1, 0.5),
        (0.8, 0.9, 1.1, 0.5),
        (1.0, 0.9, 1.1, 0.0),
        (2.9, 1.0, 1.0, None),
        (np.inf, 1.0, 1.0, "dropout"),
        (np.inf, 0.1, 1.0, 0.0),
        (np.inf, 0.1, 0.15, 0.0),
        (np.inf, 2.9, 3.1, 0.0),
        (0.3, 0.1, 0.15, None),
        (0.15, 0.1, 0.25, 0.125),
        (1.0, np.inf, np.inf, None),
        (np.inf, np.inf, np.inf, 0.0),
        (3.1, 2.0, np.inf, 0.5),
    ],
)
def test_costs_of_intervals(measured, near, far, cost):
    """An interval costs what its best range within the sensor's limits does."""
    noise = model(outliers=0.01, dropouts=0.001)
    named = {None: noise.outlier_cost, "dropout": -np.log(0.001)}
    expected = named.get(cost, cost)
    one = [np.array([each]) for each in (measured, near, far, 0.1)]
    np.testing.assert_allclose(noise.costs(*one, noise.limits()), expected, atol=1e-12)


def test_an_outlier_costs_as_much_as_noise_where_both_are_as_likely():
    noise = model(sigma=0.01, outliers=0.02)
    density = norm.pdf(np.sqrt(2.0 * noise.outlier_cost)) / 0.01
    assert density == pytest.approx(0.02 / 3.0)
    # But at least as much as a residual of 3.2 standard deviations.
    assert model(sigma=1.0, outliers=0.5).outlier_cost == 5.0


@pytest.mark.parametrize("half", [0.0, 0.2, 0.5, 0.9])
def test_usual_costs_of_narrow_intervals(half):
    """The mean cost of returns whose true range is the middle, or else an end."""

    def mean(truth):
        def weighted(x):
            return 0.5 * max(abs(x + truth) - half, 0.0) ** 2 * norm.pdf(x)

        return quad(weighted, -12.0, 12.0, points=[-half - truth, half - truth], limit=200)[0]

    near, far = np.array([1.0]), np.array([1.0 + 2 * half * 0.1])
    got = model().usual_costs(near, far, np.array([0.1]))
    assert got[0] == pytest.approx(max(mean(0.0), 0.25), abs=1e-9)


def test_usual_costs_of_wide_intervals():
    """With the truth at an end, half of the returns cost nothing, the others half on average."""
    got = model().usual_costs(np.array([1.0, 1.0]), np.array([3.0, np.inf]), np.full(2, 0.1))
    np.testing.assert_allclose(got, 0.25)


def test_level_lines_near_a_place_are_those_of_a_slow_twin():
    rng = np.random.default_rng(4)
    poses = rng.uniform(-20.0, 20.0, (30, 3))
    origins = np.repeat(poses, 100, axis=0)
    directions = rng.normal(size=(3000, 3)) * [1.0, 1.0, 0.2]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lines = _primfit.LevelLines(origins, directions)
    level = np.linalg.norm(directions[:, :2], axis=1)
    ways = directions[:, :2] / level[:, None]
    for place, radius, reach in (
        ((1.0, -2.0), 0.5, 3.0),
        ((1.0, -2.0), 0.5, 30.0),
        ((-15.0, 15.0), 3.0, 4.0),
        ((200.0, 0.0), 3.0, 4.0),
        ((200.0, 0.0), 3.0, 400.0),
    ):
        to_place = place - origins[:, :2]
        across = np.abs(ways[:, 0] * to_place[:, 1] - ways[:, 1] * to_place[:, 0])
        along = (ways * to_place).sum(axis=1)
        # How far each is within all limits, negative outside.
        margin = np.min([radius - across, along + radius, reach * level - along + radius], axis=0)
        for stride in (1, 7):
            got = lines.near(place, radius, reach, stride)
            assert (np.diff(got) > 0).all()
            assert (got % stride == 0).all()
            is_near = np.zeros(3000, dtype=bool)
            is_near[got] = True
            clear = (np.abs(margin) > 1e-3) & (np.arange(3000) % stride == 0)
            np.testing.assert_array_equal(is_near[clear], margin[clear] > 0.0)
