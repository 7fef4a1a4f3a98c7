"""aleator sensitivity: the tables, the files, and what is told when something is wrong."""

from __future__ import annotations

import importlib.util
import json
from importlib.machinery import ModuleSpec
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.views.figures import sensitivity_figure

STUDY = """\
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


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "springs"
    folder.mkdir()
    (folder / "springs.csv").write_text("id,load,length\nA,1,1.0\nB,2,2.0\nC,4,4.0\n")
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("springs/study.toml")


def test_it_prints_tables_and_writes_files(study: Path) -> None:
    done = run("sensitivity", study)
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


def test_the_figure_shows_what_the_document_says(study: Path) -> None:
    run("sensitivity", study, "--quiet")
    result = json.loads(Path("out/springs/sensitivity.json").read_text())
    left, right = sensitivity_figure(result).axes
    widths = sorted(bar.get_width() for bars in left.containers for bar in bars)
    shares = [row[key] for row in result["parameters"] for key in ("mean_first", "mean_total")]
    assert widths == pytest.approx(sorted(shares))
    assert [label.get_text() for label in left.get_yticklabels()] == ["slack", "softness", "twist"]
    matrix = right.images[0].get_array()
    assert matrix is not None
    assert matrix[1, 2] == pytest.approx(1.0)  # softness and twist
    assert matrix[0, 1] == pytest.approx(7.0 / (3.0 * 21.0) ** 0.5)  # 1, 1, 1 and 1, 2, 4
    first = Path("out/springs/sensitivity.png").read_bytes()
    run("sensitivity", study, "--quiet")
    assert Path("out/springs/sensitivity.png").read_bytes() == first


def test_a_seed_and_options_are_obeyed(study: Path) -> None:
    arguments = ("--runs", 20, "--experiments", "C, A", "--no-figures", "--quiet", "--seed", 5)
    done = run("sensitivity", study, "--output", "one", *arguments)
    assert done.exit_code == 0
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    result = json.loads(Path("one/sensitivity.json").read_text())
    assert [row["id"] for row in result["experiments"]] == ["C", "A"]
    assert result["expansion"]["runs"] == 20
    assert result["seed"] == 5
    assert not Path("one/sensitivity.png").exists()
    run("sensitivity", study, "--output", "two", *arguments)
    assert Path("two/sensitivity.csv").read_bytes() == Path("one/sensitivity.csv").read_bytes()


def test_a_single_parameter_has_no_pairs(study: Path) -> None:
    text = STUDY[: STUDY.index("[parameters.slack]")]
    study.write_text(text)
    study.with_name("model.py").write_text("def length(load, softness): return load * softness\n")
    done = run("sensitivity", study)
    assert done.exit_code == 0, done.output
    assert "pair" not in done.stdout
    assert "100.0 %" in done.stdout


def test_rough_expansions_are_told(study: Path) -> None:
    rough = "import numpy as np\ndef length(load, softness, slack, twist):\n"
    rough += "    return np.floor(3 * softness * slack) % 2\n"
    study.with_name("model.py").write_text(rough)
    done = run("sensitivity", study, "--runs", 30)
    assert done.exit_code == 0, done.output
    assert "--runs 120" in done.stdout


def test_without_matplotlib_there_are_tables_all_the_same(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec

    def without(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name == "matplotlib" else found(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", without)
    done = run("sensitivity", study)
    assert done.exit_code == 0
    assert "matplotlib" in done.stderr
    assert Path("out/springs/sensitivity.csv").exists()
    assert not Path("out/springs/sensitivity.png").exists()


def test_an_unknown_experiment_is_told(study: Path) -> None:
    done = run("sensitivity", study, "--experiments", "A,D")
    assert done.exit_code == 2
    assert "'D'" in done.stderr
