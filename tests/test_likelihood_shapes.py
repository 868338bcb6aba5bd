"""Families of footprints: corners by parameters, relatives, and what is proper."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import primfit
from primfit.geometry.footprints import signed_area
from primfit.likelihood.footprint_models import (
    CIRCLE,
    ELLIPSE,
    RECTANGLE,
    SQUARE,
    STARS,
    TEMPLATES,
    FreePolygon,
    related,
)
from primfit.likelihood.settings import ModelSettings

HOW = ModelSettings()


@pytest.mark.parametrize(
    "template", [*TEMPLATES, ELLIPSE], ids=lambda each: f"{each.kind}{each.axes.shape[1]}"
)
def test_templates_are_the_kinds_of_solids(template):
    sizes = template.sizes_of_area(0.05)[0]
    parameters = template.together(np.array([0.3, -0.2, 0.25]), np.array(sizes))
    outline = template.footprints(parameters[None])[0]
    solid = primfit.Prism(outline)
    assert solid.kind == template.kind
    assert solid.angle == pytest.approx(0.25 if solid.kind != "circle" else 0.0)
    np.testing.assert_allclose(solid.size, sizes if len(sizes) == 2 else sizes[0])
    steps = 1e-6 * np.eye(len(parameters))
    ends = template.footprints(np.concatenate([parameters + steps, parameters - steps]))
    slopes = (ends[: len(steps)] - ends[len(steps) :]).reshape(len(steps), -1).T / 2e-6
    corners, changes = template.frame(parameters)
    np.testing.assert_allclose(corners, outline, atol=1e-15)
    np.testing.assert_allclose(changes, slopes, atol=1e-8)


def test_relatives_start_where_the_other_is():
    for shape, parameters, kind in (
        (RECTANGLE, [1.0, 2.0, 0.3, 0.21, 0.2], "square"),
        (CIRCLE, [1.0, 2.0, 0.2], "ellipse"),
        (ELLIPSE, [1.0, 2.0, 0.3, 0.21, 0.2], "circle"),
        (SQUARE, [1.0, 2.0, 0.3, 0.2], "rectangle"),
        (STARS[5], [1.0, 2.0, 0.3, 0.2, 0.15], "pentagon"),
        (FreePolygon(5), [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.5, 1.001, 0.0, 1.0], "polygon"),
    ):
        parameters = np.array(parameters)
        starts = related(shape, parameters, HOW)
        other, start = next(each for each in starts if each[0].kind == kind)
        mine = shapely.Polygon(shape.footprints(parameters[None])[0])
        both = mine.intersection(shapely.Polygon(other.footprints(start[None])[0]))
        assert both.area > 0.9 * mine.area
    others = related(RECTANGLE, np.array([1.0, 2.0, 0.3, 0.4, 0.2]), HOW)
    assert [other.kind for other, _ in others] == ["ellipse"]
    assert not related(STARS[5], np.array([1.0, 2.0, 0.3, 0.2, 0.08]), HOW)


@pytest.mark.parametrize("template", [SQUARE, RECTANGLE, TEMPLATES[0], TEMPLATES[3]])
def test_a_polygon_that_is_of_a_kind_has_it_for_a_relative(template):
    sizes = [0.5, 0.3][: template.n_sizes]
    corners = template.footprints(np.array([[1.0, 2.0, 0.7, *sizes]]))[0]
    shape = FreePolygon(len(corners))
    starts = dict(related(shape, corners.ravel(), HOW))
    np.testing.assert_allclose(template.footprints(starts[template][None])[0], corners, atol=1e-12)


@given(st.lists(st.tuples(*[st.integers(0, 6)] * 2), min_size=3, max_size=8, unique=True))
def test_polygons_are_proper_when_geos_says_so(corners):
    """On a coarse grid, where sides often touch or lie on one line."""
    outline = np.array(corners, dtype=float)
    proper = FreePolygon(len(corners)).is_proper(outline.reshape(1, -1))[0]
    assert proper == shapely.is_valid(shapely.Polygon(outline))


@pytest.mark.parametrize("model", [CIRCLE, ELLIPSE], ids=lambda each: each.kind)
def test_polygons_of_round_models_have_the_area_of_the_curve(model):
    sizes = np.array([0.3, 0.2][: model.n_sizes])
    parameters = model.together(np.array([0.5, -0.5, 0.4]), sizes)[None]
    corners = model.footprints(parameters)[0]
    assert signed_area(corners) == pytest.approx(np.pi * sizes[0] * sizes[-1])
    ends = model.points(parameters)[0]
    np.testing.assert_allclose(ends.mean(axis=0), [0.5, -0.5])
    lengths = np.linalg.norm(ends[:2] - ends[2:], axis=1)
    np.testing.assert_allclose(lengths, 2 * sizes[[0, -1]])
