"""aleator next: the tables, the files, and what is told when something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
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
law = "normal"
mean = {lower = 0.2, upper = 3.0}
sd = {lower = 0.001, upper = 1.0}
[noise]
sd = 0.1
"""
MODEL = "def length(load, softness): return load * softness\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, ["next", *(str(argument) for argument in arguments)])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rng = np.random.default_rng(3)
    load = np.tile([1.0, 2.0, 3.0], 8)
    length = load * (1.0 + 0.15 * rng.standard_normal(24)) + 0.1 * rng.standard_normal(24)
    pd.DataFrame({"load": load, "length": length}).to_csv(tmp_path / "springs.csv", index=False)
    (tmp_path / "model.py").write_text(MODEL)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "new.csv").write_text("id,load\nA,0.5\nB,1\nC,6\n")
    (tmp_path / "use.csv").write_text("id,load\nuse,5\n")
    monkeypatch.chdir(tmp_path)
    return Path("study.toml")


def test_it_prints_tables_and_writes_files(study: Path) -> None:
    done = run(study, "--candidates", "new.csv", "--count", 2, "--output", "out")
    assert done.exit_code == 0, done.output
    assert "softness.sd" in done.stdout
    result = json.loads(Path("out/next.json").read_text())
    assert [row["id"] for row in result["candidates"]] == ["C", "B", "A"]
    assert [row["id"] for row in result["chosen"]] == ["C", "B"]
    table = pd.read_csv("out/next.csv", index_col="id")
    assert table.loc["C", "standard_error"] < table.loc["A", "standard_error"]


def test_a_prediction_is_asked_about_in_one_line(study: Path) -> None:
    given = ("--candidates", "new.csv", "--count", 4, "--repeat", 4, "--quiet")
    done = run(study, *given, "--for-prediction", "use.csv", "--above", 6)
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
    study: Path, given: tuple[str, ...], told: str
) -> None:
    done = run(study, "--candidates", "new.csv", "--count", "2", *given)
    assert done.exit_code == 2
    assert told in done.output
    assert not Path("runs.sqlite").exists()
