"""Moments of expansions in the normal germ, from few runs in many parameters."""

from __future__ import annotations

import numpy as np
import pytest

from aleator import Free, Inputs, Normal, TruncatedNormal
from aleator.laws.quadrature import SobolPoints, TensorGauss
from aleator.moments.expansion import TotalDegree
from aleator.moments.projection import Projection, Regression
from aleator.moments.propagation import (
    Collocation,
    ExpandedPropagation,
    QuadraturePropagation,
)

TEN = Inputs({f"x{i}": Normal(Free(-1.0, 1.0), Free(0.01, 1.0)) for i in range(10)})
ALPHA = np.array([value for i in range(10) for value in (0.1 * i - 0.4, 0.05 + 0.03 * i)])
SLOPES = np.linspace(1.0, 2.0, 10)


class Quadratic:
    """Y_l = (a.x)^2 + l b.x, whose derivatives are known."""

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        return np.stack([(x @ SLOPES) ** 2 + l * x @ SLOPES[::-1] for l in range(3)])

    def evaluate_with_gradient(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = 2.0 * (x @ SLOPES)[:, None] * SLOPES
        slope = np.stack([first + l * SLOPES[::-1] for l in range(3)])
        return self.evaluate(x), slope


def test_ten_parameters_are_exact_for_a_quadratic() -> None:
    fit = Regression(TotalDegree(2), adaptive=False)
    way = ExpandedPropagation(TEN, Quadratic(), fit, 6)
    assert len(way.design) <= 300
    found = way.moments(ALPHA, 6, gradient=False)
    # l = 0: Y = S^2 with S normal, a noncentral chi-squared: mean m^2 + s^2, var 2 s^4 + 4 m^2 s^2
    mean, variance = ALPHA[::2] @ SLOPES, ALPHA[1::2] ** 2 @ SLOPES**2
    assert found.mean[0] == pytest.approx(mean**2 + variance, rel=1e-10)
    assert found.sd[0] ** 2 == pytest.approx(2 * variance**2 + 4 * mean**2 * variance, rel=1e-10)
    # cumulants k_n = 2^(n-1) (n-1)! (s^2n + n m^2 s^(2n-2))
    third = 8.0 * (variance**3 + 3.0 * mean**2 * variance**2)
    fourth = 48.0 * (variance**4 + 4.0 * mean**2 * variance**3)
    assert found.standardized[0, 3] == pytest.approx(third / found.sd[0] ** 3, rel=1e-9)
    assert found.standardized[0, 4] == pytest.approx(3.0 + fourth / found.sd[0] ** 4, rel=1e-9)


def test_jacobians_are_those_of_differences() -> None:
    way = ExpandedPropagation(TEN, Quadratic(), Regression(TotalDegree(2), adaptive=False), 4)
    found = way.moments(ALPHA, 4, gradient=True)
    for k in (0, 1, 7, 18, 19):
        ends = []
        for sign in (1.0, -1.0):
            moved = ALPHA.copy()
            moved[k] += sign * 1e-5
            ends.append(way.moments(moved, 4, gradient=False))
        for name in ("mean", "sd", "standardized"):
            difference = (getattr(ends[0], name) - getattr(ends[1], name)) / 2e-5
            np.testing.assert_allclose(
                getattr(found, f"{name}_jac")[..., k], difference, rtol=2e-6, atol=2e-7
            )


def test_a_projection_in_the_germ_agrees_with_many_nodes_where_the_law_is_bent() -> None:
    inputs = Inputs({"x": TruncatedNormal((0.2, 2.0), 1.0, 0.5), "y": Normal(0.0, 0.3)})
    alpha = np.array([1.0, 0.5, 0.0, 0.3])

    class Smooth:
        def evaluate(self, x: np.ndarray) -> np.ndarray:
            return (np.exp(0.5 * x[:, 0]) + x[:, 0] * x[:, 1])[None, :]

        def evaluate_with_gradient(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            raise NotImplementedError

    exact = QuadraturePropagation(inputs, Smooth(), TensorGauss(20)).moments(
        alpha, 4, gradient=False
    )
    errors = []
    for degree in (3, 6, 9):
        way = ExpandedPropagation(inputs, Smooth(), Projection(TotalDegree(degree)), 4)
        found = way.moments(alpha, 4, gradient=False)
        errors.append(float(np.abs(found.standardized - exact.standardized).max()))
    # the truncation bends the germ, so that convergence is algebraic, not geometric
    assert errors[0] > 3.0 * errors[1] > 3.0 * errors[2]


def test_sampling_agrees_with_the_expansion_as_its_error_says() -> None:
    exact = ExpandedPropagation(TEN, Quadratic(), Regression(TotalDegree(2), adaptive=False), 4)
    wanted = exact.moments(ALPHA, 4, gradient=False)
    gaps = []
    for points in (256, 4096):
        way = QuadraturePropagation(TEN, Quadratic(), SobolPoints(points))
        found = way.moments(ALPHA, 4, gradient=False)
        gaps.append(np.abs(found.mean - wanted.mean) / wanted.sd)
    assert np.all(gaps[1] < 5e-3)
    assert gaps[1].max() < gaps[0].max()


def test_a_degree_that_moves_with_alpha_is_not_taken() -> None:
    chosen = Collocation(fit=Regression(TotalDegree(2)))
    assert chosen.fit == Regression(TotalDegree(2), adaptive=False)
    assert chosen.name == "collocation(regression)"
