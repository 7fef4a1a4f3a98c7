"""The convolution with the noise: exact where nodes suffice, and honest where they do not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from aleator.densities import (
    DEGENERATE_VALUE,
    FAILED_SOLVE_PENALTY,
    Convolution,
    FittedConvolution,
    NodeSensitivity,
    Status,
)
from aleator.densities.convolution import ripple
from aleator.densities.outcomes import Outcomes
from aleator.errors import InputsError
from aleator.polynomials.gauss import gauss_hermite
from aleator.types import Array


def fit(y: Array, weights: Array, noise_sd: float) -> FittedConvolution:
    return Convolution().fit_nodes(Outcomes(y, weights), noise_sd, -np.inf, np.inf)


def normal_nodes(count: int) -> tuple[Array, Array]:
    """Midpoints of equal probability of the standard normal law."""
    return stats.norm.ppf((np.arange(count) + 0.5) / count), np.full(count, 1.0 / count)


def assert_finite(found: NodeSensitivity) -> None:
    for name in found.__dataclass_fields__:
        assert np.isfinite(getattr(found, name)).all(), name


def test_a_linear_simulator_gives_a_normal_density() -> None:
    x, w = gauss_hermite(80)
    mean, slope, noise = np.array([0.0, 3.0]), np.array([1.0, -2.0]), 1.0
    fitted = fit(mean[:, None] + slope[:, None] * x, w, noise)
    assert fitted.status.tolist() == [Status.SOLVED, Status.SOLVED]
    sd = np.hypot(slope, noise)
    y = mean[:, None] + sd[:, None] * np.linspace(-3, 3, 13)
    exact = stats.norm(mean[:, None], sd[:, None])
    # the nodes of the steeper one lie 0.5 noise apart
    np.testing.assert_allclose(fitted.log_pdf(y), exact.logpdf(y), atol=1e-6)
    np.testing.assert_allclose(fitted.cdf(y), exact.cdf(y), atol=1e-6)
    p = np.array([0.001, 0.3, 0.5, 0.999])
    np.testing.assert_allclose(fitted.quantile(p), exact.ppf(p), atol=1e-5)


def test_a_lognormal_simulator_with_noise() -> None:
    x, w = gauss_hermite(400)
    noise, y = 0.3, np.array([-0.2, 0.4, 1.0, 2.5, 4.0])
    fitted = fit(np.exp(0.5 * x)[None], w, noise)
    for at in y:
        exact = integrate.quad(
            lambda t, at=at: stats.norm.pdf(t) * stats.norm.pdf(at, np.exp(0.5 * t), noise), -9, 9
        )[0]
        np.testing.assert_allclose(fitted.pdf([[at]])[0, 0], exact, rtol=1e-6)


def test_distribution_function_and_quantiles_agree() -> None:
    rng = np.random.default_rng(0)
    y, w = rng.normal(size=(3, 30)), rng.dirichlet(np.ones(30))
    fitted = fit(y, w, 0.7)
    p = np.array([0.0, 1e-9, 0.2, 0.9, 1.0])
    q = fitted.quantile(p)
    assert q[:, [0, -1]].tolist() == [[-np.inf, np.inf]] * 3
    np.testing.assert_allclose(fitted.cdf(q), np.tile(p, (3, 1)), atol=1e-13)
    h = 1e-5
    slope = (fitted.cdf(q[:, 2:4] + h) - fitted.cdf(q[:, 2:4] - h)) / (2 * h)
    np.testing.assert_allclose(fitted.pdf(q[:, 2:4]), slope, rtol=1e-6)


def coarse_and_fine() -> tuple[Array, Array, float]:
    """Row 0 resolves the noise, row 1 is a row of spikes."""
    rng = np.random.default_rng(1)
    x = np.sort(rng.uniform(-1, 1, 6))
    return np.stack([x, 40.0 * x]), rng.dirichlet(5.0 * np.ones(6)), 0.8


@pytest.mark.parametrize("place", [-6.0, 0.3, 4.0])
def test_every_partial_by_differences(place: float) -> None:
    nodes, w, noise = coarse_and_fine()
    fitted = fit(nodes, w, noise)
    assert fitted.status.tolist() == [Status.SOLVED, Status.TOO_COARSE]
    y = np.array([place, 5.0 * place])
    found = fitted.node_sensitivity(y)
    h = 1e-5
    for j in range(6):
        unit = h * np.eye(6)[j]
        up, down = (
            fit(nodes + sign * unit, w, noise).node_sensitivity(y).value for sign in (1, -1)
        )
        np.testing.assert_allclose(found.d_y[:, j], (up - down) / (2 * h), rtol=1e-6, atol=1e-8)
        # a change of one weight alone leaves the sum of one, so two change together
        shift = unit - h * np.eye(6)[(j + 1) % 6]
        up, down = (
            fit(nodes, w + sign * shift, noise).node_sensitivity(y).value for sign in (1, -1)
        )
        both = found.d_weights[:, j] - found.d_weights[:, (j + 1) % 6]
        np.testing.assert_allclose(both, (up - down) / (2 * h), rtol=1e-6, atol=1e-7)
    up, down = (fit(nodes, w, noise + sign * h).node_sensitivity(y).value for sign in (1, -1))
    np.testing.assert_allclose(found.d_noise, (up - down) / (2 * h), rtol=1e-6, atol=1e-8)


def test_value_is_the_log_pdf_and_the_stand_in_pays_the_penalty() -> None:
    nodes, w, noise = coarse_and_fine()
    fitted, y = fit(nodes, w, noise), np.array([0.4, -3.0])
    honest, seen = fitted.log_pdf(y), fitted.node_sensitivity(y).value
    np.testing.assert_allclose(seen, honest - [0.0, FAILED_SOLVE_PENALTY], rtol=1e-13)
    mean = nodes[1] @ w
    sd = np.sqrt((nodes[1] - mean) ** 2 @ w + noise**2)
    np.testing.assert_allclose(honest[1], stats.norm(mean, sd).logpdf(-3.0), rtol=1e-12)


def test_less_noise_than_the_nodes_resolve_never_pays() -> None:
    """An outcome that hits a node exactly: its spike would have any height."""
    x, w = gauss_hermite(20)
    best = max(
        float(fit(x[None], w, noise).node_sensitivity(x[[10]]).value[0])
        for noise in np.geomspace(1e-8, 10.0, 200)
    )
    assert best < stats.norm(0.0, 1.0).logpdf(x[10]) + 0.05


def test_clusters_of_nodes_are_spikes() -> None:
    """x_1 + x_2/1000: four hundred nodes that are to the noise only twenty."""
    x, w = gauss_hermite(20)
    y, weights = np.add.outer(x, x / 1000.0).ravel()[None], np.outer(w, w).ravel()
    assert fit(y, weights, 0.1).status.tolist() == [Status.TOO_COARSE]
    np.testing.assert_allclose(ripple(y, weights, 0.1), ripple(x[None], w, 0.1), rtol=0.02)
    assert fit(y, weights, 0.5).status.tolist() == [Status.SOLVED]


@pytest.mark.parametrize("distance", [1.6, 2.0, 2.4])
def test_ripple_of_equal_nodes_is_that_of_the_density(distance: float) -> None:
    y = distance * np.arange(60.0)[None]
    w = np.full(60, 1.0 / 60)
    f = fit(y, w, 1.0)._own(np.array([30.0 * distance]))[0]
    flat = np.log(w[0] / distance)
    assert np.expm1(f[0] - flat) == pytest.approx(ripple(y, w, 1.0)[0], rel=0.03)


def test_what_passes_as_resolved_is() -> None:
    """Mean |log f - log f of 20,001 nodes| over outcomes of the model itself, Gauss rules."""
    rng, worst = np.random.default_rng(2), 0.0
    z, e = rng.standard_normal(150), rng.standard_normal(150)
    fine, share = normal_nodes(20001)
    for simulator in (lambda x: x, lambda x: np.exp(0.6 * x), lambda x: np.tanh(3 * x)):
        scatter = np.std(simulator(fine))
        for relative in (0.1, 0.3, 1.0):
            noise = relative * scatter
            y = (simulator(z) + noise * e)[None]
            exact = fit(simulator(fine)[None], share, noise).log_pdf(y)
            for count in (10, 20, 40, 80, 160):
                x, w = gauss_hermite(count)
                fitted = fit(simulator(x)[None], w, noise)
                if not fitted.too_coarse[0]:
                    worst = max(worst, float(np.abs(fitted.log_pdf(y) - exact).mean()))
    assert 0.0 < worst < 0.08


def test_far_outcomes_and_empty_weights_stay_finite() -> None:
    nodes = np.array([[0.0, 1.0, 2.0]])
    for y in (1e3, -1e8, 1e200):
        found = fit(nodes, np.array([0.5, 0.5, 0.0]), 1.0).node_sensitivity([y])
        assert_finite(found)
        assert found.status.tolist() == [Status.SOLVED]
    # far out, the nearest node alone counts: log w - z^2/2 - log sqrt(2 pi)
    value = fit(nodes, np.array([0.5, 0.5, 0.0]), 1.0).node_sensitivity([1e3]).value
    np.testing.assert_allclose(value, np.log(0.5) + stats.norm.logpdf(999.0), rtol=1e-12)


def test_no_noise_is_no_density() -> None:
    fitted = fit(np.array([[0.0, 1.0]]), np.array([0.5, 0.5]), 0.0)
    assert fitted.status.tolist() == [Status.DEGENERATE]
    found = fitted.node_sensitivity([0.5])
    assert_finite(found)
    assert found.value.tolist() == [DEGENERATE_VALUE]
    assert fitted.log_pdf([0.5]).tolist() == [-np.inf]


def test_rows_without_finite_outcomes_spoil_no_other() -> None:
    fitted = fit(np.array([[np.nan, 1.0], [0.0, 1.0]]), np.array([0.5, 0.5]), 1.0)
    found = fitted.node_sensitivity([0.0, np.inf])
    assert_finite(found)
    assert fitted.status.tolist() == [Status.DEGENERATE, Status.SOLVED]
    assert found.status.tolist() == [Status.DEGENERATE, Status.DEGENERATE]


def test_misuse_is_refused() -> None:
    nodes, w = np.array([[0.0, 1.0]]), np.array([1.5, -0.5])
    with pytest.raises(InputsError, match="not negative"):
        fit(nodes, w, 1.0)
    with pytest.raises(InputsError, match="noise"):
        fit(nodes, np.abs(w) / 2.0, -1.0)
    with pytest.raises(InputsError, match="too few"):
        Convolution(points=1)
    with pytest.raises(InputsError, match="shape"):
        fit(nodes, np.abs(w) / 2.0, 1.0).log_pdf([0.0, 1.0])
    assert replace(Convolution(), points=50).points == 50
