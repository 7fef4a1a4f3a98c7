"""Gaussian processes of all experiments learn what these share, and say what is unknown."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from aleator.core.types import Array, Indices
from aleator.simulators.response_functions import Run
from aleator.surrogates import Surface
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, _loss
from aleator.surrogates.processes import PROCESSES, Processes
from aleator.surrogates.samples import features

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


def without_slopes(values: Array, parameters: int = 2) -> tuple[Array, Array]:
    """What runs return that give no slopes."""
    return values, np.full((*values.shape, parameters), np.nan)


def learned(function: Run, each: int = 8, most: int = PROCESSES.together) -> Processes:
    """The processes of 30 conditions after `each` runs, in groups of at most `most` runs."""
    everyone = np.arange(len(CONDITIONS))
    made = Processes(
        lambda case, x: without_slopes(function(case, x)[:, None]),
        BOX, CONDITIONS, everyone, 0 * everyone,
        settings=replace(PROCESSES, together=most, first=each),
    )  # fmt: skip
    made.begin()
    made.learn()
    return made


def told(made: Processes, site: Indices, x: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (R,) by the only process there is."""
    (group,) = made.groups
    inputs = site, np.hstack([CONDITIONS[site], made.axes.inward(x)])
    return group.posterior.mean(*inputs), group.posterior.deviation(*inputs)


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
    y = np.sin(u @ [1.0, -0.5, 2.0, 1.0]) + 0.1 * index
    return Data(index, u, y, 2, np.full((count, 2), np.nan))


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
        return covariance.between(index, u, other, v) + wide * data.trend(u) @ data.trend(v).T

    runs = data.experiment, data.u
    matrix = prior(*runs, *runs) + covariance.noise**2 * np.eye(40)
    weights = np.linalg.solve(matrix, prior(*runs, *at))
    assert found.mean(*at) == pytest.approx(weights.T @ data.y, abs=1e-5)
    left = prior(*at, *at) - prior(*at, *runs) @ weights
    assert found.joint(*at) == pytest.approx(found.variance * left, abs=1e-5)
    assert found.deviation(*at) ** 2 == pytest.approx(found.variance * np.diag(left), abs=1e-5)


@pytest.mark.parametrize("gaussian", [False, True])
def test_slopes_are_those_of_the_mean(gaussian: bool) -> None:
    covariance = replace(Covariance.first(4, 2, gaussian), individual=0.7, line=0.4)
    found = ProcessPosterior.of(covariance, some_runs(30))
    rng, step = np.random.default_rng(9), 1e-5
    at, u = rng.integers(0, 7, 12), rng.uniform(-1.2, 1.2, (12, 4))
    value, slope = found.with_slope(at, u)
    assert value == pytest.approx(found.mean(at, u))
    for i in range(2):
        by = step * np.eye(4)[2 + i]
        rise = found.mean(at, u + by) - found.mean(at, u - by)
        assert slope[:, i] == pytest.approx(rise / (2.0 * step), abs=1e-6)


def test_values_with_and_without_slopes_are_those_expected(front: Processes) -> None:
    site, x = np.arange(30), anywhere(60).reshape(30, 2, 2)
    values = front.means.values(site, x)
    assert front.means.with_slopes(site, x)[0] == pytest.approx(values)
    assert front.expected(site, x[:, 1]) == pytest.approx(values[:, 1])


def test_a_linear_outcome_is_exact_after_one_run_more_than_it_has_terms() -> None:
    rng = np.random.default_rng(4)
    u = rng.uniform(-1.0, 1.0, (10, 4))
    y = 3.0 + u @ [1.0, -2.0, 0.5, 4.0]
    data = Data(np.arange(10), u, y, 2, np.full((10, 2), np.nan))
    found = ProcessPosterior.of(Covariance.first(4, 2, gaussian=False), data)
    at = rng.uniform(-3.0, 3.0, (20, 4))
    assert found.mean(np.arange(20), at) == pytest.approx(3.0 + at @ [1.0, -2.0, 0.5, 4.0])
    assert found.deviation(np.arange(20), at).max() < 1e-6


# ------------------------------------------------------------------------ the processes


@pytest.fixture(scope="module")
def front() -> Processes:
    return learned(moving_front)


def test_a_front_that_moves_with_the_conditions_takes_eight_runs_an_experiment(
    front: Processes,
) -> None:
    surface = front.surface(anywhere())
    error = true_error(surface, moving_front, anywhere())
    assert surface.total_runs == 240
    assert np.quantile(error / surface.scatter, 0.9) < 0.02
    assert np.median(error / surface.error) < 2.0


def test_what_no_condition_explains_is_told_by_the_error() -> None:
    surface = learned(unexplained).surface(anywhere())
    error = true_error(surface, unexplained, anywhere())
    assert np.median(error) < 2.0 * np.median(surface.error)
    assert np.median(surface.error / surface.scatter) > 0.02


def test_groups_of_experiments_serve_where_one_process_would_be_too_large() -> None:
    apart = learned(moving_front, most=120)
    assert len(apart.groups) == 4
    error = true_error(apart.surface(anywhere()), moving_front, anywhere())
    assert np.quantile(error, 0.9) < 0.05


def test_new_values_lie_as_far_from_those_expected_as_the_process_says(front: Processes) -> None:
    cases, x = np.arange(30), anywhere(30)
    away = learned(moving_front).make(cases, x)
    mean, sd = told(front, cases, x)
    off = moving_front(cases, x) - mean
    noise = front.groups[0].posterior.noise
    assert away == pytest.approx(off / np.hypot(sd, np.sqrt(noise)))
    assert np.sqrt(np.mean(away**2)) < 2.5


def test_the_covariance_of_sums_is_that_of_the_values(front: Processes) -> None:
    site, x = np.array([3, 3, 17]), anywhere(3)
    whole = front.of_sums(site, x, np.eye(3))[0]
    assert np.sqrt(np.diag(whole)) == pytest.approx(told(front, site, x)[1], rel=1e-6)
    weights = np.array([[1.0, 0.0], [2.0, 1.0], [0.0, -3.0]])
    total, alone = front.of_sums(site, x, weights)
    assert total == pytest.approx(weights.T @ whole @ weights)
    assert alone[3] == pytest.approx(weights[:2].T @ whole[:2, :2] @ weights[:2])
    assert np.flatnonzero(np.abs(alone).sum(axis=(1, 2))).tolist() == [3, 17]


def test_a_run_is_made_where_it_tells_most(front: Processes) -> None:
    x = anywhere(40)
    left = told(front, np.full(40, 5), x)[1]
    (best,) = front.best(5, x)
    others = np.flatnonzero(~np.all(x == best, axis=1))
    assert len(others) == 39
    made = learned(moving_front)
    made.make(np.array([5]), best[None])
    made.fitted = len(made.x)
    made.learn()
    assert np.sum(told(made, np.full(40, 5), x)[1] ** 2) < 0.9 * np.sum(left**2)


def test_tests_lie_far_from_the_runs_of_their_condition_and_from_each_other(
    front: Processes,
) -> None:
    x, case = anywhere(60), np.repeat([5, 9], 30)
    weight = np.where(case == 5, 1.0, 0.0)
    some = front.farthest(case, x, weight, 8)
    assert np.all(case[some] == 5)
    assert len(set(some.tolist())) == 8

    def apart(of: Array, others: Array) -> Array:
        return np.abs(unit(of)[:, None] - unit(others)).max(axis=2).min(axis=1)

    seen = front.x[front.of_run == 5]
    assert some[0] == np.argmax(np.where(case == 5, apart(x, seen), 0.0))
    for k in range(1, 8):
        seen = np.vstack([seen, x[some[k - 1]]])
        assert apart(x[some[k]][None], seen)[0] == apart(x[case == 5], seen).max()
    doubled = front.farthest(case, x, np.where(np.arange(60) == 3, 1e6, weight), 2)
    assert doubled[0] == 3


@pytest.mark.parametrize(("scaled", "power"), [(True, -3.0), (False, 1.0)])
def test_coordinates_are_logarithmic_where_the_values_say_so(scaled: bool, power: float) -> None:
    box, everyone = np.array([[0.1, 5.0]]), np.arange(len(CONDITIONS))

    def values(case: Indices, x: Array) -> Array:
        return ((1.0 + CONDITIONS[case, 0]) * (0.3 + x[:, 0]) ** power - CONDITIONS[case, 1])[
            :, None
        ]

    made = Processes(
        lambda case, x: without_slopes(values(case, x), 1), box, CONDITIONS, everyone, 0 * everyone
    )
    made.begin()
    made.learn()
    assert made.axes.logarithmic.tolist() == [scaled]
    x = np.geomspace(0.2, 4.0, 30)[:, None]
    truth = values(everyone, x)[:, 0]
    assert np.std(made.expected(everyone, x) - truth) < 0.02 * np.std(truth)
    made.move(np.array([[0.5, 0.9]]))
    assert made.axes.logarithmic.tolist() == [False]
    made.learn()
    assert np.isfinite(made.expected(everyone, x)).all()


def test_a_region_that_moves_keeps_the_runs() -> None:
    made = learned(moving_front)
    near = np.array([[0.3, 0.8], [2.5, 3.5]])
    made.move(near)
    made.learn()
    x = near[:, 0] + np.random.default_rng(1).random((200, 2)) * np.diff(near, axis=1).T
    error = true_error(made.surface(x), moving_front, x)
    assert made.runs.tolist() == [8] * 30
    assert np.quantile(error, 0.9) < 0.03


def test_outputs_of_one_run_have_a_process_each() -> None:
    case, column = np.repeat(np.arange(30), 2), np.tile([0, 1], 30)
    made = Processes(
        lambda index, x: without_slopes(
            np.stack([moving_front(index, x), 100.0 * unit(x)[:, 0]], axis=1)
        ),
        BOX, CONDITIONS, case, column, settings=replace(PROCESSES, first=8),
    )  # fmt: skip
    made.begin()
    made.learn()
    mean = made.expected(np.array([6, 7]), np.tile([[0.5, 3.0]], (2, 1)))
    expected = moving_front(np.array([3]), np.array([[0.5, 3.0]]))[0]
    assert mean == pytest.approx([expected, 0.0], abs=0.05)


def test_failed_runs_are_left_out_and_counted() -> None:
    def failing(index: Indices, x: Array) -> Array:
        lost = (index == 7) | ((unit(x)[:, 0] > 0.4) & (index == 4))
        return np.where(lost, np.nan, moving_front(index, x))

    surface = learned(failing).surface(anywhere())
    assert 0 < surface.failed[4] < 8
    assert surface.failed[7] == 8
    assert surface.failed.sum() == surface.failed[[4, 7]].sum()
    assert np.flatnonzero(np.isinf(surface.error)).tolist() == [7]
    error = true_error(surface, moving_front, anywhere())
    assert np.quantile(error / surface.scatter, 0.9) < 0.03


# ------------------------------------------------------------------------ the conditions


def test_conditions_over_decades_are_taken_as_logarithms() -> None:
    wide = features({"p": np.array([1.0, 10.0, 100.0])}, 3)
    narrow = features({"p": np.array([1.0, 2.0, 4.0])}, 3)
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
    assert features({"c": column}, len(column)).shape == (len(column), 0)


def test_each_row_of_a_series_is_a_condition_where_it_varies() -> None:
    dose = [np.array([1.0, 1.0, 0.0]), np.array([2.0, 2.0, 0.0]), np.array([4.0, 4.0, 1.0])]
    column = np.empty(3, dtype=object)
    column[:] = dose
    assert (
        pytest.approx(np.array([[-1.0, -1.0 / 3.0, 1.0], [-1.0, -1.0, 1.0]]))
        == features({"dose": column}, 3).T
    )
