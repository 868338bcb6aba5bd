"""Posteriors by independent draws and by chains, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from primfit.likelihood.importance_sampling import sample
from primfit.likelihood.mcmc import explore
from primfit.likelihood.settings import Effort, SamplingSettings


def test_the_sampler_finds_a_normal_posterior_and_its_evidence():
    truth = np.array([1.0, -2.0, 0.5])
    covariance = np.diag([1e-4, 1e-2, 1.0]) + 0.001
    precision = np.linalg.inv(covariance)

    def cost(x):
        return 0.5 * np.einsum("ni,ij,nj->n", x - truth, precision, x - truth)

    effort = Effort(n=200, generations=60, wanted=400.0, least=0.0, chained=0)
    found = sample(cost, np.zeros(3), np.eye(3), np.random.default_rng(1), effort)
    assert found.size >= 400.0
    z = (found.mean - truth) / np.sqrt(np.diag(covariance))
    assert np.abs(z).max() < 0.3
    ratio = np.diag(found.covariance) / np.diag(covariance)
    assert (ratio > 0.7).all()
    assert (ratio < 1.4).all()
    exact = 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
    assert found.log_evidence == pytest.approx(exact, abs=0.3)


@pytest.mark.parametrize("is_box", [False, True])
def test_chains_explore_a_posterior_of_many_parameters(is_box):
    rng = np.random.default_rng(2)
    d = 13
    root = np.linalg.cholesky(np.eye(d) + 0.5 * np.ones((d, d))) * np.logspace(-3, 0, d)[:, None]

    def cost(x):
        unit = np.linalg.solve(root, x.T).T
        if is_box:
            return np.where((np.abs(unit) < np.sqrt(3.0)).all(axis=1), 0.0, np.inf)
        return 0.5 * (unit**2).sum(axis=1)

    start = root @ rng.normal(size=d) * 0.5
    effort = Effort(n=0, generations=0, wanted=0.0, least=0.0, chained=4800)
    found = explore(cost, start, 2.0 * root @ root.T, rng, SamplingSettings(), effort)
    assert found.size > 50.0
    assert np.linalg.norm(np.linalg.solve(root, found.mean)) < 0.4 * np.sqrt(d)
    ratio = np.linalg.slogdet(found.covariance)[1] - 2 * np.log(np.diag(root)).sum()
    assert abs(ratio) / (2 * d) < 0.15
    exact = 0.5 * d * np.log(2 * np.pi) + np.log(np.diag(root)).sum()
    if is_box:
        exact = d * np.log(2 * np.sqrt(3.0)) + np.log(np.diag(root)).sum()
    # The evidence is an upper bound: by 0.18 a parameter for a box.
    assert -1.0 < found.log_evidence - exact < 1.0 + 0.25 * d * is_box


def test_the_sampler_survives_a_cost_that_is_infinite_almost_everywhere():
    def cost(x):
        return np.where((np.abs(x) < 0.01).all(axis=1), 0.0, np.inf)

    effort = Effort(n=50, generations=40, wanted=50.0, least=0.0, chained=0)
    found = sample(cost, np.zeros(2), np.eye(2), np.random.default_rng(1), effort)
    assert np.abs(found.mean).max() < 0.01


def test_the_sampler_survives_a_start_without_spread():
    effort = Effort(n=50, generations=8, wanted=50.0, least=0.0, chained=0)
    start, rng = np.ones(12)[::2], np.random.default_rng(1)
    found = sample(lambda x: (x**2).sum(axis=1), start, np.zeros((7, 7))[:6, :6], rng, effort)
    assert np.isfinite(found.log_evidence)
    np.testing.assert_allclose(found.mean, start)


def test_the_sampler_follows_its_rng_alone_and_lets_errors_through():
    effort = Effort(n=50, generations=4, wanted=1e9, least=0.0, chained=0)

    def found(seed):
        rng = np.random.default_rng(seed)
        return sample(lambda x: (x**2).sum(axis=1), np.zeros(2), np.eye(2), rng, effort)

    np.testing.assert_array_equal(found(1).covariance, found(1).covariance)
    assert (found(1).covariance != found(2).covariance).all()

    def fail(_):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        sample(fail, np.zeros(2), np.eye(2), np.random.default_rng(1), effort)
    with pytest.raises(ValueError, match="costs"):
        sample(lambda x: x[1:, 0], np.zeros(2), np.eye(2), np.random.default_rng(1), effort)
