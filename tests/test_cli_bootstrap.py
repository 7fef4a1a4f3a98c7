"""`aleator bootstrap` from a study to a report, a document and a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator.cli import main

STUDY = """
title = "Levels"
[experiments]
file = "table.csv"
outcome = "y"
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
law = "normal"
mean = {lower = 0, upper = 5}
sd = {lower = 0, upper = 2}
[noise]
sd = 0.2
[verification]
samples = 0
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    y = np.random.default_rng(0).normal(2.0, 0.5, 30)
    pd.DataFrame({"y": y}).to_csv(tmp_path / "table.csv", index=False)
    (tmp_path / "model.py").write_text("def model(x):\n    return x\n")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def called(study: Path, *arguments: str) -> Result:
    output = str(study.parent / "out")
    return CliRunner().invoke(main, ["bootstrap", str(study), "--output", output, *arguments])


def test_replicates_are_told_and_written_and_gone_on_from(study: Path) -> None:
    result = called(study, "--replicates", "20", "--experiments")
    assert result.exit_code == 0, result.output
    assert "20 climbs arrived" in " ".join(result.output.split())
    out = study.parent / "out"
    document = json.loads((out / "bootstrap.json").read_text())
    row = document["hyperparameters"]["x.mean"]
    assert row["standard_error"] == pytest.approx(0.1, rel=0.5)
    assert document["statuses"] == {"arrived": 20}
    first = pd.read_csv(out / "bootstrap.csv")
    assert called(study, "--replicates", "22", "--experiments", "--quiet").exit_code == 0
    assert pd.read_csv(out / "bootstrap.csv").iloc[:20].equals(first)


def test_another_kind_in_the_same_folder_is_refused(study: Path) -> None:
    assert called(study, "--replicates", "2", "--quiet").output.count("\n") == 1
    result = called(study, "--replicates", "2", "--experiments")
    assert result.exit_code == 2
    assert "bootstrap.jsonl: its replicates are those of another study, seed or kind" in (
        result.output
    )
