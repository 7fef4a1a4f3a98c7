"""Calls for workers that come, go, die and lie: of a stage, and of a Dask cluster of processes."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pandas as pd
import pytest

from aleator.errors import ClusterError, SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner
from aleator.simulators import clusters as tested
from aleator.simulators.clusters import SETTINGS, ClusterSettings, DaskExecutor, dask_executor
from aleator.simulators.protocol import WorkerLost
from hardening.dask_processes import DaskProcesses, until

LIVES = SETTINGS.lives


class Killed(Exception):
    """How this cluster says that a worker was killed."""


class Stage:
    """A cluster whose workers do nothing until_so the test answers for them."""

    def __init__(self, *workers: str) -> None:
        self.there = set(workers)
        self.wrong: dict[str, str] = {}
        self.sent: list[tuple[str, Callable[[], Any], Future[Any]]] = []
        self.running = True
        self.closed = False

    def alive(self) -> bool:
        return self.running

    def workers(self) -> Set[str]:
        return frozenset(self.there)

    def faults(self, workers: Iterable[str]) -> Mapping[str, str]:
        return {worker: self.wrong.get(worker, "") for worker in workers}

    def send(self, worker: str, parcel: bytes) -> Future[Any]:
        future: Future[Any] = Future()
        self.sent.append((worker, cloudpickle.loads(parcel), future))
        return future

    def killed(self, error: BaseException) -> bool:
        return isinstance(error, Killed)

    def lost(self) -> ClusterError:
        return ClusterError("the scheduler is gone")

    def close(self) -> None:
        self.closed = True

    def number(self, k: int) -> tuple[str, Callable[[], Any], Future[Any]]:
        """Wait for the k-th call that was sent (from 0)."""
        until_so(lambda: len(self.sent) > k)
        return self.sent[k]

    def answer(self, k: int) -> str:
        """Have the k-th call made; the worker that made it."""
        worker, call, future = self.number(k)
        future.set_result(call())
        return worker

    def lose(self, worker: str) -> None:
        self.there.discard(worker)


def until_so(condition: Callable[[], bool], patience: float = 30.0) -> None:
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.002)


@contextmanager
def opened(stage: Stage) -> Iterator[tuple[DaskExecutor, list[str]]]:
    told: list[str] = []
    executor = DaskExecutor(stage, told.append)
    try:
        yield executor, told
    finally:
        executor.shutdown(wait=False)


def test_every_worker_has_one_call_and_the_rest_wait() -> None:
    stage = Stage("a", "b")
    with opened(stage) as (executor, _):
        futures = [executor.submit(divmod, k, 3) for k in range(5)]
        until_so(lambda: len(stage.sent) == 2)
        assert {worker for worker, _, _ in stage.sent} == {"a", "b"}
        assert executor.slots == 2
        for k in range(5):
            stage.answer(k)
        assert [future.result(30) for future in futures] == [divmod(k, 3) for k in range(5)]
    assert stage.closed


def test_what_a_lost_worker_ran_goes_to_another_before_all_that_wait() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, told):
        first, second = executor.submit(pow, 2, 5), executor.submit(pow, 3, 5)
        stage.number(0)
        stage.there = {"b"}
        assert stage.answer(1) == "b"
        assert first.result(30) == 32
        assert not second.done()
        assert stage.answer(2) == "b"
        assert second.result(30) == 243
        assert "worker a was lost; its runs go to another" in told


@pytest.mark.parametrize("said", [False, True], ids=["seen by its absence", "told by the cluster"])
def test_a_call_that_takes_its_workers_with_it_is_held_to_be_at_fault(said: bool) -> None:
    stage = Stage(*"abcd")
    with opened(stage) as (executor, _):
        future = executor.submit(int, "7")
        for k in range(LIVES):
            worker, _, sent = stage.number(k)
            stage.lose(worker)
            if said:
                sent.set_exception(Killed())
        with pytest.raises(WorkerLost, match=f"{LIVES} workers were lost"):
            future.result(30)
        other = executor.submit(int, "8")
        stage.answer(LIVES)
        assert other.result(30) == 8


def test_an_answer_that_comes_after_its_worker_was_given_up_changes_nothing() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, told):
        future = executor.submit(int, "1")
        _, _, late = stage.number(0)
        stage.there = {"b"}
        until_so(lambda: any("worker a was lost" in text for text in told))
        assert late.cancelled()
        stage.answer(1)
        assert future.result(30) == 1


def test_calls_wait_for_a_first_worker_and_a_late_one_is_used_at_once() -> None:
    stage = Stage()
    with opened(stage) as (executor, told):
        assert told == ["no worker has joined the cluster yet: the runs wait for one"]
        futures = [executor.submit(int, "1"), executor.submit(int, "2")]
        stage.there.add("a")
        stage.number(0)
        stage.there.add("late")
        stage.number(1)
        assert {stage.answer(0), stage.answer(1)} == {"a", "late"}
        assert [future.result(30) for future in futures] == [1, 2]


def test_where_the_last_worker_leaves_the_calls_wait_and_it_is_told() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, told):
        stage.there.clear()
        until_so(lambda: "no worker is left: the runs wait for another to join" in told)
        future = executor.submit(int, "1")
        stage.there.add("b")
        stage.answer(0)
        assert future.result(30) == 1


def test_a_late_worker_that_does_not_suit_is_told_and_not_used() -> None:
    stage = Stage("a")
    stage.wrong["z"] = "has Python 3.9, and this is 3.11"
    with opened(stage) as (executor, told):
        stage.there.add("z")
        until_so(lambda: bool(told))
        assert told == ["worker z is not used: it has Python 3.9, and this is 3.11"]
        assert executor.slots == 1


def test_a_cluster_without_any_worker_that_suits_is_refused() -> None:
    stage = Stage("z")
    stage.wrong["z"] = "has no Aleator installed"
    with pytest.raises(ClusterError, match="no worker can be used: z has no Aleator installed"):
        DaskExecutor(stage, lambda _: None)


def test_where_the_scheduler_is_lost_everything_open_says_so() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, _):
        running, waiting = executor.submit(int, "1"), executor.submit(int, "2")
        stage.number(0)
        stage.running = False
        for future in (running, waiting):
            with pytest.raises(ClusterError, match="the scheduler is gone"):
                future.result(30)
        with pytest.raises(ClusterError, match="the scheduler is gone"):
            executor.submit(int, "3")


def test_a_scheduler_that_does_not_answer_is_lost() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, _):
        future = executor.submit(int, "1")
        stage.number(0)

        def silent() -> Set[str]:
            raise TimeoutError("no answer")

        stage.workers = silent  # type: ignore[method-assign]
        with pytest.raises(ClusterError, match="the scheduler is gone") as caught:
            future.result(30)
        assert isinstance(caught.value.__cause__, TimeoutError)


def test_calls_that_the_cluster_cancels_are_made_again() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, _):
        future = executor.submit(int, "1")
        _, _, sent = stage.number(0)
        sent.cancel()
        stage.answer(1)
        assert future.result(30) == 1


def test_what_a_call_raises_arrives_with_the_name_of_its_worker_where_it_is_for_users() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, _):
        mine, theirs = executor.submit(int, "1"), executor.submit(int, "2")
        stage.number(0)[2].set_exception(SimulatorError("no such file", "copy it"))
        stage.number(1)[2].set_exception(ModuleNotFoundError("No module named 'solver'"))
        with pytest.raises(SimulatorError, match="on worker a: no such file\n  Remedy: copy it"):
            mine.result(30)
        with pytest.raises(ModuleNotFoundError, match="solver"):
            theirs.result(30)


def test_what_has_not_begun_can_be_cancelled_and_what_has_cannot() -> None:
    stage = Stage("a")
    with opened(stage) as (executor, _):
        begun, waiting, last = (executor.submit(int, text) for text in "123")
        stage.number(0)
        until_so(begun.running)
        assert not begun.cancel()
        assert waiting.cancel()
        stage.answer(0)
        stage.answer(1)
        assert (begun.result(30), last.result(30)) == (1, 3)


def test_closing_waits_for_what_is_open_and_refuses_what_comes_later() -> None:
    stage = Stage("a")
    executor = DaskExecutor(stage, lambda _: None)
    futures = [executor.submit(int, "1"), executor.submit(int, "2")]
    answers = threading.Thread(target=lambda: [stage.answer(0), stage.answer(1)])
    answers.start()
    executor.shutdown()
    answers.join()
    assert [future.result(0) for future in futures] == [1, 2]
    with pytest.raises(RuntimeError, match="shut down"):
        executor.submit(int, "3")
    executor.shutdown()


MODEL = """\
import os, pathlib, time

HERE = pathlib.Path(__file__).parent


def length(load, softness):
    return load * softness**1.5


def patient(load, softness):
    (HERE / f"{os.getpid()}.pid").touch()
    end = time.monotonic() + 120
    while load > 2.0 and len([*HERE.glob("*.pid")]) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    return length(load, softness)


def wise(load, softness):
    import a_solver_that_is_not_here
"""
LOADS = np.array([1.0, 2.0, 3.0, 4.0])
EXPERIMENTS = Conditions(("A", "B", "C", "D"), pd.DataFrame({"load": LOADS}))
INDEX = np.tile(np.arange(4), 5)
SOFTNESS = np.linspace(0.5, 1.5, 20)[:, None]


@contextmanager
def runner(name: str, cluster: DaskProcesses) -> Iterator[Runner]:
    simulator = FunctionSimulator.named(f"model.py:{name}", cluster.file.parent)
    with dask_executor(cluster.file) as executor:
        yield Runner(simulator, EXPERIMENTS, ["softness"], executor=executor)


def refused(address: str | Path, message: str) -> None:
    soon = ClusterSettings(connect=0.5)
    with pytest.raises(ClusterError, match=message), dask_executor(address, settings=soon):
        pass


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskProcesses]:
    """A cluster that the tests take one after the other, with one worker at first."""
    folder = tmp_path_factory.mktemp("dask")
    (folder / "model.py").write_text(MODEL)
    with DaskProcesses(folder, workers=1) as processes:
        yield processes


def test_a_worker_that_joins_late_is_used(cluster: DaskProcesses) -> None:
    with runner("patient", cluster) as run:
        until(lambda: bool(run.executor._workers), "no worker")  # type: ignore[union-attr]
        late = cluster.worker()
        outcome = run(INDEX, SOFTNESS)
        assert run.executor.slots == 2  # type: ignore[union-attr]
    np.testing.assert_allclose(outcome, LOADS[INDEX] * SOFTNESS[:, 0] ** 1.5)
    assert (cluster.file.with_name(f"{late.pid}.pid")).exists()


def test_what_workers_lack_is_told(cluster: DaskProcesses, monkeypatch: pytest.MonkeyPatch) -> None:
    with runner("wise", cluster) as run, pytest.raises(SimulatorError, match="a_solver_that_is"):
        run(INDEX[:1], SOFTNESS[:1])
    with runner("length", cluster) as run:
        moved = cluster.file.with_name("model.py").rename(cluster.file.with_name("moved.py"))
        with pytest.raises(SimulatorError, match=r"on worker tcp://.*model.py does not exist"):
            run(INDEX[:1], SOFTNESS[:1])
        moved.rename(cluster.file.with_name("model.py"))
    monkeypatch.setattr(tested, "version", lambda _: "9.9")
    refused(cluster.file, r"tcp://.* has Aleator .*, and this is 9\.9")


@pytest.mark.parametrize("address", ["nobody", "", "tcp://127.0.0.1:1"])
def test_an_address_that_is_none_is_told(address: str) -> None:
    refused(address, f"no Dask scheduler answers at {address}")


def test_a_scheduler_file_that_is_none_is_told(tmp_path: Path) -> None:
    refused(tmp_path / "missing.json", r"missing\.json does not exist")
    (tmp_path / "other.json").write_text('{"a": 1}')
    refused(tmp_path / "other.json", r"no Dask scheduler answers at .*other\.json")


def test_without_the_package_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tested, "find_spec", lambda _: None)
    refused("tcp://127.0.0.1:1", "pip install distributed")
