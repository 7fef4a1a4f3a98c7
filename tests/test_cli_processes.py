"""How commands end, by a crash or a signal; and clusters whose workers or scheduler die."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from studies import LENGTHS, SPRINGS, read, refused, run, springs

import aleator
from aleator import cli
from aleator.simulators import Store
from aleator.simulators.records import stored_runs
from hardening.dask_processes import DaskProcesses

ENDS = {
    "exit": ("os._exit(0)", "exit code 0"),
    "stop": ("ctypes.CDLL(None).exit(0)", "exit code 0"),
    "crash": ("ctypes.string_at(0)", "signal SIGSEGV"),
    "abort": ("os.abort()", "signal SIGABRT"),
}
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="no cheap copy of a process")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    springs(tmp_path, lengths=LENGTHS[:4])
    monkeypatch.chdir(tmp_path)
    return tmp_path


def simulated(folder: Path, line: str) -> None:
    (folder / "model.py").write_text(
        f"import ctypes, os\ndef length(load, softness):\n    {line}\n    return load * softness\n"
    )


def program(*arguments: str, beside: Path | None = None, **how: Any) -> Any:
    """The command in a process of its own, with modules beside it that are imported first."""
    source = str(Path(cli.__file__).parents[2])
    path = os.pathsep.join([str(beside), source]) if beside else source
    return subprocess.run(
        [sys.executable, "-m", "aleator", *arguments], env={**os.environ, "PYTHONPATH": path},
        capture_output=True, text=True, check=False, **how,
    )  # fmt: skip


@LINUX
@pytest.mark.parametrize("name", ENDS)
def test_a_function_that_ends_its_process_is_misuse(folder: Path, name: str) -> None:
    line, how = ENDS[name]
    simulated(folder, line)
    done = run("check", "study.toml")  # which would end this test, too
    assert done.exit_code == 2, done.output
    assert how in done.stderr


@LINUX
def test_a_crash_of_a_later_run_is_not_silent(folder: Path) -> None:
    simulated(folder, "load > 3 and ctypes.string_at(0)")
    done = program("check", "study.toml", "--quiet")
    assert done.returncode == -11
    assert "Segmentation fault" in done.stderr
    assert "model.py" in done.stderr


@LINUX
def test_an_end_of_a_later_run_is_not_silent(folder: Path) -> None:
    simulated(folder, f"load > 3 and {ENDS['stop'][0]}")
    done = program("check", "study.toml", "--no-figures")
    assert "'length' ended it" in done.stderr
    assert "--workers 1" in done.stderr


@LINUX
def test_a_command_that_ends_of_itself_says_nothing_of_ends(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run("check", "study.toml", "--no-figures").exit_code == 0
    simulated(folder, "None.no")
    assert run("check", "study.toml", "--no-figures").exit_code == 2
    assert "ended it" not in capfd.readouterr().err


# a module that is interrupted while it is imported, and makes nothing of it
INTERRUPTED = """\
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(20)
except BaseException:
    pass
raise ImportError("half imported")
"""


@pytest.mark.parametrize(
    ("module", "arguments"), [("click", ["--help"]), ("numpy", ["identify", "study.toml"])]
)
def test_ctrl_c_ends_an_import_at_once(tmp_path: Path, module: str, arguments: list[str]) -> None:
    (tmp_path / f"{module}.py").write_text(INTERRUPTED)
    # it may be ignored where the tests run in the background
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    done = program(*arguments, beside=tmp_path, **heard)
    assert (done.returncode, done.stderr) == (130, "aleator: stopped by Ctrl-C\n")


def test_sigterm_ends_a_command_and_keeps_its_runs(folder: Path) -> None:
    """So a batch system ends it; in the background of a shell only Ctrl-C is ignored."""
    simulated(folder, "length.runs += 1; length.runs == 20 and os.kill(os.getpid(), 15)")
    with (folder / "model.py").open("a") as model:
        model.write("length.runs = 0\n")
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)}
    done = program("identify", "study.toml", "--output", "out", **heard)
    assert done.returncode == 143, done.stderr
    assert done.stderr.endswith("aleator: stopped by SIGTERM\n")
    kept = re.search(r"keeps (\d+) new runs", done.stderr)
    assert kept is not None
    assert int(kept[1]) >= 14
    assert "Traceback" not in done.stderr


def test_who_imports_the_command_line_keeps_its_own_answer_to_ctrl_c() -> None:
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            "import signal\n"
            "before = signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "import aleator.cli\n"
            "print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)",
        ],
        capture_output=True,
        check=True,
        text=True,
    )
    assert told.stdout == "True\n"


# ------------------------------------------------------------------------------ clusters


QUICK = SPRINGS.replace("starts = 2", "starts = 1") + "[verification]\nsamples = 0\n"
MPIEXEC = Path(sys.executable).with_name("mpiexec")
# Runs are logged with their process, beginning and end, and slow enough for several batches; about
# the twentieth of them ends a process, once.
MODEL = """\
import os, pathlib, signal, time

HERE = pathlib.Path(__file__).parent


def length(load, softness):
    began = time.monotonic()
    time.sleep(0.02)
    victim = HERE / "victim"
    if load == 4.0 and softness > 1.4 and victim.exists():
        pid = int(victim.read_text() or os.getpid())
        victim.unlink()
        os.kill(pid, signal.SIGKILL)
        time.sleep(0.5)
    with open(HERE / "log.txt", "a") as log:
        log.write(f"{load} {softness!r} {os.getpid()} {began} {time.monotonic()}\\n")
    return load * softness
"""


def aleator_run(folder: Path, *options: str, launch: tuple[str, ...] = ()) -> Any:
    return subprocess.run(
        [*launch, sys.executable, *(("-m", "mpi4py.futures") if launch else ()), "-m", "aleator",
         "identify", str(folder / "study.toml"), "--no-figures", "--output", str(folder / "out"),
         *options],
        env={**os.environ, "PYTHONPATH": str(Path(aleator.__file__).parents[1])},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def answer(folder: Path) -> dict[str, Any]:
    found = read(folder / "out" / "identification.json")
    del found["seconds"]
    return found


def study_in(folder: Path) -> Path:
    return springs(folder, QUICK, MODEL, LENGTHS[:5]).parent


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer without any cluster."""
    folder = study_in(tmp_path_factory.mktemp("alone") / "springs")
    done = aleator_run(folder)
    assert done.returncode == 0, done.stderr
    return answer(folder)


def logged(folder: Path) -> list[list[str]]:
    """The load, softness, process, beginning and end of each run."""
    return [line.split() for line in (folder / "log.txt").read_text().splitlines()]


def runs_made(folder: Path) -> list[str]:
    return [f"{load} {softness}" for load, softness, *_ in logged(folder)]


def kept(folder: Path) -> list[str]:
    with Store(folder / "runs.sqlite") as store:
        return [f"{r.conditions['load']} {r.parameters['softness']!r}" for r in stored_runs(store)]


@pytest.mark.slow
def test_two_workers_run_at_once_and_to_the_same_answer_where_one_is_killed(
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
    runs = sorted((float(began), float(end), pid) for _, _, pid, began, end in logged(folder))
    at_once = sum(
        pid != other and later < end
        for (_, end, pid), (later, _, other) in pairwise(runs[:16])  # before the end of one
    )  # fmt: skip
    assert at_once > 0
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


@pytest.mark.long
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
    said = refused("box", folder / "study.toml", *options)
    assert [name for name in names if name not in said] == []
    assert not (folder / "log.txt").exists()
    assert not (folder / "runs.sqlite").exists()
