"""The studies of docs/repeated.md: their tables are those that the script makes of a known law."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pandas as pd

FOLDER = Path(__file__).parents[2] / "examples" / "repeated"


def test_the_script_makes_the_shipped_tables() -> None:
    made = runpy.run_path(str(FOLDER / "make_tables.py"))
    rng = np.random.default_rng(1)
    for name in ("wear", "coasting"):
        table = made[name](rng).to_csv(index=False)
        assert table == (FOLDER / name / f"{name}.csv").read_text(encoding="utf-8")


def test_the_coefficients_are_those_of_a_regression_of_each_pads_own_rate() -> None:
    """Five measurements of a pad tell its rate: the law is that of the separate estimates."""
    table = pd.read_csv(FOLDER / "wear" / "wear.csv")
    distance = table["distance"].to_numpy()
    pads = pd.get_dummies(table["pad"]).to_numpy(dtype=float) * distance[:, None]
    run_in = 1.0 - np.exp(-distance / 3.0)
    wear = table["wear"].to_numpy()
    *rates, shared = np.linalg.lstsq(np.column_stack([pads, run_in]), wear)[0]
    first = table.groupby("pad").first()
    pressure = first["pressure"] - first["pressure"].mean()
    columns = np.column_stack([np.ones(len(first)), pressure, first["supplier"] == "B"])
    coefficients = np.linalg.lstsq(columns.astype(float), np.array(rates))[0]
    page = (FOLDER.parents[1] / "docs" / "repeated.md").read_text(encoding="utf-8")
    told = [page.split(f"rate.mean[{term}]")[1].split()[:2] for term in
            ("Intercept", "center(pressure)", "supplier=B")]  # fmt: skip
    for (estimate, error), own in zip(told, coefficients, strict=True):
        assert abs(float(estimate) - own) < 0.5 * float(error)
    assert abs(shared - 0.3049) < 0.001
