"""The samples that do what few runs do, on made-up errors, and the claims of the searches."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from reproduction.clutch.laws import EXPANSION, Judged
from reproduction.clutch.reference import of_sample
from reproduction.clutch.samples import accuracy, needed
from reproduction.clutch.sampling import (
    ENTROPY,
    GAUSSIAN,
    GRID,
    HISTOGRAM,
    QUADRATURE,
    RANDOM,
    SOBOL,
    SURFACES,
    SamplingErrors,
)
from reproduction.clutch.study import GIVEN
from reproduction.context import Context
from reproduction.figure import Verdict

SAMPLES = np.array([16.0, 256.0, 4096.0, 65536.0])
FACTORS = {RANDOM: 1.0, GRID: 2.0, SOBOL: 0.1}


def judged(name: str) -> Judged:
    """A law of 108 normal outcomes: nothing is run."""
    p = (np.arange(400) + 0.5) / 400
    y = np.tile(p, (108, 1))
    found = of_sample(GIVEN, y, y[:, 0], y[:, -1], np.zeros(108))
    return Judged(name, GIVEN, None, found, {EXPANSION: found.moments}, np.full(108, 0.5))  # type: ignore[arg-type]


def made_up(name: str) -> SamplingErrors:
    """Errors factor/sqrt(S), histograms twice those; 0.1 and 0.01 from 25 runs."""
    curves = pd.DataFrame(
        [
            {
                "law": name, "method": method, "density": density, "samples": s, "replicates": 4,
                "mae": factor * worse / np.sqrt(s), "standard_error": 0.001,
                "mae_of_others": factor / np.sqrt(s), "missed": 1.0,
            }
            for method, factor in FACTORS.items()
            for density, worse in ((HISTOGRAM, 2.0), (ENTROPY, 1.0))
            for s in SAMPLES
        ]
    )  # fmt: skip
    levels = pd.DataFrame(
        [
            {"law": name, "density": density, "way": way, "runs": 25.0, "mae": mae}
            for density, mae in ((GAUSSIAN, 0.1), (ENTROPY, 0.01))
            for way in (EXPANSION, QUADRATURE, SURFACES)
        ]
    )
    return SamplingErrors(judged(name), curves, levels, 0.001, 0.002)


@pytest.fixture
def context() -> Context:
    found = Context()
    # a cached property is what stands in the instance
    vars(found)["sampling"] = tuple(made_up(name) for name in ("one", "other", "third"))
    return found


def test_the_samples_needed_are_those_of_the_power_laws(context: Context) -> None:
    table = needed(context).tables[""].set_index(["law", "density"])
    row = table.loc["one", GAUSSIAN]
    assert row[f"{RANDOM}, {HISTOGRAM}"] == pytest.approx(400.0)
    assert row[f"{RANDOM}, {ENTROPY}"] == pytest.approx(100.0)
    assert row[f"{GRID}, {HISTOGRAM}"] == pytest.approx(1600.0)
    assert row[f"{SOBOL}, {ENTROPY}"] == 16.0
    sharp = table.loc["one", ENTROPY]
    assert sharp[f"{RANDOM}, {HISTOGRAM}"] == pytest.approx(40_000.0)
    assert np.isnan(sharp[f"{GRID}, {HISTOGRAM}"])
    paper = table[["paper_mae", f"paper, {RANDOM}", f"paper, {GRID}"]].iloc[:4].to_numpy()
    assert paper.tolist() == [
        [0.183, 458, 577], [0.155, 629, 1171], [0.117, 265, 370], [0.088, 383, 1009],
    ]  # fmt: skip


def test_the_claims_judge_these_numbers(context: Context) -> None:
    order, fair, grid, _ = needed(context).claims
    assert order.verdict is Verdict.HOLDS  # 400 at least, against 25
    assert fair.verdict is Verdict.FAILS
    assert grid.verdict is Verdict.HOLDS
    *_, best = accuracy(context).claims
    assert best.verdict is Verdict.HOLDS
