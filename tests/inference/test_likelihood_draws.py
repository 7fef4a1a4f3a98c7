"""Draws of alpha along curved ridges of the likelihood, against exact laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from aleator.core.types import Array
from aleator.inference.alpha_draws import AlphaDraws, Estimated, alpha_draws, quantiles
from aleator.inference.likelihood_draws import agreement, draws_by_likelihood, plausible_laws
from aleator.search.interface import LogLikelihood

N, SD = 40, 0.4
LIMITS = np.array([[0.2, 5.0], [0.2, 5.0]])
ENDS = np.array([0.025, 0.5, 0.975])


def of_mean(y: Array, mean: Callable[[Array], tuple[float, Array]]) -> Callable:
    """The likelihood of normal values whose mean, with its slopes, is a function of alpha."""

    def objective(alpha: Array) -> LogLikelihood:
        at, slope = mean(alpha)
        u = (y - at) / SD
        return LogLikelihood(-0.5 * u**2, np.outer(u / SD, slope), np.zeros(y.size, np.int64))

    return objective


def known(alpha: list[float], error: Array, interval: Array, rho: float) -> Estimated:
    return Estimated(
        np.array(alpha), error, interval, LIMITS, np.ones(2, bool), np.zeros(2, bool),
        np.arange(2), np.array([[1.0, rho], [rho, 1.0]]),
    )  # fmt: skip


Y = 2.0 + SD * stats.norm.ppf((np.arange(N) + 0.5) / N)


def product(alpha: Array) -> tuple[float, Array]:
    return float(alpha[0] * alpha[1]), alpha[::-1]


def ridge() -> Estimated:
    root, unsure = np.sqrt(2.0), np.full(2, np.nan)
    return known([root, root], unsure, np.array([[0.4, 4.8], [0.4, 4.8]]), -0.8)


def test_draws_follow_a_ridge_of_which_only_the_product_is_seen() -> None:
    """With a flat prior the posterior of (a, b) is a known integral on a grid."""
    objective = of_mean(Y, product)
    assert agreement(alpha_draws(ridge()).fewer(32), objective) < 0.3
    drawn = draws_by_likelihood(ridge(), objective, np.array([[0.4, 5.0], [5.0, 0.4]]))
    assert drawn is not None
    assert drawn.effective > 40.0
    grid = np.linspace(*LIMITS[0], 1200)
    a, b = np.meshgrid(grid, grid)
    exact = np.exp(-0.5 * N * (Y.mean() - a * b) ** 2 / SD**2).ravel()
    for own, other in ((drawn.alpha.prod(axis=1), a * b), (drawn.alpha[:, 0], a)):
        order = np.argsort(other, axis=None)
        reached = np.cumsum(exact[order])
        ends = np.interp(ENDS, reached / reached[-1], other.ravel()[order])
        # Quantiles of so few draws are themselves estimates.
        assert quantiles(own, drawn.weights, ENDS) == pytest.approx(ends, abs=0.2 * np.ptp(ends))


def test_normal_draws_of_a_normal_likelihood_agree_and_are_kept() -> None:
    """Two means, each seen forty times: the log-likelihood is the parabola of the draws."""
    error = np.full(2, SD / np.sqrt(N))
    at = np.array([2.0, 3.0])
    told = known([2.0, 3.0], error, at[:, None] + 1.96 * error[:, None] * [-1.0, 1.0], 0.0)

    def objective(alpha: Array) -> LogLikelihood:
        u = (alpha - at) / error
        return LogLikelihood(-0.5 * u**2, -np.diag(u / error), np.zeros(2, np.int64))

    found = plausible_laws(told, objective, [])
    assert found.status == "normal"
    assert found.agreement == pytest.approx(1.0, abs=1e-3)
    assert not found.alpha


def test_a_ridge_too_thin_for_the_evaluations_is_told_and_not_drawn() -> None:
    """In eight dimensions a product of thousandfold precision takes more than 192 evaluations."""
    size, thin = 8, 1e-3

    def objective(alpha: Array) -> LogLikelihood:
        u = (alpha.prod() - 1.0) / thin
        slope = alpha.prod() / alpha / thin
        return LogLikelihood(np.array([-0.5 * u**2]), -u * slope[None], np.zeros(1, np.int64))

    one = np.ones(size)
    told = Estimated(
        one, np.nan * one, np.tile([0.1, 10.0], (size, 1)), np.tile([0.01, 100.0], (size, 1)),
        one > 0.0, one < 0.0, np.arange(size), np.eye(size),
    )  # fmt: skip
    found = plausible_laws(told, objective, [])
    assert found.status == "poor"
    assert found.agreement is not None
    assert found.agreement < 0.05
    assert not found.alpha


@pytest.mark.parametrize("corner", [True, False])
def test_where_no_draw_has_a_likelihood_there_are_no_draws(corner: bool) -> None:
    """In a corner of 20 limits hardly any candidate lies inside, and a spike has none beside it."""
    size = 20 if corner else 2

    def objective(alpha: Array) -> LogLikelihood:
        value = 0.0 if corner or np.all(alpha == 0.5) else -np.inf
        return LogLikelihood(np.array([value]), np.zeros((1, size)), np.zeros(1, np.int64))

    at, unsure = np.full(size, 0.0 if corner else 0.5), np.full((size, 2), np.nan)
    told = Estimated(
        at, unsure[:, 0], unsure, np.tile([0.0, 1.0], (size, 1)),
        at < 1.0, at > 1.0, np.arange(size), np.eye(size),
    )  # fmt: skip
    assert draws_by_likelihood(told, objective, [at] * 30) is None
    found = plausible_laws(told, objective, [at] * 30)
    assert (found.status, found.effective, found.alpha) == ("poor", None, ())


def test_nothing_uncertain_is_evaluated_nowhere() -> None:
    told = known([1.0, 1.0], np.full(2, np.nan), np.full((2, 2), np.nan), 0.0)
    told.free[:] = False

    def never(alpha: Array) -> LogLikelihood:
        raise AssertionError(alpha)

    assert plausible_laws(told, never, []).status == "normal"
    assert AlphaDraws.at(told.alpha).certain
