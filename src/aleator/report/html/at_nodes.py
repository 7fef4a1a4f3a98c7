"""The simulator where collocation ran it: a mark for each node of the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, fewer_ticks, models, points, shared
from aleator.report.html.rows import numbers
from aleator.results.units import label

Document = Mapping[str, Any]
PALETTE = "Cividis256"


def at_nodes(
    document: Document,
    response: str,
    nodes: Mapping[str, Sequence[float]],
    shown: Sequence[Document],
    number: int,
) -> list[Chart]:
    """A chart over each parameter, and one over the first two.

    `nodes` are the values of each parameter at the nodes, and each entry of `shown` has the
    `values` of the response there.
    """
    charts = [_over(document, response, name, nodes[name], shown, number) for name in nodes]
    return charts + ([_map(document, response, nodes, shown)] if len(nodes) > 1 else [])


def measured_of(entry: Document) -> float | None:
    """What was measured of an observation; of a bound, that."""
    low: float | None = entry["lower"]
    high: float | None = entry["upper"]
    return high if low is None else low


def _over(
    document: Document,
    response: str,
    name: str,
    at: Sequence[float],
    shown: Sequence[Document],
    number: int,
) -> Chart:
    log = document.get("transform") == "log"
    plot = axes(label(document, name), label(document, response), log_y=log)
    values = np.concatenate([numbers(entry["values"]) for entry in shown])
    if log:
        fewer_ticks(plot, values)
    repeated = {"id": [entry["id"] for entry in shown], "measured": [*map(measured_of, shown)]}
    columns = {key: np.repeat(np.array(own, object), len(at)).tolist()
               for key, own in repeated.items()}  # fmt: skip
    source = shared(
        {**columns, "x": [*at] * len(shown), "y": values.tolist()}, f"over-{number}-{name}"
    )
    told = [("experiment", "@id"), (name, "@x"), (response, "@y"), ("measured", "@measured")]
    points(plot, source, "x", "y", told, color=colors.BLUE, size=5.0)
    return Chart(
        source.name, f"{response} over {name}",
        "What the simulator returned at the nodes of the law, for some experiments. The other "
        "parameters differ from mark to mark.",
        plot, source, {"id": "id", "x": name, "y": response, "measured": "measured"},
    )  # fmt: skip


def _map(
    document: Document,
    response: str,
    nodes: Mapping[str, Sequence[float]],
    shown: Sequence[Document],
) -> Chart:
    (first, x), (second, y) = list(nodes.items())[:2]
    here = shown[len(shown) // 2]["id"]
    plot = axes(label(document, first), label(document, second), title=here)
    plot.title.text_color = colors.TEXT
    runs = {entry["id"]: {"value": numbers(entry["values"]).tolist()} for entry in shown}
    name = f"map-{response}"
    columns = {"id": [here] * len(x), "x": [*x], "y": [*y], **runs[here]}
    source = shared(columns, name, tags=[runs])
    mapper = models.LinearColorMapper(palette=PALETTE, nan_color="rgba(0, 0, 0, 0)")
    drawn = plot.scatter("x", "y", source=source, size=9.0, line_color=None,
                         fill_color={"field": "value", "transform": mapper})  # fmt: skip
    bar = models.ColorBar(color_mapper=mapper, background_fill_color=None, width=12,
                          major_label_text_color=colors.TEXT)  # fmt: skip
    plot.add_layout(bar, "right")
    told = [(first, "@x"), (second, "@y"), (response, "@value")]
    plot.add_tools(models.HoverTool(renderers=[drawn], tooltips=told))
    return Chart(
        name, f"{response} over {first} and {second}",
        f"Color: {label(document, response)} that the simulator returned for the experiment that "
        f"is marked, if it is one of {', '.join(runs)}.",
        plot, source, {"id": "id", "x": first, "y": second, "value": response},
    )  # fmt: skip
