"""Kinds within a tolerance, and what it adds to what is not known."""

from __future__ import annotations

import json

import numpy as np
import pytest
from small_maps import in_room, scanned, scene_of

import primfit
from primfit.likelihood.final_fit import model_error
from primfit.likelihood.fitting import Fit
from primfit.likelihood.footprint_models import RECTANGLE, SQUARE

EXACT = {
    "triangle": primfit.Prism.regular(3, 0.3, center=(0.5, 0.48), angle=0.4),
    "square": primfit.Prism.regular(4, 0.24, center=(0.5, 0.52), angle=0.4),
    "rectangle": primfit.Prism.rectangle(0.3, 0.18, center=(0.52, 0.5), angle=0.4),
    "pentagon": primfit.Prism.regular(5, 0.18, center=(0.48, 0.5), angle=0.4),
}


def kinds(scan, **options):
    return [each.kind for each in primfit.detect(scan, rng=1, **options).solids]


@pytest.mark.parametrize("kind", EXACT)
def test_corners_that_are_off_by_a_hundredth_of_the_size(kind):
    exact = EXACT[kind]
    rng = np.random.default_rng(len(kind))
    size = np.sqrt(exact.shadow.area)
    turn = rng.uniform(0.0, 2 * np.pi, len(exact.footprint))
    off = 0.01 * size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    solid = primfit.Prism(exact.footprint + off)
    assert solid.kind == "polygon"
    found = primfit.detect(scanned(in_room(solid), 0.0, 1), rng=1)
    assert [each.kind for each in found.solids] == [kind]
    (one,) = found.solids
    assert 0.0 < one.tolerance_sigma <= 0.02 * size
    spread = np.sqrt(np.diag(one.covariance)[:2] + one.tolerance_sigma**2)
    assert (np.abs(one.center - solid.center)[:2] < 5.0 * spread).all()


@pytest.mark.parametrize(
    ("ratio", "tolerance", "kind"),
    [
        (1.02, 0.0, "rectangle"),
        (1.15, None, "rectangle"),
        (1.15, 0.02, "square"),
        # No more than a tenth of the size.
        (1.6, 10.0, "rectangle"),
    ],
)
def test_a_rectangle_that_is_nearly_a_square(ratio, tolerance, kind):
    solid = primfit.Prism.rectangle(0.22 * ratio, 0.22, center=(0.5, 0.5), angle=0.3)
    assert kinds(scanned(in_room(solid), 0.0, 1), tolerance=tolerance) == [kind]


@pytest.mark.parametrize("tolerance", [-0.01, float("nan"), float("inf"), "wide"])
def test_what_is_no_tolerance(small_scan, tolerance):
    with pytest.raises((ValueError, TypeError), match="tolerance must be"):
        primfit.detect(small_scan, tolerance=tolerance)


def test_the_covariance_is_that_of_the_noise():
    scan = scanned(in_room(EXACT["square"]), 0.02, 1)
    strict, tolerant = (primfit.detect(scan, rng=1, tolerance=each) for each in (0.0, None))
    one, two = strict.solids[0], tolerant.solids[0]
    ratio = np.diag(two.covariance) / np.diag(one.covariance)
    # Both are known from some hundred draws.
    assert (np.abs(np.log(ratio)) < np.log(2.0)).all()
    assert one.tolerance_sigma == 0.0
    assert 0.0 <= two.tolerance_sigma < 0.005
    for each in (one, two):
        content = json.loads(json.dumps(each.to_dict()))
        assert content["tolerance_sigma"] == each.tolerance_sigma


@pytest.mark.parametrize("off", [0.0, 0.001, 0.003, -0.002])
def test_walls_that_are_off_have_that_model_error(off):
    """All walls of a square stand outside by as much."""
    solid = EXACT["square"]
    _, beams = scene_of(solid, 0.0)
    parameters = np.array([*solid.center[:2], solid.angle, solid.size + 2.0 * off])
    error, most = model_error(beams, Fit(SQUARE, parameters, np.eye(4), 0.0), solid.height)
    assert error == pytest.approx(abs(off), rel=0.02, abs=1e-5)
    assert error <= most == pytest.approx(abs(off), rel=0.02, abs=2e-5)


def test_a_pair_of_walls_that_is_off_has_the_mean_square_as_its_model_error():
    solid = EXACT["square"]
    _, beams = scene_of(solid, 0.0)
    sizes = [solid.size + 0.006, solid.size]
    parameters = np.array([*solid.center[:2], solid.angle, *sizes])
    error, _ = model_error(beams, Fit(RECTANGLE, parameters, np.eye(5), 0.0), solid.height)
    # Two of four walls by 3 mm.
    assert error == pytest.approx(0.003 / np.sqrt(2.0), rel=0.05)


def test_noise_is_no_model_error():
    solid = EXACT["square"]
    _, beams = scene_of(solid, 0.02)
    parameters = np.array([*solid.center[:2], solid.angle, solid.size])
    error, most = model_error(beams, Fit(SQUARE, parameters, np.eye(4), 0.0), solid.height)
    assert error < 3e-4
    assert error <= most < 2e-3
