"""Whatever is wrong with the file of a store is one message, and the file stays as it was."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pandas as pd
import pytest

from aleator.errors import StoreError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner, Store, notified, records
from aleator.simulators.records import holdings, stored_runs
from aleator.simulators.store import StoreSettings

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


def test_a_text_is_no_store_and_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    text = "load,x,outcome\n" * 100
    path.write_text(text)
    with pytest.raises(StoreError, match="not a store of runs, or it is damaged"):
        Store(path)
    assert path.read_text() == text


def test_a_foreign_database_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.sqlite"
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("CREATE TABLE runs (a)")
    before = path.read_bytes()
    with pytest.raises(StoreError, match="not a store of runs"):
        Store(path)
    assert path.read_bytes() == before


def test_a_store_of_a_newer_version_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    with Store(path) as store:
        runner(store)([0], [[1.0]])
        store.connection.execute("PRAGMA user_version = 2")
    before = path.read_bytes()
    with pytest.raises(StoreError, match="newer Aleator: its format is 2") as told:
        Store(path)
    assert "install" in told.value.remedy
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
                holdings(store)
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
