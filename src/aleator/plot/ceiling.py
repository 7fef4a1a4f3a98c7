"""The figure of the best possible law: a pure function of its document, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.plot.style import (
    BLACK,
    BLUE,
    GRAY,
    VERMILION,
    WIDTH,
    empty_figure,
    save_figure,
    styled,
)
from aleator.results.units import label
from aleator.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]
BAND, LACKING = "#cfe3f1", "#f6d5c3"
TALLEST = 10.0
"""The gradient function is cut there: what matters is where it is above zero."""
NOTHING = -0.99
"""A gradient below it: no experiment has anything there."""
LINEAR = 0.2
"""Gradients up to which colors are linear."""


def ceiling_figure(result: Document) -> Figure:
    """Where the chosen law lacks mass, over each parameter, and over two parameters as a map.

    `result` is the content of ceiling.json. Above the density of the chosen law with the points of
    the best one as stems, below the gradient function: where it is above zero, more mass would make
    the experiments more likely. Raises AleatorError where matplotlib is not installed.
    """
    names = [*result["curves"]]
    flat = result["map"] is not None
    with styled():
        title = result.get("title")
        figure = empty_figure(str(title) if title else None, WIDTH, 5.0)
        grid = figure.subplots(2, len(names) + flat, sharex="col", squeeze=False,
                               height_ratios=(1.0, 1.0))  # fmt: skip
        for k, name in enumerate(names):
            _law(grid[0, k], name, result)
            _gradient(grid[1, k], name, result)
        if flat:
            for axes in grid[:, -1]:
                axes.remove()
            _map(figure, figure.add_subplot(grid[0, -1].get_gridspec()[:, -1]), names, result)
        grid[0, 0].set_ylabel("density, probability")
        grid[1, 0].set_ylabel("gradient function")
        _explain(figure)
    return figure


def save_ceiling(result: Document, folder: str | Path) -> Path:
    """Write ceiling.png into a folder, which is made if need be."""
    return save_figure(ceiling_figure(result), Path(folder) / "ceiling.png")


def _law(axes: Axes, name: str, result: Document) -> None:
    """The density, and the probabilities of points as stems on a scale of their own."""
    curve = result["curves"][name]
    x, density = _array(curve["x"]), _array(curve["density"])
    tall = np.nanmax(density, initial=0.0) or 1.0
    axes.fill_between(x, density / tall, color=BAND, lw=0.0)
    axes.plot(x, density / tall, color=BLUE, lw=1.4)
    at = _array(point[name] for point in result["points"])
    share = _array(point["probability"] for point in result["points"])
    axes.vlines(at, 0.0, share, color=BLACK, lw=1.2)
    axes.plot(at, share, color=BLACK, marker="o", ms=4.0, mew=0.0, ls="none", clip_on=False)
    axes.set_ylim(0.0, 1.05)
    axes.set_title(label(result, name))


def _gradient(axes: Axes, name: str, result: Document) -> None:
    curve = result["curves"][name]
    x, value = _array(curve["x"]), np.minimum(_array(curve["gradient"]), TALLEST)
    axes.axhline(0.0, color=GRAY, lw=0.8)
    axes.fill_between(x, value, where=value > 0.0, interpolate=True, color=LACKING, lw=0.0)
    axes.plot(x, value, color=VERMILION, lw=1.4)
    axes.set_xlim(_shown(result["curves"][name], [p[name] for p in result["points"]]))
    axes.set_xlabel(label(result, name))
    axes.locator_params(axis="x", nbins=5)


def _shown(curve: Document, points: Sequence[float]) -> tuple[float, float]:
    """From where to where there is density, gain, or a point, with a margin."""
    x, density, gradient = (_array(curve[key]) for key in ("x", "density", "gradient"))
    some = (density > 1e-3 * np.nanmax(density, initial=0.0)) | (gradient > NOTHING)
    at = np.concatenate([x[some], points])
    margin = 0.05 * np.ptp(at)
    return max(x[0], at.min() - margin), min(x[-1], at.max() + margin)


def _map(figure: Figure, axes: Axes, names: list[str], result: Document) -> None:
    """The gradient function of two parameters; blue where there is too much mass."""
    from matplotlib.colors import AsinhNorm

    values = result["map"]
    first, second = _array(values["first"]), _array(values["second"])
    height = np.array([[np.nan if v is None else v for v in row] for row in values["gradient"]])
    most = float(np.clip(np.nanmax(height, initial=1.0), 1.0, TALLEST))
    mesh = axes.pcolormesh(
        first, second, np.minimum(height, most), cmap="RdBu_r", shading="nearest", rasterized=True,
        norm=AsinhNorm(LINEAR, -most, most),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axes, ticks=[-1.0, 0.0, 1.0, most], format="{x:.2g}", aspect=40)
    bar.outline.set_visible(False)
    share = _array(point["probability"] for point in result["points"])
    at = [_array(point[name] for point in result["points"]) for name in names]
    size = 12.0 + 300.0 * share
    axes.scatter(at[0], at[1], size, facecolors="none", edgecolors=BLACK, lw=1.3,
                 clip_on=False, zorder=3)  # fmt: skip
    axes.set_xlabel(label(result, names[0]))
    axes.set_ylabel(label(result, names[1]))
    axes.set_title("gradient function")


def _explain(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure.legend(
        handles=[
            Patch(facecolor=BAND, edgecolor=BLUE, label="chosen law (its largest density is 1)"),
            Line2D([], [], color=BLACK, marker="o", ms=5.0, lw=1.2, label="points of the best law"),
            Patch(color=LACKING, lw=0.0, label="the chosen law lacks mass here"),
        ],
        loc="outside lower left",
        ncols=3,
    )


def _array(values: Any) -> Array:
    return np.array([np.nan if value is None else float(value) for value in values])
