"""The best possible law of an identification: where it is sought, what it says, and is refused."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from rich.console import Console
from scipy import stats

from aleator import (
    By,
    Check,
    Constant,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    TruncatedNormal,
    ceiling,
)
from aleator.core.progress import Silent
from aleator.errors import AleatorError
from aleator.laws.law import Law
from aleator.tasks.ceiling import Ceiling, CeilingSettings, best_possible
from aleator.tasks.identification import load
from aleator.views.identification import render

COUNT, NOISE = 80, 0.1
LAW = Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.6))


def identified(x: np.ndarray, law: Law = LAW, noise: Noise | None = None, **more) -> Identification:
    """Springs of stiffness x (N,) under a known load, measured with an error."""
    rng = np.random.default_rng(1)
    load = rng.uniform(1.0, 3.0, len(x))
    y = load * x + rng.normal(0.0, NOISE, len(x))
    return unjudged(
        lambda load, x: load * x, pd.DataFrame({"load": load, "y": y}), Inputs({"x": law}),
        outcome="y", vectorized=True, noise=noise or Noise(NOISE), verification=Check(0),
        **more,
    )  # fmt: skip


def one_mode() -> np.ndarray:
    return np.random.default_rng(0).normal(1.0, 0.2, COUNT)


def two_modes() -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.choice([0.75, 1.25], COUNT) + rng.normal(0.0, 0.02, COUNT)


@pytest.fixture(scope="module")
def right() -> Identification:
    return identified(one_mode(), best_law=True)


@pytest.fixture(scope="module")
def wrong() -> Identification:
    return identified(two_modes(), best_law=True)


@pytest.fixture(scope="module")
def best(wrong: Identification) -> Ceiling:
    return ceiling(wrong, replicates=39)


def log_density(found: Identification, x: np.ndarray) -> np.ndarray:
    """log p(y_l | x_j) by hand, (N, J)."""
    table = found.fit.table
    load = table.conditions["load"].to_numpy()[:, None]
    y = table.observations.lower[:, None]
    return stats.norm.logpdf(y, load * x, NOISE)


def test_its_points_have_the_log_likelihood_that_is_told(
    wrong: Identification, best: Ceiling
) -> None:
    density = np.exp(log_density(wrong, best.points["x"].to_numpy()))
    f = density @ best.points["probability"].to_numpy()
    assert best.log_likelihood == pytest.approx(np.log(f).sum(), abs=1e-6)
    assert best.gains.sum() == pytest.approx(best.gap, abs=1e-8)
    assert best.verified is None
    assert best.estimated == pytest.approx(wrong.log_likelihood.estimated, abs=1e-6)


def test_no_law_is_above_it(wrong: Identification, best: Ceiling) -> None:
    f = np.exp(log_density(wrong, best.points["x"].to_numpy()))
    f = f @ best.points["probability"].to_numpy()
    ratio = np.exp(log_density(wrong, np.linspace(*best.region["x"], 4001))) / f[:, None]
    assert COUNT * np.log(ratio.mean(axis=0).max()) < best.error + 1e-4
    assert best.error < 1e-3


def test_two_modes_are_told_and_where_mass_is_lacking(best: Ceiling) -> None:
    assert best.gap > 10.0
    assert best.p_value == pytest.approx(1 / 40)
    assert best.judged.exceeded == 0
    curve = best.curves["x"].set_index("x")["gradient"]
    assert curve[(curve.index > 0.7) & (curve.index < 0.8)].max() > 0.1
    assert curve[(curve.index > 1.2) & (curve.index < 1.3)].max() > 0.1
    assert curve[(curve.index > 0.9) & (curve.index < 1.1)].max() < 0.0


def test_the_law_itself_gains_nothing_on_average(best: Ceiling) -> None:
    curve = best.curves["x"]
    mean = np.trapezoid(curve["gradient"] * curve["density"], curve["x"])
    assert mean == pytest.approx(0.0, abs=0.02)


def test_curves_see_experiments_that_say_sharply_what_their_parameter_is() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(1.0, 0.2, 24)
    frame = pd.DataFrame({"y": x + rng.normal(0.0, 0.004, 24)})
    found = unjudged(
        lambda x: x, frame, Inputs({"x": LAW}), outcome="y", vectorized=True, noise=Noise(0.004),
        verification=Check(0),
    )  # fmt: skip
    curve = ceiling(found, replicates=1).curves["x"]
    mean = np.trapezoid(curve["gradient"] * curve["density"], curve["x"])
    assert mean == pytest.approx(0.0, abs=0.1)


def test_the_right_law_is_not_doubted_and_few_replicates_are_drawn(right: Identification) -> None:
    found = ceiling(right)
    assert found.gap > 0.0
    assert found.p_value > 0.1
    assert found.judged.replicates < 99


def test_constants_and_noise_are_held_at_their_estimates() -> None:
    rng = np.random.default_rng(2)
    load = rng.uniform(1.0, 3.0, COUNT)
    y = 0.5 + load * rng.normal(1.0, 0.2, COUNT) + rng.normal(0.0, NOISE, COUNT)
    found = unjudged(
        lambda load, x, b: b + load * x, pd.DataFrame({"load": load, "y": y}),
        Inputs({"x": LAW, "b": Constant(Free(0.0, 1.0))}), outcome="y", vectorized=True,
        noise=Noise(Free(0.01, 1.0)), verification=Check(0),
    )  # fmt: skip
    best = ceiling(found, replicates=0)
    assert best.held == pytest.approx(found.values[["b.value", "noise.sd"]].to_dict())
    assert [*best.points.columns] == ["probability", "x"]
    assert np.isnan(best.p_value)


def test_mass_at_an_edge_of_what_was_searched_is_told_but_not_at_the_end_of_a_box() -> None:
    x = np.concatenate([one_mode()[:20], [2.6]])
    narrow = TruncatedNormal(box=(0.8, 1.2))
    assert ceiling(identified(x, narrow), replicates=0).edges == ()
    fixed = Normal(mean=1.0, sd=0.1)
    found = ceiling(identified(x, fixed), replicates=0)
    assert found.edges == ("x",)
    assert found.points["x"].max() == pytest.approx(found.region["x"][1], rel=1e-3)


def test_surfaces_serve_as_well_as_the_simulator() -> None:
    x = two_modes()[:40]
    rng = np.random.default_rng(1)
    load = rng.uniform(1.0, 3.0, 40)
    y = load * np.exp(x) + rng.normal(0.0, NOISE, 40)
    table = pd.DataFrame({"load": load, "y": y})
    law = Inputs({"x": TruncatedNormal(box=(0.4, 1.6))})

    def slow(load: float, x: float) -> float:
        sum(range(50_000))  # too slow for thousands of runs
        return float(load * np.exp(x))

    found = unjudged(slow, table, law, outcome="y", noise=Noise(NOISE), verification=Check(0))
    best = ceiling(found, replicates=0)
    at = best.points["x"].to_numpy()
    density = stats.norm.pdf(y[:, None], load[:, None] * np.exp(at), NOISE)
    exact = np.log(density @ best.points["probability"].to_numpy()).sum()
    assert found.surface is not None
    assert best.log_likelihood == pytest.approx(exact, abs=0.05)
    assert best.verified == pytest.approx(exact, abs=0.01)
    assert best.verified >= exact - 1e-6


def test_the_report_has_a_line_that_agrees(right: Identification, wrong: Identification) -> None:
    told = wrong.best_possible
    assert told["p_value"] == pytest.approx(1 / 40)
    assert told["log_likelihood"] == pytest.approx(
        ceiling(wrong, replicates=0).log_likelihood, abs=0.01
    )
    assert right.best_possible["p_value"] > 0.1
    document = wrong.to_dict()
    assert document["best_possible"] == told
    text = io.StringIO()
    Console(width=100, file=text).print(render(document))
    assert "best possible law" in text.getvalue()


def test_what_takes_longer_is_left_to_the_command(right: Identification) -> None:
    assert best_possible(right.fit, 0, Silent()) == right.best_possible
    for fewer in (CeilingSettings(direct=COUNT), CeilingSettings(nodes=COUNT)):
        assert best_possible(right.fit, 0, Silent(), fewer) is None


@pytest.mark.parametrize(
    ("law", "noise", "named"),
    [
        (LAW, None, "noise"),
        (Normal(mean=By("1 + load", -5.0, 5.0), sd=Free(0.01, 0.6)), Noise(NOISE), "follow load"),
        (Constant(Free(0.5, 1.5)), Noise(NOISE), "no parameter scatters"),
    ],
)
def test_where_there_is_none_it_is_refused(law: Law, noise: Noise | None, named: str) -> None:
    table = pd.DataFrame({"load": np.linspace(1.0, 3.0, 20)})
    table["y"] = table["load"] * one_mode()[:20]
    found = unjudged(
        lambda load, x: load * x, table, Inputs({"x": law}), outcome="y", vectorized=True,
        noise=noise, verification=Check(0),
    )  # fmt: skip
    with pytest.raises(AleatorError, match=named):
        ceiling(found)


def test_what_was_read_from_a_file_is_refused_and_keeps_its_line(
    wrong: Identification, tmp_path: Path
) -> None:
    document = {**wrong.to_dict(), "best_possible": {**(wrong.best_possible or {}), "gap": None}}
    (tmp_path / "identification.json").write_text(json.dumps(document))
    read = load(tmp_path / "identification.json")
    assert math.isnan(read.best_possible["gap"])
    with pytest.raises(AleatorError, match="read from a file"):
        ceiling(read)
