"""Moments of weighted outcomes: closed forms, invariance, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from problems import PROBLEMS, Exact, Problem, raw_normal, title

from aleator.core.polynomials import gauss_hermite
from aleator.core.types import Array
from aleator.laws.quadrature import TensorGauss
from aleator.moments.moments import weighted_moments, weighted_moments_with_gradient


def at_nodes(problem: Problem, nodes: int) -> tuple[Array, Array]:
    rule = TensorGauss(nodes).nodes(problem.inputs, problem.alpha)
    return Exact(problem).evaluate(rule.x), rule.weights


# ------------------------------------------------------------------------------ closed forms


@pytest.mark.parametrize("problem", PROBLEMS, ids=title)
def test_moments_by_quadrature_are_those_in_closed_form(problem) -> None:
    mean, sd, standardized = problem.exact_moments(8)
    found = weighted_moments(*at_nodes(problem, 24), 8)
    # 24 nodes are exact to degree 47; what an eigenvector's square leaves of the weight of an outer
    # node, 1e-18 absolute, is multiplied by the eighth power of up to 20 standard deviations
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.sd, sd, rtol=1e-11)
    np.testing.assert_allclose(found.standardized, standardized, rtol=1e-8, atol=1e-10)


def test_no_digit_is_lost_for_a_small_scatter_about_a_large_outcome() -> None:
    theta, weights = gauss_hermite(12)
    found = weighted_moments(0.8 + 1e-6 * theta[None, :], weights, 8)
    assert found.sd[0] == pytest.approx(1e-6, rel=1e-9)
    # the outcome itself is rounded to 1e-16 of 0.8, that is 1e-10 standard deviations
    truth = [float(raw_normal(0.0, 1.0, m)) for m in range(9)]
    np.testing.assert_allclose(found.standardized[0], truth, rtol=2e-9, atol=2e-7)
    # ... where powers of the outcome itself have none left at order 4
    raw = [float(weights @ (0.8 + 1e-6 * theta) ** m) for m in range(5)]
    fourth = sum(
        c * raw[m] * (-raw[1]) ** (4 - m) for m, c in enumerate([1.0, -4.0, 6.0, -4.0, 1.0])
    )
    assert abs(fourth / 1e-24 - 3.0) > 1e3


def test_an_outcome_without_scatter_has_none() -> None:
    found = weighted_moments(np.full((1, 5), 0.1), np.full(5, 0.2), 4)
    assert (found.mean.tolist(), found.sd.tolist()) == ([pytest.approx(0.1)], [0.0])
    assert found.standardized.tolist() == [[1.0, 0.0, 1.0, 0.0, 0.0]]


# ------------------------------------------------------------------------------ invariance

outcomes = arrays(np.float64, (1, 6), elements=st.floats(-10.0, 10.0), unique=True)


@given(y=outcomes, scale=st.floats(1e-3, 1e3), shift=st.floats(-1e3, 1e3), flip=st.booleans())
def test_moments_do_not_depend_on_the_unit(y, scale, shift, flip) -> None:
    weights = np.array([0.1, 0.2, 0.3, 0.2, 0.15, 0.05])
    plain = weighted_moments(y, weights, 6)
    factor = -scale if flip else scale
    moved = weighted_moments(factor * y + shift, weights, 6)
    # digits that shift + factor y has lost before it arrives, in standard deviations
    lost = 1e-14 * (1.0 + (abs(shift) + scale * 10.0) / (scale * plain.sd[0]))
    if lost > 1e-6:
        return
    assert moved.mean[0] == pytest.approx(
        factor * plain.mean[0] + shift, abs=lost * scale * plain.sd[0] + 1e-12
    )
    assert moved.sd[0] == pytest.approx(scale * plain.sd[0], rel=lost)
    sign = np.where(flip, -1.0, 1.0) ** np.arange(7)
    np.testing.assert_allclose(
        moved.standardized[0], sign * plain.standardized[0], rtol=100 * lost, atol=100 * lost
    )


# ------------------------------------------------------------------------------ derivatives


def moving(s: float) -> tuple[Array, Array]:
    """Outcomes (2, 5) and weights (5,) on a path, for differences along it."""
    t = np.linspace(-1.0, 1.0, 5)
    y = np.stack([np.exp(0.5 * t + s * t**2), 0.8 + 0.01 * np.sin(2.0 * t + s)])
    w = np.array([0.1, 0.25, 0.3, 0.25, 0.1]) * np.exp(0.7 * s * t)
    return y, w / w.sum()


def test_jacobians_are_those_of_differences() -> None:
    h, order = 1e-3, 7
    ends = [moving(k * h) for k in (-2, -1, 1, 2)]
    y, w = moving(0.0)
    # complex step would need complex powers; differences of fourth order leave 1e-11
    dy = (8.0 * (ends[2][0] - ends[1][0]) - (ends[3][0] - ends[0][0])) / (12.0 * h)
    dw = (8.0 * (ends[2][1] - ends[1][1]) - (ends[3][1] - ends[0][1])) / (12.0 * h)
    found = weighted_moments_with_gradient(y, w, order, dy[:, :, None], dw[:, None])
    plain = weighted_moments(y, w, order)
    np.testing.assert_array_equal(found.standardized, plain.standardized)
    pieces = [weighted_moments(*end, order) for end in ends]
    for name in ("mean", "sd", "standardized"):
        f = [getattr(piece, name) for piece in pieces]
        expected = (8.0 * (f[2] - f[1]) - (f[3] - f[0])) / (12.0 * h)
        jac = getattr(found, f"{name}_jac")[..., 0]
        np.testing.assert_allclose(jac, expected, rtol=1e-8, atol=1e-9)
