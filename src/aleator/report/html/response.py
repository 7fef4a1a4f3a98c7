"""The simulator over its parameters: curves of some experiments, and a map of one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import contourpy
import numpy as np

from aleator.report.html import colors
from aleator.report.html.at_nodes import at_nodes, measured_of
from aleator.report.html.chart import Chart, axes, fewer_ticks, legend_below, models, shared
from aleator.report.html.markup import side_by_side
from aleator.report.html.rows import numbers
from aleator.results.units import label
from aleator.types import Array

Document = Mapping[str, Any]
PALETTE = "Cividis256"
WIDER = 1.15
"""Size of a cell of the map over the step to the next: no seams."""
DASHES = {"first": "dotted", "middle": "dashed", "last": "solid"}
"""How lines of rows of a series are drawn, by their place in it."""


def simulated(document: Document) -> Iterator[str | Chart]:
    """Charts of each response: what is known of the simulator over its parameters."""
    found = (document.get("pictures") or {}).get("response") or {}
    names = dict.fromkeys(entry["response"] for entry in found.get("shown", ()))
    for number, response in enumerate(names):
        shown = [entry for entry in found["shown"] if entry["response"] == response]
        if "nodes" in found:
            yield from side_by_side(*at_nodes(document, response, found["nodes"], shown, number))
            continue
        failed = _failed(document, number)
        charts = [
            _curves(document, response, name, numbers(at), shown, number)
            for name, at in found["over"].items()
        ]
        places = dict.fromkeys(_place(entry) for entry in shown) if found["map"] else ()
        charts += [_map(document, response, found["map"], shown, failed, place) for place in places]
        yield from side_by_side(*charts)


def _place(entry: Document) -> str:
    """Where in its series an observation is; the last one in documents of earlier versions."""
    return str(entry.get("place", "last"))


def _failed(document: Document, number: int) -> Any | None:
    """Where runs failed, for the charts of a response."""
    points = (document.get("failures") or {}).get("points") or {}
    return shared(points, f"failed-{number}") if points else None


def _curves(
    document: Document,
    response: str,
    name: str,
    at: Array,
    shown: Sequence[Document],
    number: int,
) -> Chart:
    log = (document.get("responses") or {}).get(response, document.get("transform")) == "log"
    plot = axes(label(document, name), label(document, response), log_y=log)
    curves = [numbers(entry["curves"][name]) for entry in shown]
    if log:
        fewer_ticks(plot, np.concatenate(curves))
    source = shared(
        {
            "id": [entry["id"] for entry in shown],
            "x": [at.tolist()] * len(shown),
            "y": [curve.tolist() for curve in curves],
            "measured": [measured_of(entry) for entry in shown],
            "row": [f"{_place(entry)} row" for entry in shown],
            "dash": [DASHES[_place(entry)] for entry in shown],
        },
        f"over-{number}-{name}",
    )
    several = len(set(source.data["row"])) > 1
    drawn = plot.multi_line(
        "x", "y", source=source, color=colors.BLUE, line_width=1.5, line_dash="dash",
        **({"legend_group": "row"} if several else {}),
    )  # fmt: skip
    if several:
        legend_below(plot)
        plot.legend[0].items.sort(key=lambda item: item.index)  # as rows follow, not as words do
    drawn.selection_glyph = drawn.glyph.clone(line_color=colors.PICKED, line_width=3.5)
    plot.add_tools(
        models.HoverTool(
            renderers=[drawn],
            tooltips=[("experiment", "@id"), *([("", "@row")] if several else []),
                      ("measured", "@measured")],
        ),
        models.TapTool(renderers=[drawn]),
    )  # fmt: skip
    return Chart(
        source.name, f"{response} over {name}",
        "What stands for the simulator, a line for each of some experiments, over the range of the "
        "law; all other parameters are in their middle."
        + (" Of a series: its first, middle and last row." if several else ""),
        plot, source,
        {"id": "id", **({"row": "row"} if several else {}), "x": name, "y": response,
         "measured": "measured"},
    )  # fmt: skip


def _map(
    document: Document,
    response: str,
    sides: Mapping[str, Sequence[float]],
    entries: Sequence[Document],
    failed: Any | None,
    place: str,
) -> Chart:
    """Of the rows that have this place in their series."""
    shown = [entry for entry in entries if _place(entry) == place]
    row = "" if len(shown) == len(entries) else f"-{place}"
    (first, x), (second, y) = ((name, numbers(side)) for name, side in sides.items())
    here = shown[len(shown) // 2]
    plot = axes(label(document, first), label(document, second), title=here["id"])
    plot.title.text_color = colors.TEXT
    cells = np.meshgrid(x, y, indexing="ij")
    grid = {"x": cells[0].ravel().tolist(), "y": cells[1].ravel().tolist()}
    planes = {entry["id"]: {"value": numbers(np.ravel(entry["map"]).tolist()).tolist()}
              for entry in shown}  # fmt: skip
    name = f"map-{response}{row}"
    source = shared({"id": [here["id"]] * cells[0].size, **grid, **planes[here["id"]]}, name,
                    tags=[planes])  # fmt: skip
    mapper = models.LinearColorMapper(palette=PALETTE, nan_color="rgba(0, 0, 0, 0)")
    drawn = plot.rect(
        "x", "y", width=WIDER * (x[1] - x[0]), height=WIDER * (y[1] - y[0]), source=source,
        line_color=None, fill_color={"field": "value", "transform": mapper},
    )  # fmt: skip
    levels = {entry["id"]: _level(x, y, entry) for entry in shown}
    line = shared({"id": [here["id"]] * len(levels[here["id"]]["x"]), **levels[here["id"]]},
                  f"level-{response}{row}", tags=[levels])  # fmt: skip
    plot.multi_line("x", "y", source=line, color=colors.PAPER, line_width=5.0)
    plot.multi_line("x", "y", source=line, color=colors.INK, line_width=2.5)
    if failed is not None:
        for color, width in ((colors.PAPER, 6.0), (colors.VERMILION, 2.5)):
            plot.scatter(first, second, source=failed, marker="x", size=9, color=color,
                         line_width=width)  # fmt: skip
    plot.add_layout(
        models.ColorBar(
            color_mapper=mapper, background_fill_color=None, width=12,
            major_label_text_color=colors.TEXT,
        ),
        "right",
    )  # fmt: skip
    plot.add_tools(
        models.HoverTool(
            renderers=[drawn], tooltips=[(first, "@x"), (second, "@y"), (response, "@value")]
        )
    )
    return Chart(
        name, f"{response} over {first} and {second}{row and f', {place} row'}",
        f"Color: {label(document, response)} of the experiment that is marked, if it is one of "
        f"{', '.join(planes)}. On the line lies what was measured."
        + (" Crosses: failed runs of all experiments." if failed else ""),
        plot, source, {"id": "id", "x": first, "y": second, "value": response},
    )  # fmt: skip


def _level(x: Array, y: Array, entry: Document) -> dict[str, list[list[float]]]:
    """The curve of the map on which the measured value lies; none for a map without it."""
    measured = measured_of(entry)
    plane = np.array([numbers(row) for row in entry["map"]])
    if measured is None:
        return {"x": [], "y": []}
    lines: Any = contourpy.contour_generator(x, y, np.ma.masked_invalid(plane.T)).lines(measured)
    return {"x": [line[:, 0].tolist() for line in lines],
            "y": [line[:, 1].tolist() for line in lines]}  # fmt: skip
