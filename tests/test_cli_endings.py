"""How commands end, by a crash or a signal; where files lie, and what is replaced."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.cli import main

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
"""
ENDS = {
    "exit": ("os._exit(0)", "exit code 0"),
    "stop": ("ctypes.CDLL(None).exit(0)", "exit code 0"),
    "crash": ("ctypes.string_at(0)", "signal SIGSEGV"),
    "abort": ("os.abort()", "signal SIGABRT"),
}
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="no cheap copy of a process")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "springs.csv").write_text("id,load,length\nA,1,0.93\nB,2,2.1\nC,3,3.2\nD,4,3.7\n")
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "new.csv").write_text("id,load\nE,5\nF,6\n")
    simulated(tmp_path, "pass")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def simulated(folder: Path, line: str) -> None:
    (folder / "model.py").write_text(
        f"import ctypes, os\ndef length(load, softness):\n    {line}\n    return load * softness\n"
    )


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, arguments)


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
    command = [sys.executable, "-m", "aleator", "check", "study.toml", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == -11
    assert "Segmentation fault" in done.stderr
    assert "model.py" in done.stderr


@LINUX
@pytest.mark.parametrize("end", [f"load > 3 and {ENDS[name][0]}" for name in ("exit", "stop")])
def test_an_end_of_a_later_run_is_not_silent(folder: Path, end: str) -> None:
    simulated(folder, end)
    command = [sys.executable, "-m", "aleator", "check", "study.toml", "--no-figures"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
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


@pytest.mark.parametrize(
    ("result", "command"),
    [
        ("check.json", ("check",)),
        ("sensitivity.json", ("sensitivity",)),
        ("box.json", ("box",)),
        ("identification.json", ("identify",)),
        ("ceiling.json", ("ceiling",)),
        ("bootstrap.json", ("bootstrap",)),
        ("posterior.json", ("posterior",)),
        ("recovery.json", ("recover",)),
        ("next.json", ("next", "--candidates", "new.csv", "--count", "1")),
    ],
)
def test_the_answer_of_another_study_is_not_replaced(
    folder: Path, result: str, command: tuple[str, ...]
) -> None:
    if command[0] == "posterior":
        pytest.importorskip("mici")
    older = folder / "out" / result
    older.parent.mkdir()
    text = json.dumps({"study": {"file": "../other.toml"}})
    older.write_text(text)
    done = run(command[0], "study.toml", *command[1:], "--output", "out")
    assert done.exit_code == 2, done.output
    assert "another study" in done.stderr
    assert older.read_text() == text


@pytest.mark.parametrize("name", ["told.csv", "told.json"])
def test_a_table_of_predictions_is_replaced_but_not_silently(folder: Path, name: str) -> None:
    assert run("identify", "study.toml", "--output", "out", "--quiet").exit_code == 0
    given = ("predict", "out/identification.json", "--conditions", "new.csv", "--no-uncertainty")
    first, second = (run(*given, "--output", name) for _ in range(2))
    assert (first.exit_code, second.exit_code) == (0, 0), second.output
    assert "will be replaced" not in first.stderr
    assert f"{name} of" in second.stderr
    if name.endswith(".json"):
        (folder / name).write_text(json.dumps({"study": {"file": "other.toml"}}))
        assert run(*given, "--output", name).exit_code == 2


PLACED_STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
SIMULATOR
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 1
[verification]
samples = 0
"""
FUNCTION = """\
import os, pathlib
IMPORTED
def length(load, softness):
    os.chdir(pathlib.Path(__file__).with_name("elsewhere"))
    return load * softness
"""
HOOK = """\
import os, pathlib
def read(placed, stdout):
    os.chdir(pathlib.Path(__file__).with_name("elsewhere"))
    return float(stdout)
"""
COMMAND = """\
command = ["cat", "out.txt"]
template = "t.txt"
input = "out.txt"
output = {hook = "hook.py:read"}
keep = "all"
"""
LENGTHS = [0.93, 2.1, 3.2, 3.7]


@pytest.fixture
def placed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "springs" / "elsewhere").mkdir(parents=True)
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(LENGTHS)]
    (tmp_path / "springs" / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(placed: Path) -> set[str]:
    return {str(path.relative_to(placed)) for path in placed.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("unjudged_commands")
@pytest.mark.parametrize("imported", ["", "os.chdir('/')"])
def test_results_and_runs_lie_where_they_were_wanted(placed: Path, imported: str) -> None:
    (placed / "springs" / "model.py").write_text(FUNCTION.replace("IMPORTED", imported))
    study = PLACED_STUDY.replace("SIMULATOR", 'function = "model.py:length"')
    (placed / "springs" / "study.toml").write_text(study)
    before = files(placed)
    where = ["--output", "results", "--store", "kept.sqlite"]
    done = CliRunner().invoke(main, ["identify", "springs/study.toml", "--no-figures", *where])
    assert done.exit_code == 0, done.output
    assert Path.cwd() == placed
    assert files(placed) - before == {"results/identification.json", "kept.sqlite"}
    document = json.loads((placed / "results" / "identification.json").read_text())
    assert document["study"]["file"] == "../springs/study.toml"

    (placed / "new.csv").write_text("load\n2\n")
    law = ["results/identification.json", "--conditions", "new.csv", "--output", "new_lengths.csv"]
    done = CliRunner().invoke(main, ["predict", *law, "--quiet"])
    assert done.exit_code == 0, done.output
    assert {"new_lengths.csv", "springs/runs.sqlite"} <= files(placed)
    assert files(placed / "springs" / "elsewhere") == set()


def test_a_hook_moves_no_run(placed: Path) -> None:
    (placed / "springs" / "hook.py").write_text(HOOK)
    (placed / "springs" / "t.txt").write_text("{softness}")
    study = PLACED_STUDY.replace("SIMULATOR", COMMAND).replace(
        '"length"', '"length"\nconditions = []'
    )
    (placed / "springs" / "study.toml").write_text(study)
    done = CliRunner().invoke(main, ["box", "springs/study.toml", "--output", "found"])
    assert done.exit_code == 0, done.output
    made = files(placed)
    assert {"found/box.json", "springs/runs.sqlite"} <= made
    assert any(name.startswith("springs/completed_runs/") for name in made)
    assert files(placed / "springs" / "elsewhere") == set()


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
    source = str(Path(cli.__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-m", "aleator", *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), source])},
        capture_output=True,
        check=False,
        text=True,
        # it may be ignored where the tests run in the background
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stderr) == (130, "aleator: stopped by Ctrl-C\n")


@pytest.mark.parametrize("ignored", [False, True])
def test_sigterm_ends_a_command_and_keeps_its_runs(tmp_path: Path, ignored: bool) -> None:
    """So a batch system ends it; in the background of a shell only Ctrl-C is ignored."""
    (tmp_path / "springs.csv").write_text("load,length\n1,1.1\n2,2.1\n3,2.8\n")
    (tmp_path / "model.py").write_text(
        "import os, signal\n"
        "def length(load, x):\n"
        "    length.runs += 1\n"
        "    if length.runs == 20: os.kill(os.getpid(), signal.SIGTERM)\n"
        "    return load * x\n"
        "length.runs = 0\n"
    )
    (tmp_path / "study.toml").write_text(
        '[experiments]\nfile = "springs.csv"\noutcome = "length"\n'
        '[simulator]\nfunction = "model.py:length"\n'
        '[parameters.x]\nlaw = "normal"\nmean = {lower = 0.5, upper = 1.5}\n'
        "sd = {lower = 0.01, upper = 0.5}\n"
    )
    answer = signal.SIG_IGN if ignored else signal.default_int_handler
    done = subprocess.run(
        [sys.executable, "-m", "aleator", "identify", "study.toml", "--output", "out"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])},
        capture_output=True,
        check=False,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, answer),
    )
    assert done.returncode == 143, done.stderr
    assert done.stderr.endswith("aleator: stopped by SIGTERM\n")
    kept = re.search(r"(\d+) new runs are kept", done.stderr)
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
