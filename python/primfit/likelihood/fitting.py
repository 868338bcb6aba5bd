"""Fitting one solid to the beams around it: from a guess to a posterior.

`climb` follows the smooth part of the likelihood uphill with the top of the solid where `find_top`
saw it; `sample_posterior` samples all of the likelihood, for shape and top together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from primfit._check import Floats
from primfit.likelihood.beam_model import Beams
from primfit.likelihood.footprint_models import FootprintModel
from primfit.likelihood.importance_sampling import Posterior, sample
from primfit.likelihood.mcmc import explore
from primfit.likelihood.settings import Effort

_TOP_BEAMS = 20_000
"""Beams that tell the top, before it is sampled with the footprint."""

_FLATTEST = 0.1
"""Short over long axis below which an ellipse is not told from a wall."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A shape with parameters, as good as the smooth part of the likelihood makes it.

    Attributes
    ----------
    shape : FootprintModel
    parameters : (d,) float64
    covariance : (d, d) float64
        Inverse of the Fisher information of the ranges.
    cost : float
    """

    shape: FootprintModel
    parameters: Floats
    covariance: Floats
    cost: float

    @property
    def footprint(self) -> Floats:
        """Corners (m, 2), metres."""
        return self.shape.frame(self.parameters)[0]

    @property
    def points(self) -> Floats:
        """Corners (m, 2), or ends of the axes (4, 2), metres, as beams meet it."""
        points: Floats = self.shape.points(self.parameters[None])[0]
        return points

    @property
    def corner_sigma(self) -> float:
        """Largest standard deviation of a corner, metres."""
        _, jacobian = self.shape.frame(self.parameters)
        variances = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return float(np.sqrt(variances.reshape(-1, 2).sum(axis=1).max()))


def is_sliver(fit: Fit) -> bool:
    """Whether a fit is an ellipse that is no more than one wall."""
    return fit.shape.kind == "ellipse" and bool(
        fit.parameters[3:5].min() < _FLATTEST * fit.parameters[3:5].max()
    )


@dataclass(frozen=True)
class Top:
    """z of the top of a solid, as its beams tell it.

    Attributes
    ----------
    z, sigma : float, metres
        Sigma is NaN where no beam passes over.
    """

    z: float
    sigma: float


def climb(
    beams: Beams, shape: FootprintModel, start: Floats, top: float, *, steps: int = 12
) -> Fit:
    """Damped Gauss-Newton steps to the least cost, with the beams associated anew at each."""
    parameters, cost, covariance = beams.climb(shape.family, start, top, steps)
    return Fit(shape, parameters, covariance, cost)


def coarse_to_fine(
    beams: Beams, shape: FootprintModel, start: Floats, top: float, size: float
) -> Fit:
    """Climb from a guess that is off by a few percent of the size, metres.

    Beams are taken as less exact than they are at first, lest those that are far from the guess
    count as outliers.
    """
    how = beams.settings.fitting
    parameters, blur = start, how.blur * size
    sharpest = float(np.median(beams.arrays[4])) if len(beams) else np.inf
    while blur > sharpest:
        parameters = climb(beams.thinned(4, blur), shape, parameters, top, steps=6).parameters
        blur /= how.sharpening
    return climb(beams, shape, parameters, top)


def find_top(beams: Beams, footprint: Floats) -> Top:
    """z of the top over a footprint, as the beams tell it that cross the walls.

    Each of them either ends on the wall or passes over it, so the likelihood is constant between
    the heights at which they cross.
    """
    beams = beams.thinned(-(-len(beams) // (beams.stride * _TOP_BEAMS)) or 1, 0.0)
    origins, directions, ranges, background, sigma = beams.arrays
    sensor = float(origins[:, 2].max(initial=beams.floor_z))
    depths = beams.wall_depths(footprint)
    crossing = np.flatnonzero(depths < background)
    z = origins[crossing, 2] + depths[crossing] * directions[crossing, 2]
    order = np.argsort(z, kind="stable")
    crossing = crossing[order[z[order] > beams.floor_z]]
    heights = np.concatenate([[beams.floor_z], np.sort(z[z > beams.floor_z])])
    if len(heights) < 2:
        return Top(sensor, np.nan)
    ended, errors, limits = ranges[crossing], sigma[crossing], beams.limits_of(crossing)
    cost = [
        beams.model.costs(ended, each[crossing], each[crossing], errors, limits)
        for each in (depths, background)
    ]
    costs = beams.stride * np.concatenate([[0.0], np.cumsum(cost[0] - cost[1])])
    if costs[-1] - costs.min() < beams.settings.fitting.known_height:
        return Top(max(float(heights[-1]), sensor) + 1e-3 * beams.model.max_range, np.nan)
    widths = np.diff(heights)
    # Beams that cross at one height leave nothing between them.
    widths = np.maximum(widths, np.finfo(float).eps * max(abs(heights[-1]), 1e-3))
    weights = widths * np.exp(costs.min() - costs[:-1])
    weights /= weights.sum()
    middles = heights[:-1] + widths / 2
    z_mean = float(weights @ middles)
    variance = float(weights @ ((middles - z_mean) ** 2 + widths**2 / 12.0))
    if z_mean > sensor:
        return Top(z_mean, float(np.sqrt(variance)))
    return _search_top(beams, footprint, sensor)


def _search_top(beams: Beams, footprint: Floats, highest: float) -> Top:
    """z of a top below the sensor, on which beams end too."""
    low, high = beams.floor_z, highest
    while True:
        tops = np.linspace(low, high, 65)[1:-1]
        costs = beams.costs(np.broadcast_to(footprint, (len(tops), *footprint.shape)), tops)
        weights = np.exp(costs.min() - costs)
        weights /= weights.sum()
        z, step = float(weights @ tops), float(tops[1] - tops[0])
        sigma = float(np.sqrt(weights @ (tops - z) ** 2))
        if sigma > 2.0 * step or high - low < 1e-6 * beams.model.max_range:
            return Top(z, max(sigma, step))
        low, high = max(z - 8.0 * step, beams.floor_z), min(z + 8.0 * step, highest)


def sample_posterior(
    beams: Beams,
    fit: Fit,
    top: Top,
    rng: np.random.Generator,
    effort: Effort,
    worst: float = np.inf,
) -> tuple[Fit, Top, Posterior]:
    """Posterior of a shape and its top near a fit, by the likelihood of some beams.

    Only the beams at silhouettes are cast for each draw; the region in which the others are smooth
    follows the posterior as it moves. It is not followed where no draw costs less than `worst`.

    Returns
    -------
    fit, top : Fit and Top
        Mean and spread of the posterior, or where it was sought last.
    posterior : Posterior
        Of the shape's parameters and the top, where that is known.
    """
    how = beams.settings.fitting
    shape, d = fit.shape, fit.shape.n_parameters
    is_known = np.isfinite(top.sigma)

    mean, covariance = fit.parameters, fit.covariance
    if is_known:
        # Where beams rise, the height at which they meet a wall changes with the wall.
        mean, covariance = np.append(mean, top.z), np.pad(covariance, (0, 1))
        covariance[d, d] = top.sigma**2 + (how.steepness * fit.corner_sigma) ** 2
    extent = float(np.ptp(fit.footprint, axis=0).max())
    for _ in range(how.rounds):
        slack = min(how.margin_sigmas * fit.corner_sigma, how.widest * extent)
        top_slack = how.margin_sigmas * float(np.sqrt(covariance[d, d])) if is_known else 0.0
        top_slack = min(top_slack, how.widest * extent)
        if len(beams) <= how.few_beams:
            slack = top_slack = extent
        here, z = fit.footprint, top.z
        local = beams.around(fit.points, z, slack, top_slack, is_round=shape.is_round)
        cost = partial(local.costs, shape.family, n_jobs=beams.n_jobs)
        if len(mean) <= beams.settings.sampling.few_parameters:
            found = sample(cost, mean, covariance, rng, effort)
        else:
            found = explore(cost, mean, covariance, rng, beams.settings.sampling, effort)
        if found.size >= 2 * len(mean):
            is_proper = shape.is_proper(found.mean[None])[0]
            mean, covariance = found.mean if is_proper else found.best, found.covariance
        else:
            # A handful of draws tells where the posterior is, but not how wide.
            mean = found.best
        fit = Fit(shape, mean[:d], covariance[:d, :d], found.cost)
        away = float(np.linalg.norm(fit.footprint - here, axis=1).max())
        is_inside = away + how.room_sigmas * fit.corner_sigma <= slack
        if is_known:
            top = Top(float(mean[d]), float(np.sqrt(covariance[d, d])))
            is_inside &= abs(top.z - z) + how.room_sigmas * top.sigma <= top_slack
        if found.cost > worst or (found.size >= effort.least and is_inside):
            break
    return fit, top, found
