"""Commands on a study with series, two responses, censored values and a covariate."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli

STUDY = """\
title = "Plants"
[experiments]
file = "plants.csv"
id = "plant"
outcomes = ["height", "mass"]
conditions = ["time"]
transform = {mass = "log"}
censored = {height = {column = "status", right = "Cut"}}
[simulator]
function = "model.py:growth"
[parameters.rate]
law = "normal"
mean = {formula = "1 + light", lower = 0.1, upper = 4}
sd = {lower = 0.01, upper = 1}
[parameters.density]
law = "lognormal"
mean = {lower = 0.2, upper = 5}
sd = {lower = 0.01, upper = 2}
[noise.height]
sd = {lower = 0.01, upper = 1}
[noise.mass]
sd = 0.1
[search]
starts = 1
"""
MODEL = """\
def growth(time, rate, density):
    height = rate * time
    return {"height": height, "mass": density * height}
"""
IDENTIFIED = "out/identification.json"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


def plants() -> pd.DataFrame:
    rng = np.random.default_rng(5)
    rows = []
    for l in range(10):
        light = float(l % 2)
        rate, density = 1.0 + 0.5 * light + 0.2 * rng.normal(), np.exp(0.3 * rng.normal())
        for time in (1.0, 2.0, 4.0):
            height = rate * time
            seen = height + 0.1 * rng.normal()
            cut = seen > 5.0
            rows.append(
                {
                    "plant": f"p{l}", "time": time, "light": light, "height": min(seen, 5.0),
                    "status": "Cut" if cut else "",
                    "mass": density * height * np.exp(0.1 * rng.normal()),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that has been identified."""
    folder = tmp_path_factory.mktemp("plants")
    plants().to_csv(folder / "plants.csv", index=False)
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY)
    pd.DataFrame(
        {"plant": ["a", "a", "b"], "time": [1.0, 3.0, 3.0], "light": [1.0, 1.0, 0.0],
         "like": ["p3", "p3", "p2"]}
    ).to_csv(folder / "new.csv", index=False)  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = run("identify", "study.toml", "--output", "out", "--no-figures")
    assert done.exit_code == 0, done.output
    (folder / "report.txt").write_text(done.stdout)
    return folder


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def predicted(*options: str) -> pd.DataFrame:
    done = run("predict", IDENTIFIED, "--conditions", "new.csv", "--output", "p.csv", "--quiet",
               *options)  # fmt: skip
    assert done.exit_code == 0, done.output
    return pd.read_csv("p.csv")


def test_predictions_are_of_each_row_and_response() -> None:
    table = predicted("--no-uncertainty")
    alpha = json.loads(Path(IDENTIFIED).read_text())["alpha"]
    assert table["id"].tolist() == ["a", "a", "a", "a", "b", "b"]
    assert table["response"].tolist() == ["height", "mass"] * 3
    assert table["time"].tolist() == [1.0, 1.0, 3.0, 3.0, 3.0, 3.0]
    value = {name: entry["estimate"] for name, entry in alpha.items()}
    light = np.array([1.0, 1.0, 0.0])
    rate = value["rate.mean[Intercept]"] + value["rate.mean[light]"] * light
    heights = table[table["response"] == "height"]
    assert heights["mean"].to_numpy() == pytest.approx(rate * [1.0, 3.0, 3.0], rel=2e-3)
    sd = np.hypot(value["rate.sd"] * np.array([1.0, 3.0, 3.0]), value["noise.height.sd"])
    assert heights["standard_deviation"].to_numpy() == pytest.approx(sd, rel=5e-3)


def test_a_measured_experiment_is_predicted_better_and_without_noise_still_better() -> None:
    new, old = predicted(), predicted("--of", "like")
    mean = predicted("--of", "like", "--no-noise")
    spreads = [table["standard_deviation"].to_numpy() for table in (new, old, mean)]
    assert np.all(spreads[1] < spreads[0])
    assert np.all(spreads[2] < spreads[1])
    one = predicted("--of", "p3")
    assert one.loc[:3, "mean"].to_numpy() == pytest.approx(old.loc[:3, "mean"].to_numpy())


def test_an_unknown_experiment_and_a_missing_covariate_are_told() -> None:
    unknown = run("predict", IDENTIFIED, "--conditions", "new.csv", "--of", "p33", "--quiet")
    assert unknown.exit_code == 2
    assert "p33" in unknown.output
    Path("dark.csv").write_text("plant,time\na,1\n")
    dark = run("predict", IDENTIFIED, "--conditions", "dark.csv", "--quiet")
    assert dark.exit_code == 2
    assert "light" in dark.output


def test_the_sensitivity_of_each_value_is_told() -> None:
    done = run("sensitivity", "study.toml", "--output", "s", "--quiet", "--no-figures",
               "--experiments", "p1")  # fmt: skip
    assert done.exit_code == 0, done.output
    told = pd.read_csv("s/sensitivity.csv")
    assert set(told["experiment"]) == {
        f"p1, row {row}, {response}" for row in (1, 2, 3) for response in ("height", "mass")
    }
    height = told[told["experiment"].str.endswith("height")].set_index("parameter")
    assert height.loc["rate", "total"].to_numpy() == pytest.approx(1.0)


def test_the_box_is_found() -> None:
    done = run("box", "study.toml", "--output", "b", "--quiet")
    assert done.exit_code == 0, done.output
