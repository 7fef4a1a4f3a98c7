"""The earth mover's distance: the transport problem, closed forms, axioms; densities compared."""

from __future__ import annotations

import numpy as np
import pytest
from problems import SQUARE, Problem
from scipy import optimize, stats

from aleator import ResponseSurface
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.likelihood.level_sets.predicted import PointPredictor
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem as Prepared
from aleator.likelihood.problem import prepare
from aleator.moments.densities import FittedGaussian, Gaussian
from aleator.moments.distances import earth_movers_distance
from aleator.moments.likelihood import density_distances
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments, NodeOutcomes
from aleator.observations.experiments import Experiments
from aleator.results.values import DensityDistance
from aleator.simulators import Runner, as_simulator


def normal(mean: float, sd: float) -> FittedGaussian:
    return FittedGaussian(Moments(np.array([mean]), np.array([sd]), np.array([[1.0, 0.0, 1.0]])))


def transport(x: Array, u: Array, y: Array, v: Array) -> float:
    """The linear program of the definition: what leaves x_i, what arrives at y_j, least work."""
    cost = np.abs(x[:, None] - y).ravel()
    leaves = np.kron(np.eye(x.size), np.ones(y.size))
    arrives = np.kron(np.ones(x.size), np.eye(y.size))
    solution = optimize.linprog(
        cost, A_eq=np.vstack([leaves, arrives]), b_eq=np.concatenate([u, v]), bounds=(0, None)
    )
    return float(solution.fun)


def test_the_transport_problem() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        x, y = rng.normal(size=7), rng.normal(1.0, 2.0, size=9)
        u, v = rng.dirichlet(np.ones(7)), rng.dirichlet(np.ones(9))
        found = earth_movers_distance(NodeOutcomes(x[None], u), NodeOutcomes(y[None], v))
        np.testing.assert_allclose(found, transport(x, u, y, v), rtol=1e-9)


def test_scipy_on_batches_of_samples() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(5, 40)), rng.exponential(size=(5, 31))
    expected = [stats.wasserstein_distance(*pair) for pair in zip(a, b, strict=True)]
    np.testing.assert_allclose(earth_movers_distance(a, b), expected, rtol=1e-12)
    one = [stats.wasserstein_distance(row, b[0]) for row in a]
    np.testing.assert_allclose(earth_movers_distance(a, b[0]), one, rtol=1e-12)


@pytest.mark.parametrize(
    ("mean", "sd"), [(0.0, 1.0), (2.0, 1.0), (0.0, 3.0), (1.0, 1.5), (0.3, 0.05), (-40.0, 2.0)]
)
def test_two_normals(mean: float, sd: float) -> None:
    """The optimal plan is monotone, so the distance is E|m + s Z|, a folded normal's mean."""
    m, s = mean, sd - 1.0
    exact = abs(m) if s == 0.0 else float(stats.foldnorm.mean(abs(m / s)) * abs(s))
    found = earth_movers_distance(normal(0.0, 1.0), normal(mean, sd))
    np.testing.assert_allclose(found, exact, rtol=1e-7, atol=1e-12)


def test_wrong_laws_are_refused() -> None:
    nodes = np.array([[0.0, 1.0]])
    for bad in (
        NodeOutcomes(nodes, np.array([1.5, -0.5])),
        NodeOutcomes(nodes, np.array([0.5, 0.6])),
        NodeOutcomes(nodes * np.nan, np.array([0.5, 0.5])),
        np.zeros((2, 2, 2)),
        np.zeros((1, 0)),
    ):
        with pytest.raises(InputsError):
            earth_movers_distance(bad, [0.0])
    with pytest.raises(InputsError, match="2 and of 3 experiments"):
        earth_movers_distance(np.zeros((2, 4)), np.zeros((3, 4)))


def test_a_point_mass_and_no_density() -> None:
    m = Moments(np.array([1.0, np.nan]), np.array([0.0, 1.0]), np.ones((2, 3)))
    found = earth_movers_distance(Gaussian().fit(m, -np.inf, np.inf), [[3.0], [3.0]])
    np.testing.assert_allclose(found, [2.0, np.nan])


def prepared(problem: Problem, density) -> Prepared:
    table = Experiments.from_frame(problem.table(problem.draw(0)), outcome="y")
    runner = Runner(as_simulator(problem.simulator, True), table, problem.inputs.names)
    model = Model(problem.inputs, ResponseSurface(tolerance=1e-3), density)
    return prepare(runner, table.outcomes, model, problem.inputs.box)


def compared(ready: Prepared, problem: Problem) -> dict[str, DensityDistance]:
    """The distances from the exact distributions of the outcomes."""
    own = ready.predictor
    points = PointPredictor(problem.inputs, ready.response, ready.condition, own.lower, own.upper)
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
