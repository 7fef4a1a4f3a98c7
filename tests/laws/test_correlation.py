"""Every trial is a correlation matrix, and the nodes of correlated parameters have it."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from aleator import Constant, Free, Inputs, Normal, TruncatedNormal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Beta, Gamma, LogNormal, Uniform
from aleator.laws.correlation import Correlation, between
from aleator.laws.quadrature import Smolyak, SobolPoints, TensorGauss

LETTERS = "abcdefghij"


def all_pairs(n: int) -> Correlation:
    """Every pair of n parameters, in the order of the vine."""
    names = LETTERS[:n]
    return between(names, dict.fromkeys(combinations(names, 2), Free(-1.0, 1.0)))


def some_partials(limit: float) -> st.SearchStrategy[tuple[int, list[float]]]:
    return st.integers(2, 10).flatmap(
        lambda n: st.tuples(
            st.just(n),
            st.lists(
                st.floats(-limit, limit, allow_subnormal=False),
                min_size=n * (n - 1) // 2,
                max_size=n * (n - 1) // 2,
            ),
        )
    )


# ------------------------------------------------------------------------------ the matrix


@settings(max_examples=100, deadline=None)
@given(some_partials(1.0))
def test_every_trial_is_a_correlation_matrix(trial: tuple[int, list[float]]) -> None:
    """Also with partial correlations of exactly -1 and 1; and no derivative is infinite."""
    n, partial = trial
    correlation = all_pairs(n)
    factor, factor_slope = correlation.cholesky(np.array(partial))
    matrix, matrix_slope = correlation.matrix(np.array(partial))
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_array_equal(np.diag(matrix), 1.0)
    assert np.all(np.abs(matrix) <= 1.0 + 1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-13 * n
    np.testing.assert_array_equal(factor, np.tril(factor))
    assert np.all(np.diag(factor) >= 0.0)
    np.testing.assert_allclose(factor @ factor.T, matrix, atol=1e-14)
    assert np.all(np.isfinite(factor_slope))
    assert np.all(np.isfinite(matrix_slope))


@settings(max_examples=50, deadline=None)
@given(some_partials(0.8))
def test_the_partial_correlations_of_the_matrix_are_those_given(
    trial: tuple[int, list[float]],
) -> None:
    """By another way: r_ij given k.. is -P_ij/sqrt(P_ii P_jj), P the inverse of that part of R.

    And det R = prod (1 - r^2) (Lewandowski, Kurowicka and Joe, 2009, eq. (3)).
    """
    n, partial = trial
    correlation = all_pairs(n)
    matrix, _ = correlation.matrix(np.array(partial))
    for (i, j), value in zip(correlation.pairs, partial, strict=True):
        part = [*range(j), j, i]
        precision = np.linalg.inv(matrix[np.ix_(part, part)])[-2:, -2:]
        found = -precision[0, 1] / np.sqrt(precision[0, 0] * precision[1, 1])
        assert found == pytest.approx(value, abs=1e-9)
    determinant = np.prod(1.0 - np.array(partial) ** 2)
    assert np.linalg.det(matrix) == pytest.approx(determinant, rel=1e-9)


@pytest.mark.parametrize("n", [2, 3, 4, 7])
def test_derivatives_against_differences(n: int) -> None:
    correlation = all_pairs(n)
    partial = np.random.default_rng(n).uniform(-0.9, 0.9, len(correlation.pairs))
    factor_slope, matrix_slope = correlation.cholesky(partial)[1], correlation.matrix(partial)[1]
    for k in range(partial.size):
        step = np.zeros_like(partial)
        step[k] = 1e-3
        for way, slope in (
            (correlation.cholesky, factor_slope),
            (correlation.matrix, matrix_slope),
        ):
            ends = [way(partial + s * step)[0] for s in (-2, -1, 1, 2)]
            expected = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / 12e-3
            np.testing.assert_allclose(slope[:, :, k], expected, atol=1e-7)


# ------------------------------------------------------------------------------ names


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        (["ab"], ["a.b"]),
        (["ba"], ["a.b"]),
        (["ab", "ac", "bc"], ["a.b", "a.c", "b.c.given.a"]),
        # a chain: its middle is first, so that both are plain correlations
        (["ab", "bc"], ["a.b", "b.c"]),
        # a star
        (["ad", "bd", "cd"], ["a.d", "b.d", "c.d"]),
        # two groups know nothing of each other
        (["cd", "ab"], ["a.b", "c.d"]),
        (
            ["ab", "ac", "ad", "bc", "bd", "cd"],
            ["a.b", "a.c", "a.d", "b.c.given.a", "b.d.given.a", "c.d.given.a.b"],
        ),
    ],
)
def test_names_say_what_is_held(pairs: list[str], expected: list[str]) -> None:
    found = between("abcd", {(p[0], p[1]): Free() for p in pairs})
    assert [h.name for h in found.hyperparameters] == [f"correlation.{name}" for name in expected]
    first = found.hyperparameters[0]
    assert (first.lower, first.start, first.upper, first.free) == (-0.99, 0.0, 0.99, True)


# ------------------------------------------------------------------------------ nodes


def four() -> tuple[Inputs, Array, Array]:
    """Four normal parameters about a constant, all correlated; alpha, and their covariance."""
    names = ["a", "b", "k", "c", "d"]
    laws = {n: Constant(2.0) if n == "k" else Normal(Free(-1, 1), Free(0.1, 3.0)) for n in names}
    inputs = Inputs(laws, dict.fromkeys(combinations("abcd", 2), Free(-1.0, 1.0)))
    rng = np.random.default_rng(8)
    sd = np.array([0.5, 1.5, 0.0, 2.0, 1.0])
    means = np.array([0.3, -0.2, 2.0, 0.1, 0.9])
    own = [[m] if n == "k" else [m, s] for n, m, s in zip(names, means, sd, strict=True)]
    alpha = np.array([*np.concatenate(own), *rng.uniform(-0.9, 0.9, 6)])
    return inputs, alpha, np.outer(sd, sd) * inputs.correlation_matrix(alpha)


@pytest.mark.parametrize("choice", [TensorGauss(2), TensorGauss(4), Smolyak(1), Smolyak(2)])
def test_the_nodes_have_the_covariance(choice: TensorGauss | Smolyak) -> None:
    inputs, alpha, covariance = four()
    nodes = choice.nodes(inputs, alpha)
    mean = nodes.weights @ nodes.x
    np.testing.assert_allclose(mean, [0.3, -0.2, 2.0, 0.1, 0.9], atol=1e-13)
    away = nodes.x - mean
    np.testing.assert_allclose((away.T * nodes.weights) @ away, covariance, atol=1e-12)


@pytest.mark.parametrize("rho", [-1.0, 1.0])
def test_perfect_correlation_is_no_accident(rho: float) -> None:
    inputs = Inputs(
        {"a": Normal(Free(0, 2), Free(0.1, 1)), "b": Normal(Free(0, 2), Free(0.1, 1))},
        {("a", "b"): Free(-1.0, 1.0)},
    )
    alpha = np.array([1.0, 0.5, 0.0, 0.2, rho])
    for choice in (TensorGauss(5), Smolyak(3), SobolPoints(64)):
        nodes = choice.nodes(inputs, alpha)
        np.testing.assert_allclose(nodes.x[:, 1], rho * 0.4 * (nodes.x[:, 0] - 1.0), atol=1e-14)
        assert np.all(np.isfinite(nodes.dx))
    x = inputs.sample(alpha, np.random.default_rng(0).random((10, 2)))
    np.testing.assert_allclose(x[:, 1], rho * 0.4 * (x[:, 0] - 1.0), atol=1e-14)


# ------------------------------------------------------------------------------ copulas


def test_ranks_of_a_sample_and_its_marginals() -> None:
    """Spearman's rho of a Gaussian copula is 6/pi arcsin(R/2), Kendall's tau 2/pi arcsin(R)."""
    laws = {
        "u": TruncatedNormal((-1.0, 1.0), 0.8, 0.5),
        "v": TruncatedNormal((0.0, float("inf")), 0.0, 1.0),
        "n": Normal(3.0, 0.1),
    }
    inputs = Inputs(laws, {("u", "v"): 0.7, ("u", "n"): -0.3, ("v", "n"): 0.5})
    alpha = np.array([h.start for h in inputs.hyperparameters])
    count = 20_000
    x = inputs.sample(alpha, np.random.default_rng(5).random((count, 3)))
    matrix = inputs.correlation_matrix(alpha)
    for i, j in combinations(range(3), 2):
        expected = 6.0 / np.pi * np.arcsin(matrix[i, j] / 2.0)
        # at most about 1/sqrt(count) for any correlation
        assert stats.spearmanr(x[:, i], x[:, j])[0] == pytest.approx(expected, abs=4 / count**0.5)
        tau = stats.kendalltau(x[:, i], x[:, j])[0]
        assert tau == pytest.approx(2.0 / np.pi * np.arcsin(matrix[i, j]), abs=4 / count**0.5)
    exact = [
        stats.truncnorm(-1.8 / 0.5, 0.2 / 0.5, 0.8, 0.5),
        stats.halfnorm(),
        stats.norm(3.0, 0.1),
    ]
    for i, law in enumerate(exact):
        assert stats.kstest(x[:, i], law.cdf).pvalue > 1e-3
        edges = np.array([[0.1] * 3, [0.9] * 3])
        found = inputs.marginal(alpha, edges)[:, i]
        np.testing.assert_allclose(found, law.ppf([0.1, 0.9]), rtol=1e-9)


def test_pearson_of_a_copula_by_nodes_and_by_integration() -> None:
    """E[u v] of two truncated laws against a double integral over the bivariate normal density."""
    laws = {name: TruncatedNormal((-1.0, 1.0), m, 0.5) for name, m in (("u", 0.8), ("v", -0.3))}
    inputs = Inputs(laws, {("u", "v"): 0.7})
    alpha = np.array([h.start for h in inputs.hyperparameters])
    z = np.linspace(-8.0, 8.0, 801)
    u, v = (
        stats.truncnorm((-1 - m) / 0.5, (1 - m) / 0.5, m, 0.5).ppf(stats.norm.cdf(z))
        for m in (0.8, -0.3)
    )
    joint = stats.multivariate_normal(cov=[[1.0, 0.7], [0.7, 1.0]])
    density = joint.pdf(np.stack(np.meshgrid(z, z, indexing="ij"), axis=-1))
    expected = (z[1] - z[0]) ** 2 * u @ density @ v
    nodes = TensorGauss(40).nodes(inputs, alpha)
    assert nodes.weights @ (nodes.x[:, 0] * nodes.x[:, 1]) == pytest.approx(expected, abs=1e-7)
    points = SobolPoints(2**14, 0).nodes(inputs, alpha)
    found = points.weights @ (points.x[:, 0] * points.x[:, 1])
    assert found == pytest.approx(expected, abs=2e-4)


LAWS = {
    "uniform": (Uniform(Free(0.0, 1.0), Free(0.1, 1.0)), [0.4, 0.3]),
    "beta": (Beta((0.0, 2.0), Free(0.2, 1.5), Free(0.1, 0.5)), [0.8, 0.3]),
    "gamma": (Gamma(Free(0.5, 3.0), Free(0.1, 1.0)), [1.5, 0.6]),
    "lognormal": (LogNormal(Free(0.5, 3.0), Free(0.1, 1.0)), [1.5, 0.6]),
    "truncated": (TruncatedNormal((-1.0, 1.0), sd=Free(0.05, 2.0)), [0.8, 0.5]),
    "normal": (Normal(Free(-1.0, 1.0), Free(0.05, 1.0)), [0.4, 0.3]),
}


@pytest.mark.parametrize(
    "choice", [TensorGauss(3), SobolPoints(32)], ids=lambda c: type(c).__name__
)
@pytest.mark.parametrize("name", LAWS)
def test_every_law_can_be_correlated(name: str, choice: TensorGauss | SobolPoints) -> None:
    """The derivative of E exp(0.5 a b), b of that law, by all of alpha against differences."""
    law, values = LAWS[name]
    inputs = Inputs(
        {"a": Normal(Free(-1.0, 1.0), Free(0.1, 1.0)), "b": law}, {("a", "b"): Free(-0.9, 0.9)}
    )
    alpha = np.array([0.2, 0.5, *values, 0.6])

    def total(at: Array) -> float:
        nodes = choice.nodes(inputs, at)
        return float(nodes.weights @ np.exp(0.5 * nodes.x[:, 0] * nodes.x[:, 1]))

    nodes = choice.nodes(inputs, alpha)
    y = np.exp(0.5 * nodes.x[:, 0] * nodes.x[:, 1])
    slope = 0.5 * y[:, None] * nodes.x[:, ::-1]
    found = y @ nodes.dweights + np.einsum("j,jn,jnk->k", nodes.weights, slope, nodes.dx)
    for k in range(alpha.size):
        step = np.zeros_like(alpha)
        step[k] = 1e-3
        ends = [total(alpha + s * step) for s in (-2, -1, 1, 2)]
        expected = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / 12e-3
        assert found[k] == pytest.approx(expected, rel=1e-6, abs=1e-8)
    assert found[-1] > 0.0


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("correlation", "named"),
    [
        ({("a", "x"): 0.5}, "'x' that scatters"),
        ({("a", "k"): 0.5}, "'k' that scatters"),
        ({("a", "a"): 0.5}, "with itself"),
        ({("a", "b"): 0.5, ("b", "a"): Free()}, "given twice"),
        ({("a", "b", "c"): 0.5}, "'c'"),
        ({("a", "b"): 1.5}, r"correlation\.a\.b.*1\.5"),
        ({("a", "b"): Free(-1.5, 0.5)}, r"\[-1\.5, 0\.5\]"),
        ({("a", "b"): Free(0.1, 0.5, start=0.0)}, r"start 0\.0"),
        ({("a", "b"): "strong"}, "'strong'"),
    ],
)
def test_misuse_is_named(correlation, named: str) -> None:
    laws = {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0), "c": Normal(0.0, 1.0)}
    with pytest.raises(InputsError, match=named) as caught:
        Inputs({**laws, "k": Constant(1.0)}, correlation)
    assert caught.value.remedy


def test_independent_variables_are_tied_to_the_nodes() -> None:
    inputs, alpha, _ = four()
    laws, values = inputs.independent(alpha)
    own = np.stack([law.rule(v, 2).x[[-1]] for law, v in zip(laws, values, strict=True)], axis=1)
    at = list(inputs.correlated)
    own[:, at], _ = inputs.tied(alpha, own[:, at])
    np.testing.assert_allclose(own, TensorGauss(2).nodes(inputs, alpha).x[[-1]], atol=1e-13)


def test_scores_by_every_correlation_are_those_of_differences() -> None:
    inputs, alpha, _ = four()
    rng = np.random.default_rng(3)
    xi, weight = rng.standard_normal((2, 3, 4)), rng.standard_normal((2, 3, 5))
    score = inputs.individual(alpha, xi, slice(0, 2)).score(weight, np.ones((2, 3)))
    for k in range(alpha.size):
        h = 1e-6 * np.eye(alpha.size)[k]
        ends = [inputs.individual(alpha + sign * h, xi, slice(0, 2)).x for sign in (1.0, -1.0)]
        slope = np.sum(weight * (ends[0] - ends[1]) / 2e-6, axis=(1, 2))
        np.testing.assert_allclose(score[:, k], slope, rtol=1e-6, atol=1e-7)
