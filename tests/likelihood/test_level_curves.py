"""Level sets of several outcomes against closed forms: change of variables, folds, closed curves.

A curve's density is that of a change of variables in which the parameters not seen are integrated
out in closed form, or by SciPy's quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate, stats

from aleator import Constant, Free, Inputs, LogNormal, Mixture, Normal
from aleator.core.types import Array
from aleator.likelihood.level_sets.likelihood import LEVELS, LevelLikelihood
from aleator.simulators.response_functions import DirectResponse

Map = Callable[..., Array]
NORMAL = Normal(Free(-2.0, 2.0), Free(0.1, 3.0))
POSITIVE = LogNormal(Free(0.1, 5.0), Free(0.01, 3.0))


def likelihood(
    inputs: Inputs, maps: tuple[Map, ...], y: Array, cells: int = LEVELS.together
) -> LevelLikelihood:
    """All experiments under the same conditions; y is (N, m)."""

    def run(index: Array, x: Array) -> Array:
        found = np.empty(len(x))
        for k, one in enumerate(maps):
            with np.errstate(all="ignore"):
                found[index == k] = one(*x[index == k].T)
        return found

    response = DirectResponse(run, len(maps), inputs.box)
    condition = np.tile(np.arange(len(maps)), (len(y), 1))
    return LevelLikelihood(inputs, response, inputs.box, condition, y, cells)


def logs(alpha: Array) -> tuple[Array, Array]:
    """The means and the variances of the logarithms of lognormal parameters."""
    mean, sd = alpha[::2], alpha[1::2]
    variance = np.log1p((sd / mean) ** 2)
    return np.log(mean) - 0.5 * variance, variance


def standard(count: int, parameters: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).standard_normal((count, parameters))


# ------------------------------------------------------------- as many outcomes as parameters


def correlated() -> tuple[Inputs, Array, Array, Array]:
    """Two correlated lognormal parameters, and the law of log(a b) and log(a/b)."""
    inputs = Inputs({"a": POSITIVE, "b": POSITIVE}, {("a", "b"): Free(-0.9, 0.9)})
    alpha = np.array([1.0, 0.3, 1.4, 0.5, 0.6])
    mean, variance = logs(alpha[:4])
    covariance = np.diag(variance)
    covariance[0, 1] = covariance[1, 0] = 0.6 * np.sqrt(variance.prod())
    turn = np.array([[1.0, 1.0], [1.0, -1.0]])
    return inputs, alpha, turn @ mean, turn @ covariance @ turn.T


def test_a_product_and_a_ratio_are_a_change_of_variables() -> None:
    inputs, alpha, mean, covariance = correlated()
    z = mean + standard(50, 2) @ np.linalg.cholesky(covariance).T
    levels = likelihood(inputs, (lambda a, b: a * b, lambda a, b: a / b), np.exp(z))
    found = levels(alpha)
    exact = stats.multivariate_normal.logpdf(z, mean, covariance) - z.sum(axis=1)
    np.testing.assert_allclose(found.each, exact, atol=1e-8)
    assert found.scores is not None
    for k in range(5):
        step = 1e-5 * np.eye(5)[k]
        up, down = (levels.evaluate(alpha + by).each for by in (step, -step))
        np.testing.assert_allclose(found.scores[:, k], (up - down) / 2e-5, atol=1e-4)


@pytest.mark.parametrize("kind", ["kink", "fold"])
def test_both_preimages_of_a_map_that_folds_are_found(kind: str) -> None:
    """(a b, |log(a/b)|) and (a b, log(a/b)^2)."""
    inputs, alpha, mean, covariance = correlated()
    z = mean + standard(50, 2) @ np.linalg.cholesky(covariance).T
    away = np.abs(z[:, 1])
    law = stats.multivariate_normal(mean, covariance)
    both = sum(law.pdf(np.stack([z[:, 0], sign * away], axis=1)) for sign in (1.0, -1.0))
    exact = np.log(both) - z[:, 0]
    if kind == "kink":
        second, y = (lambda a, b: np.abs(np.log(a / b))), away
    else:
        second, y, exact = (lambda a, b: np.log(a / b) ** 2), away**2, exact - np.log(2.0 * away)
    levels = likelihood(inputs, (lambda a, b: a * b, second), np.stack([np.exp(z[:, 0]), y], 1))
    np.testing.assert_allclose(levels.evaluate(alpha).each, exact, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_more_cells_find_no_more_preimages_of_waves(seed: int) -> None:
    """Random maps that fold; 20 such maps with 300 outcomes each gave the same answer."""
    inputs, alpha = Inputs({"a": NORMAL, "b": NORMAL}), np.array([0.0, 1.0, 0.0, 1.0])
    c = np.random.default_rng(seed).normal(size=(2, 7))

    def wave(k: int) -> Map:
        return lambda a, b: (
            c[k, 0] * a + c[k, 1] * b + c[k, 2] * np.sin(1.5 * a + c[k, 3])
            + c[k, 4] * np.cos(1.3 * c[k, 5] * b) + 0.3 * c[k, 6] * a * b
        )  # fmt: skip

    maps = (wave(0), wave(1))
    y = np.stack([one(*standard(100, 2).T) for one in maps], axis=1)
    found, finer = (likelihood(inputs, maps, y, cells) for cells in (LEVELS.together, 200))
    preimages = np.isfinite(found.sets(alpha).log_weight).sum(axis=1)
    assert preimages.max() > 1
    np.testing.assert_allclose(found.evaluate(alpha).each, finer.evaluate(alpha).each, atol=2e-6)


def test_three_outcomes_of_three_parameters() -> None:
    """(a b, a/b, a b c) of lognormal parameters."""
    inputs, alpha = Inputs(dict.fromkeys("abc", POSITIVE)), np.array([1.0, 0.3, 1.4, 0.5, 0.8, 0.2])
    mean, variance = logs(alpha)
    turn = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])
    z = (mean + np.sqrt(variance) * standard(30, 3)) @ turn.T
    maps = (lambda a, b, _: a * b, lambda a, b, _: a / b, lambda a, b, c: a * b * c)
    found = likelihood(inputs, maps, np.exp(z)).evaluate(alpha)
    covariance = turn @ np.diag(variance) @ turn.T
    exact = stats.multivariate_normal.logpdf(z, turn @ mean, covariance) - z.sum(axis=1)
    np.testing.assert_allclose(found.each, exact, atol=1e-8)


# ------------------------------------------------------------- one outcome less than parameters


def test_two_products_of_three_parameters() -> None:
    inputs, alpha = Inputs(dict.fromkeys("abc", POSITIVE)), np.array([1.0, 0.3, 1.4, 0.5, 0.8, 0.2])
    mean, variance = logs(alpha)
    turn = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0]])
    z = (mean + np.sqrt(variance) * standard(30, 3)) @ turn.T
    maps = (lambda a, b, c: a * b * c, lambda a, b, _: a / b)
    covariance = turn @ np.diag(variance) @ turn.T
    exact = stats.multivariate_normal.logpdf(z, turn @ mean, covariance) - z.sum(axis=1)
    errors = [
        np.abs(likelihood(inputs, maps, np.exp(z), cells).evaluate(alpha).each - exact).max()
        for cells in (4, 8, LEVELS.together)
    ]
    assert errors[1] < errors[0] / 5.0
    assert errors[2] < 1e-8


def test_a_curve_that_bends_is_integrated_as_by_quadrature() -> None:
    """(a + b c, c + a^2/2): each a gives c, and with it b, of which the slope is c."""
    inputs = Inputs(dict.fromkeys("abc", NORMAL))
    alpha = np.array([0.2, 0.8, 1.0, 0.4, 0.1, 0.9])
    law = stats.norm(alpha[::2], alpha[1::2])
    x = alpha[::2] + alpha[1::2] * standard(4, 3, 3)
    maps = (lambda a, b, c: a + b * c, lambda a, _, c: c + 0.5 * a**2)
    y = np.stack([one(*x.T) for one in maps], axis=1)

    def along(a: float, first: float, second: float) -> float:
        c = second - 0.5 * a**2
        return float(np.prod(law.pdf([a, (first - a) / c, c]))) / abs(c)

    exact = []
    for first, second in y:
        zero = np.sqrt(2.0 * max(second, 0.0))
        ends = np.unique([-7.0, -zero, first, zero, 7.0])
        parts = [integrate.quad(along, *pair, args=(first, second), epsabs=1e-13, limit=400)[0]
                 for pair in pairwise(ends)]  # fmt: skip
        exact.append(np.log(sum(parts)))
    found = likelihood(inputs, maps, y).evaluate(alpha)
    np.testing.assert_allclose(found.each, exact, atol=1e-6)


def test_closed_curves_however_small() -> None:
    """a^2 + b^2 has the law chi2(2), and c is normal: circles of radii down to a hundredth."""
    inputs, alpha = Inputs(dict.fromkeys("abc", NORMAL)), np.array([0.0, 1.0] * 3)
    y = np.stack([[1e-4, 0.01, 0.3, 2.0, 9.0], [0.1, -1.0, 0.5, 2.0, 0.0]], axis=1)
    found = likelihood(inputs, (lambda a, b, _: a**2 + b**2, lambda _a, _b, c: c), y)
    exact = stats.chi2(2).logpdf(y[:, 0]) + stats.norm.logpdf(y[:, 1])
    np.testing.assert_allclose(found.evaluate(alpha).each, exact, atol=1e-6)


@pytest.mark.parametrize("kind", ["kink", "jump"])
def test_curves_with_a_corner_or_a_gap(kind: str) -> None:
    """(|a| + b, c), and (a + b + 2 above a = 0.3, c)."""
    inputs, alpha = Inputs(dict.fromkeys("abc", NORMAL)), np.array([0.0, 1.0] * 3)
    x, cdf, root = standard(30, 3, 5), stats.norm.cdf, np.sqrt(2.0)

    def of_sum(y: Array, low: Array | float, high: Array | float) -> Array:
        """The density of a + b at y where (a - b)/sqrt(2) lies between two ends."""
        return stats.norm.pdf(y / root) / root * (cdf(high) - cdf(low))

    if kind == "kink":
        first: Map = lambda a, b, _: np.abs(a) + b  # noqa: E731
        y = first(*x.T)
        density = 2.0 * of_sum(y, -np.inf, y / root)
    else:
        first = lambda a, b, _: a + b + 2.0 * (a > 0.3)  # noqa: E731
        y = first(*x.T)
        density = of_sum(y, -np.inf, (0.6 - y) / root)
        density += of_sum(y - 2.0, (0.6 - (y - 2.0)) / root, np.inf)
    levels = likelihood(inputs, (first, lambda _a, _b, c: c), np.stack([y, x[:, 2]], axis=1))
    exact = np.log(density) + stats.norm.logpdf(x[:, 2])
    np.testing.assert_allclose(levels.evaluate(alpha).each, exact, atol=2e-3)


# ------------------------------------------------------------- constants, mixtures, probabilities


def test_the_score_by_a_constant() -> None:
    """(k a b, a/b): log k only shifts the law of the first logarithm."""
    inputs = Inputs({"a": POSITIVE, "b": POSITIVE, "k": Constant(Free(0.5, 2.0))})
    alpha = np.array([1.0, 0.3, 1.4, 0.5, 1.2])
    mean, variance = logs(alpha[:4])
    turn = np.array([[1.0, 1.0], [1.0, -1.0]])
    z = (mean + np.sqrt(variance) * standard(20, 2)) @ turn.T
    levels = likelihood(inputs, (lambda a, b, k: k * a * b, lambda a, b, _: a / b), np.exp(z))

    def exact(k: float) -> Array:
        shifted = turn @ mean + [np.log(k), 0.0]
        law = stats.multivariate_normal(shifted, turn @ np.diag(variance) @ turn.T)
        return law.logpdf(z) - z.sum(axis=1)

    found = levels(alpha)
    np.testing.assert_allclose(found.each, exact(1.2), atol=1e-8)
    assert found.scores is not None
    slope = (exact(1.2001) - exact(1.1999)) / 2e-4
    np.testing.assert_allclose(found.scores[:, 4], slope, atol=1e-3)


def test_a_mixture_seen_through_two_outcomes() -> None:
    """(a + b, a - b) with a of two normal components."""
    inputs = Inputs({"a": Mixture((NORMAL, NORMAL)), "b": NORMAL})
    alpha = np.array([-1.0, 0.1, 1.0, 0.3, 0.4, 0.0, 0.5])
    x = standard(30, 2)
    x[:, 0] = np.where(x[:, 0] < -0.25, -1.0 + 0.1 * x[:, 1], 1.0 + 0.3 * x[:, 0])
    y = np.stack([x[:, 0] + x[:, 1], x[:, 0] - x[:, 1]], axis=1)
    found = likelihood(inputs, (lambda a, b: a + b, lambda a, b: a - b), y)(alpha)
    parts = [0.4 * stats.norm.pdf(x[:, 0], -1.0, 0.1), 0.6 * stats.norm.pdf(x[:, 0], 1.0, 0.3)]
    exact = np.log(sum(parts)) + stats.norm.logpdf(x[:, 1], 0.0, 0.5) - np.log(2.0)
    np.testing.assert_allclose(found.each, exact, atol=1e-8)
    assert found.scores is not None
    by_share = (parts[0] / 0.4 - parts[1] / 0.6) / sum(parts)
    np.testing.assert_allclose(found.scores[:, 4], by_share, atol=1e-4)


def test_probabilities_given_the_earlier_outcomes() -> None:
    """(a + b, a): given the sum, a is normal."""
    inputs, alpha = Inputs({"a": NORMAL, "b": NORMAL}), np.array([0.3, 0.8, 0.0, 0.6])
    x = alpha[::2] + alpha[1::2] * standard(30, 2)
    y = np.stack([x.sum(axis=1), x[:, 0]], axis=1)
    levels = likelihood(inputs, (lambda a, b: a + b, lambda a, _: a), y)
    share = 0.64 / (0.64 + 0.36)
    mean, sd = 0.3 + share * (y[:, 0] - 0.3), 0.8 * np.sqrt(1.0 - share)
    found = levels.probabilities(alpha, np.full(30, 0.5))
    np.testing.assert_allclose(found[:, 1], stats.norm.cdf(x[:, 0], mean, sd), atol=5e-3)
