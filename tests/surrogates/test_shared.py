"""One surface for all experiments: it learns what they share, and says what it does not know."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from aleator.core.types import Array, Indices
from aleator.errors import SimulatorError
from aleator.simulators.response_functions import Run
from aleator.surrogates import Surface
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, _loss
from aleator.surrogates.samples import features
from aleator.surrogates.shared import SharedSurface

RNG = np.random.default_rng(3)
CONDITIONS = RNG.uniform(-1.0, 1.0, (30, 2))
EFFECTS = RNG.normal(size=(30, 2))
BOX = np.array([[0.0, 1.0], [2.0, 4.0]])


def unit(x: Array) -> Array:
    return (2.0 * x - BOX.sum(axis=1)) / (BOX[:, 1] - BOX[:, 0])


def moving_front(index: Indices, x: Array) -> Array:
    c, z = CONDITIONS[index], unit(x)
    return np.tanh(1.5 * (z[:, 0] - 0.5 * z[:, 1] + c[:, 0])) + 0.3 * c[:, 1] * z[:, 1]


def unexplained(index: Indices, x: Array) -> Array:
    """Every experiment has a direction of its own, which no condition tells."""
    z = unit(x)
    return np.sin(EFFECTS[index, 0] + (z * (1.0 + EFFECTS[index, 1:])).sum(axis=1) * 1.5)


def judged(function: Run, likely: Array | None = None) -> SharedSurface:
    shared = SharedSurface(function, BOX, CONDITIONS)
    shared.judge(anywhere() if likely is None else likely)
    return shared


def surface_of(shared: SharedSurface) -> Surface:
    return shared.surface(~shared.rough(0.1, 1e-6))


def true_error(surface: Surface, function: Run, x: Array) -> Array:
    count = len(CONDITIONS)
    truth = function(np.repeat(np.arange(count), len(x)), np.tile(x, (count, 1)))
    return np.sqrt(((surface.evaluate(x) - truth.reshape(count, -1)) ** 2).mean(axis=1))


def anywhere(points: int = 300) -> Array:
    return BOX[:, 0] + np.random.default_rng(7).random((points, 2)) * np.diff(BOX, axis=1).T


def some_runs(count: int) -> Data:
    rng = np.random.default_rng(5)
    index = rng.integers(0, 6, count)
    u = np.hstack([CONDITIONS[index], rng.uniform(-1.0, 1.0, (count, 2))])
    return Data(index, u, np.sin(u @ [1.0, -0.5, 2.0, 1.0]) + 0.1 * index, 2)


# ------------------------------------------------------------------------ the process


@pytest.mark.parametrize("gaussian", [False, True])
def test_the_gradient_of_the_loss_is_that_of_finite_differences(gaussian: bool) -> None:
    data, start = some_runs(30), Covariance.first(4, 2, gaussian)
    start = start.moved(start.vector + 0.2 * np.random.default_rng(1).normal(size=21))
    expected = approx_fprime(
        start.vector, lambda vector: _loss(start.moved(vector), data, PROCESS)[0], 1e-6
    )
    assert _loss(start, data, PROCESS)[1] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("gaussian", [False, True])
def test_leave_one_out_is_that_of_the_process_without_the_run(gaussian: bool) -> None:
    data, covariance = some_runs(25), Covariance.first(4, 2, gaussian)
    whole, out = ProcessPosterior.of(covariance, data), np.array([11])
    without = ProcessPosterior.of(covariance, data.take(np.flatnonzero(np.arange(25) != 11)))
    at = data.experiment[out], data.u[out]
    spread = np.sqrt(
        whole.variance * (without.deviation(*at) ** 2 / without.variance + covariance.noise**2)
    )
    assert whole.surprise[11] == pytest.approx(
        ((data.y[out] - without.mean(*at)) / spread)[0], rel=1e-6
    )


def test_the_process_is_the_limit_of_a_trend_with_a_wide_normal_prior() -> None:
    data, covariance = some_runs(40), Covariance.first(4, 2, gaussian=False)
    found, wide = ProcessPosterior.of(covariance, data), 1e4
    at = np.arange(3), np.hstack([CONDITIONS[:3], [[0.2, -0.4], [0.9, 0.9], [-1.5, 0.1]]])

    def prior(index: Indices, u: Array, other: Indices, v: Array) -> Array:
        return covariance.between(index, u, other, v) + wide * (1.0 + u @ v.T)

    runs = data.experiment, data.u
    matrix = prior(*runs, *runs) + covariance.noise**2 * np.eye(40)
    weights = np.linalg.solve(matrix, prior(*runs, *at))
    assert found.mean(*at) == pytest.approx(weights.T @ data.y, abs=1e-5)
    left = prior(*at, *at) - prior(*at, *runs) @ weights
    assert found.joint(*at) == pytest.approx(found.variance * left, abs=1e-5)
    assert found.deviation(*at) ** 2 == pytest.approx(found.variance * np.diag(left), abs=1e-5)


def test_a_linear_outcome_is_exact_after_one_run_more_than_it_has_terms() -> None:
    rng = np.random.default_rng(4)
    u = rng.uniform(-1.0, 1.0, (6, 4))
    data = Data(np.arange(6), u, 3.0 + u @ [1.0, -2.0, 0.5, 4.0], 2)
    found = ProcessPosterior.of(Covariance.first(4, 2, gaussian=False), data)
    at = rng.uniform(-3.0, 3.0, (20, 4))
    assert found.mean(np.arange(20), at) == pytest.approx(3.0 + at @ [1.0, -2.0, 0.5, 4.0])
    assert found.deviation(np.arange(20), at).max() < 1e-6


# ------------------------------------------------------------------------ the surfaces


@pytest.fixture(scope="module")
def front() -> SharedSurface:
    return judged(moving_front)


def test_a_front_that_moves_with_the_conditions_takes_eight_runs_an_experiment(
    front: SharedSurface,
) -> None:
    surface = surface_of(front)
    error = true_error(surface, moving_front, anywhere())
    assert surface.total_runs == 240
    assert np.quantile(error / surface.scatter, 0.9) < 0.02
    assert np.mean(error <= surface.error) > 0.75
    assert np.all(error <= 2.5 * surface.error)
    assert np.all(surface.converged)


def test_what_no_condition_explains_is_told_by_the_error() -> None:
    surface = surface_of(judged(unexplained))
    assert np.median(surface.error / surface.scatter) > 0.5
    assert not np.any(surface.converged)


def test_runs_are_placed_where_the_law_is_and_earlier_ones_still_count() -> None:
    rng = np.random.default_rng(2)
    law = rng.normal([0.7, 3.5], [0.05, 0.1], (500, 2))
    shared = judged(moving_front, law)
    before = true_error(surface_of(shared), moving_front, law)
    shared.sharpen(np.arange(5, 30), law, 0.5, 1000)
    shared.judge(law)
    fresh = shared.samples.x[240:]
    assert shared.runs.tolist() == [8] * 5 + [12] * 25
    assert np.mean(np.all(np.abs(fresh - [0.7, 3.5]) < [0.2, 0.4], axis=1)) > 0.6
    after = true_error(surface_of(shared), moving_front, law)
    assert np.median(after) < 0.5 * np.median(before)
    assert np.mean(after <= shared.error) > 0.8


def test_failed_runs_are_left_out_and_counted() -> None:
    def failing(index: Indices, x: Array) -> Array:
        lost = (index == 7) | ((unit(x)[:, 0] > 0.4) & (index == 4))
        return np.where(lost, np.nan, moving_front(index, x))

    surface = surface_of(judged(failing))
    assert 0 < surface.failed[4] < 8
    assert surface.failed[7] == 8
    assert surface.failed.sum() == surface.failed[[4, 7]].sum()
    assert np.flatnonzero(np.isinf(surface.error)).tolist() == [7]
    error = true_error(surface, moving_front, anywhere())
    assert np.quantile(error / surface.scatter, 0.9) < 0.03


def test_an_infinite_outcome_is_refused() -> None:
    with pytest.raises(SimulatorError, match="infinite"):
        SharedSurface(lambda index, _: np.full(len(index), np.inf), BOX, CONDITIONS)


# ------------------------------------------------------------------------ the conditions


def test_conditions_over_decades_are_taken_as_logarithms() -> None:
    wide = features({"p": np.array([1.0, 10.0, 100.0])})
    narrow = features({"p": np.array([1.0, 2.0, 4.0])})
    assert wide.ravel() == pytest.approx([-1.0, 0.0, 1.0])
    assert narrow.ravel() == pytest.approx([-1.0, -1.0 / 3.0, 1.0])


@pytest.mark.parametrize(
    "column",
    [
        np.full(4, 2.0),
        np.array([1.0, np.nan, 2.0, 3.0]),
        np.array([f"specimen {k}" for k in range(8)], dtype=object),
        np.full(4, "oil", dtype=object),
    ],
)
def test_conditions_that_tell_nothing_are_not_shared_by(column: NDArray[np.generic]) -> None:
    assert features({"c": column}) is None
