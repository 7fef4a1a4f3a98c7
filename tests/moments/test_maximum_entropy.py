"""Maximum entropy: known answers, what a batch promises, hard targets, and starts nearby."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from moments.targets import cubics, mixed, row, single, stacked, standardized_of, varied
from scipy import stats
from scipy.integrate import quad_vec
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


def skewed(shapes: Array, order: int) -> Moments:
    """Moments of beta laws with these shapes, seen on their own range."""
    return stacked(
        [standardized_of(stats.beta(k, 3.0).pdf, 0.0, 1.0, order) for k in shapes.tolist()]
    )


def test_moments_that_no_density_has_stay_a_failure_and_spoil_no_neighbour() -> None:
    choice, shapes = MaximumEntropy(4), np.linspace(2.0, 4.0, 5)
    sound, damaged = skewed(shapes, 4), skewed(shapes, 4)
    damaged.standardized[2, 4] = 1.0 + damaged.standardized[2, 3] ** 2 - 0.1  # Pearson's limit
    alone, beside = choice.fit(sound, 0.0, 1.0), choice.fit(damaged, 0.0, 1.0)
    assert beside.status[2] != 0
    others, y = [0, 1, 3, 4], np.full((5, 1), 0.4)
    np.testing.assert_allclose(beside.log_pdf(y)[others], alone.log_pdf(y)[others], atol=1e-7)
