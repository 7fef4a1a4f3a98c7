"""One surface for all experiments: it learns what they share, and says what it does not know."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from aleator.core.types import Array, Indices
from aleator.errors import SimulatorError
from aleator.simulators.response_functions import Run
from aleator.surrogates import Surface
from aleator.surrogates.samples import features
from aleator.surrogates.shared import Covariance, ProcessPosterior, SharedSurface, _loss

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


def some_runs(count: int) -> tuple[Indices, Array, Array]:
    rng = np.random.default_rng(5)
    index = rng.integers(0, 6, count)
    u = np.hstack([CONDITIONS[index], rng.uniform(-1.0, 1.0, (count, 2))])
    return index, u, np.sin(u @ [1.0, -0.5, 2.0, 1.0]) + 0.1 * index


# ------------------------------------------------------------------------ the process


def test_the_gradient_of_the_loss_is_that_of_finite_differences() -> None:
    index, u, y = some_runs(30)
    start = Covariance.first(4, 2)
    start = start.moved(start.vector + 0.2 * np.random.default_rng(1).normal(size=20))
    expected = approx_fprime(
        start.vector, lambda vector: _loss(start.moved(vector), index, u, y)[0], 1e-6
    )
    assert _loss(start, index, u, y)[1] == pytest.approx(expected, abs=2e-3)


def test_leave_one_out_is_that_of_the_process_without_the_run() -> None:
    index, u, y = some_runs(25)
    covariance = Covariance.first(4, 2)
    whole = ProcessPosterior.of(covariance, index, u, y)
    rest = np.arange(25) != 11
    without = ProcessPosterior.of(
        covariance, index[rest], u[rest], (y[rest] - whole.level) / whole.unit
    )
    shift = without.level + (without.mean(index[11:12], u[11:12]) - without.level)
    spread = (
        whole.unit
        * np.sqrt(whole.variance)
        * np.hypot(
            without.deviation(index[11:12], u[11:12]) / without.unit / np.sqrt(without.variance),
            covariance.noise,
        )
    )
    residual = y[11] - whole.level - whole.unit * shift
    assert whole.surprise[11] == pytest.approx((residual / spread)[0], rel=0.02)


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
