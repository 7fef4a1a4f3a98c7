"""Where there is noise the default density is exact: answers are those of the exact likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from problems import FRONTIER, NOISY, Problem, log_frontier
from scipy import optimize

from aleator import Convolution, GradientMultistart, Identification, MonteCarlo, Noise, identify
from aleator.errors import InputsError


def identified(problem: Problem, y: np.ndarray, **more: object) -> Identification:
    return identify(
        problem.simulator, problem.table(y), problem.inputs, outcome="y", vectorized=True,
        noise=problem.noise, search=GradientMultistart(3), verification=MonteCarlo(0), **more,
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
    assert found.density == "convolution"
    assert found.log_likelihood.estimated == pytest.approx(-end.fun, abs=1e-3)
    for name, value in zip(("b0.value", "b1.value", "u.sd", "noise.sd"), end.x, strict=True):
        estimate = found.alpha[name]
        assert estimate.standard_error is not None
        assert abs(estimate.estimate - value) < 0.02 * estimate.standard_error
    assert found.accepted


def test_noise_of_a_thousandth_of_the_scatter_is_found_exactly() -> None:
    """Where a plain sum over nodes is a row of spikes."""
    problem = replace(NOISY, z=np.linspace(0.5, 2.0, 60), noise=Noise(1e-4))
    y = problem.draw(0, np.array([0.8, 0.4, 1e-4]))
    found = identified(problem, y)
    assert found.density == "convolution"
    assert {e.status for e in found.experiments} == {"solved"}
    alpha = np.array([found.alpha["x.mean"].estimate, found.alpha["x.sd"].estimate, 1e-4])
    exact = float(problem.log_density(alpha, problem.z, y).sum())
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.02)


def test_a_convolution_needs_noise() -> None:
    problem = replace(NOISY, noise=None)
    with pytest.raises(InputsError, match="there is no noise"):
        identified(problem, problem.draw(0, np.array([0.8, 0.4])), density=Convolution())
