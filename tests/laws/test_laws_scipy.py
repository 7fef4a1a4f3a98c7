"""Laws from SciPy's distributions: images, moments, polynomials, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from aleator import Free, ScipyLaw
from aleator.errors import InputsError

NONE = np.empty(0)
MANY = [
    stats.weibull_min(2.5, scale=3.0), stats.weibull_max(1.5), stats.gumbel_l(2.0, 3.0),
    stats.logistic(), stats.genextreme(0.1), stats.invgauss(1.0), stats.truncnorm(-1.0, 2.0),
    stats.chi2(3), stats.t(5.0), stats.lognorm(0.5),
]  # fmt: skip


@pytest.mark.parametrize("distribution", MANY, ids=lambda d: f"{d.dist.name}{d.args}")
def test_rules_converge_to_the_moments(distribution) -> None:
    """A heavy tail is no obstacle: polynomials of theta are dense for every law."""
    law, truth = ScipyLaw(distribution), np.array([distribution.mean(), distribution.std()])
    off = []
    for q in (5, 10, 20):
        rule = law.rule(NONE, q)
        mean = rule.weights @ rule.x
        sd = np.sqrt(rule.weights @ (rule.x - mean) ** 2)
        off.append(np.max(np.abs(np.array([mean, sd]) - truth)) / truth[1])
        assert rule.dx.shape == rule.dweights.shape == (q, 0)
    assert off[2] < 0.01
    assert off[2] < off[0]


def test_a_law_is_moved_and_scaled_by_its_mean_and_sd() -> None:
    shape = stats.weibull_min(1.5)
    law = ScipyLaw(shape, mean=Free(0.0, 20.0), sd=Free(0.1, 5.0))
    assert [h.name for h in law.hyperparameters] == ["mean", "sd"]
    values = np.array([10.0, 2.0])
    scale = 2.0 / shape.std()
    moved = stats.weibull_min(1.5, loc=10.0 - scale * shape.mean(), scale=scale)
    u = np.array([1e-6, 0.3, 0.9, 1.0 - 1e-6])
    np.testing.assert_allclose(law.quantile(values, u), moved.ppf(u), rtol=1e-12)
    theta = np.linspace(-6.0, 6.0, 13)
    image = law.standard(values, theta)
    np.testing.assert_allclose(image.x[:7], moved.ppf(stats.norm.cdf(theta[:7])), rtol=1e-12)
    np.testing.assert_allclose(image.x[7:], moved.isf(stats.norm.sf(theta[7:])), rtol=1e-12)
    np.testing.assert_allclose(
        image.dtheta, stats.norm.pdf(theta) / moved.pdf(image.x), rtol=1e-6, atol=1e-12
    )
    step = 1e-3
    for k in range(2):
        ends = [law.standard(values + s * step * np.eye(2)[k], theta).x for s in (1.0, -1.0)]
        np.testing.assert_allclose(image.dvalues[:, k], (ends[0] - ends[1]) / (2 * step), rtol=1e-9)
    own = law.mean_and_sd(values)
    assert (own.mean, own.sd, own.dmean.tolist(), own.dsd.tolist()) == (10.0, 2.0, [1, 0], [0, 1])
    low, high = law.box
    ends = [law.quantile(np.array([m, 5.0]), np.array([1e-14, 1 - 1e-14])) for m in (0.0, 20.0)]
    assert low <= np.min(ends) < np.max(ends) <= high


def test_one_of_mean_and_sd_may_be_left_as_it_is() -> None:
    shape = stats.weibull_min(2.0, scale=3.0)
    first = ScipyLaw(shape, mean=Free(0.0, 5.0)).hyperparameters
    assert (first[0].free, first[1].free) == (True, False)
    assert first[1].start == pytest.approx(shape.std(), rel=1e-10)
    second = ScipyLaw(shape, sd=Free(0.1, 5.0)).hyperparameters
    assert (second[0].free, second[1].free) == (False, True)
    assert second[0].start == pytest.approx(shape.mean(), rel=1e-10)


def test_a_known_law_is_the_distribution_and_has_no_hyperparameter() -> None:
    shape = stats.beta(2.0, 3.0, loc=-1.0, scale=4.0)
    law = ScipyLaw(shape)
    assert (law.hyperparameters, law.box, law.bounded) == ((), (-1.0, 3.0), True)
    assert law.filling(0.3, 1.0).size == 0
    own = law.mean_and_sd(NONE)
    assert (own.mean, own.sd) == pytest.approx((shape.mean(), shape.std()), rel=1e-11)
    u = np.array([0.0, 0.2, 1.0])
    np.testing.assert_allclose(law.quantile(NONE, u), shape.ppf(u), atol=1e-12)


@pytest.mark.parametrize(
    ("distribution", "told"),
    [
        (stats.norm, "norm_gen"),
        (3.0, "3.0 "),
        (stats.poisson(3.0), "'poisson'"),
        (stats.cauchy(), "'cauchy'"),
        (stats.t(2.0), "'t'"),
        (stats.beta(-1.0, 2.0), "'beta'"),
    ],
)
def test_what_is_no_law_is_refused_with_the_remedy(distribution, told: str) -> None:
    with pytest.raises(InputsError, match=told) as refused:
        ScipyLaw(distribution)
    assert refused.value.remedy
