"""The likelihood of circles and ellipses: ranges in closed form, slopes, what a move may change."""

import numpy as np
import pytest

from primfit import _primfit
from primfit.likelihood.footprint_models import CIRCLE, ELLIPSE, RECTANGLE, related
from primfit.likelihood.settings import LikelihoodSettings

SIGMA, TOP = 0.002, 0.4
CASES = [
    pytest.param(CIRCLE, np.array([0.3, -0.2, 0.25]), id="circle"),
    pytest.param(ELLIPSE, np.array([0.3, -0.2, 0.7, 0.4, 0.15]), id="ellipse"),
]


def rays(n, seed=0, spread=0.5):
    """Beams from around and within, above and below the top, towards the solid and past it."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform((-1.5, -1.5, 0.05), (1.5, 1.5, 0.8), (n, 3))
    targets = np.array([0.3, -0.2, 0.2]) + rng.uniform(-spread, spread, (n, 3))
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def axes_of(model, parameters):
    """Centre and half axes as columns (2, 2)."""
    ends = model.points(parameters[None])[0]
    return ends.mean(axis=0), np.stack([ends[0] - ends[2], ends[1] - ends[3]], axis=1) / 2


def slow_ranges(origins, directions, center, axes, top):
    """Where single beams meet the walls from both sides, and the top from above, by a quadratic."""
    found = np.full(len(origins), np.inf)
    into = np.linalg.inv(axes)
    for i, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        at, way = into @ (origin[:2] - center), into @ direction[:2]
        roots = np.roots([way @ way, 2 * at @ way, at @ at - 1])
        if np.isrealobj(roots) or not np.iscomplex(roots).any():
            for t in np.real(roots):
                if t >= 0 and 0 <= origin[2] + t * direction[2] <= top:
                    found[i] = min(found[i], t)
        if origin[2] > top and direction[2] < 0:
            t = (top - origin[2]) / direction[2]
            if np.linalg.norm(at + t * way) <= 1:
                found[i] = min(found[i], t)
    return found


def blocks(origins, directions, ranges, sigma=SIGMA, reach=5.0):
    n = len(origins)
    arrays = (ranges, np.full(n, np.inf), np.full(n, sigma))
    return _primfit.BeamBlocks(origins, directions, *arrays, (0.0, reach), 1e6, 1e6)


@pytest.mark.parametrize(("model", "parameters"), CASES)
def test_ranges_are_those_of_the_closed_form(model, parameters):
    origins, directions = rays(3000)
    center, axes = axes_of(model, parameters)
    slow = slow_ranges(origins, directions, center, axes, TOP)
    beams = blocks(origins, directions, slow)
    got = beams.prism_ranges(model.points(parameters[None])[0], 0.0, TOP, is_round=True)
    hit = np.isfinite(slow) & np.isfinite(got)
    assert hit.sum() > 500
    # Rounding decides of a few at silhouettes and edges, and how far along tangents are.
    assert (np.isfinite(slow) != np.isfinite(got)).mean() < 2e-3
    off = np.abs(got[hit] - slow[hit])
    assert np.median(off) < 1e-6
    assert (off < 2e-5).mean() > 0.995


@pytest.mark.parametrize(("model", "parameters"), CASES)
def test_costs_are_those_of_the_ranges(model, parameters):
    origins, directions = rays(2000)
    points = model.points(np.stack([parameters, parameters + 1e-3]))
    ranges = 1e-3 + blocks(origins, directions, np.ones(2000)).prism_ranges(
        points[0], 0.0, TOP, is_round=True
    )
    beams = blocks(origins, directions, ranges)
    floors, tops = np.zeros(2), np.full(2, TOP)
    got = beams.costs(points, floors, tops, is_round=True)
    expected = 0.5 * (1e-3 / SIGMA) ** 2 * np.isfinite(ranges).sum()
    assert got[0] == pytest.approx(expected, rel=2e-3)
    np.testing.assert_array_equal(got, beams.costs(points, floors, tops, is_round=True, n_jobs=2))
    local = beams.around(points[1], 0.0, TOP, is_round=True)
    assert local.cost == pytest.approx(got[1], rel=1e-6)


@pytest.mark.parametrize(("model", "parameters"), CASES)
def test_slopes_are_differences_of_ranges(model, parameters):
    origins, directions = rays(4000, seed=1)

    def ranges(at):
        none = blocks(origins, directions, np.ones(4000))
        return none.prism_ranges(model.points(at[None])[0], 0.0, TOP, is_round=True)

    step, d = 2e-3, model.n_parameters
    here = ranges(parameters)
    more, less = (
        np.stack([ranges(parameters + s * step) for s in each], axis=1)
        for each in (np.eye(d), -np.eye(d))
    )
    met = np.isfinite(here) & np.isfinite(more + less).all(axis=1)
    here, more, less = here[met], more[met], less[met]
    rates, bends = (more - less) / (2 * step), more + less - 2 * here[:, None]
    # Beams that meet the same wall everywhere, and do not graze it.
    smooth = (np.abs(bends) < 1e-4).all(axis=1) & (np.abs(rates) < 3).all(axis=1)
    assert smooth.sum() > 300
    off = np.random.default_rng(2).normal(0, SIGMA, smooth.sum())
    beams = blocks(origins[met][smooth], directions[met][smooth], here[smooth] + off)
    local = beams.around(model.points(parameters[None])[0], 0.0, TOP, is_round=True)
    _, changes = model.family.frame(parameters)
    told = rates[smooth] / SIGMA
    information = changes.T @ local.information @ changes
    np.testing.assert_allclose(information, told.T @ told, rtol=0.03, atol=2e-3 * information.max())
    gradient = changes.T @ local.gradient
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(gradient / scale, -(told.T @ off / SIGMA) / scale, atol=0.15)


@pytest.mark.parametrize("slack", [2e-4, 2e-3])
@pytest.mark.parametrize(("model", "parameters"), CASES)
def test_costs_near_an_ellipse_are_those_of_all_beams(model, parameters, slack):
    origins, directions = rays(3000, seed=3)
    none = blocks(origins, directions, np.ones(3000))
    rng = np.random.default_rng(4)
    ranges = none.prism_ranges(model.points(parameters[None])[0], 0.0, TOP, is_round=True)
    ranges = ranges + rng.normal(0, SIGMA, 3000)
    n = len(ranges)
    arrays = (ranges, np.full(n, np.inf), np.full(n, SIGMA))
    beams = _primfit.BeamBlocks(origins, directions, *arrays, (0.0, 5.0), 12.0, 7.0)
    here = model.points(parameters[None])[0]
    local = beams.around(here, 0.0, TOP, slack, slack, is_round=True)
    assert len(local.open) < 0.6 * n
    tops = TOP + rng.uniform(-slack, slack, 40)
    tried = parameters + rng.uniform(-0.5, 0.5, (40, model.n_parameters)) * slack
    got = local.costs(model.family, np.column_stack([tried, tops]))
    assert np.isfinite(got).all()
    all_beams = beams.costs(model.points(tried), np.zeros(40), tops, is_round=True)
    np.testing.assert_allclose(got, all_beams, rtol=2e-3, atol=0.5)
    assert np.isinf(local.costs(model.family, tried + 2 * slack)).all()


@pytest.mark.parametrize(("model", "parameters"), CASES)
def test_a_climb_ends_at_the_truth(model, parameters):
    origins, directions = rays(3000, seed=5)
    none = blocks(origins, directions, np.ones(3000))
    ranges = none.prism_ranges(model.points(parameters[None])[0], 0.0, TOP, is_round=True)
    ranges = ranges + np.random.default_rng(6).normal(0, SIGMA, 3000)
    n = len(ranges)
    arrays = (ranges, np.full(n, np.inf), np.full(n, SIGMA))
    beams = _primfit.BeamBlocks(origins, directions, *arrays, (0.0, 5.0), 12.0, 7.0)
    found, _, covariance = beams.climb(model.family, parameters + 1e-3, 0.0, TOP, 1.0, 12, False)
    assert np.abs((found - parameters) / np.sqrt(np.diag(covariance))).max() < 4.0
    assert np.sqrt(np.diag(covariance))[-1] < 2e-4


def test_a_round_footprint_has_four_ends_and_a_family_of_its_own():
    beams = blocks(*rays(10), np.ones(10))
    ends = CIRCLE.points(np.array([[0.3, -0.2, 0.25]]))[0]
    with pytest.raises(ValueError, match="4 ends of axes, not 3"):
        beams.prism_ranges(ends[:3], 0.0, TOP, is_round=True)
    local = beams.around(ends, 0.0, TOP)
    with pytest.raises(ValueError, match="that of the footprint"):
        local.costs(CIRCLE.family, np.array([[0.3, -0.2, 0.25]]))


def test_a_circle_has_no_angle():
    place, sizes = CIRCLE.apart(np.array([1.0, 2.0, 0.5]))
    np.testing.assert_array_equal(place, [1, 2, 0])
    np.testing.assert_array_equal(sizes, [0.5])
    starts = dict(related(CIRCLE, np.array([1.0, 2.0, 0.5]), LikelihoodSettings().models))
    np.testing.assert_array_equal(starts[ELLIPSE], [1, 2, 0, 0.5, 0.5])
    starts = dict(
        related(RECTANGLE, np.array([1.0, 2.0, 0.3, 2, 1.9]), LikelihoodSettings().models)
    )
    assert ELLIPSE in starts
