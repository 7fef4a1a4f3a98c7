"""`aleator predict` says what its surfaces will cost, and what they did."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from aleator import cli

STUDY = """
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:travel"
[parameters.softness]
law = "truncated_normal"
box = [0.2, 0.9]
"""
MODEL = (
    "def travel(force, softness):\n    return force * softness + 0.01 * force**2 * softness**2\n"
)
SOFTNESS = (0.41, 0.55, 0.48, 0.52, 0.46, 0.5, 0.58, 0.44, 0.53, 0.49, 0.47, 0.51)


def run(*arguments: str) -> Result:
    result = CliRunner().invoke(cli.main, list(arguments))
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture
def identified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rows = [(10.0 * (1 + k % 3), s) for k, s in enumerate(SOFTNESS)]
    lines = [f"{f},{f * s + 0.01 * (f * s) ** 2}" for f, s in rows]
    (tmp_path / "springs.csv").write_text("\n".join(["force,travel", *lines]) + "\n")
    (tmp_path / "model.py").write_text(MODEL)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "new.csv").write_text("force\n15\n25\n")
    monkeypatch.chdir(tmp_path)
    run("identify", "study.toml", "--no-verify", "--no-figures", "--quiet", "--output", "found")
    return tmp_path / "found/identification.json"


def test_runs_are_told_before_they_are_made_and_counted_after(identified: Path) -> None:
    made = json.loads(identified.read_text())["surface"]
    arguments = ("predict", str(identified), "--conditions", "new.csv")
    first = run(*arguments).stderr
    each = re.search(r"each of 2 new conditions: (\d+) runs each", first)
    assert each is not None
    assert int(each[1]) == round(made["runs"] / made["experiments"])
    counted = re.search(r"(\d+) runs of the simulator were made", first)
    assert counted is not None
    with_all = run("runs", "list", "study.toml").stdout
    assert f"{json.loads(identified.read_text())['runs'] + int(counted[1])}" in with_all
    assert "were made" not in run(*arguments).stderr
    assert "new conditions" not in run(*arguments, "--quiet").stderr
