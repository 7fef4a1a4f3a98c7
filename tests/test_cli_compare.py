"""`aleator compare` from files to a report, a document and a figure."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator.cli import main

STUDY = """
[experiments]
file = "table.csv"
id = "unit"
outcome = "y"
{transform}
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
{law}
[noise]
sd = {{lower = 0.01, upper = 2}}
[verification]
samples = 0
"""
CONSTANT = 'law = "constant"\nvalue = {lower = 0, upper = 5}'
NORMAL = 'law = "normal"\nmean = {lower = 0, upper = 5}\nsd = {lower = 0, upper = 2}'


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    """Twelve units of three values about levels that differ, and three studies of them."""
    rng = np.random.default_rng(0)
    unit = np.repeat(np.arange(12), 3)
    y = rng.normal(2.0, 0.3, 12)[unit] + rng.normal(0.0, 0.1, 36)
    pd.DataFrame({"unit": unit, "y": y}).to_csv(tmp_path / "table.csv", index=False)
    (tmp_path / "model.py").write_text("def model(x):\n    return x\n")
    for name, law, transform in [
        ("alike", CONSTANT, ""), ("differing", NORMAL, ""), ("logged", NORMAL, 'transform = "log"')
    ]:  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(STUDY.format(law=law, transform=transform))
    return tmp_path


def called(folder: Path, *arguments: str) -> Result:
    paths = [str(folder / a) if a.endswith(".toml") else a for a in arguments]
    return CliRunner().invoke(main, ["compare", *paths, "--output", str(folder / "out")])


def test_two_models_are_compared(studies: Path) -> None:
    result = called(studies, "alike.toml", "differing.toml", "--bootstrap", "2")
    assert result.exit_code == 0, result.output
    document = json.loads((studies / "out" / "compare.json").read_text())
    best, other = document["models"]
    assert (best["name"], best["free"], best["of_law"]) == ("differing", 3, 2)
    assert other["difference"] < -3.0 * other["difference_error"]
    (ratio,) = document["nested"]
    assert ratio["p"] < 1e-4
    assert ratio["replicates"] == 2
    assert len(document["left_out"]) == document["experiments"] == 12
    assert "alike does worse by more than chance explains" in " ".join(result.output.split())
    assert max(map(len, result.output.splitlines()[:-2])) <= 80
    assert (studies / "out" / "compare.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("alike.toml",), "name two or more"),
        (("alike.toml", "alike.toml"), "another study is called 'alike' too"),
        (("differing.toml", "logged.toml"), "apart by the Jacobian"),
        (("alike.toml", "differing.toml", "--nested", "alike", "diferring"), "did you mean"),
    ],
    ids=["one", "twice", "transforms", "name"],
)
def test_misuse_is_one_message(studies: Path, arguments: tuple[str, ...], told: str) -> None:
    result = called(studies, *arguments)
    assert result.exit_code == 2
    assert told in result.output
    assert "Remedy:" in result.output
