"""Expansions against polynomials with known coefficients, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from expansions import EVERY_WAY, MIXED, NORMAL, basis_of, fitted
from hypothesis import given, settings
from hypothesis import strategies as st

from aleator.errors import InputsError
from aleator.laws import (
    Constant,
    Free,
    Normal,
)
from aleator.laws.inputs import Inputs
from aleator.moments.expansion import (
    Basis,
    Expanding,
    Expansion,
    Projection,
    Regression,
    SparseProjection,
)
from aleator.moments.expansion.design import FINE, induced
from aleator.moments.expansion.indices import Hyperbolic, TotalDegree
from aleator.moments.expansion.projection import project
from aleator.moments.expansion.sparse_projection import combination

# ------------------------------------------------------------------------------ the basis


def test_products_of_polynomials_are_orthonormal_under_the_joint_law() -> None:
    indices = TotalDegree(4).indices(MIXED.limits)
    nodes = Projection(TotalDegree(4)).design(MIXED)
    psi = MIXED.evaluate(nodes.t, indices)
    np.testing.assert_allclose((psi.T * nodes.weights) @ psi, np.eye(len(indices)), atol=1e-10)
    assert np.all(indices[:, 3] == 0)


def test_the_basis_of_inputs_is_that_of_its_laws() -> None:
    inputs = Inputs({"v": Normal(Free(-1, 1), 0.5), "c": Constant(2.0)})
    basis = Basis.of(inputs, np.array([0.3, 0.5, 2.0]))
    assert basis.limits == (None, 0)
    assert basis.rule(0, 1).x.tolist() == [0.3]
    assert basis.rule(1, 5).x.tolist() == [2.0]
    tied = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.5})
    # correlated parameters are expanded in the standard normal variates that they are made of
    basis = Basis.of(tied, np.array([3.0, 2.0, 0.0, 1.0, 0.5]))
    assert [basis.rule(i, 1).x.tolist() for i in (0, 1)] == [[0.0], [0.0]]


# ------------------------------------------------------------------------------ every way


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(EVERY_WAY))
def test_every_way_finds_any_polynomial_in_its_terms(seed: int, way: Expanding) -> None:
    indices = way.terms.indices(MIXED.limits)  # type: ignore[attr-defined]
    truth = np.random.default_rng(seed).normal(size=(3, len(indices)))
    design = way.design(MIXED)
    found = way.fit(MIXED, design, truth @ MIXED.evaluate(design.t, indices).T)
    known = {tuple(k): c for k, c in zip(indices.tolist(), truth.T, strict=True)}
    for k, coefficients in zip(found.indices.tolist(), found.coefficients.T, strict=True):
        np.testing.assert_allclose(coefficients, known.pop(tuple(k)), atol=1e-7)
    assert not known
    np.testing.assert_allclose(found.mean, truth[:, 0], atol=1e-8)
    np.testing.assert_allclose(found.variance, np.sum(truth[:, 1:] ** 2, axis=1), rtol=1e-7)


@pytest.mark.parametrize("way", EVERY_WAY)
def test_an_outcome_that_does_not_vary_is_a_constant(way: Expanding) -> None:
    found = fitted(way, MIXED, lambda x: np.full(len(x), 5.0), lambda x: np.zeros(len(x)))
    np.testing.assert_allclose(found.mean, [5.0, 0.0], atol=1e-13)
    np.testing.assert_allclose(found.variance, 0.0, atol=1e-24)
    projected = isinstance(way, Projection | SparseProjection)  # without a leave-one-out error
    assert np.all(np.isnan(found.unexplained) if projected else found.unexplained == 0.0)


@pytest.mark.parametrize("way", EVERY_WAY)
def test_the_points_belong_to_the_law_and_the_constant_is_no_parameter(way: Expanding) -> None:
    design = way.design(MIXED)
    assert np.all(design.x[:, 3] == 4.0)
    assert np.all((design.x[:, 1] >= 0.0) & (design.x[:, 1] <= 3.0))
    # x = 1 + 2 theta for the normal law
    np.testing.assert_allclose(design.x[:, 0], 1.0 + 2.0 * design.t[:, 0])
    with pytest.raises(ValueError, match="read-only"):
        design.x[0] = 0.0


def test_values_of_an_expansion_cannot_be_changed() -> None:
    found = fitted(Regression(TotalDegree(1)), basis_of(NORMAL), lambda x: x[:, 0])
    with pytest.raises(ValueError, match="read-only"):
        found.coefficients[0] = 0.0


# ------------------------------------------------------------------------------ projection


def test_direct_projection_on_a_sparse_grid_aliases_and_the_pseudo_spectral_does_not() -> None:
    basis = basis_of(NORMAL, NORMAL)
    way = SparseProjection(Hyperbolic(6))
    design, indices = way.design(basis), way.terms.indices(basis.limits)
    psi = basis.evaluate(design.t, indices)
    # each polynomial of the set in turn is the outcome: the matrix of coefficients is the identity
    right = np.eye(len(indices))
    np.testing.assert_allclose(way.fit(basis, design, psi.T).coefficients, right, atol=1e-10)
    wrong = np.abs(project(basis, indices, design, psi.T).coefficients - right)
    assert wrong[0].max() < 1e-12  # the mean is right
    assert wrong.max() > 0.8  # other coefficients are wrong by nearly the whole polynomial


def test_of_the_total_degree_the_direct_projection_does_not_alias() -> None:
    # level L with l + 1 nodes integrates total degree 2 L + 1, which every product stays below
    basis = basis_of(NORMAL, NORMAL)
    way = SparseProjection(TotalDegree(4))
    design, indices = way.design(basis), way.terms.indices(basis.limits)
    psi = basis.evaluate(design.t, indices)
    direct = project(basis, indices, design, psi.T).coefficients
    np.testing.assert_allclose(direct, np.eye(15), atol=1e-12)


def test_the_sparse_grid_integrates_as_its_exactness_says() -> None:
    basis = basis_of(NORMAL, NORMAL, NORMAL)
    design = SparseProjection(TotalDegree(4)).design(basis)
    assert design.weights.sum() == pytest.approx(1.0)
    assert np.any(design.weights < 0.0)
    # level 4 with l + 1 nodes integrates total degree 2 * 4 + 1: E x^4 y^2 z^2 = 3
    value = design.weights @ (design.x[:, 0] ** 4 * design.x[:, 1] ** 2 * design.x[:, 2] ** 2)
    assert value == pytest.approx(3.0)


def test_signs_of_the_combination_are_those_of_the_formula() -> None:
    level, n = 4, 3
    indices = TotalDegree(level).indices((None,) * n)
    below = level - indices.sum(axis=1)
    expected = [(-1) ** b * math.comb(n - 1, b) if b < n else 0 for b in below.tolist()]
    assert combination(indices).tolist() == expected


def test_projection_converges_at_the_rate_of_the_coefficients() -> None:
    # exp(s x), x standard normal: c_k = exp(s^2/2) s^k / sqrt(k!), a closed form
    basis, s = basis_of(NORMAL), 0.6
    exact = np.array([np.exp(s**2 / 2) * s**k / math.sqrt(math.factorial(k)) for k in range(25)])
    for degree in (3, 6, 9):
        way = Projection(TotalDegree(degree))
        found = fitted(way, basis, lambda x: np.exp(s * x[:, 0]))
        error = np.abs(found.coefficients[0] - exact[: degree + 1])
        # q = degree + 1 nodes: c_k takes up c_(2q - k) and higher ones
        assert error.max() < 5.0 * exact[degree + 2]
        assert error[0] < 5.0 * exact[2 * degree + 2] * math.sqrt(math.factorial(degree + 1))


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Projection(TotalDegree(3), nodes=3), "3 nodes"),
        (lambda: Regression(TotalDegree(3), runs=0), "0 runs"),
        (lambda: induced(MIXED, TotalDegree(1).indices(MIXED.limits), 0, 0), "0 runs"),
        (lambda: induced(MIXED, TotalDegree(FINE).indices((None, 0, 0, 0)), 90, 0), "degree 40"),
        (lambda: Basis((), ()), "0 laws"),
        (lambda: Basis((Constant(1.0),), ()), "1 laws but 0"),
        (
            lambda: Expansion(MIXED, np.zeros((1, 4), dtype=int), np.ones((2, 2)), np.ones(2)),
            "2 experiments and 1 multi-indices",
        ),
    ],
)
def test_misuse_is_told(make: Callable[[], object], words: str) -> None:
    with pytest.raises(InputsError, match=words):
        make()


@pytest.mark.parametrize("way", EVERY_WAY)
def test_outcomes_that_do_not_fit_the_design_are_refused(way: Expanding) -> None:
    design = way.design(MIXED)
    for outcomes in (np.ones(len(design)), np.ones((2, len(design) + 1))):
        with pytest.raises(InputsError, match="outcomes of shape"):
            way.fit(MIXED, design, outcomes)
    with pytest.raises(InputsError, match="2 outcomes"):
        way.fit(MIXED, design, np.where(np.arange(len(design)) < 2, np.nan, 1.0)[None])


def test_a_fixed_degree_needs_its_runs() -> None:
    way = Regression(TotalDegree(4), runs=10, adaptive=False)
    with pytest.raises(InputsError, match=r"10 runs.*35 coefficients"):
        fitted(way, MIXED, lambda x: x[:, 0])
