"""Sampling a posterior whose cost jumps: silhouettes make the likelihood of a solid do so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit import _primfit
from primfit._check import Floats
from primfit.likelihood.settings import Effort


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
    seed = int(rng.integers(1 << 64, dtype=np.uint64))
    center, around = np.ascontiguousarray(mean), np.ascontiguousarray(covariance)
    found = _primfit.sample(cost, center, around, seed, effort.n, effort.generations, effort.wanted)
    return Posterior(*found)
