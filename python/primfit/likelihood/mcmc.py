"""Exploring a posterior of many parameters, in which independent draws hardly ever hit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from primfit._check import Floats
from primfit.likelihood.importance_sampling import Posterior
from primfit.likelihood.settings import Effort, SamplingSettings


def explore(
    cost: Callable[[Floats], Floats],
    mean: Floats,
    covariance: Floats,
    rng: np.random.Generator,
    how: SamplingSettings,
    effort: Effort,
) -> Posterior:
    """Markov chains that step by the differences between each other.

    Half of the chains moves by the differences within the other half, so the steps have the shape
    of the posterior, whatever that is, and leave it as it is. The evidence is that of the normal
    distribution with the same mean cost and covariance, which is an upper bound.

    ter Braak: A Markov Chain Monte Carlo version of the genetic algorithm Differential Evolution,
    Statistics and Computing 16, 2006. Foreman-Mackey et al.: emcee, Publications of the
    Astronomical Society of the Pacific 125, 2013, for the halves.

    Cost, mean, covariance and effort are those of `sample`.
    """
    d = len(mean)
    n = 2 * max(how.chains * d // 2, 2)
    steps = max(how.n_chained(effort, d) // n, 10)
    root = _root_of(covariance)
    at = mean + how.start * rng.normal(size=(n, d)) @ root.T
    at[0] = mean
    costs = cost(at)
    at[~np.isfinite(costs)], costs[~np.isfinite(costs)] = mean, costs[0]
    best, best_cost = mean, float(costs[0])
    kept, kept_costs = [], []
    for step in range(steps):
        scale = 1.0 if step % how.leap == how.leap - 1 else 2.38 / np.sqrt(2 * d)
        for half in (0, 1):
            mine, others = slice(half, None, 2), at[1 - half :: 2]
            first = rng.integers(n // 2, size=n // 2)
            second = (first + rng.integers(1, n // 2, size=n // 2)) % (n // 2)
            trial = at[mine] + scale * (others[first] - others[second])
            trial += how.jitter * rng.normal(size=trial.shape) @ root.T
            trial_costs = cost(trial)
            is_taken = trial_costs < costs[mine] + rng.exponential(size=n // 2)
            at[mine][is_taken] = trial[is_taken]
            costs[mine][is_taken] = trial_costs[is_taken]
        lowest = int(np.argmin(costs))
        if costs[lowest] < best_cost:
            best, best_cost = at[lowest].copy(), float(costs[lowest])
        if step >= how.burn_in * steps:
            kept.append(at.copy())
            kept_costs.append(costs.copy())
    chains = np.stack(kept)
    spread = chains.reshape(-1, d).std(axis=0)
    between = chains.mean(axis=0).std(axis=0, ddof=1)
    # What the means of the chains differ by tells how many independent draws each is worth.
    size = float(n * np.mean(spread**2 / np.maximum(between**2, 1e-300)))
    mean = chains.mean(axis=(0, 1))
    covariance = np.atleast_2d(np.cov(chains.reshape(-1, d).T))
    covariance *= (size + 1.0) / max(size - d - 2.0, 1.0)
    average = float(np.mean(kept_costs))
    evidence = 0.5 * (d * np.log(2 * np.pi * np.e) + np.linalg.slogdet(covariance)[1]) - average
    return Posterior(mean, covariance, best, best_cost, float(evidence), size)


def _root_of(covariance: Floats) -> Floats:
    """A square root (d, d) of a covariance that rounding may have made singular."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale)
    root: Floats = np.linalg.cholesky(correlation + 1e-10 * np.eye(len(scale)))
    return scale[:, None] * root
