"""Bad input through the command line: exit code 2, one message with place and remedy."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from reports import result

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
mean = {lower = 0.6, upper = 1.4}
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 1
"""
TABLE = "id,load,length\nA,1,0.93\nB,2,2.1\nC,3,3.2\nD,4,3.7\nE,5,5.4\n"
MODEL = "def length(load, softness):\n    return load * softness\n"

Change = Callable[[Path], None]


def edit(name: str, old: str, new: str) -> Change:
    def change(folder: Path) -> None:
        path = folder / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return change


def table(old: str, new: str) -> Change:
    return edit("springs.csv", old, new)


def study(old: str, new: str) -> Change:
    return edit("study.toml", old, new)


def model(new: str) -> Change:
    return edit("model.py", "load * softness", new)


def vectorized(new: str) -> Change:
    def change(folder: Path) -> None:
        study(':length"', ':length"\nvectorized = true')(folder)
        model(new)(folder)

    return change


CASES: dict[str, tuple[Change, list[str]]] = {
    "text": (table("2.1", "long"), ["springs.csv: row 3, column 'length'", "'long'"]),
    "text in a condition": (table("B,2", "B,two"), ["springs.csv: row 3, column 'load'", "'two'"]),
    "NaN": (table("3.2", "nan"), ["springs.csv: row 4, column 'length'", "'nan'"]),
    "blank": (table("3.2", ""), ["springs.csv: row 4, column 'length'"]),
    "blank id": (table("C,", ","), ["springs.csv: row 4, column 'id'"]),
    "more than": (
        table("3.2", "> 20"),
        ["springs.csv: row 4, column 'length'", "'> 20'", "signs = true", "biased"],
    ),
    "less than": (table("3.2", "<=0.5"), ["'<=0.5'", "signs = true", "biased"]),
    "a formula without end": (
        study("mean = {lower = 0.6, upper = 1.4}", f'mean = "{"1 + " * 1000}1"'),
        ["study.toml: key 'parameters'", "softness.mean", "4,001 characters"],
    ),
    "a store that no file can be": (
        study("[parameters", f'store = "{"a" * 10_000}"\n[parameters'),
        ["aaa"],
    ),
    "not importable": (
        model("load * softness\n1 / 0"),
        ["model.py", "ZeroDivisionError: division by zero (model.py, line 3)"],
    ),
    "raises": (
        model("load * softness if load < 3 else [][1]"),
        ["experiment 'C'", "softness=", "IndexError: list index out of range (model.py, line 2)"],
    ),
    "wrong shape": (vectorized("load[:1]"), ["shape (1,)", "vectorized = false"]),
    "scalar": (vectorized("1.0"), ["float", "vectorized = false"]),
    "an array a run": (model("[load]"), ["experiment 'A'", "(1,)"]),
    "nothing": (model("None"), ["experiment 'A'", "None"]),
    "returns NaN": (
        model("load * softness if softness < 1 else float('nan')"),
        ["experiment 'A'", "softness=", "nan"],
    ),
    "returns infinity": (
        model("float('inf')"),
        ["experiment 'A'", "softness=", "inf"],
    ),
    "unreachable outcome": (table("3.2", "9.9"), ["C", "9.9", "noise"]),
    "too few experiments": (
        lambda folder: (folder / "springs.csv").write_text("load,length\n1,1.1\n") and None,
        ["1 experiments", "2 hyperparameters"],
    ),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("study.toml", STUDY), ("springs.csv", TABLE), ("model.py", MODEL)):
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("change", "expected"), CASES.values(), ids=CASES)
def test_bad_input_is_one_message(folder: Path, change: Change, expected: list[str]) -> None:
    change(folder)
    done = CliRunner().invoke(main, ["identify", "study.toml", "--quiet", "--output", "out"])
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    assert done.stderr.count("aleator: error: ") == 1
    assert "Remedy: " in done.stderr
    for name in expected:
        assert name in done.stderr
    assert "Traceback" not in done.stderr
    assert not Path("out/identification.json").exists()


ESTIMATE = dict.fromkeys(("standard_error", "sandwich_error", "interval", "at_bound"))
ALPHA = {"softness.mean": 1.0, "softness.sd": 0.1}
DOCUMENT = json.dumps(
    result(
        alpha={k: {**ESTIMATE, "fixed": False, "estimate": at} for k, at in ALPHA.items()},
        correlation={"names": [], "matrix": []},
        study={"file": "study.toml"},
    )
)
PREDICTIONS = {
    "no identification": (["none.json"], "law\n", "none.json"),
    "not an identification": (["study.toml"], "law\n", "study.toml"),
    "unknown condition": (["law.json"], "laod\n1\n", "'laod'"),
    "text": (["law.json"], "load\nhigh\n", "new.csv: row 2, column 'load'"),
    "empty": (["law.json"], "", "new.csv"),
    "no study": (["lost.json"], "load\n1\n", "--study"),
    "another law": (["other.json"], "load\n1\n", "softness"),
}


@pytest.mark.parametrize(("arguments", "text", "name"), PREDICTIONS.values(), ids=PREDICTIONS)
def test_bad_predictions_are_one_message(
    folder: Path, arguments: list[str], text: str, name: str
) -> None:
    (folder / "law.json").write_text(DOCUMENT)
    (folder / "other.json").write_text(DOCUMENT.replace("softness.mean", "x"))
    (folder / "lost.json").write_text(DOCUMENT.replace("study.t", "s.t"))
    (folder / "new.csv").write_text(text)
    done = CliRunner().invoke(main, ["predict", *arguments, "--conditions", "new.csv", "--quiet"])
    assert done.exit_code == 2, done.output
    assert done.stderr.count("aleator: error: ") == 1
    assert name in done.stderr


DAMAGED = [
    "[" * 100_000,
    '{"alpha": ' + "[" * 100_000,
    *(
        DOCUMENT.replace('"softness.sd": {', f'"softness.sd": {entry}, "other": {{')
        for entry in ("1", "[]", "{}")
    ),
    *(
        DOCUMENT.replace('"estimate": 0.1}', f'"estimate": {value}}}')
        for value in ("1e300", "1" + "0" * 400, "1e400", "NaN", "-0.1", "0", "true", '"0.1"')
    ),
    *(DOCUMENT.replace('{"file": "study.toml"}', entry) for entry in ("[1]", "5", "null")),
    *(DOCUMENT.replace("study.toml", name) for name in ("a" * 10_000, "\\u0000", "\\ud800")),
]


@pytest.mark.parametrize("document", range(len(DAMAGED)))
def test_a_damaged_identification_is_one_message(folder: Path, document: int) -> None:
    (folder / "law.json").write_text(DAMAGED[document])
    (folder / "new.csv").write_text("load\n1\n")
    done = CliRunner().invoke(main, ["predict", "law.json", "--conditions", "new.csv", "--quiet"])
    assert done.exit_code == 2, done.output
    assert done.stderr.count("aleator: error: ") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["identify", "?"],
        ["identify", "study.toml", "--output", "?"],
        ["identify", "study.toml", "--store", "?"],
        ["predict", "?", "--conditions", "new.csv"],
        ["runs", "list", "?"],
        ["runs", "export", "study.toml", "?.csv"],
        ["runs", "show", "study.toml", "1" + "0" * 30],
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_name_that_no_file_can_have_is_one_message(arguments: list[str]) -> None:
    words = [word.replace("?", "a" * 10_000) for word in arguments]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2, done.output
    assert done.stderr.count("rror: ") == 1


def test_the_program_itself_prints_no_traceback(folder: Path) -> None:
    table("2.1", "long")(folder)
    command = [sys.executable, "-c", "from aleator.cli import main; main()", "identify"]
    done = subprocess.run([*command, "study.toml"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("aleator: error: springs.csv: row 3")
    assert "Traceback" not in done.stderr
