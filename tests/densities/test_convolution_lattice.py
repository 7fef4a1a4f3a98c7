"""Convolutions over a lattice of the germ: no spikes for any noise and any number of parameters."""

import numpy as np
import pytest
from scipy import stats

from aleator.densities import Convolution, FittedConvolution, Status
from aleator.densities.outcomes import Outcomes
from aleator.laws import Normal
from aleator.laws.inputs import Inputs
from aleator.polynomials.gauss import gauss_hermite
from aleator.quadrature import GermGrid, Nodes
from aleator.types import Array

SD_V, SD_K = 0.4, 0.5


def germ(per_dimension: int, dimensions: int) -> Nodes:
    inputs = Inputs({f"x{i}": Normal(0.0, 1.0) for i in range(dimensions)})
    return GermGrid(per_dimension).nodes(inputs, np.tile([0.0, 1.0], dimensions))


def fit(y: Array, nodes: Nodes, noise_sd: float) -> FittedConvolution:
    outcomes = Outcomes(np.atleast_2d(y), nodes.weights, lattice=nodes.lattice)
    return Convolution().fit_nodes(outcomes, noise_sd, -np.inf, np.inf)


def saturation(a: Array, b: Array) -> Array:
    """Michaelis and Menten's law at concentration 2, V and K lognormal."""
    return np.exp(SD_V * a) * 2.0 / (2.0 + np.exp(SD_K * b))


def exact_saturation(y: Array, noise_sd: float) -> Array:
    """Given K the outcome is lognormal; K and the noise by Gauss rules, since that is smooth."""
    x, w = gauss_hermite(60)
    scale = 2.0 / (2.0 + np.exp(SD_K * x))
    clean = y[:, None, None] - noise_sd * x[:, None]
    return np.log(stats.lognorm.pdf(clean, SD_V, scale=scale) @ w @ w)


@pytest.mark.parametrize("relative", [1e-6, 0.02, 0.1])
def test_two_parameters_with_little_noise(relative: float) -> None:
    rng, nodes = np.random.default_rng(0), germ(61, 2)
    at_nodes = saturation(*nodes.x.T)
    noise = relative * np.sqrt(nodes.weights @ (at_nodes - nodes.weights @ at_nodes) ** 2)
    y = saturation(*rng.standard_normal((2, 400))) + noise * rng.standard_normal(400)
    fitted = fit(at_nodes, nodes, noise)
    assert fitted.status.tolist() == [Status.SOLVED]
    error = fitted.log_pdf(y[None])[0] - exact_saturation(y, noise)
    assert np.abs(error).mean() < 1e-3
    assert np.abs(error).max() < 2e-2  # in the tails; 0.014 measured
    if relative == 0.02:
        bare = Outcomes(at_nodes[None], nodes.weights)
        spikes = Convolution().fit_nodes(bare, noise, -np.inf, np.inf).log_pdf(y[None])[0]
        assert np.abs(spikes - exact_saturation(y, noise)).mean() > 0.1


def test_the_error_falls_with_the_fourth_power_of_the_step() -> None:
    y = np.linspace(0.3, 2.0, 40)
    exact, errors = exact_saturation(y, 0.01), []
    for count in (41, 81):
        nodes = germ(count, 2)
        fitted = fit(saturation(*nodes.x.T), nodes, 0.01)
        errors.append(np.sqrt(np.mean((fitted.log_pdf(y[None])[0] - exact) ** 2)))
    # the width is somewhat more than in proportion to the step
    assert 8.0 < errors[0] / errors[1] < 25.0


@pytest.mark.parametrize("dimensions", [1, 2, 3])
@pytest.mark.parametrize("noise", [1e-9, 0.05, 2.0])
def test_a_linear_outcome_is_exact_whatever_the_noise(dimensions: int, noise: float) -> None:
    nodes = germ({1: 101, 2: 61, 3: 25}[dimensions], dimensions)
    slopes = np.array([1.0, -0.6, 0.3])[:dimensions]
    fitted = fit(2.0 + nodes.x @ slopes, nodes, noise)
    exact = stats.norm(2.0, np.sqrt(slopes @ slopes + noise**2))
    y = exact.mean() + exact.std() * np.linspace(-3.0, 3.0, 201)
    np.testing.assert_allclose(fitted.log_pdf(y[None])[0], exact.logpdf(y), atol=3e-4)
    np.testing.assert_allclose(fitted.cdf(y[None])[0], exact.cdf(y), atol=2e-5)
    assert fitted.around is not None
    assert fitted.around.bend[0] < 1e-9


def test_an_outcome_on_a_node_gains_nothing_from_less_noise() -> None:
    nodes = germ(61, 2)
    at_nodes = saturation(*nodes.x.T)
    own = at_nodes[[1576]]
    best = [fit(at_nodes, nodes, s).node_sensitivity(own).value[0] for s in (1e-8, 1e-5, 1e-3)]
    np.testing.assert_allclose(best, exact_saturation(own, 1e-5)[0], atol=2e-3)


@pytest.mark.parametrize(("per_dimension", "dimensions"), [(25, 1), (31, 2), (21, 3)])
@pytest.mark.parametrize("noise", [0.01, 0.2, 1.0])
def test_partials_by_differences(per_dimension: int, dimensions: int, noise: float) -> None:
    rng, nodes = np.random.default_rng(3), germ(per_dimension, dimensions)
    slopes = 0.25 * rng.standard_normal((3, dimensions))
    at_nodes = np.exp(slopes @ nodes.x.T)
    way, step = 0.3 * rng.standard_normal(at_nodes.shape), 1e-5

    def value(y: Array, sd: float = noise) -> Array:
        return fit(y, nodes, sd).node_sensitivity(np.array([0.8, 1.0, 2.0])).value

    found = fit(at_nodes, nodes, noise).node_sensitivity(np.array([0.8, 1.0, 2.0]))
    assert found.status.tolist() == [Status.SOLVED] * 3
    slope = (value(at_nodes + step * way) - value(at_nodes - step * way)) / (2.0 * step)
    np.testing.assert_allclose((found.d_y * way).sum(axis=1), slope, rtol=1e-5, atol=1e-7)
    up, down = (value(at_nodes, noise * (1.0 + sign * step)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(
        found.d_noise, (up - down) / (2.0 * step * noise), rtol=1e-5, atol=1e-7
    )
    assert not found.d_weights.any()


def test_a_product_of_three_is_too_coarse_and_says_so() -> None:
    nodes = germ(25, 3)
    a, b, c = nodes.x.T
    fitted = fit(np.stack([a * b + 0.01 * c, a + 0.1 * b + 0.1 * c]), nodes, 0.01)
    assert fitted.status.tolist() == [Status.TOO_COARSE, Status.SOLVED]
    np.testing.assert_allclose(fitted.pdf([0.0, 0.0])[0], stats.norm.pdf(0.0, 0.0, 1.0001), 1e-4)


def test_no_scatter_and_no_bounds_stay_finite() -> None:
    nodes = germ(41, 2)
    wild = np.exp(60.0 * nodes.x[:, 0])
    fitted = fit(np.stack([np.full(nodes.weights.size, 3.0), wild]), nodes, 0.5)
    found = fitted.node_sensitivity([3.0, 1.0])
    assert found.value[0] == pytest.approx(stats.norm.logpdf(0.0, 0.0, 0.5))
    assert found.status[1] == Status.DEGENERATE
    for partial in (found.value, found.d_y, found.d_noise):
        assert np.isfinite(partial).all()
