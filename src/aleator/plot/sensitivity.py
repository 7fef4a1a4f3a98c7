"""The figure of a sensitivity study: a pure function of its document, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.plot.style import BLUE, VERMILION, WIDTH, empty_figure, save_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]

_TOTAL, _FIRST, _MOST = "#cfe3f1", BLUE, VERMILION
_CELLS = 10  # more parameters than that leave no room for numbers in the matrix


def sensitivity_figure(result: Document) -> Figure:
    """Shares of the variance by parameter, and which parameters act alike.

    `result` is the content of sensitivity.json. Left the mean first-order and total Sobol' indices
    over the experiments with the range of the total, right the alignment of the linear effects.
    Raises AleatorError where matplotlib is not installed.
    """
    rows = result["parameters"]
    names = [row["parameter"] for row in rows]
    with styled():
        title = result.get("title")
        height = max(3.2, 1.6 + 0.34 * len(names))
        figure = empty_figure(str(title) if title else None, WIDTH, height)
        left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        _shares(left, rows, result["experiments"])
        _alignment(right, names, result["pairs"])
        figure.legend(loc="outside lower left", ncols=3)
    return figure


def save_sensitivity(result: Document, folder: str | Path) -> Path:
    """Write sensitivity.png into a folder, which is made if need be."""
    return save_figure(sensitivity_figure(result), Path(folder) / "sensitivity.png")


def _shares(axes: Axes, rows: Sequence[Document], experiments: Sequence[Document]) -> None:
    place = np.arange(len(rows))[::-1]
    axes.barh(place, [row["mean_total"] for row in rows], 0.72, color=_TOTAL, label="mean total")
    axes.barh(place, [row["mean_first"] for row in rows], 0.36, color=_FIRST, label="mean alone")
    for y, row in zip(place.tolist(), rows, strict=True):
        shares = [experiment["total"][row["parameter"]] for experiment in experiments]
        known = np.array([share for share in shares if share is not None], dtype=float)
        label = "total in each experiment" if y == 0 else None
        axes.plot(known, np.full(known.size, y), "|", color=_MOST, ms=7.0, mew=0.7, label=label)
    axes.set_yticks(place, [row["parameter"] for row in rows])
    axes.set_xlim(0.0, 1.02)
    axes.set_xlabel("share of the outcome's variance")
    axes.set_title("Sobol' indices")


def _alignment(axes: Axes, names: Sequence[str], pairs: Sequence[Document]) -> None:
    matrix = np.eye(len(names))
    for pair in pairs:
        i, j = names.index(pair["first"]), names.index(pair["second"])
        value = np.nan if pair["alignment"] is None else pair["alignment"]
        matrix[i, j] = matrix[j, i] = value
    axes.imshow(matrix, cmap="RdBu", vmin=-1.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(names)), names)
    axes.spines[:].set_visible(False)
    axes.set_title("Alignment: ±1 cannot be told apart")
    if len(names) > _CELLS:
        return
    for (i, j), value in np.ndenumerate(matrix):
        if i != j and np.isfinite(value):
            color = "white" if abs(value) > 0.6 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=color, fontsize=7.5)
