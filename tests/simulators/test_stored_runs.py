"""A runner with a store repeats nothing and loses nothing; runs come out of tables bit by bit."""

# Arguments that a test's simulator does not use still say what it is given.
# ruff: noqa: ARG001, ARG005
import linecache
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aleator.errors import SimulatorError, StoreError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, RunFailed, Runner, Store, notified, records
from aleator.simulators.records import StoredRun, stored_runs

TABLE = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 4.0], "nr": [1, 2, 3]}))


class Counted:
    """A function that counts its calls and can be told to fail."""

    def __init__(self, fails: Callable[[float, float], bool] = lambda load, x: False) -> None:
        self.calls = 0
        self.fails = fails
        self.error: BaseException = ValueError("broken")

    def __call__(self, load: float, x: float) -> float:
        self.calls += 1
        if self.fails(load, x):
            raise self.error
        return load * x


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store(tmp_path / "runs.sqlite") as store:
        yield store


def runner(
    function: Callable[..., Any], store: Store | None, vectorized: bool = False, **options: Any
) -> Runner:
    table = options.pop("table", TABLE)
    return Runner(FunctionSimulator(function, vectorized, **options), table, ["x"], store=store)


def points(count: int) -> np.ndarray:
    return np.linspace(0.0, 1.0, count)[:, None]


def all_runs(store: Store) -> list[StoredRun]:
    return [*stored_runs(store)]


def test_nothing_is_repeated_by_another_runner_nor_by_the_same(store: Store) -> None:
    function = Counted()
    x = np.random.default_rng(1).normal(size=(20, 1)) * 1e-7
    first = runner(function, store)(np.arange(20) % 3, x)
    again = runner(function, store)
    np.testing.assert_array_equal(again(np.arange(20) % 3, x), first)
    np.testing.assert_array_equal(again(np.arange(20) % 3, x), first)
    assert function.calls == 20
    assert (again.runs, again.fresh) == (20, 0)
    assert again.cache is not None
    assert again.cache.by_case().tolist() == [7, 7, 6]
    assert store.added == 20


@given(st.lists(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 3)), max_size=8), max_size=5))
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_store_changes_neither_outcomes_nor_counts(
    tmp_path: Path, calls: list[list[tuple[int, int]]]
) -> None:
    (tmp_path / "any.sqlite").unlink(missing_ok=True)
    plain = runner(Counted(), None)
    with Store(tmp_path / "any.sqlite") as store:
        for resumed in (runner(Counted(), store), runner(Counted(), store)):
            for call in calls:
                index = np.array([k for k, _ in call], dtype=np.intp)
                x = np.array([[float(v)] for _, v in call]).reshape(-1, 1)
                np.testing.assert_array_equal(resumed(index, x), plain(index, x))
            assert resumed.runs == plain.runs == len({run for call in calls for run in call})


def test_experiments_under_equal_conditions_and_other_studies_share_runs(store: Store) -> None:
    function = Counted()
    runner(function, store)([0, 1], [[1.0], [1.0]])
    twice = pd.DataFrame({"load": [2.0, 2.0, 1.0], "bench": [*"xyz"]})
    other = runner(function, store, table=Conditions(("P", "Q", "R"), twice))
    assert other([0, 1, 2], [[1.0]] * 3).tolist() == [2.0, 2.0, 1.0]
    assert function.calls == 2


def test_the_order_of_the_parameters_does_not_matter(store: Store) -> None:
    def difference(load: float, a: float, b: float) -> float:
        return load * (a - b)

    one = Runner(FunctionSimulator(difference), TABLE, ["a", "b"], store=store)
    two = Runner(FunctionSimulator(difference), TABLE, ["b", "a"], store=store)
    assert one([1], [[3.0, 1.0]]).tolist() == two([1], [[1.0, 3.0]]).tolist() == [4.0]
    assert (one.fresh, two.fresh) == (1, 0)


def test_a_failed_run_is_kept_with_its_message_before_it_is_raised(store: Store) -> None:
    function = Counted(lambda load, x: x > 0.5)
    function.error = RunFailed("it ended with exit code 3", "pressure too high")
    with pytest.raises(SimulatorError):
        runner(function, store)([0, 1], [[0.1], [0.9]])
    good, bad = all_runs(store)
    assert (good.outcome, good.failure) == (0.1, None)
    assert (bad.outcome, bad.failure, bad.log) == (
        None, "it ended with exit code 3", "pressure too high",
    )  # fmt: skip
    assert (bad.conditions, bad.parameters) == ({"load": 2.0}, {"x": 0.9})


def test_a_run_that_stopped_a_study_is_tried_again(store: Store) -> None:
    function = Counted(lambda load, x: x > 0.5)
    for _ in range(2):
        with pytest.raises(SimulatorError):
            runner(function, store)([0, 1], [[0.1], [0.9]])
    assert all_runs(store)[1].attempt == 2
    function.fails = lambda load, x: False
    assert runner(function, store)([0, 1], [[0.1], [0.9]]).tolist() == [0.1, 1.8]
    assert function.calls == 1 + 3
    assert (all_runs(store)[1].failure, all_runs(store)[1].attempt) == (None, 3)


@pytest.mark.parametrize("vectorized", [False, True])
def test_failures_that_are_an_answer_are_not_repeated(store: Store, vectorized: bool) -> None:
    calls = []

    def brittle(load: Any, x: Any) -> Any:
        calls.append(np.size(x))
        if np.any(x > 0.75):
            raise ValueError("too stiff")
        return np.where(x < 0.2, np.nan, load * x)[()]

    x = points(11)
    first = runner(brittle, store, vectorized).attempt(np.ones(11, int), x)
    tried = len(calls)
    again = runner(brittle, store, vectorized)
    np.testing.assert_array_equal(again.attempt(np.ones(11, int), x), first)
    assert np.isnan(first).tolist() == ((x[:, 0] < 0.2) | (x[:, 0] > 0.75)).tolist()
    assert (len(calls), again.runs) == (tried, 11)
    reasons = [run.failure for run in all_runs(store) if run.failure]
    assert sum("too stiff" in reason for reason in reasons) == 3
    assert reasons.count("it returned nan") == 2


def test_an_outcome_without_logarithm_is_an_outcome_of_another_study(store: Store) -> None:
    log = Conditions(TABLE.ids, TABLE.conditions, "log")
    function = Counted()
    with pytest.raises(SimulatorError, match="logarithm of -2"):
        runner(function, store, table=log)([1], [[-1.0]])
    assert runner(function, store)([1], [[-1.0]]).tolist() == [-2.0]
    assert function.calls == 1
    with pytest.raises(SimulatorError, match="logarithm of -2"):
        runner(function, store, table=log)([1], [[-1.0]])


@pytest.mark.parametrize("error", [ValueError("broken"), KeyboardInterrupt(), SystemExit()])
def test_runs_are_kept_whatever_stops_them(store: Store, error: BaseException) -> None:
    said = list[str]()
    function = Counted(lambda load, x: load == 4.0)
    function.error = error
    run = runner(function, store)
    stopped = isinstance(error, KeyboardInterrupt)
    # a simulator that calls sys.exit is at fault; only Ctrl-C is the user's own
    expected = KeyboardInterrupt if stopped else SimulatorError
    with pytest.raises(expected), notified(run.cache, "study.toml", said.append):
        run([0, 1, 2], [[1.0], [2.0], [3.0]])
    count = 2 if stopped else 3
    assert said == [f"{store.path} keeps {count} new runs: the same command goes on from there"]
    mended = Counted()
    again = runner(mended, store)
    with notified(again.cache, "study.toml", said.append):
        again([0, 1, 2], [[1.0], [2.0], [3.0]])
    assert mended.calls == 1
    assert said[1].startswith(f"{store.path} has {count} runs of this simulator")


def test_ctrl_c_while_the_runs_are_written_loses_none(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    add, calls = store.add, []

    def interrupted(*arguments: Any) -> int:
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return add(*arguments)

    monkeypatch.setattr(store, "add", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runner(lambda load, x: load * x, store, vectorized=True)([0, 1], [[1.0], [2.0]])
    assert [run.outcome for run in all_runs(store)] == [1.0, 4.0]


def test_slow_runs_are_committed_one_by_one(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("aleator.simulators.dispatch.time.perf_counter", lambda: now[0])
    seen = []

    def slow(load: float, x: float) -> float:
        seen.append(len(all_runs(store)))
        now[0] += 0.2
        return load * x

    runner(slow, store)([0] * 5, points(5))
    assert seen == [0, 1, 2, 3, 4]
    assert [run.seconds for run in all_runs(store)] == pytest.approx([0.2] * 5)


def test_every_run_is_kept_however_cheap_and_many(store: Store) -> None:
    calls = list[int]()

    def product(load: np.ndarray, x: np.ndarray) -> np.ndarray:
        calls.append(len(x))
        return load * x

    x = np.random.default_rng(0).random((10_000, 1))
    index = np.arange(len(x)) % 3
    for _ in range(2):
        outcome = runner(product, store, vectorized=True)(index, x)
        np.testing.assert_array_equal(outcome, np.array([1.0, 2.0, 4.0])[index] * x[:, 0])
        assert sum(calls) == len(x) == len(all_runs(store))


def test_a_simulator_that_no_longer_does_what_it_did_is_found_out(store: Store) -> None:
    function = Counted()
    runner(function, store).require_repeatable([0.5])
    runner(function, store).require_repeatable([0.5])
    assert function.calls == 3

    def drifted(load: float, x: float) -> float:
        return function(load, x) + len(all_runs(store))

    first = runner(drifted, store, version="A")([0], [[0.5]])
    assert first == 0.5 + 1
    with pytest.raises(SimulatorError, match="for the same run"):
        runner(drifted, store, version="A").require_repeatable([0.5])


def test_a_version_stands_for_what_the_simulator_does(store: Store) -> None:
    def found(function: Callable[..., Any], version: str) -> float:
        return float(runner(function, store, version=version)([0], [[1.0]])[0])

    assert found(lambda load, x: load * x, "1") == 1.0
    assert found(lambda load, x: 2 * load * x, "1") == 1.0
    assert found(lambda load, x: 2 * load * x, "2") == 2.0


def test_the_source_of_a_function_of_a_notebook_tells_its_changes() -> None:
    prints = set()
    for text in ("load * x", "2 * load * x", "load * x"):
        scope: dict[str, Any] = {"__name__": "__main__"}
        name = f"<cell {text}>"
        source = f"def model(load, x):\n    return {text}\n"
        linecache.cache[name] = (len(source), None, source.splitlines(keepends=True), name)
        exec(compile(source, name, "exec"), scope)
        prints.add(FunctionSimulator(scope["model"]).fingerprint())
    assert len(prints) == 2


BENCHES = Conditions(("A", "B"), pd.DataFrame({"load": [2.0, 3.0], "bench": ["7", "b"]}))


def length(load: float, bench: str, x: float) -> float:
    return load * x


def every(load: float, bench: str, x: float) -> np.ndarray:
    return np.array([load * x, x])


def brought(folder: Path, text: str, simulator: FunctionSimulator | None = None) -> int:
    (folder / "runs.csv").write_text(text)
    with Store(folder / "runs.sqlite") as store:
        own = simulator or FunctionSimulator(length)
        return records.read(store, folder / "runs.csv", own).added


HEAD = "condition.load,condition.bench,parameter.x,outcome"


def test_runs_from_elsewhere_are_used_however_a_number_is_written(tmp_path: Path) -> None:
    rows = '2,"""7""",1,20\n3.0,b,1.0,30\n3e0,b,2,31.5\n'
    assert brought(tmp_path, f"{HEAD}\n{rows}") == 3
    with Store(tmp_path / "runs.sqlite") as store:
        run = Runner(FunctionSimulator(length), BENCHES, ["x"], store=store)
        assert run([0, 1, 1], [[1.0], [1.0], [2.0]]).tolist() == [20.0, 30.0, 31.5]
        assert run.fresh == 0


@pytest.mark.parametrize(
    ("head", "name"),
    [
        ("condition.load,condition.bench,condition.farce,parameter.x,outcome", "'farce'"),
        ("condition.load,condition.farce,parameter.x,outcome", "'bench'"),
        ("condition.load,condition.bench,parameter.farce,outcome", "'farce'"),
        ("condition.load,condition.bench,parameter.x,parameter.y,outcome", "'y'"),
        ("condition.load,condition.,parameter.x,outcome", "'condition.'"),
        ("condition.load,condition.bench,condition.load,parameter.x,outcome", "twice"),
    ],
)
def test_runs_that_could_never_be_asked_for_are_refused(
    tmp_path: Path, head: str, name: str
) -> None:
    row = ",".join("1" * (head.count(",") + 1))
    with pytest.raises(StoreError) as told:
        brought(tmp_path, f"{head}\n{row}\n")
    assert name in told.value.problem


def test_what_one_run_serves_must_be_what_the_simulator_makes(tmp_path: Path) -> None:
    series = FunctionSimulator(every, series=True)
    with pytest.raises(StoreError, match="rows"):
        brought(tmp_path, f"{HEAD}\n2,b,1,20\n", series)
    assert brought(tmp_path, f'{HEAD},rows\n2,b,1,"[20, 1]",2\n', series) == 1
    with pytest.raises(StoreError, match="one row"):
        brought(tmp_path, f'{HEAD},rows\n2,b,1,"[20, 1]",2\n')


ROWS = {
    "time": ["2026-01-01T00:00:00+24:00", "0001-01-01", "noon"],
    "attempt": ["9" * 5000, "0", "1.5", str(2**63)],
    "seconds": ["-1", "nan", "1_0"],
    "rows": ["2", "0", "x"],
    "responses": ['["\\ud800"]', "5", '["a", "a"]', '["a", "b"]'],
    "outcome": ["[" * 100_000, "[1, 2, 3]", "[null]", "1" + "0" * 400, "1_0"],
}


@pytest.mark.parametrize(("column", "cell"), [(c, cell) for c, v in ROWS.items() for cell in v])
def test_a_cell_that_no_store_can_hold_is_told_with_its_line(
    tmp_path: Path, column: str, cell: str
) -> None:
    good = {"condition.load": "2", "condition.bench": "b", "parameter.x": "1", "outcome": "20"}
    pd.DataFrame([good, good | {column: cell}]).to_csv(tmp_path / "bad.csv", index=False)
    with pytest.raises(StoreError, match="line 3"):
        brought(tmp_path, (tmp_path / "bad.csv").read_text())
    with Store(tmp_path / "runs.sqlite") as store:
        assert not [*stored_runs(store)]


def test_whatever_was_kept_travels(tmp_path: Path) -> None:
    """A failure of any length, half a character in a condition, a series beside single runs."""
    half = '"\\ud800"'
    table = Conditions(("A", "B"), pd.DataFrame({"load": [2.0, 3.0], "bench": [half, "b"]}))

    def brittle(load: float, bench: str, x: float) -> float:
        if bench == "b":
            raise ValueError("broken " * 30_000)
        return load * x

    with Store(tmp_path / "runs.sqlite") as store:
        Runner(brittle, table, ["x"], store=store).attempt([0, 1], [[1.0], [1.0]])
        two = Conditions(
            ("A",), pd.DataFrame({"load": [4.0, 4.0], "bench": ["c", "c"]}), experiment=[0, 0]
        )
        series = FunctionSimulator(every, series=True)
        Runner(series, two, ["x"], store=store).values([0], [[1.0]])
        before = [*stored_runs(store)]
        assert records.write(before, tmp_path / "a.csv") == 3
    with Store(tmp_path / "copy.sqlite") as copy:
        assert records.read(copy, tmp_path / "a.csv").added == 3
        records.write(stored_runs(copy), tmp_path / "b.csv")
    assert max(len(run.failure or "") for run in before) > 131_072
    first, again = (pd.read_csv(tmp_path / f"{name}.csv", dtype=str) for name in "ab")
    order = ["fingerprint", "condition.load"]
    pd.testing.assert_frame_equal(
        first.sort_values(order, ignore_index=True).drop(columns="time"),
        again.sort_values(order, ignore_index=True).drop(columns="time"),
    )


def test_a_blank_condition_is_none(tmp_path: Path) -> None:
    head = "condition.load,condition.bench,condition.farce,parameter.x,outcome"
    assert brought(tmp_path, f"{head}\n2,b,,1,20\n") == 1
