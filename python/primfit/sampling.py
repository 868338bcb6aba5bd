"""Sampling a posterior whose cost jumps: silhouettes make the likelihood of a solid do so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit._check import Floats

_LEAST_SHARE = 0.2
"""Share of a generation that must keep weight: the temperature is chosen for it."""

_MOST_SHARE = 0.7
"""Share of a generation that keeps weight when it is too narrow."""

_GROWTH, _WIDENING = 1.2, 3.0
"""By how much the variance of a generation exceeds that of the weighted one before."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """What the last generations say of the parameters.

    Attributes
    ----------
    mean : (d,) float64
    covariance : (d, d) float64
    best : (d,) float64
        Parameters of least cost seen.
    cost : float
        Theirs.
    temperature : float
        1 when the sampler has settled; above it the spread is too wide by its square root.
    """

    mean: Floats
    covariance: Floats
    best: Floats
    cost: float
    temperature: float


def sample(
    cost: Callable[[Floats], Floats],
    mean: Floats,
    covariance: Floats,
    rng: np.random.Generator,
    *,
    n: int = 64,
    generations: int = 30,
    settled: int = 3,
) -> Posterior:
    """Population Monte Carlo with a normal proposal that follows the posterior.

    Each generation is drawn from the weighted mean and covariance of the one before, weighted by
    ``exp(-cost / temperature)``; the temperature is the least, but at least 1, that leaves weight
    to a share of the generation. It ends when `settled` generations in a row had temperature 1;
    their draws, corrected for the proposal, give mean and covariance.

    Cappe, Guillin, Marin, Robert: Population Monte Carlo, JCGS 13, 2004.

    Parameters
    ----------
    cost : callable
        Negative log-likelihood (n,) of parameters (n, d).
    mean, covariance : (d,) and (d, d) float64
        Where to start.
    n, generations, settled : int
    """
    d = len(mean)
    least = 1e-24 * np.eye(d)
    best, best_cost = mean, np.inf
    kept: list[tuple[Floats, Floats]] = []
    temperature = np.inf
    for _ in range(generations):
        root = np.linalg.cholesky(covariance + least)
        standard = rng.normal(size=(n, d))
        standard[0] = 0.0
        draws = mean + standard @ root.T
        costs = cost(draws)
        lowest = int(np.argmin(costs))
        if costs[lowest] < best_cost:
            best, best_cost = draws[lowest], float(costs[lowest])
        temperature = _temperature(costs, _LEAST_SHARE * n)
        weights = np.exp(-(costs - costs[lowest]) / temperature)
        growth = _GROWTH
        if temperature == 1.0:
            log_weights = -costs + 0.5 * (standard**2).sum(axis=1)
            corrected = np.exp(log_weights - log_weights.max())
            if _size(weights) > _MOST_SHARE * n:
                # The generation sees hardly any slope: it has become narrower than the posterior.
                kept.clear()
                growth = _WIDENING
            else:
                kept.append((draws, log_weights))
                if len(kept) >= settled:
                    break
                if _size(corrected) >= _LEAST_SHARE * n:
                    weights = corrected
        else:
            kept.clear()
        center, around = _moments(draws, weights)
        # While the mean still moves, the spread takes in its step, lest it run dry on the way.
        step = center - mean if temperature > 1.0 else np.zeros(d)
        mean, covariance = center, growth * (around + np.outer(step, step))
    if kept:
        log_weights = np.concatenate([each for _, each in kept])
        draws = np.concatenate([each for each, _ in kept])
        mean, covariance = _moments(draws, np.exp(log_weights - log_weights.max()))
    return Posterior(mean, covariance, best, best_cost, float(temperature))


def _moments(draws: Floats, weights: Floats) -> tuple[Floats, Floats]:
    share = weights / weights.sum()
    mean = share @ draws
    off = draws - mean
    return mean, (share[:, None] * off).T @ off


def _size(weights: Floats) -> float:
    """Effective number of weighted draws (Kish)."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _temperature(costs: Floats, least_size: float) -> float:
    """The least temperature, 1 or above, with an effective sample of `least_size`."""

    def size(temperature: float) -> float:
        return _size(np.exp(-(costs - costs.min()) / temperature))

    if size(1.0) >= least_size:
        return 1.0
    low, high = 1.0, 2.0
    while size(high) < least_size:
        low, high = high, 2.0 * high
    for _ in range(8):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if size(middle) < least_size else (low, middle)
    return float(high)
