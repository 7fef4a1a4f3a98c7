"""Measured against predicted: each outcome in the distribution that the law predicts for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, legend_below, points, shared
from aleator.report.html.markup import Section, missing
from aleator.report.html.rows import Measured
from aleator.results.printed import outside as independent

MARKS = {
    "circle": ("measured", colors.INK),
    "diamond": ("outside 95 %", colors.VERMILION),
    "triangle": ("at least", colors.GREEN),
    "inverted_triangle": ("at most", colors.GREEN),
    "square": ("between", colors.GREEN),
}
"""What marks mean."""
CONDITIONS = 6
"""Conditions that are told when the mouse is over a mark."""


def predicted(all_measured: Sequence[Measured], sources: Sequence[Any]) -> Section:
    """A chart for each response."""
    parts: list[Any] = []
    for seen, source in zip(all_measured, sources, strict=True):
        if "q0.5" not in seen.columns:
            parts.append(
                missing(
                    f"Predictions of {seen.response} by the law are not in this document.",
                    "Identify again with this version: aleator identify writes them.",
                )
            )
            continue
        parts.append(_chart(seen, source))
    return Section.of("predicted", "Measured against predicted", *parts)


def source_of(seen: Measured, number: int) -> Any:
    """The thinned rows of a response, which all charts share."""
    thin = seen.thinned()
    columns: dict[str, Any] = dict(thin.columns)
    columns["x"] = list(columns["order"])
    if "q0.5" in columns:
        low, high = thin.array("q0.025"), thin.array("q0.975")
        value = thin.array("value")
        exact = np.array([kind == "measured" for kind in thin.columns["kind"]])
        with np.errstate(invalid="ignore"):
            outside = exact & ((value < low) | (value > high))
        columns["color"] = np.where(
            ~exact, colors.GREEN, np.where(outside, colors.VERMILION, colors.INK)
        ).tolist()
        columns["marker"] = [
            _marker(kind, out) for kind, out in zip(thin.columns["kind"], outside, strict=True)
        ]
        columns["size"] = np.where(outside | ~exact, 10.0, 6.0).tolist()
    return shared(columns, f"measured-{number}")


def _marker(kind: str, outside: bool) -> str:
    shapes = {"at least": "triangle", "at most": "inverted_triangle", "between": "square"}
    return shapes.get(kind, "diamond" if outside else "circle")


def told(seen: Measured) -> list[tuple[str, str]]:
    """What hovering says of an outcome."""
    found = [("experiment", "@id"), (seen.label, "@value (@kind)")]
    if "q0.5" in seen.columns:
        found += [("predicted median", "@{q0.5}"), ("95 %", "@{q0.025} .. @{q0.975}")]
    if "own" in seen.columns:
        found.append(("individual prediction", "@own"))
    found.append(("P(below)", "@pit"))
    conditions = [axis for axis in seen.axes if axis.key.startswith("c")]
    return found + [(axis.title, f"@{axis.key}_shown") for axis in conditions[:CONDITIONS]]


def _chart(seen: Measured, source: Any) -> Chart:
    plot = axes(seen.axes[0].title, seen.label, height=400, log_y=seen.log)
    wide = float(np.clip(500.0 / max(len(seen), 1), 1.5, 12.0))
    for low, high, color, name in (
        ("q0.025", "q0.975", colors.WIDE, "95 %"),
        ("q0.25", "q0.75", colors.NARROW, "50 %"),
    ):
        plot.segment("x", low, "x", high, source=source, color=color, line_width=wide,
                     legend_label=name)  # fmt: skip
    plot.scatter("x", "q0.5", source=source, marker="dash", size=wide + 3.0, color=colors.BLUE,
                 line_width=2.0, legend_label="median")  # fmt: skip
    points(plot, source, "x", "value", told(seen), color="color", marker="marker", size="size")
    _explained(plot, set(source.data["marker"]))
    legend_below(plot)
    return Chart(
        source.name, seen.response, _caption(seen, source), plot, source,
        {"id": "id", "x": "x", "value": seen.response, "kind": "kind"}
        | {f"q{p}": f"predicted {p}" for p in ("0.025", "0.25", "0.5", "0.75", "0.975")}
        | {"pit": "P(below)"}
        | {f"{axis.key}_shown": axis.title for axis in seen.axes if axis.key.startswith("c")},
        switched=True,
    )  # fmt: skip


def _explained(plot: Any, markers: set[str]) -> None:
    """The marks that are drawn, each with its word in the legend."""
    for marker, (word, color) in MARKS.items():
        if marker in markers:
            plot.scatter([np.nan], [np.nan], marker=marker, color=color, size=8.0,
                         legend_label=word)  # fmt: skip


def _caption(seen: Measured, source: Any) -> str:
    low, high, value = (seen.array(key) for key in ("q0.025", "q0.975", "value"))
    exact = np.array([kind == "measured" for kind in seen.columns["kind"]])
    known = exact & np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore"):
        outside = int(np.sum(known & ((value < low) | (value > high))))
    text = f"Outside the predicted 95 % are {outside} of {int(known.sum()):,} (diamonds). "
    pit = seen.array("pit")
    pit = pit[exact & np.isfinite(pit)]
    if pit.size:
        # each given the earlier ones: those of the diamonds are not independent
        text += "Given the earlier observations of its experiment, " + independent(pit.tolist())
    if not exact.all():
        text += " Triangles are bounds: the value lies above, or below."
    drawn = len(source.data["id"])
    if drawn < len(seen):
        text += f" {drawn} of {len(seen):,} are drawn, those farthest out among them."
    return text
