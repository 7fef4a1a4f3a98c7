"""Figures of an identification: pure functions of its document, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.inference.calibration import counted, cumulated
from aleator.plot import individual
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
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

Document = Mapping[str, Any]

# The outcomes outside have another shape too, for a print without color.
_WIDE, _NARROW, _MEDIAN = "#cfe3f1", "#7fb8dc", BLUE
_INSIDE, _OUTSIDE, _UNKNOWN = BLACK, VERMILION, GRAY
_BAND = "#e4e4e4"

_QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")
_NAMED = 12  # so many experiments or outliers still have room for their ids
_DECADES = 30.0  # a logarithmic scale of less than that has too few powers of ten to be read
_DASHES = (0, (4, 3))
_BARS = 300  # more bars than that run into each other; steps then show the same


def experiments_figure(result: Document) -> Figure:
    """Each measured outcome in the distribution that the identified law predicts for it.

    `result` is the content of identification.json. Experiments stand side by side, ordered by
    predicted median; bars are the predicted 50 % and 95 % intervals, an outcome outside the 95 %
    interval is set off and, where few are, named by its id. An experiment whose density was not
    solved has no bar. A logarithm that was identified is shown as the outcome itself, on a
    logarithmic scale. Raises AleatorError where matplotlib is not installed.

    >>> quantiles = {"0.025": 0.0, "0.25": 0.7, "0.5": 1.0, "0.75": 1.3, "0.975": 2.0}
    >>> one = {"id": "7", "outcome": 1.2, "quantiles": quantiles, "pit": 0.65}
    >>> figure = experiments_figure({"title": "Beam", "experiments": [one]})
    >>> figure.axes[0].get_title(loc="left")
    'Outside the predicted 95 % interval: 0 of 1 measured outcomes (expected 0.05)'
    """
    experiments = _ordered(result["experiments"])
    ids = [str(experiment["id"]) for experiment in experiments]
    outcome = _numbers(experiment["outcome"] for experiment in experiments)
    quantiles = np.array([_quantiles(experiment) for experiment in experiments])
    if _logarithmic(result):
        outcome, quantiles = np.exp(outcome), np.exp(quantiles)
    known = np.isfinite(quantiles).all(axis=1)
    with np.errstate(invalid="ignore"):
        outside = known & ((outcome < quantiles[:, 0]) | (outcome > quantiles[:, -1]))
    with styled():
        figure = _figure(result, height=4.6)
        axes = figure.add_subplot()
        draw_intervals(axes, quantiles, known)
        draw_outcomes(axes, outcome, outside, known)
        _name_outside(axes, ids, outcome, outside, quantiles[:, 2])
        _number_experiments(axes, ids)
        _scale(axes, result)
        axes.set_title(
            f"Outside the predicted 95 % interval: {outside.sum()} of {known.sum()} measured "
            f"outcomes (expected {0.05 * known.sum():.3g})"
        )
        _explain(figure, bool(outside.any()), not known.all())
    return figure


def calibration_figure(result: Document) -> Figure:
    """How the outcomes' probabilities under the identified law compare with a uniform sample.

    `result` is the content of identification.json. The probability of a smaller outcome (PIT) is
    uniform over the experiments if the law is right. Left its histogram, with the range that each
    bin of a uniform sample has in 95 % of all samples (binomial). Right its cumulative
    distribution minus that of the uniform law, with the band that holds the whole curve in 95 % of
    all uniform samples (Kolmogorov). Both are a little wide, for the law was fitted to the same
    outcomes. Of experiments with several observations these are shown, each given the earlier ones
    of its experiment. Raises AleatorError where matplotlib is not installed.

    >>> ten = [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]
    >>> [axes.get_ylabel() for axes in calibration_figure({"experiments": ten}).axes]
    ['experiments', 'cumulative share − uniform']
    """
    what = "observations" if result.get("observations") else "experiments"
    pit = _numbers(entry["pit"] for entry in result[what])
    pit = np.sort(pit[np.isfinite(pit)])
    with styled():
        figure = _figure(result, height=3.9)
        histogram, cumulative = figure.subplots(1, 2)
        if pit.size:
            draw_histogram(histogram, pit)
            draw_cumulative(cumulative, pit)
        histogram.set_title("Each bin and its 95 % range")
        histogram.set_ylabel(what)
        cumulative.set_title("The whole curve and its 95 % band")
        cumulative.set_ylabel("cumulative share − uniform")
        for axes in (histogram, cumulative):
            axes.set_xlim(0.0, 1.0)
            axes.set_xlabel(
                "probability of a smaller value, given the earlier ones"
                if what == "observations"
                else "predicted probability of a smaller outcome"
            )
        _explain_calibration(figure, what)
    return figure


def save_figures(result: Document, directory: str | Path) -> list[Path]:
    """Write experiments.png and calibration.png into a folder, which is made if need be.

    With individual parameters parameters.png too.
    Returns the paths written. The bytes depend on nothing but the document and the version of
    matplotlib. Raises AleatorError where matplotlib is not installed or a file cannot be written.
    """
    figures = {"experiments": experiments_figure, "calibration": calibration_figure}
    if result.get("observations"):
        figures = {
            "experiments": _observed_figure,
            "parameters": individual.parameters_figure,
            "calibration": calibration_figure,
        }
    return [
        save_figure(draw(result), Path(directory) / f"{name}.png") for name, draw in figures.items()
    ]


# ------------------------------------------------------------------------------- the document


def _observed_figure(result: Document) -> Figure:
    """What was measured in the prediction of its own law, or where that has no say of the law's.

    One exact value is where the individual law goes by itself: it tells nothing of the model.
    """
    seen, responses = result["observations"], result["responses"]
    quantiles = (result.get("pictures") or {}).get("predicted")
    several = len(seen) > len(result["experiments"]) or len(responses) > 1
    if not quantiles or several or any(entry["lower"] != entry["upper"] for entry in seen):
        return individual.experiments_figure(result)
    rows = [
        {"id": e["id"], "outcome": e["lower"], "quantiles": {p: quantiles[p][k] for p in quantiles}}
        for k, e in enumerate(seen)
    ]
    (transform,) = responses.values()
    return experiments_figure({**result, "experiments": rows, "transform": transform})


def _ordered(experiments: Sequence[Document]) -> list[Document]:
    """By predicted median, then by outcome; experiments without a density at the end."""

    def place(experiment: Document) -> tuple[float, float]:
        median = _quantiles(experiment)[2]
        return (float(median) if np.isfinite(median) else np.inf, float(experiment["outcome"]))

    return sorted(experiments, key=place)


def _quantiles(experiment: Document) -> Array:
    return _numbers(experiment["quantiles"][p] for p in _QUANTILES)


def _numbers(values: Iterator[Any]) -> Array:
    """JSON's null is NaN."""
    return np.array([np.nan if value is None else float(value) for value in values])


def _logarithmic(result: Document) -> bool:
    return result.get("transform") == "log"


def _scale(axes: Axes, result: Document) -> None:
    """The outcome in its own unit, on a logarithmic scale where its logarithm was identified."""
    from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

    name = label(result, str(result.get("outcome") or "outcome"))
    if not _logarithmic(result):
        axes.set_ylabel(name)
        return
    axes.set_ylabel(f"{name}, logarithmic scale")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high < _DECADES * low:
        axes.yaxis.set_major_locator(MaxNLocator(6))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


# ------------------------------------------------------------------------------- experiments


def draw_intervals(axes: Axes, quantiles: Array, known: NDArray[np.bool_]) -> None:
    """The 95 % interval, the 50 % interval on it, the median on both, by quantiles (N, 5)."""
    size = len(known)
    if size > _BARS:
        x = np.arange(0.5, size + 1.5)
        low, lower, median, upper, high = np.vstack([quantiles, quantiles[-1:]]).T
        axes.fill_between(x, low, high, step="post", color=_WIDE, lw=0.0)
        axes.fill_between(x, lower, upper, step="post", color=_NARROW, lw=0.0)
        axes.step(x, median, where="post", color=_MEDIAN, lw=1.0)
        return
    x = np.arange(1, size + 1)[known]
    low, lower, median, upper, high = quantiles[known].T
    width = _bar_width(size)
    axes.use_sticky_edges = False  # else the lowest bar stands on the axis as if cut there
    axes.bar(x, high - low, width, low, color=_WIDE)
    axes.bar(x, upper - lower, width, lower, color=_NARROW)
    axes.hlines(median, x - width / 2, x + width / 2, color=_MEDIAN, lw=1.4)


def _bar_width(size: int) -> float:
    """Most of the room of an experiment, but not a wall where there are few."""
    return min(0.72, 0.02 * size + 0.06)


def draw_outcomes(
    axes: Axes, outcome: Array, outside: NDArray[np.bool_], known: NDArray[np.bool_]
) -> None:
    """Dots in the order of their places; those outside the 95 % and those unknown set off."""
    size = outcome.size
    x = np.arange(1, size + 1)
    diameter = float(np.clip(5.0 - 0.7 * np.log2(max(size, 1) / 20.0), 1.3, 4.2))
    kinds = (
        (known & ~outside, _INSIDE, 0.5 if size > _BARS else 1.0),
        (outside, _OUTSIDE, 1.0),
        (~known, _UNKNOWN, 1.0),
    )
    for which, kind, alpha in kinds:
        if which.any():
            axes.plot(x[which], outcome[which], **_dot(kind, diameter), alpha=alpha, zorder=3)


def _dot(color: str, diameter: float) -> dict[str, Any]:
    shape, scale = ("D", 1.25) if color == _OUTSIDE else ("o", 1.0)
    return {"color": color, "marker": shape, "ms": scale * diameter, "mew": 0.0, "ls": "none"}


def _name_outside(
    axes: Axes, ids: Sequence[str], outcome: Array, outside: NDArray[np.bool_], median: Array
) -> None:
    """The ids, on the side away from the interval; those of neighbors make room for each other."""
    if outside.sum() > _NAMED or len(ids) <= _NAMED:
        return
    axes.margins(y=0.09)
    near = 0.03 * len(ids)
    for side in (1, -1):
        with np.errstate(invalid="ignore"):
            named = [int(l) for l in np.flatnonzero(outside & (side * (outcome - median) > 0.0))]
        for k, l in enumerate(named):
            after = k > 0 and l - named[k - 1] < near
            before = k + 1 < len(named) and named[k + 1] - l < near
            axes.annotate(
                ids[l], (l + 1, outcome[l]), (0, side * (14 if after and before else 5)),
                textcoords="offset points", color=_OUTSIDE, fontsize=8.0,
                ha="center" if after == before else "left" if after else "right",
                va="bottom" if side > 0 else "top",
            )  # fmt: skip


def _number_experiments(axes: Axes, ids: Sequence[str]) -> None:
    size = len(ids)
    axes.set_xlim(0.4, size + 0.6)
    axes.set_xlabel("experiment, ordered by predicted median")
    if size <= _NAMED:
        long = sum(map(len, ids)) > 60
        axes.set_xticks(range(1, size + 1), ids, rotation=20 if long else 0)


def _explain(figure: Figure, outside: bool, unknown: bool) -> None:
    """The legend, in the order of reading and of one size whatever the number of experiments."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def dot(color: str, label: str) -> Line2D:
        return Line2D([], [], **_dot(color, 4.5), label=label)

    handles: list[Line2D | Patch] = [
        Patch(color=_WIDE, lw=0.0, label="predicted 95 %"),
        Patch(color=_NARROW, lw=0.0, label="predicted 50 %"),
        Line2D([], [], color=_MEDIAN, lw=1.6, label="median"),
        dot(_INSIDE, "measured"),
    ]
    handles += [dot(_OUTSIDE, "measured, outside the 95 %")] if outside else []
    handles += [dot(_UNKNOWN, "measured, no density")] if unknown else []
    _legend(figure, handles)


# ------------------------------------------------------------------------------- calibration


def draw_histogram(axes: Axes, pit: Array) -> None:
    """The counts of probabilities (N,) in bins, with the range of each under a uniform law."""
    found = counted(pit)
    axes.axhspan(found.low, found.high, color=_BAND, lw=0.0)
    middle, width = 0.5 * (found.edges[1:] + found.edges[:-1]), 0.84 * found.edges[1]
    axes.bar(middle, found.counts, width, color=_NARROW)
    axes.axhline(found.expected, color=_UNKNOWN, lw=1.0, ls=_DASHES)
    axes.set_ylim(0.0, 1.12 * max(found.high, found.counts.max()))
    axes.locator_params(axis="y", integer=True)


def draw_cumulative(axes: Axes, pit: Array) -> None:
    """The difference from uniform: the cumulative share itself would hide it where N is large."""
    found = cumulated(pit)
    axes.fill_between(found.band_x, found.band_low, found.band_high, color=_BAND, lw=0.0)
    axes.axhline(0.0, color=_UNKNOWN, lw=1.0, ls=_DASHES)
    axes.plot(found.x, found.difference, color=_MEDIAN, lw=1.4)


def _explain_calibration(figure: Figure, what: str) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    _legend(
        figure,
        [
            Patch(color=_NARROW, lw=0.0, label=what),
            Line2D([], [], color=_UNKNOWN, lw=1.0, ls=_DASHES, label="uniform: the law is right"),
            Patch(color=_BAND, lw=0.0, label="95 % of all uniform samples"),
        ],
    )


# ------------------------------------------------------------------------------- matplotlib


def _legend(figure: Figure, handles: Sequence[Line2D | Patch]) -> None:
    """Under the axes, where it never hides a number."""
    figure.legend(
        handles=handles, loc="outside lower left", ncols=6, handlelength=1.6, columnspacing=1.8
    )


def _figure(result: Document, height: float) -> Figure:
    """An empty figure under the title of the study."""
    title = result.get("title")
    return empty_figure(str(title) if title else None, WIDTH, height)
