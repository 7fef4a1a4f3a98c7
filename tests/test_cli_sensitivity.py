"""aleator sensitivity: the tables, the files, and what is told when something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli

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


def test_an_unknown_experiment_is_told(study: Path) -> None:
    done = run("sensitivity", study, "--experiments", "A,D")
    assert done.exit_code == 2
    assert "'D'" in done.stderr
