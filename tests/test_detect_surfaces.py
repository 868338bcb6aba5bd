"""Planes and curved surfaces of clouds of which nothing is known."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from round_surfaces import local_points, rotation
from scipy import ndimage

import primfit

sys.path.append(str(Path(__file__).parents[1] / "benches"))
from surface_scenes import SCENES, Primitive, mixed, rack, table
from surfaces import judged, ours

KINDS = ("plane", "sphere", "cylinder", "cone", "torus")


@pytest.fixture(scope="module")
def small():
    """One of each kind apart from the others, with noise and clutter; and which point is whose."""
    rng = np.random.default_rng(7)
    points = [np.column_stack([rng.uniform(-0.5, 0.5, (3000, 2)), np.zeros(3000)])]
    points += [local_points(kind, rng, 3000, arc=4.0)[0] for kind in KINDS[1:]]
    points = [p @ rotation(rng).T + [2.5 * i, 0.0, 0.0] for i, p in enumerate(points)]
    cloud = np.vstack(points) + rng.normal(0.0, 0.003, (15000, 3))
    clutter = rng.uniform(cloud.min(axis=0), cloud.max(axis=0), (600, 3))
    truth = np.append(np.repeat(np.arange(5), 3000), np.full(600, -1))
    return np.vstack([cloud, clutter]), truth


@pytest.fixture(scope="module")
def found(small):
    return primfit.detect_surfaces(small[0])


def test_each_kind_is_found_as_what_it_is(small, found):
    truth = small[1]
    assert sorted(found.kinds) == sorted(KINDS)
    for number, kind in enumerate(KINDS):
        label = found.kinds.index(kind)
        own, labelled = truth == number, found.labels == label
        assert (own & labelled).sum() / (own | labelled).sum() > 0.9
    (sphere,), (cylinder,) = found.spheres, found.cylinders
    (cone,), (torus,) = found.cones, found.tori
    for value, expected, sigma in (
        (sphere.radius, 0.5, sphere.sigmas["radius"]),
        (cylinder.radius, 0.3, cylinder.sigmas["radius"]),
        (cone.angle, 0.4, cone.sigmas["angle"]),
        (torus.major_radius, 0.6, torus.sigmas["major_radius"]),
        (torus.radius, 0.2, torus.sigmas["radius"]),
    ):
        assert abs(value - expected) < 4.0 * sigma
        assert sigma < 0.001
    assert found.sigma == pytest.approx(0.003, rel=0.15)
    assert [np.array_equal(s.inliers, np.flatnonzero(found.labels == i))
            for i, s in enumerate(found)] == [True] * 5  # fmt: skip
    assert repr(found).startswith("Surfaces(1 plane, 1 sphere, 1 cylinder, 1 cone, 1 torus; 9")


def test_neither_the_order_of_rows_nor_threads_matter(small, found):
    points, _ = small
    order = np.random.default_rng(3).permutation(len(points))
    again = primfit.detect_surfaces(points[order], n_jobs=3)
    assert again.kinds == found.kinds
    assert np.array_equal(again.labels, found.labels[order])
    for a, b in zip(again, found, strict=True):
        assert np.array_equal(a.covariance, b.covariance, equal_nan=True)


def test_unwanted_kinds_stay_without_label_and_force_nothing(small, found):
    only = primfit.detect_surfaces(small[0], kinds=("cylinder",))
    assert only.kinds == ("cylinder",)
    label = found.kinds.index("cylinder")
    assert np.array_equal(only.labels == 0, found.labels == label)


def test_scattered_points_are_no_surface():
    points = np.random.default_rng(0).uniform(size=(5000, 3))
    assert len(primfit.detect_surfaces(points)) == 0


def test_too_few_points_and_bad_arguments(small):
    assert len(primfit.detect_surfaces(np.zeros((3, 3)))) == 0
    with pytest.raises(ValueError, match="points must hold at least 3 returns"):
        primfit.detect_surfaces(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="kinds must be one of 'plane', 'sphere'"):
        primfit.detect_surfaces(small[0], kinds=("ball",))
    with pytest.raises(ValueError, match="kinds must name at least one"):
        primfit.detect_surfaces(small[0], kinds=())
    with pytest.raises(ValueError, match="min_points must be at least 10"):
        primfit.detect_surfaces(small[0], min_points=3)


def test_planes_alone_are_those_of_flat_parts():
    rng = np.random.default_rng(5)
    floor, front, side = rng.uniform(-1.0, 1.0, (3, 4000, 3))
    floor[:, 2], front[:, 1], side[:, 0] = -1.0, 1.0, 1.0
    points = np.vstack([floor, front, side]) + rng.normal(0.0, 0.003, (12_000, 3))
    found = primfit.detect_surfaces(points)
    assert found.kinds == ("plane",) * 3
    assert (found.labels >= 0).mean() > 0.97


def test_errors_that_are_alike_leave_a_can_a_cylinder():
    kinds = [found.kinds for found in (primfit.detect_surfaces(*_can(seed)) for seed in (1, 2, 3))]
    assert all(found == ("plane", "cylinder") for found in kinds), kinds


def _can(seed):
    """A can and a wall before a depth camera whose errors are alike over some pixels; and where that was."""
    rng = np.random.default_rng(seed)
    can = Primitive("cylinder", np.eye(3), np.array([0.0, 0.9, 0.0]), (0.08,), (-0.1, 0.1))
    x, z = np.meshgrid(np.linspace(-0.2, 0.2, 150), np.linspace(-0.2, 0.2, 150))
    beams = np.column_stack([x.ravel(), np.ones(x.size), z.ravel()])
    beams /= np.linalg.norm(beams, axis=1)[:, None]
    noise = ndimage.gaussian_filter(rng.normal(size=x.shape), 1.0)
    wall = 1.2 / beams[:, 1]
    ranges = np.minimum(can.hit(np.zeros(3), beams), wall) + 0.001 * (noise / noise.std()).ravel()
    return ranges[:, None] * beams, np.zeros(3)


def test_a_pipe_in_a_scan_is_convex():
    pipe = Primitive("cylinder", np.eye(3), np.array([2.0, 0.0, 0.0]), (0.2,), (-1.0, 1.0))
    rng = np.random.default_rng(1)
    across, up = (
        x.ravel() for x in np.meshgrid(np.linspace(-0.2, 0.2, 90), np.linspace(-0.3, 0.3, 90))
    )
    beams = np.column_stack([np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)])
    ranges = pipe.hit(np.zeros(3), beams)
    ranges = np.where(np.isfinite(ranges), ranges + rng.normal(0.0, 0.003, len(ranges)), np.inf)
    scan = primfit.Scan.from_rays((0, 0, 0), beams, ranges)
    found = primfit.detect_surfaces(scan)
    assert found.kinds == ("cylinder",)
    assert found[0].is_convex
    assert abs(found[0].radius - 0.2) < 4.0 * found[0].sigmas["radius"]
    assert (found.labels[~scan.is_return] == -1).all()


@pytest.mark.parametrize(
    ("scene", "least"),
    [(lambda: mixed(101, 60_000), 0.9), (lambda: rack(101), 0.75), (lambda: table(101), 0.75)],
    ids=["mixed", "rack", "table"],
)
def test_scenes(scene, least):
    scene = scene()
    (found,) = ours(scene)
    figures = judged(scene, found)
    for name in ("recall", "kind", "precision"):
        assert np.mean(figures[name]) >= least, (name, figures[name])


def test_scenes_are_the_same_by_seed():
    for name in ("mixed", "crowded", "flat"):
        make = SCENES[name]
        assert np.array_equal(make(5).points, make(5).points)


@pytest.mark.skipif(
    signal.getsignal(signal.SIGINT) is not signal.default_int_handler, reason="SIGINT is ignored"
)
def test_ctrl_c_ends_it():
    points = np.random.default_rng(0).uniform(size=(400_000, 3))
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        primfit.detect_surfaces(points)
    assert time.monotonic() - start < 60.0


def test_planes_and_curved_surfaces_are_surfaces(small, found):
    points = np.random.default_rng(2).uniform(-2.0, 2.0, (50, 3))
    step = 1e-6
    for surface in found:
        assert isinstance(surface, primfit.Surface)
        assert surface.covariance.shape == (len(surface.parameters),) * 2
        assert all(sigma > 0.0 for sigma in surface.sigmas.values())
        normals = surface.normals(points)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        rise = (surface.distances(points + step * normals) - surface.distances(points)) / step
        np.testing.assert_allclose(rise, 1.0, atol=1e-3)
        off = surface.distances(small[0][surface.inliers])
        assert np.sqrt((off**2).mean()) == pytest.approx(surface.rms, rel=0.05)
