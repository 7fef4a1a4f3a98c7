"""A real Dask cluster of processes: runs are the same as here, whatever becomes of its workers."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from dask_processes import DaskProcesses, until

from aleator.errors import ClusterError, SimulatorError
from aleator.experiments import Conditions
from aleator.simulate import FunctionSimulator, Runner, Store
from aleator.simulate import dask_cluster as tested
from aleator.simulate.dask_cluster import dask_executor
from aleator.simulate.inventory import kept_runs

MODEL = """\
import os, pathlib, signal, time

HERE = pathlib.Path(__file__).parent


def length(load, softness):
    return load * softness**1.5


def deadly(load, softness):
    if load == 3.0 and not (HERE / "died").exists():
        (HERE / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return length(load, softness)


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
def runner(name: str, cluster: DaskProcesses, **options: object) -> Iterator[Runner]:
    simulator = FunctionSimulator.named(f"model.py:{name}", cluster.file.parent)
    with dask_executor(cluster.file) as executor:
        yield Runner(simulator, EXPERIMENTS, ["softness"], executor=executor, **options)  # type: ignore[arg-type]


def refused(address: str | Path, message: str) -> None:
    with pytest.raises(ClusterError, match=message), dask_executor(address):
        pass


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskProcesses]:
    """A cluster that the tests take one after the other, with a worker for each that needs one."""
    folder = tmp_path_factory.mktemp("dask")
    (folder / "model.py").write_text(MODEL)
    with DaskProcesses(folder, workers=2) as processes:
        yield processes


def test_a_worker_that_is_killed_costs_no_run_and_changes_no_digit(
    cluster: DaskProcesses, tmp_path: Path
) -> None:
    simulator = FunctionSimulator.named("model.py:length", cluster.file.parent)
    here = Runner(simulator, EXPERIMENTS, ["softness"])(INDEX, SOFTNESS)
    with Store(tmp_path / "runs.sqlite") as store:
        with runner("deadly", cluster, store=store) as run:
            until(lambda: run.executor.slots == 2, "no second worker")  # type: ignore[union-attr]
            assert run(INDEX, SOFTNESS).tobytes() == here.tobytes()
        kept = [*kept_runs(store)]
    assert [one.poll() for one in cluster.workers].count(None) == 1
    assert len({(one.conditions["load"], one.parameters["softness"]) for one in kept}) == len(kept)
    assert sorted(one.outcome for one in kept) == sorted(here.tolist())  # type: ignore[type-var]


def test_a_worker_that_joins_late_is_used(cluster: DaskProcesses) -> None:
    with runner("patient", cluster) as run:
        assert run.executor.slots == 1  # type: ignore[union-attr]
        late = cluster.worker()
        run(INDEX, SOFTNESS)
        assert run.executor.slots == 2  # type: ignore[union-attr]
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


def test_versions_that_do_not_suit_are_told() -> None:
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    own = tested.version("aleator")
    assert tested._fault({"python": f"{python}.77.final.0", "aleator": own}) == ""
    assert "has no Aleator" in tested._fault({"python": f"{python}.1", "aleator": None})
    old = tested._fault({"python": "3.9.1.final.0", "aleator": own})
    assert old.startswith("has Python 3.9.1, and this is 3.")


@pytest.mark.parametrize("address", ["nobody", "http://127.0.0.1:8786", "", "tcp://127.0.0.1:x"])
def test_an_address_that_is_none_is_told(address: str) -> None:
    refused(address, f"no Dask scheduler answers at {address}")


def test_a_scheduler_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tested, "CONNECT", 0.2)
    refused("tcp://127.0.0.1:1", r"answers at tcp://127.0.0.1:1 \(Timed out")


def test_a_scheduler_file_that_is_none_is_told(tmp_path: Path) -> None:
    refused(tmp_path / "missing.json", r"missing\.json does not exist")
    (tmp_path / "other.json").write_text('{"a": 1}')
    refused(tmp_path / "other.json", r"no Dask scheduler answers at .*other\.json")


def test_without_the_package_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tested, "find_spec", lambda _: None)
    refused("tcp://127.0.0.1:1", r"pip install 'aleator\[dask\]'")
