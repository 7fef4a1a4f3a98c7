"""Densities whose answer is known: the law of largest entropy is the law itself."""

import mpmath
import numpy as np
import pytest
from moments.densities.targets import single
from scipy import stats

from aleator.moments.densities import Gaussian, MaximumEntropy
from aleator.moments.densities.moments import Moments
from aleator.status import Status


@pytest.mark.parametrize("order", range(2, 9))
def test_moments_of_the_uniform_law_give_the_uniform_law(order: int) -> None:
    moments = single(np.ones_like, 2.0, 5.0, order)
    fitted = MaximumEntropy(order).fit(moments, [2.0], [5.0])
    y = np.linspace(2.0, 5.0, 41)[None]
    assert fitted.status.tolist() == [Status.SOLVED]
    np.testing.assert_allclose(fitted.pdf(y), 1.0 / 3.0, rtol=1e-9)
    np.testing.assert_allclose(fitted.cdf(y), (y - 2.0) / 3.0, atol=1e-10)
    np.testing.assert_allclose(fitted.quantile([0.0, 1.0]), [[2.0, 5.0]], rtol=1e-14)


def test_two_moments_of_a_truncated_normal_give_it_back() -> None:
    law = stats.truncnorm(-1.0, 2.5, loc=3.0, scale=0.7)
    a, b = law.support()
    fitted = MaximumEntropy(2).fit(single(law.pdf, a, b, 2), [a], [b])
    y = np.linspace(a, b, 101)[1:-1]
    np.testing.assert_allclose(fitted.log_pdf(y[None])[0], law.logpdf(y), atol=1e-9)
    # the multiplier of y^2 is -1/(2 scale^2)
    bend = np.polyfit(y - 3.0, fitted.log_pdf(y[None])[0], 2)[0]
    np.testing.assert_allclose(bend, -0.5 / 0.7**2, rtol=1e-8)


def test_moments_of_a_truncated_exponential_give_a_straight_exponent() -> None:
    law = stats.truncexpon(b=6.0, scale=0.5)
    fitted = MaximumEntropy(4).fit(single(law.pdf, 0.0, 3.0, 4), [0.0], [3.0])
    y = np.linspace(0.0, 3.0, 101)
    np.testing.assert_allclose(fitted.pdf(y[None])[0], law.pdf(y), rtol=1e-8)
    np.testing.assert_allclose(fitted.cdf(y[None])[0], law.cdf(y), atol=1e-10)


@pytest.mark.parametrize(
    ("order", "coefficients", "a", "b"),
    [
        (3, [1.0, -0.5, 0.7], -1.0, 2.0),
        (4, [0.3, 2.0, 0.1, -0.8], -2.2, 2.0),  # two modes
        (5, [-1.0, 1.0, 0.4, -0.3, 0.1], -2.0, 1.5),
        (6, [0.1, 1.5, 0.0, -1.0, 0.05, 0.05], -2.0, 2.5),
    ],
)
def test_an_exponential_of_a_polynomial_is_recovered(
    order: int, coefficients: list[float], a: float, b: float
) -> None:
    def exponential(x: float) -> float:
        return mpmath.exp(sum(c * x ** (k + 1) for k, c in enumerate(coefficients)))

    z = mpmath.quad(exponential, [a, 0, b])
    mean = mpmath.quad(lambda x: x * exponential(x), [a, 0, b]) / z
    central = [
        mpmath.quad(lambda x, m=m: (x - mean) ** m * exponential(x), [a, 0, b]) / z
        for m in range(order + 1)
    ]
    sd = mpmath.sqrt(central[2])
    standardized = [[float(c / sd**m) for m, c in enumerate(central)]]
    moments = Moments(np.array([float(mean)]), np.array([float(sd)]), np.array(standardized))
    y = np.linspace(a, b, 57)
    fitted = MaximumEntropy(order).fit(moments, [a], [b])
    truth = np.array([float(exponential(x) / z) for x in y])
    np.testing.assert_allclose(fitted.pdf(y[None])[0], truth, rtol=1e-9)


def test_thirty_digits_agree_at_order_four() -> None:
    """Newton on the raw powers in 30 digits, from a start of its own."""
    moments = single(lambda x: stats.beta(2.0, 5.0).pdf(x) + 0.3, 0.0, 1.0, 4)
    a = float((0.0 - moments.mean[0]) / moments.sd[0])
    b = float((1.0 - moments.mean[0]) / moments.sd[0])
    with mpmath.workdps(30):
        rule = [
            (mpmath.mpf(x), mpmath.mpf(w))
            for x, w in mpmath.calculus.quadrature.GaussLegendre(mpmath.mp).calc_nodes(5, 120)
        ]
        u = [mpmath.mpf(a) + (mpmath.mpf(b) - a) * (x + 1) / 2 for x, _ in rule]
        target = [mpmath.mpf(float(c)) for c in moments.standardized[0]]
        multipliers = mpmath.matrix([0, 0, 0, 0])
        for _ in range(60):
            exponent = [
                w * mpmath.exp(sum(multipliers[k] * x ** (k + 1) for k in range(4)))
                for x, (_, w) in zip(u, rule, strict=True)
            ]
            z = mpmath.fsum(exponent)
            raw = [
                mpmath.fsum(e * x**m for e, x in zip(exponent, u, strict=True)) / z
                for m in range(9)
            ]
            gradient = mpmath.matrix([target[k + 1] - raw[k + 1] for k in range(4)])
            hessian = mpmath.matrix(4, 4)
            for i in range(4):
                for j in range(4):
                    hessian[i, j] = raw[i + j + 2] - raw[i + 1] * raw[j + 1]
            step = mpmath.lu_solve(hessian, gradient)
            decrement = mpmath.fsum(g * s for g, s in zip(gradient, step, strict=True))
            multipliers += step / (1 + mpmath.sqrt(decrement))
            if decrement < mpmath.mpf(10) ** -40:
                break
        z *= (mpmath.mpf(b) - a) / 2
        points = np.linspace(a, b, 31)
        truth = [
            float(
                sum(multipliers[k] * mpmath.mpf(float(x)) ** (k + 1) for k in range(4))
                - mpmath.log(z)
            )
            for x in points
        ]
    fitted = MaximumEntropy(4).fit(moments, [0.0], [1.0])
    found = fitted.log_pdf((moments.mean + moments.sd * points)[None])[0] + np.log(moments.sd[0])
    np.testing.assert_allclose(found, truth, atol=1e-8)


def test_gaussian_is_the_normal_law() -> None:
    moments = Moments(np.array([1.0, -2.0]), np.array([0.5, 3.0]), np.tile([1.0, 0.0, 1.0], (2, 1)))
    fitted = Gaussian().fit(moments, [0.0, 0.0], [np.inf, np.inf])
    law = stats.norm(moments.mean, moments.sd)
    y = np.array([1.7, -5.0])
    np.testing.assert_allclose(fitted.log_pdf(y), law.logpdf(y), rtol=1e-14)
    np.testing.assert_allclose(fitted.cdf(y), law.cdf(y), rtol=1e-13)
    np.testing.assert_allclose(
        fitted.quantile([0.1, 0.9]), np.array([law.ppf(0.1), law.ppf(0.9)]).T
    )
    assert fitted.quantile([0.0, 1.0]).tolist() == [[-np.inf, np.inf]] * 2


def test_order_two_on_a_wide_support_tends_to_the_gaussian() -> None:
    moments = Moments(np.array([3.0]), np.array([2.0]), np.array([[1.0, 0.0, 1.0]]))
    wide = MaximumEntropy(2).fit(moments, [-np.inf], [np.inf])
    normal = Gaussian().fit(moments, [-np.inf], [np.inf])
    y = 3.0 + 2.0 * np.linspace(-5, 5, 21)[None]
    np.testing.assert_allclose(wide.log_pdf(y), normal.log_pdf(y), atol=1e-8)
