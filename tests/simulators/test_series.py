"""One run serves a whole experiment, and a run may return several values."""

# Arguments that a test's simulator does not use still say what it is given.
# ruff: noqa: ARG001, ARG005
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator.errors import SimulatorError
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Observations, responses_of
from aleator.simulators import (
    FunctionSimulator,
    NoOutcome,
    ProcessPool,
    Runner,
    Store,
    as_simulator,
    records,
)
from aleator.simulators.records import stored_runs

# Rows of two experiments that are not adjacent, with a row less in the second.
ROWS = pd.DataFrame(
    {"load": [2.0, 3.0, 2.0, 3.0, 2.0], "time": [0.5, 1.0, 1.0, 2.0, 1.5], "note": [*"abcde"]}
)


def table(
    observed: Sequence[tuple[int, int]],
    names: Sequence[str] = ("way",),
    transform: Mapping[str, str] | str = "none",
    rows: pd.DataFrame = ROWS,
    experiment: Sequence[int] = (0, 1, 0, 1, 0),
) -> Experiments:
    """A table with observations of (row, response)."""
    ids = tuple(f"E{k}" for k in range(max(experiment) + 1))
    row, response = np.array(sorted(observed, key=lambda pair: experiment[pair[0]])).T
    of, values = np.array(experiment), np.zeros(len(row))
    seen = Observations(of[row], row, response, values, values, responses_of(names, transform))
    return Experiments(ids, rows, seen, experiment=of)


SORTED = ROWS.iloc[[0, 2, 4, 1, 3]]
EVERY = [(k, 0) for k in range(5)]
BOTH = [(k, r) for k in range(5) for r in (0, 1)]


def course(load: float, time: Any, x: float) -> Any:
    return load * x * time


def test_a_row_is_a_unit_of_a_function_that_is_called_row_by_row() -> None:
    run = Runner(course, table(EVERY), ["x"])
    assert (run.units, run.unit.tolist(), run.column.tolist()) == (5, [0, 2, 4, 1, 3], [0] * 5)
    values = run.values(np.arange(5), np.full((5, 1), 2.0))
    np.testing.assert_array_equal(values[:, 0], 2.0 * ROWS["load"] * ROWS["time"])


def test_many_runs_of_a_series_are_one_call_with_all_their_rows() -> None:
    """Rows of other experiments lie between, one has a row less, and texts are arrays too."""
    calls = list[int]()

    def both(load: Any, time: Any, note: Any, x: Any) -> Any:
        calls.append(np.size(x))
        way = course(load, time, x) + (np.asarray(note) == "a")
        return {"speed": load * x + 0.0 * time, "way": way}

    rows = table(BOTH, ("way", "speed"))
    run = Runner(FunctionSimulator(both, series=True), rows, ["x"])
    unit, x = np.arange(30) % 2, np.linspace(1.0, 3.0, 30)[:, None]
    expected = run.values(unit, x)
    assert run.takes_arrays(np.array([[1.0, 3.0]]))
    calls.clear()
    np.testing.assert_array_equal(run.straight(unit, x), expected)
    assert calls == [75]  # rows: 15 runs with three, 15 with two


def test_an_experiment_is_a_unit_of_a_series() -> None:
    calls = list[Any]()

    def told(load: float, time: Any, x: float) -> Any:
        calls.append((load, time.tolist(), x))
        return course(load, time, x)

    run = Runner(FunctionSimulator(told, series=True), table(EVERY), ["x"])
    assert run.units == 2
    assert run.unit.tolist() == [0, 0, 0, 1, 1]
    assert run.column.tolist() == [0, 1, 2, 0, 1]
    values = run.values([0, 1, 0], [[2.0], [2.0], [2.0]])
    assert calls == [(2.0, [0.5, 1.0, 1.5], 2.0), (3.0, [1.0, 2.0], 2.0)]
    np.testing.assert_array_equal(values, [[2, 4, 6], [6, 12, np.nan], [2, 4, 6]])
    measured = values[[0, 1]][run.unit, run.column]
    np.testing.assert_array_equal(measured, 2.0 * SORTED["load"] * SORTED["time"])
    assert run.runs == run.fresh == 2


@pytest.mark.parametrize("kind", ["rows", "vectorized", "series"])
def test_several_responses_come_as_a_mapping_whatever_its_order(kind: str) -> None:
    def both(load: Any, time: Any, x: Any) -> dict[str, Any]:
        return {"unseen": 0.0, "speed": load * x + 0 * time, "way": load * x * time}

    simulator = FunctionSimulator(both, kind == "vectorized", series=kind == "series")
    run = Runner(simulator, table(BOTH, ("way", "speed"), {"speed": "log"}), ["x"])
    values = run.values(np.arange(run.units), np.full((run.units, 1), 2.0))
    measured = values[run.unit, run.column].reshape(5, 2)
    np.testing.assert_array_equal(measured[:, 0], 2.0 * SORTED["load"] * SORTED["time"])
    np.testing.assert_array_equal(measured[:, 1], np.log(2.0 * SORTED["load"]))


def test_one_number_of_a_series_stands_for_all_rows() -> None:
    def both(load: float, time: Any, x: float) -> dict[str, Any]:
        return {"way": load * x * time, "speed": load * x}

    run = Runner(FunctionSimulator(both, series=True), table(BOTH, ("way", "speed")), ["x"])
    values = run.values([1], [[1.0]])
    np.testing.assert_array_equal(values, [[3, 3, 6, 3, np.nan, np.nan]])
    flat = Runner(FunctionSimulator(lambda load, x: load * x, series=True), table(EVERY), ["x"])
    np.testing.assert_array_equal(flat.values([1], [[1.0]]), [[3, 3, np.nan]])


def test_only_what_is_measured_must_be_finite() -> None:
    def late(load: float, time: Any, x: float) -> dict[str, Any]:
        return {"way": np.where(time > 1.0, np.nan, time), "speed": x}

    observed = [(0, 0), (1, 0), (2, 0), (3, 1), (4, 1)]
    simulator = FunctionSimulator(late, series=True)
    run = Runner(simulator, table(observed, ("way", "speed")), ["x"])
    values = run.values([0, 1], [[7.0], [7.0]])
    np.testing.assert_array_equal(values[run.unit, run.column], [0.5, 1.0, 7.0, 1.0, 7.0])
    strict = Runner(simulator, table(BOTH, ("way", "speed")), ["x"])
    assert np.all(np.isnan(strict.values([0], [[7.0]])))
    (failure,) = strict.failures.failures.values()
    assert failure.message == "it returned nan for way in row 3 of 3"


@pytest.mark.parametrize("executor", [False, True], ids=["here", "workers"])
@pytest.mark.parametrize("kind", ["vectorized", "series"])
def test_a_store_has_vectors(tmp_path: Path, kind: str, executor: bool) -> None:
    def both(load: Any, time: Any, x: Any) -> dict[str, Any]:
        return {"way": load * x * time, "speed": load * x + 0.0 * time}

    simulator = FunctionSimulator(both, kind == "vectorized", series=kind == "series")
    asked = table(BOTH, ("way", "speed"))
    found = []
    for _ in range(2):
        with Store(tmp_path / "runs.sqlite") as store:
            if executor:
                with ProcessPool(1) as pool:
                    run = Runner(simulator, asked, ["x"], store=store, executor=pool)
                    found.append(run.values(np.arange(run.units), np.ones((run.units, 1))))
            else:
                run = Runner(simulator, asked, ["x"], store=store)
                found.append(run.values(np.arange(run.units), np.ones((run.units, 1))))
            kept = [*stored_runs(store)]
    np.testing.assert_array_equal(*found)
    assert (run.fresh, run.runs) == (0, run.units) == (0, len(kept))


@pytest.mark.parametrize("kind", [{}, {"series": True}], ids=["rows", "series"])
@pytest.mark.parametrize("several", [False, True])
def test_vectors_travel_by_a_table_and_back(tmp_path: Path, kind: Any, several: bool) -> None:
    def both(load: float, time: Any, x: float) -> Any:
        way = load * x * time
        return {"way": way, "speed": np.where(time > 0.7, load * x, np.nan)[()]} if several else way

    # the speed is not measured where there is none
    observed = [pair for pair in BOTH if pair != (0, 1)] if several else EVERY
    asked = table(observed, ("way", "speed") if several else ("way",))
    simulator = FunctionSimulator(both, **kind)
    with Store(tmp_path / "a.sqlite") as store:
        run = Runner(simulator, asked, ["x"], store=store)
        units, x = np.arange(run.units), np.ones((run.units, 1))
        first = run.values(units, x)
        assert records.write(stored_runs(store), tmp_path / "runs.csv") == run.units
        before = [replace(kept, number=0, time=0.0) for kept in stored_runs(store)]
    with Store(tmp_path / "b.sqlite") as store:
        assert records.read(store, tmp_path / "runs.csv").added == run.units
        again = records.read(store, tmp_path / "runs.csv")
        assert (again.added, again.present) == (0, run.units)
        after = [replace(kept, number=0, time=0.0) for kept in stored_runs(store)]
        resumed = Runner(simulator, asked, ["x"], store=store)
        np.testing.assert_array_equal(resumed.values(units, x), first)
        assert resumed.fresh == 0
    assert str(after) == str(before)  # NaN is not equal to itself


def test_another_response_is_another_run(tmp_path: Path) -> None:
    def both(load: float, time: float, x: float) -> dict[str, float]:
        return {"way": load * x * time, "speed": load * x}

    with Store(tmp_path / "runs.sqlite") as store:
        for name, expected in (("way", 1.0), ("speed", 2.0)) * 2:
            run = Runner(both, table(EVERY, (name,)), ["x"], store=store)
            assert run([0], [[1.0]]).tolist() == [expected]


@pytest.mark.parametrize(
    ("function", "names", "words"),
    [
        (
            lambda load, time, x: time[:1],
            ("way",),
            r"1 values for experiment 'E0', which has 3 rows",
        ),
        (lambda load, time, x: {"wy": time}, ("way",), "no 'way' (did you mean 'wy'?)"),
        (lambda load, time, x: {"way": time}, ("way", "speed"), "no 'speed'"),
        (lambda load, time, x: time, ("way", "speed"), "has the responses way, speed"),
    ],
)
def test_what_does_not_fit_the_table_is_told(
    function: Callable[..., Any], names: Sequence[str], words: str
) -> None:
    observed = [(k, r) for k in range(5) for r in range(len(names))]
    run = Runner(FunctionSimulator(function, series=True), table(observed, names), ["x"])
    with pytest.raises(SimulatorError) as told:
        run.values([0], [[1.0]])
    assert words in str(told.value)


def test_a_failure_is_told_with_experiment_and_row() -> None:
    def brittle(load: float, time: float, x: float) -> float:
        if time == 2.0:
            raise ValueError("too late")
        return x

    run = Runner(brittle, table(EVERY), ["x"])
    with pytest.raises(SimulatorError, match="row 2 of 2 of experiment 'E1' with x=1"):
        run(np.arange(5), np.ones((5, 1)))


def test_equal_experiments_are_one_case_unless_they_differ_in_length() -> None:
    rows = pd.DataFrame({"load": [1.0] * 5, "time": [1.0, 2.0, 1.0, 2.0, 1.0]})
    three = (0, 0, 1, 1, 2)
    simulator = FunctionSimulator(course, series=True)
    run = Runner(simulator, table(EVERY, rows=rows, experiment=three), ["x"])
    assert run.cases.condition.tolist() == [0, 0, 1]
    run.values([0, 1, 2], np.ones((3, 1)))
    assert run.runs == 2


def test_straight_runs_are_the_same_but_not_remembered() -> None:
    for kind in ({"vectorized": True}, {}, {"series": True}):
        asked = np.arange(2 if "series" in kind else 5)
        simulator = FunctionSimulator(course, **kind)
        run = Runner(simulator, table(EVERY), ["x"])
        x = np.linspace(0.5, 1.0, len(asked))[:, None]
        np.testing.assert_array_equal(run.straight(asked, x), run.values(asked, x))
        assert (run.runs, len(run.completed)) == (2 * len(asked), len(asked))


def test_a_straight_run_may_be_infinite_and_one_that_raises_is_nan() -> None:
    def life(load: float, time: float, x: float) -> float:
        if x > 2.0:
            raise ValueError("too stiff")
        return time if x < 1.0 else np.inf

    run = Runner(life, table(EVERY), ["x"])
    values = run.straight([0, 1, 2, 3], [[0.5], [1.5], [2.5], [0.5]])
    np.testing.assert_array_equal(values[:, 0], [0.5, np.inf, np.nan, 2.0])


def test_a_long_series_travels(tmp_path: Path) -> None:
    rows = pd.DataFrame({"load": 2.0, "time": np.linspace(0.0, 1.0, 8000)})
    asked = table([(k, 0) for k in range(8000)], rows=rows, experiment=[0] * 8000)
    with Store(tmp_path / "a.sqlite") as store:
        run = Runner(FunctionSimulator(course, series=True), asked, ["x"], store=store)
        run.values([0], [[1.0 / 3.0]])
        records.write(stored_runs(store), tmp_path / "runs.csv")
    with Store(tmp_path / "b.sqlite") as store:
        assert records.read(store, tmp_path / "runs.csv").added == 1


class Mute(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no words")


class Gone(Exception):
    def __str__(self) -> str:
        raise GeneratorExit


TEXTS = [Mute(), Gone(), ValueError("a file \udcff"), SyntaxError("odd", (3, 1, 2, b"x"))]


@pytest.mark.parametrize("error", TEXTS, ids=lambda error: type(error).__name__)
def test_a_failure_is_kept_whatever_its_text_is(tmp_path: Path, error: Exception) -> None:
    def brittle(load: float, time: float, x: float) -> float:
        raise error

    with Store(tmp_path / "runs.sqlite") as store:
        run = Runner(brittle, table(EVERY), ["x"], store=store)
        assert np.isnan(run.attempt([0], [[1.0]])).all()
        (kept,) = stored_runs(store)
    assert kept.failure is not None
    assert type(error).__name__ in kept.failure


def test_a_function_that_wants_the_arrays_of_an_experiment_is_told_to_be_one_of_series() -> None:
    def summed(load: float, time: Any, x: float) -> Any:
        return load * x * np.array([sum(time[: k + 1]) for k in range(len(time))])

    for ask in (lambda run, *at: run(*at), lambda run, *at: run.values(*at)):
        with pytest.raises(SimulatorError, match=r"arrays of time\b[\s\S]*series=True"):
            ask(Runner(summed, table(EVERY), ["x"], min_failed=1), np.arange(5), np.ones((5, 1)))
    right = Runner(as_simulator(summed, series=True), table(EVERY), ["x"])
    assert right.values([0], [[1.0]]).tolist() == [[1.0, 3.0, 6.0]]

    def wrong(load: float, time: Any, x: float) -> Any:
        return load * x * len(time)  # one number, whatever the rows: nothing says that it is right

    with pytest.raises(NoOutcome):
        Runner(wrong, table(EVERY), ["x"])(np.arange(5), np.ones((5, 1)))
    with pytest.raises(SimulatorError):  # what is a simulator already says itself what it takes
        as_simulator(FunctionSimulator(summed), series=True)
