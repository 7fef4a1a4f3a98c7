"""Without noise the lattice gives the density of the outcome itself: against closed forms."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from aleator.moments.densities import Convolution, FittedConvolution, Status
from aleator.moments.densities.outcomes import Outcomes
from aleator.moments.densities.stand_in import BEYOND
from aleator.laws import Normal, TruncatedNormal, Uniform
from aleator.laws.inputs import Inputs
from aleator.moments.quadrature import GermGrid
from aleator.types import Array

NORMAL = Inputs({"x": Normal(0.0, 1.0)})
TWO = Inputs({"x": Normal(0.0, 1.0), "z": Normal(0.0, 1.0)})
FLAT = Inputs({"x": Uniform(mean=0.5, sd=12.0**-0.5)})
FLATS = Inputs({name: Uniform(mean=0.5, sd=12.0**-0.5) for name in "xz"})
CUT = Inputs({"x": TruncatedNormal((0.0, 1.0), mean=0.1, sd=0.3)})
P = np.array([1e-4, 1e-3, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999, 1.0 - 1e-4])


def fit(y: Array, inputs: Inputs = NORMAL, per_dimension: int = 401) -> FittedConvolution:
    alpha = np.array([h.start for h in inputs.hyperparameters])
    nodes = GermGrid(per_dimension).nodes(inputs, alpha)
    outcomes = Outcomes(np.atleast_2d(y), nodes.weights, lattice=nodes.lattice)
    return Convolution().fit_nodes(outcomes, -np.inf, np.inf)


def at_nodes(
    eta: Callable[..., Array], inputs: Inputs = NORMAL, per_dimension: int = 401
) -> FittedConvolution:
    alpha = np.array([h.start for h in inputs.hyperparameters])
    x = GermGrid(per_dimension).nodes(inputs, alpha).x
    return fit(eta(*x.T), inputs, per_dimension)


@pytest.mark.parametrize("sd", [0.3, 0.8, 1.5])
def test_a_lognormal_outcome(sd: float) -> None:
    exact, fitted = stats.lognorm(sd), at_nodes(lambda x: np.exp(sd * x))
    assert fitted.status.tolist() == [Status.SOLVED]
    y = exact.ppf(P)[None]
    np.testing.assert_allclose(fitted.log_pdf(y)[0], exact.logpdf(y[0]), atol=2e-4)
    np.testing.assert_allclose(fitted.cdf(y)[0], P, atol=2e-5)
    np.testing.assert_allclose(fitted.quantile(P[2:-2])[0], exact.ppf(P[2:-2]), rtol=1e-4)


def test_a_law_with_hard_edges_keeps_them() -> None:
    """A germ maps to the edge slowly, so that the grid is fine where the density ends."""
    inner = P[1:-1]
    np.testing.assert_allclose(at_nodes(lambda x: x, FLAT).log_pdf(inner[None])[0], 0.0, atol=3e-4)
    law = stats.truncnorm(-1.0 / 3.0, 3.0, 0.1, 0.3)
    x = law.ppf(inner)
    found = at_nodes(lambda x: np.exp(2.0 * x), CUT).log_pdf(np.exp(2.0 * x)[None])[0]
    np.testing.assert_allclose(found, law.logpdf(x) - np.log(2.0) - 2.0 * x, atol=3e-4)


def test_a_turning_point_is_resolved_to_a_thousandth_of_the_variance() -> None:
    """y = x^2: the singularity at zero is cut where the germ is below the smoothing, 0.035."""
    exact, fitted = stats.chi2(1), at_nodes(lambda x: x**2)
    assert fitted.status.tolist() == [Status.SOLVED]
    y = exact.ppf([0.1, 0.2, 0.5, 0.9, 0.99])
    np.testing.assert_allclose(fitted.log_pdf(y[None])[0], exact.logpdf(y), atol=0.02)
    lower = exact.ppf([0.001, 0.01])
    assert (fitted.log_pdf(lower[None])[0] < exact.logpdf(lower)).all()


def test_two_parameters() -> None:
    exact = stats.lognorm(0.8)
    fitted = at_nodes(lambda x, z: np.exp(0.8 * (0.6 * x + 0.8 * z)), TWO, 61)
    y = exact.ppf(P[2:-2])
    np.testing.assert_allclose(fitted.log_pdf(y[None])[0], exact.logpdf(y), atol=0.02)
    sums, law = at_nodes(lambda x, z: x + z, FLATS, 61), stats.triang(0.5, 0.0, 2.0)
    y = law.ppf(P[3:-3])
    np.testing.assert_allclose(sums.log_pdf(y[None])[0], law.logpdf(y), atol=0.01)


def test_beyond_the_nodes_there_is_no_density_but_a_way_back() -> None:
    fitted = fit(np.stack([2.0 + 3.0 * GermGrid(401).nodes(NORMAL, np.array([0.0, 1.0])).x[:, 0]]))
    y = np.array([[2.0 + 3.0 * 7.9, 2.0 + 3.0 * 9.0, 2.0 + 3.0 * 60.0, -1e300]])
    assert np.isfinite(fitted.log_pdf(y)[0]).tolist() == [True, False, False, False]
    values = [fitted.node_sensitivity(y[:, i]) for i in range(4)]
    assert all(np.isfinite(v.value).all() and np.isfinite(v.d_y).all() for v in values)
    np.testing.assert_allclose(values[2].value, -BEYOND - np.log(3.0) - 200.0, rtol=1e-9)
    # where there is a density the continuation is nothing
    np.testing.assert_allclose(values[0].value, stats.norm.logpdf(7.9) - np.log(3.0), atol=0.03)


@pytest.mark.parametrize("place", [0.3, 2.0, 40.0, -3.0])
@pytest.mark.parametrize(("per_dimension", "inputs"), [(25, NORMAL), (31, TWO)])
def test_partials_by_differences(place: float, per_dimension: int, inputs: Inputs) -> None:
    rng = np.random.default_rng(3)
    alpha = np.array([h.start for h in inputs.hyperparameters])
    x = GermGrid(per_dimension).nodes(inputs, alpha).x
    y = np.exp(0.4 * x @ np.array([1.0, -0.5])[: x.shape[1]])
    way, step = 0.3 * rng.standard_normal(y.shape), 1e-6

    def value(nodes: Array) -> float:
        found = fit(nodes, inputs, per_dimension).node_sensitivity(np.array([place]))
        return float(found.value[0])

    found = fit(y, inputs, per_dimension).node_sensitivity(np.array([place]))
    slope = (value(y + step * way) - value(y - step * way)) / (2.0 * step)
    np.testing.assert_allclose((found.d_y[0] * way).sum(), slope, rtol=1e-5, atol=1e-6)


def test_a_point_mass_has_no_density() -> None:
    """Where the outcome saturates, its mass is missing; where it never moves there is none."""
    fitted = at_nodes(lambda x: np.minimum(x, 1.0))
    y = np.array([[-1.0, 0.5, 1.0 + 1e-12]])
    np.testing.assert_allclose(fitted.log_pdf(y)[0, :2], stats.norm.logpdf(y[0, :2]), atol=1e-4)
    assert fitted.log_pdf(y)[0, 2] < 1.0
    np.testing.assert_allclose(fitted.cdf(np.array([5.0]))[0], stats.norm.cdf(1.0), atol=0.01)
    still = at_nodes(lambda x: np.full_like(x, 3.0))
    assert still.status.tolist() == [Status.DEGENERATE]
    assert still.log_pdf(np.array([3.0])).tolist() == [-np.inf]
