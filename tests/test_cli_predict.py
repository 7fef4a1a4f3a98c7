"""`aleator predict`: probabilities, limits and design values, and what it says beside them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result
from scipy import stats

from aleator import cli
from aleator.cli.program import main

MODEL = "def stretch(load, softness):\n    return load * softness\n"
STUDY = """
[experiments]
file = "springs.csv"
outcome = "travel"

[simulator]
function = "model.py:stretch"
vectorized = true

[parameters.softness]
law = "normal"
mean = {lower = 0.5, upper = 1.5}
sd = {lower = 0.01, upper = 0.5}

[noise]
sd = 0.05

[verification]
samples = 0
"""
LAW = "out/identification.json"


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, [*arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("springs")
    rng = np.random.default_rng(4)
    load = np.linspace(1.0, 3.0, 40)
    travel = load * (1.0 + 0.1 * rng.normal(size=40)) + 0.05 * rng.normal(size=40)
    pd.DataFrame({"load": load, "travel": travel}).to_csv(folder / "springs.csv", index=False)
    new = pd.DataFrame({"id": ["near", "far"], "load": [2.0, 6.0]})
    new.to_csv(folder / "new.csv", index=False)
    new.head(1).to_csv(folder / "near.csv", index=False)
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = run("identify", "study.toml", "--output", "out", "--no-figures")
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def asked(*options: str, to: str = "p.csv", of: str = "near.csv") -> Result:
    done = run("predict", LAW, "--conditions", of, "--output", to, *options)
    assert done.exit_code == 0, done.output
    return done


def alpha() -> dict[str, float]:
    entries = json.loads(Path(LAW).read_text())["alpha"]
    return {name: entry["estimate"] for name, entry in entries.items()}


def test_the_probability_of_the_true_value_is_the_normal_tail() -> None:
    law = alpha()
    limit = 2.0 * (law["softness.mean"] + 4.0 * law["softness.sd"])
    asked("--above", str(limit), "--no-noise", "--no-uncertainty", "--quiet")
    table = pd.read_csv("p.csv")
    assert table.loc[0, "probability"] == pytest.approx(stats.norm.sf(4.0), rel=0.1)
    assert table["lower"].isna().all()
    asked("--above", str(limit), "--no-noise", "--quiet")
    row = pd.read_csv("p.csv").iloc[0]
    assert row["lower"] < row["at_estimate"] < row["probability"] < row["upper"]
    assert row["at_estimate"] == pytest.approx(stats.norm.sf(4.0), rel=0.1)


def test_what_is_beyond_the_tested_conditions_is_told() -> None:
    done = asked("--between", "1.5", "2.5", to="p.json", of="new.csv")
    document = json.loads(Path("p.json").read_text())
    assert [row["id"] for row in document["rows"]] == ["near", "far"]
    assert document["rows"][1]["beyond"] == pytest.approx(1.5)
    assert "load is 1.5 tested ranges above the highest" in done.stderr
    assert "near" not in done.stderr


def test_limits_and_design_values() -> None:
    law = alpha()
    sd = np.hypot(2.0 * law["softness.sd"], 0.05)
    asked("--tolerance", "0.95", "0.95", "--quiet")
    row = pd.read_csv("p.csv").iloc[0]
    for end, side in (("lower", -1.0), ("upper", 1.0)):
        factor = side * (row[end] - 2.0 * law["softness.mean"]) / sd
        assert 2.1 < factor < 2.8
    values = []
    for side in ("upper", "lower"):
        asked("--reliability", "0.999", "--confidence", "0.5", "--side", side, "--quiet")
        values.append(pd.read_csv("p.csv").loc[0, side])
    assert values == pytest.approx(
        2.0 * law["softness.mean"] + sd * np.array([3.09, -3.09]), abs=0.15 * sd
    )


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (["--above", "1", "--below", "2"], "--above"),
        (["--between", "2", "1"], "between"),
        (["--tolerance", "1.5", "0.9"], "1.5"),
        (["--reliability", "0.9", "--confidence", "0"], "confidence"),
    ],
)
def test_what_cannot_be_asked_is_one_message(options: list[str], name: str) -> None:
    done = run("predict", LAW, "--conditions", "new.csv", "--quiet", *options)
    assert done.exit_code == 2, done.output
    assert done.stderr.count("aleator: error: ") == 1
    assert name in done.stderr


CLOCK_STUDY = """
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:travel"
[parameters.softness]
law = "truncated_normal"
box = [0.2, 0.9]
"""
CLOCK = (
    "def travel(force, softness):\n    return force * softness + 0.01 * force**2 * softness**2\n"
)
SOFTNESS = (0.41, 0.55, 0.48, 0.52, 0.46, 0.5, 0.58, 0.44, 0.53, 0.49, 0.47, 0.51)


def ran(*arguments: str) -> Result:
    result = CliRunner().invoke(cli.main, list(arguments))
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture
def identified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rows = [(10.0 * (1 + k % 3), s) for k, s in enumerate(SOFTNESS)]
    lines = [f"{f},{f * s + 0.01 * (f * s) ** 2}" for f, s in rows]
    (tmp_path / "springs.csv").write_text("\n".join(["force,travel", *lines]) + "\n")
    (tmp_path / "model.py").write_text(CLOCK)
    (tmp_path / "study.toml").write_text(CLOCK_STUDY)
    (tmp_path / "new.csv").write_text("force\n15\n25\n")
    monkeypatch.chdir(tmp_path)
    ran("identify", "study.toml", "--no-verify", "--no-figures", "--quiet", "--output", "found")
    return tmp_path / "found/identification.json"


def test_runs_are_told_before_they_are_made_and_counted_after(identified: Path) -> None:
    made = json.loads(identified.read_text())["surface"]
    arguments = ("predict", str(identified), "--conditions", "new.csv")
    first = ran(*arguments).stderr
    each = re.search(r"each of 2 new conditions: (\d+) runs each", first)
    assert each is not None
    assert int(each[1]) == round(made["runs"] / made["experiments"])
    counted = re.search(r"(\d+) runs of the simulator were made", first)
    assert counted is not None
    with_all = ran("runs", "list", "study.toml").stdout
    assert f"{json.loads(identified.read_text())['runs'] + int(counted[1])}" in with_all
    assert "were made" not in ran(*arguments).stderr
    assert "new conditions" not in ran(*arguments, "--quiet").stderr
