"""An external program as a simulator: what it is given, and where its outcome is found."""

import json
import os
import pickle
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import Runner
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
    process,
)
from aleator.simulators.command.inputs import Text

DIVIDE = ["awk", 'BEGIN {{printf "%.17g", {load} / {stiffness}}}']


def script(folder: Path, text: str, name: str = "program") -> str:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return f"./{name}"


def once(simulator: CommandSimulator, load: float | str = 1.0, stiffness: float = 4.0) -> float:
    return simulator.run_one({"load": load}, {"stiffness": stiffness})


# ------------------------------------------------------------------------------ placeholders


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


def test_a_format_that_no_number_has() -> None:
    with pytest.raises(SimulatorError, match=r"\{x:q\} has a format that no number has"):
        Text.parse("{x:q}")
    with pytest.raises(SimulatorError, match="cannot mark a placeholder"):
        Delimiters("", "}")


# ------------------------------------------------------------------------- what it is given


def test_arguments() -> None:
    assert once(CommandSimulator(DIVIDE)) == 0.25


def test_a_command_as_one_text_is_cut_as_a_shell_does_but_no_shell_sees_it(tmp_path: Path) -> None:
    program = script(tmp_path, 'test "$1" = "1.0 * 2" && echo $#')
    assert once(CommandSimulator(f"{program} '{{load}} * 2' $HOME", base=tmp_path)) == 2


def test_a_shell_gets_quoted_values() -> None:
    simulator = CommandSimulator("printf %s {load} | wc -c | tr -d ' '", shell=True)
    assert once(simulator, "a b; $(exit 3) 'c'") == len("a b; $(exit 3) 'c'")


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


def test_environment(tmp_path: Path) -> None:
    simulator = CommandSimulator(
        [script(tmp_path, "echo $LOAD")], base=tmp_path, environment={"LOAD": "{load:.0f}"}
    )
    assert once(simulator, 12.0) == 12


@pytest.mark.parametrize(
    ("feed", "read"),
    [
        (JsonFeed(), "json.load(sys.stdin)"),
        (CsvFeed(), "next(csv.DictReader(sys.stdin))"),
    ],
)
def test_standard_input_has_every_condition(feed: JsonFeed | CsvFeed, read: str) -> None:
    code = f"import csv, json, sys; v = {read}; print(float(v['load']) / float(v['stiffness']))"
    simulator = CommandSimulator(["python3", "-S", "-c", code], stdin=feed)
    assert simulator.asks(["load", "bench"], ["stiffness"]) == ("load", "bench")
    assert simulator.run_one({"load": 0.1, "bench": 'A, "b"'}, {"stiffness": 3.0}) == 0.1 / 3.0


def test_standard_input_from_a_template(tmp_path: Path) -> None:
    (tmp_path / "in.tpl").write_text("{load} {stiffness}\n")
    simulator = CommandSimulator(
        ["awk", "{{print $1 / $2}}"], stdin=Template(tmp_path / "in.tpl"), base=tmp_path
    )
    assert once(simulator) == 0.25


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


def test_the_study_folder_has_a_placeholder(tmp_path: Path) -> None:
    (tmp_path / "model.awk").write_text("BEGIN {print 6}")
    assert once(CommandSimulator(["awk", "-f", "{study}/model.awk"], base=tmp_path)) == 6


# ------------------------------------------------------------------- where the outcome is


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


# ------------------------------------------------------- the same answers as a function gives


@given(load=st.floats(1e-300, 1e300), stiffness=st.floats(1e-3, 1e3))
@settings(max_examples=20, deadline=None)
def test_a_program_gives_what_the_function_gives(load: float, stiffness: float) -> None:
    assert once(CommandSimulator(DIVIDE), load, stiffness) == load / stiffness


def test_runs_through_the_runner_and_keeps_what_completed_before_a_failure(tmp_path: Path) -> None:
    program = script(tmp_path, 'test $1 != 3.0 || { echo "no convergence" >&2; exit 7; }; echo $1')
    simulator = CommandSimulator([program, "{x}"], base=tmp_path)
    run = Runner(simulator, Conditions(("a", "b"), pd.DataFrame({"z": [0.0, 1.0]})), ["x"])
    assert run([0, 1, 0], [[1.0], [1.0], [2.0]]).tolist() == [1.0, 1.0, 2.0]
    with pytest.raises(SimulatorError) as error:
        run([0, 0, 0], [[5.0], [3.0], [6.0]])
    assert error.value.problem.startswith(
        "simulator 'program' failed for experiment 'a' with x=3: it ended with exit code 7 (kept in"
    )
    assert error.value.problem.endswith("its log ends: no convergence")
    assert run.completed.outcome[:3, 0].tolist() == [1.0, 2.0, 5.0]
    assert np.isnan(run.attempt([0, 0], [[3.0], [4.0]])).tolist() == [True, False]


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


# ----------------------------------------------------------------------------- fingerprint


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
    process.close()
    assert os.listdir(tmp_path) == []
