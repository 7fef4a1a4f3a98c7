"""Priors of hyperparameters against the densities and slopes of SciPy's distributions."""

import numpy as np
import pytest
from scipy import stats

from aleator import Beta, Constant, Free, Gamma, LogNormal, Normal, TruncatedNormal, Uniform
from aleator.errors import InputsError
from aleator.laws import Law, resolve
from aleator.laws.hyperparameter import Prior, curvatures, log_prior, prior_score


def of_gamma(mean: float, sd: float) -> stats.rv_continuous:
    return stats.gamma((mean / sd) ** 2, scale=sd**2 / mean)


def of_lognormal(mean: float, sd: float) -> stats.rv_continuous:
    s = np.sqrt(np.log1p((sd / mean) ** 2))
    return stats.lognorm(s, scale=mean * np.exp(-0.5 * s**2))


CASES = [
    (Normal(1.0, 0.1), stats.norm(1.0, 0.1), (0.5, 1.5)),
    (Gamma(2.0, 1.0), of_gamma(2.0, 1.0), (1e-6, 9.0)),
    (LogNormal(0.5, 0.3), of_lognormal(0.5, 0.3), (1e-3, 5.0)),
    (Beta((0.0, 1.0), 0.6, 0.2), stats.beta(3.0, 2.0), (0.01, 0.99)),
    (Uniform.between(0.0, 4.0), stats.uniform(0.0, 4.0), (0.5, 3.0)),
    (TruncatedNormal((0.0, 10.0), 0.0, 2.0), stats.halfnorm(0.0, 2.0), (1e-6, 8.0)),
]


@pytest.mark.parametrize(("law", "truth", "limits"), CASES, ids=lambda v: type(v).__name__)
def test_density_slope_and_curvature_are_those_of_the_law(
    law: Law, truth: stats.rv_continuous, limits: tuple[float, float]
) -> None:
    prior = Prior.of(law, "x.mean", *limits)
    for value in np.linspace(*limits, 7):
        wanted = truth.logpdf(value)
        assert prior.log_density(value) == pytest.approx(wanted, abs=2e-6)
        h = 1e-5 * min(1.0, value)
        # the house's own density, because its constant may be rounded otherwise
        slope = (prior.log_density(value + h) - prior.log_density(value - h)) / (2.0 * h)
        assert prior.slope(value) == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_slope_and_curvature_of_a_normal_prior_are_exact() -> None:
    prior = Prior.of(Normal(1.0, 0.1), "x.mean", 0.0, 2.0)
    for value in (0.1, 0.9, 1.0, 1.7):
        assert prior.slope(value) == pytest.approx(-(value - 1.0) / 0.01, rel=1e-9, abs=1e-8)
        assert prior.curvature(value) == pytest.approx(100.0, rel=1e-6)


def test_slope_of_a_gamma_prior_holds_close_to_the_end_of_its_support() -> None:
    prior = Prior.of(Gamma(2.0, 1.0), "x.sd", 1e-6, 9.0)
    # shape 4, scale 1/2: d log p = 3/v - 2
    for value in (1e-6, 1e-3, 1.0, 9.0):
        assert prior.slope(value) == pytest.approx(3.0 / value - 2.0, rel=1e-7)


def test_slopes_at_the_end_where_a_density_stops_are_those_beside_it() -> None:
    half = Prior.of(TruncatedNormal((0.0, 10.0), 0.0, 2.0), "x.mean", 0.0, 10.0)
    assert half.slope(0.0) == pytest.approx(0.0, abs=1e-8)
    assert half.slope(10.0) == pytest.approx(-2.5, abs=1e-8)
    assert Prior.of(Uniform.between(0.5, 1.5), "x.mean", 0.5, 1.5).slope(0.5) == 0.0


def test_priors_add_up_over_the_hyperparameters_that_have_one() -> None:
    law = Normal(Free(0.0, 2.0, prior=Normal(1.0, 0.1)), Free(0.1, 1.0))
    alpha = np.array([1.2, 0.5])
    assert log_prior(law.hyperparameters, alpha) == pytest.approx(stats.norm.logpdf(1.2, 1.0, 0.1))
    score = prior_score(law.hyperparameters, alpha)
    assert score is not None
    np.testing.assert_allclose(score, [-20.0, 0.0], rtol=1e-9)
    np.testing.assert_allclose(curvatures(law.hyperparameters, alpha), [100.0, 0.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("prior", "says"),
    [
        (Normal(Free(0.0, 1.0), 0.1), "mean to be identified"),
        (Constant(1.0), "a constant"),
        (Normal(100.0, 0.1), "hold 0 of the prior"),
        (Gamma(1.0, 0.5), "lower limit -10"),
        (Uniform.between(-20.0, 5.0), "upper limit 10"),
    ],
)
def test_a_prior_that_cannot_be_used_is_told(prior: Law, says: str) -> None:
    with pytest.raises(InputsError, match=says) as told:
        resolve("x.mean", Free(-10.0, 10.0, prior=prior), (None, None))
    assert told.value.remedy
    assert "x.mean" in told.value.problem


def test_a_flat_prior_bends_nothing() -> None:
    prior = Prior.of(Uniform.between(0.0, 4.0), "x.mean", 1.0, 3.0)
    assert prior.slope(2.0) == pytest.approx(0.0, abs=1e-9)
    assert prior.curvature(2.0) == pytest.approx(0.0, abs=1e-6)


def test_without_a_prior_there_is_no_score() -> None:
    law = Normal(Free(0.0, 2.0), 0.5)
    assert prior_score(law.hyperparameters, np.array([1.0, 0.5])) is None
    assert log_prior(law.hyperparameters, np.array([1.0, 0.5])) == 0.0
