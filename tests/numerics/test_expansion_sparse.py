"""Sparse regression finds the few terms that there are, and says what it needs."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from aleator.errors import AleatorError
from aleator.expansion import Basis, Regression, Sparse
from aleator.expansion.design import drawn
from aleator.laws import Uniform
from aleator.polynomials.indices import Hyperbolic, TotalDegree


def cube(n: int) -> Basis:
    """n parameters, uniform on [-1, 1]."""
    law = Uniform.between(-1.0, 1.0)
    values = np.array([h.start for h in law.hyperparameters])
    return Basis((law,) * n, (values,) * n)


@pytest.mark.parametrize("seed", range(4))
def test_few_terms_among_a_thousand_are_found_from_few_runs(seed: int) -> None:
    basis = cube(10)
    indices = TotalDegree(4).indices(basis.limits)  # 1,001 terms
    rng = np.random.default_rng(seed)
    support = rng.choice(len(indices), size=(2, 8), replace=False)
    truth = np.zeros((2, len(indices)))
    for row, terms in zip(truth, support, strict=True):
        row[terms] = rng.uniform(0.5, 2.0, 8) * rng.choice([-1.0, 1.0], 8)
    way = Sparse(TotalDegree(4), runs=120, seed=seed)
    design = way.design(basis)
    found = way.fit(basis, design, truth @ basis.evaluate(design.germ, indices).T)
    place = {tuple(k): p for p, k in enumerate(indices.tolist())}
    dense = np.zeros_like(truth)
    dense[:, [place[tuple(k)] for k in found.indices.tolist()]] = found.coefficients
    np.testing.assert_allclose(dense, truth, atol=1e-9)
    assert found.leave_one_out.max() < 1e-8


def test_the_corrected_error_does_not_flatter() -> None:
    basis = cube(10)

    def ten(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(0.5 * x @ (1.0 / np.arange(1, 11))) + x[:, 0] * x[:, 1])

    way = Sparse(TotalDegree(3), runs=200)
    design = way.design(basis)
    found = way.fit(basis, design, ten(design.x)[None])
    points = drawn(basis, 8192, seed=5)
    truth = ten(points.x)
    missed = np.mean((found.evaluate(points.germ)[0] - truth) ** 2) / truth.var()
    assert missed < 2e-3
    assert 0.7 * missed < found.unexplained[0] < 5.0 * missed


def test_fewer_runs_than_terms_of_degree_two_still_find_an_interaction() -> None:
    basis = cube(10)
    design = Sparse(TotalDegree(2), runs=60).design(basis)  # 66 terms
    outcome = (design.x[:, 0] + design.x[:, 3] * design.x[:, 8])[None]
    sparse = Sparse(TotalDegree(2), runs=60).fit(basis, design, outcome)
    plain = Regression(TotalDegree(2)).fit(basis, design, outcome)  # degree 1 is what it can do
    assert sparse.variance[0] == pytest.approx(1.0 / 3.0 + 1.0 / 9.0)
    assert sparse.unexplained[0] < 1e-12
    assert plain.unexplained[0] > 0.2


def test_noise_without_effect_selects_next_to_nothing() -> None:
    basis = cube(6)
    way = Sparse(Hyperbolic(5, 0.6), runs=100)
    design = way.design(basis)
    noise = np.random.default_rng(0).normal(size=(20, 100))
    found = way.fit(basis, design, noise)
    chosen = np.sum(found.coefficients[:, 1:] != 0.0, axis=1)
    assert np.median(chosen) <= 5  # of 75 candidates
    assert np.all(found.unexplained > 0.5)


def test_without_scikit_learn_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.linear_model", None)
    basis, way = cube(2), Sparse(TotalDegree(2), runs=20)
    design = way.design(basis)
    with pytest.raises(AleatorError, match=r"pip install 'aleator\[sparse\]'"):
        way.fit(basis, design, design.x.T)
    plain = Regression(TotalDegree(2), runs=20)
    found = plain.fit(basis, design, design.x[:, :1].T)
    np.testing.assert_allclose(found.variance, 1.0 / 3.0)
