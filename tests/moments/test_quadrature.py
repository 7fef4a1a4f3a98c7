"""Nodes of the joint law: exactness and its end, orders of convergence, derivatives, misuse."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest
from problems import raw_normal, raw_truncated
from scipy import special

from aleator import Constant, Free, Inputs, Normal, TruncatedNormal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws.quadrature import (
    Cubature,
    MonteCarloPoints,
    ProbabilityGrid,
    Smolyak,
    SobolPoints,
    TensorGauss,
)

BOX = (-1.0, 1.0)
ALPHA = np.array([0.4, 0.3, -2.0, 0.8, 0.5, 0.1, 0.7])
"""x normal, c constant, w truncated normal on a box that binds, v normal."""
CHOICES = [
    TensorGauss(3),
    Smolyak(2),
    SobolPoints(32, seed=3),
    MonteCarloPoints(30, seed=3),
    ProbabilityGrid(3),
]


def mixed(correlation: float | Free | None = None) -> Inputs:
    return Inputs(
        {
            "x": Normal(Free(-1.0, 1.0), Free(0.05, 1.0)),
            "c": Constant(Free(-5.0, 5.0)),
            "w": TruncatedNormal(BOX, sd=Free(0.05, 2.0)),
            "v": Normal(Free(-1.0, 1.0), Free(0.05, 1.0)),
        },
        None if correlation is None else {("x", "w"): correlation},
    )


def standard_normals(n: int) -> tuple[Inputs, Array]:
    return Inputs({f"p{i}": Normal(0.0, 1.0) for i in range(n)}), np.tile([0.0, 1.0], n)


def raw(powers: tuple[int, int, int]) -> float:
    """E[x^i w^j v^k] in closed form."""
    x = raw_normal(ALPHA[0], ALPHA[1], powers[0])
    w = raw_truncated(ALPHA[3], ALPHA[4], BOX, powers[1])
    return float(x * w * raw_normal(ALPHA[5], ALPHA[6], powers[2]))


def mean(choice: Cubature, inputs: Inputs, alpha: Array, powers: tuple[int, ...]) -> float:
    nodes = choice.nodes(inputs, alpha)
    return float(nodes.weights @ np.prod(nodes.x ** np.array(powers), axis=1))


# ------------------------------------------------------------------------------ every choice


@pytest.mark.parametrize("correlation", [None, 0.0, -0.7], ids=["independent", "zero", "tied"])
@pytest.mark.parametrize("choice", CHOICES, ids=lambda c: type(c).__name__)
def test_the_derivative_of_any_weighted_sum_is_exact(
    choice: Cubature, correlation: float | None
) -> None:
    """However coarse the rule is, by every hyperparameter, correlations included."""
    inputs = mixed(None if correlation is None else Free(-1.0, 1.0))
    alpha = ALPHA if correlation is None else np.append(ALPHA, correlation)

    def outcome(x: Array) -> Array:
        return np.exp(0.5 * x[:, 0] * x[:, 2] - 0.1 * x[:, 1] * x[:, 3])

    def total(at: Array) -> float:
        nodes = choice.nodes(inputs, at)
        return float(nodes.weights @ outcome(nodes.x))

    nodes = choice.nodes(inputs, alpha)
    y, (x, c, w, v) = outcome(nodes.x), nodes.x.T
    slope = y[:, None] * np.stack([0.5 * w, -0.1 * v, 0.5 * x, -0.1 * c], axis=1)
    found = y @ nodes.dweights + np.einsum("j,jn,jnk->k", nodes.weights, slope, nodes.dx)
    for k in range(alpha.size):
        step = np.zeros_like(alpha)
        step[k] = 1e-3
        ends = [total(alpha + s * step) for s in (-2, -1, 1, 2)]
        expected = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / 12e-3
        # the own rule of a truncated law leaves 1e-9 in its derivatives
        assert found[k] == pytest.approx(expected, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("choice", CHOICES, ids=lambda c: type(c).__name__)
def test_where_nothing_scatters_one_node_is_left(choice: Cubature) -> None:
    inputs = Inputs({"a": Constant(Free(0.0, 1.0)), "b": Constant(2.0)})
    nodes = choice.nodes(inputs, np.array([0.5, 2.0]))
    assert nodes.x.tolist() == [[0.5, 2.0]]
    assert nodes.weights.tolist() == [1.0]
    assert nodes.dx.tolist() == [[[1.0, 0.0], [0.0, 1.0]]]


def test_tensor_gauss_is_exact_to_its_degree_in_each_parameter() -> None:
    for i, j, k in product(range(6), repeat=3):
        found = mean(TensorGauss(3), mixed(), ALPHA, (i, 0, j, k))
        assert found == pytest.approx(raw((i, j, k)), rel=1e-11, abs=1e-13)
    assert abs(mean(TensorGauss(3), mixed(), ALPHA, (6, 0, 0, 0)) - raw((6, 0, 0))) > 1e-3


# ------------------------------------------------------------------------------ sparse grids


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_sparse_grid_is_exact_just_where_it_says(level: int) -> None:
    """Monomials with sum of floor(k/2) <= L, among them all of total degree 2L + 1."""
    nodes = Smolyak(level).nodes(mixed(), ALPHA)
    exact = 0
    for powers in product(range(2 * level + 2), repeat=3):
        if sum(k // 2 for k in powers) <= level:
            exact += 1
            x = np.prod(nodes.x[:, [0, 2, 3]] ** np.array(powers), axis=1)
            assert nodes.weights @ x == pytest.approx(raw(powers), rel=1e-10, abs=1e-12)
        else:
            assert sum(powers) > 2 * level + 1
    assert exact >= comb(2 * level + 4, 3)  # all of total degree 2L + 1 in three parameters


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_sparse_grid_is_not_exact_beyond(level: int) -> None:
    """q = L + 1 nodes miss E[x^2q] by sd^2q q!, the square norm of the node polynomial."""
    q = level + 1
    inputs, alpha = standard_normals(3)
    odd = np.prod(np.arange(2 * q - 1, 0, -2.0))
    found = mean(Smolyak(level), inputs, alpha, (0, 2 * q, 0))
    assert odd - found == pytest.approx(special.factorial(q), rel=1e-9)
    # nor for products whose floors of half the powers sum to L + 1
    if level:
        assert mean(Smolyak(level), inputs, alpha, (2 * level, 2, 0)) == pytest.approx(
            np.prod(np.arange(2 * level - 1, 0, -2.0)) - special.factorial(level), rel=1e-9
        )


def test_nodes_that_coincide_are_merged() -> None:
    """Level 2: the middle, 4 more on each axis, and (+-1, +-1) on each pair of axes."""
    for n in (1, 2, 5, 10):
        inputs, alpha = standard_normals(n)
        nodes = Smolyak(2).nodes(inputs, alpha)
        count = (1 + 4 * n + 4 * comb(n, 2)) if n > 1 else 3
        assert nodes.weights.size == count
        assert np.unique(nodes.x.round(9), axis=0).shape[0] == count
    # in one dimension it is the Gauss rule; laws whose nodes depend on alpha share none
    inputs, alpha = standard_normals(1)
    gauss, sparse = TensorGauss(5).nodes(inputs, alpha), Smolyak(4).nodes(inputs, alpha)
    np.testing.assert_allclose(np.sort(sparse.x[:, 0]), gauss.x[:, 0], atol=1e-14)
    law = Inputs({"w": TruncatedNormal(BOX, 0.0, 0.5), "v": TruncatedNormal(BOX, 0.0, 0.5)})
    start = np.array([0.0, 0.5, 0.0, 0.5])
    assert Smolyak(2).nodes(law, start).weights.size == 3 + 4 + 3 + 2 + 2


# ------------------------------------------------------------------------------ points


def errors(make: type[SobolPoints] | type[MonteCarloPoints], points: int) -> float:
    """Root mean square error of E exp(0.3 sum x) = exp(0.18), over 24 seeds, in 4 dimensions."""
    inputs, alpha = standard_normals(4)
    found = []
    for seed in range(24):
        nodes = make(points, seed).nodes(inputs, alpha)
        found.append(nodes.weights @ np.exp(0.3 * nodes.x.sum(axis=1)))
    return float(np.sqrt(np.mean((np.array(found) - np.exp(0.18)) ** 2)))


def test_sobol_points_converge_faster_than_random_ones() -> None:
    sizes = 2 ** np.array([6, 8, 10, 12])
    sobol = np.polyfit(np.log(sizes), np.log([errors(SobolPoints, int(j)) for j in sizes]), 1)[0]
    random = np.polyfit(np.log(sizes), np.log([errors(MonteCarloPoints, int(j)) for j in sizes]), 1)
    assert sobol < -0.85
    assert random[0] == pytest.approx(-0.5, abs=0.1)


def test_the_probability_grid_misses_the_tails_at_first_order() -> None:
    inputs, alpha = standard_normals(1)
    missing = np.array([1.0 - mean(ProbabilityGrid(m), inputs, alpha, (2,)) for m in (64, 256)])
    assert np.all(missing > 0.0)
    assert np.log(missing[0] / missing[1]) / np.log(4.0) == pytest.approx(1.0, abs=0.03)
    # a Gauss rule of two nodes has none of this error
    assert mean(TensorGauss(2), inputs, alpha, (2,)) == pytest.approx(1.0, abs=1e-14)


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: TensorGauss(0), "per_dimension = 0"),
        (lambda: TensorGauss(2.0), "per_dimension = 2.0"),  # type: ignore[arg-type]
        (lambda: TensorGauss(101), "between 1 and 100"),
        (lambda: Smolyak(-1), "level = -1"),
        (lambda: Smolyak(21), "between 0 and 20"),
        (lambda: SobolPoints(1000), "1000 Sobol' points"),
        (lambda: SobolPoints(1), "points = 1"),
        (lambda: SobolPoints(64, seed=-1), "seed = -1"),
        (lambda: MonteCarloPoints(1), "points = 1"),
        (lambda: ProbabilityGrid(True), "per_dimension = True"),
        (lambda: TensorGauss(20).nodes(*standard_normals(8)), "nodes, more than"),
        (lambda: ProbabilityGrid(20).nodes(*standard_normals(8)), "nodes, more than"),
        (lambda: Smolyak(20).nodes(*standard_normals(8)), "nodes, more than"),
    ],
)
def test_misuse_is_named(make, named: str) -> None:
    with pytest.raises(InputsError, match=named) as caught:
        make()
    assert caught.value.remedy
