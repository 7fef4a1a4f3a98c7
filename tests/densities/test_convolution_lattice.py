"""Convolutions over a lattice of the germ: closed forms of one, two and three parameters."""

import numpy as np
import pytest
from scipy import stats

from aleator.moments.densities import (
    DEGENERATE_VALUE,
    FAILED_SOLVE_PENALTY,
    Convolution,
    FittedConvolution,
    Status,
)
from aleator.moments.densities.outcomes import Outcomes
from aleator.errors import InputsError
from aleator.laws import Normal
from aleator.laws.inputs import Inputs
from aleator.polynomials.gauss import gauss_hermite
from aleator.moments.quadrature import GermGrid, Nodes
from aleator.types import Array

SD_V, SD_K = 0.4, 0.5


def germ(per_dimension: int, dimensions: int) -> Nodes:
    inputs = Inputs({f"x{i}": Normal(0.0, 1.0) for i in range(dimensions)})
    return GermGrid(per_dimension).nodes(inputs, np.tile([0.0, 1.0], dimensions))


def fit(y: Array, nodes: Nodes) -> FittedConvolution:
    outcomes = Outcomes(np.atleast_2d(y), nodes.weights, lattice=nodes.lattice)
    return Convolution().fit_nodes(outcomes, -np.inf, np.inf)


def saturation(a: Array, b: Array) -> Array:
    """Michaelis and Menten's law at concentration 2, V and K lognormal."""
    return np.exp(SD_V * a) * 2.0 / (2.0 + np.exp(SD_K * b))


def exact_saturation(y: Array) -> Array:
    """Given K the outcome is lognormal; K by a Gauss rule, since that is smooth."""
    x, w = gauss_hermite(60)
    scale = 2.0 / (2.0 + np.exp(SD_K * x))
    return np.log(stats.lognorm.pdf(y[:, None], SD_V, scale=scale) @ w)


def test_two_parameters() -> None:
    rng, nodes = np.random.default_rng(0), germ(61, 2)
    y = saturation(*rng.standard_normal((2, 400)))
    fitted = fit(saturation(*nodes.x.T), nodes)
    assert fitted.status.tolist() == [Status.SOLVED]
    error = fitted.log_pdf(y[None])[0] - exact_saturation(y)
    assert np.abs(error).mean() < 1e-3
    assert np.abs(error).max() < 2e-2  # in the tails; 0.014 measured


def test_the_error_falls_with_the_fourth_power_of_the_step() -> None:
    y = np.linspace(0.3, 2.0, 40)
    exact, errors = exact_saturation(y), []
    for count in (41, 81):
        nodes = germ(count, 2)
        fitted = fit(saturation(*nodes.x.T), nodes)
        errors.append(np.sqrt(np.mean((fitted.log_pdf(y[None])[0] - exact) ** 2)))
    # the width is somewhat more than in proportion to the step
    assert 8.0 < errors[0] / errors[1] < 25.0


@pytest.mark.parametrize("dimensions", [1, 2, 3])
def test_a_linear_outcome_is_exact(dimensions: int) -> None:
    nodes = germ({1: 101, 2: 61, 3: 25}[dimensions], dimensions)
    slopes = np.array([1.0, -0.6, 0.3])[:dimensions]
    fitted = fit(2.0 + nodes.x @ slopes, nodes)
    exact = stats.norm(2.0, np.sqrt(slopes @ slopes))
    y = exact.mean() + exact.std() * np.linspace(-3.0, 3.0, 201)
    np.testing.assert_allclose(fitted.log_pdf(y[None])[0], exact.logpdf(y), atol=3e-4)
    np.testing.assert_allclose(fitted.cdf(y[None])[0], exact.cdf(y), atol=2e-5)
    assert fitted.around.bend[0] < 1e-9


@pytest.mark.parametrize(("per_dimension", "dimensions"), [(25, 1), (31, 2), (21, 3)])
def test_partials_by_differences(per_dimension: int, dimensions: int) -> None:
    rng, nodes = np.random.default_rng(3), germ(per_dimension, dimensions)
    slopes = 0.25 * rng.standard_normal((3, dimensions))
    at_nodes = np.exp(slopes @ nodes.x.T)
    way, step = 0.3 * slopes @ nodes.x.T * at_nodes, 1e-5
    own = np.exp(np.array([0.1, -0.2, 0.3]) * np.linalg.norm(slopes, axis=1))

    def value(y: Array) -> Array:
        return fit(y, nodes).node_sensitivity(own).value

    found = fit(at_nodes, nodes).node_sensitivity(own)
    assert found.status.tolist() == [Status.SOLVED] * 3
    slope = (value(at_nodes + step * way) - value(at_nodes - step * way)) / (2.0 * step)
    np.testing.assert_allclose((found.d_y * way).sum(axis=1), slope, rtol=1e-5, atol=1e-7)
    assert not found.d_weights.any()


def test_a_product_of_three_is_too_coarse_and_the_normal_stands_in() -> None:
    nodes = germ(25, 3)
    a, b, c = nodes.x.T
    y = np.stack([a * b + 0.01 * c, a + 0.1 * b + 0.1 * c])
    fitted, own = fit(y, nodes), np.array([0.4, 0.2])
    assert fitted.status.tolist() == [Status.TOO_COARSE, Status.SOLVED]
    honest, seen = fitted.log_pdf(own), fitted.node_sensitivity(own).value
    np.testing.assert_allclose(honest[0], stats.norm(0.0, 1.0001**0.5).logpdf(0.4), rtol=1e-4)
    np.testing.assert_allclose(seen, honest - [FAILED_SOLVE_PENALTY, 0.0], rtol=1e-9)


def test_partials_of_the_normal_that_stands_in_by_differences() -> None:
    nodes, step = germ(25, 3), 1e-5
    a, b, c = nodes.x.T
    y, way = (a * b + 0.01 * c)[None], (a * b + 0.3 * (a * b) ** 2)[None]
    up, down = (fit(y + s * step * way, nodes).node_sensitivity([0.7]).value for s in (1.0, -1.0))
    found = fit(y, nodes).node_sensitivity([0.7])
    assert found.status.tolist() == [Status.TOO_COARSE]
    np.testing.assert_allclose((found.d_y * way).sum(), (up - down)[0] / (2.0 * step), rtol=1e-5)


def test_distribution_function_and_quantiles_agree() -> None:
    nodes = germ(41, 2)
    fitted = fit(saturation(*nodes.x.T), nodes)
    p = np.array([0.0, 1e-6, 0.2, 0.9, 1.0])
    q = fitted.quantile(p)
    assert q[:, [0, -1]].tolist() == [[-np.inf, np.inf]]
    np.testing.assert_allclose(fitted.cdf(q)[0], p, atol=1e-12)


def test_no_scatter_and_no_bounds_stay_finite() -> None:
    nodes = germ(41, 2)
    plain = nodes.x.sum(axis=1)
    lost = np.where(np.arange(plain.size) == 7, np.nan, plain)
    wild, still = np.exp(60.0 * nodes.x[:, 0]), np.full(plain.size, 3.0)
    fitted = fit(np.stack([still, wild, lost, plain, plain]), nodes)
    found = fitted.node_sensitivity([3.0, 1.0, 0.0, 1e200, np.inf])
    assert found.status.tolist() == [*[Status.DEGENERATE] * 3, Status.SOLVED, Status.DEGENERATE]
    assert found.value[:3].tolist() == [DEGENERATE_VALUE] * 3
    assert fitted.log_pdf(np.zeros(5))[:3].tolist() == [-np.inf] * 3
    for partial in (found.value, found.d_y, found.d_weights):
        assert np.isfinite(partial).all()


def test_misuse_is_refused() -> None:
    nodes = germ(41, 1)
    with pytest.raises(InputsError, match="not negative"):
        Convolution().fit_nodes(Outcomes(nodes.x.T, -nodes.weights), -np.inf, np.inf)
    with pytest.raises(InputsError, match="lattice"):
        Convolution().fit_nodes(Outcomes(nodes.x.T, nodes.weights), -np.inf, np.inf)
    with pytest.raises(InputsError, match="too few"):
        Convolution(points=1)
    with pytest.raises(InputsError, match="shape"):
        fit(nodes.x.T, nodes).log_pdf([0.0, 1.0])
