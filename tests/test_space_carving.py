"""Free space: layers of cells that beams crossed and passed, and the regions that are left."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from small_maps import in_room, rays_of, scanned

import primfit
from primfit import _primfit
from primfit.likelihood.environment import initial_scene
from primfit.likelihood.settings import LikelihoodSettings
from primfit.likelihood.space_carving import carve


def carved(scan):
    sigma = np.full(len(scan), scan.sigma or 0.0)
    scene, _ = initial_scene(scan, sigma, LikelihoodSettings(), 1)
    return carve(scene)


def carved_slowly(origins, directions, spans, low, cell, shape, heights):
    """Counts of each cell and layer: beams in steps of a cell, in the middle of each step."""
    counts = np.zeros((*shape, len(heights) - 1, 2), dtype=int)
    for origin, direction, start, passed, end in zip(origins, directions, *spans, strict=True):
        first, n_passed, last = (int(np.floor(each / cell + 0.5)) for each in (start, passed, end))
        for step in range(first, last):
            x, y, z = origin + (step + 0.5) * cell * direction
            i, j = int(np.floor((x - low[0]) / cell)), int(np.floor((y - low[1]) / cell))
            layer = int(np.searchsorted(heights, z, side="right")) - 1
            if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= layer < len(heights) - 1:
                counts[i, j, layer] += [1, step < n_passed]
    return counts


@pytest.mark.parametrize("heights", [[-0.1, 0.2], [-0.2, -0.05, 0.0, 0.1, 0.35]])
def test_carving_counts_cells_like_a_slow_twin(heights):
    rng = np.random.default_rng(3)
    n, cell = 300, 0.07
    origins = rng.uniform(-0.5, 0.5, (n, 3))
    directions = rng.normal(size=(n, 3))
    directions[:20, 2] = 0.0
    directions[20:25, :2] = 0.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    starts = np.where(rng.random(n) < 0.5, 0.0, rng.uniform(0.0, 0.4, n))
    passed, ends = rng.uniform(0.0, 1.2, n), rng.uniform(0.2, 1.2, n)
    shape, low = (20, 25), (-0.7, -0.8)
    where = (low, cell, shape, np.array(heights))
    expected = carved_slowly(origins, directions, (starts, passed, ends), *where)
    assert expected[..., 1].any()
    for n_jobs in (1, 2):
        got = _primfit.carve(origins, directions, starts, passed, ends, *where, n_jobs)
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("height", [0.04, 0.2])
def test_what_is_left_is_where_the_solid_stands(height):
    solid = primfit.Prism.regular(4, 0.24, center=(0.5, 0.5), angle=0.4, height=height)
    space = carved(scanned(in_room(solid), 0.0, 1))
    walls = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    (region,) = space.regions(walls)
    assert space.cell < 0.01
    np.testing.assert_allclose(region.center, [0.5, 0.5], atol=space.cell)
    assert (
        shapely.Polygon(solid.footprint)
        .buffer(1.5 * space.cell)
        .contains(shapely.Polygon(region.outline))
    )
    assert region.area == pytest.approx(0.24**2, rel=0.15)
    # Beams that pass over a low solid free no cell below its top.
    assert region.top < height * LikelihoodSettings().carving.layer_ratio


def test_beams_free_cells_only_above_where_they_passed():
    low = primfit.Prism.regular(4, 0.24, center=(0.5, 0.5), height=0.03)
    space = carved(scanned(in_room(low), 0.0, 1))
    i, j = space.cells_of(np.array([[0.5, 0.5]]))[0]
    is_free = space.is_free[:, i, j]
    assert not is_free[space.heights < 0.03].any()
    assert is_free[-1]


def test_a_pose_that_is_too_near_frees_nothing():
    """Most beams of these poses meet the solid within the shortest range, and return nothing."""
    solid = primfit.Prism.regular(4, 0.24, center=(0.5, 0.5), height=0.3)
    world = in_room(solid)
    lidar = primfit.Lidar(min_range=0.06, field_of_view=4.0)
    around = primfit.grid_path(world, 0.25, headings=1, rng=1)
    path = np.concatenate([around, [(0.65, 0.5 + y, np.pi) for y in np.arange(-4, 5) / 50]])
    scan = primfit.scan(world, path, lidar, rng=1)
    assert (~scan.is_return[scan.pose_index >= len(around)]).mean() > 0.2
    places = np.array([[0.5, 0.5], [0.42, 0.5], [0.5, 0.58]])
    for each in (scan, rays_of(scan, min_range=None)):
        space = carved(each)
        i, j = space.cells_of(places).T
        assert not space.is_free[-1, i, j].any()
    # Were there no shortest range, what these beams passed would be free.
    wrong = carved(rays_of(scan, min_range=0.0))
    i, j = wrong.cells_of(places).T
    assert wrong.is_free[-1, i, j].any()


def test_cells_follow_the_scene_and_not_the_reach():
    scan = scanned(in_room(primfit.Prism.regular(3, 0.3, center=(0.5, 0.5))), 0.0, 1, max_range=10)
    near, far = (carved(rays_of(scan, max_range=reach)) for reach in (10.0, 1000.0))
    assert near.cell == far.cell
    np.testing.assert_array_equal(near.is_free, far.is_free)
