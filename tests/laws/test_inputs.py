"""The joint law: tensor rules, and the map from outcomes at nodes to the expansion."""

from __future__ import annotations

import numpy as np
import pytest
from problems import from_raw, raw_normal, raw_truncated
from scipy import special

from aleator import Constant, Free, Inputs, Normal, TensorGauss, TruncatedNormal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.moments.moments import weighted_moments
from aleator.moments.projection import expansion_map

BOX = (-1.0, 1.0)
ALPHA = np.array([0.4, 0.3, -2.0, 0.8, 0.5])
"""x normal, c constant, w truncated normal on a box that binds."""


def inputs(basis: str = "own") -> Inputs:
    return Inputs(
        {
            "x": Normal(mean=Free(-1.0, 1.0), sd=Free(0.05, 1.0)),
            "c": Constant(Free(-5.0, 5.0)),
            "w": TruncatedNormal(BOX, sd=Free(0.05, 2.0), polynomials=basis),  # type: ignore[arg-type]
        }
    )


def raw(order: tuple[int, int, int]) -> float:
    """E[x^i c^j w^k] in closed form."""
    i, j, k = order
    x, w = raw_normal(ALPHA[0], ALPHA[1], i), raw_truncated(ALPHA[3], ALPHA[4], BOX, k)
    return float(x * ALPHA[2] ** j * w)


def cubic(x: Array) -> Array:
    """A polynomial of total degree 3 in x, c and w, (J, 3) -> (J,)."""
    return x[:, 0] ** 2 * x[:, 2] + x[:, 1] * x[:, 2] ** 2 - 0.5 * x[:, 0] + 2.0


# ------------------------------------------------------------------------------ tensor rules


def test_the_order_of_alpha_is_that_of_the_laws() -> None:
    names = [h.name for h in inputs().hyperparameters]
    assert names == ["x.mean", "x.sd", "c.value", "w.mean", "w.sd"]
    assert inputs().slices == (slice(0, 2), slice(2, 3), slice(3, 5))
    assert inputs().scattering == 2
    assert inputs().names == ("x", "c", "w")
    assert inputs().size == 5
    assert inputs().scattered == (0, 2)


@pytest.mark.parametrize("basis", ["own", "hermite"])
def test_a_tensor_rule_has_the_product_moments(basis) -> None:
    nodes = TensorGauss(6 if basis == "own" else 60).nodes(inputs(basis), ALPHA)
    assert nodes.x.shape == ((6 if basis == "own" else 60) ** 2, 3)
    assert nodes.weights.sum() == pytest.approx(1.0, abs=1e-14)
    # the Hermite rule of the clip converges slowly: 60 nodes leave 1e-7
    tolerance = 1e-12 if basis == "own" else 1e-6
    for order in [(1, 0, 0), (0, 1, 0), (0, 0, 1), (4, 1, 5), (3, 2, 11), (11, 0, 2)]:
        found = nodes.weights @ np.prod(nodes.x ** np.array(order), axis=1)
        assert found == pytest.approx(raw(order), rel=tolerance)


@pytest.mark.parametrize("basis", ["own", "hermite"])
def test_the_derivative_of_any_weighted_sum_is_exact(basis) -> None:
    """Also where the rule itself is coarse: q = 3 for an exponential."""

    def total(alpha: Array) -> float:
        nodes = TensorGauss(3).nodes(inputs(basis), alpha)
        return float(nodes.weights @ np.exp(nodes.x[:, 0] * nodes.x[:, 2] - 0.1 * nodes.x[:, 1]))

    nodes = TensorGauss(3).nodes(inputs(basis), ALPHA)
    x, c, w = nodes.x.T
    value = np.exp(x * w - 0.1 * c)
    slope = value[:, None] * np.stack([w, np.full_like(w, -0.1), x], axis=1)
    found = value @ nodes.dweights + np.einsum("j,jn,jnk->k", nodes.weights, slope, nodes.dx)
    for k in range(ALPHA.size):
        step = np.zeros_like(ALPHA)
        step[k] = 1e-3
        ends = [total(ALPHA + s * step) for s in (-2, -1, 1, 2)]
        expected = (8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / 12e-3
        # the rule's own differences of its ends leave 1e-9
        assert found[k] == pytest.approx(expected, rel=1e-7, abs=1e-8)


# ------------------------------------------------------------------------------ the expansion


def test_moments_of_the_expansion_of_a_polynomial_are_exact_to_order_8() -> None:
    """Against the product moments in closed form; 20 nodes serve degree 24 as well."""
    joint = inputs()
    nodes = TensorGauss(4).nodes(joint, ALPHA)
    matrix, weights = expansion_map(joint, ALPHA, 4, 3, 8)
    outcome = cubic(nodes.x)[None, :] @ matrix.T
    found = weighted_moments(outcome, weights, 8)
    terms = [((2, 0, 1), 1.0), ((0, 1, 2), 1.0), ((1, 0, 0), -0.5), ((0, 0, 0), 2.0)]
    powers = {(0, 0, 0): 1.0}
    moments = []
    for _ in range(9):
        moments.append(sum(factor * raw(order) for order, factor in powers.items()))
        grown: dict[tuple[int, int, int], float] = {}
        for order, factor in powers.items():
            for term, coefficient in terms:
                key = (order[0] + term[0], order[1] + term[1], order[2] + term[2])
                grown[key] = grown.get(key, 0.0) + factor * coefficient
        powers = grown
    mean, sd, standardized = from_raw(moments)
    assert found.mean[0] == pytest.approx(mean, rel=1e-12)
    assert found.sd[0] == pytest.approx(sd, rel=1e-11)
    # raw moments in double precision lose four digits when they are centered
    np.testing.assert_allclose(found.standardized[0], standardized, rtol=1e-9, atol=1e-9)
    # plain quadrature with the same four nodes integrates degree 7 only
    plain = weighted_moments(cubic(nodes.x)[None, :], nodes.weights, 8)
    assert abs(plain.standardized[0, 8] / standardized[8] - 1.0) > 0.01


# ------------------------------------------------------------------------------ sampling, misuse


def test_a_sample_has_the_moments_of_the_rule() -> None:
    u = np.random.default_rng(4).random((40_000, 3))
    x = inputs().sample(ALPHA, u)
    for order in [(1, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 2), (1, 0, 1)]:
        terms = np.prod(x ** np.array(order), axis=1)
        # four standard errors of the Monte Carlo mean
        assert np.mean(terms) == pytest.approx(raw(order), abs=4.0 * np.std(terms) / 200.0 + 1e-12)


def test_the_image_of_a_normal_variate_is_the_quantile_of_its_probability() -> None:
    xi = np.random.default_rng(2).standard_normal((50, 2))
    u = special.ndtr(np.insert(xi, 1, 0.0, axis=1))
    x, dx = inputs().image(ALPHA, xi)
    np.testing.assert_allclose(x, inputs().marginal(ALPHA, u), atol=1e-12)
    # x_i moves with the hyperparameters of its own law only
    assert [np.flatnonzero(np.any(dx[:, i], axis=0)).tolist() for i in range(3)] == [
        [0, 1],
        [2],
        [3, 4],
    ]


@pytest.mark.parametrize(
    ("laws", "named"),
    [({}, "no parameter"), ({"a b": Normal(0.0, 1.0)}, "a b"), ({"2x": Normal(0.0, 1.0)}, "2x")],
)
def test_misuse_is_named(laws, named) -> None:
    with pytest.raises(InputsError, match=named) as caught:
        Inputs(laws)
    assert caught.value.remedy
