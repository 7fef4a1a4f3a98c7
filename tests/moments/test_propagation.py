"""alpha -> moments, by both ways, with plain quadrature and with expansions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from problems import BINDING, GROWTH, PROBLEMS, PRODUCT, SQUARE, Exact, Problem, collocated, title

from aleator import Collocation, Free, Inputs, Normal, ResponseSurface, TruncatedNormal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws.quadrature import SobolPoints, TensorGauss
from aleator.moments.expansion import TotalDegree
from aleator.moments.moments import Moments
from aleator.moments.projection import Projection, Regression
from aleator.moments.propagation import (
    ExpandedPropagation,
    ProjectedPropagation,
    QuadraturePropagation,
    check_nodes,
)
from aleator.simulators.response_functions import DirectResponse
from aleator.surrogates import build_surface

NAMES = ("mean", "sd", "standardized")


def law_of(problem: Problem) -> Array:
    return problem.alpha[:-1] if problem.noise else problem.alpha


def direct(problem: Problem, step: float = 1e-4) -> DirectResponse:
    return DirectResponse(problem.run, problem.z.size, problem.inputs.box, step)


def differences(propagation: QuadraturePropagation, alpha: Array, order: int) -> dict[str, Array]:
    """Jacobians by differences of fourth order of the moments themselves."""
    columns: dict[str, list[Array]] = {name: [] for name in NAMES}
    for k in range(alpha.size):
        h = 1e-3 * (1.0 + abs(alpha[k])) * 0.2
        ends = []
        for s in (-2, -1, 1, 2):
            moved = alpha.copy()
            moved[k] += s * h
            ends.append(propagation.moments(moved, order, gradient=False))
        for name in NAMES:
            f = [getattr(end, name) for end in ends]
            columns[name].append((8.0 * (f[2] - f[1]) - (f[3] - f[0])) / (12.0 * h))
    return {name: np.stack(column, axis=-1) for name, column in columns.items()}


def assert_same(found: Moments, expected: Moments, rtol: float) -> None:
    for name in NAMES:
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=rtol, atol=10.0 * rtol)


# ------------------------------------------------------------------------------ jacobians


@pytest.mark.parametrize("degree", [None, 4], ids=["quadrature", "expansion"])
@pytest.mark.parametrize("problem", PROBLEMS, ids=title)
def test_jacobians_are_those_of_differences(problem, degree) -> None:
    """With few nodes: what is differentiated is the sum that is computed, not its limit."""
    propagation = collocated(problem.inputs, Exact(problem), 5, degree)
    alpha = law_of(problem)
    found = propagation.moments(alpha, 6, gradient=True)
    plain = propagation.moments(alpha, 6, gradient=False)
    assert_same(found, plain, 1e-13)
    expected = differences(propagation, alpha, 6)
    free = [k for k, h in enumerate(problem.inputs.hyperparameters) if h.free]
    for name in NAMES:
        jac, other = getattr(found, f"{name}_jac")[..., free], expected[name][..., free]
        scale = np.abs(other).max()
        # rounding of moments of up to 100, 1e-13, over a step of 2e-4 leaves 1e-9
        np.testing.assert_allclose(jac, other, rtol=1e-6, atol=1e-7 * scale + 1e-8)


def test_simulator_differences_converge_with_the_square_of_the_step() -> None:
    points = TensorGauss(6).nodes(GROWTH.inputs, GROWTH.alpha).x
    _, exact = Exact(GROWTH).evaluate_with_gradient(points)
    errors = [
        np.abs(direct(GROWTH, step).evaluate_with_gradient(points)[1] - exact).max()
        for step in (4e-2, 2e-2, 1e-2)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.01)


def test_simulator_differences_stay_inside_the_box() -> None:
    seen: list[Array] = []

    def run(index: NDArray[np.intp], x: Array) -> Array:
        seen.append(x)
        return BINDING.run(index, x)

    points = np.array([[0.0], [0.4], [1.0]])
    response = DirectResponse(run, BINDING.z.size, BINDING.inputs.box)
    slope = response.evaluate_with_gradient(points)[1]
    np.testing.assert_allclose(slope[:, :, 0], np.tile(BINDING.z[:, None], 3), rtol=1e-9)
    assert np.concatenate(seen).min() >= 0.0
    assert np.concatenate(seen).max() <= 1.0


def test_simulator_differences_survive_nodes_beyond_the_box_of_an_open_law() -> None:
    """40 nodes reach 11.7 standard deviations, the box of a law without one ends at 8."""
    inputs = Inputs({"x": Normal(mean=0.0, sd=Free(0.1, 0.5))})
    response = DirectResponse(lambda _, x: np.exp(0.1 * x[:, 0]), 1, inputs.box)
    found = QuadraturePropagation(inputs, response, TensorGauss(40)).moments(
        np.array([0.0, 0.5]), 4, gradient=True
    )
    # d E[exp(0.1 x)]/d sd = 0.01 sd exp(0.005 sd^2)
    assert found.mean_jac[0, 1] == pytest.approx(0.005 * math.exp(0.00125), rel=1e-7)


# ------------------------------------------------------------------------------ both ways agree


@pytest.mark.parametrize("problem", [GROWTH, SQUARE, BINDING, PRODUCT], ids=title)
def test_collocation_and_surface_agree(problem) -> None:
    choice = ResponseSurface(tolerance=1e-5, accuracy=1e-13)
    surface = build_surface(problem.run, problem.inputs.box, problem.z.size, choice)
    assert surface.converged.all()
    alpha = law_of(problem)
    by_surface = QuadraturePropagation(problem.inputs, surface, TensorGauss(12)).moments(
        alpha, 4, gradient=True
    )
    by_runs = QuadraturePropagation(problem.inputs, direct(problem), TensorGauss(12)).moments(
        alpha, 4, gradient=True
    )
    # the surface's error is 1e-5 of the scatter on the whole box, of which the law may be a tenth
    allowed = 5.0 * surface.error
    assert np.all(np.abs(by_surface.mean - by_runs.mean) <= allowed)
    assert np.all(np.abs(by_surface.sd - by_runs.sd) <= allowed)
    np.testing.assert_allclose(by_surface.standardized, by_runs.standardized, rtol=1e-2, atol=1e-3)
    np.testing.assert_allclose(by_surface.mean_jac, by_runs.mean_jac, rtol=1e-2, atol=1e-3)


def test_an_expansion_is_exact_where_plain_quadrature_with_its_nodes_is_not() -> None:
    """y = (x + z)^2 through 3 nodes: degree 2 is exact, order 4 of it needs degree 8."""
    truth = SQUARE.exact_moments(8)
    plain = QuadraturePropagation(SQUARE.inputs, Exact(SQUARE), TensorGauss(3))
    expanded = ProjectedPropagation(SQUARE.inputs, Exact(SQUARE), 3, 2)
    exact = expanded.moments(SQUARE.alpha, 8, gradient=False)
    np.testing.assert_allclose(exact.standardized, truth[2], rtol=1e-9, atol=1e-9)
    coarse = plain.moments(SQUARE.alpha, 8, gradient=False)
    np.testing.assert_allclose(coarse.sd, truth[1], rtol=1e-12)  # degree 4 of at most 5
    assert np.all(np.abs(coarse.standardized[:, 4] / truth[2][:, 4] - 1.0) > 1e-3)


@pytest.mark.parametrize("s", [0.3, 1.0])
def test_the_error_of_the_mean_falls_as_theory_says(s) -> None:
    """E[exp(s theta)]: the q-point rule errs by q! s^(2q)/(2q)! times exp(s xi) at some xi."""
    inputs = Inputs({"x": Normal(mean=Free(-1.0, 1.0), sd=Free(0.1, 2.0))})
    response = DirectResponse(lambda _, x: np.exp(x[:, 0]), 1, inputs.box)
    for q in (2, 3, 4, 5):
        found = QuadraturePropagation(inputs, response, TensorGauss(q)).moments(
            np.array([0.0, s]), 2, gradient=False
        )
        error = math.exp(0.5 * s**2) - found.mean[0]
        leading = math.factorial(q) * s ** (2 * q) / math.factorial(2 * q)
        # exp(s xi) averages to exp(s^2/2) (2q+1)-point spread: between 1 and 1.5 exp(s^2/2)
        assert leading < error < 1.5 * math.exp(0.5 * s**2) * leading


# ------------------------------------------------------------------------------ choices, misuse


@pytest.mark.parametrize(
    "make",
    [
        lambda: Collocation(nodes=1),
        lambda: Collocation(nodes=101),
        lambda: Collocation(moments="pce"),  # type: ignore[arg-type]
        lambda: Collocation(nodes=5, degree=5),
        lambda: Collocation(degree=0),
        lambda: Collocation(difference_step=0.0),
        lambda: check_nodes(1),
        lambda: Collocation(nodes=SobolPoints(64), moments="expansion"),
        lambda: Collocation(fit=TotalDegree(2)),  # type: ignore[arg-type]
        lambda: Collocation(nodes=5, fit=Regression(TotalDegree(2))),
    ],
)
def test_misuse_has_a_remedy(make) -> None:
    with pytest.raises(InputsError) as caught:
        make()
    assert caught.value.remedy


# ------------------------------------------------ expansions in the normal germ, of many parameters


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


def test_jacobians_in_the_germ_are_those_of_differences() -> None:
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


def test_a_degree_that_moves_with_alpha_is_not_taken() -> None:
    chosen = Collocation(fit=Regression(TotalDegree(2)))
    assert chosen.fit == Regression(TotalDegree(2), adaptive=False)
    assert chosen.name == "collocation(regression)"
