"""Charts on axes of one's own: they draw there and nowhere else, and say what is missing."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from aleator import (
    AleatorError,
    Check,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    identify,
    plot,
)


@pytest.fixture(scope="module")
def found() -> Identification:
    y = np.random.default_rng(4).normal(1.0, 0.4, 30)
    return identify(
        lambda x: x, pd.DataFrame({"y": y}), Inputs({"x": Normal(Free(0.0, 2.0), Free(0.05, 2.0))}),
        outcome="y", noise=Noise(0.1), vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    )  # fmt: skip


def test_charts_compose_on_axes_of_ones_own(found: Identification) -> None:
    figure, grid = plt.subplots(2, 3)
    drawn = [
        plot.calibration(found, ax=grid[0, 0]),
        plot.histogram(found, ax=grid[0, 1]),
        plot.experiments(found, ax=grid[0, 2]),
        plot.law(found, "x", ax=grid[1, 0]),
        plot.profile(found, "x.mean", ax=grid[1, 1]),
    ]
    assert drawn == list(grid.ravel()[:5])
    assert all(axes.has_data() for axes in drawn)
    assert not grid[1, 2].has_data()
    plt.close(figure)


def test_what_is_drawn_is_what_was_found(found: Identification) -> None:
    axes = plot.experiments(found)
    dots = [line for line in axes.lines if line.get_linestyle() == "None"]
    drawn = np.concatenate([line.get_ydata() for line in dots])
    assert np.sort(drawn) == pytest.approx(np.sort([o.lower for o in found.observations]))
    (line,) = [line for line in plot.profile(found, "x.sd").lines if line.get_marker() == "o"]
    best = line.get_xdata()[np.argmax(line.get_ydata())]
    assert best == pytest.approx(found.values["x.sd"], rel=1e-6)


def test_a_profile_is_at_the_ends_of_the_interval_where_it_has_dropped_by_1_92(
    found: Identification,
) -> None:
    _, line, *_ = plot.profile(found, "x.sd").lines
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


def test_the_simulator_at_the_nodes_of_collocation_is_drawn_as_marks() -> None:
    shown = [{"id": id, "response": "y", "values": [k, 2.0 * k]} for k, id in enumerate("ab")]
    drawn = {"nodes": {"x": [1.0, 2.0]}, "shown": shown}
    lines = plot.response({"pictures": {"response": drawn}}, "x").lines
    assert [line.get_linestyle() for line in lines] == ["None", "None"]
    assert [list(line.get_ydata()) for line in lines] == [[0.0, 0.0], [1.0, 2.0]]


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
