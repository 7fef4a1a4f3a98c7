"""The figures that commands write: of an identification, a check, a sensitivity, a comparison.

Each figure depends only on a document, the content of a result's JSON file. matplotlib draws it;
AleatorError is raised if matplotlib is not installed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aleator.core.types import Array
from aleator.inference.information import INTERVALS
from aleator.results.printed import AMOUNTS, Amounts, percent
from aleator.results.units import label, transforms
from aleator.views.axes import (
    BLACK,
    BLUE,
    FIGURES,
    GRAY,
    VERMILION,
    draw,
    empty_figure,
    legend,
    save_figure,
    styled,
)
from aleator.views.chart import WIDE, evenly, numbers
from aleator.views.law_charts import law_chart, law_curves
from aleator.views.measured import MeasuredValues, measured, varying
from aleator.views.outcome_charts import (
    cumulative_chart,
    histogram_chart,
    individuals_of,
    lines_of,
    predicted_chart,
    probabilities,
    single_series_chart,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = Mapping[str, Any]
Draw = Callable[[Document], "Figure"]


@dataclass(frozen=True)
class SheetSettings:
    """Settings of figures: heights in inches, and the range that is drawn; chosen by judgement.

    Fields with the name of a figure are its height. If there are two numbers, the first is the
    height of the frame, the second that of each row of the figure. For sensitivity and compare the
    least height of the figure stands before these two. letters: if the ids of all experiments have
    more letters than these, they are turned by `turned` degrees.

    The gradient function of `aleator ceiling` says where more mass of the law would make the
    experiments more likely: where it is above zero. tallest: the chart cuts higher values. linear:
    colors are linear up to this gradient. nothing: where the gradient is lower, no experiment needs
    mass. density: the axis shows densities from this share of the largest density on.
    """

    experiments: tuple[float, float] = (1.0, 3.6)
    parameters: tuple[float, float] = (0.6, 2.6)
    calibration: float = 3.9
    series: tuple[float, float] = (0.9, 1.85)
    check: tuple[float, float] = (0.9, 2.9)
    sensitivity: tuple[float, float, float] = (3.2, 1.6, 0.34)
    compare: tuple[float, float, float] = (2.6, 1.5, 0.36)
    ceiling: float = 5.0
    letters: int = 60
    turned: int = 20
    tallest: float = 10.0
    linear: float = 0.2
    nothing: float = -0.99
    density: float = 1e-3


SHEETS = SheetSettings()


def save_figures(document: Document, directory: str | Path) -> list[Path]:
    """Write experiments.png and calibration.png into a folder, which is made if necessary.

    If experiments have parameters of their own, parameters.png is written too. Returns the paths of
    the written files. Their bytes depend only on the document and the version of matplotlib.
    Raises AleatorError if matplotlib is not installed or a file cannot be written.
    """
    figures: dict[str, Draw] = {"experiments": experiments_figure}
    if document.get("observations"):
        figures["parameters"] = parameters_figure
    figures["calibration"] = calibration_figure
    return [
        save_figure(make(document), Path(directory) / f"{name}.png")
        for name, make in figures.items()
    ]


def experiments_figure(document: Document) -> Figure:
    """Measured values beside their predicted distributions, ordered by the predicted median.

    If a condition such as time varies within experiments, each experiment has a chart of its own.
    If experiments are many, the four with the largest residuals are drawn, and others evenly
    chosen.

    >>> quantiles = {"0.025": 0.0, "0.25": 0.7, "0.5": 1.0, "0.75": 1.3, "0.975": 2.0}
    >>> one = {"id": "7", "outcome": 1.2, "quantiles": quantiles, "pit": 0.65}
    >>> figure = experiments_figure({"title": "Beam", "experiments": [one]})
    >>> figure.axes[0].get_title(loc="left")
    'Outside the predicted 95 %: 0 of 1 (expected 0.05)'
    """
    all_measured, name = measured(document), varying(document)
    if name is not None:
        return _series(document, all_measured, name)
    with styled():
        figure = _figure(document, _high(SHEETS.experiments, len(all_measured)))
        grid = figure.subplots(len(all_measured), 1, squeeze=False).ravel()
        for axes, seen in zip(grid, all_measured, strict=True):
            if not seen.by_law:
                axes.set_axis_off()
                axes.set_title(f"{seen.response}: predictions by the law are not in this document")
                continue
            draw(predicted_chart(seen, seen.series()), axes)
            beyond, known = seen.outside, np.isfinite(seen.array(seen.ends[0])) & seen.exact
            axes.set_title(
                f"Outside the predicted 95 %: {beyond.sum()} of {known.sum()} "
                f"(expected {2.0 * INTERVALS.tail * known.sum():.3g})"
            )
            _name(axes, seen)
        legend(figure)
    return figure


def parameters_figure(document: Document, amounts: Amounts = AMOUNTS) -> Figure:
    """The identified law of each parameter, with a tick at each experiment's own mean of it."""
    names, individuals = [*law_curves(document)], individuals_of(document)
    with styled():
        rows = max(-(-len(names) // amounts.across), 1)
        figure = _figure(document, _high(SHEETS.parameters, rows))
        grid = figure.subplots(rows, min(max(len(names), 1), amounts.across), squeeze=False).ravel()
        for axes in grid[len(names) :]:
            axes.set_axis_off()
        for axes, name in zip(grid, names, strict=False):
            draw(law_chart(document, name, individuals), axes)
            share = (document.get("shrinkage") or {}).get(name)
            axes.set_title("" if share is None else f"shrinkage {percent(share)}")
            axes.set_yticks([])
            axes.set_ylabel("")
            axes.spines["left"].set_visible(False)
            axes.locator_params(axis="x", nbins=4)
        legend(figure)
    return figure


def calibration_figure(document: Document) -> Figure:
    """Calibration: the predicted probabilities of smaller outcomes, compared with a uniform sample.

    The left chart is their histogram, with the range of a bin's count in 95 % of all uniform
    samples (binomial). The right chart is their cumulative distribution minus the uniform one, with
    the band that contains the whole curve in 95 % of all uniform samples (Kolmogorov). Range and
    band are a little too wide, because the law was fitted to the same outcomes.

    >>> ten = [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]
    >>> [axes.get_ylabel() for axes in calibration_figure({"experiments": ten}).axes]
    ['count', 'cumulative share − uniform']
    """
    pit, _ = probabilities(measured(document))
    with styled():
        figure = _figure(document, SHEETS.calibration)
        grid = figure.subplots(1, 2)
        for axes, make in zip(grid, (histogram_chart, cumulative_chart), strict=True):
            axes.set_xlim(0.0, 1.0)
            if pit.size:
                chart = make(pit)
                draw(chart, axes)
                axes.set_title(chart.title)
        legend(figure)
    return figure


def _series(
    document: Document,
    all_measured: Sequence[MeasuredValues],
    name: str,
    amounts: Amounts = AMOUNTS,
) -> Figure:
    """The figure of outcomes over a condition: a chart for each experiment shown and response."""
    responses = len(all_measured)
    most = max(amounts.across, amounts.named // responses // amounts.across * amounts.across)
    ids = chosen(document["observations"], most)
    across = min(amounts.across, len(ids))
    blocks = -(-len(ids) // across)
    with styled():
        figure = _figure(document, _high(SHEETS.series, blocks * responses))
        grid = figure.subplots(
            blocks * responses, across, squeeze=False, sharex=True, sharey=responses == 1
        )
        for axes in grid.ravel():
            axes.set_axis_off()
        for r, seen in enumerate(all_measured):
            (choice,) = [one for one in seen.choices if one.name == name]
            lines = lines_of(seen, choice, ids)
            for k, one in enumerate(ids):
                axes = grid[k // across * responses + r, k % across]
                axes.set_axis_on()
                if one in lines:
                    draw(single_series_chart(seen, choice, r, lines, one), axes)
                if r == 0:
                    axes.set_title(
                        one if len(one) <= amounts.letters else f"{one[: amounts.letters - 1]}…"
                    )
                if k % across:
                    axes.set_ylabel("")
                if r < responses - 1 or (k // across + 1) * across + k % across < len(ids):
                    axes.set_xlabel("")
                else:
                    axes.tick_params(labelbottom=True)
        legend(figure)
    return figure


def chosen(seen: Sequence[Document], most: int, amounts: Amounts = AMOUNTS) -> list[str]:
    """Ids of at most `most` experiments: some with the largest residuals, others evenly chosen."""
    size: dict[str, float] = {}
    for entry in seen:
        size[entry["id"]] = max(size.get(entry["id"], 0.0), abs(entry["residual"] or 0.0))
    ids = [*size]
    if len(ids) <= most:
        return ids
    worst = sorted(ids, key=lambda name: -size[name])[: min(amounts.farthest_panels, most)]
    others = [name for name in ids if name not in worst]
    kept = {*worst, *(others[k] for k in evenly(len(others), most - len(worst)))}
    return [name for name in ids if name in kept]


def _name(axes: Axes, seen: MeasuredValues, amounts: Amounts = AMOUNTS) -> None:
    """Write the ids of the experiments at the x axis.

    If experiments are many, only those outside their predicted 95 % range are named, at their mark.
    """
    ids, place, size = seen.columns["id"], seen.columns["order"], len(seen)
    axes.set_xlim(0.5, size + 0.5)
    if size <= amounts.named:
        ordered = [ids[k] for k in np.argsort(place)]
        long = sum(map(len, ids)) > SHEETS.letters
        axes.set_xticks(range(1, size + 1), ordered, rotation=SHEETS.turned if long else 0)
    elif seen.outside.sum() <= amounts.named:
        axes.margins(y=0.1)
        value, high = seen.array("value"), seen.array(seen.ends[1])
        for k in np.flatnonzero(seen.outside):
            side = 1 if value[k] > high[k] else -1
            axes.annotate(ids[k], (place[k], value[k]), (0, 4 * side), color=VERMILION,
                          textcoords="offset points", fontsize="small", ha="center",
                          va="bottom" if side > 0 else "top")  # fmt: skip


def _high(inches: Sequence[float], count: int) -> float:
    """The height of a figure: the height of its frame plus that of `count` rows; both in inches."""
    other, each = inches
    return other + each * count


def _figure(document: Document, height: float) -> Figure:
    """An empty figure of this height in inches, with the title of the study."""
    title = document.get("title")
    return empty_figure(str(title) if title else None, FIGURES.width, height)


def _save(make: Draw, name: str, document: Document, folder: str | Path) -> Path:
    return save_figure(make(document), Path(folder) / f"{name}.png")


# ------------------------------------------------------------------------------------ first runs


def check_figure(document: Document) -> Figure:
    """The simulated outcomes over each parameter: a chart for each parameter and response.

    `document` is the content of check.json. A line has the outcomes of one observation, while all
    other parameters are in the middle of their ranges. The gray band is the range of the measured
    outcomes. Experiments whose measured value is reached by no run have another color.
    """
    rows, responses = document["parameters"], [*document["measured"]]
    across = min(len(rows), 3)
    down = -(-len(rows) // across)
    with styled():
        figure = _figure(document, _high(SHEETS.check, down * len(responses)))
        grid = figure.subplots(down * len(responses), across, sharey="row", squeeze=False)
        for axes in grid.ravel():
            axes.set_visible(False)
        for r, response in enumerate(responses):
            for k, row in enumerate(rows):
                axes = grid[r * down + k // across, k % across]
                axes.set_visible(True)
                _panel(axes, document, response, k, row)
                if k % across == 0:
                    axes.set_ylabel(label(document, response))
                    if transforms(document).get(response) == "log":
                        axes.set_yscale("log")
        legend(figure)
    return figure


def _panel(axes: Axes, document: Document, response: str, k: int, row: Document) -> None:
    low, high = _drawable(document["measured"][response])
    axes.axhspan(low, high, color="#e8e8e8", lw=0.0, label="measured", zorder=0)
    lost = set(document["out_of_reach"])
    alpha = min(1.0, 2.0 / np.sqrt(max(len(document["observations"]), 1)))
    for each in (e for e in document["observations"] if e["response"] == response):
        outside = each["id"] in lost
        axes.plot(
            row["values"], _drawable(each["by_parameter"][k]), "-", lw=1.0, marker=".", ms=3.0,
            color=VERMILION if outside else BLUE,
            alpha=1.0 if outside else alpha,
            label="of an experiment out of reach" if outside else "of an experiment",
            zorder=3 if outside else 2,
        )  # fmt: skip
    axes.set_xlabel(label(document, row["name"]))
    if not row["influence"]:
        axes.set_title("no influence", color=GRAY)


def _drawable(values: ArrayLike) -> Array:
    """The values, limited to numbers that matplotlib can draw on an axis."""
    most = np.finfo(np.float64).max / 10.0
    return np.clip(np.asarray(values, dtype=np.float64), -most, most)


# ------------------------------------------------------------------------------------ sensitivity


def sensitivity_figure(document: Document) -> Figure:
    """Sobol' indices of each parameter, and the alignment of each pair of parameters.

    `document` is the content of sensitivity.json. The left chart shows the means of the first-order
    and the total Sobol' indices over the experiments, and the total index of each experiment. The
    right chart shows the alignment: how far two parameters have the same linear effects (1 or -1:
    they cannot be distinguished).
    """
    rows = document["parameters"]
    names = [row["parameter"] for row in rows]
    least, *each = SHEETS.sensitivity
    with styled():
        figure = _figure(document, max(least, _high(each, len(names))))
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        place = np.arange(len(rows))[::-1]
        total, alone = ([row[key] for row in rows] for key in ("mean_total", "mean_first"))
        left.barh(place, total, color=WIDE, label="mean total")
        left.barh(place, alone, 0.5, color=BLUE, label="mean alone")
        for y, name in zip(place.tolist(), names, strict=True):
            shares = numbers(each["total"][name] for each in document["experiments"])
            left.plot(shares, np.full(shares.size, y), "|", color=VERMILION,
                      label="total in each experiment")  # fmt: skip
        left.set_yticks(place, names)
        left.set(xlim=(0.0, 1.0), xlabel="share of the outcome's variance")
        left.set_title("Sobol' indices")
        _alignment(right, names, document["pairs"])
        legend(figure)
    return figure


def _alignment(
    axes: Axes, names: Sequence[str], pairs: Sequence[Document], amounts: Amounts = AMOUNTS
) -> None:
    matrix = np.eye(len(names))
    for pair in pairs:
        i, j = names.index(pair["first"]), names.index(pair["second"])
        matrix[i, j] = matrix[j, i] = numbers([pair["alignment"]])[0]
    axes.imshow(matrix, cmap="RdBu", vmin=-1.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=SHEETS.turned, ha="right",
                    rotation_mode="anchor")  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.spines[:].set_visible(False)
    axes.set_title("Alignment: ±1 cannot be told apart")
    if len(names) > amounts.named:
        return
    for (i, j), value in np.ndenumerate(matrix):
        if i != j and np.isfinite(value):
            color = "white" if abs(value) > 0.5 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=color,
                      fontsize="small")  # fmt: skip


# ------------------------------------------------------------------------------------ models


def compare_figure(document: Document) -> Figure:
    """The predictive log-likelihood of each model, minus that of the best model.

    `document` is the content of compare.json. The left chart shows the difference summed over the
    experiments, with two standard errors; the right chart shows it for each experiment.
    """
    models = document["models"]
    best, places = models[0]["name"], range(len(models) - 1, -1, -1)
    least, *each = SHEETS.compare
    with styled():
        figure = empty_figure(None, FIGURES.width, max(least, _high(each, len(models))))
        left, right = figure.subplots(1, 2, sharey=True)
        for axes in (left, right):
            axes.axvline(0.0, color=GRAY, lw=1)
        for place, model in zip(places, models, strict=True):
            error = 2.0 * (model["difference_error"] or 0.0)
            color = BLUE if model["sound"] else VERMILION
            left.errorbar(model["difference"], place, xerr=error, fmt="o", color=color, capsize=3.0)
            gaps = [row[model["name"]] - row[best] for row in document["left_out"]]
            right.plot(gaps, np.full(len(gaps), place), "|", color=BLUE)
        left.set_xlabel("predictive log-likelihood minus that of the best")
        left.set_title("Left out, with two standard errors")
        right.set_xlabel("the same of each experiment")
        right.set_title("Each experiment")
        left.set_yticks(places, [model["name"] for model in models])
        left.set_ylim(-0.5, len(models) - 0.5)
    return figure


LACKING = "#f6d5c3"


def ceiling_figure(document: Document) -> Figure:
    """The chosen law, the points of the best possible law, and where the chosen law lacks mass.

    `document` is the content of ceiling.json. The upper charts show the density of the chosen law,
    and the points of the best law as stems. The lower charts show the gradient function: where it
    is above zero, more mass would make the experiments more likely.
    """
    names, flat = [*document["curves"]], document["map"] is not None
    with styled():
        figure = _figure(document, SHEETS.ceiling)
        grid = figure.subplots(2, len(names) + flat, sharex="col", squeeze=False)
        for k, name in enumerate(names):
            _mass(grid[0, k], name, document)
            _gradient(grid[1, k], name, document)
        if flat:
            for axes in grid[:, -1]:
                axes.remove()
            whole = figure.add_subplot(grid[0, -1].get_gridspec()[:, -1])
            _map(figure, whole, names, document)
        grid[0, 0].set_ylabel("density, probability")
        grid[1, 0].set_ylabel("gradient function")
        legend(figure)
    return figure


def _mass(axes: Axes, name: str, document: Document) -> None:
    """Draw the chosen law's density over its maximum, and the best law's points as stems."""
    curve = document["curves"][name]
    x, density = numbers(curve["x"]), numbers(curve["density"])
    tall = np.nanmax(density, initial=0.0) or 1.0
    axes.fill_between(x, density / tall, color=WIDE, lw=0.0)
    axes.plot(x, density / tall, color=BLUE,
              label="chosen law (its largest density is 1)")  # fmt: skip
    at = numbers(point[name] for point in document["points"])
    share = numbers(point["probability"] for point in document["points"])
    axes.vlines(at, 0.0, share, color=BLACK, lw=1)
    axes.plot(at, share, color=BLACK, marker="o", ms=4.0, mew=0.0, ls="none", clip_on=False,
              label="points of the best law")  # fmt: skip
    axes.set_ylim(bottom=0.0)
    axes.set_title(label(document, name))


def _gradient(axes: Axes, name: str, document: Document) -> None:
    curve = document["curves"][name]
    x, density, gradient = (numbers(curve[key]) for key in ("x", "density", "gradient"))
    value = np.minimum(gradient, SHEETS.tallest)
    axes.axhline(0.0, color=GRAY, lw=1)
    axes.fill_between(x, value, where=value > 0.0, interpolate=True, color=LACKING, lw=0.0,
                      label="the chosen law lacks mass here")  # fmt: skip
    axes.plot(x, value, color=VERMILION)
    # The axis spans all values with density, with a gain, or with a point of the best law.
    some = density > SHEETS.density * np.nanmax(density, initial=0.0)
    some |= gradient > SHEETS.nothing
    at = np.concatenate([x[some], [point[name] for point in document["points"]]])
    axes.set_xlim(at.min(), at.max())
    axes.set_xlabel(label(document, name))
    axes.locator_params(axis="x", nbins=4)


def _map(figure: Figure, axes: Axes, names: list[str], document: Document) -> None:
    """Draw the gradient function over two parameters; blue where the law has too much mass."""
    from matplotlib.colors import AsinhNorm

    first, second = (numbers(document["map"][key]) for key in ("first", "second"))
    height = np.array([numbers(row) for row in document["map"]["gradient"]])
    most = float(np.clip(np.nanmax(height, initial=1.0), 1.0, SHEETS.tallest))
    mesh = axes.pcolormesh(
        first, second, np.minimum(height, most), cmap="RdBu_r", shading="nearest", rasterized=True,
        norm=AsinhNorm(SHEETS.linear, -most, most),
    )  # fmt: skip
    ticks = [-1.0, 0.0, 1.0, most]
    bar = figure.colorbar(mesh, ax=axes, ticks=ticks, format="{x:.2g}")
    bar.outline.set_visible(False)
    share = numbers(point["probability"] for point in document["points"])
    x, y = (numbers(point[name] for point in document["points"]) for name in names)
    axes.scatter(x, y, 10.0 + 100.0 * share, "none", edgecolors=BLACK, clip_on=False, zorder=3)
    axes.set(xlabel=label(document, names[0]), ylabel=label(document, names[1]))
    axes.set_title("gradient function")


save_check = partial(_save, check_figure, "check")
save_sensitivity = partial(_save, sensitivity_figure, "sensitivity")
save_compare = partial(_save, compare_figure, "compare")
save_ceiling = partial(_save, ceiling_figure, "ceiling")
