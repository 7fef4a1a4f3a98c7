"""How far moment densities are from the exact one of the outcome."""

import numpy as np
import pandas as pd
import pytest
from problems import GROWTH, SQUARE, Problem
from scipy import stats

from aleator import Inputs, MaximumEntropy, Normal, ResponseSurface
from aleator.laws.inputs import law_region
from aleator.likelihood.level_sets.predicted import Predictor
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem as Prepared
from aleator.likelihood.problem import prepare
from aleator.moments.comparison import density_distances
from aleator.moments.propagation import ExpandedPropagation
from aleator.observations.experiments import Experiments
from aleator.results.values import DensityDistance
from aleator.simulators import Runner, as_simulator
from aleator.types import Array


def prepared(problem: Problem, density) -> Prepared:
    table = Experiments.from_frame(problem.table(problem.draw(0)), outcome="y")
    runner = Runner(as_simulator(problem.simulator, True), table, problem.inputs.names)
    model = Model(problem.inputs, ResponseSurface(tolerance=1e-3), density)
    return prepare(runner, table.outcomes, model, problem.inputs.box)


def compared(ready: Prepared, problem: Problem) -> dict[str, DensityDistance]:
    """The distances from the exact distributions of the outcomes."""
    own = ready.predictor
    points = Predictor(problem.inputs, ready.response, ready.condition, own.lower, own.upper)
    exact = float(problem.log_density(problem.alpha, problem.z, ready.outcomes).sum())
    rows = density_distances(ready.likelihood, problem.alpha, exact, points.under(problem.alpha))
    return {row.density: row for row in rows}


def test_distances_fall_with_the_moments_and_agree_with_the_closed_form() -> None:
    rows = compared(prepared(SQUARE, MaximumEntropy(4)), SQUARE)
    assert rows["gaussian"].mean > rows["maximum entropy, 4 moments"].mean > 0.0
    assert rows["maximum entropy, 4 moments"].mean > rows["maximum entropy, 6 moments"].mean
    assert abs(rows["maximum entropy, 6 moments"].log_likelihood) < abs(
        rows["gaussian"].log_likelihood
    )
    # the distance of the Gaussian of each experiment, from noncentral chi-square distributions
    mean, sd = SQUARE.exact_moments(2)[:2]
    u = np.linspace(-8.0, 8.0, 20_001)
    y = np.maximum(mean[:, None] + sd[:, None] * u, 0.0)
    centre = (SQUARE.alpha[0] + SQUARE.z[:, None]) / SQUARE.alpha[1]
    truth = stats.ncx2.cdf(y / SQUARE.alpha[1] ** 2, 1, centre**2)
    distance = np.trapezoid(np.abs(truth - stats.norm.cdf(u)), u, axis=1)
    assert rows["gaussian"].mean == pytest.approx(distance.mean(), abs=2e-3)
    assert rows["gaussian"].worst == pytest.approx(distance.max(), abs=2e-3)


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
    assert isinstance(ready.predictor.propagation, ExpandedPropagation)
    exact = stats.norm.logpdf(5.0 * z, 5.0 * z, z * 0.2 * 5**0.5).sum()
    assert ready.likelihood.evaluate(alpha).total == pytest.approx(exact, abs=0.02)


def test_without_noise_the_reference_is_the_density_in_closed_form() -> None:
    """GROWTH: lognormal outcomes, so that the gap in log-likelihood has a truth."""
    ready = prepared(GROWTH, MaximumEntropy(4))
    rows = compared(ready, GROWTH)
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
