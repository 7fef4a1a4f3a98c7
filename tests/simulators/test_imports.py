"""Runs out of tables: what can be used is kept bit by bit, what cannot is told with its line."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator.errors import StoreError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner, Store, records
from aleator.simulators.records import stored_runs

TABLE = Conditions(("A", "B"), pd.DataFrame({"load": [2.0, 3.0], "bench": ["7", "b"]}))


def length(load: float, bench: str, x: float) -> float:  # noqa: ARG001
    return load * x


def every(load: float, bench: str, x: float) -> np.ndarray:  # noqa: ARG001
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
        run = Runner(FunctionSimulator(length), TABLE, ["x"], store=store)
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


def test_a_blank_condition_is_none(tmp_path: Path) -> None:
    head = "condition.load,condition.bench,condition.farce,parameter.x,outcome"
    assert brought(tmp_path, f"{head}\n2,b,,1,20\n") == 1


def test_what_one_run_serves_must_be_what_the_simulator_makes(tmp_path: Path) -> None:
    series = FunctionSimulator(every, series=True)
    with pytest.raises(StoreError, match="rows"):
        brought(tmp_path, f"{HEAD}\n2,b,1,20\n", series)
    assert brought(tmp_path, f'{HEAD},rows\n2,b,1,"[20, 1]",2\n', series) == 1
    with pytest.raises(StoreError, match="one row"):
        brought(tmp_path, f'{HEAD},rows\n2,b,1,"[20, 1]",2\n')


ROWS = {
    "time": ["2026-01-01T00:00:00+24:00", "0001-01-01", "9999-12-31T23:59:59-23:59", "noon"],
    "attempt": ["1" + "0" * 22, "9" * 5000, "0", "1.5", str(2**63)],
    "seconds": ["-1", "nan", "1_0"],
    "rows": ["2", "0", "1" + "0" * 22, "x"],
    "responses": ['["\\ud800"]', "[" * 100_000, "5", '"ab"', '["a", "a"]', '["a", "b"]'],
    "outcome": ["[]", "[" * 100_000, "[1, 2]", "[true]", "[null]", "1" + "0" * 400, "1_0"],
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
