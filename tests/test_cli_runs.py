"""`aleator runs`: what is kept can be seen, taken away, brought in and forgotten."""

from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.simulators import Identity, Store, records
from aleator.simulators.records import StoredRun

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
"""
MODEL = """\
def length(load, bench, softness):
    if softness > 1.45 and load > 3:
        raise ValueError("the spring broke")
    return load * softness
"""
TABLE = "id,load,bench,length\nA,1,007,0.93\nB,2,007,2.1\nC,3,b,3.2\nD,4,c,3.7\nE,5,c,5.4\n"
STORE = Path("springs/runs.sqlite")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, ["runs", *map(str, arguments)])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study of text conditions whose runs are those of its feasible box, some of them failed."""
    folder = tmp_path / "springs"
    folder.mkdir()
    (folder / "springs.csv").write_text(TABLE)
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli.main, ["box", "springs/study.toml", "--quiet"])
    assert done.exit_code == 0, done.output
    return Path("springs/study.toml")


def contents(path: Path = STORE) -> list[records.StoredRun]:
    with Store(path) as store:
        return [*records.stored_runs(store)]


def test_list_tells_runs_and_failures_of_every_simulator(study: Path) -> None:
    runs = contents()
    failed = sum(run.failure is not None for run in runs)
    assert failed
    for target in (study, STORE):
        done = run("list", target)
        assert done.exit_code == 0, done.output
        assert f"{len(runs)}" in done.output
        assert f"{failed}" in done.output
        assert ("study's" in done.output) == (target == study)
    study.with_name("model.py").write_text(MODEL + "# changed\n")
    assert "study's" not in run("list", study).output


def test_show_has_the_last_runs_the_failures_and_all_of_one(study: Path) -> None:
    failure = next(run for run in contents() if run.failure)
    shown = run("show", study, "--failures").output
    assert "the spring broke" in " ".join(shown.split())
    assert "load=1" not in shown
    one = run("show", study, failure.number).output
    assert "model.py, line 3" in " ".join(one.split())
    assert repr(failure.parameters["softness"]) in one
    absent = run("show", study, 10**9)
    assert absent.exit_code == 2
    assert f"{10**9}" in absent.stderr


def test_an_import_does_not_change_what_is_there(study: Path) -> None:
    run("export", study, "runs.csv")
    frame = pd.read_csv("runs.csv", dtype=str)
    good = frame.index[frame["outcome"].notna()][0]
    before = contents()
    frame.loc[good, "outcome"] = "123.5"
    frame.to_csv("other.csv", index=False)
    told = run("import", study, "other.csv")
    assert told.exit_code == 0
    assert "1 of these" in told.output
    assert contents() == before


def test_retry_forgets_the_failures_alone(study: Path) -> None:
    before = contents()
    failed = [run for run in before if run.failure]
    assert f"{len(failed)} failures" in run("retry", study).output
    assert contents() == [run for run in before if not run.failure]


def test_forget_asks_and_then_forgets_old_fingerprints_or_all(study: Path) -> None:
    first = contents()
    study.with_name("model.py").write_text(MODEL + "# changed\n")
    CliRunner().invoke(cli.main, ["box", str(study), "--quiet"])
    asked = run("forget", study, "--old")
    assert asked.exit_code == 2
    assert f"{len(first)} runs" in asked.stderr
    assert "--yes" in asked.stderr
    assert len(contents()) == 2 * len(first)
    assert f"{len(first)} runs" in run("forget", study, "--old", "--yes").output
    left = contents()
    assert len(left) == len(first)
    assert {run.simulator.fingerprint for run in left}.isdisjoint(
        run.simulator.fingerprint for run in first
    )
    assert run("forget", study, "--fingerprint", "zz", "--yes").exit_code == 0
    assert contents() == left
    assert run("forget", STORE, "--all", "--yes").exit_code == 0
    assert contents() == []
    for arguments in ((study,), (study, "--old", "--all"), (STORE, "--old")):
        assert run("forget", *arguments).exit_code == 2


def test_what_cannot_be_done_is_told(study: Path) -> None:
    nowhere = run("list", "nowhere.sqlite")
    assert nowhere.exit_code == 2
    assert "nowhere.sqlite" in nowhere.stderr
    assert ".xlsx" in run("export", study, "runs.xlsx").stderr
    Path("runs.csv").touch()
    for refused in (run("export", study, "runs.csv"), run("import", study, "absent.csv")):
        assert refused.exit_code == 2
        assert refused.stderr.count("aleator: error: ") == 1
    assert Path("runs.csv").read_text() == ""  # what is there already stays


def test_runs_of_different_simulators_are_rows_of_one_table() -> None:
    def kept(number: int, conditions: dict[str, float], parameters: dict[str, float]) -> StoredRun:
        return StoredRun(
            number,
            Identity("f", "model"),
            conditions,
            parameters,
            1.0,
            None,
            None,
            0.1,
            "h",
            0.0,
            1,
        )

    runs = [kept(1, {"a": 2.0}, {"x": 3.0}), kept(2, {"b": 4.0}, {"x": 5.0, "y": 6.0})]
    frame = records.table(runs)
    rows = frame[["condition.a", "condition.b", "parameter.x", "parameter.y"]].fillna(-1.0)
    assert rows.to_numpy().tolist() == [[2.0, -1.0, 3.0, -1.0], [-1.0, 4.0, 5.0, 6.0]]
    assert [*frame.columns[:4]] == ["fingerprint", "simulator", "description", "version"]
    assert [*records.table([]).columns] == [*frame.columns[:4], *frame.columns[8:]]
