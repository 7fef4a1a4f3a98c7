"""The figure of a comparison: a pure function of its document, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.plot.style import BLUE, GRAY, VERMILION, WIDTH, empty_figure, save_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]


def compare_figure(result: Document) -> Figure:
    """How much worse each model predicts than the best, and by which experiments.

    `result` is the content of compare.json. Left the difference of the predictive log-likelihood
    with two standard errors, right that of each experiment. Raises AleatorError where matplotlib is
    not installed.
    """
    models = result["models"]
    with styled():
        figure = empty_figure(None, WIDTH, max(2.6, 1.5 + 0.36 * len(models)))
        left, right = figure.subplots(1, 2, sharey=True)
        _differences(left, result)
        _experiments(right, result)
        left.set_yticks(_places(result), [model["name"] for model in models])
        left.set_ylim(-0.6, len(models) - 0.4)
    return figure


def save_compare(result: Document, folder: str | Path) -> Path:
    """Write compare.png into a folder, which is made if need be."""
    return save_figure(compare_figure(result), Path(folder) / "compare.png")


def _places(result: Document) -> list[int]:
    return list(range(len(result["models"])))[::-1]


def _differences(axes: Axes, result: Document) -> None:
    axes.axvline(0.0, color=GRAY, lw=0.8)
    for place, model in zip(_places(result), result["models"], strict=True):
        error = model["difference_error"] or 0.0
        color = BLUE if model["sound"] else VERMILION
        axes.errorbar(
            model["difference"], place, xerr=2.0 * error, fmt="o", color=color, capsize=3.0
        )
    axes.set_xlabel("predictive log-likelihood minus that of the best")
    axes.set_title("Left out, with two standard errors")


def _experiments(axes: Axes, result: Document) -> None:
    best = result["models"][0]["name"]
    axes.axvline(0.0, color=GRAY, lw=0.8)
    for place, model in zip(_places(result), result["models"], strict=True):
        gaps = [row[model["name"]] - row[best] for row in result["left_out"]]
        axes.plot(gaps, np.full(len(gaps), place), "|", color=BLUE, ms=10.0, mew=0.8)
    axes.set_xlabel("the same of each experiment")
    axes.set_title("Each experiment")
