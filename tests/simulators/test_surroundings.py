"""What the machine does to a run is no answer of the simulator: it is told, and not stored."""

import errno
import os
import subprocess
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import aleator
from aleator.cli.program import misuse_as_message
from aleator.errors import SimulatorError, SurroundingsError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, ProcessPool, RunFailed, Runner, Store
from aleator.simulators.command import CommandSimulator, Keep
from aleator.simulators.records import stored_runs
from aleator.simulators.surroundings import printed

TABLE = Conditions(("A",), pd.DataFrame({"load": [2.0]}))
X = np.linspace(0.0, 1.0, 30)[:, None]
MODEL = """
import errno, pathlib
def refused():
    return not pathlib.Path(__file__).with_name("mended").exists()
def disk(load, x):
    if x > 0.5 and refused():
        raise OSError(errno.ENOSPC, "No space left on device")
    return load * x
def server(load, x):
    if x > 0.5 and refused():
        try:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        except OSError as error:
            raise ValueError("no license") from error
    return load * x
def answered(load, x):
    if x > 0.5 and refused():
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError:
            raise RuntimeError("the result could not be written")
    return load * x
def arrays(load, x):
    if (x > 0.5).any() and refused():
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")
    return load * x
def greedy(load, x):
    if x > 0.5:
        raise MemoryError
    return load * x
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPool]:
    with ProcessPool(1) as pool:
        yield pool


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "model.py").write_text(MODEL)
    return tmp_path


@pytest.mark.parametrize("workers", [False, True])
@pytest.mark.parametrize("name", ["disk", "server", "answered", "arrays"])
def test_a_study_stops_and_goes_on_as_if_nothing_had_been(
    pool: ProcessPool, model: Path, name: str, workers: bool
) -> None:
    simulator = FunctionSimulator.named(f"model.py:{name}", model, vectorized=name == "arrays")
    executor = pool if workers else None
    with Store(model / "runs.sqlite") as store:
        run = Runner(simulator, TABLE, ["x"], store=store, executor=executor, retries=2)
        with pytest.raises(SurroundingsError, match="a run could not be made: ") as told:
            run.attempt(np.zeros(30, int), X, most=1.0)
        assert "same command again" in told.value.remedy
        assert all(one.failure is None for one in stored_runs(store))
        before = len([*stored_runs(store)])
        assert before == 15  # each that was made before
        (model / "mended").touch()
        run = Runner(simulator, TABLE, ["x"], store=store, executor=executor)
        np.testing.assert_array_equal(run(np.zeros(30, int), X), 2.0 * X[:, 0])
        assert run.fresh == 30 - before


def test_a_simulator_that_wants_too_much_memory_has_failed(model: Path) -> None:
    run = Runner(FunctionSimulator.named("model.py:greedy", model), TABLE, ["x"])
    outcome = run.attempt(np.zeros(30, int), X, most=1.0)
    np.testing.assert_array_equal(np.isnan(outcome), X[:, 0] > 0.5)


def test_memory_that_aleator_lacks_is_no_failure() -> None:
    def none_left(*_: object) -> None:
        raise MemoryError

    place = str(Path(aleator.__file__).with_name("types.py"))
    none_left.__code__ = none_left.__code__.replace(co_filename=place)  # a line of the house
    with pytest.raises(SurroundingsError, match="no memory left"):
        Runner(lambda x: none_left(x), TABLE, ["x"]).attempt([0], [[1.0]])


# ------------------------------------------------------------------------------ programs


def command(folder: Path, text: str = "echo {x}", **choices: Any) -> CommandSimulator:
    return CommandSimulator(text, shell=True, base=folder, keep=Keep.NONE, **choices)


@pytest.mark.parametrize(
    ("words", "is_so"),
    [
        ("tee: out.dat: No space left on device", True),
        ("sh: 1: Cannot fork", True),
        ("FLEXnet Licensing error:-15,570", True),
        ("ERROR: could not connect to license server", True),
        ("License checkout failed.", True),
        ("no solver license available", True),
        ("pressure too high", False),
        ("License GPLv3+. There is NO WARRANTY, to the extent permitted by law", False),
        ("This program comes with ABSOLUTELY NO WARRANTY; for details see the license", False),
        ("Licensed to the bench. error 3", False),
    ],
)
def test_the_words_of_programs(words: str, is_so: bool) -> None:
    assert (printed(f"begun\n{words}\nended\n") is not None) is is_so


def test_what_a_program_says_of_the_machine_stops(tmp_path: Path) -> None:
    refused = 'echo "License checkout failed" >&2; exit 3'
    with pytest.raises(SurroundingsError, match="it said: License checkout failed"):
        command(tmp_path, refused).run_one({}, {})
    with pytest.raises(RunFailed, match="exit code 3"):
        command(tmp_path, refused, stop_on="").run_one({}, {})
    with pytest.raises(SurroundingsError, match="it said: NO TOKEN"):
        command(tmp_path, "echo NO TOKEN; exit 1", stop_on="TOKEN").run_one({}, {})
    with pytest.raises(SimulatorError, match="no regular expression"):
        command(tmp_path, stop_on="(")


def disk(free: int) -> Any:
    return lambda _: SimpleNamespace(f_blocks=100, f_frsize=4096, f_bfree=free, f_bavail=free)


@pytest.mark.parametrize(("text", "free"), [("echo 1", 0), ("exit 1", 0), ("exit 1", 200)])
def test_a_full_disk_stops_whatever_the_program_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, free: int
) -> None:
    monkeypatch.setattr(os, "statvfs", disk(free))
    with pytest.raises(SurroundingsError, match="is full"):
        command(tmp_path, text).run_one({}, {})


def test_a_disk_with_space_is_not_to_blame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "statvfs", disk(10**6))
    with pytest.raises(RunFailed):
        command(tmp_path, "exit 1").run_one({}, {})
    monkeypatch.setattr(os, "statvfs", disk(1))
    assert command(tmp_path, "echo 1").run_one({}, {}) == 1.0


def test_a_program_that_the_system_does_not_start_has_not_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_process(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", no_process)
    with pytest.raises(SurroundingsError, match="cannot be started: Resource temporarily"):
        command(tmp_path).run_one({}, {"x": 1.0})


def test_a_run_that_gets_no_folder_has_not_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with pytest.raises(SurroundingsError, match="folder of a run could not be made"):
        command(tmp_path).run_one({}, {"x": 1.0})


# ------------------------------------------------------------------------------- workers


class Stillborn(Executor):
    """Workers that die before they run anything."""

    slots = 2

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        future: Future[Any] = Future()
        future.set_exception(BrokenExecutor("a process ended abruptly"))
        return future


def test_workers_that_cannot_live_are_no_failed_runs(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.sqlite") as store:
        run = Runner(lambda load, x: load * x, TABLE, ["x"], store=store, executor=Stillborn())
        with pytest.raises(SurroundingsError, match="before they have run anything"):
            run.attempt(np.zeros(30, int), X, most=1.0)
        assert [*stored_runs(store)] == []


def test_a_worker_that_the_system_does_not_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_process(*_: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", no_process)
    with (
        ProcessPool(1) as pool,
        pytest.raises(SurroundingsError, match="a worker process could not be started"),
    ):
        pool.submit(os.getpid)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "out/x.json"), "'out/x.json'"),
        (MemoryError(), "no memory left"),
    ],
)
def test_a_command_tells_it_in_one_message(error: Exception, words: str) -> None:
    @click.command()
    @click.pass_context
    def failing(context: click.Context) -> None:
        with misuse_as_message(context):
            raise error

    done = CliRunner().invoke(failing)
    assert done.exit_code == 2
    assert done.output.startswith("aleator: error: ")
    assert words in done.output
