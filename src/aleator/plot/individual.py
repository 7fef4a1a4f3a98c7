"""Figures of experiments with individual parameters: pure functions of the document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.plot.style import BLACK, BLUE, VERMILION, WIDTH, empty_figure, styled
from aleator.results.units import label, varying_number
from aleator.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]
Entries = Sequence[Document]

PANELS, COLUMNS = 12, 4
WORST = 4
"""Of the panels so many are those with the largest residuals."""
BAND = "#cfe3f1"
SURE = 1.96
LONG = 18
"""Letters of an id that fit over a panel."""
RUG = 400
"""More individual means than that are not drawn one by one."""


def experiments_figure(result: Document) -> Figure:
    """What was measured and what the individual laws predict for it.

    Where a number varies within experiments each of some of them has a panel: the four with the
    largest residuals, and others evenly chosen; a band is where 95 % of the measurement errors
    are. Where nothing varies, measured values over predicted ones. Raises AleatorError where
    matplotlib is not installed.

    >>> one = {"id": "7", "row": 1, "response": "y", "lower": 1.0, "upper": 1.0, "predicted": 1.1,
    ...        "scale": 0.1, "residual": -1.0, "conditions": {}}
    >>> document = {"observations": [one], "responses": {"y": "none"}}
    >>> [axes.get_title(loc="left") for axes in experiments_figure(document).axes]
    ['y']
    """
    axis = varying_number(result["observations"])
    return _against_predictions(result) if axis is None else _series(result, axis)


def parameters_figure(result: Document) -> Figure:
    """The identified law of each parameter, and the means of the individual laws below it."""
    names = [*result["law_curves"]]
    with styled():
        rows = -(-len(names) // COLUMNS)
        figure = _figure(result, 0.6 + 2.6 * max(rows, 1))
        grid = figure.subplots(max(rows, 1), min(max(len(names), 1), COLUMNS), squeeze=False)
        for axes in grid.ravel()[len(names) :]:
            axes.set_axis_off()
        for axes, name in zip(grid.ravel(), names, strict=False):
            _draw_law(axes, name, result)
        _legend(figure, {"identified law": ("line", BLUE), "mean of each experiment": ("|", BLACK)})
    return figure


def chosen(seen: Entries, most: int) -> list[str]:
    """Ids of experiments to be shown: those with the largest residuals, others evenly chosen."""
    size: dict[str, float] = {}
    for entry in seen:
        size[entry["id"]] = max(size.get(entry["id"], 0.0), abs(entry["residual"] or 0.0))
    ids = [*size]
    if len(ids) <= most:
        return ids
    worst = sorted(ids, key=lambda name: -size[name])[: min(WORST, most)]
    others = [name for name in ids if name not in worst]
    evenly = np.linspace(0, len(others) - 1, most - len(worst)).round().astype(int)
    kept = {*worst, *(others[k] for k in evenly)}
    return [name for name in ids if name in kept]


def _series(result: Document, axis: str) -> Figure:
    responses = [*result["responses"]]
    seen = result["observations"]
    ids = chosen(seen, max(COLUMNS, PANELS // len(responses) // COLUMNS * COLUMNS))
    across = min(COLUMNS, len(ids))
    blocks = -(-len(ids) // across)
    with styled():
        figure = _figure(result, 0.9 + 1.85 * blocks * len(responses))
        grid = figure.subplots(
            blocks * len(responses), across, squeeze=False, sharex=True, sharey=len(responses) == 1
        )
        for axes in grid.ravel():
            axes.set_axis_off()
        for k, name in enumerate(ids):
            for r, response in enumerate(responses):
                axes = grid[k // across * len(responses) + r, k % across]
                axes.set_axis_on()
                own = [e for e in seen if e["id"] == name and e["response"] == response]
                _draw_series(axes, own, axis, result["responses"][response] == "log")
                if r == 0:
                    axes.set_title(name if len(name) <= LONG else f"{name[: LONG - 1]}…")
                if k % across == 0:
                    axes.set_ylabel(label(result, response))
                below = (k // across + 1) * across + k % across
                if r == len(responses) - 1 and below >= len(ids):
                    axes.set_xlabel(label(result, axis))
                    axes.tick_params(labelbottom=True)
        _explain(figure, any(_bounded(entry) for entry in seen), "prediction of its own law")
    return figure


def _draw_series(axes: Axes, seen: Entries, axis: str, log: bool) -> None:
    seen = sorted(
        (e for e in seen if isinstance(e["conditions"].get(axis), int | float)),
        key=lambda entry: entry["conditions"][axis],
    )
    x = _array(entry["conditions"][axis] for entry in seen)
    predicted = _array(entry["predicted"] for entry in seen)
    reach = SURE * _array(entry["scale"] for entry in seen)
    shown = np.exp if log else np.asarray
    axes.fill_between(x, shown(predicted - reach), shown(predicted + reach), color=BAND, lw=0.0)
    axes.plot(x, shown(predicted), color=BLUE, lw=1.2, marker="" if len(x) > 1 else "_")
    _draw_measured(axes, x, seen, log)
    if log:
        _logarithmic(axes, "y")


def _logarithmic(axes: Axes, *sides: str) -> None:
    """Logarithmic scales whose ticks are plain numbers."""
    from matplotlib.ticker import NullFormatter

    for side in sides:
        getattr(axes, f"set_{side}scale")("log")
        axis = getattr(axes, f"{side}axis")
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def _draw_measured(axes: Axes, x: Array, seen: Entries, log: bool) -> None:
    """Dots; of a censored value an arrow from its bound, or a bar between its bounds."""
    low, high = (_array(entry[end] for entry in seen) for end in ("lower", "upper"))
    if log:
        low, high = np.exp(low), np.exp(high)
    exact = low == high
    axes.plot(x[exact], low[exact], color=BLACK, marker="o", ms=3.2, mew=0.0, ls="none", zorder=3)
    for where, value, marker in (
        (np.isnan(high), low, "^"),
        (np.isnan(low), high, "v"),
    ):
        axes.plot(
            x[where], value[where], color=VERMILION, marker=marker, ms=4.0, mew=0.0, ls="none",
            zorder=3,
        )  # fmt: skip
    between = ~exact & np.isfinite(low) & np.isfinite(high)
    axes.vlines(x[between], low[between], high[between], color=VERMILION, lw=1.6, zorder=3)


def _against_predictions(result: Document) -> Figure:
    responses = [*result["responses"]]
    with styled():
        across = min(len(responses), 3)
        rows = -(-len(responses) // across)
        figure = _figure(result, 0.9 + 3.6 * rows)
        grid = figure.subplots(rows, across, squeeze=False).ravel()
        for axes in grid[len(responses) :]:
            axes.set_axis_off()
        for axes, name in zip(grid, responses, strict=False):
            seen = [e for e in result["observations"] if e["response"] == name]
            log = result["responses"][name] == "log"
            predicted = _within(seen)
            x = np.exp(predicted) if log else predicted
            reach = SURE * _array(entry["scale"] for entry in seen)
            ends = [predicted - reach, predicted + reach]
            low, high = np.exp(ends) if log else ends
            axes.vlines(x, low, high, color=BAND, lw=3.0)
            line = [np.nanmin(x), np.nanmax(x)] if len(x) else []
            axes.plot(line, line, color=BLUE, lw=1.0)
            _draw_measured(axes, x, seen, log)
            if log:
                _logarithmic(axes, "x", "y")
            axes.set_title(label(result, name))
            axes.set_xlabel("predicted by the individual law")
            axes.set_ylabel("measured")
        bounded = any(_bounded(entry) for entry in result["observations"])
        _explain(figure, bounded, "measured = predicted")
    return figure


def _within(seen: Entries) -> Array:
    """Predicted values (m,); those that are infinite stand at the largest number there is."""
    predicted = _array(entry["predicted"] for entry in seen)
    ends = np.concatenate([_array(entry[end] for entry in seen) for end in ("lower", "upper")])
    known = np.concatenate([predicted, ends])
    known = known[np.isfinite(known)]
    return np.where(np.isfinite(predicted), predicted, known.max(initial=-np.inf))


def _draw_law(axes: Axes, name: str, result: Document) -> None:
    curve = result["law_curves"][name]
    axes.fill_between(curve["x"], curve["density"], color=BAND, lw=0.0)
    axes.plot(curve["x"], curve["density"], color=BLUE, lw=1.4)
    means = _array(entry["mean"][name] for entry in result["experiments"])
    if means.size > RUG:
        heights, edges = np.histogram(means[np.isfinite(means)], 40, density=True)
        axes.stairs(heights, edges, color=BLACK, lw=1.0)
    else:
        foot = np.full(means.shape, -0.04 * max(curve["density"]))
        axes.plot(means, foot, color=BLACK, marker="|", ms=7.0, mew=0.8, ls="none", clip_on=False)
    share = result["shrinkage"].get(name)
    head = label(result, name)
    axes.set_title(head if share is None else f"{head}, shrinkage {100 * share:.0f} %")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=5)


def _explain(figure: Figure, bounded: bool, line: str) -> None:
    kinds = {"measured": ("o", BLACK), line: ("line", BLUE)}
    kinds |= {"95 % of the measurement errors": ("patch", BAND)}
    if bounded:
        kinds |= {"a bound only": ("^", VERMILION)}
    _legend(figure, kinds)


def _legend(figure: Figure, kinds: Mapping[str, tuple[str, str]]) -> None:
    """Under the axes, where it never hides a number."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    for said, (kind, color) in kinds.items():
        if kind == "patch":
            handles.append(Patch(color=color, lw=0.0, label=said))
        elif kind == "line":
            handles.append(Line2D([], [], color=color, lw=1.6, label=said))
        else:
            handles.append(Line2D([], [], color=color, marker=kind, ms=5.0, ls="none", label=said))
    figure.legend(
        handles=handles, loc="outside lower left", ncols=6, handlelength=1.6, columnspacing=1.8
    )


def _figure(result: Document, height: float) -> Figure:
    title = result.get("title")
    return empty_figure(str(title) if title else None, WIDTH, height)


def _bounded(entry: Document) -> bool:
    return entry["lower"] is None or entry["lower"] != entry["upper"]


def _array(values: Any) -> Array:
    """JSON's null is NaN."""
    return np.array([np.nan if value is None else float(value) for value in values])
