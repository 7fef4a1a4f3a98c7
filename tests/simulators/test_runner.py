# Arguments that a test's simulator does not use still say what it is given.
# ruff: noqa: ARG001, ARG002, ARG005
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator.errors import SimulatorError
from aleator.inference.check import Check
from aleator.laws import Free, Normal
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import (
    FunctionSimulator,
    NoOutcome,
    Runner,
    Store,
    as_simulator,
    working_box,
)
from aleator.simulators.dispatch import Batching
from aleator.surrogates import ResponseSurface

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


def test_text_conditions_reach_a_simulator_that_asks_for_them() -> None:
    run = runner(lambda site, x: x + len(site) if site == "y" else x)
    assert run([0, 1], [[1.0], [1.0]]).tolist() == [1.0, 2.0]


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


def test_a_text_condition_is_suspected() -> None:
    with pytest.raises(SimulatorError, match="site is text in the table"):
        runner(lambda site, x: site * x)([0], [[1.0]])


def test_a_function_that_takes_one_run_at_a_time_but_is_called_vectorized() -> None:
    def branching(load: Any, x: Any) -> Any:
        return load if x > 0.5 else x * load

    with pytest.raises(SimulatorError, match=r"(?s)but not with fewer.*vectorized = false"):
        runner(branching, vectorized=True)([0, 1, 2, 0], points(4))


def test_a_function_of_numbers_that_is_called_with_arrays_is_told_the_cause() -> None:
    with pytest.raises(SimulatorError, match=r"(?s)with arrays, because vectorized is true.*false"):
        runner(lambda load, x: math.exp(x), vectorized=True)([0, 1, 2, 0], points(4))


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
        (None, r"returned None for 2 runs, expected an array of shape \(2,\)"),
        (1.0, r"returned a single float for 2 runs.*\n.*vectorized = false"),
        (np.zeros((2, 1)), r"returned ndarray of shape \(2, 1\) for 2 runs"),
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


def test_a_lower_end_that_fails_is_found_too() -> None:
    run = runner(lambda x: np.where(x < 0.35, np.nan, x), vectorized=True)
    with pytest.raises(SimulatorError, match=r"x from below, to 0\.4"):
        run(np.zeros(11, int), points(11))


def test_numpy_does_not_warn_about_what_is_reported_anyway() -> None:
    with pytest.raises(SimulatorError, match="returned nan"):
        runner(lambda load, x: np.log(x - load), vectorized=True)([0], [[0.5]])


def test_experiments_under_equal_conditions_share_their_runs() -> None:
    table = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 1.0], "nr": [1, 2, 3]}))
    function = Counted()
    run = Runner(function, table, ["x"])
    assert run.cases.condition.tolist() == [0, 1, 0]
    assert run.cases.first.tolist() == [0, 1]
    assert run([2, 0, 1, 0], [[1.0], [1.0], [1.0], [2.0]]).tolist() == [1.0, 1.0, 2.0, 2.0]
    assert function.runs == run.runs == 3


def test_blocks_do_not_change_the_answer() -> None:
    simulator = FunctionSimulator(lambda load, x: load * x, vectorized=True)
    simulator.block = 4
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


def test_an_identification_counts_the_different_runs_it_needed(tmp_path: Path) -> None:
    asked = set[tuple[float, float]]()

    def model(load: np.ndarray, x: np.ndarray) -> np.ndarray:
        asked.update(zip(load.tolist(), x.tolist(), strict=True))
        return load * x

    frame = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    table = Experiments.from_frame(frame, outcome="y")
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    simulator = FunctionSimulator(model, vectorized=True)
    counts = []
    for path in (None, tmp_path / "runs.sqlite", tmp_path / "runs.sqlite"):
        with Store(path) if path else nullcontext() as store:
            run = Runner(simulator, table, law.names, store=store)
            found = unjudged(
                run, table, law, verification=Check(50),
                propagation=ResponseSurface(surfaces="own"),
            )  # fmt: skip
        counts.append((found.runs, run.runs, len(asked)))
    assert counts == [(len(asked),) * 3] * 3
    assert run.fresh == 0


def test_slow_runs_tell_their_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    class Listener:
        def __init__(self) -> None:
            self.texts: list[str] = []

        def stage(self, name: str) -> None:
            self.texts.append(name)

        def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
            self.texts.append(f"{text} {done} {total}")

    clock = iter(np.arange(0.0, 100.0, 2.0))
    monkeypatch.setattr("aleator.simulators.execution.time.monotonic", lambda: next(clock))
    listener = Listener()
    run = runner(lambda load, x: x, vectorized=True, progress=listener, batching=Batching(here=0.0))
    run.simulator.block = 16
    run(np.zeros(40, int), points(40))
    assert listener.texts == [
        "16 of 40 runs, 8 runs/s, about 3 s left 16 40",
        "32 of 40 runs, 8 runs/s, about 1 s left 32 40",
    ]


def test_any_class_that_fills_the_protocol_is_a_simulator() -> None:
    class Doubling:
        name = "doubling"
        block = 10

        def asks(self, conditions: Any, parameters: Any) -> tuple[str, ...]:
            return ("load",)

        def __call__(self, conditions: Any, parameters: Any) -> Any:
            return 2 * conditions["load"] * parameters["x"]

        def fingerprint(self) -> str:
            return "doubling 1"

    simulator = Doubling()
    assert as_simulator(simulator) is simulator
    assert Runner(simulator, TABLE, ["x"])([1], [[1.0]]).tolist() == [4.0]


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
