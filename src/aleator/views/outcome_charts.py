"""Charts of measured values: against predictions, for calibration, over time, by experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.core.types import Array
from aleator.inference.calibration import counted, cumulated
from aleator.results.printed import AMOUNTS, Amounts, outside, percent
from aleator.results.units import label
from aleator.views import chart
from aleator.views.chart import CHARTS, Axis, Chart, GuideLine, Mark, Series, evenly, numbers
from aleator.views.measured import SHAPES, AxisChoice, MeasuredValues, add_conditions, conditions_of

Document = Mapping[str, Any]
IN_A_SERIES = (
    "value", "own", "own_low", "own_high", "q0.025", "q0.5", "q0.975", "pit", "kind",
)  # fmt: skip
PROBABILITY = "probability of a smaller value"

# ------------------------------------------------------------------------------------ predictions


def predicted_chart(seen: MeasuredValues, source: Series) -> Chart:
    """Measured values against the distributions that the law predicts for them.

    `seen` has predictions by the law; those by an experiment's own parameters would follow the
    measured values. `source` has the rows that are drawn, which may be fewer than those of `seen`.
    """
    whole, least, most = CHARTS.spans
    thick = float(np.clip(whole / max(len(seen), 1), least, most))
    spans = (("q0.025", "q0.975", chart.WIDE, "95 %"), ("q0.25", "q0.75", chart.NARROW, "50 %"))
    marks = [
        Mark("spans", source, y=one, high=other, color=color, width=thick, legend=f"predicted {of}")
        for one, other, color, of in spans
    ]
    columns = {"id": "id", "x": "x", "value": seen.response, "kind": "kind"}
    columns |= {f"q{p}": f"predicted {p}" for p in ("0.025", "0.25", "0.5", "0.75", "0.975")}
    columns |= {"pit": "P(below)"}
    return Chart(
        source.name, seen.response, _outside(seen, source),
        Axis(seen.choices[0].title), Axis(seen.label, seen.log),
        [
            *marks,
            Mark("points", source, y="q0.5", marker="dash", size=thick + 3.0, width=2.0,
                 legend="median"),
            Mark("points", source, y="value", color="color", marker="marker", size="size",
                 hover=hover(seen), pick=True),
        ],
        columns | {f"{one.key}_shown": one.title for one in seen.choices if one.name},
        height=CHARTS.high, switched=True, wide=True,
    )  # fmt: skip


def hover(seen: MeasuredValues, amounts: Amounts = AMOUNTS) -> list[tuple[str, str]]:
    """The lines of the tooltip of a measured value: a title, and a text with names of columns."""
    lines = [("experiment", "{id}"), (seen.label, "{value} ({kind})")]
    if seen.by_law:
        lines += [("predicted median", "{q0.5}"), ("95 %", "{q0.025} .. {q0.975}")]
    if "own" in seen.columns:
        lines.append(("fitted", "{own}"))
    lines.append(("P(below)", "{pit}"))
    conditions = [one for one in seen.choices if one.name][: amounts.hovered]
    return lines + [(one.title, f"{{{one.key}_shown}}") for one in conditions]


def _outside(seen: MeasuredValues, source: Series) -> str:
    words = f"Outside the predicted 95 % are {seen.outside_of} (diamonds). "
    pit = seen.exact_probabilities
    if pit and len({*seen.columns["id"]}) < len(seen):
        # These probabilities are conditional on earlier observations, hence independent.
        words += "Given the earlier observations of its experiment, " + outside(pit)
    elif pit:
        words = f"Outside the predicted 95 % (diamonds) {outside(pit)}"
    if not seen.exact.all():
        words += " Triangles are bounds: the value lies above, or below."
    drawn = len(source.columns["id"])
    if drawn < len(seen):
        words += f" {drawn} of {len(seen):,} are drawn, those farthest out among them."
    return words


# ------------------------------------------------------------------------------------ calibration


def probabilities(all_measured: Sequence[MeasuredValues]) -> tuple[Array, list[str]]:
    """The predicted probabilities of values below the measured ones, ascending, with their ids."""
    pit = np.concatenate([seen.array("pit") for seen in all_measured])
    ids = [one for seen in all_measured for one in seen.columns["id"]]
    order = [k for k in np.argsort(pit, kind="stable").tolist() if np.isfinite(pit[k])]
    return pit[order], [ids[k] for k in order]


def histogram_chart(pit: Array) -> Chart:
    """The histogram of predicted probabilities `pit` (N,), for calibration.

    A band shows the range of a bin's count in 95 % of all uniform samples.
    """
    bins = counted(pit)
    left, right = bins.edges[:-1], bins.edges[1:]
    source = Series(
        "pit-histogram",
        {"left": left, "right": right, "middle": 0.5 * (left + right), "count": bins.counts},
    )
    level = {"x": [0.0, 1.0], "low": [bins.low] * 2, "high": [bins.high] * 2}
    return Chart(
        source.name, "Each bin and its 95 % range",
        "If the model is right the bars are level, and 95 % of them end within the gray band. A "
        "hill: the law is too wide; a valley: too narrow; a slope: predictions are biased.",
        Axis(PROBABILITY), Axis("count"),
        [
            Mark("band", Series("range", level), y="low", high="high", color=chart.BAND,
                 legend="95 % of uniform samples"),
            Mark("bars", source, "middle", "count", color=chart.NARROW,
                 width=float(0.8 * bins.edges[1])),
        ],
        {"left": "from", "right": "to", "count": "count"}, [GuideLine(bins.expected)], foot=True,
        data=source,
    )  # fmt: skip


def cumulative_chart(pit: Array, ids: Sequence[str] = (), amounts: Amounts = AMOUNTS) -> Chart:
    """The cumulative distribution of ascending probabilities `pit` (N,), minus the uniform one.

    A band contains the whole curve in 95 % of all uniform samples. If the `ids` of the experiments
    are stated, each probability has a mark.
    """
    kept = evenly(pit.size, amounts.marks) if ids else []
    share = (np.array(kept, dtype=float) + 0.5) / pit.size
    source = Series(
        "pit-cumulative",
        {"id": [ids[k] for k in kept], "pit": pit[kept], "difference": share - pit[kept]},
    )
    dots = [Mark("points", source, "pit", "difference", color=chart.INK, size=4.0, pick=True,
                 hover=[("experiment", "{id}"), (PROBABILITY, "{pit}")])]  # fmt: skip
    return Chart(
        source.name, "The whole curve and its 95 % band",
        "If the model is right the whole curve stays within the gray band, in 95 % of all cases.",
        Axis(PROBABILITY), Axis("cumulative share − uniform"),
        [
            *curve_and_band(pit),
            *(dots if ids else ()),
        ],
        {"id": "id", "pit": PROBABILITY, "difference": "cumulative share - uniform"},
        [GuideLine(0.0)], data=source,
    )  # fmt: skip


def curve_and_band(pit: Array) -> tuple[Mark, Mark]:
    """The 95 % band of a uniform sample, and the curve of the probabilities `pit`, as two marks."""
    curve = cumulated(pit)
    around = {"x": curve.band_x, "low": curve.band_low, "high": curve.band_high}
    line = Series("pit", {"x": curve.x, "y": curve.difference})
    return (
        Mark("band", Series("band", around), y="low", high="high", color=chart.BAND,
             legend="95 % of uniform samples"),
        Mark("line", line),
    )  # fmt: skip


# ------------------------------------------------------------------------------------ over time


def series_charts(
    seen: MeasuredValues, name: str, number: int, amounts: Amounts = AMOUNTS
) -> Iterator[Chart]:
    """Two charts of outcomes over the condition `name`: all experiments, and the marked one."""
    choice = next((one for one in seen.choices if one.name == name), None)
    if choice is None:
        return
    ids = list(dict.fromkeys(seen.columns["id"]))
    most = max(1, min(amounts.series, amounts.observations * len(ids) // max(len(seen), 1)))
    lines = lines_of(seen, choice, [ids[k] for k in evenly(len(ids), most)])
    few = "" if len(lines) == len(ids) else f" {len(lines)} are drawn."
    every = {
        "id": list(lines),
        "x": [line["x"] for line in lines.values()],
        "y": [line["value"] for line in lines.values()],
    }
    yield Chart(
        f"series-{number}", f"All series of {seen.response}",
        f"A line for each experiment; click one to see it beside.{few}",
        Axis(choice.title), Axis(seen.label, seen.log),
        [Mark("lines", Series(f"series-{number}", every), color=chart.LINE,
              width=CHARTS.thin, alpha=CHARTS.faint, hover=[("experiment", "{id}")], pick=True)],
        {"id": "id", "x": choice.title, "y": seen.response}, height=CHARTS.high,
    )  # fmt: skip
    yield single_series_chart(seen, choice, number, lines, _least_probable(lines))


def single_series_chart(
    seen: MeasuredValues, choice: AxisChoice, number: int, lines: Mapping[str, Any], one: str
) -> Chart:
    """The observations of the experiment `one`, with predicted and fitted values.

    Predictions are by the law, fitted values by the parameters of the experiment itself. `lines`
    has the data of each experiment that a reader can mark.
    """
    line = lines[one]
    source = Series(f"marked-{number}", {"id": [one] * len(line["x"]), **line}, lines)
    by_law = [Mark("band", source, y="q0.025", high="q0.975", color=chart.BAND, legend="law, 95 %")]
    columns = {"id": "id", "x": choice.title, "value": seen.response, "own": "fitted"}
    return Chart(
        source.name, "The marked experiment",
        "Gray: where the law expects measurements of an experiment of which nothing is known. "
        "Blue: the fitted values, with the parameters of the experiment itself, and the range of "
        "measurement errors.",
        Axis(choice.title), Axis(seen.label, seen.log),
        [
            *(by_law if "q0.025" in line else ()),
            Mark("band", source, y="own_low", high="own_high", color=chart.WIDE,
                 alpha=CHARTS.faint, legend="errors, 95 %"),
            Mark("line", source, y="own", width=2.0, legend="fitted"),
            Mark("points", source, y="value", color=chart.INK, marker="shape",
                 hover=hover(seen)[:4], pick=True),
        ],
        columns | {"q0.025": "law 0.025", "q0.5": "law 0.5", "q0.975": "law 0.975"},
        height=CHARTS.high, marked=one,
    )  # fmt: skip


def lines_of(
    seen: MeasuredValues, choice: AxisChoice, ids: Sequence[str]
) -> dict[str, dict[str, list[Any]]]:
    """For each id, the columns of the experiment's observations, in the order of a condition."""
    at, columns = seen.array(choice.key), seen.columns
    rows: dict[str, list[int]] = {one: [] for one in ids}
    for k, one in enumerate(columns["id"]):
        if one in rows and np.isfinite(at[k]):
            rows[one].append(k)
    ordered = {one: sorted(own, key=lambda k: at[k]) for one, own in rows.items() if own}
    return {
        one: {"x": [at[k] for k in own]}
        | {"shape": [SHAPES.get(columns["kind"][k], "circle") for k in own]}
        | {name: [columns[name][k] for k in own] for name in IN_A_SERIES if name in columns}
        for one, own in ordered.items()
    }


def _least_probable(lines: Mapping[str, Mapping[str, list[Any]]]) -> str:
    """The experiment with the least probable observation; it is shown until a reader marks one."""

    def far(one: str) -> float:
        return float(np.nanmax(np.abs(numbers(lines[one].get("pit", [])) - 0.5), initial=0.0))

    return max(lines, key=far)


# ------------------------------------------------------------------------------------ individuals


@dataclass(frozen=True, eq=False)
class Individuals:
    """The parameters of each of `count` experiments, given its own observations.

    `series` has the data of charts, and `choices` the quantities for the x axis.
    """

    parameters: tuple[str, ...]
    series: Series
    choices: tuple[AxisChoice, ...]
    count: int


def individuals_of(document: Document, amounts: Amounts = AMOUNTS) -> Individuals | None:
    """Mean and 95 % range of the parameters of each experiment, given its observations.

    The result is None if each experiment has a single exact outcome. If experiments are very many,
    some hundreds are chosen.
    """
    entries = document["experiments"]
    if not document.get("observations") or not entries:
        return None
    kept = evenly(len(entries), amounts.marks)
    names = tuple(n for n in document.get("law_curves") or {} if n in entries[0]["mean"])
    columns: dict[str, list[Any]] = {"id": [str(entries[k]["id"]) for k in kept]}
    columns["foot"] = [0.0] * len(kept)
    for name in names:
        mean = numbers([entries[k]["mean"][name] for k in kept])
        reach = CHARTS.sd * numbers([entries[k]["sd"][name] for k in kept])
        columns |= {f"mean_{name}": mean.tolist(), f"low_{name}": (mean - reach).tolist(),
                    f"high_{name}": (mean + reach).tolist()}  # fmt: skip
    columns["order"] = [k + 1 for k in kept]
    drawn = {name: [column[j] for j in kept] for name, column in conditions_of(document).items()}
    choices = [AxisChoice("order", "order of the table")]
    choices += add_conditions(document, columns, drawn)
    columns["x"] = list(columns["order"])
    return Individuals(names, Series("individuals", columns), tuple(choices), len(entries))


def individual_charts(document: Document, individuals: Individuals) -> Iterator[Chart]:
    """A chart for each parameter: its mean and 95 % range in each experiment, over a condition."""
    for name in individuals.parameters:
        share = (document.get("shrinkage") or {}).get(name)
        caption = (
            "Mean and 95 % of each experiment's own law, given its observations. A trend over a "
            "condition says that the law should follow it."
        )
        if share is not None:
            caption += f" Shrinkage {percent(share)}: with much of it single means say little."
        drawn = len(individuals.series.columns["id"])
        if drawn < individuals.count:
            caption += f" {drawn} of {individuals.count:,} experiments are drawn."
        mean, low, high = f"mean_{name}", f"low_{name}", f"high_{name}"
        head = label(document, name)
        yield Chart(
            f"individual-{name}", name, caption, Axis(individuals.choices[0].title), Axis(head),
            [
                Mark("spans", individuals.series, y=low, high=high, color=chart.WIDE, width=3.0),
                Mark("points", individuals.series, y=mean, color=chart.INK, pick=True,
                     hover=[("experiment", "{id}"), (head, f"{{{mean}}}")]),
            ],
            {"id": "id", "x": "x", mean: f"{name}, mean", low: f"{name}, lower",
             high: f"{name}, upper"},
            switched=True,
        )  # fmt: skip


def roughness_chart(seen: MeasuredValues, source: Series, against: str) -> Chart | None:
    """The error of each response surface over a condition; None if the errors are not known.

    `against` names the quantity to which the errors are relative.
    """
    if all(value is None for value in seen.columns.get("error", ())):
        return None
    return Chart(
        f"rough-{source.name}", f"Where surfaces of {seen.response} are rough",
        f"Root-mean-square error of each surface under the identified law, over {against}.",
        Axis(seen.choices[0].title), Axis("error of the surface", share=True),
        [Mark("points", source, y="error", color=chart.INK, pick=True,
              hover=[*hover(seen), ("error", "{error:%}")])],
        {"id": "id", "x": "x", "error": "error"}, switched=True, wide=True,
    )  # fmt: skip
