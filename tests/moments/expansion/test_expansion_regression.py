"""Designs of runs, and regression on them: second algorithms, and true errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from expansions import MIXED, NORMAL, basis_of, box, drawn, fitted, miss

from aleator.laws import (
    Beta,
    Gamma,
    Law,
    LogNormal,
    TruncatedNormal,
    Uniform,
)
from aleator.moments.expansion import (
    Basis,
    Design,
    Expanding,
    Projection,
    Regression,
    SparseProjection,
)
from aleator.moments.expansion.design import induced
from aleator.moments.expansion.indices import TotalDegree
from aleator.moments.expansion.least_squares import nested_fits
from aleator.types import Array

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
    density = np.mean(MIXED.evaluate(fine.t, indices) ** 2, axis=1)
    for f in (lambda t: t[:, 0] ** 2, lambda t: t[:, 1] * t[:, 2], lambda t: np.cos(t[:, 0])):
        law, mixture = fine.weights @ f(fine.t), (fine.weights * density) @ f(fine.t)
        assert design.weights @ f(design.t) == pytest.approx(law, abs=0.03)
        assert np.mean(f(design.t)) == pytest.approx(mixture, abs=0.03)


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
    psi = np.sqrt(design.weights)[:, None] * basis.evaluate(design.t, indices)
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
    if not isinstance(law, LogNormal):  # x is a polynomial of theta
        assert found.mean[0] == pytest.approx(about.mean, abs=1e-8)
        assert found.variance[0] == pytest.approx(2.0 * about.sd**2 + about.mean**2, rel=1e-7)
    else:
        assert found.mean[0] == pytest.approx(about.mean, rel=1e-3)
        assert found.variance[0] == pytest.approx(2.0 * about.sd**2 + about.mean**2, rel=1e-2)
    assert found.variance[1] == pytest.approx(1.0)


def test_runs_of_the_law_itself_are_not_where_the_law_is_normal() -> None:
    basis = basis_of(NORMAL, NORMAL)
    indices = TotalDegree(8).indices(basis.limits)
    psi = basis.evaluate(drawn(basis, 90, seed=0).t, indices)
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
