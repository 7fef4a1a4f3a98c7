"""Runs a second of the clutch against `scipy.integrate.solve_ivp` at the same accuracy."""

from __future__ import annotations

import time

import numpy as np

from aleator.core.types import Array
from aleator.study import load_study
from benchmarks.identifications import CLUTCH
from benchmarks.likelihood import median_seconds
from benchmarks.row import Row
from examples.wet_clutch.model import shifting_time
from examples.wet_clutch.reference import reference_shifting_time

MANY, FEW = 5_000, 60
TARGET_ERROR = 1e-6  # s


def simulator_rows() -> list[Row]:
    """The largest error, and runs a second on one core."""
    many, few = clutch_runs(MANY, 0), clutch_runs(FEW, 1)
    ours = MANY / median_seconds(lambda: shifting_time(**many), 3)
    exact = reference(few, "RK45", 1e-10, 2e-3)
    error = float(np.abs(shifting_time(**few) - exact).max())
    rows = [Row("clutch, largest error", f"{error:.1e} s", f"target {TARGET_ERROR:.0e} s",
                error / TARGET_ERROR)]  # fmt: skip
    for method, tolerance in (("RK45", 1e-8), ("LSODA", 1e-7)):
        began = time.perf_counter()
        found = reference(few, method, tolerance, np.inf)
        theirs = exact.size / (time.perf_counter() - began)
        error = np.abs(found - exact).max()
        what = f"clutch, runs a second / solve_ivp {method} (error {error:.0e} s)"
        rows.append(Row(what, f"{ours:,.0f}", f"{theirs:.0f}", ours / theirs))
    return rows


def clutch_runs(size: int, seed: int) -> dict[str, Array]:
    """Random experiments with parameters uniform in the box."""
    study, rng = load_study(CLUTCH), np.random.default_rng(seed)
    table = study.experiments.conditions
    rows = table.iloc[rng.integers(0, len(table), size)]
    low, high = study.inputs.box.T
    x = rng.uniform(low, high, (size, low.size))
    parameters = dict(zip(study.inputs.names, x.T, strict=True))
    return {name: rows[name].to_numpy(float) for name in table.columns} | parameters


def reference(runs: dict[str, Array], method: str, tolerance: float, step: float) -> Array:
    """The same runs by scipy.integrate.solve_ivp, one after the other."""
    names = list(runs)
    return np.array(
        [
            reference_shifting_time(
                **dict(zip(names, row, strict=True)),
                method=method, tolerance=tolerance, max_step=step,
            )
            for row in zip(*(runs[name].tolist() for name in names), strict=True)
        ]
    )  # fmt: skip
