"""The only way to a simulator: runs are checked, counted, made once, and repeated on purpose."""

# Arguments that a test's simulator does not use still say what it is given.
# ruff: noqa: ARG001, ARG005
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import Check, Free, Inputs, Normal
from aleator.errors import SimulatorError
from aleator.inference.diagnostics import failure_report
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.responses import Response
from aleator.simulators import FunctionSimulator, NoOutcome, ProcessPool, Runner, Store, working_box
from aleator.simulators.dispatch import Batching

TABLE = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 4.0], "site": [*"xyz"]}))


def runner(function: Callable[..., Any], vectorized: bool = False, **options: Any) -> Runner:
    return Runner(FunctionSimulator(function, vectorized), TABLE, ["x"], **options)


class Counted:
    """A function that counts its runs and can be told to fail."""

    def __init__(self, fails: Callable[[float, float], bool] = lambda load, x: False) -> None:
        self.runs = 0
        self.fails = fails
        self.error: BaseException = ValueError("broken")

    def __call__(self, load: float, x: float) -> float:
        if self.fails(load, x):
            raise self.error
        self.runs += 1
        return load * x


def points(count: int) -> np.ndarray:
    return np.linspace(0.0, 1.0, count)[:, None]


def test_runs_are_counted_and_kept() -> None:
    run = runner(lambda load, x: load * x)
    outcome = run([0, 1, 2, 0], [[1.0], [2.0], [3.0], [0.5]])
    assert outcome.tolist() == [1.0, 4.0, 12.0, 0.5]
    assert run.runs == run.fresh == 4
    assert run.completed.case.tolist() == [0, 1, 2, 0]
    assert run.completed.x.tolist() == [[1.0], [2.0], [3.0], [0.5]]
    assert run.completed.outcome[:, 0].tolist() == outcome.tolist()


def test_the_log_transform_is_applied_to_the_simulator() -> None:
    table = Experiments.from_frame(
        pd.DataFrame({"load": [1.0, 2.0], "y": [1.0, 1.0]}), outcome="y", transform="log"
    )
    run = Runner(lambda load, x: load * x, table, ["x"])
    np.testing.assert_allclose(run([0, 1], [[1.0], [3.0]]), np.log([1.0, 6.0]))
    assert run.completed.outcome[:, 0].tolist() == [1.0, 6.0]
    with pytest.raises(SimulatorError, match="returned -2: the logarithm of -2 does not exist"):
        run([1], [[-1.0]])


@pytest.mark.parametrize("vectorized", [False, True])
def test_a_run_that_raises_is_named_and_the_others_are_kept(vectorized: bool) -> None:
    def brittle(load: Any, x: Any) -> Any:
        if np.any((load == 2.0) & (x > 0.5)):
            raise ValueError("too\nhot")
        return load * x

    run = runner(brittle, vectorized, batching=Batching(here=np.inf))
    index, x = np.repeat([0, 1, 2], 10), np.tile(points(10), (3, 1))
    with pytest.raises(SimulatorError) as caught:
        run(index, x)
    message = str(caught.value)
    assert "experiment 'B' with x=0.555556: ValueError: too hot (test_runner.py, line" in message
    assert "load=2" in message
    assert len(run.completed) == 25


def test_a_function_that_takes_one_run_at_a_time_but_is_called_vectorized() -> None:
    def branching(load: Any, x: Any) -> Any:
        return load if x > 0.5 else x * load

    with pytest.raises(SimulatorError, match=r"(?s)but not with fewer.*vectorized"):
        runner(branching, vectorized=True)([0, 1, 2, 0], points(4))


def test_a_simulator_that_draws_random_numbers_is_refused() -> None:
    rng = np.random.default_rng(0)
    run = runner(lambda load, x: load * x + rng.normal())
    with pytest.raises(SimulatorError, match=r"for the same run: .*x=0\.5") as told:
        run.require_repeatable([0.5])
    assert "seed" in told.value.remedy


def test_a_repeatable_simulator_is_run_twice_and_once_where_the_run_is_known() -> None:
    function = Counted()
    run = runner(function)
    run.require_repeatable([0.5])
    assert (function.runs, run.runs, len(run.completed)) == (2, 1, 1)
    run.require_repeatable([0.5])
    assert (function.runs, run.runs) == (3, 1)


def test_failed_runs_are_told_with_their_parameters() -> None:
    run = runner(lambda x: np.where(x < 0.35, np.nan, x), vectorized=True)
    with pytest.raises(NoOutcome) as caught:
        run(np.zeros(11, int), points(11))
    np.testing.assert_allclose(caught.value.failed[:, 0], [0.0, 0.1, 0.2, 0.3])


def test_the_box_of_points_that_worked_leaves_out_those_that_failed() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(400, 2))
    fails = x[:, 0] + 0.2 * x[:, 1] > 0.8
    box = working_box(x[~fails], x[fails], [0])
    inside = np.all((x >= box[:, 0]) & (x <= box[:, 1]), axis=1)
    assert not np.any(inside & fails)
    # only the first parameter is cut, from above, and most of what worked is kept
    assert box[0, 0] == x[~fails, 0].min()
    assert np.sum(inside) > 0.8 * np.sum(~fails)


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (None, r"returned None for 2 values, expected an array of shape \(2,\)"),
        (1.0, r"returned a single float for 2 values.*\n.*vectorized"),
        (np.zeros((2, 1)), r"returned ndarray of shape \(2, 1\) for 2 values"),
        (np.array(["a", "b"]), "returned values of type <U1"),
        (np.zeros(2, complex), "returned values of type complex128"),
    ],
)
def test_a_wrong_shape_or_kind_is_told(returned: Any, words: str) -> None:
    with pytest.raises(SimulatorError, match=words):
        runner(lambda load, x: returned, vectorized=True)([0, 1], points(2))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_outcome_that_is_not_finite_is_told_with_the_parameter_to_narrow(bad: float) -> None:
    run = runner(lambda load, x: np.where((load > 1) & (x > 0.75), bad, x), vectorized=True)
    with pytest.raises(SimulatorError) as caught:
        run(np.repeat([0, 1, 2], 11), np.tile(points(11), (3, 1)))
    message = str(caught.value)
    assert f"returned {bad:g} for experiment 'B' with x=0.8" in message
    assert "6 of 33 runs failed so, in 2 of 3 experiments" in message
    assert "narrow the box or the bounds of x from above, to 0.7" in message
    assert len(run.completed) == 27


def test_experiments_under_equal_conditions_share_their_runs() -> None:
    table = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 1.0], "nr": [1, 2, 3]}))
    function = Counted()
    run = Runner(function, table, ["x"])
    assert run.cases.condition.tolist() == [0, 1, 0]
    assert run.cases.first.tolist() == [0, 1]
    assert run([2, 0, 1, 0], [[1.0], [1.0], [1.0], [2.0]]).tolist() == [1.0, 1.0, 2.0, 2.0]
    assert function.runs == run.runs == 3


def test_blocks_do_not_change_the_answer() -> None:
    simulator = FunctionSimulator(lambda load, x: load * x, vectorized=True, block=4)
    run = Runner(simulator, TABLE, ["x"])
    assert run(np.zeros(10, int), points(10)).tolist() == points(10)[:, 0].tolist()
    assert len(run.completed) == 10


@pytest.mark.parametrize("stored", [False, True], ids=["memory", "store"])
def test_a_run_is_counted_and_made_once_however_often_it_is_asked_for(
    stored: bool, tmp_path: Path
) -> None:
    function = Counted(lambda load, x: x == 3.0)
    with Store(tmp_path / "runs.sqlite") if stored else nullcontext() as store:
        run = runner(function, store=store)
        for call in (run, run.attempt, run):
            assert call([0, 1, 0], [[1.0], [2.0], [1.0]]).tolist() == [1.0, 4.0, 1.0]
        for _ in range(2):  # a failed run is a run
            assert np.isnan(run.attempt([1, 2, 1], [[3.0], [3.0], [2.0]])).tolist() == [1, 1, 0]
        assert (function.runs, run.fresh, run.runs) == (2, 2, 4)
        assert (len(run.completed), len(run.failures)) == (2, 2)


@pytest.mark.parametrize("seconds", [0.0, np.inf])
def test_where_a_batch_ends_does_not_decide_whether_too_many_runs_failed(seconds: float) -> None:
    """The first unit fails everywhere; a batch ends after each run, or never."""
    batching = Batching(here=seconds)
    table = Conditions([*"abcdefgh"], pd.DataFrame({"load": np.arange(8.0)}))
    asked, x = np.repeat(np.arange(8), 20), np.tile(points(20), (8, 1))
    eighth = Counted(lambda load, x: load == 0.0)
    outcome = Runner(FunctionSimulator(eighth), table, ["x"], batching=batching).attempt(asked, x)
    np.testing.assert_array_equal(np.isnan(outcome), asked == 0)
    quarter = FunctionSimulator(Counted(lambda load, x: load < 2.0))
    with pytest.raises(NoOutcome, match="too many to go on"):
        Runner(quarter, table, ["x"], batching=batching).attempt(asked, x)


def test_a_simulator_that_works_nowhere_is_given_up_after_a_few_runs() -> None:
    table = Conditions([*map(str, range(50))], pd.DataFrame({"load": np.arange(50.0)}))
    tried = []

    def broken(load: float, x: float) -> float:
        tried.append(load)
        time.sleep(0.005)
        raise ValueError("no license")

    with pytest.raises(NoOutcome, match="no run of it worked"):
        Runner(FunctionSimulator(broken), table, ["x"]).attempt(
            np.repeat(np.arange(50), 20), np.tile(points(20), (50, 1))
        )
    assert len(set(tried)) == len(tried) < 50


LOADS = Conditions((*"ABCD",), pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0]}))


class Sometimes:
    """Random in one of ten runs, and right in all others."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.runs = 0

    def __call__(self, load: float, x: float) -> float:
        self.runs += 1
        return load * x * (1.0 + 1e-3 * (self.rng.random() < 0.1))


def runs_asked(size: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(size) % 4, np.linspace(0.5, 1.5, size)[:, None]


@pytest.mark.parametrize("way", ["attempt", "values", "straight"])
def test_what_is_random_in_one_of_ten_runs_is_refused(way: str) -> None:
    """Of 600 runs 24 are made again: 0.81^24, so that one of 157 passes."""
    found = 0
    for seed in range(20):
        run = Runner(Sometimes(seed), LOADS, ["x"])
        run.repeat_some()
        try:
            getattr(run, way)(*runs_asked(600))
        except SimulatorError as error:
            found += "for the same run: experiment" in error.problem
    assert found >= 19


def test_it_costs_two_dozen_runs_and_no_run_counts_twice() -> None:
    class Counted:
        runs = 0

        def __call__(self, load: float, x: float) -> float:
            self.runs += 1
            return load * x

    function = Counted()
    run = Runner(function, LOADS, ["x"])
    index, x = runs_asked(2000)
    for part in range(0, 2000, 20):
        run.attempt(index[part : part + 20], x[part : part + 20])
    assert (function.runs, run.runs) == (2000, 2000)  # unless it is runs_asked for, none is
    run.repeat_some()
    run.attempt(index, x + 1.0)
    run.attempt(index, x + 2.0)
    assert (function.runs, run.runs, len(run.completed)) == (6024, 6000, 6000)
    run.attempt(index, x + 2.0)  # what is known is no run that is made
    assert function.runs == run.runs + run.repeated == 6024


def test_a_run_that_fails_the_second_time_is_another_matter() -> None:
    tried: set[float] = set()

    def once(load: float, x: float) -> float:
        if x in tried:
            raise RuntimeError("the license is gone")
        tried.add(x)
        return load * x

    run = Runner(once, LOADS, ["x"])
    run.repeat_some()
    assert np.isfinite(run.attempt(*runs_asked(100))).all()


def test_rounding_beside_large_outcomes_is_no_randomness() -> None:
    state = {"last": 0.0}

    def tolerant(load: float, x: float) -> float:
        state["last"] = 1e-7 - state["last"]
        return load * (x - 1.0) + state["last"]  # zero at x = 1, but for the last state

    run = Runner(tolerant, LOADS, ["x"])
    run.repeat_some()
    assert np.isfinite(run.attempt(*runs_asked(401))).all()


def test_an_identification_refuses_it() -> None:
    rng = np.random.default_rng(1)
    load = np.linspace(1.0, 2.0, 30)
    table = pd.DataFrame({"load": load, "y": load * rng.normal(1.0, 0.1, 30)})
    inputs = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    with pytest.raises(SimulatorError, match="for the same run"):
        unjudged(Sometimes(), table, inputs, outcome="y", verification=Check(0))


ONE = Conditions(("A",), pd.DataFrame({"load": [2.0]}))
X = np.array([[1.0], [2.0], [3.0], [4.0]])


def hangs_at_three(load: float, x: float) -> float:
    while x == 3.0:
        pass
    return load * x


def deaf_at_three(load: float, x: float) -> float:
    """What swallows the first word of its end, as a loop that tries again does."""
    while x == 3.0:
        try:
            time.sleep(10.0)
        except Exception:
            time.sleep(10.0)
    return load * x


def compiled_at_three(load: float, x: float) -> float:
    """Compiled code that holds the interpreter."""
    if x == 3.0:
        return float(sum(range(10**12)))  # hours, and no signal is heard
    return load * x


@pytest.mark.parametrize("function", [hangs_at_three, deaf_at_three])
@pytest.mark.parametrize("vectorized", [False, True])
def test_a_hanging_run_fails_and_the_others_do_not(function, vectorized: bool) -> None:  # type: ignore[no-untyped-def]
    def called(load: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.array([function(*one) for one in zip(load, x, strict=True)])

    simulator = FunctionSimulator(called if vectorized else function, vectorized, timeout=0.1)
    run = Runner(simulator, ONE, ["x"], max_failed=1.0)
    np.testing.assert_array_equal(run.attempt([0] * 4, X), [2.0, 4.0, np.nan, 8.0])
    (failure,) = run.failures.failures.values()
    assert failure.message == "it was stopped after its 0.1 s"


@pytest.mark.slow
def test_compiled_code_that_hangs_ends_its_worker_alone() -> None:
    began = time.perf_counter()
    with ProcessPool(2) as pool:
        simulator = FunctionSimulator(compiled_at_three, timeout=0.2)
        run = Runner(simulator, ONE, ["x"], executor=pool, max_failed=1.0)
        np.testing.assert_array_equal(run.attempt([0] * 4, X), [2.0, 4.0, np.nan, 8.0])
    (failure,) = run.failures.failures.values()
    assert "died" in failure.message
    assert time.perf_counter() - began < 50.0


def test_a_time_that_is_none_is_refused_and_another_thread_has_no_limit() -> None:
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SimulatorError, match="no time"):
            FunctionSimulator(hangs_at_three, timeout=wrong)
    simulator = FunctionSimulator(hangs_at_three, timeout=1e-9)
    with ThreadPoolExecutor(1) as thread:
        run = Runner(simulator, ONE, ["x"], executor=thread)
        assert run([0], [[1.0]]).tolist() == [2.0]


IDS = tuple(f"E{k // 4}" for k in range(20))
ROWS = pd.DataFrame(
    {"load": 1.0 + np.arange(20) // 4, "time": 0.1 * np.arange(20), "site": [*"ab"] * 10}
)
REGION = np.array([[0.5, 2.0], [-1.0, 1.0]])


def of_rows(
    function: Callable[..., Any], responses: tuple[str, ...] = ("way",), **kind: Any
) -> Any:
    table = Conditions(
        tuple(dict.fromkeys(IDS)), ROWS, responses=[Response(name) for name in responses],
        experiment=np.arange(20) // 4,
    )  # fmt: skip
    return Runner(FunctionSimulator(function, **kind), table, ["x", "y"])


def formula(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * np.exp(-x * time) + y**3


def named_parts(load: Any, time: Any, x: Any, y: Any) -> dict[str, Any]:
    return {"speed": x * load, "way": y * time, "grade": 2.0}


def branching(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * time if x > 1.0 else y


def scalar(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * math.exp(-x * time) + y


def smoothed(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * time - np.mean(x) + np.mean(y)


def texts(site: Any, x: Any, y: Any) -> Any:
    return x if site == "a" else y


def seldom(load: Any, time: Any, x: Any, y: Any) -> Any:
    if np.any(x == 7.0):
        raise ValueError("too fast")
    return load * x + y * time


@pytest.mark.parametrize(
    ("function", "responses", "expected", "series"),
    [
        (formula, ("way",), True, False),
        (formula, ("way",), True, True),
        (named_parts, ("way", "speed"), True, False),
        (named_parts, ("way", "speed"), True, True),
        (branching, ("way",), False, False),
        (branching, ("way",), False, True),
        (smoothed, ("way",), False, False),
        (smoothed, ("way",), False, True),
        (scalar, ("way",), False, False),
        (texts, ("way",), False, False),
    ],
)
def test_arrays_are_given_only_to_a_function_that_treats_them_as_numbers(
    function: Callable[..., Any], responses: tuple[str, ...], expected: bool, series: bool
) -> None:
    run = of_rows(function, responses, series=series)
    x = np.random.default_rng(0).uniform(*REGION.T, size=(50, 2))
    units = np.arange(50) % run.units
    before = run.straight(units, x)
    assert run.takes_arrays(REGION) is expected
    np.testing.assert_allclose(run.straight(units, x), before, rtol=1e-14)
    np.testing.assert_allclose(run.straight(units, x), run.values(units, x), rtol=1e-14)


def test_a_run_that_raises_does_not_spoil_the_others() -> None:
    run = of_rows(seldom)
    assert run.takes_arrays(REGION)
    values = run.straight([0, 1, 2], [[1.0, 1.0], [7.0, 1.0], [2.0, 1.0]])
    np.testing.assert_allclose(values[:, 0], [1.0, np.nan, 2.2])
    lost, failures = run.lost
    assert (lost, failures.case.tolist(), failures.x.tolist()) == (1, [1], [[7.0, 1.0]])
    assert "too fast" in failures.failures[0].message
    report = failure_report(run)
    assert report is not None
    assert (report.runs, report.needed, report.experiments) == (1, 19, ("E0",))
    assert report.region == {"x": (7.0, 7.0), "y": (1.0, 1.0)}


def test_a_series_that_changes_its_arguments_changes_no_other_run() -> None:
    def careless(load: float, time: Any, x: float, y: float) -> Any:
        time -= time[0]
        return time * load * x + y

    run = of_rows(careless, series=True)
    first = run.values([1], [[1.0, 0.0]])
    np.testing.assert_array_equal(run.values([1], [[2.0, 0.0]]), 2.0 * first)


def drawing(load: float, x: float) -> float:
    rng = np.random.default_rng()
    return load * x * (1.0 + (rng.random() < 0.5))


def test_it_is_found_among_workers() -> None:
    with ThreadPoolExecutor(2) as pool:
        run = Runner(FunctionSimulator(drawing), LOADS, ["x"], executor=pool)
        run.repeat_some()
        with pytest.raises(SimulatorError, match="for the same run"):
            run.attempt(*runs_asked(100))


def test_what_is_no_number_is_counted_and_the_first_are_told() -> None:
    def half(load: Any, time: Any, x: Any, y: Any) -> Any:
        return np.where(x > 1.0, np.nan, np.inf) + 0 * load * time * y

    run = of_rows(half, vectorized=True)
    values = run.straight(np.zeros(4000, int), np.tile([[0.5, 0.0], [1.5, 0.0]], (2000, 1)))
    assert np.sum(np.isnan(values)) == 2000
    lost, failures = run.lost
    assert (lost, len(failures), np.unique(failures.x[:, 0]).tolist()) == (2000, 1000, [1.5])
    assert failures.failures[0].message == "it returned nan"


def test_few_calls_find_it_out() -> None:
    calls = []

    def counted(load: Any, time: Any, x: Any, y: Any) -> Any:
        calls.append(1)
        return formula(load, time, x, y)

    run = of_rows(counted)
    assert run.takes_arrays(REGION)
    assert len(calls) == 18
    run.straight(np.zeros(1000, int), np.ones((1000, 2)))
    assert len(calls) == 19
