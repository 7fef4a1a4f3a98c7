"""Tolerance limits of normal samples against the exact factors."""

import numpy as np
import pytest
from scipy import optimize, stats

from aleator.inference.rare_events import content_interval, quantile_bound

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
