"""What a fitted batch promises: moments met, normalized, invertible, the same alone or together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moments.densities.targets import mixed, row, single
from scipy import stats
from scipy.integrate import quad

from aleator.moments.densities import FittedDensity, MaximumEntropy
from aleator.moments.densities.moments import Moments
from aleator.status import Status


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


def test_cdf_is_the_integral_of_the_pdf() -> None:
    moments, lower, upper = mixed(4, 4, seed=3)
    fitted = MaximumEntropy(4).fit(moments, lower, upper)
    end = moments.mean + 0.3 * moments.sd
    for index in range(4):
        one = MaximumEntropy(4).fit(row(moments, index), lower[[index]], upper[[index]])
        area = quad(
            lambda y, f=one: f.pdf([y])[0], one.quantile([0.0])[0, 0], end[index], limit=200
        )[0]
        np.testing.assert_allclose(fitted.cdf(end)[index], area, atol=1e-8)
    below, above = fitted.cdf(lower - 1.0), fitted.cdf(upper + 1.0)
    np.testing.assert_allclose(below, 0.0, atol=0)
    np.testing.assert_allclose(above, 1.0, rtol=1e-13)


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


def test_shapes_of_y() -> None:
    moments, lower, upper = mixed(5, 4, seed=6)
    fitted = MaximumEntropy(4).fit(moments, lower, upper)
    grid = moments.mean[:, None] + moments.sd[:, None] * np.linspace(-1, 1, 3)
    assert fitted.log_pdf(grid).shape == (5, 3)
    np.testing.assert_allclose(fitted.log_pdf(grid[:, 1]), fitted.log_pdf(grid)[:, 1], rtol=1e-14)
    none = Moments(np.empty(0), np.empty(0), np.empty((0, 5)))
    assert MaximumEntropy(4).fit(none, np.empty(0), np.empty(0)).log_pdf(np.empty(0)).shape == (0,)
