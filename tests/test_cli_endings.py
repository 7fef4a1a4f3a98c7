"""Simulators that end the process they run in, and answers that a command would replace."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

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
    "crash": ("ctypes.string_at(0)", "signal 11"),
    "abort": ("os.abort()", "signal 6"),
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
