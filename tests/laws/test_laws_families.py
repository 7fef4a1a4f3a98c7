"""Laws of every family against the distributions of SciPy and 30 digits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy import special, stats

from aleator import (
    Beta,
    Constant,
    Free,
    Gamma,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.core.polynomials import evaluate
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Law

THETA = np.linspace(-6.0, 6.0, 25)


def beta(box: tuple[float, float], mean: float, sd: float) -> Any:
    width = box[1] - box[0]
    m, v = (mean - box[0]) / width, (sd / width) ** 2
    s = m * (1.0 - m) / v - 1.0
    return stats.beta(m * s, (1.0 - m) * s, loc=box[0], scale=width)


def gamma(mean: float, sd: float, lower: float) -> Any:
    return stats.gamma(((mean - lower) / sd) ** 2, loc=lower, scale=sd**2 / (mean - lower))


def lognormal(mean: float, sd: float, lower: float) -> Any:
    s = math.sqrt(math.log1p((sd / (mean - lower)) ** 2))
    return stats.lognorm(s, loc=lower, scale=(mean - lower) * math.exp(-0.5 * s**2))


def uniform(mean: float, sd: float) -> Any:
    return stats.uniform(mean - 3.0**0.5 * sd, 2.0 * 3.0**0.5 * sd)


def truncated(box: tuple[float, float], mean: float, sd: float) -> Any:
    return stats.truncnorm((box[0] - mean) / sd, (box[1] - mean) / sd, mean, sd)


WIDE = (Free(0.6, 8.0), Free(1e-4, 9.0))
BOX = (-1.0, 3.0)
ON_BOX = (Free(0.99, 1.01), Free(1e-3, 1.9))

# a law, its mean and sd, the same distribution by SciPy
LAWS = [
    pytest.param(Uniform(*WIDE), 1.0, 0.5, uniform(1.0, 0.5), id="uniform"),
    *[
        pytest.param(Beta(BOX, *ON_BOX), 1.0, sd, beta(BOX, 1.0, sd), id=name)
        for sd, name in ((0.3, "beta"), (1.8, "beta, two peaks"), (0.004, "beta, narrow"))
    ],
    pytest.param(Beta((0, 1), Free(0.05, 0.2)), 0.1, 0.15, beta((0, 1), 0.1, 0.15), id="beta skew"),
    *[
        pytest.param(Gamma(*WIDE, lower=0.5), 1.5, k**-0.5, gamma(1.5, k**-0.5, 0.5), id=name)
        for k, name in (
            (0.2, "gamma 0.2"), (1.0, "exponential"), (9.0, "gamma 9"), (1e6, "gamma 1e6")
        )
    ],
    *[
        pytest.param(LogNormal(*WIDE, 0.5), 1.5, c, lognormal(1.5, c, 0.5), id=f"lognormal {c}")
        for c in (0.01, 0.3, 1.0)
    ],
]  # fmt: skip
OTHERS = [
    pytest.param(Normal(*WIDE), 1.0, 0.5, stats.norm(1.0, 0.5), id="normal"),
    *[
        pytest.param(
            TruncatedNormal((0.0, 2.0), *WIDE, name), 1.9, 0.7, truncated((0.0, 2.0), 1.9, 0.7),
            id=f"truncated, {name}",
        )
        for name in ("own", "hermite")
    ],
]  # fmt: skip


def slope(function: Callable[[Array], Array], values: Array, k: int, relative: float) -> Array:
    """Derivative by values[k] from differences of fourth order."""
    step = relative * values[k] * np.eye(values.size)[k]
    near = function(values + step) - function(values - step)
    far = function(values + 2.0 * step) - function(values - 2.0 * step)
    return (8.0 * near - far) / (12.0 * relative * values[k])


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS)
def test_rules_have_the_mean_and_sd_that_name_the_law(law: Law, mean, sd, truth) -> None:
    assert (truth.mean(), truth.std()) == pytest.approx((mean, sd), rel=1e-9)
    rule = law.rule(np.array([mean, sd]), 20)
    assert rule.weights.sum() == pytest.approx(1.0, abs=1e-13)
    assert rule.weights @ rule.x == pytest.approx(mean, rel=1e-10)
    assert rule.weights @ (rule.x - mean) ** 2 == pytest.approx(sd**2, rel=1e-7)
    if not isinstance(law, LogNormal):  # its rule is exact for polynomials of theta
        z = (rule.x - mean) / sd
        skewness, kurtosis = (float(part) for part in truth.stats("sk"))
        assert rule.weights @ z**3 == pytest.approx(skewness, abs=1e-9)
        assert rule.weights @ z**4 == pytest.approx(3.0 + kurtosis, rel=1e-9)


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS)
def test_polynomials_of_every_law_are_orthonormal_to_degree_20(law: Law, mean, sd, truth) -> None:  # noqa: ARG001
    values = np.array([mean, sd])
    rule = law.rule(values, 21)
    table = evaluate(*law.recurrence(values, 21), rule.t, 20)
    np.testing.assert_allclose(table.T @ (table * rule.weights[:, None]), np.eye(21), atol=1e-10)


def truth_of_germ(truth: Any, theta: Array) -> Array:
    left = theta < 0.0
    below, above = truth.ppf(stats.norm.cdf(theta)), truth.isf(stats.norm.sf(theta))
    return np.where(left, below, above)


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS + OTHERS)
def test_the_image_of_the_germ_is_the_quantile(law: Law, mean, sd, truth) -> None:
    values = np.array([mean, sd])
    image = law.standard(values, THETA)
    # SciPy's incomplete gamma function leaves 1e-6 in the lower tail of a large shape
    loose = 2e-6 if isinstance(law, Gamma) and sd < 0.01 else 1e-9
    np.testing.assert_allclose(image.x, truth_of_germ(truth, THETA), atol=loose * sd)
    assert np.all(np.diff(image.x) >= 0.0)
    middle = np.abs(THETA) < 5.0
    quantile = law.quantile(values, stats.norm.cdf(THETA[middle]))
    np.testing.assert_allclose(image.x[middle], quantile, rtol=1e-8, atol=1e-9 * sd)


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS + OTHERS)
def test_derivatives_by_the_germ_are_density_ratios(law: Law, mean, sd, truth) -> None:
    theta = np.linspace(-4.0, 4.0, 17)
    image = law.standard(np.array([mean, sd]), theta)
    with np.errstate(divide="ignore"):
        ratio = stats.norm.pdf(theta) / truth.pdf(image.x)
    # x may round to the end of the law, where the density is infinite
    np.testing.assert_allclose(image.dtheta, ratio, rtol=1e-7, atol=1e-9 * sd)


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS + OTHERS)
@pytest.mark.parametrize("k", [0, 1])
def test_derivatives_by_mean_and_sd_are_those_of_differences(law: Law, mean, sd, truth, k) -> None:  # noqa: ARG001
    values, theta = np.array([mean, sd]), np.linspace(-4.0, 4.0, 17)
    # a narrow law moves by its sd; both differences are good to 1e-9 or so of a unit step
    small = 1e-3 * min(1.0, sd / mean if k == 0 else 1.0)
    image, rule = law.standard(values, theta), law.rule(values, 9)
    for found, function in (
        (image.dvalues[:, k], lambda v: law.standard(v, theta).x),
        (rule.dx[:, k], lambda v: law.rule(v, 9).x),
        (rule.dweights[:, k] * sd, lambda v: law.rule(v, 9).weights * sd),
    ):
        np.testing.assert_allclose(found, slope(function, values, k, small), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("law", "mean", "sd", "truth"), LAWS + OTHERS)
def test_mean_and_sd_of_a_law_with_their_derivatives(law: Law, mean, sd, truth) -> None:
    values = np.array([mean, sd])
    found = law.mean_and_sd(values)
    assert (found.mean, found.sd) == pytest.approx((truth.mean(), truth.std()), rel=1e-9)
    for k in range(2):
        by_mean = slope(lambda v: np.array([law.mean_and_sd(v).mean]), values, k, 1e-3)
        by_sd = slope(lambda v: np.array([law.mean_and_sd(v).sd]), values, k, 1e-3)
        assert found.dmean[k] == pytest.approx(by_mean[0], abs=1e-7)
        assert found.dsd[k] == pytest.approx(by_sd[0], abs=1e-7)


@pytest.mark.parametrize("theta", [-5.0, -3.0, 0.4, 6.0])
@pytest.mark.parametrize("k", [0.2, 3.0, 50.0])
def test_the_gamma_map_is_that_of_thirty_digits(theta: float, k: float) -> None:
    """P(k, g) = Phi(theta), and dg/dk from differences at 30 digits."""
    with mpmath.workdps(30):

        def g(shape: mpmath.mpf) -> mpmath.mpf:
            below = mpmath.ncdf(theta)
            guess = mpmath.mpf(float(special.gammaincinv(float(shape), float(below))))
            # Newton in the logarithm, which is monotone and nearly straight
            for _ in range(60):
                mass = mpmath.gammainc(shape, 0, guess, regularized=True)
                density = guess ** (shape - 1) * mpmath.exp(-guess) / mpmath.gamma(shape)
                step = (mass - below) / (density * guess)
                guess *= mpmath.exp(-step)
                if abs(step) < mpmath.mpf(10) ** -25:
                    break
            return guess

        h = mpmath.mpf(10) ** -8
        truth = g(mpmath.mpf(k))
        by_k = float((g(k + h) - g(k - h)) / (2 * h))
    # the scale is sd^2/mean: with mean = k and sd = sqrt(k) it is one
    image = Gamma(k, k**0.5).standard(np.array([k, k**0.5]), np.array([theta]))
    assert image.x[0] == pytest.approx(float(truth), rel=1e-11)
    # along mean = k, sd = sqrt(k) only the shape changes
    along = image.dvalues[0] @ np.array([1.0, 0.5 * k**-0.5])
    assert along == pytest.approx(by_k, rel=1e-8, abs=1e-9)


def test_boxes_hold_the_laws() -> None:
    for law, corners in (
        (Uniform(Free(0.0, 1.0), Free(0.1, 0.3)), [(0.0, 0.3), (1.0, 0.3)]),
        (Gamma(Free(0.5, 2.0), Free(0.1, 1.0)), [(0.5, 1.0), (2.0, 1.0), (1.0, 1.0)]),
        (LogNormal(Free(1.0, 2.0), Free(0.1, 1.0)), [(1.0, 1.0), (2.0, 1.0)]),
    ):
        low, high = law.box
        ends = np.array([1e-14, 1.0 - 1e-14])
        for corner in corners:
            x = law.quantile(np.array(corner), ends)
            assert low <= x[0] < x[1] <= high
    assert Uniform.between(-1.0, 2.0).box == (-1.0, 2.0)
    assert [law.bounded for law in (Uniform.between(0, 1), Beta((0, 1)), Gamma(1.0, 1.0))] == [
        True, True, False
    ]  # fmt: skip


def test_a_law_between_two_ends_never_leaves_them() -> None:
    law = Uniform.between(0.0, 1.0)
    values = np.array([h.start for h in law.hyperparameters])
    assert law.quantile(values, np.array([0.0, 1.0])).tolist() == [0.0, 1.0]
    assert not any(h.free for h in law.hyperparameters)
    assert law.rule(values, 5).x.tolist() == pytest.approx(stats.uniform().ppf(
        0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]
    ))  # fmt: skip


@pytest.mark.parametrize(
    ("law", "center", "sd", "expected"),
    [
        (Normal(Free(0.0, 2.0), 0.5), 1.2, 9.0, [1.2, 0.5]),
        (Normal(Free(0.0, 2.0), Free(0.1, 1.0, 0.3)), 5.0, None, [2.0, 0.3]),
        (TruncatedNormal((0.0, 4.0)), 3.0, 1.0, [3.0, 1.0]),
        (Gamma(Free(1.0, 2.0), Free(0.1, 1.0)), 0.2, 2.0, [1.0, 1.0]),
        (Constant(Free(0.0, 1.0)), 0.7, 3.0, [0.7]),
        (Constant(0.5), 0.7, None, [0.5]),
    ],
)
def test_a_law_about_a_center_stays_within_its_limits(law: Law, center, sd, expected) -> None:
    assert law.filling(center, sd).tolist() == expected


@pytest.mark.parametrize("share", [0.2, 0.9])
def test_every_law_within_the_limits_of_a_beta_law_exists(share: float) -> None:
    law = Beta((0.0, 1.0), mean=Free(0.05, 0.3))
    mean, sd = law.hyperparameters
    assert sd.upper == pytest.approx(0.95 * math.sqrt(0.05 * 0.95))
    values = np.array([mean.lower + share * (mean.upper - mean.lower), sd.upper])
    assert np.all(np.isfinite(law.rule(values, 20).x))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Beta((0.0, 1.0), Free(0.1, 0.9), Free(0.1, 0.4)), "to 0.297"),
        (lambda: Beta((0.0, 1.0), 0.5, 0.5), "to 0.495"),
        (lambda: Beta((0.0, 1.0), Free(0.0, 0.5)), "mean: 0.0 to 0.5 "),
        (lambda: Beta((1.0, 0.0)), "box: 1.0 to 0.0 "),
        (lambda: Beta((0.0, math.inf)), "box: 0.0 to inf "),
        (lambda: Gamma(Free(-1.0, 2.0)), "mean: -1.0 "),
        (lambda: Gamma(Free(1.0, 2.0), lower=1.5), "mean: 1.0 .* 1.5 "),
        (lambda: Gamma(Free(1.0, 2.0), lower=-math.inf), "lower = -inf "),
        (lambda: Gamma(), "mean .*lower.*upper"),
        (lambda: Gamma(2.0), "sd .*lower.*upper"),
        (lambda: LogNormal(0.0, 1.0), "mean: 0.0 "),
        (lambda: Uniform.between(1.0, 1.0), "uniform.* 1.0 .* 1.0"),
        (lambda: Uniform(Free(0.0, 1.0), 0.0), "sd = 0"),
    ],
)
def test_what_is_no_law_is_refused_with_the_remedy(make: Callable[[], Law], told: str) -> None:
    with pytest.raises(InputsError, match=told):
        make()


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (Beta((0.0, 1.0), Free(0.2, 0.8), Free(0.01, 0.3)), (0.4, 0.2)),
        (Beta((0.0, 1.0), Free(0.2, 0.8), Free(0.01, 0.3)), (0.5, 0.01)),
        (Beta((-1.0, 3.0), Free(0.0, 2.0), Free(0.01, 0.9)), (0.5, 0.9)),
        (Gamma(Free(0.5, 2.0), Free(0.01, 2.0)), (1.0, 2.0)),
        (Gamma(Free(0.5, 2.0), Free(0.01, 2.0)), (1.0, 0.01)),
        (Gamma(Free(0.5, 2.0), Free(0.01, 2.0)), (1.5, 0.7)),
    ],
)
def test_many_values_are_the_quantiles_that_few_are(law, values) -> None:
    """Many values of one law are interpolated: x by its quantile, derivatives by those of few."""
    values = np.array(values)
    theta = np.random.default_rng(3).uniform(-6.0, 6.0, 4000)
    many = law.standard(values, theta)
    np.testing.assert_allclose(many.x, law.quantile(values, special.ndtr(theta)), rtol=2e-8)
    few = [law.standard(values, part) for part in np.split(theta, 40)]
    for name in ("x", "dtheta", "dvalues"):
        exact = np.concatenate([getattr(part, name) for part in few])
        size = np.max(np.abs(exact))
        np.testing.assert_allclose(getattr(many, name), exact, rtol=1e-6, atol=1e-7 * size)


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
def test_a_distribution_that_is_no_law_is_refused(distribution, told: str) -> None:
    with pytest.raises(InputsError, match=told) as refused:
        ScipyLaw(distribution)
    assert refused.value.remedy


WEIBULL = stats.weibull_min(2.0, scale=3.0)


@pytest.mark.parametrize(
    ("law", "by_quantities"),
    [
        (LogNormal(2.0, 0.7, 0.5), lambda q: stats.lognorm(q["sdlog"], 0.5, q["median"] - 0.5)),
        (Gamma(2.0, 0.7, 0.5), lambda q: stats.gamma(q["shape"], 0.5, q["scale"])),
        (Beta((0.0, 4.0), 2.0, 0.7), lambda q: stats.beta(q["shape1"], q["shape2"], 0.0, 4.0)),
        (Uniform(2.0, 0.7), lambda q: stats.uniform(q["lower"], q["upper"] - q["lower"])),
        (ScipyLaw(WEIBULL, 2.0, 0.7), lambda q: stats.weibull_min(2.0, q["loc"], q["scale"])),
    ],
)
def test_the_customary_quantities_determine_the_law(law: Law, by_quantities: Any) -> None:
    told = law.customary(np.array([2.0, 0.7]))
    truth = by_quantities(told)
    assert (truth.mean(), truth.std()) == pytest.approx((2.0, 0.7), rel=1e-9)
    if "geometric sd" in told:
        log = np.log(truth.ppf([special.ndtr(1.0), 0.5]) - 0.5)
        assert told["geometric sd"] == pytest.approx(math.exp(log[0] - log[1]), rel=1e-9)
