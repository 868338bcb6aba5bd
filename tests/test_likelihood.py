"""Detection by the likelihood of all ranges: its kernels, its parts, and what it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from small_maps import ROOM, scanned, scene_of

import primfit
from primfit import _primfit
from primfit.clouds.noise import estimate_range_sigma
from primfit.likelihood.candidates import ranked
from primfit.likelihood.fitting import Fit, Top, climb, coarse_to_fine, find_top, sample_posterior
from primfit.likelihood.footprint_models import (
    RECTANGLE,
    REGULAR,
    SQUARE,
    STARS,
    FreePolygon,
)
from primfit.likelihood.hypotheses import Candidate
from primfit.likelihood.obstacles import Obstacle
from primfit.likelihood.settings import LikelihoodSettings

SAMPLING = LikelihoodSettings().sampling


@pytest.mark.parametrize("height", [0.05, 0.2])
def test_costs_are_those_of_the_ray_caster(height):
    star = primfit.Prism.star(5, 0.24, 0.12, center=(0.5, 0.5), height=height)
    scan = scanned(primfit.World([star], ROOM.arena), 0.05, 1)
    background, _ = primfit.RayCaster(ROOM).cast(scan.origins, scan.directions)
    expected, _ = primfit.RayCaster(primfit.World([star], ROOM.arena)).cast(
        scan.origins, scan.directions
    )
    foreseen, returned = (expected >= 0.01) & (expected <= 1.0), scan.is_return
    with np.errstate(invalid="ignore"):
        explained = np.minimum(0.5 * ((scan.ranges - expected) / 0.05) ** 2, 12.5)
    cost = np.where(foreseen & returned, explained, 0.0)
    cost[~foreseen & returned] = 12.5
    cost[foreseen & ~returned] = 7.5
    arrays = (scan.origins, scan.directions, scan.ranges, background, np.full(len(scan), 0.05))
    beams = _primfit.BeamBlocks(*map(np.ascontiguousarray, arrays), (0.01, 1.0), 12.5, 7.5)
    footprints = np.stack([star.footprint, star.footprint[::-1]])
    for n_jobs in (1, 2):
        got = beams.costs(footprints, np.zeros(2), np.full(2, height), n_jobs=n_jobs)
        np.testing.assert_allclose(got, cost.sum(), rtol=1e-7)
    local = beams.around(star.footprint, 0.0, height)
    assert not len(local.open)
    assert local.cost == pytest.approx(cost.sum(), rel=1e-7)
    tall = primfit.World([replace(star, height=5.0)])
    depths, ids = primfit.RayCaster(tall).cast(scan.origins, scan.directions)
    walls = ids == 0
    np.testing.assert_allclose(beams.wall_depths(star.footprint)[walls], depths[walls], atol=1e-6)


def test_the_expansion_has_the_slopes_of_the_cost():
    solid = primfit.Prism.regular(5, 0.2, center=(0.5, 0.5), angle=0.2, height=0.2)
    _, beams = scene_of(solid, 0.05)
    local = beams.around(solid.footprint, 0.2, 1e-4, 0.0)
    origins, directions, ranges, background, sigma = beams.arrays
    is_smooth = np.ones(len(beams), dtype=bool)
    is_smooth[local.open] = False

    def cost(footprint):
        prism = primfit.Prism(footprint, 0.2)
        depths, _ = primfit.RayCaster(primfit.World([prism])).cast(origins, directions)
        nearest = np.minimum(depths, background)
        costs = beams.model.costs(ranges, nearest, nearest, sigma, beams.limits)
        return costs[is_smooth].sum()

    step = 1e-6
    for k in range(10):
        moved = np.stack([solid.footprint.copy(), solid.footprint.copy()])
        moved[0].flat[k] += step
        moved[1].flat[k] -= step
        slope = (cost(moved[0]) - cost(moved[1])) / (2 * step)
        assert slope == pytest.approx(local.gradient[k], rel=1e-3, abs=1.0)


@pytest.mark.parametrize("noise", [0.01, 0.2])
def test_a_local_likelihood_is_the_whole_one(noise):
    solid = primfit.Prism.star(5, 0.24, 0.12, center=(0.5, 0.5), angle=0.3)
    _, beams = scene_of(solid, noise)
    slack = 0.1 * noise
    rng = np.random.default_rng(1)
    local = beams.around(solid.footprint, 0.2, slack, slack)
    assert 0 < len(local.open) < 0.7 * len(beams)
    moves = rng.uniform(-0.7 * slack, 0.7 * slack, (50, 10, 2))
    tops = 0.2 + rng.uniform(-slack, slack, 50)
    candidates = solid.footprint + moves
    family, parameters = FreePolygon(10).family, np.column_stack([candidates.reshape(50, 20), tops])
    got = local.costs(family, parameters)
    np.testing.assert_allclose(got, beams.costs(candidates, tops), rtol=2e-3, atol=2.0)
    np.testing.assert_array_equal(local.costs(family, parameters, n_jobs=2), got)
    assert np.isinf(local.costs(family, parameters + 2 * slack)).all()
    crossed = parameters.copy()
    crossed[:, [0, 1, 2, 3]] = crossed[:, [2, 3, 0, 1]]
    assert np.isinf(local.costs(family, crossed)).all()


def climbed_slowly(beams, shape, start, top, steps):
    """Parameters, cost and covariance as `climb` should find them."""

    def expanded(parameters):
        corners, changes = shape.frame(parameters)
        local = beams._core.around(corners, beams.floor_z, top)
        information = changes.T @ local.information @ changes
        scale = beams.stride
        return scale * local.cost, scale * changes.T @ local.gradient, scale * information

    parameters, damping = start, 1e-3
    cost, gradient, information = expanded(parameters)
    for _ in range(steps):
        diagonal = np.diag(information)
        damped = information + np.diag(damping * (diagonal + 1e-12 * diagonal.sum()))
        descent = np.linalg.solve(damped, gradient)
        if descent @ gradient / 2 < 0.1:
            break
        moved = parameters - descent
        if shape.is_proper(moved[None])[0] and (there := expanded(moved))[0] < cost:
            parameters, damping = moved, damping / 10
            cost, gradient, information = there
        else:
            damping *= 10
    return parameters, cost, np.linalg.inv(information)


@pytest.mark.parametrize(
    ("shape", "start"),
    [
        (RECTANGLE, [0.51, 0.49, 0.45, 0.31, 0.19]),
        (STARS[5], [0.5, 0.51, 0.3, 0.16, 0.1]),
        (FreePolygon(4), [0.38, 0.36, 0.66, 0.47, 0.61, 0.64, 0.33, 0.54]),
    ],
)
def test_climbs_end_where_a_slow_twin_does(shape, start):
    solid = primfit.Prism.rectangle(0.3, 0.2, center=(0.5, 0.5), angle=0.4)
    _, beams = scene_of(solid, 0.01)
    few = beams.thinned(2, 0.02)
    fit = climb(few, shape, np.array(start), 0.2, steps=7)
    parameters, cost, covariance = climbed_slowly(few, shape, np.array(start), 0.2, 7)
    np.testing.assert_allclose(fit.parameters, parameters, rtol=1e-6)
    assert fit.cost == pytest.approx(cost)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        fit.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-4
    )


def test_climbing_reaches_exact_corners_from_a_guess():
    solid = primfit.Prism.rectangle(0.3, 0.2, center=(0.5, 0.5), angle=0.4)
    _, beams = scene_of(solid, 0.0)
    start = np.array([0.51, 0.495, 0.5, 0.33, 0.18])
    fit = coarse_to_fine(beams, RECTANGLE, start, 0.2, 0.25)
    np.testing.assert_allclose(fit.parameters, [0.5, 0.5, 0.4, 0.3, 0.2], atol=1e-6)


@pytest.mark.parametrize("height", [0.04, 0.15])
def test_the_top_is_where_beams_begin_to_pass(height):
    solid = primfit.Prism.regular(4, 0.25, center=(0.5, 0.5), angle=0.3, height=height)
    _, beams = scene_of(solid, 0.01)
    top = find_top(beams, solid.footprint)
    assert top.z == pytest.approx(height, abs=max(4 * top.sigma, 1e-4))
    assert top.sigma < 0.005


def test_a_top_above_all_beams_is_not_known():
    solid = primfit.Prism.regular(4, 0.25, center=(0.5, 0.5), height=0.9)
    _, beams = scene_of(solid, 0.01)
    assert np.isnan(find_top(beams, solid.footprint).sigma)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_noise_from_neighbouring_beams(noise):
    scan = scanned(primfit.random_world(rng=5), noise, 5)
    estimate = estimate_range_sigma(scan, np.random.default_rng(1))
    assert estimate == pytest.approx(noise, rel=0.1, abs=2e-4)


@pytest.mark.parametrize("noise", [0.01, 0.03, 0.1])
def test_noise_of_a_spinning_sensor(noise):
    sizes = dict.fromkeys(("triangle", "square", "rectangle", "pentagon"), (1.0, 2.0))
    world = primfit.random_world(rng=5, size=20.0, sizes=sizes, height=2.0)
    lidar = primfit.Lidar.vlp16(mount=(0.0, 0.0, 1.0), noise=noise / 100.0)
    scan = primfit.scan(world, (2.0, 2.0, 0.0), lidar, rng=5)
    assert estimate_range_sigma(scan, np.random.default_rng(1)) == pytest.approx(noise, rel=0.06)


def test_noise_of_a_recorded_turn(data):
    sigmas = []
    for part in ("full", "target"):
        points = primfit.read_points(data / "vlp16_board" / f"pose3_{part}.pcd")
        scan = primfit.Scan.from_points(points, origins=(0.0, 0.0, 0.0))
        sigmas.append(estimate_range_sigma(scan, np.random.default_rng(1)))
    # The board's points have 13 to 18 mm about its plane, of which rings do not share all.
    assert 0.004 < min(sigmas) <= max(sigmas) < 0.018
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.3)


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_the_posterior_is_as_wide_as_its_errors(noise):
    """95 % regions of 40 solids hold the truth, up to chance."""
    levels = []
    for seed in range(40):
        world = primfit.random_world(1, 1.0, ["rectangle"], rng=seed + 9000)
        solid = world.solids[0]
        _, beams = scene_of(solid, noise, seed)
        truth = np.array([*solid.center[:2], solid.angle, *solid.size])
        fit = climb(beams, RECTANGLE, truth, 0.2)
        top = find_top(beams, solid.footprint)
        fit, _, _ = sample_posterior(
            beams, fit, top, np.random.default_rng(seed), SAMPLING.thorough
        )
        off = fit.parameters - truth
        levels.append(chi2.cdf(off @ np.linalg.solve(fit.covariance, off), len(off)))
    # Of 40, 33 or fewer inside would be rarer than one in ten thousand.
    assert sum(level <= 0.95 for level in levels) >= 34
    assert 8 <= sum(level <= 0.5 for level in levels) <= 32


def test_a_kind_that_is_wrong_does_not_flee_from_its_beams():
    """Where any pentagon explains less than nothing would."""
    solid = primfit.Prism.regular(4, 0.2, center=(0.5, 0.5), height=0.2)
    _, beams = scene_of(solid, 0.0)
    few = beams.subset(16)
    start = np.array([0.5, 0.5, 0.0, 0.12])
    fit = climb(few, REGULAR[5], start, 0.2)
    top = find_top(few, solid.footprint)
    fit, _, found = sample_posterior(few, fit, top, np.random.default_rng(1), SAMPLING.quick)
    assert np.linalg.norm(fit.parameters[:2] - start[:2]) < 0.5
    assert found.log_evidence < -100.0


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("n_corners", [3, 4, 5])
def test_small_solids_that_hardly_leave_a_seed(n_corners, noise):
    size = 0.12 / np.sqrt(n_corners)
    solid = primfit.Prism.regular(n_corners, size, center=(0.5, 0.5), angle=0.1, height=0.2)
    world = primfit.World([solid], ROOM.arena)
    assert primfit.evaluate(primfit.detect(scanned(world, noise, 1), rng=1), world).all_right


@pytest.mark.parametrize(("noise", "most_mm"), [(0.0, 0.01), (0.05, 0.4), (0.2, 0.6)])
def test_a_map_at_any_noise(noise, most_mm):
    world = primfit.random_world(rng=601)
    found = primfit.detect(scanned(world, noise, 601), rng=1)
    assert found.method == "likelihood"
    report = primfit.evaluate(found, world)
    assert not report.missed
    assert not report.spurious
    assert report.n_right >= len(world.solids) - (noise > 0.1)
    assert np.median([row.center_error_mm for row in report.rows]) < most_mm
    np.testing.assert_allclose(found.arena.size, (2.0, 2.0), atol=max(0.1 * noise, 1e-3))
    assert report.n_planes == report.n_planes_true
    for row in report.rows:
        solid = found.solids[row.detection]
        assert solid.height == pytest.approx(0.2, abs=max(4 * solid.height_sigma, 2e-3))


def test_bits_do_not_depend_on_threads(small_scan):
    one = primfit.detect(small_scan, method="likelihood", rng=1, n_jobs=1)
    two = primfit.detect(small_scan, method="likelihood", rng=1, n_jobs=2)
    assert one.to_json() == two.to_json()


def test_progress_ends_at_all(small_scan):
    seen = []
    primfit.detect(small_scan, rng=1, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]


def test_a_bare_cloud_is_refused_by_name_and_has_its_own_default(small_scan):
    points = small_scan.points[small_scan.is_return]
    with pytest.raises(ValueError, match="scan must have origins for method='likelihood'"):
        primfit.detect(points, method="likelihood")
    # Upright walls whose tops nobody saw: without origins the paper's method tells more of them.
    assert primfit.detect(points, rng=1).method == "paper"
    from_one_place = primfit.Scan.from_points(points, origins=(0.5, 0.5, 3.0), sigma=0.005)
    assert primfit.choose_method(from_one_place)[0] == "likelihood"


def test_a_cloud_stands_for_its_points(small_scan):
    points = small_scan.points[small_scan.is_return]
    cloud = primfit.Cloud(points, {"label": np.arange(len(points))})
    assert primfit.detect(cloud, rng=1).to_json() == primfit.detect(points, rng=1).to_json()
    assert len(primfit.detect_planes(cloud)) == len(primfit.detect_planes(points))


def test_what_detect_does_not_take(small_scan):
    with pytest.raises(FileNotFoundError, match=r"there is no file scan\.npz"):
        primfit.detect("scan.npz")
    with pytest.raises(TypeError, match=r"options of method='likelihood' are sigma, .*; not noise"):
        primfit.detect(small_scan, noise=0.05)
    with pytest.raises(ValueError, match="rng must be None, an integer of at least 0 or a"):
        primfit.detect(small_scan, rng=-1)


def test_obstacles_have_a_face_for_every_triangle():
    vertices, triangles, faces = Obstacle(np.array([[0.0, 0], [1, 0], [0, 1]]), 0.5).unit
    assert len(triangles) == len(faces)
    np.testing.assert_allclose([vertices[:, 2].min(), vertices[:, 2].max()], [0.0, 1.0])
    top = triangles[faces == 3]
    np.testing.assert_allclose(vertices[top, 2], 1.0)


@pytest.mark.parametrize(
    ("evidences", "n_corners"),
    [([-5.0, 0.0, -900.0], 8), ([-50.0, 0.0, -900.0], 9), ([-5.0, 0.0, 1.0], 4)],
    ids=["as likely", "less likely", "a known kind"],
)
def test_of_free_polygons_about_as_likely_the_simplest_wins(evidences, n_corners):
    rivals = [
        Candidate(
            Fit(shape, np.ones(8), np.eye(8), -evidence),
            Top(1.0, 0.1),
            np.ones(8),
            evidence,
            evidence,
            cost=-evidence,
        )
        for shape, evidence in zip((FreePolygon(8), FreePolygon(9), SQUARE), evidences, strict=True)
    ]
    how = LikelihoodSettings().selection
    shape = ranked(rivals, how.rival_gain, how)[0].fit.shape
    assert (4 if shape is SQUARE else shape.n_corners) == n_corners
