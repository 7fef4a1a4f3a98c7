"""Censored outcomes without noise: probabilities of bands against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from aleator import Constant, Free, Inputs, LogNormal, Mixture, Normal, Uniform
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.likelihood.level_sets.sets import JoinedSets
from aleator.simulators.response_functions import DirectResponse

Array = NDArray[np.float64]
NO = np.inf
NORMAL = Normal(Free(-1.0, 3.0), Free(0.01, 1.0))
LOG_NORMAL = LogNormal(Free(0.2, 5.0), Free(0.01, 2.0))
ONE, TWO, THREE = (Inputs(dict.fromkeys("abc"[:count], NORMAL)) for count in (1, 2, 3))
SUM = np.array([[2.0, 2.4, -NO, 1.75, 1.9], [2.0, NO, 1.2, 1.85, 2.6]])
"""An exact sum of two parameters, two with one bound, and two with two bounds."""


def likelihood(
    inputs: Inputs, outcome: Callable[..., Array], bounds: Array, cells: int
) -> LevelLikelihood:
    response = DirectResponse(lambda _, x: outcome(*x.T), 1, inputs.box)
    condition = np.zeros(bounds.shape[1], dtype=np.intp)
    y = np.where(np.isfinite(bounds[0]), bounds[0], bounds[1])
    return LevelLikelihood(inputs, response, inputs.box, condition, y, cells, bounds=bounds)


def of_law(law: stats.rv_continuous, bounds: Array) -> Array:
    """The log-densities of exact values under a law, and the log probabilities of censored ones."""
    low, high = bounds
    between = np.log(np.maximum(law.cdf(high) - law.cdf(low), 1e-300))
    return np.where(low == high, law.logpdf(low), between)


def require_scores(of: LevelLikelihood, alpha: Array, rtol: float = 1e-4) -> None:
    scores = of(alpha).scores
    for k, step in enumerate(1e-4 * np.eye(alpha.size)):
        slope = (of.evaluate(alpha + step).each - of.evaluate(alpha - step).each) / 2e-4
        np.testing.assert_allclose(scores[:, k], slope, rtol=rtol, atol=2e-4)


def test_one_parameter_has_the_probabilities_of_its_law() -> None:
    bounds, alpha = SUM - 1.0, np.array([1.0, 0.3])
    of = likelihood(ONE, lambda a: a, bounds, 1024)
    exact = of_law(stats.norm(*alpha), bounds)
    np.testing.assert_allclose(of.evaluate(alpha).each, exact, atol=1e-5)
    require_scores(of, alpha)


def test_a_fold_has_both_of_its_branches() -> None:
    """(a - 0.9)^2 between bounds, of a normal parameter."""
    bounds, law = np.array([[0.01, 0.04, -NO], [0.09, NO, 0.04]]), stats.norm(1.0, 0.3)
    found = likelihood(ONE, lambda a: (a - 0.9) ** 2, bounds, 256).evaluate(np.array([1.0, 0.3]))
    high, low = np.sqrt(np.maximum(bounds[1], 0.0)), np.sqrt(np.maximum(bounds[0], 0.0))
    right = law.cdf(0.9 + high) - law.cdf(0.9 + low)
    left = law.cdf(0.9 - low) - law.cdf(0.9 - high)
    np.testing.assert_allclose(found.each, np.log(left + right), atol=3e-6)


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_a_product_of_two_lognormal_parameters_is_lognormal(rho: float) -> None:
    laws = {"a": LOG_NORMAL, "b": LOG_NORMAL}
    inputs = Inputs(laws, {("a", "b"): Free(-0.95, 0.95)}) if rho else Inputs(laws)
    alpha = np.array([1.0, 0.3, 1.2, 1.0, rho][: 5 if rho else 4])
    bounds = np.array([[1.0, 1.2, 0.0, 0.9, 3.0], [1.0, NO, 0.7, 1.1, NO]])
    of = likelihood(inputs, lambda a, b: a * b, bounds, 96)
    variance = np.log1p((alpha[1:4:2] / alpha[:4:2]) ** 2)
    mean = np.sum(np.log(alpha[:4:2]) - 0.5 * variance)
    sd = np.sqrt(variance.sum() + 2.0 * rho * np.sqrt(variance.prod()))
    exact = of_law(stats.lognorm(sd, scale=np.exp(mean)), bounds)
    np.testing.assert_allclose(of.evaluate(alpha).each, exact, atol=2e-5)
    require_scores(of, alpha)


def test_the_error_falls_with_the_third_power_of_the_cells_or_faster() -> None:
    inputs, alpha = Inputs({"a": LOG_NORMAL, "b": LOG_NORMAL}), np.array([1.0, 1.5, 1.2, 0.5])
    variance = np.log1p((alpha[1::2] / alpha[::2]) ** 2)
    mean = np.sum(np.log(alpha[::2]) - 0.5 * variance)
    bounds = np.array([[1.2, 0.0, 0.9, 3.0], [NO, 0.7, 1.1, NO]])
    exact = of_law(stats.lognorm(np.sqrt(variance.sum()), scale=np.exp(mean)), bounds)
    coarse, fine = (
        np.abs(likelihood(inputs, np.multiply, bounds, cells).evaluate(alpha).each - exact).max()
        for cells in (48, 96)
    )
    assert fine < coarse / 8.0 < 2e-5


@pytest.mark.parametrize("infinite", [True, False])
def test_a_life_without_end_is_longer_than_any_bound_and_a_failed_run_is_not(
    infinite: bool,
) -> None:
    """a + b up to 2.2; beyond, the life is infinite, or the run fails."""
    bounds, law = np.array([[1.8, 2.2], [NO, NO]]), stats.norm(2.0, np.hypot(0.3, 0.2))
    beyond = NO if infinite else np.nan
    of = likelihood(TWO, lambda a, b: np.where(a + b > 2.2, beyond, a + b), bounds, 32)
    found = np.exp(of.evaluate(np.array([1.0, 0.3, 1.0, 0.2])).each)
    exact = law.sf(bounds[0]) if infinite else [law.cdf(2.2) - law.cdf(1.8), 0.0]
    np.testing.assert_allclose(found, exact, atol=1e-3)
    assert of.unreached.tolist() == [False, not infinite]


def test_three_parameters_on_lines() -> None:
    bounds, alpha = SUM + 1.0, np.array([1.0, 0.3, 0.8, 0.2, 1.2, 0.4])
    law = stats.norm(3.0, np.sqrt(0.29))
    plain = likelihood(THREE, lambda a, b, c: a + b + c, bounds, 16)
    np.testing.assert_allclose(plain.evaluate(alpha).each, of_law(law, bounds), atol=2e-6)
    require_scores(plain, alpha)
    bent = likelihood(THREE, lambda a, b, c: np.exp(a + b + c), np.exp(bounds), 16)
    exact = of_law(law, bounds) - np.where(bounds[0] == bounds[1], bounds[0], 0.0)
    np.testing.assert_allclose(bent.evaluate(alpha).each, exact, atol=1e-5)


def test_spheres_on_lines_have_the_chi_square_law() -> None:
    """The lines of a sphere end where they miss it: more of them make the sum exact."""
    inputs = Inputs(dict.fromkeys("abc", Normal(0.0, Free(0.1, 3.0))))
    bounds = np.array([[3.0, -NO, 1.0], [NO, 2.0, 4.0]])
    of = likelihood(inputs, lambda a, b, c: a * a + b * b + c * c, bounds, 128)
    found = of.evaluate(np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0])).each
    np.testing.assert_allclose(found, of_law(stats.chi2(3), bounds), atol=0.03)


def test_a_constant_that_is_identified_and_a_law_whose_support_moves() -> None:
    bounds = np.array([[2.0, 2.3, -NO], [2.0, NO, 2.2]])
    of = likelihood(
        Inputs({"a": NORMAL, "c": Constant(Free(-2.0, 4.0))}), lambda a, c: a + c, bounds, 16
    )
    alpha = np.array([1.0, 0.3, 1.2])
    exact = of_law(stats.norm(2.2, 0.3), bounds)
    np.testing.assert_allclose(of.evaluate(alpha).each, exact, atol=1e-6)
    require_scores(of, alpha)
    uniform = Inputs({"a": Uniform(Free(0.0, 3.0), Free(0.1, 2.0))})
    half = np.sqrt(3.0) * 0.5
    exact = of_law(stats.uniform(2.0 - half, 2.0 * half), bounds)
    found = likelihood(uniform, lambda a: a, bounds, 16).evaluate(np.array([2.0, 0.5]))
    np.testing.assert_allclose(found.each, exact, atol=5e-6)


def test_components_of_a_mixture_far_apart() -> None:
    inputs = Inputs({"a": Mixture((NORMAL, NORMAL))})
    bounds = np.array([[0.5, 1.0, -NO], [0.5, NO, 0.2]])
    names = [h.name for h in inputs.hyperparameters]
    alpha = np.array([0.3 if "share" in n or "weight" in n else 0.0 for n in names])
    alpha[[names.index(n) for n in names if n.endswith("sd")]] = 0.01, 0.2
    alpha[[names.index(n) for n in names if n.endswith("mean")]] = 0.0, 1.0
    found = np.exp(likelihood(inputs, lambda a: a, bounds, 1024).evaluate(alpha).each)
    one, two = (np.exp(of_law(stats.norm(*law), bounds)) for law in ((0.0, 0.01), (1.0, 0.2)))
    np.testing.assert_allclose(found, 0.3 * one + 0.7 * two, atol=1e-5)


def test_equal_bounds_share_a_band_and_parts_are_parts() -> None:
    bounds = np.tile(SUM, 40)
    of = likelihood(TWO, lambda a, b: a + b, bounds, 48)
    alpha = np.array([1.0, 0.3, 1.0, 0.2])
    sets, found = of.sets(alpha), of(alpha)
    assert isinstance(sets, JoinedSets)
    assert [len(part.x) for part in sets.parts] == [40, 4]
    one = likelihood(TWO, lambda a, b: a + b, SUM, 48)(alpha)
    np.testing.assert_allclose(found.each, np.tile(one.each, 40), rtol=1e-12)
    rows = np.array([6, 3, 5])
    np.testing.assert_allclose(of.take(rows)(alpha).scores, found.scores[rows], rtol=1e-9)
    means = np.empty((200, 2))
    for own, x, share in sets.points(alpha):
        means[own] = np.einsum("nk,nki->ni", share, x)
    np.testing.assert_allclose(means[5:10], means[:5], rtol=1e-12)
    z = (SUM[0, 1] - 2.0) / np.hypot(0.3, 0.2)
    excess = np.hypot(0.3, 0.2) * stats.norm.pdf(z) / stats.norm.sf(z)
    assert means[1].sum() == pytest.approx(2.0 + excess, abs=1e-4)
