"""`aleator check`, `sensitivity` and `next`: what is printed and written, and misuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.views.figures import check_figure

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:spring"
[parameters.stiffness]
law = "truncated_normal"
box = [2.0, 6.0]
[parameters.idle]
law = "constant"
value = {lower = 0, upper = 1}
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(a) for a in arguments])


@pytest.fixture
def check_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rows = ["id,force,travel", "A,10,4.9", "B,20,10.2", "C,30,15.4", "D,40,12", "E,50,8"]
    (tmp_path / "springs.csv").write_text("\n".join([*rows, ""]))
    (tmp_path / "model.py").write_text(
        "def spring(force, stiffness, idle):\n    return force / stiffness\n"
    )
    (tmp_path / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("study.toml")


def test_what_is_out_of_reach_idle_and_to_come_is_told(check_study: Path) -> None:
    done = run("check", check_study, "--output", "out")
    assert done.exit_code == 0, done.output
    result = json.loads(Path("out/check.json").read_text())
    assert result["out_of_reach"] == ["C", "E", "B"]
    assert [row["influence"] for row in result["parameters"]] == [True, False]
    assert result["runs"] == 5 * 13
    assert result["seconds_a_run"] > 0.0
    assert "65 runs: 13 points under 5 of 5" in done.stderr
    assert "aleator identify study.toml" in done.stdout
    figure = check_figure(result)
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_visible()]
    assert labels == ["stiffness", "idle"]
    assert len(figure.axes[0].lines) == 5
    assert Path("out/check.png").stat().st_size > 10_000


def test_its_runs_are_kept_and_none_is_made_twice(check_study: Path) -> None:
    assert run("check", check_study, "--output", "out", "--no-figures").exit_code == 0
    first = json.loads(Path("out/check.json").read_text())
    Path("model.py").touch()
    again = run("check", check_study, "--output", "out", "--no-figures", "--quiet")
    assert again.exit_code == 0
    assert "3 of 5 measured values are out of reach" in again.stdout
    second = json.loads(Path("out/check.json").read_text())
    assert second["observations"] == first["observations"]
    listed = run("runs", "list", check_study).output
    assert "65" in listed


SENSITIVITY_STUDY = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
[parameters.slack]
law = "constant"
value = {lower = 0.0, upper = 2.0}
[parameters.twist]
law = "constant"
value = {lower = 0.0, upper = 1.0}
"""
MODEL = "def length(load, softness, slack, twist): return load * (softness + 0.1 * twist) + slack\n"


def sensitivity(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "springs"
    folder.mkdir()
    (folder / "springs.csv").write_text("id,load,length\nA,1,1.0\nB,2,2.0\nC,4,4.0\n")
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(SENSITIVITY_STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("springs/study.toml")


def test_it_prints_tables_and_writes_files(study: Path) -> None:
    done = sensitivity("sensitivity", study)
    assert done.exit_code == 0, done.output
    assert "Springs" in done.stdout
    assert "softness, twist" in done.stdout  # both act in proportion to the load
    result = json.loads(Path("out/springs/sensitivity.json").read_text())
    assert [row["parameter"] for row in result["parameters"]] == ["slack", "softness", "twist"]
    assert result["study"]["outcome"] == "length"
    assert result["runs"] == 3 * result["expansion"]["runs"]
    # variances load^2/12, 4/12, load^2/1200
    first = {row["id"]: row["first"] for row in result["experiments"]}
    assert first["A"]["softness"] == pytest.approx(1.0 / (1.0 + 4.0 + 0.01))
    assert first["C"]["slack"] == pytest.approx(4.0 / (16.0 + 4.0 + 0.16))
    table = pd.read_csv("out/springs/sensitivity.csv")
    assert len(table) == 9
    assert table["first"].sum() == pytest.approx(3.0)
    assert Path("out/springs/sensitivity.png").stat().st_size > 10_000
    for file in ("json", "csv", "png"):
        assert f"sensitivity.{file}" in done.stdout


def test_a_seed_and_options_are_obeyed(study: Path) -> None:
    arguments = ("--runs", 20, "--experiments", "C, A", "--no-figures", "--quiet", "--seed", 5)
    done = sensitivity("sensitivity", study, "--output", "one", *arguments)
    assert done.exit_code == 0
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    result = json.loads(Path("one/sensitivity.json").read_text())
    assert [row["id"] for row in result["experiments"]] == ["C", "A"]
    assert result["expansion"]["runs"] == 20
    assert result["seed"] == 5
    assert not Path("one/sensitivity.png").exists()
    sensitivity("sensitivity", study, "--output", "two", *arguments)
    assert Path("two/sensitivity.csv").read_bytes() == Path("one/sensitivity.csv").read_bytes()


def test_an_unknown_experiment_is_told(study: Path) -> None:
    done = sensitivity("sensitivity", study, "--experiments", "A,D")
    assert done.exit_code == 2
    assert "'D'" in done.stderr


NEXT_STUDY = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "normal"
mean = {lower = 0.2, upper = 3.0}
sd = {lower = 0.001, upper = 1.0}
[noise]
sd = 0.1
"""
NEXT_MODEL = "def length(load, softness): return load * softness\n"


def next_run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, ["next", *(str(argument) for argument in arguments)])


@pytest.fixture
def next_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rng = np.random.default_rng(3)
    load = np.tile([1.0, 2.0, 3.0], 8)
    length = load * (1.0 + 0.15 * rng.standard_normal(24)) + 0.1 * rng.standard_normal(24)
    pd.DataFrame({"load": load, "length": length}).to_csv(tmp_path / "springs.csv", index=False)
    (tmp_path / "model.py").write_text(NEXT_MODEL)
    (tmp_path / "study.toml").write_text(NEXT_STUDY)
    (tmp_path / "new.csv").write_text("id,load\nA,0.5\nB,1\nC,6\n")
    (tmp_path / "use.csv").write_text("id,load\nuse,5\n")
    monkeypatch.chdir(tmp_path)
    return Path("study.toml")


def test_next_prints_tables_and_writes_files(next_study: Path) -> None:
    done = next_run(next_study, "--candidates", "new.csv", "--count", 2, "--output", "out")
    assert done.exit_code == 0, done.output
    assert "softness.sd" in done.stdout
    result = json.loads(Path("out/next.json").read_text())
    assert [row["id"] for row in result["candidates"]] == ["C", "B", "A"]
    assert [row["id"] for row in result["chosen"]] == ["C", "B"]
    table = pd.read_csv("out/next.csv", index_col="id")
    assert table.loc["C", "standard_error"] < table.loc["A", "standard_error"]


def test_a_prediction_is_asked_about_in_one_line(next_study: Path) -> None:
    given = ("--candidates", "new.csv", "--count", 4, "--repeat", 4, "--quiet")
    done = next_run(next_study, *given, "--for-prediction", "use.csv", "--above", 6)
    assert done.exit_code == 0, done.output
    assert done.stdout.count("\n") == 1
    assert "4 experiments" in done.stdout


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("--count", "4"), "4 experiments of 3 candidates"),
        (("--for", "softness.s"), "did you mean"),
        (("--for", "noise.sd"), "is fixed"),
        (("--above", "6"), "--for-prediction"),
        (("--for", "all", "--for-prediction", "use.csv"), "contradict"),
        (("--for-prediction", "use.csv", "--above", "1", "--below", "2"), "below and above"),
    ],
)
def test_misuse_is_told_before_anything_is_run(
    next_study: Path, given: tuple[str, ...], told: str
) -> None:
    done = next_run(next_study, "--candidates", "new.csv", "--count", "2", *given)
    assert done.exit_code == 2
    assert told in done.output
    assert not Path("runs.sqlite").exists()
