"""Detection by the likelihood of all ranges."""

from __future__ import annotations

import numpy as np
import pytest

import primfit
from primfit import _primfit
from primfit.sampling import sample
from primfit.templates import TEMPLATES


def scanned(world, noise, seed, spacing=0.25):
    path = primfit.grid_path(world, spacing, rng=seed)
    return primfit.scan(world, path, primfit.Lidar(noise=noise), rng=seed)


@pytest.mark.parametrize("height", [0.05, 0.2])
def test_costs_are_those_of_the_ray_caster(height):
    star = primfit.Prism.star(5, 0.24, 0.12, center=(0.5, 0.5), height=height)
    room = primfit.World([], primfit.Arena((1, 1)))
    scan = scanned(primfit.World([star], room.arena), 0.05, 1)
    background, _ = primfit.RayCaster(room).cast(scan.origins, scan.directions)
    expected, _ = primfit.RayCaster(primfit.World([star], room.arena)).cast(
        scan.origins, scan.directions
    )
    foreseen, returned = expected <= 1.0, scan.is_return
    with np.errstate(invalid="ignore"):
        explained = np.minimum(0.5 * ((scan.ranges - expected) / 0.05) ** 2, 12.5)
    cost = np.where(foreseen & returned, explained, 0.0)
    cost[foreseen != returned] = 12.5
    arrays = (scan.origins, scan.directions, scan.ranges, background, np.full(len(scan), 0.05))
    footprints = np.stack([star.footprint, star.footprint[::-1]])
    for n_jobs in (1, 2):
        got = _primfit.prism_costs(
            *map(np.ascontiguousarray, arrays),
            1.0,
            12.5,
            footprints,
            np.zeros(2),
            np.full(2, height),
            n_jobs,
        )
        np.testing.assert_allclose(got, cost.sum(), rtol=1e-9)


def test_the_sampler_finds_a_normal_posterior():
    truth = np.array([1.0, -2.0, 0.5])
    covariance = np.diag([1e-4, 1e-2, 1.0]) + 0.001
    precision = np.linalg.inv(covariance)

    def cost(x):
        return 0.5 * np.einsum("ni,ij,nj->n", x - truth, precision, x - truth)

    found = sample(cost, np.zeros(3), np.eye(3), np.random.default_rng(1), n=200, generations=60)
    assert found.temperature == 1.0
    z = (found.mean - truth) / np.sqrt(np.diag(covariance))
    assert np.abs(z).max() < 0.5
    ratio = np.diag(found.covariance) / np.diag(covariance)
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda each: each.kind)
def test_templates_are_the_kinds_of_solids(template):
    sizes = template.sizes_of_area(0.05)[0]
    outline = template.footprints(np.array([[0.3, -0.2, 0.25, *sizes]]))[0]
    solid = primfit.Prism(outline)
    assert solid.kind == template.kind
    assert solid.angle == pytest.approx(0.25)
    np.testing.assert_allclose(solid.size, sizes if len(sizes) == 2 else sizes[0])


@pytest.mark.parametrize(("noise", "most_mm"), [(0.0, 0.05), (0.05, 0.6), (0.2, 1.0)])
def test_a_map_at_any_noise(noise, most_mm):
    world = primfit.random_world(rng=601)
    found = primfit.detect(scanned(world, noise, 601), method="likelihood", rng=1)
    report = primfit.evaluate(found, world)
    assert not report.missed
    assert not report.spurious
    assert report.n_right >= len(world.solids) - 1
    assert np.median([row.center_error_mm for row in report.rows]) < most_mm
    np.testing.assert_allclose(found.arena.size, (2.0, 2.0), atol=max(0.1 * noise, 1e-3))


def test_eight_planes_for_a_square_and_its_height():
    solid = primfit.Prism.regular(4, 0.25, center=(0.5, 0.5), angle=0.3, height=0.15)
    world = primfit.World([solid], primfit.Arena((1, 1)))
    found = primfit.detect(scanned(world, 0.05, 1, 0.125), method="likelihood", rng=1)
    assert len(found.planes) == 8
    assert [each.kind for each in found.solids] == ["square"]
    assert found.solids[0].height == pytest.approx(0.15, abs=0.01)
    assert found.solids[0].sigmas["height"] < 0.01


def test_without_an_arena():
    solid = primfit.Prism.regular(3, 0.3, center=(0.2, 0.1), angle=0.3)
    world = primfit.World([solid])
    found = primfit.detect(scanned(world, 0.05, 1, 0.2), method="likelihood", rng=1)
    assert found.arena is None
    assert [each.kind for each in found.solids] == ["triangle"]


def test_bits_do_not_depend_on_threads(small_scan):
    one = primfit.detect(small_scan, method="likelihood", rng=1, n_jobs=1)
    two = primfit.detect(small_scan, method="likelihood", rng=1, n_jobs=2)
    assert one.to_json() == two.to_json()


def test_a_bare_cloud_is_refused(small_scan):
    with pytest.raises(ValueError, match="scan must have origins for method='likelihood'"):
        primfit.detect(small_scan.points[small_scan.is_return], method="likelihood")
