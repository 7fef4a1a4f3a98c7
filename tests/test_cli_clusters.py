"""The command line with a cluster: workers die, the scheduler dies, and the answer is the same."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import aleator
from aleator import cli
from aleator.simulators import Store
from aleator.simulators.records import stored_runs
from hardening.dask_processes import DaskProcesses

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
[search]
method = "gradient"
starts = 2
[verification]
samples = 0
"""
MPIEXEC = Path(sys.executable).with_name("mpiexec")
# Runs are logged, and slow enough for several batches; one of them ends a process, once.
MODEL = """\
import os, pathlib, signal, time

HERE = pathlib.Path(__file__).parent


def length(load, softness):
    time.sleep(0.02)
    victim = HERE / "victim"
    if load == 4.0 and softness > 1.0 and victim.exists():
        pid = int(victim.read_text() or os.getpid())
        victim.unlink()
        os.kill(pid, signal.SIGKILL)
        time.sleep(0.5)
    with open(HERE / "log.txt", "a") as log:
        log.write(f"{load} {softness!r}\\n")
    return load * softness
"""
TABLE = "id,load,length\nA,1,0.93\nB,2,2.1\nC,3,3.2\nD,4,3.7\nE,5,5.4\n"


def aleator_run(folder: Path, *options: str, launch: tuple[str, ...] = ()) -> Any:
    return subprocess.run(
        [*launch, sys.executable, *(("-m", "mpi4py.futures") if launch else ()), "-m", "aleator",
         "identify", str(folder / "study.toml"), "--no-figures", "--output", str(folder / "out"),
         *options],
        env={**os.environ, "PYTHONPATH": str(Path(aleator.__file__).parents[1])},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def answer(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "identification.json").read_text())
    del found["seconds"]
    return found


def study_in(folder: Path) -> Path:
    folder.mkdir()
    for name, text in (("study.toml", STUDY), ("model.py", MODEL), ("springs.csv", TABLE)):
        (folder / name).write_text(text)
    return folder


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer without any cluster."""
    folder = study_in(tmp_path_factory.mktemp("alone") / "springs")
    done = aleator_run(folder)
    assert done.returncode == 0, done.stderr
    return answer(folder)


def runs_made(folder: Path) -> list[str]:
    return (folder / "log.txt").read_text().splitlines()


def kept(folder: Path) -> list[str]:
    with Store(folder / "runs.sqlite") as store:
        return [f"{r.conditions['load']} {r.parameters['softness']!r}" for r in stored_runs(store)]


@pytest.mark.slow
def test_a_study_whose_worker_is_killed_ends_with_the_same_answer(
    tmp_path: Path, alone: dict[str, Any]
) -> None:
    folder = study_in(tmp_path / "springs")
    (folder / "victim").touch()  # whoever comes first
    with DaskProcesses(tmp_path, workers=2) as cluster:
        done = aleator_run(folder, "--dask", str(cluster.file))
        assert done.returncode == 0, done.stderr
        assert [worker.poll() for worker in cluster.workers].count(None) == 1
    assert "tcp://" in done.stderr  # the worker that was lost
    assert answer(folder) == alone
    assert len(kept(folder)) == len(set(kept(folder)))
    assert set(kept(folder)) == set(runs_made(folder))


@pytest.mark.slow
def test_a_study_whose_scheduler_is_killed_keeps_its_runs_and_goes_on(
    tmp_path: Path, alone: dict[str, Any]
) -> None:
    folder = study_in(tmp_path / "springs")
    with DaskProcesses(tmp_path, workers=1) as cluster:
        (folder / "victim").write_text(str(cluster.scheduler.pid))
        done = aleator_run(folder, "--dask", str(cluster.file))
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("aleator: error: ") == 1
    assert "tcp://127.0.0.1:" in done.stderr
    stored = kept(folder)
    assert f"{len(stored)} new runs" in done.stderr
    assert "runs.sqlite" in done.stderr
    assert len(stored) > 2
    (folder / "log.txt").unlink()
    again = aleator_run(folder)
    assert again.returncode == 0, again.stderr
    assert f"{len(stored)} runs" in again.stderr
    assert answer(folder) == alone
    repeated = set(runs_made(folder)) & set(stored)
    assert len(repeated) <= 1  # the one that is repeated on purpose


@pytest.mark.slow
@pytest.mark.skipif(not MPIEXEC.exists(), reason="no MPI")
def test_an_mpi_job_finds_the_same_answer(tmp_path: Path, alone: dict[str, Any]) -> None:
    folder = study_in(tmp_path / "springs")
    done = aleator_run(folder, "--mpi", launch=(str(MPIEXEC), "-n", "2"))
    assert done.returncode == 0, done.stderr
    assert answer(folder) == alone
    assert set(kept(folder)) == set(runs_made(folder))
    (folder / "model.py").write_text("def length(load): return load")
    wrong = aleator_run(folder, "--mpi", launch=(str(MPIEXEC), "-n", "1"))
    assert wrong.returncode == 2
    assert "'softness'" in wrong.stderr


@pytest.mark.parametrize(
    ("options", "names"),
    [
        (["--dask", "nobody"], ["nobody"]),
        (["--dask", "no.json"], ["no.json"]),
        (["--mpi"], ["mpi4py.futures"]),
        (["--mpi", "--dask", "x"], ["--mpi", "--dask"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_cluster_that_is_none_is_told_before_anything_runs(
    tmp_path: Path, options: list[str], names: list[str]
) -> None:
    folder = study_in(tmp_path / "springs")
    done = CliRunner().invoke(cli.main, ["box", str(folder / "study.toml"), *options])
    assert done.exit_code == 2
    for name in names:
        assert name in done.stderr
    assert not (folder / "log.txt").exists()
    assert not (folder / "runs.sqlite").exists()
