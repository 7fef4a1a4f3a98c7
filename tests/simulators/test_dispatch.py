"""Runs by workers: the same outcomes, whatever the workers do, and nothing done is lost."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from programs import emptied, gone

from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner, Runs, Store
from aleator.simulators.pool import ProcessPool
from aleator.simulators.protocol import WorkerLost
from aleator.simulators.records import stored_runs

TABLE = Conditions(("A", "B"), pd.DataFrame({"load": [1.0, 2.0]}))
INDEX, X = np.repeat([0, 1], 20), np.tile(np.linspace(0.0, 1.0, 20), 2)[:, None]
MODEL = """
import os, pathlib, signal, time
import numpy as np

def product(load, x):
    return load * x

def arrays(load, x):
    return load * np.exp(x)

def brittle(load, x):
    if x > 0.9:
        raise ValueError("too hot")
    return np.nan if x < 0.1 else load * x

def deadly(load, x):
    if load == 2.0 and 0.5 < x < 0.54:
        os.kill(os.getpid(), signal.SIGKILL)
    return load * x

class Abort(BaseException):
    pass

def aborting(load, x):
    if x > 0.9:
        raise Abort("out of license")
    return load * x

def interrupting(load, x):
    if x > 0.9:
        raise KeyboardInterrupt
    return load * x

def many_interrupting(load, x):
    if np.any(x > 0.9):
        raise KeyboardInterrupt
    return load * x

def leaving(load, x):
    if x > 0.9:
        raise SystemExit(3)
    return load * x

def slow(load, x):
    pathlib.Path(__file__).with_name(f"at{x:.3f}").touch()
    time.sleep(0.2)
    return load * x

def flaky(load, x):
    seen = pathlib.Path(__file__).with_name(f"tried{load}{x:.3f}")
    if x > 0.9 and not seen.exists():
        seen.touch()
        raise ValueError("no license")
    return load * x
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPool]:
    with ProcessPool(2) as pool:
        yield pool


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "model.py").write_text(MODEL)
    return tmp_path


def messages(runs: Runs) -> list[str]:
    return sorted(failure.message for failure in runs.failures.values())


def named(folder: Path, name: str, vectorized: bool = False) -> FunctionSimulator:
    return FunctionSimulator.named(f"model.py:{name}", folder, vectorized)


@pytest.mark.parametrize(("name", "vectorized"), [("product", False), ("arrays", True)])
def test_workers_give_the_same_outcomes(
    pool: ProcessPool, model: Path, name: str, vectorized: bool
) -> None:
    simulator = named(model, name, vectorized)
    here = Runner(simulator, TABLE, ["x"])(INDEX, X)
    with Store(model / "runs.sqlite") as store:
        run = Runner(simulator, TABLE, ["x"], store=store, executor=pool)
        np.testing.assert_array_equal(run(INDEX, X), here)
        assert (run.runs, run.fresh, len([*stored_runs(store)])) == (40, 40, 40)
        again = Runner(simulator, TABLE, ["x"], store=store, executor=pool)
        np.testing.assert_array_equal(again(INDEX, X), here)
        assert (again.runs, again.fresh) == (40, 0)


def test_a_function_that_no_file_holds_is_sent_whole(pool: ProcessPool) -> None:
    factor = 3.0
    run = Runner(lambda load, x: factor * load * x, TABLE, ["x"], executor=pool)
    np.testing.assert_allclose(run(INDEX, X), 3.0 * (INDEX + 1) * X[:, 0])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("aborting", "Abort: out of license"),
        ("leaving", "SystemExit: 3"),
        ("interrupting", "it raised KeyboardInterrupt"),
        ("many_interrupting", "it raised KeyboardInterrupt"),
    ],
)
def test_whatever_a_run_raises_in_a_worker_is_its_own_failure(
    pool: ProcessPool, model: Path, name: str, words: str
) -> None:
    run = Runner(named(model, name, name.startswith("many")), TABLE, ["x"], executor=pool)
    outcome = run.attempt(INDEX, X, most=1.0)
    np.testing.assert_array_equal(np.isnan(outcome), X[:, 0] > 0.9)
    assert all(words in message for message in messages(run.failures))


def test_failed_runs_are_told_by_workers_as_they_are_here(pool: ProcessPool, model: Path) -> None:
    runners = [Runner(named(model, "brittle"), TABLE, ["x"], executor=e) for e in (None, pool)]
    outcomes = [run.attempt(INDEX, X, most=1.0) for run in runners]
    np.testing.assert_array_equal(outcomes[0], outcomes[1])
    assert np.sum(np.isnan(outcomes[0])) == 8
    here, there = (run.failures for run in runners)
    assert messages(here) == messages(there)
    assert any("too hot" in message for message in messages(there))
    np.testing.assert_allclose(there.region, [[0.0, 1.0]])
    assert len(there) == 8
    with pytest.raises(SimulatorError, match="too hot"):
        runners[1]([0], [[0.95]])


def test_a_worker_that_dies_is_one_failed_run(pool: ProcessPool, model: Path) -> None:
    with Store(model / "runs.sqlite") as store:
        run = Runner(named(model, "deadly"), TABLE, ["x"], store=store, executor=pool)
        outcome = run.attempt(INDEX, X)
        bad = (INDEX == 1) & (X[:, 0] > 0.5) & (X[:, 0] < 0.54)
        np.testing.assert_array_equal(np.isnan(outcome), bad)
        np.testing.assert_allclose(outcome[~bad], ((INDEX + 1) * X[:, 0])[~bad])
        (failed,) = [kept for kept in stored_runs(store) if kept.failure]
    assert failed.failure is not None
    assert failed.failure.startswith("the worker process died")


class Losing(Executor):
    """Loses whole batches in which experiment B has x near 0.5, and says so of each."""

    slots = 3

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        _, batch, _ = args
        at_fault = np.abs(batch.runs.x[:, 0] - 0.52) < 0.02
        if np.any((batch.conditions["load"] == 2.0) & at_fault):
            future.set_exception(WorkerLost("3 workers were lost while they ran it"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_where_the_executor_knows_which_batch_it_was_the_run_is_found_too(model: Path) -> None:
    run = Runner(named(model, "product"), TABLE, ["x"], executor=Losing())
    outcome = run.attempt(INDEX, X)
    bad = (INDEX == 1) & (np.abs(X[:, 0] - 0.52) < 0.02)
    assert np.sum(bad) == 1
    np.testing.assert_array_equal(np.isnan(outcome), bad)
    np.testing.assert_array_equal(outcome[~bad], ((INDEX + 1) * X[:, 0])[~bad])
    assert "3 workers were lost" in messages(run.failures)[0]


def test_a_run_that_fails_is_tried_again(pool: ProcessPool, model: Path) -> None:
    once = Runner(named(model, "flaky"), TABLE, ["x"], executor=pool, retries=1)
    np.testing.assert_allclose(once.attempt(INDEX, X), (INDEX + 1) * X[:, 0])
    assert len(once.failures) == 0


@pytest.mark.parametrize("where", ["here", "workers"])
def test_too_many_failures_stop_with_everything_kept(
    pool: ProcessPool, model: Path, where: str
) -> None:
    with Store(model / "runs.sqlite") as store:
        executor = None if where == "here" else pool
        simulator = named(model, "brittle")
        x = np.linspace(0.8, 1.0, 60)[:, None]
        for _ in range(2):  # the same from the store
            run = Runner(simulator, TABLE, ["x"], store=store, executor=executor)
            with pytest.raises(SimulatorError, match=r"runs failed, too many.*too hot|.*before"):
                run.attempt(np.zeros(60, int), x)
        assert len([*stored_runs(store)]) >= 10


class Watched(Executor):
    """Counts what is submitted and has not come back."""

    def __init__(self) -> None:
        self.inner, self.most, self.now = ThreadPoolExecutor(2), 0, 0
        self.slots = 2
        self.lock = threading.Lock()

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        future = self.inner.submit(fn, *args, **kwargs)
        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)
        future.add_done_callback(self._back)
        return future

    def _back(self, _: object) -> None:
        with self.lock:
            self.now -= 1


def test_a_million_runs_are_not_submitted_at_once() -> None:
    watched = Watched()
    with watched.inner:
        run = Runner(lambda x: x, TABLE, ["x"], executor=watched)
        x = np.random.default_rng(0).random((20_000, 1))
        np.testing.assert_array_equal(run(np.zeros(len(x), int), x), x[:, 0])
    assert watched.most <= 4


def test_ctrl_c_waits_for_what_is_at_work_and_keeps_it(pool: ProcessPool, model: Path) -> None:
    def interrupt() -> None:
        while len([*model.glob("at*")]) < 3:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    with Store(model / "runs.sqlite") as store:
        run = Runner(named(model, "slow"), TABLE, ["x"], store=store, executor=pool)
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            run(INDEX, X)
        begun = len([*model.glob("at*")])
        assert begun < 20
        assert len([*stored_runs(store)]) == begun == run.fresh


def test_what_cannot_be_sent_or_run_elsewhere_is_told(pool: ProcessPool, model: Path) -> None:
    lock = threading.Lock()
    with pytest.raises(SimulatorError, match="cannot be sent to other processes"):
        Runner(lambda x: x if lock else 0.0, TABLE, ["x"], executor=pool)([0], [[1.0]])
    simulator = named(model, "product")
    (model / "model.py").unlink()
    with pytest.raises(SimulatorError, match=r"file model\.py does not exist"):
        Runner(simulator, TABLE, ["x"], executor=pool)([0], [[1.0]])


PARENT = """\
import sys, time
from pathlib import Path
from aleator.simulators import ProcessPool
from aleator.simulators.command import CommandSimulator
if __name__ == "__main__":
    here = Path(sys.argv[1])
    program = CommandSimulator("echo $$ > {study}/program; sleep 60", base=here, shell=True)
    pool = ProcessPool(2)
    pool.submit(program.run_one, {}, {})
    if sys.argv[2] == "stubborn":
        (here / "stubborn.py").write_text(
            "import os, time\\n"
            "def stays():\\n"
            "    while True:\\n"
            "        try:\\n"
            "            time.sleep(60)\\n"
            "        except BaseException:\\n"
            "            pass\\n"
        )
        sys.path.insert(0, str(here))
        import stubborn
        pool.submit(stubborn.stays)
    else:
        pool.submit(len, "idle")
    while not (here / "program").exists():
        time.sleep(0.01)
    time.sleep(0.2)
    print(*[worker.pid for worker in pool._inner._processes.values()], flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
@pytest.mark.parametrize("other", ["idle", "stubborn"])
def test_workers_and_their_programs_end_with_a_parent_that_is_killed(
    tmp_path: Path, other: str
) -> None:
    (tmp_path / "folders").mkdir()
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, "parent.py", str(tmp_path), other],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path / "folders")},
    )
    with parent:
        assert parent.stdout is not None
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2
        os.kill(parent.pid, signal.SIGKILL)
    assert all(gone(worker, 10.0) for worker in workers)
    assert gone(int((tmp_path / "program").read_text()), 1.0)
    assert emptied(tmp_path / "folders")


def test_a_pool_that_gives_up_ends_its_own_workers_only() -> None:
    mine = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    mine.start()
    others = {process.pid for process in multiprocessing.active_children()}
    try:
        pool = ProcessPool(1)
        asked = pool.submit(time.sleep, 60)
        while not asked.running():
            time.sleep(0.01)
        (worker,) = [p for p in multiprocessing.active_children() if p.pid not in others]
        began = time.monotonic()
        pool.shutdown(wait=False, cancel_futures=True)
        worker.join(10.0)
        assert time.monotonic() - began < 10.0
        # the pool may have reaped it first: then it is gone, and no child to ask about
        with pytest.raises(ProcessLookupError):
            os.kill(worker.pid, 0)
        assert mine.is_alive()
    finally:
        mine.kill()
        mine.join()


class Cancelled(Executor):
    """Returns batches without a run, which something ended."""

    slots = 1

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        made = fn(*args, **kwargs)
        future.set_result(replace(made.some(slice(0)), stopped=CancelledError()))
        return future


def test_what_ends_a_batch_ends_the_study_and_is_not_asked_for_again(model: Path) -> None:
    run = Runner(named(model, "product"), TABLE, ["x"], executor=Cancelled())
    with pytest.raises(CancelledError):
        run(INDEX, X)


def test_an_exception_of_any_kind_is_a_failure_here_too(model: Path) -> None:
    run = Runner(named(model, "aborting"), TABLE, ["x"])
    with pytest.raises(SimulatorError, match="Abort: out of license"):
        run(INDEX, X)
