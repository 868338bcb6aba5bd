"""Spheres, cylinders, cones and tori through points: exact, unbiased, with honest deviations."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from round_surfaces import PARAMETERS, local_points, placed, rotation, seen
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

import primfit

KINDS = sorted(PARAMETERS)


def fit(kind, *arguments, **options):
    return getattr(primfit, f"fit_{kind}")(*arguments, **options)


def z_scores(kind, found, truth):
    return [(getattr(found, name) - truth[name]) / found.sigmas[name] for name in PARAMETERS[kind]]


def place_of(found):
    return found.apex if found.kind == "cone" else found.center


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_origins", [False, True])
def test_exact_points_give_the_exact_surface(kind, with_origins):
    rng = np.random.default_rng(1)
    if with_origins:
        points, origin, truth = seen(kind, rng, 400, 0.0)
    else:
        (points, _, truth), origin = placed(kind, rng, 400), None
    found = fit(kind, points, origin)
    for name in PARAMETERS[kind]:
        assert getattr(found, name) == pytest.approx(truth[name], abs=1e-8)
    if kind != "cylinder":
        assert place_of(found) == pytest.approx(truth["place"], abs=1e-7)
    if kind != "sphere":
        assert abs(found.axis @ truth["axis"]) == pytest.approx(1.0, abs=1e-12)
    if kind == "cylinder":
        away = found.center - truth["place"]
        assert np.cross(away, truth["axis"]) == pytest.approx([0, 0, 0], abs=1e-8)
    assert found.rms < 1e-8
    assert found.is_convex is (True if with_origins else None)
    assert np.abs(found.distances(points)).max() < 1e-8
    assert len(found.inliers) == len(points)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_origins", [False, True])
@pytest.mark.parametrize("is_told", [False, True])
def test_errors_are_as_large_as_their_deviations(kind, with_origins, is_told):
    """Noise of 2 to 3 % of the radius."""
    sigma, scores, turns = (0.005 if kind == "torus" else 0.008), [], []
    for seed in range(48):
        rng = np.random.default_rng(seed)
        if with_origins:
            points, origin, truth = seen(kind, rng, 1200, sigma)
        else:
            (points, _, truth), origin = placed(kind, rng, 900, arc=3.0), None
            points = points + rng.normal(0.0, sigma, points.shape)
        found = fit(kind, points, origin, sigma if is_told else None)
        scores.append(z_scores(kind, found, truth))
        if kind != "sphere":
            off = np.cross(found.axis, truth["axis"])
            turns.append(np.linalg.norm(off) / found.sigmas["axis"])
    scores = np.array(scores)
    assert np.abs(scores.mean(axis=0)).max() <= 0.3, scores.mean(axis=0)
    rms = np.sqrt((scores**2).mean(axis=0))
    assert rms.min() >= 0.6, rms
    assert rms.max() <= 1.3, rms
    if turns:
        turn = np.sqrt(np.mean(np.square(turns)))
        assert 0.6 <= turn <= 1.3, turn


def test_the_correction_is_what_takes_the_bias_off():
    """The plain least-squares sphere is too large by half of sigma squared times its curvatures."""
    off = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        points, _, truth = placed("sphere", rng, 2000, arc=6.3)
        points = points + rng.normal(0.0, 0.02, points.shape)
        found = primfit.fit_sphere(points, sigma=0.02)
        plain = least_squares(
            lambda x, at=points: np.linalg.norm(at - x[:3], axis=1) - x[3], found.parameters
        )
        off.append([found.radius - truth["radius"], plain.x[3] - truth["radius"]])
    ours, plain = np.mean(off, axis=0)
    assert abs(ours) < 0.3 * 0.02**2 / 0.5
    assert plain > 0.7 * 0.02**2 / 0.5


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.2, 0.45])
def test_outliers_do_not_matter(kind, share):
    scores = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        points, _, truth = placed(kind, rng, 1000, arc=6.0)
        points = points + rng.normal(0.0, 0.005, points.shape)
        n = int(1000 * share / (1.0 - share))
        low, high = points.min(axis=0) - 0.1, points.max(axis=0) + 0.1
        cloud = np.vstack([points, rng.uniform(low, high, (n, 3))])
        found = fit(kind, cloud, outliers=share)
        scores.append(z_scores(kind, found, truth))
        is_inlier = np.isin(np.arange(len(cloud)), found.inliers)
        assert is_inlier[:1000].mean() > 0.97
        assert is_inlier[1000:].mean() < 0.15
        assert found.rms == pytest.approx(0.005, rel=0.1)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def varied(found, number, step):
    """The surface with one of its parameters changed, its axis of unit length again."""
    values = found.parameters.copy()
    values[number] += step
    if found.kind == "sphere":
        return dataclasses.replace(found, center=values[:3], radius=values[3])
    axis = values[3:6] / np.linalg.norm(values[3:6])
    if found.kind == "cone":
        return dataclasses.replace(found, apex=values[:3], axis=axis, angle=values[6])
    if found.kind == "cylinder":
        return dataclasses.replace(found, center=values[:3], axis=axis, radius=values[6])
    return dataclasses.replace(
        found, center=values[:3], axis=axis, major_radius=values[6], radius=values[7]
    )


def ranges_to(surface, points, beams):
    """How far beyond the points their beams meet the surface, by Newton's method."""
    far = np.zeros(len(points))
    for _ in range(30):
        at = points + far[:, None] * beams
        far -= surface.distances(at) / np.einsum("ni,ni->n", surface.normals(at), beams)
    return far


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_origins", [False, True])
def test_covariance_is_that_of_finite_differences(kind, with_origins):
    """The inverse of the information, whose derivatives are differences of distances or ranges."""
    rng = np.random.default_rng(3)
    sigma, h = 0.002, 1e-6
    points, origin, _ = seen(kind, rng, 600, sigma)
    found = fit(kind, points, origin if with_origins else None, sigma)
    beams = (points - origin) / np.linalg.norm(points - origin, axis=1)[:, None]
    used = np.ones(len(points), dtype=bool)
    if with_origins:
        far = ranges_to(found, points, beams)
        steep = np.einsum("ni,ni->n", found.normals(points + far[:, None] * beams), beams)
        used = (steep <= -0.25) & (np.abs(far) < 10.0 * sigma)

    def residuals(surface):
        if with_origins:
            return ranges_to(surface, points[used], beams[used])
        return surface.distances(points)

    columns = [
        (residuals(varied(found, i, h)) - residuals(varied(found, i, -h))) / (2.0 * h)
        for i in range(len(found.parameters))
    ]
    information = np.array(columns) @ np.array(columns).T / sigma**2
    expected = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    n_used, k = used.sum(), np.linalg.matrix_rank(information, tol=1e-9 * np.trace(information))
    errors = residuals(found) / sigma
    grown = max(1.0, (errors @ errors) / (n_used - k)) * found.correlation_area
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) * grown
    assert np.abs(found.covariance - grown * expected).max() < 0.02 * scale.max()
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(
        np.sqrt(np.diag(grown * expected)), rel=0.02, abs=1e-9
    )


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(KINDS), st.integers(0, 2**31), st.floats(0.1, 10.0))
def test_what_is_found_moves_with_the_points(kind, seed, scale):
    rng = np.random.default_rng(seed)
    points = local_points(kind, np.random.default_rng(5), 300, arc=4.0)[0]
    points = points + np.random.default_rng(6).normal(0.0, 0.003, points.shape)
    turn, shift = rotation(rng), rng.uniform(-50.0, 50.0, 3)
    first = fit(kind, points)
    second = fit(kind, scale * points @ turn.T + shift)
    for name in PARAMETERS[kind]:
        size = 1.0 if name == "angle" else scale
        assert getattr(second, name) == pytest.approx(size * getattr(first, name), rel=1e-4)
        assert second.sigmas[name] == pytest.approx(size * first.sigmas[name], rel=1e-2)
    assert place_of(second) == pytest.approx(
        scale * turn @ place_of(first) + shift, abs=1e-3 * scale
    )


@pytest.mark.parametrize("kind", KINDS)
def test_neither_the_order_of_rows_nor_threads_matter(kind):
    rng = np.random.default_rng(2)
    points, origin, _ = seen(kind, rng, 9000, 0.01)
    order = rng.permutation(len(points))
    first = fit(kind, points, origin, n_jobs=1)
    second = fit(kind, points[order], origin, n_jobs=3)
    assert np.array_equal(first.parameters, second.parameters)
    assert np.array_equal(first.covariance, second.covariance)
    assert np.array_equal(first.inliers, np.sort(order[second.inliers]))


def test_errors_alike_among_neighbors_widen_the_deviations():
    """As of a depth image: noise blurred over pixels."""
    scores = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u, v = np.meshgrid(np.linspace(-0.8, 0.8, 60), np.linspace(-0.8, 0.8, 60))
        normals = np.dstack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)])
        noise = gaussian_filter(rng.normal(size=u.shape), 1.0, mode="wrap")
        noise *= 0.002 / noise.std()
        points = (0.3 + noise)[..., None] * normals
        found = primfit.fit_sphere(points.reshape(-1, 3))
        assert found.correlation_area > 6.0
        scores.append((found.radius - 0.3) / found.sigmas["radius"])
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_scan_and_rows_without_points():
    rng = np.random.default_rng(4)
    points, origin, truth = seen("cylinder", rng, 500, 0.002)
    directions = points - origin
    ranges = np.linalg.norm(directions, axis=1)
    ranges[::7] = np.inf
    scan = primfit.Scan.from_rays(origin, directions, ranges, 0.002)
    found = primfit.fit_cylinder(scan)
    assert np.array_equal(found.inliers, np.flatnonzero(np.isfinite(ranges)))
    assert found.radius == pytest.approx(truth["radius"], abs=5.0 * found.sigmas["radius"])
    points[::7] = np.nan
    same = primfit.fit_cylinder(points, origin, 0.002)
    assert same.parameters == pytest.approx(found.parameters, abs=1e-9)


def test_far_from_the_origin():
    points = local_points("cone", np.random.default_rng(4), 500)[0]
    offset = np.array([4e5, 5e6, 100.0])
    near, far = primfit.fit_cone(points), primfit.fit_cone(points + offset)
    assert far.apex - offset == pytest.approx(near.apex, abs=1e-6)
    middle = near.boundary[0].mean(axis=0)
    assert far.boundary[0].mean(axis=0) - offset == pytest.approx(middle, abs=1e-3)


def test_seen_from_inside_is_concave():
    points, _, truth = placed("sphere", np.random.default_rng(1), 500)
    assert primfit.fit_sphere(points, origins=truth["place"]).is_convex is False


AREAS = {
    "sphere": 2.0 * 0.5**2 * 1.2,
    "cylinder": 0.3 * 2.0 * 1.0,
    "cone": (1.2**2 - 0.4**2) / 2.0 * 2.0 * np.sin(0.4),
    "torus": 2.0 * 0.2 * (0.6 * 4.0 + 0.2 * 2.0 * np.sin(2.0)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_boundary_and_area(kind):
    points = local_points(kind, np.random.default_rng(1), 6000)[0]
    found = fit(kind, points)
    assert found.area == pytest.approx(AREAS[kind], rel=0.04)
    (outline,) = found.boundary
    assert np.abs(found.distances(outline)).max() < 1e-6
    near = np.linalg.norm(outline[:, None] - points, axis=2).min(axis=1)
    assert near.max() < 0.01
    if kind != "sphere":
        assert found.arc == pytest.approx(2.0, abs=0.05)
    again = pickle.loads(pickle.dumps(found))
    assert again.area == found.area
    assert repr(again) == repr(found)
    assert copy.deepcopy(found).area == found.area


def test_all_around_is_a_full_arc():
    for kind in ("cylinder", "cone", "torus"):
        points = local_points(kind, np.random.default_rng(1), 3000, arc=2.0 * np.pi)[0]
        assert fit(kind, points).arc == 2.0 * np.pi


def flat(noise):
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(size=(300, 2)), rng.normal(0.0, noise, 300)])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_plane_is_refused(kind, noise):
    with pytest.raises(ValueError, match=f"must tell a {kind}, but lie on a plane"):
        fit(kind, flat(noise))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_limits_of_other_kinds_are_refused(noise):
    rng = np.random.default_rng(0)
    for kind, simpler in (("cone", "cylinder"), ("torus", "cylinder"), ("torus", "sphere")):
        points = local_points(simpler, rng, 500, arc=4.0)[0]
        points = points + rng.normal(0.0, noise, points.shape)
        with pytest.raises(ValueError, match=f"must tell a {kind}, but lie on a {simpler}"):
            fit(kind, points)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 3)), "must hold at least . returns, since a"),
        (np.ones((50, 3)), "must hold at least . different ones"),
        (np.full((50, 3), np.nan), "must hold at least . returns"),
        (np.outer(np.arange(50.0), [1.0, 2.0, 3.0]), "but lie on a plane as well"),
        (np.zeros((50, 2)), "points must"),
    ],
)
def test_what_determines_nothing_is_refused(kind, points, message):
    with pytest.raises(ValueError, match=message):
        fit(kind, points)


def test_arguments_are_checked():
    ball = placed("sphere", np.random.default_rng(1), 100)[0]
    with pytest.raises(ValueError, match=r"outliers must be below 0\.5, not 0\.5"):
        primfit.fit_sphere(ball, outliers=0.5)
    with pytest.raises(ValueError, match="sigma"):
        primfit.fit_sphere(ball, sigma=-1.0)
    with pytest.raises(ValueError, match="n_jobs"):
        primfit.fit_sphere(ball, n_jobs=0)
    with pytest.raises(ValueError, match="origins"):
        primfit.fit_sphere(ball, np.zeros((7, 3)))
