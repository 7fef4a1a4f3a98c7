"""Expansions against polynomials with known coefficients, second algorithms, and true errors."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.expansion import (
    Basis,
    Design,
    Expanding,
    Expansion,
    Projection,
    Regression,
    Sparse,
    SparseProjection,
)
from aleator.expansion.design import FINE, drawn, induced
from aleator.expansion.least_squares import nested_fits
from aleator.expansion.projection import project
from aleator.expansion.sparse_projection import combination
from aleator.indices import Anisotropic, Hyperbolic, TotalDegree
from aleator.inputs import Inputs
from aleator.laws import (
    Beta,
    Constant,
    Free,
    Gamma,
    Law,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
)

Array = NDArray[np.float64]


def basis_of(*laws: tuple[Law, tuple[float, ...]]) -> Basis:
    return Basis(tuple(law for law, _ in laws), tuple(np.array(values) for _, values in laws))


def box(lower: float, upper: float) -> tuple[Law, tuple[float, ...]]:
    law = Uniform.between(lower, upper)
    return law, tuple(h.start for h in law.hyperparameters)


NORMAL = (Normal(0.0, 1.0), (0.0, 1.0))
MIXED = basis_of(
    (Normal(1.0, 2.0), (1.0, 2.0)),
    (TruncatedNormal((0.0, 3.0), 0.5, 1.0), (0.5, 1.0)),
    (TruncatedNormal((-1.0, 1.0), 0.2, 0.7, "hermite"), (0.2, 0.7)),
    (Constant(4.0), (4.0,)),
)
EVERY_WAY = [
    Projection(TotalDegree(3)),
    SparseProjection(TotalDegree(3)),
    SparseProjection(Hyperbolic(4, 0.6)),
    SparseProjection(Anisotropic(3, (1.0, 1.5, 1.0, 1.0))),
    Regression(TotalDegree(3)),
    Regression(TotalDegree(3), adaptive=False),
    Regression(Hyperbolic(4, 0.6)),
    Sparse(TotalDegree(3), runs=80),
]


def fitted(way: Expanding, basis: Basis, *functions: Callable[[Array], Array]) -> Expansion:
    design = way.design(basis)
    return way.fit(basis, design, np.stack([function(design.x) for function in functions]))


def miss(expansion: Expansion, function: Callable[[Array], Array], runs: int = 4096) -> float:
    """The true share of variance that the expansion of the first experiment misses."""
    points = drawn(expansion.basis, runs, seed=99)
    truth = function(points.x)
    return float(np.mean((expansion.evaluate(points.germ)[0] - truth) ** 2) / truth.var())


# ------------------------------------------------------------------------------ the basis


def test_products_of_polynomials_are_orthonormal_under_the_joint_law() -> None:
    indices = TotalDegree(4).indices(MIXED.limits)
    nodes = Projection(TotalDegree(4)).design(MIXED)
    psi = MIXED.evaluate(nodes.germ, indices)
    np.testing.assert_allclose((psi.T * nodes.weights) @ psi, np.eye(len(indices)), atol=1e-10)
    assert np.all(indices[:, 3] == 0)


def test_the_basis_of_inputs_is_that_of_its_laws() -> None:
    inputs = Inputs({"v": Normal(Free(-1, 1), 0.5), "c": Constant(2.0)})
    basis = Basis.of(inputs, np.array([0.3, 0.5, 2.0]))
    assert basis.limits == (None, 0)
    assert basis.rule(0, 1).x.tolist() == [0.3]
    assert basis.rule(1, 5).x.tolist() == [2.0]
    tied = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.5})
    with pytest.raises(InputsError, match="a, b are correlated"):
        Basis.of(tied, np.array([0.0, 1.0, 0.0, 1.0, 0.5]))


# ------------------------------------------------------------------------------ every way


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(EVERY_WAY))
def test_every_way_finds_any_polynomial_in_its_terms(seed: int, way: Expanding) -> None:
    indices = way.terms.indices(MIXED.limits)  # type: ignore[attr-defined]
    truth = np.random.default_rng(seed).normal(size=(3, len(indices)))
    design = way.design(MIXED)
    found = way.fit(MIXED, design, truth @ MIXED.evaluate(design.germ, indices).T)
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
    np.testing.assert_allclose(design.x[:, 0], 1.0 + 2.0 * design.germ[:, 0])
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
    psi = basis.evaluate(design.germ, indices)
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
    psi = basis.evaluate(design.germ, indices)
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


# ------------------------------------------------------------------------------ designs


def test_points_of_the_law_have_its_moments() -> None:
    design = drawn(MIXED, 2048, seed=3)
    fine = Projection(TotalDegree(7)).design(MIXED)
    for power in (1, 2):
        expected = fine.weights @ fine.x[:, :3] ** power
        np.testing.assert_allclose(design.weights @ design.x[:, :3] ** power, expected, rtol=5e-3)


def test_induced_points_have_the_induced_density_and_undo_it_by_weights() -> None:
    indices = TotalDegree(4).indices(MIXED.limits)
    design = induced(MIXED, indices, 4096, seed=1)
    # E f = sum w f for the law, and P^-1 sum_k E psi_k^2 f for the unweighted average
    fine = Projection(TotalDegree(11)).design(MIXED)
    density = np.mean(MIXED.evaluate(fine.germ, indices) ** 2, axis=1)
    for f in (lambda t: t[:, 0] ** 2, lambda t: t[:, 1] * t[:, 2], lambda t: np.cos(t[:, 0])):
        law, mixture = fine.weights @ f(fine.germ), (fine.weights * density) @ f(fine.germ)
        assert design.weights @ f(design.germ) == pytest.approx(law, abs=0.03)
        assert np.mean(f(design.germ)) == pytest.approx(mixture, abs=0.03)


@pytest.mark.parametrize(
    "make", [drawn, lambda b, j, s: induced(b, np.eye(4, dtype=int)[:3], j, s)]
)
def test_a_short_design_begins_a_long_one(make: Callable[[Basis, int, int], Design]) -> None:
    short, long = make(MIXED, 50, 7), make(MIXED, 400, 7)
    assert np.array_equal(short.x, long.x[:50])
    assert not np.array_equal(make(MIXED, 50, 8).x, short.x)


@pytest.mark.parametrize("law", [NORMAL, box(-1.0, 1.0)])
@pytest.mark.parametrize(("n", "degree"), [(1, 10), (2, 8), (4, 5), (10, 2)])
def test_twice_as_many_runs_as_terms_are_well_conditioned(
    law: tuple[Law, tuple[float, ...]], n: int, degree: int
) -> None:
    basis = basis_of(*[law] * n)
    indices = TotalDegree(degree).indices(basis.limits)
    design = induced(basis, indices, 2 * len(indices), seed=0)
    psi = np.sqrt(design.weights)[:, None] * basis.evaluate(design.germ, indices)
    assert np.linalg.cond(psi) < 12.0


@pytest.mark.parametrize(
    "law",
    [
        Beta((0.0, 2.0), 0.6, 0.3),
        Beta((0.0, 1.0), 0.2, 0.3),  # infinite density at both ends
        Gamma(1.0, 1.0),
        LogNormal(1.0, 0.5),
        TruncatedNormal((0.0, 1.0), 0.0, 0.2),
        Uniform.between(0.0, 1.0),
    ],
)
def test_every_law_serves_an_expansion(law: Law) -> None:
    values = tuple(h.start for h in law.hyperparameters)
    basis = basis_of((law, values), NORMAL)
    found = fitted(
        Regression(TotalDegree(6)), basis, lambda x: x[:, 0] + x[:, 0] * x[:, 1], lambda x: x[:, 1]
    )
    about = law.mean_and_sd(np.array(values))
    if not isinstance(law, LogNormal):  # x is a polynomial of the germ
        assert found.mean[0] == pytest.approx(about.mean, abs=1e-8)
        assert found.variance[0] == pytest.approx(2.0 * about.sd**2 + about.mean**2, rel=1e-7)
    else:
        assert found.mean[0] == pytest.approx(about.mean, rel=1e-3)
        assert found.variance[0] == pytest.approx(2.0 * about.sd**2 + about.mean**2, rel=1e-2)
    assert found.variance[1] == pytest.approx(1.0)


def test_runs_of_the_law_itself_are_not_where_the_law_is_normal() -> None:
    basis = basis_of(NORMAL, NORMAL)
    indices = TotalDegree(8).indices(basis.limits)
    psi = basis.evaluate(drawn(basis, 90, seed=0).germ, indices)
    assert np.linalg.cond(psi) > 1e3


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


def ten(x: Array) -> Array:
    """Ten parameters: an exponential of all, an interaction, a cubic interaction."""
    return np.exp(0.5 * x @ (1.0 / np.arange(1, 11))) + x[:, 0] * x[:, 1] + x[:, 2] ** 2 * x[:, 9]


@pytest.mark.parametrize(
    "way", [Regression(TotalDegree(3), runs=1000), SparseProjection(TotalDegree(3))]
)
def test_ten_parameters_take_less_than_two_thousand_runs(way: Expanding) -> None:
    basis = basis_of(*[box(-1.0, 1.0)] * 10)
    assert len(way.design(basis)) < 2000
    assert miss(fitted(way, basis, ten), ten) < 2e-5


def test_each_experiment_takes_the_degree_that_its_outcome_needs() -> None:
    basis = basis_of(box(-1.0, 1.0), box(-1.0, 1.0))
    rng = np.random.default_rng(1)
    way = Regression(TotalDegree(9), runs=80)
    design = way.design(basis)
    noisy = design.x[:, 0] + 0.5 * rng.normal(size=80)
    smooth = np.exp(design.x[:, 0] * design.x[:, 1])
    found = way.fit(basis, design, np.stack([noisy, smooth]))
    degrees = [found.indices[row != 0.0].sum(axis=1).max() for row in found.coefficients]
    assert degrees[0] <= 2
    assert degrees[1] >= 6
    fixed = Regression(TotalDegree(9), runs=80, adaptive=False).fit(basis, design, noisy[None])
    assert fixed.leave_one_out[0] > found.leave_one_out[0]


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Projection(TotalDegree(3), nodes=3), "3 nodes do not determine"),
        (lambda: Regression(TotalDegree(3), runs=0), "0 runs"),
        (lambda: Sparse(TotalDegree(3), runs=1), "too few"),
        (lambda: drawn(MIXED, 0, 0), "0 runs"),
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
    with pytest.raises(InputsError, match="2 outcomes are not finite"):
        way.fit(MIXED, design, np.where(np.arange(len(design)) < 2, np.nan, 1.0)[None])


def test_a_fixed_degree_needs_its_runs() -> None:
    way = Regression(TotalDegree(4), runs=10, adaptive=False)
    with pytest.raises(InputsError, match="10 runs do not determine 35 coefficients"):
        fitted(way, MIXED, lambda x: x[:, 0])
