"""Maximum entropy: known answers, what a batch promises, hard targets."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moments.targets import cubics, mixed, row, single, varied
from scipy import stats
from scipy.integrate import quad, quad_vec
from scipy.linalg import eigh

from aleator.core.status import Status
from aleator.core.types import Array
from aleator.moments.densities import FittedDensity, Gaussian
from aleator.moments.legendre import reach_of
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments


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


def moments_by_quad(fitted: FittedDensity, index: int, moments: Moments, order: int) -> list[float]:
    one = fitted.quantile([0.0, 1.0])[index]
    count = fitted.status.size

    def density(y: float) -> float:
        return float(fitted.pdf(np.full(count, y))[index])

    mean, sd = moments.mean[index], moments.sd[index]
    inner = [mean - 2 * sd, mean - sd, mean, mean + sd, mean + 2 * sd]
    points = [p for p in inner if one[0] < p < one[1]]
    return [
        quad(lambda y, m=m: ((y - mean) / sd) ** m * density(y), *one, points=points, limit=400)[0]
        for m in range(order + 1)
    ]


def test_moments_integrated_by_scipy_are_those_asked_for() -> None:
    moments, lower, upper = mixed(8, 4, seed=1)
    fitted = MaximumEntropy(4).fit(moments, lower, upper)
    for index in range(8):
        found = moments_by_quad(fitted, index, moments, 4)
        np.testing.assert_allclose(found, moments.standardized[index], atol=1e-7)


@pytest.mark.parametrize("order", [2, 3, 5, 8])
def test_cdf_and_quantile_are_inverse(order: int) -> None:
    moments, lower, upper = mixed(24, order, seed=2)
    fitted = MaximumEntropy(order).fit(moments, lower, upper)
    p = np.concatenate([[1e-9, 1e-4], np.linspace(0.01, 0.99, 25), [1 - 1e-6]])
    y = fitted.quantile(p)
    np.testing.assert_allclose(fitted.cdf(y), np.broadcast_to(p, y.shape), atol=1e-12)
    assert (np.diff(y, axis=1) > 0).all()
    ends = fitted.quantile([0.0, 1.0])
    np.testing.assert_allclose(fitted.cdf(ends), [[0.0, 1.0]] * 24, atol=1e-12)
    assert np.isfinite(fitted.log_pdf(ends)).all()
    assert (fitted.pdf(ends + moments.sd[:, None] * [-1e-9, 1e-9]) == 0.0).all()


def test_the_entropy_falls_with_every_moment_and_not_below_the_true_law() -> None:
    law = stats.beta(2.0, 3.0)
    fitted = MaximumEntropy(4).fit(single(law.pdf, 0.0, 1.0, 4), [0.0], [1.0])
    coarser = MaximumEntropy(2).fit(single(law.pdf, 0.0, 1.0, 2), [0.0], [1.0])
    four, two = (
        quad(lambda y, f=f: -f.pdf([y])[0] * f.log_pdf([y])[0], 0.0, 1.0)[0]
        for f in (fitted, coarser)
    )
    assert two > four > law.entropy()


@settings(max_examples=25, deadline=None)
@given(
    shift=st.floats(-1e3, 1e3),
    scale=st.floats(1e-3, 1e3),
    p=st.floats(1.0, 6.0),
    q=st.floats(1.0, 6.0),
)
def test_a_change_of_unit_changes_nothing(shift: float, scale: float, p: float, q: float) -> None:
    moments = single(stats.beta(p, q).pdf, 0.0, 1.0, 4)
    moved = Moments(shift + scale * moments.mean, scale * moments.sd, moments.standardized)
    y = np.linspace(0.02, 0.98, 9)[None]
    here = MaximumEntropy(4).fit(moments, [0.0], [1.0])
    there = MaximumEntropy(4).fit(moved, [shift], [shift + scale])
    assert here.status[0] == there.status[0] == Status.SOLVED
    np.testing.assert_allclose(
        there.log_pdf(shift + scale * y) + np.log(scale), here.log_pdf(y), atol=2e-6
    )


@settings(max_examples=25, deadline=None)
@given(p=st.floats(0.7, 8.0), q=st.floats(0.7, 8.0), order=st.integers(2, 6))
def test_densities_integrate_to_one(p: float, q: float, order: int) -> None:
    moments = single(stats.beta(p, q).pdf, 0.0, 1.0, order)
    fitted = MaximumEntropy(order).fit(moments, [0.0], [1.0])
    x, w = np.polynomial.legendre.leggauss(600)
    assert fitted.status[0] == Status.SOLVED
    first, last = fitted.quantile([0.0, 1.0])[0]  # a reach of 8 may cut the range
    half = 0.5 * (last - first)
    np.testing.assert_allclose(fitted.pdf(first + half * (1 + x[None])) @ w * half, 1.0, rtol=1e-9)


def test_a_batch_is_its_experiments_one_by_one_in_any_order() -> None:
    moments, lower, upper = mixed(300, 4, seed=5)
    density = MaximumEntropy(4)
    y = moments.mean + 0.4 * moments.sd
    together = density.fit(moments, lower, upper)
    turned = np.random.default_rng(1).permutation(300)
    shuffled = density.fit(row(moments, turned), lower[turned], upper[turned])
    np.testing.assert_allclose(shuffled.log_pdf(y[turned]), together.log_pdf(y)[turned], atol=1e-8)
    for index in range(0, 300, 37):
        alone = density.fit(row(moments, index), lower[[index]], upper[[index]])
        np.testing.assert_allclose(
            alone.log_pdf(y[[index]]), together.log_pdf(y)[[index]], atol=1e-8
        )


UNBOUNDED = (-np.inf, np.inf)


def recomputed(fitted: FittedDensity, moments: Moments, rows: Array) -> Array:
    """Largest relative error (n,) of the moments of some rows, by SciPy's adaptive quadrature."""
    count, order = moments.mean.size, moments.order
    a, b = ((fitted.quantile([0.0, 1.0]) - moments.mean[:, None]) / moments.sd[:, None]).T
    half, center = 0.5 * (b - a), 0.5 * (a + b)

    def powers(t: float) -> Array:
        u = center + half * t
        f = fitted.pdf(moments.mean + moments.sd * u) * moments.sd * half
        every: Array = f[rows, None] * u[rows, None] ** np.arange(order + 1) / scale[rows]
        return every

    scale = np.maximum(1.0, np.abs(moments.standardized))
    edges = -np.cos(np.pi * np.arange(1, 40) / 40)
    found, _ = quad_vec(powers, -1.0, 1.0, epsabs=1e-9, norm="max", points=edges, limit=4000)
    assert count == fitted.status.size
    error: Array = np.abs(found - (moments.standardized / scale)[rows]).max(axis=1)
    return error


@pytest.mark.parametrize(
    ("order", "count", "failures"),
    [(3, 40, 0), (4, 200, 0), (5, 40, 0), (6, 200, 0), (7, 40, 0), (8, 200, 2)],
)
def test_targets_of_mixed_kind(order: int, count: int, failures: int) -> None:
    moments, lower, upper = varied(count, order, seed=20)
    fitted = MaximumEntropy(order).fit(moments, lower, upper)
    solved = np.flatnonzero(fitted.status == Status.SOLVED)
    assert solved.size >= count - failures
    assert (fitted.solution.order_used[solved] == order).all()
    assert recomputed(fitted, moments, solved).max() < 1e-6


@pytest.mark.parametrize(
    ("order", "failures", "decay"), [(4, 0, 1.0), (5, 0, 0.5), (6, 4, 1.0), (6, 4, 0.5)]
)
def test_two_hundred_cubics_of_a_normal_variable(order: int, failures: int, decay: float) -> None:
    moments = cubics(200, order, seed=21, decay=decay)
    fitted = MaximumEntropy(order).fit(moments, *UNBOUNDED)
    solved = np.flatnonzero(fitted.status == Status.SOLVED)
    assert solved.size >= 200 - failures
    assert recomputed(fitted, moments, solved).max() < 1e-6


def test_what_eight_moments_do_not_solve_falls_back_by_two() -> None:
    """Cubics at M = 8 are beyond float64 in every third case: six moments stand in, and say so."""
    moments = cubics(24, 8, seed=0, decay=1.0)
    fitted = MaximumEntropy(8).fit(moments, *UNBOUNDED)
    failed = np.flatnonzero(fitted.status != Status.SOLVED)
    assert 0 < failed.size < 24
    assert (fitted.solution.order_used[failed] >= 4).all()
    six = MaximumEntropy(6).fit(row(moments, failed), *UNBOUNDED)
    y = (moments.mean + 0.2 * moments.sd)[failed]
    same = fitted.solution.order_used[failed] == 6
    assert same.any()
    np.testing.assert_allclose(
        fitted.log_pdf(moments.mean + 0.2 * moments.sd)[failed][same],
        six.log_pdf(y)[same],
        atol=1e-8,
    )


@pytest.mark.parametrize("order", range(2, 9))
def test_the_reach_holds_every_law_with_these_moments(order: int) -> None:
    """The smallest interval by eigenvalues of the Hankel pencils, which the reach must exceed."""
    moments = cubics(40, order, seed=5, decay=1.0)
    width = reach_of(moments.standardized, 1e-3)[0]
    for c, r in zip(moments.standardized, width, strict=True):
        odd = order % 2
        size = order // 2 + odd
        shift = 1 if odd else 2
        place = np.add.outer(np.arange(size), np.arange(size))
        needed = np.abs(eigh(c[place + shift], c[place], eigvals_only=True)).max()
        assert r > 1.1 * (needed if odd else np.sqrt(needed))


@pytest.mark.parametrize("order", range(2, 9))
def test_the_slope_of_the_reach_is_its_derivative(order: int) -> None:
    c = cubics(30, order, seed=6, decay=0.5).standardized
    width, found = reach_of(c, 8.0)
    assert (width >= 8.0).all()
    for k in range(order + 1):
        h = 1e-6 * np.maximum(1.0, np.abs(c[:, k]))[:, None] * np.eye(order + 1)[k]
        rise = reach_of(c + h, 8.0)[0] - reach_of(c - h, 8.0)[0]
        slope = rise / (2.0 * h[:, k])
        np.testing.assert_allclose(found[:, k], slope, rtol=1e-4, atol=1e-7)


def test_the_reach_of_the_normal_law_and_of_its_cube() -> None:
    # trace A^-1 B is m^2 for the normal law, and 1 + kurtosis for a symmetric law at M = 4; that of
    # the cube is E x^12/(E x^6)^2 = 10395/225
    normal = np.array([[1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0]])
    for order, trace in ((4, 4.0), (6, 9.0)):
        r = reach_of(normal[:, : order + 1], 8.0)[0]
        np.testing.assert_allclose(r, (8.0**4 + (2 * trace) ** 2) ** 0.25, rtol=1e-12)
    cube = np.array([[1.0, 0.0, 1.0, 0.0, 10395.0 / 225.0]])
    r = reach_of(cube, 8.0)[0]
    np.testing.assert_allclose(r, (8.0**4 + 4 * (1 + 46.2) ** 2) ** 0.25, rtol=1e-12)


@pytest.mark.parametrize("order", [4, 6])
def test_heavy_tails_move_value_and_support_without_a_jump(order: int) -> None:
    """A lognormal outcome whose scatter grows: the log-density is smooth in it, its slope too."""
    s = np.linspace(0.3, 0.5, 401)
    x, w = np.polynomial.hermite_e.hermegauss(60)
    y = np.exp(s[:, None] * x)
    w = w / w.sum()
    mean = y @ w
    sd = np.sqrt((y - mean[:, None]) ** 2 @ w)
    z = (y - mean[:, None]) / sd[:, None]
    c = np.stack([z**k @ w for k in range(order + 1)], axis=1)
    c[:, :3] = 1.0, 0.0, 1.0
    fitted = MaximumEntropy(order).fit(Moments(mean, sd, c), 0.0, np.inf)
    assert (fitted.status == Status.SOLVED).all()
    at = fitted.sensitivity(mean + 5.0 * sd).value
    second = np.diff(at, 2)
    assert np.abs(np.diff(second)).max() < 1e-4
    assert (np.diff(fitted.quantile([1.0])[:, 0] / sd - mean / sd) > 0.0).all()
