"""Where there is noise the answers are those of the exact likelihood."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from identifications import unjudged
from problems import FRONTIER, NOISY, Problem, log_frontier
from scipy import optimize

from aleator import (
    Check,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Noise,
)
from aleator.core.polynomials import gauss_hermite


def identified(problem: Problem, y: np.ndarray, **more: object) -> Identification:
    return unjudged(
        problem.simulator, problem.table(y), problem.inputs, outcome="y", vectorized=True,
        noise=problem.noise, search=GradientMultistart(3), verification=Check(0), **more,
    )  # type: ignore[arg-type]  # fmt: skip


@pytest.mark.parametrize(("sds", "seed"), [((0.7, 0.3), 1), ((1.1, 0.2), 2), ((1.6, 0.1), 3)])
def test_a_stochastic_frontier_is_found_exactly(sds: tuple[float, float], seed: int) -> None:
    """Sharp densities that meet little noise, where four moments are 0.3 to 1.3 errors off."""
    problem = replace(FRONTIER, z=np.linspace(0.0, 3.0, 100))
    y = problem.draw(seed, np.array([1.0, 0.7, 0.0, *sds]))

    def negative(p: np.ndarray) -> float:
        return -float(np.sum(log_frontier(y - p[0] - p[1] * problem.z, p[2], p[3])))

    start, bounds = np.array([1.0, 0.7, *sds]), [(-1, 5), (-1, 3), (0.02, 2.0), (0.02, 1.0)]
    end = optimize.minimize(
        negative, start, method="L-BFGS-B", bounds=bounds, tol=1e-14, options={"maxiter": 500}
    )
    found = identified(problem, y)
    assert found.density.startswith("panels")
    assert found.log_likelihood.estimated == pytest.approx(-end.fun, abs=1e-3)
    for name, value in zip(("b0.value", "b1.value", "u.sd", "noise.sd"), end.x, strict=True):
        estimate = found.alpha[name]
        assert estimate.standard_error is not None
        assert abs(estimate.estimate - value) < 0.02 * estimate.standard_error
    assert found.sound


def test_noise_of_a_thousandth_of_the_scatter_is_found_exactly() -> None:
    """Where a plain sum over nodes is a row of spikes."""
    problem = replace(NOISY, z=np.linspace(0.5, 2.0, 60), noise=Noise(1e-4))
    y = problem.draw(0, np.array([0.8, 0.4, 1e-4]))
    found = identified(problem, y)
    assert found.density.startswith("Gauss-Hermite")
    assert {e.status for e in found.experiments} == {"solved"}
    alpha = np.array([found.alpha["x.mean"].estimate, found.alpha["x.sd"].estimate, 1e-4])
    exact = float(problem.log_density(alpha, problem.z, y).sum())
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.02)


def log_saturation(alpha: np.ndarray, z: np.ndarray, y: np.ndarray) -> np.ndarray:
    """y = V z/(K + z) + e: lognormal given K; K and the noise by Gauss rules, since f is smooth."""
    x, w = gauss_hermite(50)
    variance = np.log1p((alpha[[1, 3]] / alpha[[0, 2]]) ** 2)
    middle, spread = np.log(alpha[[0, 2]]) - 0.5 * variance, np.sqrt(variance)
    share = z[:, None] / (np.exp(middle[1] + spread[1] * x) + z[:, None])
    clean = np.maximum(y[:, None] - alpha[4] * x, 1e-12)[:, :, None]
    u = (np.log(clean) - np.log(share)[:, None] - middle[0]) / spread[0]
    density = np.exp(-0.5 * u**2) / (clean * spread[0] * np.sqrt(2.0 * np.pi))
    return np.log(density @ w @ w)


SATURATION = Problem(
    "Michaelis and Menten's law with lognormal V and K, and noise",
    lambda z, v, k: v * z / (k + z),
    Inputs(
        {
            "v": LogNormal(mean=Free(3.0, 30.0), sd=Free(0.3, 15.0)),
            "k": LogNormal(mean=Free(0.3, 8.0), sd=Free(0.05, 5.0)),
        }
    ),
    np.tile([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0], 4),
    np.array([10.0, 3.0, 2.0, 0.8, 0.05]),
    lambda alpha, z, m: mpmath.nan,  # noqa: ARG005  no moments in closed form
    log_saturation,
    Noise(0.05),
)


def test_two_scattering_parameters_with_little_noise_have_the_exact_maximum() -> None:
    """Noise of 2 % of the scatter, where a plain sum over 61 x 61 nodes is a row of spikes."""
    y = SATURATION.draw(3)
    found = identified(SATURATION, y)
    noise = np.array([0.05])
    names = [h.name for h in SATURATION.inputs.hyperparameters]
    start = np.array([found.alpha[name].estimate for name in names])

    def exact(p: np.ndarray) -> float:
        return -float(log_saturation(np.append(p, noise), SATURATION.z, y).sum())

    bounds = [(h.lower, h.upper) for h in SATURATION.inputs.hyperparameters]
    truth = optimize.minimize(exact, start, method="L-BFGS-B", bounds=bounds, tol=1e-9)
    step = 1e-3 * truth.x * np.eye(4)
    exact_information = np.array(
        [
            [
                exact(truth.x + g + h)
                - exact(truth.x + g - h)
                - exact(truth.x - g + h)
                + exact(truth.x - g - h)
                for h in step
            ]
            for g in step
        ]
    ) / (4.0 * np.outer(step.sum(axis=1), step.sum(axis=1)))
    exact_errors = np.sqrt(np.diag(np.linalg.inv(exact_information)))
    errors = np.array([found.alpha[name].standard_error for name in names], dtype=np.float64)
    assert found.log_likelihood.estimated == pytest.approx(-truth.fun, abs=1e-2)
    assert np.abs((start - truth.x) / exact_errors).max() < 0.02
    np.testing.assert_allclose(errors, exact_errors, rtol=0.01)
