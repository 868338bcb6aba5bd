"""Sampling a posterior whose cost jumps: silhouettes make the likelihood of a solid do so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from primfit import _primfit
from primfit._check import Floats

FEW = 6
"""Parameters up to which independent draws hit the posterior often enough."""


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


QUICK = Effort(n=144, generations=8, wanted=40.0, least=13.0, chained=768)
THOROUGH = Effort(n=320, generations=12, wanted=400.0, least=67.0, chained=5760)
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
