"""What is added to a store is found again exactly, by any process, until it is forgotten."""

import pickle
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aleator.simulators.store import Case, Identity, Store

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


def test_a_commit_waits_for_the_disk_after_a_second_of_runs(path: Path) -> None:
    with Store(path) as store:

        def waits() -> bool:
            return bool(store.connection.execute("PRAGMA synchronous").fetchone()[0] == 2)

        seen = []
        for k, seconds in enumerate((0.4, 0.4, 0.4, 0.4, 3600.0, 0.1)):
            store.add(MODEL, [CASE], [row(float(k), 1.0, seconds=seconds)])
            seen.append(waits())
    assert seen == [False, False, True, False, True, False]


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
