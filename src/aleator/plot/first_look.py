"""The figure of the first runs: a pure function of their document, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aleator.plot.style import BLUE, GRAY, VERMILION, WIDTH, empty_figure, save_figure, styled
from aleator.results.units import label, seen_label
from aleator.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]

ACROSS = 3
_ROW = 2.9  # inches
_MEASURED = "#e8e8e8"


def check_figure(result: Document) -> Figure:
    """The outcome of each observation over each parameter, a panel a parameter and response.

    `result` is the content of check.json. The other parameters are in the middle of the region.
    The gray band is the range of the measured outcomes, and what no point reaches is drawn in
    another color. Raises AleatorError where matplotlib is not installed.
    """
    rows = result["parameters"]
    responses = [*result["measured"]]
    across = min(len(rows), ACROSS)
    down = -(-len(rows) // across)
    with styled():
        title = result.get("title")
        height = 0.9 + _ROW * down * len(responses)
        figure = empty_figure(str(title) if title else None, WIDTH, height)
        grid = figure.subplots(down * len(responses), across, sharey="row", squeeze=False)
        for axes in grid.ravel():
            axes.set_visible(False)
        for r, response in enumerate(responses):
            for k, row in enumerate(rows):
                axes = grid[r * down + k // across, k % across]
                axes.set_visible(True)
                _panel(axes, result, response, k, row)
                if k % across == 0:
                    axes.set_ylabel(seen_label(result, response))
        handles = {
            text: handle
            for axes in grid.ravel()
            for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        told = figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=3)
        for line in told.get_lines():
            line.set_alpha(1.0)
    return figure


def save_check(result: Document, folder: str | Path) -> Path:
    """Write check.png into a folder, which is made if need be."""
    return save_figure(check_figure(result), Path(folder) / "check.png")


def _panel(axes: Axes, result: Document, response: str, k: int, row: Document) -> None:
    axes.axhspan(
        *_drawable(result["measured"][response]),
        color=_MEASURED,
        lw=0.0,
        label="measured",
        zorder=0,
    )
    lost = set(result["out_of_reach"])
    alpha = float(np.clip(8.0 / max(len(result["observations"]), 1), 0.15, 0.9))
    named = set()
    for each in (e for e in result["observations"] if e["response"] == response):
        outside = each["id"] in lost
        said = "of an experiment out of reach" if outside else "of an experiment"
        values = _drawable(each["by_parameter"][k])
        axes.plot(
            row["values"], values, "-", lw=1.0, marker=".", ms=3.0,
            color=VERMILION if outside else BLUE, alpha=max(alpha, 0.6) if outside else alpha,
            label=None if said in named else said, zorder=3 if outside else 2,
        )  # fmt: skip
        named.add(said)
    axes.set_xlabel(label(result, row["name"]))
    if not row["influence"]:
        axes.set_title("no influence", color=GRAY)


def _drawable(values: ArrayLike) -> Array:
    """Values cut where matplotlib ends: no axis is longer than the largest number."""
    most = np.finfo(np.float64).max / 8.0
    return np.clip(np.asarray(values, dtype=np.float64), -most, most)
