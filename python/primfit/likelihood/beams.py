"""Beams, their noise, and what they cost where they do not meet what they should."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from primfit import _primfit
from primfit._check import Floats

LEAST_SIGMA = 2e-5
"""Least standard deviation, as a fraction of the sensor's reach: corners of exact ranges."""

_RARE = 1e-5
"""Least share of outliers, and of lost returns: what is never seen may still happen."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """How beams err.

    A beam whose nearest surface is within the sensor's range returns it with Gaussian noise, but
    for a share of lost returns, and a share of outliers of any range up to the longest.

    Attributes
    ----------
    sigma : (n,) float64, metres
        Standard deviation of each beam's range.
    reach : float, metres
        Longest range.
    outliers, lost : float
        Their shares.
    """

    sigma: Floats
    reach: float
    outliers: float = _RARE
    lost: float = _RARE

    @cached_property
    def typical_sigma(self) -> float:
        """Median of the beams', metres."""
        return float(np.median(self.sigma))

    @cached_property
    def outlier_price(self) -> float:
        """Most that a return costs: there an outlier is as likely as the noise."""
        peak = self.typical_sigma * np.sqrt(2 * np.pi) / self.reach
        return max(float(-np.log(max(self.outliers, _RARE) * peak)), 5.0)

    @property
    def missing_price(self) -> float:
        """What a beam costs that should return and does not."""
        return float(-np.log(max(self.lost, _RARE)))

    def costs(self, ranges: Floats, expected: Floats, sigma: Floats) -> Floats:
        """Negative log-likelihood (k,) of ranges of beams that should meet something there."""
        foreseen, returned = expected <= self.reach, np.isfinite(ranges)
        with np.errstate(invalid="ignore"):
            explained = np.minimum(0.5 * ((ranges - expected) / sigma) ** 2, self.outlier_price)
        mismatch = self.outlier_price * returned + self.missing_price * foreseen
        return np.where(foreseen & returned, explained, mismatch)


class Beams:
    """Some beams, with what they meet when the solid in question is not there.

    Parameters
    ----------
    arrays : origins (n, 3), directions (n, 3), ranges (n,), background (n,), sigmas (n,)
        float64, metres.
    noise : Noise
    base : float, metres
        z of the floor, on which solids stand.
    stride : int
        Each beam stands for so many.
    """

    def __init__(
        self, arrays: tuple[Floats, ...], noise: Noise, base: float, n_jobs: int | None, stride: int
    ) -> None:
        self.arrays = arrays
        self.noise = noise
        self.base = base
        self.n_jobs = n_jobs
        self.stride = stride
        o, d, r, b, s = (np.ascontiguousarray(array) for array in arrays)
        prices = noise.reach, noise.outlier_price, noise.missing_price
        self._core = _primfit.BeamBlocks(o, d, r, b, s, *prices)

    def __len__(self) -> int:
        return self.stride * len(self._core)

    def costs(self, footprints: Floats, tops: Floats) -> Floats:
        """Negative log-likelihood of each candidate: footprints (k, m, 2) and tops (k,)."""
        n = len(footprints)
        corners, heights = np.ascontiguousarray(footprints), np.ascontiguousarray(tops)
        return self.stride * self._core.costs(corners, np.full(n, self.base), heights, self.n_jobs)

    def climb(
        self, family: _primfit.Family, start: Floats, top: float, steps: int
    ) -> tuple[Floats, float, Floats]:
        """Parameters (d,) of least cost near a start, their cost and covariance (d, d)."""
        first = np.ascontiguousarray(start)
        return self._core.climb(family, first, self.base, top, self.stride, steps)

    def wall_depths(self, footprint: Floats) -> Floats:
        """How far each beam first meets the walls over a footprint, however high they are."""
        depths: Floats = self._core.wall_depths(np.ascontiguousarray(footprint))
        return depths

    def around(
        self, footprint: Floats, top: float, slack: float, top_slack: float
    ) -> _primfit.Local:
        """The likelihood of prisms whose corners and top are near those of a given one.

        It is a quadratic, and the beams at silhouettes.
        """
        corners = np.ascontiguousarray(footprint)
        return self._core.around(corners, self.base, top, slack, top_slack, self.stride)

    def thinned(self, stride: int, least_sigma: float) -> Beams:
        """Every so manieth beam, taken as no more exact than `least_sigma`."""
        sigmas = np.maximum(self.arrays[4], least_sigma)
        return self._take(slice(None, None, stride), self.stride * stride, sigmas)

    def some(self, stride: int) -> Beams:
        """Every so manieth of the scan's beams, as if there were no others."""
        if stride == self.stride == 1:
            return self
        return self._take(slice(None, None, stride // self.stride), 1, self.arrays[4])

    def _take(self, rows: Any, stride: int, sigmas: Floats) -> Beams:
        o, d, r, b, _ = self.arrays
        arrays = tuple(array[rows] for array in (o, d, r, b, sigmas))
        return Beams(arrays, self.noise, self.base, self.n_jobs, stride)
