"""Polynomials and Gauss rules: exact to degree 2 q - 1 and no further, exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import mpmath
import numpy as np
import pytest
from scipy import special, stats

from aleator.core.polynomials import (
    evaluate,
    gauss,
    gauss_hermite,
    gauss_with_gradient,
    hermite_recurrence,
    jacobi_recurrence,
    laguerre_recurrence,
    legendre_recurrence,
    recurrence_with_gradient,
    stieltjes,
    tensor,
)
from aleator.core.types import Array


def standard(recurrence: tuple[Array, Array]) -> tuple[Array, Array]:
    """The recurrence of the same law with mean 0 and sd 1."""
    a, b = recurrence
    return (a - a[0]) / np.sqrt(b[1]), np.concatenate([b[:1], b[1:] / b[1]])


def beta_moments(p: float, q: float) -> Callable[[int], mpmath.mpf]:
    @cache
    def moment(order: int) -> mpmath.mpf:
        """E z^order of the standardized beta law, from E x^m = (p)_m/(p+q)_m in 80 digits."""
        with mpmath.workdps(80):
            P, Q = mpmath.mpf(p), mpmath.mpf(q)
            mean, var = P / (P + Q), P * Q / ((P + Q) ** 2 * (P + Q + 1))
            raw = [mpmath.rf(P, m) / mpmath.rf(P + Q, m) for m in range(order + 1)]
            terms = [mpmath.binomial(order, m) * raw[m] * (-mean) ** (order - m)
                     for m in range(order + 1)]  # fmt: skip
            return mpmath.fsum(terms) / mpmath.sqrt(var) ** order

    return moment


def gamma_moments(k: float) -> Callable[[int], mpmath.mpf]:
    @cache
    def moment(order: int) -> mpmath.mpf:
        """E z^order of the standardized gamma law, from E g^m = (k)_m in 200 digits."""
        with mpmath.workdps(200):
            K = mpmath.mpf(k)
            terms = [mpmath.binomial(order, m) * mpmath.rf(K, m) * (-K) ** (order - m)
                     for m in range(order + 1)]  # fmt: skip
            return mpmath.fsum(terms) / mpmath.sqrt(K) ** order

    return moment


FAMILIES = [
    pytest.param(standard(legendre_recurrence(21)), beta_moments(1.0, 1.0), id="legendre"),
    *[
        pytest.param(jacobi_recurrence(21, p, q), beta_moments(p, q), id=f"jacobi {p} {q}")
        for p, q in ((1.0, 1.0), (0.5, 0.5), (0.1, 3.0), (2.0, 5.0), (0.9, 1.1), (400.0, 3e4))
    ],
    *[
        pytest.param(laguerre_recurrence(21, k**-0.5), gamma_moments(k), id=f"laguerre {k:g}")
        for k in (0.2, 1.0, 7.5, 1e3, 1e6)
    ],
]


@pytest.mark.parametrize(("recurrence", "moment"), FAMILIES)
@pytest.mark.parametrize("q", [1, 4, 12, 20])
def test_rules_are_exact_to_degree_2q_minus_1_and_no_further(recurrence, moment, q) -> None:
    a, b = (part[:q] for part in recurrence)
    t, w = gauss(a, b)
    assert w.sum() == pytest.approx(1.0, abs=1e-13)
    for m in range(2 * q):
        even = float(moment(m + m % 2))
        # rounding is relative to the absolute moment, which an even one bounds
        assert float(w @ t**m) / even == pytest.approx(float(moment(m)) / even, abs=1e-11)
    # what is missing at degree 2 q is the square of the monic polynomial: b_1 b_2 ... b_q
    missing = float(moment(2 * q)) - float(w @ t ** (2 * q))
    norm = float(np.prod(recurrence[1][1 : q + 1]))
    assert missing == pytest.approx(norm, rel=1e-6, abs=1e-10 * float(moment(2 * q)))
    assert norm > 0.0


@pytest.mark.parametrize(("recurrence", "moment"), FAMILIES)
def test_polynomials_are_orthonormal_to_degree_20(recurrence, moment) -> None:  # noqa: ARG001
    t, w = gauss(*recurrence)
    table = evaluate(*recurrence, t, 20)
    np.testing.assert_allclose(table.T @ (table * w[:, None]), np.eye(21), atol=1e-10)


@pytest.mark.parametrize(("p", "q"), [(0.5, 0.5), (2.0, 5.0), (1.0, 1.0)])
def test_jacobi_is_what_stieltjes_makes_of_the_density(p: float, q: float) -> None:
    # x = sin^2 makes the density smooth also where a shape is one half
    s, w = np.polynomial.legendre.leggauss(200)
    x = np.sin(0.25 * np.pi * (s + 1.0)) ** 2
    weights = w * x ** (p - 0.5) * (1.0 - x) ** (q - 0.5)
    law = stats.beta(p, q)
    a, b = stieltjes((x - law.mean()) / law.std(), weights / weights.sum(), 15)
    np.testing.assert_allclose(a, jacobi_recurrence(15, p, q)[0], atol=1e-11)
    np.testing.assert_allclose(b, jacobi_recurrence(15, p, q)[1], rtol=1e-11)


def test_families_have_their_limits() -> None:
    """Gamma and beta laws of large shapes tend to the normal one."""
    a, b = hermite_recurrence(12)
    for far in (laguerre_recurrence(12, 1e-7), jacobi_recurrence(12, 1e13, 1e13)):
        np.testing.assert_allclose(far[0], a, atol=1e-5)
        np.testing.assert_allclose(far[1], b, rtol=1e-10)
    # a large second shape leaves a gamma law
    near = jacobi_recurrence(12, 2.0, 1e12)
    gamma = laguerre_recurrence(12, 2.0**-0.5)
    np.testing.assert_allclose(near[0], gamma[0], rtol=1e-9)
    np.testing.assert_allclose(near[1], gamma[1], rtol=1e-9)


DERIVATIVES = [
    pytest.param(laguerre_recurrence, (0.5,), id="laguerre k = 4"),
    pytest.param(laguerre_recurrence, (5.0**0.5,), id="laguerre k = 0.2"),
    pytest.param(jacobi_recurrence, (0.5, 0.7), id="jacobi singular"),
    pytest.param(jacobi_recurrence, (3.0, 8.0), id="jacobi smooth"),
]


def rule_by_mpmath(family: Callable, parameters: list[mpmath.mpf], q: int) -> list[mpmath.mpf]:
    """Nodes, then weights, in 40 digits, by the eigenvalues of the Jacobi matrix."""
    a, b = _coefficients(family, parameters, q)
    matrix = mpmath.zeros(q)
    for i in range(q):
        matrix[i, i] = a[i]
        if i:
            matrix[i, i - 1] = matrix[i - 1, i] = mpmath.sqrt(b[i])
    values, vectors = mpmath.eigsy(matrix)
    return [*values, *(vectors[0, i] ** 2 for i in range(q))]


def _coefficients(family, parameters, q):
    """The classical coefficients (Gautschi, table 1.1), then standardized: another way."""
    if family is laguerre_recurrence:
        k = 1 / parameters[0] ** 2
        return ([(2 * n + k - k) / mpmath.sqrt(k) for n in range(q)],
                [n * (n + k - 1) / k for n in range(q)])  # fmt: skip
    p, r = parameters
    al, be = r - 1, p - 1
    a = [(be - al) / (al + be + 2)] + [
        (be**2 - al**2) / ((2 * n + al + be) * (2 * n + al + be + 2)) for n in range(1, q)
    ]
    b = [1, 4 * (al + 1) * (be + 1) / ((al + be + 2) ** 2 * (al + be + 3))] + [
        4 * n * (n + al) * (n + be) * (n + al + be)
        / ((2 * n + al + be) ** 2 * (2 * n + al + be + 1) * (2 * n + al + be - 1))
        for n in range(2, q)
    ]  # fmt: skip
    return [(value - a[0]) / mpmath.sqrt(b[1]) for value in a], [1, *(v / b[1] for v in b[1:])]


@pytest.mark.parametrize(("family", "parameters"), DERIVATIVES)
def test_derivatives_of_the_rule_are_those_of_forty_digits(family, parameters) -> None:
    q = 6
    parts = gauss_with_gradient(*recurrence_with_gradient(family, q, parameters))
    with mpmath.workdps(40):
        exact = [mpmath.mpf(value) for value in parameters]
        here = rule_by_mpmath(family, exact, q)
        np.testing.assert_allclose([*parts[0], *parts[1]], np.array(here, float), atol=1e-13)
        for k in range(len(parameters)):
            ends = []
            for sign in (1, -1):
                moved = [value * (1 + sign * mpmath.mpf(10) ** -12 * (i == k))
                         for i, value in enumerate(exact)]  # fmt: skip
                ends.append(rule_by_mpmath(family, moved, q))
            step = 2 * exact[k] * mpmath.mpf(10) ** -12
            slope = [float((u - v) / step) for u, v in zip(*ends, strict=True)]
            np.testing.assert_allclose([*parts[2][:, k], *parts[3][:, k]], slope, atol=1e-11)


def test_derivatives_of_weights_sum_to_zero() -> None:
    parts = gauss_with_gradient(*recurrence_with_gradient(jacobi_recurrence, 20, (0.3, 4.0)))
    np.testing.assert_allclose(parts[3].sum(axis=0), 0.0, atol=1e-13)
    assert np.abs(parts[3]).max() > 1e-3


def test_tensor_takes_every_combination_once() -> None:
    picks = tensor((2, 3, 1))
    assert picks.shape == (6, 3)
    assert len({tuple(row) for row in picks.tolist()}) == 6


def test_hermite_polynomials_are_those_of_scipy() -> None:
    t = np.linspace(-6.0, 6.0, 41)
    table = evaluate(*hermite_recurrence(16), t, 15)
    for k in range(16):
        expected = special.eval_hermitenorm(k, t) / math.sqrt(math.factorial(k))
        np.testing.assert_allclose(table[:, k], expected, rtol=1e-11, atol=1e-11)


def test_stieltjes_recovers_the_recurrence_of_laguerre() -> None:
    # a_k = 2k + 1 and b_k = k^2 for the weight exp(-t); the rule is exact to degree 2 * 40 - 1
    t, w = np.polynomial.laguerre.laggauss(40)
    a, b = stieltjes(t, w, 12)
    np.testing.assert_allclose(a, 2.0 * np.arange(12) + 1.0, rtol=1e-10)
    np.testing.assert_allclose(b[1:], np.arange(1.0, 12.0) ** 2, rtol=1e-10)


@pytest.mark.parametrize("q", [1, 2, 7, 20, 60])
def test_gauss_hermite_is_that_of_numpy(q) -> None:
    t, w = gauss_hermite(q)
    x, expected = np.polynomial.hermite_e.hermegauss(q)
    np.testing.assert_allclose(t, x, atol=1e-13 * max(1, q))
    # the weights of the outer nodes, 1e-40 of the whole, are good to rounding of the whole
    np.testing.assert_allclose(w, expected / np.sqrt(2.0 * np.pi), atol=1e-15 * max(1, q))
    assert w.sum() == pytest.approx(1.0, abs=1e-14)


def test_gauss_of_a_batch_is_that_of_each() -> None:
    a = np.array([[0.0, 0.0, 0.0], [1.0, 3.0, 5.0]])
    b = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 4.0]])
    nodes, weights = gauss(a, b)
    for row in range(2):
        alone = gauss(a[row], b[row])
        np.testing.assert_allclose(nodes[row], alone[0], atol=1e-15)
        np.testing.assert_allclose(weights[row], alone[1], atol=1e-15)
