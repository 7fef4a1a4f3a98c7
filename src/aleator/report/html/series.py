"""Observations over time: all series at once, and the one that is marked with its bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, legend_below, models, points, shared
from aleator.report.html.markup import Section
from aleator.report.html.predicted import told
from aleator.report.html.rows import Measured, numbers
from aleator.results.units import varying_number

Document = Mapping[str, Any]
SERIES = 200
ROWS = 20_000
"""Observations of which the page holds each: of more, those of some experiments."""
KEYS = ("value", "own", "own_low", "own_high", "q0.025", "q0.5", "q0.975", "pit", "kind")


def series(document: Document, all_measured: Sequence[Measured]) -> Section | None:
    """Two charts for each response; None where no number varies within experiments."""
    name = varying_number(document.get("observations") or ())
    if name is None:
        return None
    parts: list[Any] = []
    for number, seen in enumerate(all_measured):
        parts += _pair(seen, name, number)
    return Section.of("series", f"Observations over {name}", *parts)


def _pair(seen: Measured, name: str, number: int) -> tuple[str | Chart, ...]:
    found = next((axis for axis in seen.axes if axis.name == name), None)
    if found is None:
        return ()
    lines, name = _lines(seen, found.key), found.title
    one = _first(lines)
    return ('<div class="row">', _all(seen, name, number, lines),
            _marked(seen, name, number, lines, one), "</div>")  # fmt: skip


def _lines(seen: Measured, key: str) -> dict[str, dict[str, list[Any]]]:
    """Of each shown experiment its observations in the order of x."""
    ids = list(dict.fromkeys(seen.columns["id"]))
    most = max(1, min(SERIES, ROWS * len(ids) // max(len(seen), 1)))
    evenly = np.unique(np.linspace(0, len(ids) - 1, min(len(ids), most)).astype(int))
    shown = [ids[k] for k in evenly]
    rows: dict[str, list[int]] = {one: [] for one in shown}
    at = numbers(seen.columns[key])
    for k, one in enumerate(seen.columns["id"]):
        if one in rows and np.isfinite(at[k]):
            rows[one].append(k)
    found = {}
    for one, own in rows.items():
        own = sorted(own, key=lambda k: at[k])
        if own:
            found[one] = {"x": [at[k] for k in own]} | {
                name: [seen.columns[name][k] for k in own] for name in KEYS if name in seen.columns
            }
    return found


def _first(lines: Mapping[str, Mapping[str, list[Any]]]) -> str:
    """The experiment with the least probable observation: what is shown before one is marked."""

    def far(one: str) -> float:
        away = np.abs(numbers(lines[one].get("pit", [])) - 0.5)
        return float(np.nanmax(away, initial=0.0))

    return max(lines, key=far)


def _all(seen: Measured, name: str, number: int, lines: Mapping[str, Any]) -> Chart:
    plot = axes(name, seen.label, height=360, log_y=seen.log)
    source = shared(
        {
            "id": list(lines),
            "x": [line["x"] for line in lines.values()],
            "y": [line["value"] for line in lines.values()],
        },
        name=f"series-{number}",
    )
    drawn = plot.multi_line("x", "y", source=source, color=colors.LINE, line_width=1.2,
                            line_alpha=0.7)  # fmt: skip
    drawn.selection_glyph = drawn.glyph.clone(
        line_color=colors.PICKED, line_width=3.0, line_alpha=1.0
    )
    plot.add_tools(
        models.HoverTool(renderers=[drawn], tooltips=[("experiment", "@id")]),
        models.TapTool(renderers=[drawn]),
    )
    few = "" if len(lines) == len(set(seen.columns["id"])) else f" {len(lines)} are drawn."
    return Chart(
        source.name, f"All series of {seen.response}",
        f"A line for each experiment; click one to see it beside.{few}", plot, source,
        {"id": "id", "x": name, "y": seen.response},
    )  # fmt: skip


def _marked(seen: Measured, name: str, number: int, lines: Mapping[str, Any], one: str) -> Chart:
    plot = axes(name, seen.label, height=360, log_y=seen.log, title=one)
    plot.title.text_color = colors.TEXT
    line = lines[one]
    source = shared({"id": [one] * len(line["x"]), **line}, name=f"marked-{number}", tags=[lines])
    if "q0.025" in line:
        plot.varea("x", "q0.025", "q0.975", source=source, color=colors.BAND,
                   legend_label="law, 95 %")  # fmt: skip
    plot.varea("x", "own_low", "own_high", source=source, color=colors.WIDE, fill_alpha=0.7,
               legend_label="errors, 95 %")  # fmt: skip
    plot.line("x", "own", source=source, color=colors.BLUE, line_width=2.0,
              legend_label="its own")  # fmt: skip
    points(plot, source, "x", "value", told(seen)[:4], legend_label="measured")
    legend_below(plot)
    return Chart(
        source.name, "The marked experiment",
        "Gray: where the law expects measurements of an experiment of which nothing is known. "
        "Blue: the prediction with its own parameters, and the range of measurement errors.",
        plot, source,
        {"id": "id", "x": name, "value": seen.response, "own": "own prediction",
         "q0.025": "law 0.025", "q0.5": "law 0.5", "q0.975": "law 0.975"},
    )  # fmt: skip
