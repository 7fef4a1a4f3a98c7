"""Sobol' indices against closed forms, and against Monte Carlo that knows no expansion."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from aleator.errors import InputsError
from aleator.laws import Normal, TruncatedNormal, Uniform
from aleator.moments.expansion import Basis, Regression, SparseProjection
from aleator.moments.expansion.indices import TotalDegree
from aleator.moments.expansion.sobol import SobolIndices, sobol_indices
from aleator.types import Array


def cube(n: int, lower: float, upper: float) -> Basis:
    law = Uniform.between(lower, upper)
    return Basis((law,) * n, (np.array([h.start for h in law.hyperparameters]),) * n)


def of(basis: Basis, way: Regression | SparseProjection, *functions) -> SobolIndices:
    design = way.design(basis)
    found = way.fit(basis, design, np.stack([function(design.x) for function in functions]))
    return sobol_indices(found.indices, found.coefficients)


def ishigami(x: Array, a: float, b: float) -> Array:
    return np.asarray(np.sin(x[:, 0]) * (1.0 + b * x[:, 2] ** 4) + a * np.sin(x[:, 1]) ** 2)


@pytest.mark.parametrize("way", [Regression(TotalDegree(12)), SparseProjection(TotalDegree(12))])
def test_ishigami(way: Regression | SparseProjection) -> None:
    """Ishigami and Homma 1990: V1 = (1 + b pi^4/5)^2/2, V2 = a^2/8, V13 = 8 b^2 pi^8/225."""
    pairs = [(7.0, 0.1), (7.0, 0.05), (1.0, 0.2)]  # three experiments at once
    functions = [lambda x, a=a, b=b: ishigami(x, a, b) for a, b in pairs]
    found = of(cube(3, -np.pi, np.pi), way, *functions)
    for k, (a, b) in enumerate(pairs):
        v1, v2 = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0
        v13 = 8.0 * b**2 * np.pi**8 / 225.0
        variance = v1 + v2 + v13
        assert found.variance[k] == pytest.approx(variance, rel=2e-4)
        first, total = np.array([v1, v2, 0.0]), np.array([v1 + v13, v2, v13])
        np.testing.assert_allclose(found.first[k], first / variance, atol=1e-4)
        np.testing.assert_allclose(found.total[k], total / variance, atol=1e-4)
        second = np.zeros((3, 3))
        second[0, 2] = second[2, 0] = v13 / variance
        np.testing.assert_allclose(found.second[k], second, atol=1e-4)
        assert found.closed[k, 0, 2] == pytest.approx((v1 + v13) / variance, abs=1e-4)
        assert found.closed[k, 1, 1] == pytest.approx(v2 / variance, abs=1e-4)


def test_the_smooth_g_function_of_sobol() -> None:
    """prod (1 + g_i) with E g_i = 0 has V_i = Var g_i and prod (1 + V_i) - 1 in total.

    Sobol' has g = (|4 x - 2| - 1)/(1 + a), Var 1/(3 (1 + a)^2); with x^2 in place of the kink it is
    g = (3 x^2 - 1)/(1 + a) on [-1, 1], Var 4/(5 (1 + a)^2), and a polynomial.
    """
    a = np.array([0.0, 1.0, 9.0, 99.0])
    basis, part = cube(4, -1.0, 1.0), 0.8 / (1.0 + a) ** 2
    found = of(
        basis,
        Regression(TotalDegree(8), adaptive=False),
        lambda x: np.prod(1.0 + (3.0 * x**2 - 1.0) / (1.0 + a), axis=1),
    )
    variance = np.prod(1.0 + part) - 1.0
    np.testing.assert_allclose(found.variance, variance, rtol=1e-9)
    np.testing.assert_allclose(found.first[0], part / variance, atol=1e-9)
    for i in range(4):
        total = part[i] * np.prod(1.0 + np.delete(part, i)) / variance
        assert found.total[0, i] == pytest.approx(total, abs=1e-9)
    for i, j in combinations(range(4), 2):
        assert found.second[0, i, j] == pytest.approx(part[i] * part[j] / variance, abs=1e-9)


def test_the_g_function_with_its_kinks_is_met_as_far_as_polynomials_go() -> None:
    a = np.array([0.0, 1.0, 4.5, 9.0])
    part = 1.0 / (3.0 * (1.0 + a) ** 2)
    variance = np.prod(1.0 + part) - 1.0
    found = of(
        cube(4, 0.0, 1.0),
        Regression(TotalDegree(8), runs=2000),
        lambda x: np.prod((np.abs(4.0 * x - 2.0) + a) / (1.0 + a), axis=1),
    )
    np.testing.assert_allclose(found.first[0], part / variance, atol=0.015)
    error = np.abs(found.first[0] - part / variance).max()
    assert error > 1e-4  # a kink converges slowly: do not promise more


def test_an_independent_monte_carlo_estimate_agrees() -> None:
    """Saltelli's and Jansen's estimators of SciPy, with laws that are not uniform."""
    laws = (Normal(1.0, 0.5), TruncatedNormal((0.0, 2.0), 0.5, 0.8), Normal(0.0, 1.0))
    basis = Basis(laws, tuple(np.array([h.start for h in law.hyperparameters]) for law in laws))

    def outcome(x: Array) -> Array:
        return np.asarray(np.exp(0.4 * x[:, 0]) * x[:, 1] + 0.3 * x[:, 2] ** 2 * x[:, 0])

    found = of(basis, Regression(TotalDegree(8)), outcome)
    peers = [
        stats.norm(1.0, 0.5),
        stats.truncnorm(-0.5 / 0.8, 1.5 / 0.8, 0.5, 0.8),
        stats.norm(0.0, 1.0),
    ]
    peer = stats.sobol_indices(
        func=lambda x: outcome(x.T), n=2**14, dists=peers, rng=np.random.default_rng(0)
    )
    np.testing.assert_allclose(found.first[0], peer.first_order, atol=0.01)
    np.testing.assert_allclose(found.total[0], peer.total_order, atol=0.01)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_shares_sum_to_one_as_they_must(n: int, degree: int, seed: int) -> None:
    indices = TotalDegree(degree).indices((None,) * n)
    coefficients = np.random.default_rng(seed).normal(size=(2, len(indices)))
    found = sobol_indices(indices, coefficients)
    order = (indices > 0).sum(axis=1)
    whole = np.sum(coefficients[:, 1:] ** 2, axis=1)
    np.testing.assert_allclose(found.variance, whole)
    upper = np.triu(np.ones((n, n)), 1)
    low = np.sum(coefficients**2 * ((order == 1) | (order == 2)), axis=1) / whole
    np.testing.assert_allclose(
        found.first.sum(axis=1) + (found.second * upper).sum(axis=(1, 2)), low, rtol=1e-10
    )
    assert np.all(found.first <= found.total + 1e-12)
    np.testing.assert_allclose(
        found.total.sum(axis=1), np.sum(coefficients**2 * order, axis=1) / whole
    )


def test_an_outcome_that_does_not_vary_has_no_shares() -> None:
    found = sobol_indices(np.array([[0], [1]]), np.array([[5.0, 0.0], [5.0, 1e-14], [5.0, 0.1]]))
    assert np.isnan(found.first[:2]).all()
    assert np.isnan(found.total[:2]).all()
    assert found.first[2, 0] == pytest.approx(1.0)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputsError, match="give coefficients"):
        sobol_indices(np.zeros((3, 2), dtype=np.int64), np.zeros((1, 2)))
