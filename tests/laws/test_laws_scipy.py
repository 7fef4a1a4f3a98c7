"""Laws from SciPy's distributions: their polynomials, their moments, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from aleator import Free, ScipyLaw
from aleator import polynomials as gauss
from aleator.errors import InputsError
from aleator.laws.scipy_law import Support, discretize
from aleator.polynomials import evaluate, hermite_recurrence, jacobi_recurrence, laguerre_recurrence
from aleator.types import Array

NONE = np.empty(0)

KNOWN = [
    pytest.param(stats.norm(1e6, 1e-3), hermite_recurrence(21), id="normal"),
    pytest.param(stats.expon(loc=1e3), laguerre_recurrence(21, 1.0), id="exponential"),
    *[
        pytest.param(stats.gamma(k), laguerre_recurrence(21, k**-0.5), id=f"gamma {k:g}")
        for k in (0.2, 3.0, 1e4)
    ],
    *[
        pytest.param(stats.beta(p, q, -3.0, 0.1), jacobi_recurrence(21, p, q), id=f"beta {p} {q}")
        for p, q in ((0.5, 0.5), (0.2, 3.0), (1.0, 1.0), (2.0, 5.0), (300.0, 200.0))
    ],
]


@pytest.mark.parametrize(("distribution", "recurrence"), KNOWN)
def test_rules_of_known_families_are_theirs(distribution, recurrence) -> None:
    law = ScipyLaw(distribution)
    rule = law.rule(NONE, 21)
    t, w = gauss(*recurrence)
    np.testing.assert_allclose(rule.t, t, atol=1e-10)
    np.testing.assert_allclose(rule.weights, w, atol=1e-11)
    expected = distribution.mean() + distribution.std() * t
    np.testing.assert_allclose(rule.x, expected, atol=1e-10 * distribution.std(), rtol=1e-14)
    assert rule.dx.shape == rule.dweights.shape == (21, 0)


MANY = [
    stats.weibull_min(0.6), stats.weibull_min(0.5), stats.weibull_min(2.5, scale=3.0),
    stats.weibull_max(1.5), stats.gumbel_r(), stats.gumbel_l(2.0, 3.0), stats.laplace(),
    stats.logistic(), stats.triang(0.3), stats.trapezoid(0.2, 0.6), stats.genextreme(0.1),
    stats.skewnorm(4.0), stats.invgauss(1.0), stats.rayleigh(), stats.arcsine(),
    stats.truncnorm(-1.0, 2.0), stats.powerlaw(0.3), stats.gennorm(8.0),
    stats.semicircular(), stats.loguniform(1.0, 100.0), stats.nakagami(0.7), stats.chi2(3),
]  # fmt: skip


@pytest.mark.parametrize("distribution", MANY, ids=lambda d: f"{d.dist.name}{d.args}")
def test_polynomials_are_orthonormal_under_the_density_itself(distribution) -> None:
    """To degree 20, by an integral over 4000 parts of theta, and moments as SciPy knows them."""
    law = ScipyLaw(distribution)
    rule = law.rule(NONE, 21)
    mean, variance, skewness, kurtosis = (float(m) for m in distribution.stats("mvsk"))
    z = (rule.x - mean) / variance**0.5
    moments = [rule.weights @ z**m for m in (1, 2, 3, 4)]
    truth = [0.0, 1.0, skewness, 3.0 + kurtosis]
    np.testing.assert_allclose(moments, truth, rtol=1e-8, atol=1e-8)
    table = evaluate(*law.recurrence(NONE, 21), rule.t, 20)
    np.testing.assert_allclose(table.T @ (table * rule.weights[:, None]), np.eye(21), atol=1e-10)
    # independently of the discretization: a midpoint rule in theta, for low degrees
    theta = np.linspace(-8.2, 8.2, 4001)
    z = (law.standard(NONE, theta).x - mean) / variance**0.5
    low = evaluate(*law.recurrence(NONE, 4), z, 3)
    mass = stats.norm.pdf(theta) * (theta[1] - theta[0])
    np.testing.assert_allclose(low.T @ (low * mass[:, None]), np.eye(4), atol=2e-5)


def test_a_rule_of_q_nodes_is_exact_to_degree_2q_minus_1_and_no_further() -> None:
    """Weibull with shape 2: E x^m = Gamma(1 + m/2)."""
    q, law = 6, ScipyLaw(stats.weibull_min(2.0))
    rule = law.rule(NONE, q)
    moment = special.gamma(1.0 + 0.5 * np.arange(2 * q + 1))
    found = np.array([rule.weights @ rule.x**m for m in range(2 * q + 1)])
    np.testing.assert_allclose(found[:-1], moment[:-1], rtol=1e-11)
    assert found[-1] < moment[-1] * (1.0 - 1e-5)


def test_jumps_and_kinks_inside_are_found() -> None:
    """A histogram: half the mass on [0, 1], half on [1, 5]."""
    law = ScipyLaw(stats.rv_histogram(([1.0, 1.0], [0.0, 1.0, 5.0]), density=False)())
    own = law.mean_and_sd(NONE)
    assert own.mean == pytest.approx(0.5 * 0.5 + 0.5 * 3.0, abs=1e-11)
    second = 0.5 * (1.0 / 3.0) + 0.5 * (124.0 / 12.0)
    assert own.sd**2 == pytest.approx(second - own.mean**2, abs=1e-11)


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


def test_a_discretized_density_integrates_smooth_functions() -> None:
    support = Support(0.0, np.inf, 1.0, 1.0)
    z, w = discretize(support, stats.expon().logpdf, 40)
    # the mass within 1e-8 of the end is not there
    assert w.sum() == pytest.approx(1.0 - 1e-8, abs=1e-12)
    # E cos x = 1/2 for an exponential law
    assert w @ np.cos(z + 1.0) == pytest.approx(0.5 - 1e-8, abs=1e-12)


@pytest.mark.parametrize(
    ("distribution", "told"),
    [
        (stats.norm, "norm_gen"),
        (3.0, "3.0 "),
        (stats.poisson(3.0), "'poisson'"),
        (stats.lognorm(0.5), "LogNormal"),
        (stats.cauchy(), "'cauchy'"),
        (stats.t(2.0), "'t'"),
        (stats.t(5.0), "'t'"),
        (stats.pareto(3.0), "'pareto'"),
        (stats.weibull_min(0.4), "c >= 0.5"),
        (stats.gennorm(0.8), "'gennorm'"),
        (stats.johnsonsu(1.0, 2.0), "'johnsonsu'"),
        (stats.beta(-1.0, 2.0), "'beta'"),
    ],
)
def test_what_is_no_law_is_refused_with_the_remedy(distribution, told: str) -> None:
    with pytest.raises(InputsError, match=told) as refused:
        ScipyLaw(distribution)
    assert refused.value.remedy


def test_a_density_that_is_not_one_is_refused() -> None:
    class Half(stats.rv_continuous):
        def _pdf(self, x: Array, *shapes: float) -> Array:  # noqa: ARG002
            return np.full_like(x, 0.5)

        def _stats(self) -> tuple[float, float, float, float]:
            return 0.5, 1.0 / 12.0, 0.0, 0.0

    with pytest.raises(InputsError, match="variance 2 times"):
        ScipyLaw(Half(a=0.0, b=1.0, name="half")())
