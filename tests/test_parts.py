"""Planes of labelled parts, and what is told of a cloud by counting, against slow twins in NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from primfit import _primfit
from primfit.geometry.extents import half_extent, is_amid
from primfit.planes.ransac import NoisyPoints, Orientation, fit


def parts(rng, has_beams):
    """Points of four noisy planes, of a ball and of none, in any order, seen from one place."""
    pieces, labels = [], []
    for k in range(4):
        flat = rng.uniform(-1.0, 1.0, (50 + 400 * k, 3)) * [1.0, 0.6, 0.0]
        flat[:, 2] = 0.01 * rng.normal(size=len(flat))
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        pieces.append(flat @ turn + rng.uniform(2.0, 5.0, 3))
        labels.append(np.full(len(flat), k))
    ball = rng.normal(size=(200, 3))
    pieces.append(ball / np.linalg.norm(ball, axis=1)[:, None] + 8.0)
    labels.append(np.full(200, 4))
    pieces.append(rng.uniform(0.0, 5.0, (100, 3)))
    labels.append(np.full(100, -1))
    order = rng.permutation(sum(map(len, labels)))
    points, labels = np.concatenate(pieces)[order], np.concatenate(labels)[order]
    beams = points / np.linalg.norm(points, axis=1)[:, None] if has_beams else None
    return points, beams, labels, rng.uniform(0.002, 0.02, len(points))


def twin(points, beams, noise, wanted, limit):
    """Equation, covariance, rms, reach and inliers of one part, or None.

    Fits to ranges stop where a step would gain 1e-9 of the cost, so other starts give other digits.
    """
    middle = points.mean(axis=0)
    local = points - middle
    normal = np.linalg.eigh(local.T @ local)[1][:, 0]
    rms = np.sqrt(np.mean((local @ normal) ** 2))
    spread = max(rms, np.median(noise), 1e-6 * np.abs(local).max())
    facing = normal[np.abs(normal).argmax()] if beams is None else -(beams @ normal).sum()
    normal = np.copysign(1.0, facing) * normal
    start = np.append(normal, -normal @ middle)
    reach = 4.0 * spread if limit is None else limit
    each = np.full(len(points), spread)
    cloud = NoisyPoints(points, beams, each, each)
    model = fit(cloud, start, wanted)
    if model is None and beams is not None:
        model = fit(replace(cloud, directions=None), start, wanted)
    if model is None:
        return None
    distance = points @ model.equation[:3] + model.equation[3]
    if np.sqrt(np.mean(distance**2)) > 1.5 * spread:
        return None
    inliers = np.flatnonzero(np.abs(distance) <= reach)
    return model.equation, model.covariance, model.rms, reach, inliers


@pytest.mark.parametrize("has_beams", [False, True])
@pytest.mark.parametrize(
    ("orientation", "max_angle"), [("any", None), ("vertical", 0.6), ("vertical", None)]
)
@pytest.mark.parametrize("limit", [None, 0.02])
def test_planes_of_parts_are_those_of_each_by_itself(has_beams, orientation, max_angle, limit):
    points, beams, labels, noise = parts(np.random.default_rng(5), has_beams)
    wanted = Orientation.of(orientation, max_angle)
    cosines = (float(np.cos(wanted.high)), float(np.cos(wanted.low)))
    fitted, again = (
        _primfit.fit_parts(
            points,
            beams,
            labels,
            noise,
            wanted.normal_space,
            wanted.axis,
            cosines,
            limit,
            n_jobs,
        )
        for n_jobs in (1, 3)
    )
    assert len(fitted) == 5
    assert orientation != "any" or sum(part is not None for part in fitted) >= 4
    for k, (part, other) in enumerate(zip(fitted, again, strict=True)):
        own = np.flatnonzero(labels == k)
        expected = twin(
            points[own], None if beams is None else beams[own], noise[own], wanted, limit
        )
        if expected is None:
            assert part is None
            continue
        (equation, covariance, rms), reach, inliers = part
        assert equation == pytest.approx(expected[0], abs=1e-8)
        assert covariance == pytest.approx(expected[1], rel=1e-6, abs=1e-12)
        assert (rms, reach) == pytest.approx(expected[2:4], rel=1e-8)
        assert np.array_equal(inliers, own[expected[4]])
        assert np.array_equal(equation, other[0][0])
        assert np.array_equal(inliers, other[2])


@given(
    st.integers(0, 10**6),
    st.sampled_from([0.0, 1.0, 100.0, 350.0, 450.0, 1e4]),
    st.sampled_from([0, 7]),
)
def test_what_is_counted_as_amid_has_its_middle_there(seed, far, every):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (rng.integers(100, 3000), 3)) * rng.uniform(0.1, 3.0, 3)
    points += far * rng.uniform(-1.0, 1.0, 3)
    if every:
        points[::every] = np.nan
    returns = points[~np.isnan(points[:, 0])]
    middle = np.median(returns, axis=0)
    if is_amid(points, len(returns), 400.0):
        assert np.abs(middle).max() <= 400.0 * half_extent(returns, middle)
    else:
        # It gives up early, but not on what lies about the origin.
        assert far > 1.0
