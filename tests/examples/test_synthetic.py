"""Studies of synthetic tables: the tables are those that the scripts draw of a known law."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, optimize, stats

from aleator import GradientMultistart, identify
from aleator.core.types import Array
from aleator.study import load_study

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
BATTERY = ROOT / "src" / "aleator" / "cli" / "battery"


@pytest.mark.parametrize(
    ("folder", "script", "table"),
    [
        (EXAMPLES / "braking", "make_stops.py", "stops.csv"),
        (BATTERY, "make_cells.py", "cells.csv"),
        (EXAMPLES / "servo_drive", "make_drives.py", "drives.csv"),
    ],
)
def test_the_script_prints_the_shipped_table(
    folder: Path,
    script: str,
    table: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "model", raising=False)
    runpy.run_path(str(folder / script), run_name="__main__")
    monkeypatch.delitem(sys.modules, "model")
    assert capsys.readouterr().out == (folder / table).read_text(encoding="utf-8")


def test_the_law_of_braking_distances_is_the_maximum_by_an_integral_of_a_few_lines() -> None:
    study = load_study(EXAMPLES / "braking" / "road.toml")
    found = identify(
        study.simulator, study.experiments, study.inputs, noise=study.noise,
        search=GradientMultistart(2), consistency=False, best_law=False,
    )  # fmt: skip
    table = study.experiments.table
    v = table["speed"].to_numpy(dtype=float)[:, None] / 3.6
    wet = (table["road"] == "wet").to_numpy()
    friction = np.linspace(0.2, 1.2, 4001)
    measured = study.experiments.outcomes[:, None]

    def log_likelihood(alpha: Array) -> float:
        dry, less, sd, delay = alpha
        mean = np.where(wet, dry + less, dry)[:, None]
        inside = stats.norm.cdf((1.2 - mean) / sd) - stats.norm.cdf((0.2 - mean) / sd)
        distance = v * delay + v**2 / (2.0 * friction * 9.81)
        of_each = stats.norm.pdf(measured, distance, 0.3) * stats.norm.pdf(friction, mean, sd)
        return float(np.log(integrate.simpson(of_each, x=friction) / inside[:, 0]).sum())

    names = ["friction.mean[Intercept]", "friction.mean[road=wet]", "friction.sd", "delay.value"]
    at = found.values[names].to_numpy()
    best = optimize.minimize(lambda a: -log_likelihood(a), at, method="Nelder-Mead")
    assert abs(log_likelihood(at) - found.log_likelihood.estimated) < 0.002
    assert -best.fun - log_likelihood(at) < 0.002
    assert np.round(at, 3).tolist() == [0.755, -0.139, 0.043, 0.188]  # as the tutorial says


@pytest.mark.long
@pytest.mark.parametrize(
    ("page", "folder"), [("battery", BATTERY), ("servo_drive", EXAMPLES / "servo_drive")]
)
def test_the_page_of_an_example_tells_what_is_found(page: str, folder: Path) -> None:
    study = load_study(folder / "study.toml")
    found = identify(study.simulator, study.experiments, study.inputs, noise=study.noise)
    text = (EXAMPLES / page / "README.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| `([\w.]+)`.*?\|.*?\| (\S+) \| (\S+) \| \[(\S+), (\S+)\] \|$", text, re.M
    )
    told = {name: [float(number) for number in numbers] for name, *numbers in rows}
    assert told.keys() == set(found.values.index)
    for name, (estimate, error, lower, upper) in told.items():
        seen = [found.values[name], found.errors[name], *found.intervals.loc[name]]
        assert seen == pytest.approx([estimate, error, lower, upper], abs=0.05 * error), name
    assert found.sound
    assert found.consistent
