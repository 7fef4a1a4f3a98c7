"""Log-splines: exact in their family, converging outside it, with exact partials."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from aleator.densities import (
    DEGENERATE_VALUE,
    FAILED_SOLVE_PENALTY,
    FittedDensity,
    FittedLogSpline,
    LogSpline,
    MaximumEntropy,
    NodeSensitivity,
    Status,
)
from aleator.densities.logspline.splines import NoisyPowers, evaluate, noisy, splines
from aleator.densities.moments import weighted_moments
from aleator.densities.outcomes import Outcomes
from aleator.errors import InputsError
from aleator.types import Array

COUNT = 2000
LEVELS = (np.arange(COUNT) + 0.5) / COUNT
EQUAL = np.full(COUNT, 1.0 / COUNT)


def fit(
    choice: LogSpline, y: Array, noise: float = 0.0, low: float = -np.inf, high: float = np.inf
) -> FittedLogSpline:
    return choice.fit_nodes(Outcomes(np.atleast_2d(y), EQUAL), noise, low, high)


def bimodal(p: Array) -> Array:
    """Quantiles of 0.4 Normal(-1, 1/16) + 0.6 Normal(0.8, 1/4)."""
    y = np.linspace(-4.0, 4.0, 100001)
    below = 0.4 * stats.norm.cdf(y, -1.0, 0.25) + 0.6 * stats.norm.cdf(y, 0.8, 0.5)
    return np.interp(p, below, y)


def bimodal_density(y: Array) -> Array:
    density: Array = 0.4 * stats.norm.pdf(y, -1.0, 0.25) + 0.6 * stats.norm.pdf(y, 0.8, 0.5)
    return density


Function = Callable[[Array], Array]
LAWS: list[tuple[Function, Function, float, float, float, float]] = [
    (bimodal, bimodal_density, -np.inf, np.inf, -4.0, 4.0),
    (stats.gamma(2.0).ppf, stats.gamma(2.0).pdf, 0.0, np.inf, 0.0, 40.0),
    (stats.beta(0.7, 0.7).ppf, stats.beta(0.7, 0.7).pdf, 0.0, 1.0, 0.0, 1.0),
]


def test_splines_with_noise_against_monte_carlo_and_differences() -> None:
    rng = np.random.default_rng(0)
    t, s, c = rng.uniform(-0.2, 1.2, (2, 4)), np.array([0.05, 0.4]), rng.normal(size=(2, 10))
    value, by_place, by_noise = noisy(c, NoisyPowers.at(t, s, 7))
    places = np.clip(t[:, :, None] + s[:, None, None] * rng.standard_normal(40000), 0.0, 1.0)
    sampled = evaluate(c, places.reshape(2, -1)).reshape(2, 4, -1)
    error = sampled.std(axis=2) / 200.0
    assert (np.abs(sampled.mean(axis=2) - value) < 4.0 * error).all()
    h = 1e-5
    for exact, (dt, ds) in ((by_place, (h, 0.0)), (by_noise, (0.0, h))):
        up, down = (
            noisy(c, NoisyPowers.at(t + sign * dt, s + sign * ds, 7))[0] for sign in (1, -1)
        )
        np.testing.assert_allclose(exact, (up - down) / (2 * h), atol=1e-7)


def test_splines_sum_to_one_and_evaluate_agrees() -> None:
    t, c = np.linspace(0.0, 1.0, 50), np.random.default_rng(1).normal(size=(1, 12))
    np.testing.assert_allclose(splines(t, 9).sum(axis=1), 1.0)
    np.testing.assert_allclose(evaluate(c, t[None])[0], splines(t, 9) @ c[0], atol=1e-14)
    slope = splines(t[1:-1], 9, 1) @ c[0]
    np.testing.assert_allclose(evaluate(c, t[None, 1:-1], 1)[0], slope, atol=1e-11)


def test_a_law_of_the_family_comes_back() -> None:
    """exp of a cubic spline, by a Gauss rule within its intervals; the error is the smoothing's."""
    c = np.array([0.0, 1.0, -1.0, 2.0, 0.5, -2.0, 1.0, 0.0])
    x, w = np.polynomial.legendre.leggauss(40)
    t = ((np.arange(5)[:, None] + 0.5 * (x + 1.0)) / 5).ravel()
    f = np.exp(splines(t, 5) @ c)
    mass = f * np.tile(w, 5) / 10.0
    outcomes = Outcomes((3.0 + 2.0 * t)[None], mass / mass.sum())
    for smoothing, accuracy in ((1e-6, 2e-2), (1e-8, 2e-4), (1e-10, 2e-6)):
        fitted = LogSpline(5, smoothing=smoothing).fit_nodes(outcomes, 0.0, [3.0], [5.0])
        assert fitted.status.tolist() == [Status.SOLVED]
        exact = f / (2.0 * mass.sum())
        np.testing.assert_allclose(fitted.pdf((3.0 + 2.0 * t)[None])[0], exact, rtol=accuracy)


def test_a_normal_outcome_with_noise_stays_normal() -> None:
    """exp(-u^2/2) is of the family, whatever the smoothing; the ends cost 1e-15 at eight sds."""
    x = stats.norm.ppf(LEVELS)
    x /= np.sqrt(np.mean(x**2))
    fitted = fit(LogSpline(12, smoothing=1e2), x, noise=1.0)
    exact = stats.norm(0.0, np.sqrt(2.0))
    y = np.linspace(-4.0, 4.0, 9)[None]
    np.testing.assert_allclose(fitted.log_pdf(y), exact.logpdf(y), atol=2e-3)


@pytest.mark.parametrize("law", [0, 1, 2])
def test_more_knots_come_closer_than_any_eight_moments(law: int) -> None:
    quantile, density, low, high, first, last = LAWS[law]
    x, w = np.polynomial.legendre.leggauss(1500)
    y = 0.5 * (first + last) + 0.5 * (last - first) * x
    mass = w * density(y) / (w @ density(y))
    truth = quantile((np.arange(20000) + 0.5) / 20000)[None]
    entropy = -float(np.log(density(truth)).mean())

    def distance(fitted: FittedDensity) -> float:
        """Kullback-Leibler, from the truth; no outcome lies beyond eight sds."""
        return -float(fitted.log_pdf(truth).mean()) - entropy

    outcomes = Outcomes(y[None], mass)
    distances = [
        distance(LogSpline(knots, smoothing=1e-6).fit_nodes(outcomes, 0.0, low, high))
        for knots in (4, 8, 16, 32)
    ]
    m = weighted_moments(y[None], mass, 8)
    moments = [distance(MaximumEntropy(order).fit(m, low, high)) for order in (4, 6, 8)]
    assert distances == sorted(distances, reverse=True)
    assert distances[-1] < 0.5 * min(moments)
    assert distances[-1] < 2e-3


def test_nodes_of_equal_probability_leave_the_tail_empty() -> None:
    """So many knots overfit the last of 2000 nodes, and more smoothing mends it."""
    y, truth = stats.gamma(2.0).ppf(LEVELS), stats.gamma(2.0).ppf((np.arange(9000) + 0.5) / 9000)
    rough, smooth = (
        -float(fit(LogSpline(48, smoothing=s), y, 0.0, 0.0).log_pdf(truth[None])[0].mean())
        for s in (1e-6, 1e-3)
    )
    exact = float(stats.gamma(2.0).entropy())
    assert smooth - exact < 0.2 * (rough - exact)


def test_every_partial_by_differences() -> None:
    rng, count = np.random.default_rng(2), 80
    x = stats.norm.ppf((np.arange(count) + 0.5) / count)
    y = np.stack([x, np.exp(0.3 * x), np.tanh(x), np.where(x > 0.0, 9.0, -9.0) + x])
    w = rng.dirichlet(20.0 * np.ones(count))
    low, high = np.array([-np.inf, 0.0, -1.0, -np.inf]), np.array([np.inf, np.inf, 1.0, np.inf])
    noise, choice = 0.3, LogSpline(10, reach=6.0, smoothing=1e-4)

    def value(
        at: Array, y: Array, w: Array, noise: float, low: Array, high: Array
    ) -> NodeSensitivity:
        return choice.fit_nodes(Outcomes(y, w), noise, low, high).node_sensitivity(at)

    for at, last in ((np.array([0.3, 1.2, 0.5, 3.0]), 0), (np.array([-9.0, 6.0, -5.0, 1.0]), 3)):
        found = value(at, y, w, noise, low, high)
        assert found.status.tolist() == [last] * 3 + [Status.TOO_COARSE]

        def close(exact: Array, change: Callable[[float], NodeSensitivity]) -> None:
            h = 1e-4
            v = [change(k * h).value for k in (-2, -1, 1, 2)]
            slope = (8.0 * (v[2] - v[1]) - (v[3] - v[0])) / (12.0 * h)
            np.testing.assert_allclose(exact, slope, rtol=2e-4, atol=2e-6)

        for j in (0, 31, 79):
            unit = np.eye(count)[j]
            close(
                found.d_y[:, j], lambda h, e=unit, at=at: value(at, y + h * e, w, noise, low, high)
            )
            # weights keep their sum
            shift = 0.1 * (unit - np.eye(count)[(j + 7) % count])
            close(
                found.d_weights @ shift,
                lambda h, e=shift, at=at: value(at, y, w + h * e, noise, low, high),
            )
        close(found.d_noise, lambda h, at=at: value(at, y, w, noise + h, low, high))


def test_distribution_function_and_quantiles_agree() -> None:
    y = np.stack([bimodal(LEVELS), stats.norm.ppf(LEVELS)])
    fitted = fit(LogSpline(20), y, 0.1)
    p = np.array([0.0, 1e-6, 0.3, 0.999, 1.0])
    q = fitted.quantile(p)
    np.testing.assert_allclose(q[:, 0], fitted.range.a)
    np.testing.assert_allclose(q[:, -1], fitted.range.b)
    np.testing.assert_allclose(fitted.cdf(q), np.tile(p, (2, 1)), atol=1e-12)
    h = 1e-5
    slope = (fitted.cdf(q[:, 2:4] + h) - fitted.cdf(q[:, 2:4] - h)) / (2 * h)
    np.testing.assert_allclose(fitted.pdf(q[:, 2:4]), slope, rtol=1e-6)


def test_a_batch_is_its_rows() -> None:
    y = np.stack([bimodal(LEVELS), np.exp(0.3 * stats.norm.ppf(LEVELS))])
    batch = fit(LogSpline(12), y, 0.2).node_sensitivity([0.5, 0.9])
    for n, at in enumerate((0.5, 0.9)):
        one = fit(LogSpline(12), y[n], 0.2).node_sensitivity([at])
        np.testing.assert_allclose(batch.value[n], one.value[0], rtol=1e-9)
        np.testing.assert_allclose(batch.d_y[n], one.d_y[0], rtol=1e-6, atol=1e-10)


def test_the_value_outside_never_exceeds_the_edge() -> None:
    fitted = fit(LogSpline(8, reach=4.0), stats.norm.ppf(LEVELS), 0.2)
    low, high = fitted.quantile([0.0, 1.0])[0]
    edge = fitted.log_pdf([[low, high]])[0]
    for y, value in ((low - 1.0, edge[0]), (high + 1.0, edge[1]), (1e150, edge[1])):
        found = fitted.node_sensitivity([y])
        assert found.status.tolist() == [Status.OUTSIDE_SUPPORT]
        assert float(found.value[0]) < value
        assert np.isfinite(found.d_y).all()
        assert fitted.log_pdf([y])[0] == -np.inf


def test_what_cannot_be_fitted_has_a_status_and_pays() -> None:
    few = Outcomes(
        np.array([[-1.0, 0.0, 5.0], [np.nan, 0.0, 1.0], [2.0, 2.0, 2.0]]), np.ones(3) / 3
    )
    fitted = LogSpline(16).fit_nodes(few, 0.0, -np.inf, np.inf)
    assert fitted.status.tolist() == [Status.TOO_COARSE, Status.DEGENERATE, Status.DEGENERATE]
    found = fitted.node_sensitivity([0.3, 0.0, 2.0])
    np.testing.assert_allclose(
        found.value[0], fitted.log_pdf([0.3, 0, 0])[0] - FAILED_SOLVE_PENALTY
    )
    assert found.value[1:].tolist() == [DEGENERATE_VALUE] * 2
    for name in found.__dataclass_fields__:
        assert np.isfinite(getattr(found, name)).all(), name
    outside = fit(LogSpline(8), stats.norm.ppf(LEVELS), 0.0, low=3.0, high=9.0)
    assert outside.status.tolist() == [Status.NOT_REALIZABLE]


def test_misuse_is_refused() -> None:
    for knots, reach, smoothing in ((1, 8.0, 1.0), (65, 8.0, 1.0), (8, 0.0, 1.0), (8, 8.0, 0.0)):
        with pytest.raises(InputsError, match="logspline with"):
            LogSpline(knots, reach, smoothing)
    with pytest.raises(InputsError, match="not negative"):
        LogSpline().fit_nodes(Outcomes(np.zeros((1, 2)), np.array([2.0, -1.0])), 0.1, 0.0, 1.0)
    assert LogSpline(10).points == 200
