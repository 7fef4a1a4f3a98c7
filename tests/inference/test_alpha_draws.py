"""Draws of alpha from intervals, and limits that hold a share of all with a confidence."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize, stats

from aleator import Free, Inputs, Normal
from aleator.errors import InputsError
from aleator.inference.alpha_draws import AlphaDraws, Estimated, alpha_draws, estimated, quantiles
from aleator.inference.rare_events import content_interval, quantile_bound
from aleator.results.values import Estimate


def known(alpha, error, interval, limits, correlation=None, which=None) -> Estimated:
    size = len(alpha)
    which = range(size) if which is None else which
    return Estimated(
        np.array(alpha, float), np.array(error, float), np.array(interval, float),
        np.array(limits, float), np.ones(size, bool), np.array([False, True][:size]),
        np.array([*which], np.intp),
        np.eye(len(which)) if correlation is None else np.array(correlation, float),
    )  # fmt: skip


WIDE = [-100.0, 100.0]


def test_a_quarter_of_the_draws_is_beyond_no_end_and_one_in_forty_is() -> None:
    """Intervals come back as the 2.5 % and 97.5 % quantiles, skew ones too; so do correlations."""
    told = known([1.0, 2.0], [0.5, 0.3], [[0.0, 2.0], [1.6, 3.1]], [WIDE, WIDE],
                 [[1.0, 0.6], [0.6, 1.0]])  # fmt: skip
    draws = alpha_draws(told, 4096)
    ends = quantiles(draws.alpha.T, draws.weights, np.array([0.025, 0.5, 0.975]))
    assert ends == pytest.approx(np.array([[0.0, 1.0, 2.0], [1.6, 2.0, 3.1]]), abs=0.02)
    assert np.corrcoef(draws.z.T)[0, 1] == pytest.approx(0.6, abs=0.01)


def test_symmetric_intervals_keep_the_mean_exactly() -> None:
    draws = alpha_draws(known([1.0], [0.5], [[0.02, 1.98]], [WIDE]), 256)
    assert draws.weights @ draws.alpha == pytest.approx([1.0], abs=1e-12)


def test_nothing_leaves_the_limits_and_what_is_on_one_is_a_half_normal() -> None:
    told = known([0.0, 1.0], [np.nan, 0.6], [[np.nan, 0.49], [np.nan, 2.3]],
                 [[0.0, 5.0], [0.5, 5.0]], [[1.0]], [1])  # fmt: skip
    told.interval[0] = [0.0, 0.49]
    told.interval[1] = [0.5, 2.3]
    draws = alpha_draws(told, 2048)
    assert np.all((draws.alpha >= told.limits[:, 0]) & (draws.alpha <= told.limits[:, 1]))
    assert stats.kstest(draws.alpha[:, 0], stats.halfnorm(scale=0.25).cdf).statistic < 0.02
    assert draws.fixed.size == 0


def test_what_has_neither_error_nor_interval_is_held_and_named() -> None:
    told = known([1.0, 2.0], [0.5, np.nan], [[0.0, 2.0], [np.nan, np.nan]], [WIDE, WIDE],
                 [[1.0]], [0])  # fmt: skip
    draws = alpha_draws(told, 64)
    assert np.all(draws.alpha[:, 1] == 2.0)
    assert draws.fixed.tolist() == [1]
    nothing = known([1.0], [np.nan], [[np.nan, np.nan]], [WIDE], np.empty((0, 0)), [])
    assert alpha_draws(nothing).certain


def test_weights_by_the_likelihood_make_the_draws_exact() -> None:
    """Mean and sd of ten normal values: sd^2 is SS over chi^2 with nine degrees of freedom."""
    y = stats.norm.ppf((np.arange(10) + 0.5) / 10)
    total = np.sum((y - y.mean()) ** 2)

    def objective(alpha):
        value = np.sum(stats.norm.logpdf(y, *alpha))
        return SimpleNamespace(total=value)

    sd = np.sqrt(total / 10)
    down, up = 0.66 * sd, 1.69 * sd
    told = known([y.mean(), sd], [sd / np.sqrt(10), sd / np.sqrt(20)],
                 [[y.mean() - 0.69 * sd, y.mean() + 0.69 * sd], [down, up]],
                 [WIDE, [1e-3, 50.0]])  # fmt: skip
    draws = alpha_draws(told, 4096, wide=1.3).reweighted(objective)
    assert draws.effective > 2000
    probabilities = np.array([0.05, 0.5, 0.95])
    found = quantiles(draws.alpha[:, 1], draws.weights, probabilities)
    exact = np.sqrt(total / stats.chi2.ppf(1.0 - probabilities, 9))
    assert found == pytest.approx(exact, rel=0.03)
    score = (draws.alpha[:, 0] - y.mean()) / (np.std(y, ddof=1) / np.sqrt(10))
    found = quantiles(score, draws.weights, probabilities)
    assert found == pytest.approx(stats.t.ppf(probabilities, 9), abs=0.06)


def test_a_known_alpha_is_one_draw() -> None:
    assert AlphaDraws.at(np.array([1.0, 2.0])).effective == 1.0


LAWS = 1024
N = 12


def one_sided(content: float, confidence: float) -> float:
    """k of mean + k s: a quantile of noncentral t."""
    root = np.sqrt(N)
    return stats.nct.ppf(confidence, N - 1, stats.norm.ppf(content) * root) / root


def two_sided(content: float, confidence: float) -> float:
    """k of mean -+ k s: the integral over the mean (Wald and Wolfowitz, 1946)."""

    z, weights = np.polynomial.hermite_e.hermegauss(20)
    z, weights = z / np.sqrt(N), weights / weights.sum()
    r = np.array(
        [
            optimize.brentq(
                lambda r, m=m: stats.norm.cdf(m + r) - stats.norm.cdf(m - r) - content, 0.0, 30.0
            )
            for m in z
        ]
    )

    def excess(k: float) -> float:
        return float(weights @ stats.chi2.sf((N - 1) * (r / k) ** 2, N - 1)) - confidence

    return optimize.brentq(excess, 1.0, 9.0)


@pytest.fixture(scope="module")
def sample():
    """Laws N(mean, sd) given a normal sample with mean zero and s = 1, and quantiles of each."""
    rng = np.random.default_rng(0)
    sd = np.sqrt((N - 1) / rng.chisquare(N - 1, LAWS))
    mean = sd * rng.standard_normal(LAWS) / np.sqrt(N)
    score = stats.norm.ppf((np.arange(500) + 0.5) / 500)
    y = mean[:, None] + sd[:, None] * score
    return y, np.full(y.shape, 1.0 / 500), np.full(LAWS, 1.0 / LAWS)


def test_one_sided_limits_have_the_factor_of_noncentral_t(sample) -> None:
    for confidence in (0.05, 0.95):
        found, _ = quantile_bound(*sample, 0.95, confidence)
        assert found == pytest.approx(one_sided(0.95, confidence), rel=0.03)


def test_two_sided_limits_have_the_exact_factor(sample) -> None:
    low, high = content_interval(*sample, 0.95, 0.95)
    assert [-low, high] == pytest.approx([two_sided(0.95, 0.95)] * 2, rel=0.03)
    narrow = content_interval(*sample, 0.95, 0.5)
    assert low < narrow[0] < narrow[1] < high


INPUTS = Inputs({"x": Normal(Free(0.0, 2.0), Free(0.1, 1.0))})


def test_a_correlation_of_a_name_that_is_no_hyperparameter_is_told() -> None:
    alpha = {
        name: Estimate(0.5, 0.1, 0.1, (0.3, 0.7), None, fixed=False) for name in ("x.mean", "x.sd")
    }
    found = estimated(alpha, ["x.sd", "x.mean"], [[1.0, 0.2], [0.2, 1.0]], INPUTS.hyperparameters)
    assert found.which.tolist() == [1, 0]
    with pytest.raises(InputsError, match="2147483648"):
        estimated(alpha, ["2147483648"], [[1.0]], INPUTS.hyperparameters)
