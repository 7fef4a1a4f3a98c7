"""`aleator predict` with --above, --tolerance and so on."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result
from scipy import stats

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
