"""Circles and ellipses, and the polygons that stand for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import primfit
from primfit.geometry import footprints
from primfit.results import Detection
from primfit.solids.found import FoundSolid

angles = st.floats(0, 2 * np.pi)
places = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
sizes = st.floats(1e-2, 1e2)


def circular(difference, period):
    return abs((difference + period / 2) % period - period / 2)


def turned(outline, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(outline) @ np.array([[c, s], [-s, c]])


@settings(max_examples=60, deadline=None)
@given(sizes, places, angles)
def test_circle(radius, center, angle):
    solid = primfit.Prism.circle(radius, center=center)
    again = primfit.Prism(turned(solid.footprint, angle))
    for each in (solid, again):
        assert (each.kind, each.angle) == ("circle", 0.0)
        assert each.size == pytest.approx(radius, rel=1e-9)
    np.testing.assert_allclose(solid.center[:2], center, atol=1e-9)
    assert footprints.symmetry_angle(solid.footprint) == 0.0


@settings(max_examples=60, deadline=None)
@given(sizes, st.floats(0.05, 0.99), places, angles, angles)
def test_ellipse(long, ratio, center, angle, more):
    solid = primfit.Prism.ellipse(long, ratio * long, center=center, angle=angle)
    again = primfit.Prism(turned(solid.footprint[::-1], more))
    for each, turn in ((solid, angle), (again, angle + more)):
        assert each.kind == "ellipse"
        assert 0 <= each.angle < np.pi
        np.testing.assert_allclose(each.size, (long, ratio * long), rtol=1e-6)
        assert circular(each.angle - turn, np.pi) < 1e-5
    assert footprints.symmetry_angle(solid.footprint) == pytest.approx(np.pi)


def test_the_polygon_has_the_area_of_the_ellipse_and_hugs_it():
    solid = primfit.Prism.ellipse(0.5, 0.2)
    np.testing.assert_allclose(np.ptp(solid.footprint, axis=0), [1.0008, 0.4003], atol=1e-4)
    assert shapely.Polygon(solid.footprint).area == pytest.approx(np.pi * 0.5 * 0.2)
    in_axes = primfit.Prism.circle(1.0).footprint
    middles = (in_axes + np.roll(in_axes, 1, axis=0)) / 2
    assert np.linalg.norm(in_axes, axis=1).max() - 1 == pytest.approx(0.0008, abs=1e-5)
    assert 1 - np.linalg.norm(middles, axis=1).min() == pytest.approx(0.0004, abs=1e-5)


@pytest.mark.parametrize("n", [24, 31, 60, 180])
def test_other_regular_polygons_with_many_corners_are_round(n):
    outline = primfit.Prism.regular(n, 0.1, angle=0.3).footprint
    assert footprints.kind_of(outline) == "circle"
    stretched = turned(outline * (2.0, 1.0), 0.2)
    assert footprints.kind_of(stretched) == "ellipse"
    long, short = footprints.size_of(stretched)
    assert np.pi * long * short == pytest.approx(shapely.Polygon(stretched).area)
    assert long / short == pytest.approx(2.0)
    around = shapely.get_coordinates(shapely.Point(3, 4).buffer(0.3, quad_segs=16))
    assert primfit.Prism(around).kind == "circle"


def test_what_is_not_round():
    assert primfit.Prism.regular(23, 0.1).kind == "23-gon"
    assert primfit.Prism.star(16, 1.0, 0.8).kind == "star"
    dented = primfit.Prism.circle(0.2).footprint.copy()
    dented[5] *= 0.999
    assert footprints.kind_of(dented) == "polygon"
    assert footprints.kind_of(dented, 2e-3) == "circle"
    fit = footprints.fit_ellipse(dented)
    assert fit.misfit == pytest.approx(0.0002, rel=0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: primfit.Prism.circle(0.0), "radius must be greater than 0"),
        (lambda: primfit.Prism.circle(1.0, center=(0, 0, 0)), r"center must have shape \(2,\)"),
        (lambda: primfit.Prism.ellipse(1.0, 2.0), r"short must be at most long \(1\), not 2"),
        (lambda: primfit.Prism.ellipse(1.0, -2.0), "short must be greater than 0"),
    ],
)
def test_mistakes(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("seed", range(3))
def test_worlds_of_round_solids(seed, tmp_path):
    world = primfit.random_world(5, 2.0, ["circle", "ellipse"], rng=seed)
    assert {solid.kind for solid in world.solids} <= {"circle", "ellipse"}
    world.save(tmp_path / "world.json")
    again = primfit.World.load(tmp_path / "world.json")
    assert [s.kind for s in again.solids] == [s.kind for s in world.solids]
    for solid, other in zip(world.solids, again.solids, strict=True):
        assert other.size == solid.size
        low, high = (0.10, 0.17) if solid.kind == "circle" else (0.07, 0.11)
        assert low <= np.min(solid.size) <= high
    colors = {tuple(color) for color in world.matrix[world.mask].tolist()}
    assert len(colors) == len({solid.kind for solid in world.solids})


def test_ranges_to_a_circle():
    world = primfit.World([primfit.Prism.circle(0.2, center=(1, 0), height=1.0)])
    lidar = primfit.Lidar(1, 0.0, 100, 0.3, max_range=5.0, mount=(0, 0, 0.5))
    scan = primfit.scan(world, (0.0, 0.0, 0.0), lidar, rng=1)
    x, y = scan.directions[:, 0], scan.directions[:, 1]
    expected = x - np.sqrt(0.2**2 - y**2)
    np.testing.assert_allclose(scan.ranges, expected, atol=3e-4)


def found_as(world, footprint, kind):
    solid = FoundSolid.upright(
        kind, footprint, 0.0, 0.2, footprints.angle_of(footprint, kind),
        footprints.size_of(footprint, kind), np.eye(5), (), (),
    )  # fmt: skip
    scan = primfit.Scan.from_points(np.zeros((1, 3)))
    return Detection(scan, "planes", (), np.array([-1]), (solid,), None, None, 0.0, {})


def test_evaluation():
    truth = primfit.Prism.ellipse(0.2, 0.1, center=(1, 1), angle=0.1)
    world = primfit.World([truth])
    guess = primfit.Prism.ellipse(0.203, 0.1, center=(1, 1.002), angle=np.pi + 0.05)
    (row,) = primfit.evaluate(found_as(world, guess.footprint, "ellipse"), world).rows
    assert row.angle_error_deg == pytest.approx(np.degrees(0.05))
    assert row.size_error_mm == pytest.approx(3.0)
    assert row.center_error_mm == pytest.approx(2.0)
    circle = primfit.Prism.circle(0.14, center=(1, 1))
    report = primfit.evaluate(found_as(world, circle.footprint, "circle"), world)
    assert np.isnan(report.rows[0].angle_error_deg)
    round_world = replace(world, solids=(circle,))
    bigger = primfit.Prism.circle(0.141, center=(1, 1)).footprint
    report = primfit.evaluate(found_as(round_world, bigger, "circle"), round_world)
    assert report.all_right
    assert np.isnan(report.rows[0].angle_error_deg)
    assert report.rows[0].size_error_mm == pytest.approx(1.0)
    assert "circle" in str(report)
