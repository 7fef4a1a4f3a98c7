"""Pearson's mixtures: known ones come back, partials are exact, guessing gains nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats
from scipy.special import expit

from aleator.errors import InputsError
from aleator.moments.densities import (
    FAILED_SOLVE_PENALTY,
    FittedGaussianMixture,
    Gaussian,
    GaussianMixture,
    Sensitivity,
)
from aleator.moments.densities.moments import Moments, weighted_moments
from aleator.moments.densities.pearson import mixture_moments, two_normals
from aleator.status import DEGENERATE_VALUE, Status
from aleator.types import Array


def moments(standardized: Array, mean: float = 0.0, sd: float = 1.0) -> Moments:
    rows = np.atleast_2d(standardized)
    return Moments(np.full(rows.shape[0], mean), np.full(rows.shape[0], sd), rows)


def fit(m: Moments) -> FittedGaussianMixture:
    return GaussianMixture().fit(m, -np.inf, np.inf)


def mixtures(count: int, seed: int) -> tuple[Array, Array, Array]:
    """Weights, means, variances (N, 2) of mixtures of mean 0 and variance 1."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0.05, 0.95, count)
    d = np.sort(2.0 * rng.normal(size=(count, 2)), axis=1)
    w, v = np.stack([first, 1.0 - first], axis=1), rng.uniform(0.1, 2.0, (count, 2)) ** 2
    d -= (w * d).sum(axis=1, keepdims=True)
    variance = (w * (d**2 + v)).sum(axis=1, keepdims=True)
    return w, d / np.sqrt(variance), v / variance


def test_known_mixtures_come_back() -> None:
    w, d, v = mixtures(1000, seed=0)
    found = two_normals(mixture_moments(w, d, v))
    assert found.exists.all()
    for exact, here in ((w, found.weights), (d, found.means), (v, found.variances)):
        np.testing.assert_allclose(here, exact, atol=1e-8)


def test_moments_by_a_quadrature_of_the_density() -> None:
    w, d, v = mixtures(3, seed=1)
    fitted = fit(moments(mixture_moments(w, d, v), mean=7.0, sd=3.0))
    u = np.linspace(-20.0, 20.0, 40001)
    f = fitted.pdf(np.tile(7.0 + 3.0 * u, (3, 1)))
    for m in range(7):
        recomputed = 3.0 * (f * u**m).sum(axis=1) * (u[1] - u[0])
        np.testing.assert_allclose(recomputed, mixture_moments(w, d, v)[:, m], rtol=1e-9, atol=1e-9)


def test_no_mixture_is_overlooked() -> None:
    """Another algorithm: Powell's, from 300 random starts, on the five moment equations."""
    rng = np.random.default_rng(2)
    w, d, v = mixtures(6, seed=3)
    asked = mixture_moments(w, d, v)
    # move the moments off those of the mixtures that made them
    asked[:, 5] *= 1.0 + 0.02 * rng.normal(size=6)

    def unfold(x: Array) -> tuple[Array, Array, Array]:
        return expit(np.array([x[0], -x[0]])), x[1:3], np.exp(np.minimum(x[3:], 50.0))

    def misfit(x: Array, row: Array) -> Array:
        return mixture_moments(*unfold(x))[1:6] - row[1:6]

    found = two_normals(asked)
    for n in range(6):
        sixth = []
        for _ in range(50):
            start = np.array(
                [rng.normal(), -abs(rng.normal()), abs(rng.normal()), *rng.normal(size=2)]
            )
            x, info, flag, _ = optimize.fsolve(misfit, start, args=(asked[n],), full_output=True)
            narrow = x[3:].min() < 2.0 * np.log(0.01)
            if flag == 1 and np.abs(info["fvec"]).max() < 1e-9 and not narrow:
                sixth.append(mixture_moments(*unfold(x))[6])
        if sixth:
            assert found.exists[n]
            ours = mixture_moments(found.weights[n], found.means[n], found.variances[n])[6]
            best = min(sixth, key=lambda value: abs(value - asked[n, 6]))
            assert abs(ours - asked[n, 6]) <= abs(best - asked[n, 6]) + 1e-6


def check_partials(m: Moments, y: Array) -> Sensitivity:
    found = fit(m).sensitivity(y)

    def close(exact: Array, change: Callable[[float], Moments], h: float = 1e-5) -> None:
        v = [fit(change(k * h)).sensitivity(y).value for k in (-2, -1, 1, 2)]
        slope = (8.0 * (v[2] - v[1]) - (v[3] - v[0])) / (12.0 * h)
        np.testing.assert_allclose(exact, slope, rtol=2e-5, atol=2e-5)

    close(found.d_mean * m.sd, lambda h: replace(m, mean=m.mean + h * m.sd))
    close(found.d_sd * m.sd, lambda h: replace(m, sd=m.sd * (1 + h)))
    for k in range(3, m.order + 1):
        unit = np.eye(m.order + 1)[k]
        close(
            found.d_standardized[:, k],
            lambda h, unit=unit: replace(m, standardized=m.standardized + h * unit),
        )
    assert not found.d_standardized[:, :3].any()
    return found


def test_every_partial_by_differences() -> None:
    w, d, v = mixtures(40, seed=4)
    # mixtures near a fold bend too much for differences
    clear = (d[:, 1] - d[:, 0] > 1.0) & (w.min(axis=1) > 0.2)
    m = moments(mixture_moments(w, d, v)[clear], mean=2.0, sd=0.3)
    assert clear.sum() > 10
    for place in (-1.5, 0.2, 4.0):
        found = check_partials(m, m.mean + place * m.sd)
        assert (found.status == Status.SOLVED).all()


def test_a_symmetric_bimodal_law() -> None:
    """1/2 N(-c, s^2) + 1/2 N(c, s^2): the nonic has double roots beside the one that counts."""
    m = moments(mixture_moments(np.full(2, 0.5), np.array([-0.8, 0.8]), np.full(2, 0.36)))
    fitted = fit(m)
    np.testing.assert_allclose(fitted.parts.means, [[-0.8, 0.8]], atol=1e-12)
    np.testing.assert_allclose(fitted.parts.variances, [[0.36, 0.36]], atol=1e-12)
    check_partials(m, np.array([0.6]))


def test_two_scales_of_one_mean() -> None:
    """w N(0, s^2) + (1 - w) N(0, t^2) from its moments 4 and 6."""
    w, v = np.array([0.7, 0.3]), np.array([0.4, 2.4])
    m = moments(mixture_moments(w, np.zeros(2), v))
    fitted = fit(m)
    assert fitted.status.tolist() == [Status.SOLVED]
    np.testing.assert_allclose(fitted.parts.weights, [w], atol=1e-12)
    np.testing.assert_allclose(fitted.parts.variances, [v], atol=1e-12)
    found = fitted.sensitivity([0.5])
    h = 1e-5
    for k in (4, 6):
        unit = h * np.eye(7)[k]
        up, down = (
            fit(moments(m.standardized + sign * unit)).sensitivity([0.5]).value for sign in (1, -1)
        )
        np.testing.assert_allclose(found.d_standardized[:, k], (up - down) / (2 * h), rtol=1e-7)


def test_a_normal_law_is_itself() -> None:
    standardized = np.array([1.0, 0.0, 1.0, 1e-9, 3.0 - 1e-8, 1e-9, 15.0])
    fitted = fit(moments(standardized, mean=3.0, sd=2.0))
    exact = stats.norm(3.0, 2.0)
    y = np.array([[-1.0, 3.0, 8.0]])
    assert fitted.status.tolist() == [Status.SOLVED]
    np.testing.assert_allclose(fitted.log_pdf(y), exact.logpdf(y), rtol=1e-12)
    np.testing.assert_allclose(fitted.cdf(y), exact.cdf(y), rtol=1e-12)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.3, -1.0, 0.5), (0.2, 1.0, -1.0)])
def test_towards_a_normal_law_the_value_is_continuous(direction: tuple[float, ...]) -> None:
    """With a mixture or without: the value tends to that of the normal law."""
    y, gaps = np.array([1.3]), []
    for size in (1e-2, 1e-3, 1e-4, 1e-5):
        c3, c4, c5 = size * np.array(direction)
        m = moments(np.array([1.0, 0.0, 1.0, c3, 3.0 + c4, c5 + 10.0 * c3, 15.0 + 15.0 * c4]))
        gaps.append(abs(float(fit(m).sensitivity(y).value[0]) - stats.norm.logpdf(1.3)))
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[-1] < 1e-4


def test_without_a_mixture_the_normal_density_stands_in_and_pays() -> None:
    three = weighted_moments(np.array([[0.0, 1.0, 5.0]]), np.array([0.1, 0.6, 0.3]), 6)
    points = moments(three.standardized, mean=1.0, sd=2.0)
    fitted, y = fit(points), np.array([0.4])
    assert fitted.status.tolist() == [Status.NO_MIXTURE]
    np.testing.assert_allclose(fitted.log_pdf(y), stats.norm.logpdf(0.4, 1.0, 2.0))
    found = check_partials(points, y)
    lost = fitted.log_pdf(y) - found.value
    assert 0.0 < float(lost[0]) <= FAILED_SOLVE_PENALTY


@settings(max_examples=300)
@given(st.floats(-4, 4), st.floats(0, 6), st.floats(-30, 30), st.floats(0, 60), st.floats(-9, 9))
def test_any_moments_give_a_finite_value_and_an_honest_status(
    skewness: float, kurtosis: float, fifth: float, sixth: float, y: float
) -> None:
    m = moments(np.array([1.0, 0.0, 1.0, skewness, 1.0 + skewness**2 + kurtosis, fifth, sixth]))
    fitted = fit(m)
    found = fitted.sensitivity([y])
    for name in found.__dataclass_fields__:
        assert np.isfinite(getattr(found, name)).all(), name
    assert float(found.value[0]) <= float(fitted.log_pdf([y])[0]) + 1e-9
    if fitted.status[0] == Status.SOLVED:
        # moments within 1e-6 of a normal or symmetric law's are taken as those
        parts = fitted.parts
        has = mixture_moments(parts.weights, parts.means, parts.variances)[0, :6]
        asked = m.standardized[0, :6]
        assert (np.abs(has - asked) <= 2e-5 * np.maximum(1.0, np.abs(asked))).all()
        normal = Gaussian().fit(m, -np.inf, np.inf)
        assert float(fitted.log_pdf([0.0])[0]) <= float(normal.log_pdf([0.0])[0]) + 4.7


def test_distribution_function_and_quantiles_agree() -> None:
    w, d, v = mixtures(4, seed=6)
    fitted = fit(moments(mixture_moments(w, d, v), mean=-2.0, sd=0.1))
    p = np.array([0.0, 1e-12, 0.03, 0.5, 0.999, 1.0])
    q = fitted.quantile(p)
    np.testing.assert_allclose(fitted.cdf(q), np.tile(p, (4, 1)), rtol=1e-9)
    assert np.isinf(q[:, [0, -1]]).all()


def test_no_scatter_is_a_point_mass() -> None:
    standardized = mixture_moments(np.full(2, 0.5), np.array([-0.8, 0.8]), np.full(2, 0.36))
    m = Moments(np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.stack([standardized] * 2))
    fitted = fit(m)
    found = fitted.sensitivity([1.0, np.nan])
    assert fitted.status.tolist() == [Status.DEGENERATE, Status.SOLVED]
    assert found.value.tolist() == [DEGENERATE_VALUE] * 2
    assert fitted.log_pdf([1.0, 0.0])[0] == -np.inf
    np.testing.assert_allclose(fitted.quantile([0.1, 0.9])[0], 1.0)
    np.testing.assert_allclose(fitted.cdf([[0.9, 1.1], [0.0, 0.0]])[0], [0.0, 1.0])


def test_too_few_moments_are_refused() -> None:
    with pytest.raises(InputsError, match="needs 6 moments, 4 given"):
        fit(moments(np.array([1.0, 0.0, 1.0, 0.0, 3.0])))
