"""Figures that are printed twice are one figure: rows and total, intervals and their profiles."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from matplotlib.figure import Figure
from rich.console import Console
from scipy import stats

from aleator import (
    Check,
    Collocation,
    Free,
    Identification,
    Inputs,
    MaximumEntropy,
    Noise,
    Normal,
    plot,
)
from aleator.core.types import Array
from aleator.results.answer import answer
from aleator.results.printed import fragment
from aleator.tasks.identification import pictured
from aleator.views import figures as identification
from aleator.views.identification import render
from aleator.views.law_charts import profile_line

RNG = np.random.default_rng(2028)


def single(count: int) -> pd.DataFrame:
    load = np.linspace(0.5, 2.0, count)
    return pd.DataFrame({"load": load, "y": load * np.exp(0.3 * RNG.normal(size=count))})


ONE, FEW = single(12), single(4)
REPEATED = pd.DataFrame(
    [(k, t, np.exp(z) * t + e) for k, z in enumerate(0.3 * RNG.normal(size=9))
     for t, e in zip((0.5, 1.0, 2.0), 0.1 * RNG.normal(size=3), strict=True)],
    columns=["id", "load", "y"],
)  # fmt: skip


def smooth(load: Array, x: Array) -> Array:
    return load * np.exp(x)


def jump(load: Array, x: Array) -> Array:
    return load * np.exp(x) + 0.5 * (x > 0.1)


def jump_of_two(load: Array, x: Array, z: Array) -> Array:
    return jump(load, x) + 0.05 * z


def jump_of_three(load: Array, x: Array, z: Array, w: Array) -> Array:
    return jump(load, x) + 0.05 * (z + w)


def law(*others: str, prior: Normal | None = None) -> Inputs:
    laws = {name: Normal(0.0, 1.0) for name in others}
    return Inputs({"x": Normal(Free(-1.0, 1.0, prior=prior), Free(0.02, 1.0)), **laws})


NOISE = {"noise": Noise(0.1)}
SMALL = {"noise": Noise(0.03)}
WAYS = [
    (smooth, ONE, law(), {}, "level sets"),
    (jump, ONE, law(), {}, "level sets"),
    (smooth, ONE, law(), {"density": MaximumEntropy(4)}, "maximum entropy, 4 moments"),
    (smooth, ONE, law(), {"density": MaximumEntropy(6)}, "maximum entropy, 6 moments"),
    (smooth, ONE, law(), {"propagation": Collocation()}, "maximum entropy, 4 moments"),
    (smooth, ONE, law(), NOISE, "Gauss-Hermite, 5 nodes"),
    (smooth, REPEATED, law(), NOISE, "Gauss-Hermite, 5 nodes"),
    (jump, FEW, law(), SMALL, "panels"),
    pytest.param(
        jump_of_two, FEW, law("z"), SMALL, "panels of two variates", marks=pytest.mark.slow
    ),
    pytest.param(
        jump_of_three, FEW, law("z", "w"), SMALL, "importance points", marks=pytest.mark.slow
    ),
]  # fmt: skip


@pytest.mark.parametrize(("simulator", "table", "inputs", "choices", "name"), WAYS)
def test_the_rows_of_every_way_sum_to_its_total_under_its_name(
    simulator: Callable[..., Array],
    table: pd.DataFrame,
    inputs: Inputs,
    choices: dict[str, Any],
    name: str,
) -> None:
    found = identified(simulator, table, inputs, **choices)
    total = found.log_likelihood.estimated
    assert sum(e.log_density for e in found.experiments) == pytest.approx(total, rel=1e-9)
    assert found.log_likelihood_at({}) == pytest.approx(total, rel=1e-9)
    assert found.density == name or found.density.startswith(f"{name}, ")
    assert_written(found)


def assert_written(found: Identification) -> None:
    """Every writer says by what the total was made, beside the total."""
    document = found.to_dict()
    assert document["density"] == found.density
    for text in (repr(found), fragment(answer(document)), terminal(document)):
        words = " ".join(text.split())
        before = words.index(f"{found.log_likelihood.estimated:.3f}")
        assert f"by {found.density}" in words[before:]


def terminal(document: dict[str, Any]) -> str:
    console = Console(file=io.StringIO(), width=300)
    console.print(render(document))
    return console.file.getvalue()


def test_rows_and_prior_are_what_was_maximized() -> None:
    found = identified(smooth, ONE, law(prior=Normal(0.0, 0.1)))
    rows, prior = sum(e.log_density for e in found.experiments), found.log_likelihood.log_prior
    assert prior is not None
    assert rows == pytest.approx(found.log_likelihood.estimated, rel=1e-9)
    assert rows + prior == pytest.approx(found.search["optima"][0]["log_likelihood"], rel=1e-9)


def identified(
    simulator: Callable[..., Array], table: pd.DataFrame, inputs: Inputs, **choices: Any
) -> Identification:
    return unjudged(
        simulator, table, inputs, outcome="y", vectorized=True, verification=Check(0),
        **choices,
    )  # fmt: skip


SHORT = pd.DataFrame({"load": np.ones(4), "y": [0.8, 1.1, 1.3, 0.9]})
"""So few that profiles bend, and a standard deviation may be anything up to its limit."""


@pytest.mark.parametrize(("choices", "table"), [({}, SHORT), (NOISE, SHORT), (NOISE, REPEATED)])
def test_the_chart_of_a_profile_has_the_interval_of_the_table(
    choices: dict[str, Any], table: pd.DataFrame
) -> None:
    found = pictured(identified(smooth, table, law(), **choices))
    for name, curve in found.pictures["profiles"].items():
        entry = found.alpha[name]
        assert entry.interval is not None
        assert entry.drops is not None
        at, below = (np.array(curve[key], float) for key in ("at", "below"))
        line = np.interp(entry.interval, *profile_line(at, below))
        assert at[0] <= entry.interval[0] < entry.interval[1] <= at[-1]
        assert np.interp(entry.interval, at, below) == pytest.approx(entry.drops, rel=1e-4)
        assert -line == pytest.approx(entry.drops, rel=1e-3)
        assert below[at == entry.estimate] == pytest.approx(0.0) or entry.at_bound
        verticals = [
            line.get_xdata()[0] for line in plot.profile(found, name).lines
            if len({*line.get_xdata()}) == 1 and line.get_linestyle() == "--"
        ]  # fmt: skip
        assert verticals == pytest.approx(entry.interval)
        plt.close("all")


def test_one_value_an_experiment_is_drawn_in_the_prediction_of_the_law(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its individual law goes through it, however wrong the model is."""
    found = identified(lambda load, x: x + 0.0 * load, ONE, law(), noise=Noise(0.01))
    kept: dict[str, Figure] = {}
    monkeypatch.setattr(
        identification, "save_figure", lambda figure, path: kept.setdefault(path.stem, figure)
    )
    identification.save_figures(pictured(found).to_dict(), tmp_path)
    (axes,) = kept["experiments"].axes
    mean, sd = found.values["x.mean"], np.hypot(found.values["x.sd"], 0.01)
    low, high = stats.norm(mean, sd).ppf([0.025, 0.975])
    bars = [bar for bar in axes.patches if bar.get_height() > sd * 2.0]
    assert len(bars) == len(ONE)
    for bar in bars:
        assert bar.get_y() == pytest.approx(low, abs=0.05 * sd)
        assert bar.get_y() + bar.get_height() == pytest.approx(high, abs=0.05 * sd)
    dots = np.concatenate([line.get_ydata() for line in axes.lines])
    assert np.sort(dots) == pytest.approx(np.sort(ONE["y"]))
