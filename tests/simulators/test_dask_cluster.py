"""A real Dask cluster of processes: its workers, late ones too, and what they lack."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator.errors import ClusterError, SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner
from aleator.simulators import clusters as tested
from aleator.simulators.clusters import ClusterSettings, dask_executor
from hardening.dask_processes import DaskProcesses, until

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
    soon = ClusterSettings(connect=2.0)
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


def test_a_scheduler_that_does_not_answer_is_told() -> None:
    refused("tcp://127.0.0.1:1", r"answers at tcp://127.0.0.1:1 \(")


def test_a_scheduler_file_that_is_none_is_told(tmp_path: Path) -> None:
    refused(tmp_path / "missing.json", r"missing\.json does not exist")
    (tmp_path / "other.json").write_text('{"a": 1}')
    refused(tmp_path / "other.json", r"no Dask scheduler answers at .*other\.json")


def test_without_the_package_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tested, "find_spec", lambda _: None)
    refused("tcp://127.0.0.1:1", "pip install distributed")
