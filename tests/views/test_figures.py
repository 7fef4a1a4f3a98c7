"""Figures and charts on axes: what is drawn is what the document holds, in the same bytes."""

import json
import math
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from scipy.stats import kstwo, norm

from aleator import AleatorError, Check, Free, Identification, Inputs, Noise, Normal, identify, plot
from aleator.views.chart import GRAY, INK, VERMILION
from aleator.views.figures import calibration_figure, experiments_figure, save_figures
from aleator.views.interactive import LOG_TICKS

QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")


def document(size: int, seed: int = 0, **more: Any) -> dict[str, Any]:
    """An identification of normal outcomes, as identification.json holds it."""
    rng = np.random.default_rng(seed)
    mean, sd = rng.normal(0.0, 3.0, size), rng.uniform(0.3, 1.5, size)
    outcome = rng.normal(mean, sd)
    experiments = [
        {
            "id": f"e{l}",
            "outcome": float(outcome[l]),
            "pit": float(norm.cdf(outcome[l], mean[l], sd[l])),
            "quantiles": {p: float(norm.ppf(float(p), mean[l], sd[l])) for p in QUANTILES},
            "status": "solved",
        }
        for l in range(size)
    ]
    return {"title": "Normal outcomes", "experiments": experiments, **more}


def unsolved(outcome: float) -> dict[str, Any]:
    quantiles = dict.fromkeys(QUANTILES)
    return {"id": "lost", "outcome": outcome, "pit": None, "quantiles": quantiles, "status": "no"}


def dots(axes: Axes, color: str) -> np.ndarray:
    """Abscissae and ordinates (2, k) of the outcomes drawn in a color."""
    lines = [line for line in axes.lines if line.get_color() == color and line.get_marker() != ""]
    points = [line.get_xydata() for line in lines if line.get_linestyle() == "None"]
    return np.concatenate([*points, np.empty((0, 2))]).T


# ------------------------------------------------------------------------------------ experiments


@pytest.mark.parametrize("size", [1, 3, 75, 301])
def test_every_outcome_is_one_dot_inside_or_outside_its_interval(size: int) -> None:
    result = document(size)
    outside = sum(not 0.025 <= entry["pit"] <= 0.975 for entry in result["experiments"])
    (axes,) = experiments_figure(result).axes
    assert dots(axes, VERMILION).shape[1] == outside
    assert dots(axes, INK).shape[1] == size - outside
    assert f" {outside} of {size} " in axes.get_title(loc="left")


def test_outcomes_and_intervals_stand_in_the_order_of_the_predicted_medians() -> None:
    result = document(20)
    (axes,) = experiments_figure(result).axes
    ordered = sorted(result["experiments"], key=lambda entry: entry["quantiles"]["0.5"])
    drawn = np.concatenate([dots(axes, INK), dots(axes, VERMILION)], axis=1)
    assert sorted(drawn[0]) == list(range(1, 21))
    assert drawn[1, np.argsort(drawn[0])].tolist() == [entry["outcome"] for entry in ordered]
    for bars, (low, high) in zip(axes.containers, (QUANTILES[::4], QUANTILES[1:4:2]), strict=True):
        at = {round(bar.get_x() + bar.get_width() / 2): bar for bar in bars}
        for place, entry in enumerate(ordered, start=1):
            ends = at[place].get_y(), at[place].get_y() + at[place].get_height()
            assert ends == pytest.approx((entry["quantiles"][low], entry["quantiles"][high]))
    heights = sorted(path.vertices[0, 1] for path in axes.collections[0].get_paths())
    assert heights == pytest.approx([entry["quantiles"]["0.5"] for entry in ordered])


def test_an_experiment_without_a_density_has_a_dot_but_no_bar(tmp_path: Path) -> None:
    result = document(5)
    result["experiments"].insert(0, unsolved(9.0))
    (axes,) = experiments_figure(result).axes
    assert dots(axes, GRAY).T.tolist() == [[6.0, 9.0]]
    assert len(axes.patches) == 10
    assert len(save_figures({"experiments": [unsolved(1.0), unsolved(2.0)]}, tmp_path)) == 2


def test_a_logarithmic_axis_has_a_number_at_1_2_and_5_of_each_decade() -> None:
    result = document(20, outcome="cycles", transform="log")
    for k, entry in enumerate(result["experiments"]):
        entry["outcome"] = middle = np.log(300.0 * 1.1**k)
        entry["quantiles"] = {p: middle + float(norm.ppf(float(p))) / 4.0 for p in QUANTILES}
    axes = experiments_figure(result).axes[0]
    low, high = axes.get_ylim()
    shown = [t for t in axes.get_yticks() if low <= t <= high]
    every = [digit * 10.0**k for k in range(1, 5) for digit in (1.0, 2.0, 5.0)]
    assert shown == pytest.approx([t for t in every if low <= t <= high])
    assert len(shown) > 2


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (190.0, 1.1e4, [200, 500, 1000, 2000, 5000, 10000]),
        (0.03, 0.7, [0.05, 0.1, 0.2, 0.5]),
        (2e-3, 5e4, [0.01, 0.1, 1, 10, 100, 1000, 10000]),
        (620.0, 910.0, [650, 700, 750, 800, 850, 900]),
    ],
)
def test_the_page_has_such_an_axis_too(low: float, high: float, ticks: list[float]) -> None:
    call = f"(function (cb_data) {{{LOG_TICKS}}})({{start: {low}, end: {high}}})"
    seen = subprocess.run(
        ["node", "-p", f"JSON.stringify({call})"], capture_output=True, text=True, check=True
    )
    assert json.loads(seen.stdout) == pytest.approx(ticks)


def test_a_logarithm_is_drawn_as_the_outcome_on_a_logarithmic_scale() -> None:
    result = document(20, outcome="cycles", transform="log")
    (axes,) = experiments_figure(result).axes
    assert axes.get_yscale() == "log"
    drawn = np.concatenate([dots(axes, INK), dots(axes, VERMILION)], axis=1)
    measured = [math.exp(entry["outcome"]) for entry in result["experiments"]]
    assert sorted(drawn[1]) == pytest.approx(sorted(measured))
    top = max(bar.get_y() + bar.get_height() for bar in axes.patches)
    assert top == pytest.approx(
        math.exp(max(e["quantiles"]["0.975"] for e in result["experiments"]))
    )
    seen = plot.experiments(result)  # on the scale of the likelihood
    assert (seen.get_yscale(), seen.get_ylabel()) == ("linear", "log(cycles)")


# ------------------------------------------------------------------------------------ calibration


def test_the_histogram_counts_every_experiment() -> None:
    histogram, _ = calibration_figure(document(108)).axes
    assert sum(bar.get_height() for bar in histogram.patches) == 108
    assert len(histogram.patches) == 10
    # binomial(108, 1/10): 5 to 17 in at least 95 % of all samples
    heights = histogram.collections[0].get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == (5.0, 17.0)


def test_the_curve_is_the_cumulative_share_minus_uniform() -> None:
    result = {"experiments": [{"id": l, "pit": pit} for l, pit in enumerate((0.7, 0.2))]}
    _, cumulative = calibration_figure(result).axes
    (curve,) = [line for line in cumulative.lines if len(line.get_xdata()) > 2]
    assert curve.get_xydata().ravel().tolist() == pytest.approx(
        [0.0, 0.0, 0.2, -0.2, 0.2, 0.3, 0.7, -0.2, 0.7, 0.3, 1.0, 0.0]
    )


@pytest.mark.parametrize("size", [2, 20, 2000])
def test_the_band_is_that_of_a_uniform_sample(size: int) -> None:
    _, cumulative = calibration_figure(document(size)).axes
    heights = cumulative.collections[0].get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx(
        (-kstwo.ppf(0.95, size), kstwo.ppf(0.95, size))
    )


# ------------------------------------------------------------------------------------ files


def test_files_are_the_same_bytes_for_the_same_document(tmp_path: Path) -> None:
    paths = save_figures(document(75), tmp_path / "made" / "here")
    assert [path.name for path in paths] == ["experiments.png", "calibration.png"]
    first = [path.read_bytes() for path in paths]
    with matplotlib.rc_context({"font.size": 20.0, "savefig.dpi": 30, "axes.grid": True}):
        assert [path.read_bytes() for path in save_figures(document(75), tmp_path)] == first
    for image in first:
        assert image.startswith(b"\x89PNG")
        assert b"matplotlib" not in image.lower()


def test_drawing_leaves_no_trace(tmp_path: Path) -> None:
    settings, state = dict(matplotlib.rcParams), random.getstate()
    result = document(30)
    before, figures = repr(result), plt.get_fignums()
    save_figures(result, tmp_path)
    assert dict(matplotlib.rcParams) == settings
    assert random.getstate() == state
    assert repr(result) == before
    assert plt.get_fignums() == figures


@pytest.mark.parametrize("draw", [experiments_figure, calibration_figure])
def test_without_matplotlib_the_message_says_what_to_install(
    draw: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(AleatorError) as caught:
        draw(document(3))
    assert "pip install matplotlib" in caught.value.remedy


# ------------------------------------------------------------------------------------ aleator.plot


@pytest.fixture(scope="module")
def found() -> Identification:
    y = np.random.default_rng(4).normal(1.0, 0.4, 30)
    return identify(
        lambda x: x, pd.DataFrame({"y": y}), Inputs({"x": Normal(Free(0.0, 2.0), Free(0.05, 2.0))}),
        outcome="y", noise=Noise(0.1), vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    )  # fmt: skip


def test_what_is_drawn_is_what_was_found(found: Identification) -> None:
    axes = plot.experiments(found)
    lines = [line for line in axes.lines if line.get_linestyle() == "None"]
    drawn = np.concatenate([line.get_ydata() for line in lines])
    assert np.sort(drawn) == pytest.approx(np.sort([o.lower for o in found.observations]))
    (line,) = [line for line in plot.profile(found, "x.sd").lines if line.get_marker() == "o"]
    best = line.get_xdata()[np.argmax(line.get_ydata())]
    assert best == pytest.approx(found.values["x.sd"], rel=1e-6)


def test_a_profile_is_at_the_ends_of_the_interval_where_it_has_dropped_by_1_92(
    found: Identification,
) -> None:
    line = max(plot.profile(found, "x.sd").lines, key=lambda line: len(line.get_xdata()))
    ends = found.alpha["x.sd"].interval
    assert np.interp(ends, *line.get_data()) == pytest.approx([-1.92, -1.92], abs=0.05)


def test_the_simulator_and_the_weakest_pair_are_drawn_as_they_are(found: Identification) -> None:
    (line, *_) = plot.response(found, "x").lines
    assert line.get_ydata() == pytest.approx(line.get_xdata(), rel=1e-4)  # it returns x
    axes = plot.surface(found)
    (cross,) = axes.lines
    best = [float(cross.get_xdata()[0]), float(cross.get_ydata()[0])]
    assert best == pytest.approx(found.values[["x.mean", "x.sd"]].to_numpy(), rel=1e-3)
    assert axes.get_xlabel() == "x.mean"


def test_what_is_missing_is_told(found: Identification) -> None:
    with pytest.raises(AleatorError, match=r"'x\.men'"):
        plot.profile(found, "x.men")
    with pytest.raises(AleatorError, match="no response 'z'"):
        plot.experiments(found, response="z")
    with pytest.raises(AleatorError, match="has no response of"):
        plot.response(found.to_dict(), "x")
    with pytest.raises(AleatorError, match="has no laws"):
        plot.law(found.to_dict(), "x")
    with pytest.raises(AleatorError, match="no probability"):
        plot.calibration({"experiments": [{"id": "1", "pit": None}]})
