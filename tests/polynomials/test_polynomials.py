"""Recurrences and Gauss rules against families that are known in closed form."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy import special

from aleator.polynomials import (
    evaluate,
    gauss,
    gauss_hermite,
    gauss_legendre,
    hermite_recurrence,
    stieltjes,
    tensor,
)


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


def test_stieltjes_works_on_many_weights_at_once() -> None:
    t, w = np.polynomial.legendre.leggauss(50)
    weights = np.stack([w / 2.0, w * np.exp(t) / np.sum(w * np.exp(t))])
    a, b = stieltjes(np.stack([t, t]), weights, 6)
    for row in range(2):
        alone = stieltjes(t, weights[row], 6)
        np.testing.assert_array_equal(a[row], alone[0])
        np.testing.assert_array_equal(b[row], alone[1])
    # Legendre: a = 0, b_k = k^2/(4 k^2 - 1)
    k = np.arange(1.0, 6.0)
    np.testing.assert_allclose(a[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(b[0, 1:], k**2 / (4.0 * k**2 - 1.0), rtol=1e-13)


@pytest.mark.parametrize("q", [1, 2, 7, 20, 60])
def test_gauss_hermite_is_that_of_numpy(q) -> None:
    t, w = gauss_hermite(q)
    x, expected = np.polynomial.hermite_e.hermegauss(q)
    np.testing.assert_allclose(t, x, atol=1e-13 * max(1, q))
    # the weights of the outer nodes, 1e-40 of the whole, are good to rounding of the whole
    np.testing.assert_allclose(w, expected / np.sqrt(2.0 * np.pi), atol=1e-15 * max(1, q))
    assert w.sum() == pytest.approx(1.0, abs=1e-14)


def test_gauss_rules_are_exact_to_their_degree_and_no_further() -> None:
    q = 6
    for rule, moment in (
        (gauss_legendre(q), lambda m: 1.0 / (m + 1)),
        (gauss_hermite(q), lambda m: special.factorial2(m - 1) if m else 1.0),
    ):
        t, w = rule
        for m in range(0, 2 * q, 2):
            assert w @ t**m == pytest.approx(moment(m), rel=1e-13)
        assert w @ t ** (2 * q) != pytest.approx(moment(2 * q), rel=1e-5)


def test_cached_rules_cannot_be_spoiled() -> None:
    with pytest.raises(ValueError, match="read-only"):
        gauss_hermite(5)[0][0] = 1.0


def test_gauss_of_a_batch_is_that_of_each() -> None:
    a = np.array([[0.0, 0.0, 0.0], [1.0, 3.0, 5.0]])
    b = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 4.0]])
    nodes, weights = gauss(a, b)
    for row in range(2):
        alone = gauss(a[row], b[row])
        np.testing.assert_allclose(nodes[row], alone[0], atol=1e-15)
        np.testing.assert_allclose(weights[row], alone[1], atol=1e-15)


def test_tensor_counts_every_combination_once_the_last_fastest() -> None:
    picks = tensor((2, 1, 3))
    assert picks.tolist() == [list(i) for i in product(range(2), range(1), range(3))]
