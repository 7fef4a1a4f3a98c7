"""Expansions: sets of terms, known coefficients, designs, regression, Sobol' indices."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from expansions import EVERY_WAY, MIXED, NORMAL, basis_of, box, fitted, miss
from hypothesis import given, settings
from hypothesis import strategies as st

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Constant, Uniform
from aleator.moments.expansion import (
    Basis,
    Expanding,
    Expansion,
    Hyperbolic,
    IndexSet,
    SobolIndices,
    TotalDegree,
    induced,
    sobol_indices,
)
from aleator.moments.projection import Projection, Regression, nested_fits


def rows(indices: np.ndarray) -> set[tuple[int, ...]]:
    found = {tuple(row) for row in indices.tolist()}
    assert len(found) == len(indices)
    return found


@pytest.mark.parametrize(("n", "degree"), [(1, 5), (2, 4), (3, 3), (4, 2)])
def test_the_total_degree_set_has_the_size_of_the_paper(n, degree) -> None:
    indices = TotalDegree(degree).indices((None,) * n)
    assert len(rows(indices)) == math.comb(n + degree, degree)
    assert indices.sum(axis=1).max() == degree
    assert indices[0].tolist() == [0] * n
    assert np.all(np.diff(indices.sum(axis=1)) >= 0)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 6),
    st.floats(0.2, 1.0),
    st.lists(st.one_of(st.none(), st.integers(0, 4)), min_size=1, max_size=4),
)
def test_every_set_is_what_its_definition_says(degree, norm, limits) -> None:
    n = len(limits)
    tops = [degree if limit is None else min(limit, degree) for limit in limits]
    full = list(product(*(range(top + 1) for top in tops)))
    near = 1e-9 * degree

    def chosen(choice: IndexSet, measure) -> None:
        found = rows(choice.indices(limits))
        assert {k for k in full if measure(k) < degree - near} <= found
        assert found <= {k for k in full if measure(k) <= degree + 10 * near + 1e-12}
        for k in found:
            below = {(*k[:i], k[i] - 1, *k[i + 1 :]) for i in range(n) if k[i]}
            assert below <= found

    chosen(TotalDegree(degree), sum)
    chosen(Hyperbolic(degree, norm), lambda k: sum(e**norm for e in k) ** (1.0 / norm))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: TotalDegree(-1), "negative"),
        (lambda: Hyperbolic(3, 0.0), "norm"),
        (lambda: Hyperbolic(3, 1.5), "norm"),
        (lambda: TotalDegree(30).indices((None,) * 20), "more than"),
    ],
)
def test_misuse_of_a_set_is_told(make, words) -> None:
    with pytest.raises(InputsError, match=words):
        make()


# ------------------------------------------------------------------------------ the basis


def test_products_of_polynomials_are_orthonormal_under_the_joint_law() -> None:
    indices = TotalDegree(4).indices(MIXED.limits)
    nodes = Projection(TotalDegree(4)).design(MIXED)
    psi = MIXED.evaluate(nodes.t, indices)
    np.testing.assert_allclose((psi.T * nodes.weights) @ psi, np.eye(len(indices)), atol=1e-10)
    assert np.all(indices[:, 3] == 0)


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
    projected = isinstance(way, Projection)  # without a leave-one-out error
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


# ------------------------------------------------------------------------------ projection


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
        (lambda: induced(MIXED, TotalDegree(40).indices((None, 0, 0, 0)), 90, 0), "degree 40"),
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


# ------------------------------------------------------------------------------ designs


def test_induced_points_have_the_induced_density_and_undo_it_by_weights() -> None:
    indices = TotalDegree(4).indices(MIXED.limits)
    design = induced(MIXED, indices, 4096, seed=1)
    # E f = sum w f for the law, and P^-1 sum_k E psi_k^2 f for the unweighted average
    fine = Projection(TotalDegree(11)).design(MIXED)
    density = np.mean(MIXED.evaluate(fine.t, indices) ** 2, axis=1)
    for f in (lambda t: t[:, 0] ** 2, lambda t: t[:, 1] * t[:, 2], lambda t: np.cos(t[:, 0])):
        law, mixture = fine.weights @ f(fine.t), (fine.weights * density) @ f(fine.t)
        assert design.weights @ f(design.t) == pytest.approx(law, abs=0.03)
        assert np.mean(f(design.t)) == pytest.approx(mixture, abs=0.03)


# ------------------------------------------------------------------------------ regression


def test_the_closed_form_of_leave_one_out_is_that_of_leaving_one_out() -> None:
    rng = np.random.default_rng(5)
    psi, weights = rng.normal(size=(17, 6)), rng.uniform(0.5, 2.0, 17)
    outcomes = rng.normal(size=(3, 17))
    fits = nested_fits(psi, weights, outcomes, (2, 4, 6))
    share = weights / weights.sum()
    for e, end in enumerate(fits.ends):
        error = np.zeros(3)
        for j in range(17):
            rest = np.arange(17) != j
            root = np.sqrt(share[rest])[:, None]
            fit = np.linalg.lstsq(root * psi[rest, :end], root * outcomes[:, rest].T)[0]
            error += share[j] * (outcomes[:, j] - psi[j, :end] @ fit) ** 2
        np.testing.assert_allclose(fits.leave_one_out[e], error, rtol=1e-10)
        gram = (psi[:, :end].T * share) @ psi[:, :end]
        factor = 17 / (17 - end) * (1.0 + np.trace(np.linalg.inv(gram)) / 17)
        np.testing.assert_allclose(fits.corrected[e], error * factor, rtol=1e-10)
        whole = np.linalg.lstsq(
            np.sqrt(share)[:, None] * psi[:, :end], (np.sqrt(share) * outcomes).T
        )[0]
        np.testing.assert_allclose(fits.coefficients(end, np.arange(3)), whole, rtol=1e-10)


def test_terms_that_the_points_do_not_determine_have_an_infinite_error() -> None:
    psi = np.stack([np.ones(6), np.arange(6.0), np.arange(6.0)], axis=1)
    fits = nested_fits(psi, np.ones(6), np.arange(6.0)[None] ** 2, (2, 3))
    assert np.isfinite(fits.corrected[0]).all()
    assert np.isinf(fits.corrected[1]).all()


def test_the_leave_one_out_error_tells_the_true_error() -> None:
    # borehole flow (Harper and Gupta 1983), all eight parameters uniform
    limits = [
        (0.05, 0.15), (100, 50_000), (63_070, 115_600), (990, 1110),
        (63.1, 116), (700, 820), (1120, 1680), (9855, 12_045),
    ]  # fmt: skip
    found = fitted(Regression(TotalDegree(3)), basis_of(*[box(*ends) for ends in limits]), borehole)
    truth = miss(found, borehole)
    assert truth < 1e-4
    assert found.unexplained[0] == pytest.approx(truth, rel=0.5)


def borehole(x: Array) -> Array:
    radius, reach, upper, head_upper, lower, head_lower, length, conductivity = x.T
    log = np.log(reach / radius)
    leak = 2.0 * length * upper / (log * radius**2 * conductivity)
    return 2.0 * np.pi * upper * (head_upper - head_lower) / (log * (1.0 + leak + upper / lower))


def cube(n: int, lower: float, upper: float) -> Basis:
    law = Uniform.between(lower, upper)
    return Basis((law,) * n, (np.array([h.start for h in law.hyperparameters]),) * n)


def of(basis: Basis, way: Regression, *functions) -> SobolIndices:
    design = way.design(basis)
    found = way.fit(basis, design, np.stack([function(design.x) for function in functions]))
    return sobol_indices(found.indices, found.coefficients)


def ishigami(x: Array, a: float, b: float) -> Array:
    return np.asarray(np.sin(x[:, 0]) * (1.0 + b * x[:, 2] ** 4) + a * np.sin(x[:, 1]) ** 2)


def test_ishigami() -> None:
    """Ishigami and Homma 1990: V1 = (1 + b pi^4/5)^2/2, V2 = a^2/8, V13 = 8 b^2 pi^8/225."""
    pairs = [(7.0, 0.1), (7.0, 0.05), (1.0, 0.2)]  # three experiments at once
    functions = [lambda x, a=a, b=b: ishigami(x, a, b) for a, b in pairs]
    found = of(cube(3, -np.pi, np.pi), Regression(TotalDegree(12)), *functions)
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
