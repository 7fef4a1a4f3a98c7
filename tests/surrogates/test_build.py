"""Building surfaces: exact where it can be, honest where it cannot, cheap where it is easy."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.errors import InputsError, SimulatorError
from aleator.surrogates import ResponseSurface, Surface, build_surface

Function = Callable[[NDArray[np.intp], Array], Array]


def unit_box(n: int) -> Array:
    return np.tile([0.0, 1.0], (n, 1))


def chosen(tolerance: float = 0.02, **others: float) -> ResponseSurface:
    return ResponseSurface(tolerance=tolerance, **others)  # type: ignore[arg-type]


def built(run: Function, n: int, count: int, **choice: float) -> Surface:
    return build_surface(run, unit_box(n), count, chosen(**choice))


def true_error(surface: Surface, function: Function, points: int = 1000) -> Array:
    """Root-mean-square error (N,) at random points of the box that no surface has seen."""
    low, high = surface.box.T
    x = low + np.random.default_rng(7).random((points, len(low))) * (high - low)
    count = len(surface.error)
    truth = function(np.repeat(np.arange(count), points), np.tile(x, (count, 1)))
    residual = surface.evaluate(x) - truth.reshape(count, points)
    return np.sqrt((residual**2).mean(axis=1))


def front(index: NDArray[np.intp], x: Array) -> Array:
    return np.tanh(20.0 * (x[:, 0] - 0.5 * x[:, 1] - 0.3 + 0.02 * index))


def kink(index: NDArray[np.intp], x: Array) -> Array:
    return np.abs(x[:, 0] - 0.5 * x[:, 1] - 0.3 + 0.03 * index)


def waves(index: NDArray[np.intp], x: Array) -> Array:
    return np.cos(9.0 * x[:, 0] + 5.0 * x[:, 1] + index)


def smooth(index: NDArray[np.intp], x: Array) -> Array:
    return np.exp((0.2 + 0.2 * index) * x[:, 0] + x[:, 1])


def additive(index: NDArray[np.intp], x: Array) -> Array:
    return np.exp(x * np.linspace(0.1, 1.0, x.shape[1])).sum(axis=1) + index


# ------------------------------------------------------------------------ exact


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_polynomial_of_degree_two_is_exact_after_one_call(n: int) -> None:
    matrix = np.random.default_rng(n).normal(size=(n, n))
    calls = []

    def run(index: NDArray[np.intp], x: Array) -> Array:
        calls.append(len(index))
        return 3.0 + x.sum(axis=1) + (index + 1) * np.einsum("ri,ij,rj->r", x, matrix, x)

    surface = built(run, n, 3)
    assert len(calls) == 1
    assert surface.converged.all()
    assert true_error(surface, run).max() < 1e-12


# ------------------------------------------------------------------------ cheap


def test_ten_additive_parameters_need_few_runs() -> None:
    surface = built(additive, 10, 3)
    assert surface.converged.all()
    assert surface.runs.max() <= 100
    assert (true_error(surface, additive) <= surface.error).all()


def test_calls_are_few_and_every_run_is_counted() -> None:
    asked = np.zeros(5, dtype=int)
    told = []

    def run(index: NDArray[np.intp], x: Array) -> Array:
        np.add.at(asked, index, 1)
        return waves(index, x)

    surface = build_surface(run, unit_box(2), 5, chosen(), lambda *done: told.append(done))
    assert len(told) <= 15
    assert asked.tolist() == surface.runs.tolist()
    assert told[-1] == (surface.total_runs, 5, 5)
    assert [runs for runs, _, _ in told] == sorted(runs for runs, _, _ in told)


# ------------------------------------------------------------------------ convergence


def test_analytic_outcomes_converge_geometrically() -> None:
    def run(_: NDArray[np.intp], x: Array) -> Array:
        return 1.0 / (1.0 + 4.0 * (2.0 * x[:, 0] - 1.0) ** 2)

    runs, errors = [], []
    for digits in (1, 2, 3, 4, 5, 6):
        choice = ResponseSurface(tolerance=10.0**-digits, accuracy=0.0)
        surface = build_surface(run, unit_box(1), 1, choice)
        assert surface.converged.all()
        runs.append(int(surface.runs[0]))
        errors.append(float(true_error(surface, run)[0] / surface.scatter[0]))
    rate = np.polyfit(runs, np.log(errors), 1)[0]
    # Chebyshev interpolation: (1/2 + sqrt(1 + 1/4))^-1, that is -0.48, for each run.
    assert -0.6 < rate < -0.2
    assert errors[-1] < 1e-6


@pytest.mark.parametrize(
    ("function", "n", "loosest"),
    [
        pytest.param(kink, 2, 1.5, marks=pytest.mark.long),
        (waves, 2, 1.2),
        (smooth, 2, 1.5),
        pytest.param(front, 2, 1.2, marks=pytest.mark.long),
        (additive, 10, 1.0),
    ],
)
def test_the_estimate_bounds_the_true_error(function: Function, n: int, loosest: float) -> None:
    count = 4 if n < 10 else 2
    surface = built(function, n, count)
    true = true_error(surface, function)
    assert surface.converged.all()
    assert (surface.error <= 0.02 * surface.scatter).all()
    assert (true <= surface.error).mean() >= 0.75
    assert (true <= loosest * surface.error).all()


# ------------------------------------------------------------------------ limits


def test_an_exhausted_budget_is_a_flag_and_an_honest_error() -> None:
    surface = built(front, 2, 2, max_runs=60)
    assert not surface.converged.any()
    assert surface.runs.tolist() == [60, 60]
    assert (surface.error > 0.02 * surface.scatter).all()
    assert (true_error(surface, front) <= 1.5 * surface.error).all()


def test_noise_is_reported_as_error() -> None:
    noise = np.random.default_rng(0)

    def run(_: NDArray[np.intp], x: Array) -> Array:
        return np.sin(x[:, 0] + 2.0 * x[:, 1]) + 0.05 * noise.standard_normal(len(x))

    surface = built(run, 2, 4, max_runs=200)
    assert not surface.converged.any()
    assert surface.error == pytest.approx(np.full(4, 0.05), rel=0.5)
    # the surface goes between the noisy runs, not through all of them
    assert true_error(surface, lambda _, x: np.sin(x[:, 0] + 2.0 * x[:, 1])).max() < 0.04


def test_the_accuracy_of_the_simulator_is_enough() -> None:
    noise = np.random.default_rng(0)

    def run(_: NDArray[np.intp], x: Array) -> Array:
        return 300.0 + 1e-6 * x[:, 0] + 1e-5 * noise.standard_normal(len(x))

    surface = built(run, 2, 4)
    assert surface.converged.all()
    assert surface.runs.max() < 50
    assert surface.error.min() > 1e-6


# ------------------------------------------------------------------------ the same again


def test_units_of_the_box_and_the_outcome_do_not_matter() -> None:
    box = np.array([[-4.0, 6.0], [1e-3, 3e-3]])
    width = box[:, 1] - box[:, 0]
    one = built(waves, 2, 3)
    two = build_surface(lambda i, x: 1e5 * waves(i, (x - box[:, 0]) / width), box, 3, chosen())
    assert two.runs.tolist() == one.runs.tolist()
    assert two.error == pytest.approx(1e5 * one.error, rel=1e-6)


# ------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    "wrong",
    [
        {"tolerance": 0.0},
        {"tolerance": 1.0},
        {"tolerance": float("nan")},
        {"max_runs": 3},
        {"max_runs": 5000},
        {"accuracy": -1e-9},
        {"surfaces": "both"},
        {"nodes": 0},
    ],
)
def test_inadmissible_choices_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(InputsError, match=next(iter(wrong))):
        ResponseSurface(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "box",
    [[[1.0, 0.0]], [[0.0, 0.0]], [[0.0, np.inf]], [[np.nan, 1.0]], [0.0, 1.0], np.empty((0, 2))],
)
def test_inadmissible_boxes_are_refused(box: list[list[float]]) -> None:
    with pytest.raises(InputsError, match="box"):
        build_surface(waves, np.asarray(box), 1, chosen())


def test_too_few_runs_or_no_experiment_is_refused() -> None:
    with pytest.raises(InputsError, match="max_runs 15"):
        built(waves, 2, 1, max_runs=15)
    with pytest.raises(InputsError, match="at least one"):
        built(waves, 2, 0)


@pytest.mark.parametrize("answer", [lambda x: x, lambda x: np.full(len(x), np.inf)])
def test_a_simulator_that_does_not_answer_is_named(answer: Callable[[Array], Array]) -> None:
    with pytest.raises(SimulatorError, match="outcomes"):
        built(lambda _, x: answer(x), 2, 1)


@pytest.mark.parametrize(
    "outcome",
    [lambda v, x: np.log1p(x * v**2 / 9.81) / (2.0 * x), lambda v, x: v / x],
    ids=["drag", "reciprocal"],
)
def test_a_steep_end_does_not_stall_the_surfaces(outcome) -> None:
    """Rounding in the expected error once stopped these, and thinned them to constants."""
    speed = np.random.default_rng(0).uniform(5.0, 30.0, 20)
    box, x = np.array([[0.05, 1.5]]), np.linspace(0.05, 1.5, 400)[:, None]

    def run(index: np.ndarray, at: np.ndarray) -> np.ndarray:
        return outcome(speed[index], at[:, 0])

    surface = build_surface(run, box, 20, ResponseSurface(tolerance=0.005))
    truth = np.array([run(np.full(400, l), x) for l in range(20)])
    error = np.sqrt(((surface.evaluate(x) - truth) ** 2).mean(axis=1)) / truth.std(axis=1)
    assert surface.converged.all()
    assert surface.runs.max() < 100
    assert error.max() < 0.005
