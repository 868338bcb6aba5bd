"""Sampling a posterior whose cost jumps: silhouettes make the likelihood of a solid do so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import lgamma

import numpy as np

from primfit._check import Floats

_LEAST_SIZE = 0.3
"""Effective share of the draws of some generations by which the next one is adapted."""

_MEMORY = 8
"""Generations that are remembered."""

FEW = 6
"""Parameters up to which independent draws hit the posterior often enough."""

_DEGREES = 6.0
"""Of freedom of the proposal: its tails are heavier than those of a jumping likelihood."""

_POWER = 0.05
"""Relative error of the power by which weights are tempered."""

_GROWTH = 1.1
"""By how much the variance of a generation exceeds that of the weighted ones before."""


@dataclass(frozen=True)
class Effort:
    """How hard `sample` tries.

    Attributes
    ----------
    n : int
        Draws of a generation.
    generations : int
        Most of them.
    wanted : float
        Effective number of draws at which it ends.
    least : float
        Effective number of draws that tell where the posterior is.
    chained : int
        Draws of Markov chains in `FEW` parameters.
    """

    n: int
    generations: int
    wanted: float
    least: float
    chained: int

    def n_chained(self, n_parameters: int) -> int:
        """Draws of Markov chains in many parameters: chains and steps grow with their number."""
        return self.chained * n_parameters**2 // FEW**2


QUICK = Effort(n=96, generations=8, wanted=40.0, least=13.0, chained=768)
THOROUGH = Effort(n=320, generations=12, wanted=400.0, least=67.0, chained=1920)
"""To sample a level, and a posterior that is reported: proposals that follow few draws make its
spread too small."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """What draws say of the parameters.

    Attributes
    ----------
    mean : (d,) float64
    covariance : (d, d) float64
    best : (d,) float64
        Parameters of least cost seen.
    cost : float
        Theirs.
    log_evidence : float
        Logarithm of the integral of ``exp(-cost)``.
    size : float
        Effective number of draws behind mean, covariance and evidence.
    """

    mean: Floats
    covariance: Floats
    best: Floats
    cost: float
    log_evidence: float
    size: float


class _Students:
    """Student distributions of `_DEGREES` degrees of freedom, one a generation.

    Only the last `_MEMORY` are remembered.
    """

    def __init__(self, d: int) -> None:
        self._means, self._inverses = np.empty((0, 1, d)), np.empty((0, d, d))
        self._peaks = np.empty((0, 1))

    def __len__(self) -> int:
        return len(self._means)

    def append(self, mean: Floats, root: Floats) -> None:
        """One more, the last, about a mean (d,) with a root (d, d) of its scale."""
        d, nu = len(mean), _DEGREES
        peak = lgamma((nu + d) / 2) - lgamma(nu / 2) - 0.5 * d * np.log(nu * np.pi)
        peak -= float(np.log(np.diag(root)).sum())
        inverse = np.linalg.inv(root).T
        self._means = np.concatenate([self._means, mean[None, None]])[-_MEMORY:]
        self._inverses = np.concatenate([self._inverses, inverse[None]])[-_MEMORY:]
        self._peaks = np.concatenate([self._peaks, [[peak]]])[-_MEMORY:]

    def log_densities(self, draws: Floats, which: slice) -> Floats:
        """Logarithm of the density (k, n) of draws (n, d) by some of them."""
        standard = (draws - self._means[which]) @ self._inverses[which]
        tails = np.log1p(np.einsum("kij,kij->ki", standard, standard) / _DEGREES)
        densities: Floats = self._peaks[which] - 0.5 * (_DEGREES + draws.shape[1]) * tails
        return densities


def sample(
    cost: Callable[[Floats], Floats],
    mean: Floats,
    covariance: Floats,
    rng: np.random.Generator,
    effort: Effort,
) -> Posterior:
    """Adaptive importance sampling with a Student proposal that follows the posterior.

    Each generation is drawn from mean and covariance of the ones before, weighted against the
    mixture of their proposals; where few draws would carry all the weight, the weights are
    tempered. It ends when the draws are worth as many independent ones as are wanted.

    Cornuet, Marin, Mira, Robert: Adaptive Multiple Importance Sampling, Scandinavian Journal of
    Statistics 39, 2012.

    Parameters
    ----------
    cost : callable
        Negative log-likelihood (n,) of parameters (n, d); infinite where they are not admitted.
    mean, covariance : (d,) and (d, d) float64
        Where to start.
    effort : Effort
    """
    n = effort.n
    best, best_cost = mean, np.inf
    draws, costs = np.empty((0, len(mean))), np.empty(0)
    proposals = _Students(len(mean))
    logs = np.empty((0, 0))
    for _ in range(effort.generations):
        root = root_of(covariance)
        proposals.append(mean, root)
        standard = rng.normal(size=(n, len(mean)))
        standard *= np.sqrt(_DEGREES / rng.chisquare(_DEGREES, size=(n, 1)))
        standard[0] = 0.0
        drawn = mean + standard @ root.T
        draws = np.concatenate([draws, drawn])[-_MEMORY * n :]
        # Density (proposals, draws): what is new are the last row and the last columns.
        n_old = len(proposals) - 1
        known = logs[len(logs) - n_old :, logs.shape[1] - n_old * n :]
        new = proposals.log_densities(drawn, slice(n_old))
        last = proposals.log_densities(draws, slice(n_old, None))
        logs = np.vstack([np.hstack([known, new]), last])
        costs = np.concatenate([costs, cost(drawn)])[-_MEMORY * n :]
        lowest = int(np.argmin(costs))
        if costs[lowest] < best_cost:
            best, best_cost = draws[lowest], float(costs[lowest])
        if np.isfinite(costs).sum() <= 2 * len(mean):
            # Too few are admitted to tell a spread.
            mean, covariance = best, covariance / 4.0
            continue
        highest = logs.max(axis=0)
        mixture = highest + np.log(np.exp(logs - highest).mean(axis=0))
        log_weights = -costs - mixture
        weights = np.exp(log_weights - log_weights.max())
        if _size(weights) >= effort.wanted:
            break
        mean, around = _moments(draws, _tempered(log_weights, _LEAST_SIZE * n))
        # It shrinks by steps, lest a single draw with all the weight leave none.
        covariance = _GROWTH * around + 1e-4 * covariance
    if np.isfinite(costs).sum() <= 2 * len(mean):
        return Posterior(best, covariance, best, best_cost, -np.inf, 0.0)
    mean, covariance = _moments(draws, weights)
    size = _size(weights)
    # The spread of few draws is too small by about this much, as in Hotelling's statistic.
    covariance *= (size + 1.0) / max(size - len(mean) - 2.0, 1.0)
    evidence = float(np.log(weights.mean()) + log_weights.max())
    return Posterior(mean, covariance, best, best_cost, evidence, size)


def root_of(covariance: Floats) -> Floats:
    """A square root (d, d) of a covariance that rounding may have made singular."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale)
    root: Floats = np.linalg.cholesky(correlation + 1e-10 * np.eye(len(scale)))
    return scale[:, None] * root


def _moments(draws: Floats, weights: Floats) -> tuple[Floats, Floats]:
    share = weights / weights.sum()
    mean = share @ draws
    off = draws - mean
    return mean, (share[:, None] * off).T @ off


def _size(weights: Floats) -> float:
    """Effective number of weighted draws (Kish)."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _tempered(log_weights: Floats, least_size: float) -> Floats:
    """Weights to the largest power, 1 at the most, with an effective size of `least_size`."""
    weights = np.zeros(len(log_weights))
    admitted = np.isfinite(log_weights)
    behind = log_weights[admitted] - log_weights.max()
    low, high = 0.0, 1.0
    if _size(np.exp(behind)) >= least_size:
        low = 1.0
    while high - low > _POWER * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _size(np.exp(middle * behind)) > least_size else (low, middle)
    weights[admitted] = np.exp(low * behind)
    return weights
