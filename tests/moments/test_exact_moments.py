"""Exact moments of an expansion: both ways, against exact arithmetic and closed forms."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from exact_expansions import (
    FAMILIES,
    SCATTERED,
    SETS,
    TOTAL,
    WAYS,
    assert_same,
    basis_of,
    drawn_with_truth,
)

from aleator.core.types import Indices
from aleator.errors import InputsError
from aleator.moments.exact_moments import ExactQuadrature, Galerkin, cheapest, prepare
from aleator.moments.expansion import Basis

# ------------------------------------------------------------------------------ truths


@pytest.mark.parametrize("way", WAYS, ids=repr)
@pytest.mark.parametrize("indices", SETS.values(), ids=SETS)
@pytest.mark.parametrize("name", FAMILIES)
def test_moments_are_those_of_exact_arithmetic(way, indices, name) -> None:
    names = (name, name)
    c, truth = drawn_with_truth(names, next(key for key in SETS if SETS[key] is indices))
    found = prepare(basis_of(*names), indices, 8, way).moments(c)
    mean, sd, standardized = (np.array(part) for part in zip(*truth, strict=True))
    np.testing.assert_allclose(found.mean, mean, rtol=1e-13)
    np.testing.assert_allclose(found.sd, sd, rtol=1e-13)
    assert_same(found.standardized, standardized, 1e-12)


@pytest.mark.parametrize("way", WAYS, ids=repr)
def test_derivatives_are_those_of_the_moments(way) -> None:
    ready = prepare(basis_of("hermite", "laguerre"), SCATTERED, 6, way)
    c = np.random.default_rng(5).standard_normal((3, len(SCATTERED)))
    exact = ready.moments_with_gradient(c)
    step = 1e-5
    for i in range(len(SCATTERED)):
        change = np.zeros_like(c)
        change[:, i] = step
        up, down = ready.moments(c + change), ready.moments(c - change)
        for name in ("mean", "sd", "standardized"):
            slope = (getattr(up, name) - getattr(down, name)) / (2.0 * step)
            jac = getattr(exact, f"{name}_jac")[..., i]
            np.testing.assert_allclose(slope, jac, rtol=1e-6, atol=1e-6 * np.abs(jac).max() + 1e-9)


# ------------------------------------------------------------------------------ rules

# ------------------------------------------------------------------------------ choice and misuse


def hermite(n: int, d: int) -> tuple[Basis, Indices]:
    return Basis.normal(n), np.array([k for k in product(range(d + 1), repeat=n) if sum(k) <= d])


def test_few_parameters_take_quadrature_and_many_take_galerkin() -> None:
    assert cheapest(*hermite(1, 8), 8) == ExactQuadrature()
    assert cheapest(*hermite(3, 3), 5) == ExactQuadrature()
    assert cheapest(*hermite(7, 2), 4) == Galerkin()


def test_what_fills_the_memory_is_refused() -> None:
    big = Basis.normal(16), np.vstack([np.zeros(16, dtype=int), np.eye(16, dtype=int)])
    assert cheapest(*big, 8) == Galerkin()
    with pytest.raises(InputsError, match=r"3.*nodes.*\n.*Galerkin"):
        prepare(*big, 8, ExactQuadrature())
    hopeless = Basis.normal(12), np.vstack([np.zeros(12), 5 * np.eye(12)])
    with pytest.raises(InputsError, match=r"Galerkin products to order 8.*\n.*lower the degree"):
        prepare(*hopeless, 8)


@pytest.mark.parametrize(
    ("indices", "message"),
    [
        ([[0, 0]], "shape"),
        ([[0], [-1]], "negative"),
        ([[0], [0.5]], "not whole"),
        ([[0], [1], [1]], "twice"),
        ([[1], [2]], "lack the constant"),
    ],
)
def test_wrong_multi_indices_are_named(indices, message) -> None:
    with pytest.raises(InputsError, match=message):
        prepare(Basis.normal(1), np.array(indices), 3)


def test_wrong_orders_and_coefficients_are_named() -> None:
    basis, indices = Basis.normal(1), np.array([[0], [3]])
    with pytest.raises(InputsError, match="order 1"):
        prepare(basis, indices, 1)
    with pytest.raises(InputsError, match=r"shape \(3,\) for 2 polynomials"):
        prepare(basis, indices, 3).moments(np.ones(3))


# ------------------------------------------------------------------------------ properties


@pytest.mark.parametrize("way", WAYS, ids=repr)
def test_an_expansion_without_scatter_has_none(way) -> None:
    c = np.array([[2.0, 0.0, 0.0, 0.0], [2.0, 1e-17, 0.0, 0.0]])
    found = prepare(Basis.normal(1), TOTAL[1], 4, way).moments_with_gradient(c)
    assert (found.mean.tolist(), found.sd.tolist()) == ([2.0, 2.0], [0.0, 0.0])
    assert found.standardized.tolist() == [[1.0, 0.0, 1.0, 0.0, 0.0]] * 2
    assert np.all(found.standardized_jac == 0.0)
