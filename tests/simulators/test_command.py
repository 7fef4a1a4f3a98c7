"""A program: what it is given, where its outcome is, how it fails; nothing of it is left."""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs import emptied, failing, gone, script

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators import RunFailed
from aleator.simulators.command import (
    CommandSimulator,
    CsvFeed,
    CsvOutput,
    Delimiters,
    HookOutput,
    InputFile,
    JsonFeed,
    JsonOutput,
    Keep,
    OutputFile,
    RegexOutput,
    Template,
    run,
)
from aleator.simulators.command.inputs import Text, filled
from aleator.simulators.command.run import run_folder
from aleator.simulators.runs import Failure, Runs

DIVIDE = ["awk", 'BEGIN {{printf "%.17g", {load} / {stiffness}}}']


def once(simulator: CommandSimulator, load: float | str = 1.0, stiffness: float = 4.0) -> float:
    return simulator.run_one({"load": load}, {"stiffness": stiffness})


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_a_placeholder_without_format_keeps_every_digit(value: float) -> None:
    assert float(Text.parse("{x}").fill({"x": value})) == value
    assert float(Text.parse("{x:.17g}").fill({"x": value})) == value


@pytest.mark.parametrize(
    ("text", "marks", "filled"),
    [
        ("{x:8.3f}|", Delimiters(), "   2.500|"),
        ("{ x }, {\n}", Delimiters(), "2.5, {\n}"),
        ('{"a": {{x}}}', Delimiters("{{", "}}"), '{"a": 2.5}'),
        ("a{b} = $x$; $x:.1e$", Delimiters("$", "$"), "a{b} = 2.5; 2.5e+00"),
        ("<%x%>", Delimiters("<%", "%>"), "2.5"),
        ("{n:d} {n:05d}", Delimiters(), "3 00003"),
        ("{name:>4}", Delimiters(), "   A"),
    ],
)
def test_delimiters_and_formats(text: str, marks: Delimiters, filled: str) -> None:
    assert Text.parse(text, marks).fill({"x": 2.5, "n": 3.0, "name": "A"}) == filled


def test_doubled_braces_are_braces_in_a_command_only() -> None:
    assert Text.parse("{{x}} {x}", escapes=True).fill({"x": 1.0}) == "{x} 1.0"
    assert Text.parse("}}{x}}}").fill({"x": 1.0}) == "}}1.0}}"


def test_a_command_as_one_text_is_cut_as_a_shell_does_but_no_shell_sees_it(tmp_path: Path) -> None:
    program = script(tmp_path, 'test "$1" = "1.0 * 2" && echo $#')
    assert once(CommandSimulator(f"{program} '{{load}} * 2' $HOME", base=tmp_path)) == 2


def test_a_template_is_written_into_the_private_folder(tmp_path: Path) -> None:
    (tmp_path / "model.tpl").write_bytes(b"\xff\r\nk $stiffness$\r\nF $load:.3f$\r\n")
    program = script(tmp_path, """awk '/^k/ {k = $2} /^F/ {print $2 / k}' "$1" > result.txt""")
    simulator = CommandSimulator(
        [program, "{input}"],
        base=tmp_path,
        inputs=(InputFile("sub/model.in", Template(tmp_path / "model.tpl", Delimiters("$", "$"))),),
        output=OutputFile("result.txt"),
        keep=Keep.ALL,
    )
    assert once(simulator) == 0.25
    (kept,) = (tmp_path / "completed_runs").iterdir()
    assert (kept / "sub/model.in").read_bytes() == b"\xff\r\nk 4.0\r\nF 1.000\r\n"
    assert json.loads((kept / "aleator.run.json").read_text())["values"] == {
        "load": 1.0,
        "stiffness": 4.0,
    }


@pytest.mark.parametrize(
    ("feed", "read"),
    [(JsonFeed(), "json.load(sys.stdin)"), (CsvFeed(), "next(csv.DictReader(sys.stdin))")],
)
def test_standard_input_has_every_condition(feed: JsonFeed | CsvFeed, read: str) -> None:
    code = f"import csv, json, sys; v = {read}; print(float(v['load']) / float(v['stiffness']))"
    simulator = CommandSimulator(["python3", "-S", "-c", code], stdin=feed)
    assert simulator.asks(["load", "bench"], ["stiffness"]) == ("load", "bench")
    assert simulator.run_one({"load": 0.1, "bench": 'A, "b"'}, {"stiffness": 3.0}) == 0.1 / 3.0


@pytest.mark.parametrize("link", [False, True])
def test_files_and_folders_come_along(tmp_path: Path, link: bool) -> None:
    (tmp_path / "mesh.dat").write_text("3\n")
    (tmp_path / "tables/deep").mkdir(parents=True)
    (tmp_path / "tables/deep/oil.dat").write_text("4\n")
    program = script(tmp_path, "cat mesh.dat tables/deep/oil.dat | awk '{s += $1} END {print s}'")
    simulator = CommandSimulator([program], base=tmp_path, files=("mesh.dat", "tables/"), link=link)
    assert once(simulator) == 7


def test_an_old_result_among_the_files_is_not_taken_for_the_outcome(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old/result.txt").write_text("1.0")
    simulator = CommandSimulator(
        ["true"], base=tmp_path, files=("old",), link=True, output=OutputFile("old/result.txt")
    )
    with pytest.raises(Exception, match=r"wrote no file 'old/result.txt'"):
        once(simulator)
    assert (tmp_path / "old/result.txt").read_text() == "1.0"


@pytest.mark.parametrize("link", [False, True])
def test_an_input_replaces_a_file_of_the_case_but_not_the_study(tmp_path: Path, link: bool) -> None:
    (tmp_path / "case").mkdir()
    (tmp_path / "case/load").write_text("as it was")
    (tmp_path / "load.tpl").write_text("{load}")
    simulator = CommandSimulator(
        ["cat", "{input}"],
        base=tmp_path,
        files=("case",),
        link=link,
        inputs=(InputFile("case/load", Template(tmp_path / "load.tpl")),),
    )
    assert once(simulator, 3.0) == 3
    assert (tmp_path / "case/load").read_text() == "as it was"


@pytest.mark.parametrize(
    ("output", "text", "outcome"),
    [
        (OutputFile(), " 1.5D-01\n", 0.15),
        (RegexOutput("stdout", r"time\s*=\s*(\S+)"), "time = 1\ntime = 2.5\n", 2.5),
        (RegexOutput("stdout", r"^t (\S+)$", 0), "at 0\nt 1\nt 2\n", 1.0),
        (CsvOutput("stdout", "time"), "id,time\n1,0.5\n2,0.75\n\n", 0.75),
        (CsvOutput("stdout", "time", 0, ";", 1), "# made\nid; time\n1; 5e-1\n", 0.5),
        (CsvOutput("stdout", 1, 0, " "), "  1.0   2.0\n  3.0   4.0\n", 2.0),
        (JsonOutput("stdout", "results.1.time"), '{"results": [1, {"time": 0.5}]}', 0.5),
    ],
)
def test_outputs(tmp_path: Path, output: OutputFile, text: str, outcome: float) -> None:
    (tmp_path / "text").write_text(text)
    simulator = CommandSimulator(["cat", "text"], output, base=tmp_path, files=("text",))
    assert once(simulator) == outcome


def test_a_hook_gets_the_folder_and_what_was_printed(tmp_path: Path) -> None:
    (tmp_path / "reading.py").write_text(
        "def outcome(folder, stdout):\n"
        "    return float(stdout) + float((folder / 'more.txt').read_text())\n"
    )
    program = script(tmp_path, "echo 2; echo 3 > more.txt")
    simulator = CommandSimulator(
        [program], HookOutput("reading.py:outcome", tmp_path), base=tmp_path
    )
    assert once(simulator) == 5


def test_pickled_copies_run_at_once_without_meeting(tmp_path: Path) -> None:
    program = script(tmp_path, "echo $1 > result.txt; sleep 0.02; test $(ls | wc -l) = 3")
    simulator = CommandSimulator(
        [program, "{load}"], OutputFile("result.txt"), base=tmp_path, keep=Keep.NONE
    )
    copies = [pickle.loads(pickle.dumps(simulator)) for _ in range(8)]
    with ThreadPoolExecutor(4) as pool:
        outcomes = list(pool.map(once, copies, map(float, range(8))))
    assert outcomes == list(range(8))
    assert all(copy == simulator for copy in copies)


def test_a_fingerprint_changes_with_all_that_is_named(tmp_path: Path) -> None:
    (tmp_path / "mesh").mkdir()
    for name in ("in.tpl", "mesh/a.dat", "model.awk"):
        (tmp_path / name).write_text("{x}")
    script(tmp_path, "echo 1")

    def made(**other: object) -> str:
        choices: dict[str, object] = {
            "command": ["./program", "{study}/model.awk"],
            "base": tmp_path,
            "files": ("mesh",),
            "inputs": (InputFile("in.dat", Template(tmp_path / "in.tpl")),),
        }
        return CommandSimulator(**{**choices, **other}).fingerprint()  # type: ignore[arg-type]

    first = made()
    assert made() == first
    assert made(timeout=3.0, keep=Keep.NONE) == first
    seen = {first}
    for change in (
        {"command": ["./program", "{study}/model.awk", "-v"]},
        {"version": "2"},
        {"output": OutputFile("stderr")},
        {"environment": {"A": "1"}},
        {"stdin": JsonFeed()},
    ):
        seen.add(made(**change))
    for name in ("in.tpl", "mesh/a.dat", "model.awk", "program"):
        (tmp_path / name).write_text("#!/bin/sh\n# changed {x}")
        seen.add(made())
    assert len(seen) == 10


def test_a_fingerprint_does_not_change_when_the_study_moves(tmp_path: Path) -> None:
    prints = []
    for name in ("here", "there"):
        base = tmp_path / name
        base.mkdir()
        (base / "in.tpl").write_text("{x}")
        prints.append(
            CommandSimulator(
                [script(base, "echo 1"), "{study}/in.tpl"],
                base=base,
                inputs=(InputFile("in.dat", Template(base / "in.tpl")),),
            ).fingerprint()
        )
    assert prints[0] == prints[1]


def test_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    once(CommandSimulator(DIVIDE))
    (home,) = tmp_path.iterdir()  # of this process, as long as it lives
    assert os.listdir(home) == []
    run.close()
    assert os.listdir(tmp_path) == []


def template(folder: Path, text: str = "{x}") -> Template:
    (folder / "in.tpl").write_text(text)
    return Template(folder / "in.tpl")


def made(command: object = ("true",), **choices: object) -> Callable[[Path], object]:
    return lambda folder: CommandSimulator(command, base=folder, **choices)  # type: ignore[arg-type]


# What is made, and what the refusal names: the cause, the nearest name, or what to write instead.
WRONG: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "no such program": (made(["./progam"]), ["'./progam'", "'program'"]),
    "no program": (made(["./model.py"]), ['["python3", "{study}/model.py"']),
    "not executable": (made(["./text"]), ["chmod +x ./text"]),
    "a folder": (made(["./folder"]), ["'./folder'"]),
    "beside the PATH": (made(["program"]), ["PATH", "'./program'"]),
    "nowhere": (made(["no_such_program_anywhere"]), ["PATH", "install"]),
    "another in each run": (made(["./{x}"]), ["'./{x}'"]),
    "empty": (made([]), ["empty"]),
    "an open quote": (made("./program 'open"), ["cut into arguments"]),
    "a list for a shell": (made(["echo", "1"], shell=True), ["one text"]),
    "no such file": (made(files=("txt",)), ["'txt'", "'text'"]),
    "two of one name": (made(files=("text", "folder/text")), ["'text'"]),
    "no time": (made(timeout=0.0), ["timeout = 0"]),
    "no end": (made(timeout=float("inf")), ["timeout = inf"]),
    "no success": (made(success_codes=()), ["every run would fail"]),
    "no such template": (lambda folder: Template(folder / "tex"), ["'text'"]),
    "an input above": (lambda f: InputFile("../in.dat", template(f)), ["folder of a run"]),
    "an input elsewhere": (lambda f: InputFile("/in.dat", template(f)), ["folder of a run"]),
    "an input that is a file": (
        lambda f: made(files=("text",), inputs=(InputFile("text", template(f)),))(f),
        ["file of the run already"],
    ),
    "a format": (lambda _: Text.parse("{x:q}"), ["{x:q}"]),
    "delimiters": (lambda _: Delimiters("", "}"), ["cannot mark a placeholder"]),
    "a regex": (lambda _: RegexOutput("stdout", "time = ("), ["'time = ('"]),
    "no group": (lambda _: RegexOutput("stdout", "time"), ["0 groups"]),
    "two groups": (lambda _: RegexOutput("stdout", "(a)(b)"), ["2 groups"]),
    "a delimiter": (lambda _: CsvOutput("stdout", 0, delimiter=", "), ["one character"]),
    "an output elsewhere": (lambda _: OutputFile("/tmp/result.txt"), ["folder of a run"]),
    "no such hook": (lambda _: HookOutput("nowhere.py:outcome"), ["nowhere.py"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_run_is_refused_with_its_remedy(tmp_path: Path, case: str) -> None:
    script(tmp_path, "echo 1")
    (tmp_path / "folder").mkdir()
    for name in ("model.py", "text", "folder/text"):
        (tmp_path / name).write_text("")
    make, names = WRONG[case]
    with pytest.raises(SimulatorError) as refused:
        make(tmp_path)
    assert refused.value.remedy
    assert [name for name in names if name not in str(refused.value)] == []


def test_placeholders_and_parameters_must_meet(tmp_path: Path) -> None:
    inputs = (InputFile("in.dat", template(tmp_path, "{stifness}")),)
    told = CommandSimulator(["echo", "{load}"])
    with pytest.raises(SimulatorError, match=r"never told the parameter 'stiffness'"):
        told.asks(["load"], ["stiffness"])
    with pytest.raises(SimulatorError, match=r"the command: 'load' is neither.*mean 'loads'"):
        told.asks(["loads"], [])
    with pytest.raises(SimulatorError, match=r"'load' is both a condition and a parameter"):
        told.asks(["load"], ["load"])
    with pytest.raises(SimulatorError, match=r"template in.tpl: 'stifness'.*'stiffness'"):
        CommandSimulator(["true"], inputs=inputs).asks([], ["stiffness"])
    with pytest.raises(SimulatorError, match=r"'input' stands for the input file"):
        CommandSimulator(["cat", "{input}"], inputs=inputs).asks([], ["stifness", "input"])
    assert CommandSimulator(["echo", "{load}"], allow_unused=True).asks(["load"], ["k"]) == (
        "load",
    )
    assert CommandSimulator(["cat"], stdin=JsonFeed()).asks(["a", "b"], ["k"]) == ("a", "b")


def test_braces_that_are_no_placeholders_are_told_of(tmp_path: Path) -> None:
    (tmp_path / "in.json").write_text('{"a": {x}, "b": {"c": 3}}')
    template = Template(tmp_path / "in.json")
    with pytest.raises(SimulatorError, match="choose other delimiters for a file"):
        CommandSimulator(["true"], stdin=template).asks([], ["x"])
    (tmp_path / "in.json").write_text('{"a": <x>, "b": {"c": 3}}')
    template = Template(tmp_path / "in.json", Delimiters("<", ">"))
    assert template.names == ("x",)


def test_a_crash_is_told_with_its_last_words_and_its_folder_is_kept(tmp_path: Path) -> None:
    failure = failing(tmp_path, "echo begun; echo 'pressure too high' >&2; exit 3")
    assert failure.log == "begun\npressure too high"
    (kept,) = (tmp_path / "failed_runs").iterdir()
    assert failure.message == f"it ended with exit code 3: pressure too high (kept in {kept})"
    assert (kept / "aleator.stdout").read_text() == "begun\n"
    copy = pickle.loads(pickle.dumps(failure))
    assert (copy.message, copy.log) == (failure.message, failure.log)


def test_the_failure_that_most_runs_share_is_found() -> None:
    said = ["no root at 3 (kept in /a/1)", "cold", "no root at 4.5 (kept in /a/2)", "cold 2"]
    x = np.array([[4.0], [1.0], [3.0], [2.0]])
    runs = replace(
        Runs.planned(np.zeros(4, dtype=np.intp), x),
        failures={row: Failure(text) for row, text in enumerate(said)},
    )
    found = runs.frequent_failure()
    assert found is not None
    assert found.message == said[2]  # of those alike the one at the least parameter
    assert Runs.planned(np.zeros(4, dtype=np.intp), x).frequent_failure() is None


def test_other_exit_codes_may_be_a_success(tmp_path: Path) -> None:
    program = script(tmp_path, "echo 5; exit 3")
    assert CommandSimulator([program], base=tmp_path, success_codes=(0, 3)).run_one({}, {}) == 5


def test_an_outcome_beside_another_exit_code_is_told(tmp_path: Path) -> None:
    assert "success_codes = [0, 3]" in failing(tmp_path, "echo 5; exit 3").message
    for text in ("echo five; exit 3", "echo 5; kill -9 $$"):
        assert "success_codes" not in failing(tmp_path, text).message


def test_failed_runs_do_not_fill_the_disk(tmp_path: Path) -> None:
    for k in range(100):
        (tmp_path / f"failed_runs/{k}").mkdir(parents=True)
    assert "holds 100 runs" in failing(tmp_path, "exit 1").message
    assert len(list((tmp_path / "failed_runs").iterdir())) == 100


@pytest.mark.parametrize(
    ("output", "text", "message"),
    [
        (
            OutputFile("result.txt"),
            "echo 1 > result.tx",
            r"no file 'result.txt' \(did you mean 're",
        ),
        (OutputFile(), "echo garbage", r"outcome in 'stdout' is 'garbage', not a number"),
        (OutputFile(), "echo 1_000", r"outcome in 'stdout' is '1_000', not a number"),
        (CsvOutput(), "head -c 200000 /dev/zero | tr '\\0' 1", "is not a table: field larger"),
        (OutputFile(), "true", r"outcome in 'stdout' is empty, not a number"),
        (OutputFile(), "echo NaN", "is NaN, which is not finite"),
        (OutputFile(), "echo -inf", "is -inf, which is not finite"),
        (RegexOutput("stdout", "t = (.*)"), "echo t: 3", "matches nothing in 'stdout'"),
        (RegexOutput("stdout", "t = (.*)"), "echo t: 3", 'begins with "t: 3"'),
        (RegexOutput("stdout", "(.*)="), "echo 3 > out.csv", "is empty; .* holds out.csv too"),
        (RegexOutput("stdout", "t = (.*)", 2), "echo t = 3", "matches 1 times"),
        (CsvOutput("stdout", "time"), "echo tim,x", r"no column 'time' \(did you mean 'tim'"),
        (CsvOutput("stdout", "time"), "echo time", "has 0 rows"),
        (CsvOutput("stdout", 2), "echo 1,2", "has 2 columns"),
        (JsonOutput("stdout", "a"), "echo '{'", "'stdout' is not JSON"),
        (
            JsonOutput("stdout", "a.time"),
            """echo '{"a": {"tim": 1}}'""",
            r"mean 'tim'.*has tim there",
        ),
        (JsonOutput("stdout", "a.1"), """echo '{"a": [1]}'""", "no '1' at a; it has 1 entries"),
        (JsonOutput("stdout", "a"), """echo '{"a": null}'""", "is None, not a number"),
    ],
)
def test_an_outcome_that_is_not_there(
    tmp_path: Path, output: OutputFile, text: str, message: str
) -> None:
    failure = failing(tmp_path, text, output=output)
    with pytest.raises(RunFailed, match=message):
        raise failure


def test_a_hook_that_fails(tmp_path: Path) -> None:
    (tmp_path / "failing_hook.py").write_text(
        "def raises(folder, stdout):\n    return 1 / 0\n\n"
        "def text(folder, stdout):\n    return '3'\n\n"
        "def row(folder, stdout):\n    return [3]\n"
    )
    raises = HookOutput("failing_hook.py:raises", tmp_path)
    message = failing(tmp_path, "true", output=raises).message
    assert "raised ZeroDivisionError: division by zero (failing_hook.py, line 2)" in message
    text = HookOutput("failing_hook.py:text", tmp_path)
    assert "returned '3', not a number" in failing(tmp_path, "true", output=text).message
    row = HookOutput("failing_hook.py:row", tmp_path)
    assert "returned [3], not a number" in failing(tmp_path, "true", output=row).message


def test_a_program_that_is_not_one_for_this_machine(tmp_path: Path) -> None:
    (tmp_path / "program").write_bytes(b"\x7fELF garbage")
    (tmp_path / "program").chmod(0o755)
    with pytest.raises(SurroundingsError, match="cannot be started: Exec format error"):
        CommandSimulator(["./program"], base=tmp_path).run_one({}, {})


def test_a_value_that_does_not_have_the_format() -> None:
    with pytest.raises(RunFailed, match=r"'A' of 'bench' cannot be written with the format '.3f'"):
        CommandSimulator(["echo", "{bench:.3f}"], keep=Keep.NONE).run_one({"bench": "A"}, {})


def test_a_program_that_hangs_is_stopped_with_all_its_children(tmp_path: Path) -> None:
    failure = failing(tmp_path, "sleep 60 & echo $!; wait", timeout=0.2)
    assert failure.message.startswith("it was stopped after its 0.2 s")
    assert gone(int(failure.log))


def test_a_child_that_outlives_the_program_is_ended(tmp_path: Path) -> None:
    program = script(tmp_path, "sleep 60 & echo $!")
    assert gone(int(CommandSimulator([program], base=tmp_path).run_one({}, {})))


def test_a_program_that_does_not_listen_is_killed(tmp_path: Path) -> None:
    failure = failing(tmp_path, "trap '' TERM; sleep 60 & echo $!; wait", timeout=0.1)
    assert failure.message.startswith("it was stopped after its 0.1 s")
    assert gone(int(failure.log))


def test_nothing_is_left_of_a_run_whose_caller_is_killed(tmp_path: Path) -> None:
    program = script(tmp_path, f"sleep 60 & echo $$ $! > {tmp_path}/pids; wait")
    (tmp_path / "folders").mkdir()
    code = (
        "from pathlib import Path\n"
        "from aleator.simulators.command import CommandSimulator\n"
        f"CommandSimulator([{program!r}], base=Path({str(tmp_path)!r})).run_one({{}}, {{}})\n"
    )
    caller = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(tmp_path / "folders")}
    )
    pids = tmp_path / "pids"
    while not (pids.exists() and pids.read_text().strip()):
        assert caller.poll() is None
        time.sleep(0.01)
    assert len([*(tmp_path / "folders").iterdir()]) == 1
    time.sleep(0.1)  # the caller takes note of what it started
    caller.kill()
    caller.wait()
    assert all(gone(int(pid)) for pid in pids.read_text().split())
    assert emptied(tmp_path / "folders")


@pytest.mark.slow
def test_ctrl_c_ends_the_program_and_passes_on(tmp_path: Path) -> None:
    program = script(tmp_path, f"echo $$ > {tmp_path}/pid; sleep 60")
    code = (
        "import signal\n"
        # it may be ignored where the tests run in the background
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from aleator.simulators.command import CommandSimulator\n"
        f"CommandSimulator([{program!r}], base=__import__('pathlib').Path({str(tmp_path)!r}))"
        ".run_one({}, {})\n"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
    pid = tmp_path / "pid"
    for _ in range(1000):
        if pid.exists() and pid.read_text().strip():
            break
        time.sleep(0.01)
    os.kill(caller.pid, signal.SIGINT)
    _, told = caller.communicate(timeout=20)
    assert told.endswith(b"KeyboardInterrupt\n")
    assert gone(int(pid.read_text()))


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_the_instant_of_a_start_ends_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signum: signal.Signals
) -> None:
    simulator = CommandSimulator([script(tmp_path, "echo 1.0; exec sleep 60")], base=tmp_path)
    started: list[int] = []

    class Interrupted(subprocess.Popen[bytes]):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            started.append(self.pid)
            signal.raise_signal(signum)

    run_folder().rmdir()  # a janitor is there, whose start is not the one in question
    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    before = signal.signal(signum, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulator.run_one({}, {})
        assert signal.getsignal(signum) is signal.default_int_handler
    finally:
        signal.signal(signum, before)
    (pid,) = started
    assert gone(pid)


def test_a_passing_folder_is_gone_with_its_process(tmp_path: Path) -> None:
    code = (
        "import time\n"
        "from aleator.simulators.command.run import passing\n"
        "with passing() as folder:\n"
        "    (folder / 'large').write_text('1')\n"
        "    print(folder, flush=True)\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as caller:
        assert caller.stdout is not None
        folder = Path(caller.stdout.readline().decode().strip())
        assert (folder / "large").exists()
        caller.kill()
    assert emptied(tmp_path)


HERE_DOCUMENT = """cat <<END
{label}
END
echo 1"""


@pytest.mark.parametrize("value", ["$(touch X)", "';touch X;'", "A B"])
@pytest.mark.parametrize(
    "command",
    [
        'echo "label: {label}" > /dev/null; echo 1',
        "echo '{label}' > /dev/null; echo 1",
        HERE_DOCUMENT,
        'echo "$(echo "a {label}")" > /dev/null; echo 1',
        "echo `echo {label}` > /dev/null; echo 1",
        "eval echo {label} > /dev/null; echo 1",
        "bash -c 'echo '{label} > /dev/null; echo 1",
        "ssh host echo {label} > /dev/null; echo 1",
        "# it's\necho '{label}' > /dev/null; echo 1",
    ],
)
def test_a_shell_never_reads_what_a_cell_says(tmp_path: Path, command: str, value: str) -> None:
    simulator = CommandSimulator(command, shell=True, base=tmp_path, keep=Keep.ALL)
    with pytest.raises(SimulatorError, match=r"LABEL = \"\{label\}\"") as told:
        simulator.run_one({"label": value}, {})
    assert not isinstance(told.value, SurroundingsError)
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize("program", [["sh", "-c"], ["bash", "-e", "-uc"]])
def test_a_shell_that_is_the_program_itself_does_not_either(
    tmp_path: Path, program: list[str]
) -> None:
    quoted = CommandSimulator([*program, 'echo "{label}"; echo 1'], base=tmp_path, keep=Keep.ALL)
    with pytest.raises(SimulatorError, match="a shell would read"):
        quoted.run_one({"label": "$(touch X)"}, {})
    for command in (
        [*program, "printf %s {label} | wc -c"],
        [*program, 'printf %s "$1" | wc -c', "sh", "{label}"],
    ):
        simulator = CommandSimulator(command, base=tmp_path, keep=Keep.ALL)
        assert simulator.run_one({"label": "$(touch X)"}, {}) == len("$(touch X)")
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize("value", ["B-2.1", "Prüfstand", "a/b,c=d:e%f@g+h_i"])
def test_a_plain_cell_may_stand_in_quotes_of_a_shell(tmp_path: Path, value: str) -> None:
    same = """test "{label}" = '{label}' && test {x:.2f} = '{x:.2f}'"""
    command = f"{same} && echo {{label}} > n && wc -c < n"
    length = CommandSimulator(command, shell=True, base=tmp_path).run_one(
        {"label": value}, {"x": 2.0}
    )
    assert length == len(value.encode()) + 1


def test_a_cell_of_any_text_reaches_a_shell_by_its_environment(tmp_path: Path) -> None:
    value = "$(touch X)`touch X`';\" touch X"
    command = 'printf %s "$LABEL" | wc -c'
    simulator = CommandSimulator(
        command, shell=True, base=tmp_path, environment={"LABEL": "{label}"}, keep=Keep.ALL
    )
    assert simulator.run_one({"label": value}, {}) == len(value)
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize(
    "command", ["echo {label} | sh", "echo {label}|/bin/bash", "trap {label} EXIT"]
)
def test_a_shell_that_reads_a_pipe_and_a_trap_read_a_cell_twice(command: str) -> None:
    text = Text.parse(command)
    assert filled(text, {"label": "B2"}).replace("B2", "{label}") == command
    with pytest.raises(SimulatorError, match="a shell would read"):
        filled(text, {"label": "touch X"})
    assert "'touch X'" in filled(Text.parse("run.sh {label} | tee x"), {"label": "touch X"})
