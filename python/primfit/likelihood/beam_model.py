"""How beams err, and what they cost where they do not meet what they should."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import ndtr

from primfit import _primfit
from primfit._check import Bools, Floats
from primfit.likelihood.settings import LikelihoodSettings, NoiseSettings

Limits = tuple[float, float] | Floats
"""Shortest and longest true range that gives a return, metres: of all beams, or (2, n) of each."""


@dataclass(frozen=True, kw_only=True)
class BeamModel:
    """How beams err.

    A beam whose nearest surface is within the sensor's limits returns its range with Gaussian
    noise, but for a share of dropouts, and a share of outliers of any range.

    Attributes
    ----------
    sigma : (n,) float64, metres
        Standard deviation of each beam's range.
    min_range, max_range : float, metres
        True ranges outside give no return.
    beam_limits : (2, n) float64 or None, metres
        The same of each beam, where beams differ; those of all are the least and the largest.
    outliers, dropouts : float
        Their shares.
    """

    sigma: Floats
    min_range: float
    max_range: float
    beam_limits: Floats | None = None
    outliers: float = 0.0
    dropouts: float = 0.0
    settings: NoiseSettings = field(default_factory=NoiseSettings)

    @cached_property
    def typical_sigma(self) -> float:
        """Median of the beams', metres."""
        return float(np.median(self.sigma))

    @property
    def least_sigma(self) -> float:
        """Least standard deviation, metres."""
        return self.settings.least_sigma * self.max_range

    def limits(self, rows: Any = slice(None)) -> Limits:
        """Shortest and longest true range that gives a return, metres, for some beams."""
        if self.beam_limits is None:
            return self.min_range, self.max_range
        some: Floats = self.beam_limits[:, rows]
        return some

    @cached_property
    def outlier_cost(self) -> float:
        """Most that a return costs: there an outlier is as likely as the noise."""
        peak = self.typical_sigma * np.sqrt(2 * np.pi) / self.max_range
        cost = -np.log(max(self.outliers, self.settings.rare) * peak)
        return max(float(cost), self.settings.least_outlier_cost)

    @property
    def dropout_cost(self) -> float:
        """What a beam costs that should return and does not."""
        return float(-np.log(max(self.dropouts, self.settings.rare)))

    def of_beams(self, rows: Any) -> BeamModel:
        """How some beams err."""
        each = None if self.beam_limits is None else self.beam_limits[:, rows]
        return replace(self, sigma=self.sigma[rows], beam_limits=each)

    def is_visible(self, expected: Floats, rows: Any = slice(None)) -> Bools:
        """Which true ranges of some beams give a return."""
        shortest, longest = self.limits(rows)
        visible: Bools = (expected >= shortest) & (expected <= longest)
        return visible

    def costs(
        self, ranges: Floats, near: Floats, far: Floats, sigma: Floats, limits: Limits
    ) -> Floats:
        """Negative log-likelihood (k,) of ranges of beams whose true range is in [near, far]."""
        shortest, longest = limits
        low, high = np.maximum(near, shortest), np.minimum(far, longest)
        may_return, returned = low <= high, np.isfinite(ranges)
        may_miss = (near < shortest) | (far > longest)
        with np.errstate(invalid="ignore"):
            off = np.maximum(np.maximum(low - ranges, ranges - high), 0.0) / sigma
            explained = np.minimum(0.5 * off * off, self.outlier_cost)
        of_return = np.where(may_return, explained, self.outlier_cost)
        return np.where(returned, of_return, np.where(may_miss, 0.0, self.dropout_cost))

    def fair_costs(
        self, ranges: Floats, near: Floats, far: Floats, sigma: Floats, limits: Limits
    ) -> Floats:
        """The same costs (k,), comparable between intervals of different widths.

        Noise costs less in a wide interval than in a narrow one, which would favour the larger of
        two solids, whose tolerance is larger. So returns cost what they do beyond that.
        """
        costs = self.costs(ranges, near, far, sigma, limits)
        shortest, longest = limits
        foreseen = np.isfinite(ranges) & (far >= shortest) & (near <= longest)
        costs[foreseen] += 0.5 - _mean_cost(near[foreseen], far[foreseen], sigma[foreseen])
        return costs

    def usual_costs(self, near: Floats, far: Floats, sigma: Floats) -> Floats:
        """What returns cost on average (k,) if their true range is in [near, far].

        Half where that is one range. In a narrow interval the true range is taken as the middle,
        in a wide one as an end.
        """
        return np.maximum(_mean_cost(near, far, sigma), 0.25)


def _mean_cost(near: Floats, far: Floats, sigma: Floats) -> Floats:
    """What returns cost on average (k,) whose true range is the middle of [near, far]."""
    half = 0.5 * (far - near) / sigma
    mean = np.zeros(len(half))
    narrow = half < 8.0
    h = half[narrow]
    density = np.exp(-0.5 * h * h) / np.sqrt(2 * np.pi)
    mean[narrow] = (1.0 + h * h) * ndtr(-h) - h * density
    return mean


class Beams:
    """Some beams, with what they meet when the solid in question is not there.

    Parameters
    ----------
    arrays : origins (n, 3), directions (n, 3), ranges (n,), background (n,), sigmas (n,)
        float64, metres.
    limits : (float, float) or (2, n) float64, metres
        Shortest and longest true range that gives a return.
    model : BeamModel
    floor_z : float, metres
        z of the floor, on which solids stand.
    stride : int
        Each beam stands for so many.
    is_open : bool
        Whether what they may meet has no top face, as a room.
    """

    def __init__(
        self,
        arrays: tuple[Floats, ...],
        limits: Limits,
        model: BeamModel,
        floor_z: float,
        settings: LikelihoodSettings,
        *,
        n_jobs: int | None = None,
        stride: int = 1,
        is_open: bool = False,
    ) -> None:
        self.arrays = arrays
        self.limits = limits
        self.model = model
        self.floor_z = floor_z
        self.settings = settings
        self.n_jobs = n_jobs
        self.stride = stride
        self.is_open = is_open
        o, d, r, b, s = (np.ascontiguousarray(array) for array in arrays)
        costs = model.outlier_cost, model.dropout_cost
        each = np.ascontiguousarray(limits) if isinstance(limits, np.ndarray) else limits
        self._core = _primfit.BeamBlocks(o, d, r, b, s, each, *costs)

    def __len__(self) -> int:
        return self.stride * len(self._core)

    def limits_of(self, rows: Any) -> Limits:
        """Limits of some of them."""
        return self.limits[:, rows] if isinstance(self.limits, np.ndarray) else self.limits

    def costs(self, footprints: Floats, tops: Floats, *, is_round: bool = False) -> Floats:
        """Negative log-likelihood of each candidate: footprints (k, m, 2) and tops (k,).

        Round footprints are told by the ends of the axes of an ellipse (k, 4, 2).
        """
        n = len(footprints)
        corners, heights = np.ascontiguousarray(footprints), np.ascontiguousarray(tops)
        floors = np.full(n, self.floor_z)
        how = self.is_open, is_round, self.n_jobs
        return self.stride * self._core.costs(corners, floors, heights, *how)

    def climb(
        self, family: _primfit.Family, start: Floats, top: float, steps: int
    ) -> tuple[Floats, float, Floats]:
        """Parameters (d,) of least cost near a start, their cost and covariance (d, d)."""
        first = np.ascontiguousarray(start)
        return self._core.climb(family, first, self.floor_z, top, self.stride, steps, self.is_open)

    def wall_depths(self, footprint: Floats) -> Floats:
        """How far each beam first meets the walls over a footprint, however high they are."""
        depths: Floats = self._core.wall_depths(np.ascontiguousarray(footprint))
        return depths

    def prism_ranges(self, footprint: Floats, top: float, *, is_round: bool = False) -> Floats:
        """Range (n,) at which each beam first meets a prism, or what is there without it."""
        corners = np.ascontiguousarray(footprint)
        met = self._core.prism_ranges(corners, self.floor_z, top, is_round)
        return np.minimum(met, self.arrays[3])

    def around(
        self,
        footprint: Floats,
        top: float,
        slack: float,
        top_slack: float,
        *,
        is_round: bool = False,
    ) -> _primfit.Local:
        """The likelihood of prisms whose corners and top are near those of a given one.

        It is a quadratic, and the beams at silhouettes.
        """
        corners = np.ascontiguousarray(footprint)
        weight, room = self.stride, (slack, top_slack)
        return self._core.around(corners, self.floor_z, top, *room, weight, self.is_open, is_round)

    def thinned(self, stride: int, least_sigma: float) -> Beams:
        """Every `stride`-th beam, taken as no more exact than `least_sigma`."""
        sigmas = np.maximum(self.arrays[4], least_sigma)
        return self._take(slice(None, None, stride), self.stride * stride, sigmas)

    def subset(self, stride: int) -> Beams:
        """Every `stride`-th of the scan's beams, as if there were no others."""
        if stride <= self.stride == 1:
            return self
        return self._take(slice(None, None, max(stride // self.stride, 1)), 1, self.arrays[4])

    def blurred(self, sigma: float) -> Beams:
        """The same beams with a standard deviation more, metres."""
        if sigma == 0.0:
            return self
        return self._take(slice(None), self.stride, np.hypot(self.arrays[4], sigma))

    def take(self, rows: Any) -> Beams:
        """Some of them."""
        return self._take(rows, self.stride, self.arrays[4])

    def _take(self, rows: Any, stride: int, sigmas: Floats) -> Beams:
        o, d, r, b, _ = self.arrays
        arrays = (o[rows], d[rows], r[rows], b[rows], sigmas[rows])
        return Beams(
            arrays,
            self.limits_of(rows),
            self.model,
            self.floor_z,
            self.settings,
            n_jobs=self.n_jobs,
            stride=stride,
            is_open=self.is_open,
        )
