"""How far moment densities are from the exact one of the outcome."""

import numpy as np
import pandas as pd
import pytest
from problems import GROWTH, SQUARE, Problem
from scipy import integrate, stats

from aleator import Inputs, MaximumEntropy, Normal, ResponseSurface
from aleator.laws.region import law_region
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem as Prepared
from aleator.likelihood.problem import prepare
from aleator.moments.comparison import density_distances, exact_movement
from aleator.moments.propagation import ExpandedPropagation
from aleator.observations.experiments import Experiments
from aleator.simulators import Runner, as_simulator
from aleator.types import Array


def prepared(problem: Problem, density) -> Prepared:
    table = Experiments.from_frame(problem.table(problem.draw(0)), outcome="y")
    runner = Runner(as_simulator(problem.simulator, True), table, problem.inputs.names)
    model = Model(problem.inputs, ResponseSurface(tolerance=1e-3), density)
    return prepare(runner, table.outcomes, model, problem.inputs.box)


def test_distances_fall_with_the_moments_and_agree_with_integration() -> None:
    ready = prepared(SQUARE, Convolution())
    rows = {row.density: row for row in density_distances(ready, SQUARE.alpha)}
    assert rows["gaussian"].mean > rows["maximum entropy, 4 moments"].mean > 0.0
    assert rows["maximum entropy, 4 moments"].mean > rows["maximum entropy, 6 moments"].mean
    assert abs(rows["maximum entropy, 6 moments"].log_likelihood) < abs(
        rows["gaussian"].log_likelihood
    )
    # the Gaussian's distance, integrated for the first experiment by an adaptive rule
    likelihood = ready.likelihood
    fitted, moments = (
        likelihood.predictive.fitted(SQUARE.alpha),
        likelihood.predictive.moments(SQUARE.alpha),
    )
    mean, sd = moments.mean[0], moments.sd[0]
    count = moments.mean.size

    def gap(u: float) -> float:
        exact = fitted.cdf(np.full(count, mean + sd * u))[0]
        return abs(float(exact) - float(stats.norm.cdf(u)))

    distance = integrate.quad(gap, -8.0, 8.0, limit=200, points=[0.0])[0]
    assert rows["gaussian"].worst >= distance - 2e-3
    assert rows["gaussian"].mean <= rows["gaussian"].worst


def test_of_five_parameters_the_moments_are_an_expansion_s() -> None:
    """A sum of five normals is normal: the density of the moments is the exact one."""
    z = np.linspace(0.5, 1.5, 6)
    names = [f"x{i}" for i in range(5)]
    inputs = Inputs({name: Normal(1.0, 0.2) for name in names})

    def total(z: Array, x0: Array, x1: Array, x2: Array, x3: Array, x4: Array) -> Array:
        return z * (x0 + x1 + x2 + x3 + x4)

    table = Experiments.from_frame(pd.DataFrame({"z": z, "y": 5.0 * z}), outcome="y")
    runner = Runner(as_simulator(total, True), table, inputs.names)
    model = Model(inputs, ResponseSurface(), MaximumEntropy(4))
    alpha = np.tile([1.0, 0.2], 5)
    ready = prepare(runner, table.outcomes, model, law_region(inputs, [alpha]))
    assert isinstance(ready.predictive.propagation, ExpandedPropagation)
    exact = stats.norm.logpdf(5.0 * z, 5.0 * z, z * 0.2 * 5**0.5).sum()
    assert ready.likelihood.evaluate(alpha).total == pytest.approx(exact, abs=0.02)
    assert density_distances(ready, alpha) == ()


def test_without_noise_the_reference_is_the_density_in_closed_form() -> None:
    """GROWTH: lognormal outcomes, so that the gap in log-likelihood has a truth."""
    ready = prepared(GROWTH, MaximumEntropy(4))
    rows = {row.density: row for row in density_distances(ready, GROWTH.alpha)}
    assert (
        rows["gaussian"].mean
        > rows["maximum entropy, 4 moments"].mean
        > rows["maximum entropy, 6 moments"].mean
    )
    y = ready.likelihood.outcomes
    exact = float(GROWTH.log_density(GROWTH.alpha, GROWTH.z, y).sum())
    own = ready.likelihood.evaluate(GROWTH.alpha).total
    gap = rows["maximum entropy, 4 moments"].log_likelihood
    assert gap == pytest.approx(own - exact, abs=0.1 * abs(own - exact) + 1e-3)


def test_the_step_to_the_exact_maximum_is_told_in_standard_errors() -> None:
    """Outcomes exp(z x): the exact estimates are mean and scatter of log(y)/z."""
    ready = prepared(GROWTH, MaximumEntropy(4))
    x = np.log(ready.likelihood.outcomes) / GROWTH.z
    best = np.array([x.mean(), x.std()])
    assert exact_movement(ready, best) < 0.05
    # a step is exact to first order, where scores are those of seven experiments
    moved = np.array([best[0] + 0.2 * x.std() / np.sqrt(x.size), best[1]])
    assert exact_movement(ready, moved) == pytest.approx(0.2, rel=0.5)
    assert exact_movement(ready, best) < exact_movement(ready, moved)
    # an outcome of which the law knows nothing
    assert exact_movement(ready, np.array([best[0], 0.02])) == np.inf
