"""Figures of an identification: drawn from its document alone, and from nothing else."""

import math
import random
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import kstwo, norm

from aleator.errors import AleatorError
from aleator.plot.identification import calibration_figure, experiments_figure, save_figures

QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")
INSIDE, OUTSIDE, UNKNOWN = "#262626", "#d55e00", "#8c8c8c"


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
    return {
        "id": "lost",
        "outcome": outcome,
        "pit": None,
        "quantiles": dict.fromkeys(QUANTILES),
        "status": "not_solved",
    }


def dots(axes: Axes, color: str) -> np.ndarray:
    """Abscissae and ordinates (2, k) of the outcomes drawn in a color."""
    lines = [line for line in axes.lines if line.get_color() == color and line.get_marker() != ""]
    points = [line.get_xydata() for line in lines if line.get_linestyle() == "None"]
    return np.concatenate([*points, np.empty((0, 2))]).T


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize("size", [1, 3, 75, 300, 301, 5000])
def test_every_outcome_is_one_dot_inside_or_outside_its_interval(size: int) -> None:
    result = document(size)
    outside = sum(not 0.025 <= entry["pit"] <= 0.975 for entry in result["experiments"])
    (axes,) = experiments_figure(result).axes
    assert dots(axes, OUTSIDE).shape[1] == outside
    assert dots(axes, INSIDE).shape[1] == size - outside
    assert f" {outside} of {size} measured" in axes.get_title(loc="left")


def test_each_experiment_has_its_two_intervals_and_its_median() -> None:
    result = document(20)
    (axes,) = experiments_figure(result).axes
    ordered = sorted(result["experiments"], key=lambda entry: entry["quantiles"]["0.5"])
    spans = [(bar.get_y(), bar.get_y() + bar.get_height()) for bar in axes.patches]
    expected = [tuple(entry["quantiles"][p] for p in pair) for pair in (("0.025", "0.975"),
                ("0.25", "0.75")) for entry in ordered]  # fmt: skip
    assert np.array(spans) == pytest.approx(np.array(expected), abs=1e-12)
    (medians,) = axes.collections
    heights = [path.vertices[0, 1] for path in medians.get_paths()]
    assert heights == pytest.approx([entry["quantiles"]["0.5"] for entry in ordered])


def test_many_experiments_are_steps_instead_of_bars() -> None:
    (few,), (many,) = (experiments_figure(document(size)).axes for size in (300, 301))
    assert (len(few.patches), len(few.collections)) == (600, 1)
    assert (len(many.patches), len(many.collections)) == (0, 2)


def test_outcomes_stand_in_the_order_of_the_predicted_medians() -> None:
    result = document(40)
    (axes,) = experiments_figure(result).axes
    drawn = np.concatenate([dots(axes, INSIDE), dots(axes, OUTSIDE)], axis=1)
    ordered = sorted(result["experiments"], key=lambda entry: entry["quantiles"]["0.5"])
    assert sorted(drawn[0]) == list(range(1, 41))
    assert drawn[1, np.argsort(drawn[0])].tolist() == [entry["outcome"] for entry in ordered]


def test_the_order_of_the_document_does_not_matter(tmp_path: Path) -> None:
    result = document(30)
    shuffled = {**result, "experiments": result["experiments"][::-1]}
    one, other = (
        [path.read_bytes() for path in save_figures(each, tmp_path / name)]
        for each, name in ((result, "one"), (shuffled, "other"))
    )
    assert one == other


def test_an_experiment_without_a_density_has_a_dot_but_no_bar() -> None:
    result = document(5)
    result["experiments"].insert(0, unsolved(9.0))
    figure = experiments_figure(result)
    (axes,) = figure.axes
    assert dots(axes, UNKNOWN).T.tolist() == [[6.0, 9.0]]
    assert len(axes.patches) == 10
    assert legend(figure)[-1] == "measured, no density"
    assert calibration_figure(result).axes[0].patches


def test_a_document_without_any_density_still_gives_figures(tmp_path: Path) -> None:
    result = {"experiments": [unsolved(1.0), unsolved(2.0)]}
    assert len(save_figures(result, tmp_path)) == 2


def test_outcomes_outside_are_named_where_few_are() -> None:
    result = document(40)
    (first, second, *_) = (entry["quantiles"] for entry in result["experiments"])
    for entry in result["experiments"]:
        entry["outcome"] = entry["quantiles"]["0.5"]
    result["experiments"][0]["outcome"] = first["0.975"] + 1.0
    result["experiments"][1]["outcome"] = second["0.025"] - 1.0
    (axes,) = experiments_figure(result).axes
    assert sorted(text.get_text() for text in axes.texts) == ["e0", "e1"]
    for entry in result["experiments"]:
        entry["outcome"] = entry["quantiles"]["0.975"] + 1.0
    (axes,) = experiments_figure(result).axes
    assert not axes.texts


def test_few_experiments_are_named_on_the_axis() -> None:
    result = document(3)
    (axes,) = experiments_figure(result).axes
    ordered = sorted(result["experiments"], key=lambda entry: entry["quantiles"]["0.5"])
    assert [label.get_text() for label in axes.get_xticklabels()] == [e["id"] for e in ordered]


def test_title_and_outcome_are_written_as_they_are() -> None:
    figure = experiments_figure(document(3, title="Cost in $ and $", outcome="a_b$"))
    assert figure.get_suptitle() == "Cost in $ and $"
    assert figure.axes[0].get_ylabel() == "a_b$"
    plain = experiments_figure({"experiments": document(3)["experiments"]})
    assert (plain.get_suptitle(), plain.axes[0].get_ylabel()) == ("", "outcome")


def test_the_histogram_counts_every_experiment() -> None:
    histogram, _ = calibration_figure(document(108)).axes
    band, *bars = histogram.patches
    assert sum(bar.get_height() for bar in bars) == 108
    assert len(bars) == 10
    # binomial(108, 1/10): 5 to 17 in at least 95 % of all samples
    assert (band.get_y(), band.get_y() + band.get_height()) == (5.0, 17.0)


def test_the_curve_is_the_cumulative_share_minus_uniform() -> None:
    result = {"experiments": [{"id": l, "pit": pit} for l, pit in enumerate((0.7, 0.2))]}
    _, cumulative = calibration_figure(result).axes
    curve = cumulative.lines[-1].get_xydata()
    assert curve.ravel().tolist() == pytest.approx(
        [0.0, 0.0, 0.2, -0.2, 0.2, 0.3, 0.7, -0.2, 0.7, 0.3, 1.0, 0.0]
    )


@pytest.mark.parametrize("size", [2, 20, 2000])
def test_the_band_is_that_of_a_uniform_sample(size: int) -> None:
    _, cumulative = calibration_figure(document(size)).axes
    heights = cumulative.collections[0].get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(kstwo.ppf(0.95, size))
    assert heights.min() == pytest.approx(-kstwo.ppf(0.95, size))


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
    before = repr(result)
    save_figures(result, tmp_path)
    assert dict(matplotlib.rcParams) == settings
    assert random.getstate() == state
    assert repr(result) == before
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or pyplot.get_fignums() == []


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


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file, not a folder")
    with pytest.raises(AleatorError, match="taken") as caught:
        save_figures(document(3), taken)
    assert caught.value.remedy


def test_a_logarithm_is_drawn_as_the_outcome_on_a_logarithmic_scale() -> None:
    result = document(20, outcome="cycles", transform="log")
    (axes,) = experiments_figure(result).axes
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel().startswith("cycles")
    drawn = np.concatenate([dots(axes, INSIDE), dots(axes, OUTSIDE)], axis=1)
    measured = [math.exp(entry["outcome"]) for entry in result["experiments"]]
    assert sorted(drawn[1]) == pytest.approx(sorted(measured))
    top = max(bar.get_y() + bar.get_height() for bar in axes.patches)
    assert top == pytest.approx(
        math.exp(max(e["quantiles"]["0.975"] for e in result["experiments"]))
    )
