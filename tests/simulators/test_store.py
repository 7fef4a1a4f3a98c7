"""A store gives back every bit, survives kills and crowds, and says what is wrong with its file."""

import json
import os
import pickle
import random
import signal
import sqlite3
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aleator import cli
from aleator.errors import StoreError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner, Store, notified, records
from aleator.simulators.records import runs_by_simulator, stored_runs
from aleator.simulators.runs import REPEATABILITY
from aleator.simulators.store import Case, Identity, StoreSettings

MODEL = Identity("f" * 64, "spring", "model:spring")
CASE = Case.of({"load": 2.0}, ["k"])


def row(x: float, outcome: float | None, case: int = 0, seconds: float = 1e-3) -> tuple:
    failure = None if outcome is not None else "it broke"
    return (case, struct.pack("<d", x), outcome, failure, None, seconds, "bench", 1.0, 1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs.sqlite"


def outcomes(store: Store, cases: list[Case], keys: list) -> dict:
    return {place: outcome for place, outcome, *_ in store.find(MODEL.fingerprint, cases, keys)}


def found(store: Store, x: float, case: Case = CASE, fingerprint: str = MODEL.fingerprint) -> dict:
    back = store.find(fingerprint, [case], [(0, struct.pack("<d", x))])
    return {x: back[0][1]} if back else {}


@given(st.floats(), st.floats(allow_nan=False, allow_infinity=False))
@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_every_bit_of_a_run_comes_back(tmp_path: Path, x: float, outcome: float) -> None:
    with Store(tmp_path / "bits.sqlite") as store:
        fresh = Identity(struct.pack("<dd", x, outcome).hex(), "bits")
        store.add(fresh, [CASE], [row(x, outcome)])
        key = struct.pack("<d", x)
        ((_, back, *_),) = store.find(fresh.fingerprint, [CASE], [(0, key)])
        assert back is not None
        assert struct.pack("<d", back) == struct.pack("<d", outcome)


def test_only_the_same_simulator_conditions_and_parameters_are_found(path: Path) -> None:
    with Store(path) as store:
        store.add(MODEL, [CASE], [row(4.0, 0.5)])
        assert found(store, 4.0) == {4.0: 0.5}
        assert found(store, np.nextafter(4.0, 5.0)) == {}
        assert found(store, 4.0, Case.of({"load": 2.5}, ["k"])) == {}
        assert found(store, 4.0, Case.of({"load": 2.0}, ["stiffness"])) == {}
        assert found(store, 4.0, Case.of({"load": 2.0, "bench": "A"}, ["k"])) == {}
        assert found(store, 4.0, fingerprint="e" * 64) == {}


def test_conditions_are_told_apart_by_kind_and_not_by_order() -> None:
    assert Case.of({"a": 1.0, "b": "x"}, ["k"]) == Case.of({"b": "x", "a": np.float64(1)}, ["k"])
    assert Case.of({"a": 0.1 + 0.2}, []) != Case.of({"a": 0.3}, [])
    assert Case.of({"a": "1.0"}, []) != Case.of({"a": 1.0}, [])


def test_a_run_with_an_outcome_is_never_changed(path: Path) -> None:
    with Store(path) as store:
        assert store.add(MODEL, [CASE], [row(4.0, 0.5)]) == 1
        assert store.add(MODEL, [CASE], [row(4.0, 0.7)]) == 0
        assert store.add(MODEL, [CASE], [row(4.0, None)]) == 0
        assert found(store, 4.0) == {4.0: 0.5}


def test_a_failed_run_is_replaced_and_its_attempts_are_counted(path: Path) -> None:
    with Store(path) as store:
        for outcome in (None, None, 0.5):
            store.add(MODEL, [CASE], [row(4.0, outcome)])
        assert store.connection.execute(
            "SELECT outcome, failure, attempt FROM runs"
        ).fetchall() == [(0.5, None, 3)]
        store.add(MODEL, [CASE], [row(5.0, None)])
        assert store.add(MODEL, [CASE], [row(5.0, 0.1)], again=False) == 0
        assert found(store, 5.0) == {5.0: None}


def test_runs_of_many_cases_are_found_in_one_go(path: Path) -> None:
    loads = np.random.default_rng(3).permutation(300)
    cases = [Case.of({"load": float(load)}, ["k"]) for load in loads]
    with Store(path) as store:
        # every second case, and of it every third run, each with an outcome of its own
        rows = [
            row(float(x), 1e3 * k + x, k // 2) for k in range(0, 300, 2) for x in range(0, 9, 3)
        ]
        assert store.add(MODEL, cases[::2], rows) == len(rows)
        keys = [(k, struct.pack("<d", float(x))) for x in range(9) for k in range(300)]
        found = outcomes(store, cases, keys)
    assert found == {300 * x + k: 1e3 * k + x for x in range(0, 9, 3) for k in range(0, 300, 2)}


def test_a_run_that_is_sought_twice_is_found_twice(path: Path) -> None:
    key = (0, struct.pack("<d", 4.0))
    with Store(path) as store:
        store.add(MODEL, [CASE, CASE], [row(4.0, 0.5), row(5.0, 0.6, case=1)])
        assert outcomes(store, [CASE], [key, (0, b""), key]) == {0: 0.5, 2: 0.5}
        assert store.find(MODEL.fingerprint, [CASE], []) == []
        assert store.find(MODEL.fingerprint, [], []) == []
        assert found(store, 5.0) == {5.0: 0.6}


def test_a_block_is_written_whole_or_not_at_all(path: Path) -> None:
    with Store(path) as store:
        broken = (0, b"", None, None, None, 0.0, "bench", 1.0, 1)  # neither outcome nor failure
        with pytest.raises(Exception, match="CHECK"):
            store.add(MODEL, [CASE], [row(1.0, 1.0), broken])
        assert found(store, 1.0) == {}
        assert store.add(MODEL, [CASE], [row(1.0, 1.0)]) == 1


def test_runs_are_counted_with_those_of_other_fingerprints(path: Path) -> None:
    other = Identity("e" * 64, MODEL.name, MODEL.description)
    stranger, elsewhere = Identity("d" * 64, "damper"), Identity("c" * 64, MODEL.name, "its force")
    with Store(path) as store:
        store.add(MODEL, [CASE], [row(1.0, 1.0), row(2.0, None)])
        store.add(other, [CASE], [row(1.0, 1.0)])
        store.add(stranger, [CASE], [row(1.0, 1.0)])
        store.add(elsewhere, [CASE], [row(1.0, 1.0)])  # another outcome of it is no older version
        counts = store.counts(MODEL)
    assert (counts.runs, counts.failures, counts.other) == (2, 1, 1)
    assert counts.seconds == pytest.approx(2e-3)


def test_another_process_gets_a_connection_of_its_own(path: Path) -> None:
    with Store(path) as store:
        store.add(MODEL, [CASE], [row(4.0, 0.5)])
        with pickle.loads(pickle.dumps(store)) as copy:
            assert copy.connection is not store.connection
            assert found(copy, 4.0) == {4.0: 0.5}


def test_a_closed_store_is_one_sound_file(path: Path) -> None:
    with Store(path) as store:
        store.add(MODEL, [CASE], [row(float(k), 1.0) for k in range(2000)])
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    with sqlite3.connect(path) as plain:
        assert plain.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    plain.close()


TABLE = Conditions(("A",), pd.DataFrame({"load": [2.0]}))


def double(load: float, x: float) -> float:
    return load * x


def runner(store: Store) -> Runner:
    return Runner(FunctionSimulator(double), TABLE, ["x"], store=store)


@pytest.fixture
def without_rights(monkeypatch: pytest.MonkeyPatch) -> None:
    """The superuser may write anything: let the system answer as it would to anybody else.

    To be somebody else for a while does not do: where the tests are, only root may be allowed in.
    """

    def allowed(path: str | Path, mode: int) -> bool:
        return Path(path).exists() and (Path(path).stat().st_mode >> 6) & mode == mode

    if os.geteuid() == 0:
        monkeypatch.setattr("aleator.simulators.store.os.access", allowed)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder that may be made read-only."""
    path = tmp_path / "folder"
    path.mkdir()
    yield path
    path.chmod(0o755)


def read_only(folder: Path) -> None:
    for file in folder.iterdir():
        file.chmod(0o444)
    folder.chmod(0o555)


def other_text(path: Path) -> None:
    path.write_text("load,x,outcome\n" * 100)


def other_database(path: Path) -> None:
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("CREATE TABLE runs (a)")


def newer_store(path: Path) -> None:
    with Store(path) as store:
        runner(store)([0], [[1.0]])
        store.connection.execute("PRAGMA user_version = 2")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (other_text, ["not a store of runs"]),
        (other_database, ["not a store of runs"]),
        (newer_store, ["newer Aleator", "install"]),
    ],
)
def test_what_is_no_store_of_this_version_is_told_and_left_alone(
    tmp_path: Path, make: Callable[[Path], None], words: list[str]
) -> None:
    path = tmp_path / "runs.sqlite"
    make(path)
    before = path.read_bytes()
    with pytest.raises(StoreError) as told:
        Store(path)
    assert [word for word in words if word not in str(told.value)] == []
    assert path.read_bytes() == before


def test_a_damaged_store_is_told_and_not_written_to(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as store:
        runner(store)([0] * 500, [[float(k)] for k in range(500)])
    whole = bytearray(path.read_bytes())
    whole[4096:] = b"\xa5" * (len(whole) - 4096)
    path.write_bytes(whole)
    with pytest.raises(StoreError, match="damaged") as told, Store(path) as store:
        runner(store)([0], [[1.0]])
    assert "move the file aside" in told.value.remedy
    assert path.read_bytes()[4096:] == whole[4096:]


DAMAGE = {
    "conditions": "UPDATE cases SET conditions = '{'",
    "conditions that are none": "UPDATE cases SET conditions = '[1]'",
    "names": "UPDATE cases SET parameters = '[]'",
    "parameters": "UPDATE runs SET x = x'00'",
    "outcome": "UPDATE runs SET outcome = x'00'",
    "a text": "UPDATE runs SET outcome = 'abc'",
    "time": "UPDATE runs SET time = 1e300",
    "bytes that are no text": "UPDATE simulators SET name = CAST(x'ff' AS TEXT)",
}


@pytest.mark.parametrize("statement", DAMAGE.values(), ids=DAMAGE)
def test_what_the_file_does_not_notice_is_told_too(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as store:
        runner(store)([0], [[1.0]])
        store.connection.execute(statement)
    with Store(path) as store:
        with pytest.raises(StoreError, match=r"runs\.sqlite: .*damaged|decode"):
            records.write(stored_runs(store), tmp_path / "runs.csv")
        if "outcome" in statement:
            with pytest.raises(StoreError, match="a run of 'double' is damaged"):
                runner(store)([0], [[1.0]])
        if "time" in statement or "name =" in statement:
            with pytest.raises(StoreError, match=r"runs\.sqlite"):
                runs_by_simulator(store)
    assert not (tmp_path / "runs.csv").exists()


def test_a_table_whose_very_layout_is_damaged_is_told(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as store:
        runner(store)([0], [[1.0]])
    whole = path.read_bytes()
    assert b"CREATE TABLE simulators" in whole
    path.write_bytes(
        whole.replace(b"CREATE TABLE simulators", b"CREATE TABLE \xc5\xc5\xc5\xc5\xc5tors")
    )
    with pytest.raises(StoreError, match="damaged"):
        Store(path)


def test_a_full_disk_is_told_and_what_was_written_stays(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as store:
        run = runner(store)
        run([0], [[1.0]])
        pages = store.connection.execute("PRAGMA page_count").fetchone()[0]
        store.connection.execute(f"PRAGMA max_page_count = {pages + 2}")
        with pytest.raises(StoreError, match="the disk is full") as told:
            run([0] * 1000, [[float(k)] for k in range(1000)])
    assert "free some space" in told.value.remedy
    with Store(path) as store:
        kept = runner(store).cache
        assert kept is not None
        assert 1 <= kept.at_start.runs < 1000
        assert runner(store)([0], [[1.0]]).tolist() == [2.0]


@pytest.mark.usefixtures("without_rights")
def test_a_folder_that_is_read_only_is_told_before_anything_runs(folder: Path) -> None:
    read_only(folder)
    with pytest.raises(StoreError, match="it is read-only") as told:
        Store(folder / "runs.sqlite")
    assert "--no-store" in told.value.remedy
    with pytest.raises(StoreError, match="there is no such folder"):
        Store(folder / "nowhere" / "runs.sqlite")
    with pytest.raises(StoreError, match="is a folder"):
        Store(folder)


@pytest.mark.usefixtures("without_rights")
def test_the_runs_of_a_read_only_store_are_reused(folder: Path) -> None:
    path = folder / "runs.sqlite"
    with Store(path) as store:
        runner(store)([0], [[1.0]])
    read_only(folder)
    before, said = path.read_bytes(), list[str]()
    with Store(path) as store:
        assert not store.writable
        run = runner(store)
        with notified(run.cache, "study.toml", said.append):
            assert run([0, 0], [[1.0], [3.0]]).tolist() == [2.0, 6.0]
        assert (run.runs, run.fresh) == (2, 1)
    assert "is read-only" in said[-1]
    assert path.read_bytes() == before
    assert [file.name for file in folder.iterdir()] == [path.name]


def test_an_empty_file_becomes_a_store(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    path.touch()
    with Store(path) as store:
        assert runner(store)([0], [[1.0]]).tolist() == [2.0]


def test_a_store_that_another_process_holds_is_told(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as first, Store(path, StoreSettings(patience=0.1)) as second:
        first.connection.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match="another process has been writing"):
            runner(second)([0], [[1.0]])
        first.connection.execute("ROLLBACK")
        assert runner(second)([0], [[1.0]]).tolist() == [2.0]


STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = false
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 1
[verification]
samples = 50
"""
SLOW_MODEL = """\
import os, time
log = os.open({log!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
def length(load, softness):
    time.sleep(0.002)
    os.write(log, f"{{load!r}} {{softness!r}}\\n".encode())
    return load * softness ** 1.1
"""
PART = 16  # cheap runs are committed by as many
COMMAND = [sys.executable, "-c", "from aleator.cli import main; main()"]


def study_of(folder: Path, log: Path) -> Path:
    folder.mkdir()
    lengths = [0.93, 2.1, 3.2, 3.7, 5.4, 5.8, 7.9, 7.6]
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(lengths)]
    (folder / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    (folder / "model.py").write_text(SLOW_MODEL.format(log=str(log)))
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


def document(folder: Path) -> dict[str, object]:
    found = json.loads((folder / "identification.json").read_text())
    del found["seconds"]
    return found


def stored(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        return int(connection.execute("SELECT count(*) FROM runs").fetchone()[0])


def lines_of(log: Path) -> int:
    return log.read_bytes().count(b"\n") if log.exists() else 0


@pytest.mark.slow
@pytest.mark.usefixtures("unreported", "unjudged_commands")
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no kill -9")
def test_a_study_killed_again_and_again_ends_with_the_same_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study, log = study_of(tmp_path / "springs", tmp_path / "calls.txt"), tmp_path / "calls.txt"
    arguments = ["identify", "springs/study.toml", "--quiet", "--no-figures", "--output"]
    whole = CliRunner().invoke(cli.main, [*arguments, "whole", "--no-store"])
    assert whole.exit_code == 0, whole.output
    needed = lines_of(log)
    distinct = len(set(log.read_text().splitlines()))
    log.unlink()

    store, chance, kills = study.with_name("runs.sqlite"), random.Random(7), 2
    for number in range(kills):
        before = stored(store) if store.exists() else 0
        goal = lines_of(log) + chance.randrange(1, needed // (kills + 1))
        process = subprocess.Popen([*COMMAND, *arguments, "result"])
        while lines_of(log) < goal:
            assert process.poll() is None
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, 0.01))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        # All is there but what was being computed; the repeated runs of each start add none.
        kept = stored(store)
        assert kept >= before
        assert kept >= lines_of(log) - (number + 1) * (PART + 1 + REPEATABILITY.most)
    done = CliRunner().invoke(cli.main, [*arguments, "result"])
    assert done.exit_code == 0, done.output
    assert document(tmp_path / "result") == document(tmp_path / "whole")
    assert stored(store) == distinct
    assert lines_of(log) <= distinct + kills * PART + (kills + 1) * (1 + REPEATABILITY.most)


WRITER = """\
import struct, sys
from aleator.simulators.store import Case, Identity
from aleator.simulators.store import Store
path, name, start = sys.argv[1], sys.argv[2], int(sys.argv[3])
case = Case.of({"load": 1.0}, ["x"])
print("ready", flush=True)
sys.stdin.readline()
with Store(path) as store:
    for block in range(100):
        xs = [float(start + 10 * block + k) for k in range(20)]
        rows = [(0, struct.pack("<d", x), 2 * x, None, None, 0.0, name, 0.0, 1) for x in xs]
        store.add(Identity("f", "model"), [case], rows)
        found = store.find("f", [case], [row[:2] for row in rows])
        assert [outcome for _, outcome, *_ in found] == [2 * x for x in xs]
"""


def test_two_processes_may_fill_one_store_at_once(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, path, name, start],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name, start in (("one", "0"), ("two", "500"))
    ]
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate()
    assert [writer.returncode for writer in writers] == [0, 0]
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        runs = connection.execute("SELECT x, outcome FROM runs").fetchall()
        assert connection.execute("SELECT count(*) FROM simulators").fetchone() == (1,)
    # 0 to 1009 and 500 to 1509, each once
    assert len(runs) == 1510
    assert len({x for x, _ in runs}) == 1510


def test_a_commit_waits_for_the_disk_after_a_second_of_runs(path: Path) -> None:
    with Store(path) as store:

        def waits() -> bool:
            return bool(store.connection.execute("PRAGMA synchronous").fetchone()[0] == 2)

        seen = []
        for k, seconds in enumerate((0.4, 0.4, 0.4, 0.4, 3600.0, 0.1)):
            store.add(MODEL, [CASE], [row(float(k), 1.0, seconds=seconds)])
            seen.append(waits())
    assert seen == [False, False, True, False, True, False]
