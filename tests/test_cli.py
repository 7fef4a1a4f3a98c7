"""Identify and predict by commands: files, stores, what is said, what is refused."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pandas as pd
import pytest
from reports import result
from studies import SPRINGS, done, estimate, read, refused, run, shown_again, springs

import aleator
from aleator.cli import main
from aleator.simulators.runs import Repeatability

pytestmark = pytest.mark.usefixtures("unreported")
QUICK = ("--no-figures", "--no-verify", "--quiet")


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    springs(tmp_path / "springs")
    monkeypatch.chdir(tmp_path)
    return Path("springs/study.toml")


# ------------------------------------------------------------------------------ commands


def commands(group: click.Group, name: str = "aleator") -> Iterator[tuple[str, click.Command]]:
    yield name, group
    context = click.Context(group)
    for key in group.list_commands(context):
        command = group.get_command(context, key)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} {key}")
        else:
            yield f"{name} {key}", command


def test_every_command_and_option_is_documented() -> None:
    found = dict(commands(main))
    assert {name.removeprefix("aleator").strip() for name in found} == {
        "", "identify", "predict", "recover", "ceiling", "sensitivity", "box", "compare",
        "bootstrap", "posterior", "next", "pbox", "report", "new", "check", "schema", "demo",
        "show", "runs", "runs list", "runs show", "runs export", "runs import", "runs retry",
        "runs forget",
    }  # fmt: skip
    for name, command in found.items():
        assert command.help, name
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, f"{name} {parameter.name}"
            else:
                assert isinstance(parameter.metavar, str), f"{name} {parameter.name}"
        shown = done(*name.split()[1:], "--help").output
        assert max(map(len, shown.splitlines())) <= 90


TAKEN: list[tuple[str, Callable[..., Any], list[str]]] = [
    ("bootstrap", aleator.bootstrap, ["replicates"]),
    ("ceiling", aleator.ceiling, ["replicates"]),
    ("compare", aleator.compare, ["bootstrap"]),
    ("next", aleator.next_experiments, ["count", "repeat", "laws"]),
    ("posterior", aleator.posterior, ["draws", "chains"]),
    ("predict", aleator.Identification.probability, ["checks"]),
    ("predict", aleator.Identification.tolerance, ["side"]),
    ("recover", aleator.recover, ["replicates"]),
]


@pytest.mark.parametrize(("command", "function", "options"), TAKEN)
def test_a_command_has_the_defaults_of_its_function_and_its_help_tells_them(
    command: str, function: Callable[..., Any], options: list[str]
) -> None:
    one = main.get_command(click.Context(main), command)
    assert one is not None
    given = {parameter.name: parameter.default for parameter in one.params}
    shown = " ".join(done(command, "--help").output.split())
    for name in options:
        default = inspect.signature(function).parameters[name].default
        assert given[name] == default
        assert f"[default: {default}" in shown


# ------------------------------------------------------------------------------ identify


def test_identify_writes_and_prints_the_answer_which_the_seed_decides(study: Path) -> None:
    study.write_text(f"{SPRINGS}[[questions]]\ntolerance = [0.95, 0.9]\nat = {{load = 10}}\n")
    told = done("check", study, "--output", "checked", "--no-figures").stdout
    assert "1 question of the study" in told
    texts = []
    for folder in ("result", "again"):
        shown = done("identify", study, "--output", folder, "--seed", 5)
        document = read(f"{folder}/identification.json")
        del document["seconds"]
        texts.append(json.dumps(document))
        assert f"Written: {folder}/identification.json" in shown.stdout
        shown_again(shown, folder)
    assert texts[0] == texts[1]
    assert (document["title"], document["seed"]) == ("Springs", 5)
    assert document["study"]["file"] == "../springs/study.toml"
    assert set(document["alpha"]) == {"softness.mean", "softness.sd"}
    assert document["alpha"]["softness.mean"]["estimate"] == pytest.approx(1.02, abs=0.05)
    assert document["surface"]["estimates_error"] < 0.2
    assert [entry["id"] for entry in document["experiments"]] == [*"ABCDEFGH"]
    (answer,) = document["answers"]
    assert answer["at"] == {"load": 10.0}
    assert 5.0 < answer["lower"] < 10.0 * 1.02 < answer["upper"] < 15.0
    said = f"between {answer['lower']:.3g} and {answer['upper']:.3g}"
    assert said in shown.stdout
    briefly = done("show", "result", "--quiet").stdout
    assert 0 < briefly.index(said) < briefly.index("softness.mean")
    assert document["runs_by_stage"]["questions"] > 0
    assert "softness.mean" in shown.stdout
    assert "search ..." in shown.stderr
    assert Path("springs/runs.sqlite").exists()


COUNTED = """\
from pathlib import Path
calls = 0
def length(load, softness):
    global calls
    calls += 1
    Path({file!r}).write_text(str(calls))
    if calls == 20 and Path('stops').exists(): raise KeyboardInterrupt
    return load * softness
"""


@pytest.mark.usefixtures("unjudged_commands")
def test_completed_runs_survive_and_are_taken_up(study: Path) -> None:
    counter = Path("count.txt")
    study.with_name("model.py").write_text(COUNTED.format(file=str(counter.resolve())))
    done("identify", study, "--no-figures", "--output", "whole", "--no-store")
    assert not Path("springs/runs.sqlite").exists()
    calls = int(counter.read_text())
    Path("stops").touch()
    stopped = run("identify", study, "--no-figures", "--output", "result")
    assert stopped.exit_code == 130
    assert "aleator: stopped by Ctrl-C" in stopped.stderr
    # The first run was repeated, and a few of the others, to see whether they can be.
    kept = int(re.findall(r"springs/runs.sqlite keeps (\d+) new runs", stopped.stderr)[0])
    assert 19 - 8 <= kept <= 18
    assert "Traceback" not in stopped.output
    assert not Path("result/identification.json").exists()
    Path("stops").unlink()
    again = done("identify", study, "--no-figures", "--output", "result")
    assert f"springs/runs.sqlite has {kept} runs of this simulator" in again.stderr
    assert abs(int(counter.read_text()) - (calls - kept)) <= Repeatability().most
    # Resumed or not, the answer is the same, and so is the number of runs that it rests on.
    one, two = (read(f"{folder}/identification.json") for folder in ("whole", "result"))
    del one["seconds"], two["seconds"]
    assert one == two


@pytest.mark.usefixtures("unjudged_commands")
def test_the_store_may_lie_anywhere_or_nowhere(study: Path) -> None:
    study.write_text(SPRINGS.replace("[simulator]", '[simulator]\nstore = "kept/a.sqlite"'))
    Path("springs/kept").mkdir()
    for arguments, file in (((), "springs/kept/a.sqlite"), (("--store", "b.sqlite"), "b.sqlite")):
        done("identify", study, *QUICK, *arguments)
        assert Path(file).exists()
    assert not Path("springs/runs.sqlite").exists()
    assert "contradict" in refused("identify", study, "--no-store", "--store", "b.sqlite")


def test_recover_at_a_given_law(study: Path) -> None:
    truth = ("--truth", "softness.mean=1.1", "--truth", "softness.sd=0.05")
    options = ("--output", "out", "--workers", 1, "--replicates", 3)
    shown = done("recover", study, *truth, *options)
    assert "3 virtual data sets" in shown.stdout
    shown_again(shown, "out/recovery.json")
    found = read("out/recovery.json")["hyperparameters"]["softness.mean"]
    assert found["truth"] == 1.1
    assert found["mean"] == pytest.approx(1.1, abs=0.06)
    for wrong, name in (("mena=1", "'softness.mean'"), ("mean", "''"), ("mean=high", "'high'")):
        assert name in refused("recover", study, "--truth", f"softness.{wrong}")


# ------------------------------------------------------------------------------ predict


@pytest.mark.usefixtures("unjudged_commands")
def test_predict_prints_or_writes_and_finds_a_study_that_was_moved_or_changed(study: Path) -> None:
    done("identify", study, "--output", "result", *QUICK)
    Path("new.csv").write_text("id,load\nten,10\ntwenty,20\n")
    asked = ("predict", "result/identification.json", "--at", "new.csv")
    shown = done(*asked)
    assert "Predicted distribution of length" in shown.stdout
    assert "twenty" in shown.stdout
    assert done("predict", "result", *asked[2:]).stdout == shown.stdout
    done(*asked, "--output", "p.json")
    assert done("show", "p.json").stdout == shown.stdout
    assert done(*asked, "--output", "p.csv", "--quiet").output == "Written: p.csv\n"
    table = pd.read_csv("p.csv")
    mean = estimate("softness.mean", "result/identification.json")
    assert table["id"].tolist() == ["ten", "twenty"]
    assert table["load"].tolist() == [10, 20]
    assert table["mean"].to_numpy() == pytest.approx([10 * mean, 20 * mean], rel=0.02)
    assert (table["q0.025"] < table["q0.5"]).all()
    study.parent.rename("moved")
    assert "--study" in refused(*asked)
    moved = Path("moved/study.toml")
    assert "has changed" not in done(*asked, "--study", moved).stderr
    moved.write_text(SPRINGS + "\n")
    assert "moved/study.toml has changed since" in done(*asked, "--study", moved).stderr


@pytest.mark.usefixtures("unjudged_commands")
def test_a_table_of_predictions_is_replaced_but_not_silently(study: Path) -> None:
    done("identify", study, "--output", "out", *QUICK)
    Path("new.csv").write_text("id,load\nE,5\nF,6\n")
    given = ("predict", "out/identification.json", "--at", "new.csv", "--no-uncertainty")
    for name in ("told.csv", "told.json"):
        first, second = (done(*given, "--output", name).stderr for _ in range(2))
        assert "will be replaced" not in first
        assert f"{name} of" in second
    Path("told.json").write_text(json.dumps({"study": {"file": "other.toml"}}))
    refused(*given, "--output", "told.json")


ANSWERS = {
    "check.json": ("check",),
    "sensitivity.json": ("sensitivity",),
    "box.json": ("box",),
    "identification.json": ("identify",),
    "ceiling.json": ("ceiling",),
    "bootstrap.json": ("bootstrap",),
    "posterior.json": ("posterior",),
    "recovery.json": ("recover",),
    "next.json": ("next", "--candidates", "springs/springs.csv", "--count", "1"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_the_answer_of_another_study_is_not_replaced(study: Path, name: str) -> None:
    if name == "posterior.json":
        pytest.importorskip("mici")
    older = Path("out") / name
    older.parent.mkdir()
    older.write_text(json.dumps({"study": {"file": "../other.toml"}}))
    command, *options = ANSWERS[name]
    assert "another study" in refused(command, study, *options, "--output", "out")
    assert read(older) == {"study": {"file": "../other.toml"}}


# ------------------------------------------------------------------------------ places

MOVING = """\
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


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("unjudged_commands")
@pytest.mark.parametrize("imported", ["", "os.chdir('/')"])
def test_results_and_runs_lie_where_they_are_asked_for(
    study: Path, tmp_path: Path, imported: str
) -> None:
    study.with_name("model.py").write_text(MOVING.replace("IMPORTED", imported))
    study.with_name("elsewhere").mkdir()
    before = files(tmp_path)
    done("identify", study, "--output", "results", "--store", "kept.sqlite", *QUICK)
    assert Path.cwd() == tmp_path
    assert files(tmp_path) - before == {"results/identification.json", "kept.sqlite"}
    Path("new.csv").write_text("load\n2\n")
    law = ("results/identification.json", "--at", "new.csv", "--output", "lengths.csv")
    done("predict", *law, "--quiet")
    assert {"lengths.csv", "springs/runs.sqlite"} <= files(tmp_path)
    assert files(tmp_path / "springs" / "elsewhere") == set()


def test_a_hook_moves_no_run(study: Path, tmp_path: Path) -> None:
    study.with_name("hook.py").write_text(HOOK)
    study.with_name("t.txt").write_text("{softness}")
    study.with_name("elsewhere").mkdir()
    text = SPRINGS.replace('function = "model.py:length"\nvectorized = false', COMMAND)
    study.write_text(text.replace('"length"', '"length"\nconditions = []', 1))
    done("box", study, "--output", "found")
    made = files(tmp_path)
    assert {"found/box.json", "springs/runs.sqlite"} <= made
    assert any(name.startswith("springs/completed_runs/") for name in made)
    assert files(tmp_path / "springs" / "elsewhere") == set()


# ------------------------------------------------------------------------------ misuse


def changed(name: str, old: str, new: str) -> Callable[[Path], object]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def model(new: str) -> Callable[[Path], object]:
    return changed("model.py", "load * softness", new)


# One of each kind; the tables of what is wrong with a file are with the file's own tests.
WRONG: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "a cell": (changed("springs.csv", "2.1", "long"), ["springs.csv: line 3, column 'length'"]),
    "a bound": (changed("springs.csv", "3.2", "> 20"), ["line 4", "'> 20'", "signs = true"]),
    "a formula without end": (
        changed("study.toml", "sd = {", f'mean = "{"1 + " * 1000}1"\nsd = {{'),
        ["study.toml: key 'parameters'", "softness.mean"],
    ),
    "a store that no file can be": (
        changed("study.toml", "[parameters", f'store = "{"a" * 10_000}"\n[parameters'),
        ["aaa"],
    ),
    "not importable": (model("load * softness\n1 / 0"), ["ZeroDivisionError", "model.py, line 3"]),
    "raises": (
        model("load * softness if load < 3 else [][1]"),
        ["experiment 'C'", "softness=", "IndexError: list index out of range (model.py, line 2)"],
    ),
    "returns NaN": (
        model("load * softness if softness < 1 else float('nan')"),
        ["experiment '", "softness=", "nan"],
    ),
    "out of reach": (changed("springs.csv", "3.2", "9.9"), ["C", "9.9", "noise"]),
    "too few experiments": (
        lambda folder: (folder / "springs.csv").write_text("load,length\n1,1.1\n"),
        ["1 experiments", "2 hyperparameters"],
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_input_is_one_message_with_place_cause_and_remedy(study: Path, case: str) -> None:
    change, names = WRONG[case]
    change(study.parent)
    said = refused("identify", study, "--quiet", "--output", "out")
    assert "Remedy: " in said
    assert [name for name in names if name not in said] == []
    assert not Path("out/identification.json").exists()


def test_the_program_itself_prints_no_traceback(study: Path) -> None:
    WRONG["a cell"][0](study.parent)
    command = [sys.executable, "-m", "aleator", "identify", str(study)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("aleator: error: springs/springs.csv: line 3")
    assert "Traceback" not in ended.stderr


ESTIMATE = dict.fromkeys(("standard_error", "sandwich_error", "interval", "at_bound"))
ALPHA = {"softness.mean": 1.0, "softness.sd": 0.1}
DOCUMENT = json.dumps(
    result(
        alpha={k: {**ESTIMATE, "fixed": False, "estimate": at} for k, at in ALPHA.items()},
        correlation={"names": [], "matrix": []},
        study={"file": "springs/study.toml"},
    )
)
LAWS = {
    "law.json": DOCUMENT,
    "lost.json": DOCUMENT.replace("study.toml", "gone.toml"),
    "other.json": DOCUMENT.replace("softness", "stiffness"),
}
PREDICTIONS = {
    "no identification": ("none.json", "law\n", "none.json"),
    "not an identification": ("springs/study.toml", "law\n", "study.toml"),
    "unknown condition": ("law.json", "laod\n1\n", "'laod'"),
    "text": ("law.json", "load\nhigh\n", "new.csv: line 2, column 'load'"),
    "empty": ("law.json", "", "new.csv"),
    "no study": ("lost.json", "load\n1\n", "--study"),
    "another law": ("other.json", "load\n1\n", "softness"),
}


@pytest.mark.parametrize("case", PREDICTIONS)
@pytest.mark.usefixtures("study")
def test_bad_predictions_are_one_message(case: str) -> None:
    law, text, name = PREDICTIONS[case]
    for file, document in LAWS.items():
        Path(file).write_text(document)
    Path("new.csv").write_text(text)
    assert name in refused("predict", law, "--at", "new.csv", "--quiet")


DAMAGED = [
    "[" * 100_000,
    '{"alpha": ' + "[" * 100_000,
    *(
        DOCUMENT.replace('"softness.sd": {', f'"softness.sd": {entry}, "other": {{')
        for entry in ("1", "[]", "{}")
    ),
    *(
        DOCUMENT.replace('"estimate": 0.1}', f'"estimate": {value}}}')
        for value in ("1e300", "1" + "0" * 400, "NaN", "-0.1", "true", '"0.1"')
    ),
    *(DOCUMENT.replace('{"file": "springs/study.toml"}', entry) for entry in ("[1]", "null")),
    *(DOCUMENT.replace("study.toml", name) for name in ("a" * 10_000, "\\u0000", "\\ud800")),
]


@pytest.mark.usefixtures("unjudged_commands")
def test_a_quiet_identification_is_its_estimates_and_both_verdicts(study: Path) -> None:
    quiet = done("identify", study, "--output", "out", *QUICK)
    assert quiet.stderr == ""
    rows = quiet.stdout.splitlines()
    assert [row.split()[0] for row in rows if row.startswith("softness")] == [
        "softness.mean", "softness.sd",
    ]  # fmt: skip
    assert "omputed soundly" in rows[-2]
    assert "consistent" in rows[-1]
    assert len(rows) == 6  # a head, a line, two estimates, two verdicts
    assert done("show", "out", "--quiet").stdout == quiet.stdout
    whole, details = (done("show", "out", *options).stdout for options in ((), ("--details",)))
    assert len(details) > len(whole) > len(quiet.stdout)


def damaged(path: str, **entries: object) -> Path:
    Path("damaged.json").write_text(json.dumps({**read(path), **entries}))
    return Path("damaged.json")


def test_what_is_no_answer_is_not_shown(study: Path) -> None:
    done("check", study, "--output", "out", "--no-figures", "--quiet")
    assert "check" in refused("show", damaged("out/check.json", cost=[3]))
    assert "check" in refused("show", damaged("out/check.json", parameters=[{"name": 1}]))
    Path("other.json").write_text('{"rows": []}')
    for name in ("other.json", study, "nowhere.json", "springs"):
        refused("show", name)
    done("show", "out")
    Path("other.json").rename("out/other.json")
    said = refused("show", "out")
    assert "out/check.json" in said
    assert "out/other.json" in said


@pytest.mark.usefixtures("study")
def test_a_damaged_identification_is_one_message() -> None:
    Path("new.csv").write_text("load\n1\n")
    for document in DAMAGED:
        assert document != DOCUMENT
        Path("law.json").write_text(document)
        refused("predict", "law.json", "--at", "new.csv", "--quiet")


@pytest.mark.usefixtures("study")
def test_a_name_that_no_file_can_have_is_one_message() -> None:
    for words in (
        "identify ?",
        "identify springs/study.toml --output ?",
        "identify springs/study.toml --store ?",
        "predict ? --at new.csv",
        "runs list ?",
        "runs export springs/study.toml ?.csv",
        f"runs show springs/study.toml 1{'0' * 30}",
    ):
        refused(*words.replace("?", "a" * 10_000).split())
