"""The best weights of given points meet other methods and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from aleator.inference.npmle import mixed

CASES = [(30, 12, 0.5), (108, 400, 0.3), (60, 400, 0.02), (400, 200, 1.0)]


def log_density(count: int, points: int, sd: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y = rng.choice([-1.0, 0.3, 2.0], count) + rng.normal(0.0, 0.2 + sd, count)
    x = np.linspace(-4.0, 5.0, points)
    return stats.norm.logpdf(y[:, None], x, sd)


def by_em(matrix: np.ndarray, rounds: int) -> np.ndarray:
    """The weights after many steps of expectation and maximization."""
    density = np.exp(matrix - matrix.max(axis=1, keepdims=True))
    weights = np.full(matrix.shape[1], 1.0 / matrix.shape[1])
    for _ in range(rounds):
        weights = weights * ((1.0 / (density @ weights)) @ density) / len(density)
    return weights


def value(matrix: np.ndarray, weights: np.ndarray) -> float:
    top = matrix.max(axis=1)
    return float((top + np.log(np.exp(matrix - top[:, None]) @ weights)).sum())


@pytest.mark.parametrize("case", CASES, ids=str)
def test_it_is_certified_and_above_a_long_run_of_em(case: tuple[int, int, float]) -> None:
    matrix = log_density(*case)
    found = mixed(matrix)
    assert found.gap < 1e-4
    assert found.weights.min() >= 0.0
    assert found.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert value(matrix, found.weights) == pytest.approx(found.log_likelihood, abs=1e-9)
    em = value(matrix, by_em(matrix, 3000))
    assert em - 1e-9 <= found.log_likelihood
    assert found.log_likelihood == pytest.approx(em, abs=0.1)


def test_a_general_maximizer_finds_the_same() -> None:
    matrix = log_density(30, 12, 0.5)
    found = mixed(matrix)
    end = optimize.minimize(
        lambda w: -value(matrix, w),
        np.full(12, 1.0 / 12.0),
        method="SLSQP",
        bounds=[(0.0, 1.0)] * 12,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1.0},
        options={"ftol": 1e-12, "maxiter": 1000},
    )
    assert found.log_likelihood == pytest.approx(-end.fun, abs=1e-6)
    assert found.weights == pytest.approx(end.x, abs=1e-3)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_no_gap_is_too_small(case: tuple[int, int, float]) -> None:
    matrix = log_density(*case)
    best = mixed(matrix).log_likelihood
    for tolerance in (1.0, 0.1, 1e-3):
        rough = mixed(matrix, tolerance)
        assert rough.log_likelihood <= best + 1e-9
        assert best <= rough.log_likelihood + rough.gap + 1e-9


def test_one_experiment_takes_its_likeliest_point() -> None:
    found = mixed(np.array([[-3.0, -1.0, -2.0]]))
    assert found.weights.tolist() == [0.0, 1.0, 0.0]
    assert found.log_likelihood == -1.0


def test_experiments_far_apart_have_a_point_each_with_their_share() -> None:
    place = np.array([0, 0, 0, 1, 1, 2])
    matrix = np.where(place[:, None] == np.arange(3), 0.0, -900.0)
    found = mixed(matrix)
    assert found.weights == pytest.approx([3 / 6, 2 / 6, 1 / 6], abs=1e-8)
    shares = np.array([3, 3, 3, 2, 2, 1]) / 6.0
    assert found.log_likelihood == pytest.approx(np.log(shares).sum(), abs=1e-9)


def test_units_order_and_copies_change_nothing() -> None:
    matrix = log_density(60, 100, 0.3)
    found = mixed(matrix)
    rng = np.random.default_rng(1)
    shift, rows, columns = rng.normal(0.0, 50.0, 60), rng.permutation(60), rng.permutation(100)
    other = mixed((matrix + shift[:, None])[rows][:, columns])
    assert other.log_likelihood - shift.sum() == pytest.approx(found.log_likelihood, abs=1e-5)
    assert mixed(np.hstack([matrix, matrix])).log_likelihood == pytest.approx(
        found.log_likelihood, abs=1e-5
    )
    twice = mixed(np.vstack([matrix, matrix]))
    assert twice.log_likelihood == pytest.approx(2.0 * found.log_likelihood, abs=1e-4)


def test_an_experiment_that_nothing_explains_is_told_and_leaves_the_others_alone() -> None:
    matrix = log_density(30, 50, 0.3)
    found = mixed(np.vstack([matrix, np.full(50, -np.inf)]))
    assert found.each[-1] == -np.inf
    assert found.weights == pytest.approx(mixed(matrix).weights)


@pytest.mark.parametrize("nothing", [np.nan, -np.inf])
def test_where_nothing_is_explained_that_is_told(nothing: float) -> None:
    found = mixed(np.full((3, 4), nothing))
    assert found.log_likelihood == -np.inf
    assert found.weights.sum() == pytest.approx(1.0)
