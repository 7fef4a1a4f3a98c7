"""Charts drawn with Bokeh for report.html, with tooltips and with marks that a click selects."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import bokeh.models
import bokeh.plotting
import numpy as np
from bokeh.document import Document

from aleator.views import chart as colors
from aleator.views.chart import CHARTS, Axis, Chart, GuideLine, Mark, Series, looks, meaning

# The type hints of Bokeh lack arguments that it takes.
models: Any = bokeh.models
plotting: Any = bokeh.plotting
Sources = dict[int, Any]


@dataclass(frozen=True)
class BokehSettings:
    """Settings of charts that Bokeh draws, in pixels. The values are chosen by judgement, by eye.

    row: the number of entries in a row of a legend, for narrow screens. border: room on the right
    for half of the last number under the axis. picked: width of the line about a marked experiment.
    scale: width of the scale of colors beside a map. top: the end of an axis on the right, over
    its largest value.
    """

    row: int = 4
    border: int = 14
    picked: float = 3.5
    scale: int = 12
    top: float = 1.15


BOKEH = BokehSettings()
PALETTE = "Cividis256"
TOOLS = "pan,box_zoom,wheel_zoom,reset"
TEX = re.compile(r'\[(?:\{start:"[^"]+",end:"[^"]+",inline:![01]\},?)+\]')
"""A pattern for the part of Bokeh's script that lists the delimiters of TeX in labels."""
RENDERER = re.compile(r"https://cdn\.jsdelivr\.net/npm/mathjax[^\"]*")
"""A pattern for the address from which Bokeh would load a renderer of TeX."""
ID = re.compile(r'"id":"(p[0-9]+)"')


def drawable(charts: Iterable[Chart]) -> dict[str, Any]:
    """The argument of Bokeh's `embed_items`: one document with all charts, and the place of each.

    The objects of Bokeh are numbered from 1, so that the same charts give the same text.
    """
    sources: Sources = {}
    plots = {chart.name: drawn(chart, sources) for chart in charts}
    document = Document()
    with document.models.freeze():  # Otherwise Bokeh would visit all objects for each chart.
        for plot in plots.values():
            document.add_root(plot)
    text = json.dumps(document.to_json(deferred=False), separators=(",", ":"))
    numbers = {name: f"m{k}" for k, name in enumerate(dict.fromkeys(ID.findall(text)), start=1)}
    text = ID.sub(lambda match: f'"id":"{numbers[match[1]]}"', text)
    places = {numbers[plot.id]: f"plot-{name}" for name, plot in plots.items()}
    return {"documents": {"report": json.loads(text)}, "places": places}


def bokeh_script() -> str:
    """Bokeh's JavaScript from its package, changed so that it treats no text as TeX.

    To show TeX, the script would load another script from a public address.
    """
    script = (files("bokeh") / "server/static/js/bokeh.min.js").read_text(encoding="utf-8")
    return RENDERER.sub("data:,", TEX.sub("[]", script))


# ------------------------------------------------------------------------------------ a chart


def drawn(chart: Chart, sources: Sources) -> Any:
    """The Bokeh plot of a chart.

    `sources` collects the data objects of Bokeh, so that charts with the same series share one.
    """
    plot = axes(chart.x, chart.y, chart.height)
    if chart.marked:
        plot.title.text, plot.title.text_color = chart.marked, colors.TEXT
    for mark in chart.marks:
        if mark.right:
            _right(plot, mark, chart.right)
        _SHAPES[mark.shape](plot, mark, _source(mark.series, sources))
    for rule in chart.rules:
        straight(plot, rule)
    if chart.foot:
        plot.y_range.start = 0.0
    for mark in chart.marks:
        if mark.marker in mark.series.columns:
            for color, marker in looks(mark):
                plot.scatter([np.nan], [np.nan], marker=marker, color=color,
                             legend_label=meaning(color, marker))  # fmt: skip
    if plot.legend:
        _legend_below(plot)
    # When a reader marks an experiment, all else keeps its look; Bokeh would fade it.
    for renderer in plot.renderers:
        if hasattr(renderer, "nonselection_glyph"):
            renderer.nonselection_glyph = None
    return plot


def axes(x: Axis, y: Axis, height: int = 320) -> Any:
    """A Bokeh plot of this height in pixels, with labeled axes and no data."""
    plot = plotting.figure(
        height=height, sizing_mode="stretch_width", tools=TOOLS, active_drag=None,
        active_scroll=None, toolbar_location="above", x_axis_label=x.title, y_axis_label=y.title,
        y_axis_type="log" if y.log else "linear", background_fill_color=colors.PAPER,
        border_fill_color=colors.PAPER, outline_line_color=None,
    )  # fmt: skip
    plot.min_border_right = BOKEH.border
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    for axis in plot.axis:
        _style(axis)
    for grid in plot.grid:
        grid.grid_line_color = colors.GRID
    if y.share:
        plot.yaxis.formatter = models.NumeralTickFormatter(format="0.[0000] %")
    if y.log:
        plot.yaxis.ticker = plot.ygrid.ticker = models.LogTicker(mantissas=[1, 2, 5])
    return plot


def straight(plot: Any, rule: GuideLine) -> None:
    """Draw a horizontal or vertical line through the plot."""
    plot.add_layout(
        models.Span(
            location=rule.at, dimension="width" if rule.across else "height",
            line_color=rule.color, line_dash="dashed" if rule.color == colors.GRAY else "solid",
        )
    )  # fmt: skip


def _style(axis: Any) -> None:
    axis.axis_line_color = colors.LINE
    axis.major_tick_line_color = colors.LINE
    axis.minor_tick_line_color = None
    axis.major_label_text_color = colors.TEXT
    axis.axis_label_text_color = colors.TEXT
    axis.axis_label_text_font_style = "normal"
    axis.axis_label_text_font_size = "13px"
    axis.major_label_text_font_size = "12px"


def _source(series: Series, sources: Sources) -> Any:
    """The data object of Bokeh for a series; all charts with the series share this object."""
    if id(series) not in sources:
        each = [] if series.each is None else [series.each]
        columns = {
            name: column.tolist() if isinstance(column, np.ndarray) else list(column)
            for name, column in series.columns.items()
        }
        sources[id(series)] = models.ColumnDataSource(columns, name=series.name, tags=each)
    return sources[id(series)]


def _legend_below(plot: Any) -> None:
    """Put the legend of a plot under its axes, where it hides no data."""
    legend = plot.legend[0]
    plot.add_layout(legend, "below")
    legend.orientation = "horizontal"
    legend.ncols = "auto" if len(legend.items) <= BOKEH.row else 3
    legend.border_line_color = None
    legend.background_fill_color = None
    legend.label_text_color = colors.TEXT
    legend.label_text_font_size = "12px"
    legend.padding, legend.margin, legend.spacing = 2, 0, 10


# ------------------------------------------------------------------------------------ shapes


def _line(plot: Any, mark: Mark, source: Any) -> None:
    plot.line(mark.x, mark.y, source=source, line_width=mark.width, line_dash=mark.dash,
              **_look(mark))  # fmt: skip


def _lines(plot: Any, mark: Mark, source: Any) -> None:
    look = {"legend_group": mark.legend_by} if mark.legend_by else {}
    found = plot.multi_line(mark.x, mark.y, source=source, line_width=mark.width,
                            line_dash=mark.dash, **_look(mark), **look)  # fmt: skip
    if mark.legend_by:  # The legend follows the order of the rows, not the alphabet.
        plot.legend[0].items.sort(key=lambda item: item.index)
    if mark.pick:
        found.selection_glyph = found.glyph.clone(
            line_color=colors.PICKED, line_width=BOKEH.picked, line_alpha=1.0
        )
        _answers(plot, found, mark, snap=False)


def _band(plot: Any, mark: Mark, source: Any) -> None:
    plot.varea(mark.x, mark.y, mark.high, source=source, fill_alpha=mark.alpha,
               **_look(mark, ("color", "legend_label")))  # fmt: skip


def _spans(plot: Any, mark: Mark, source: Any) -> None:
    on = {"y_range_name": "right"} if mark.right else {}
    plot.segment(mark.x, mark.y, mark.x, mark.high, source=source, line_width=mark.width,
                 **_look(mark), **on)  # fmt: skip


def _bars(plot: Any, mark: Mark, source: Any) -> None:
    plot.vbar(mark.x, mark.width, mark.y, source=source, **_look(mark))


def _points(plot: Any, mark: Mark, source: Any) -> None:
    stroked = mark.marker in ("dash", "tick", "cross", "x")
    upright = {"angle": 0.5 * np.pi} if mark.marker == "tick" else {}
    found = plot.scatter(
        mark.x, mark.y, source=source, marker="dash" if mark.marker == "tick" else mark.marker,
        size=mark.size, line_width=mark.width, **upright, **_look(mark),
        **({} if stroked else {"line_color": None}),
    )  # fmt: skip
    if not stroked and mark.alpha < 1.0:
        found.glyph.fill_alpha = mark.alpha
    if mark.pick:
        line = colors.PICKED if stroked else colors.INK
        found.selection_glyph = found.glyph.clone(
            fill_color=colors.PICKED, fill_alpha=1.0, line_color=line, size=CHARTS.tick,
            line_width=BOKEH.picked if stroked else CHARTS.thin,
        )  # fmt: skip
    if mark.hover:
        _answers(plot, found, mark)


def _cells(plot: Any, mark: Mark, source: Any) -> None:
    mapper = models.LinearColorMapper(palette=PALETTE, nan_color="rgba(0, 0, 0, 0)")
    look = {"line_color": None, "fill_color": {"field": "value", "transform": mapper}}
    width, height = mark.step
    found = plot.rect(mark.x, mark.y, width=width, height=height, source=source, **look)
    bar = models.ColorBar(color_mapper=mapper, background_fill_color=None, width=BOKEH.scale,
                          major_label_text_color=colors.TEXT)  # fmt: skip
    plot.add_layout(bar, "right")
    plot.add_tools(models.HoverTool(renderers=[found], tooltips=_tooltips(mark)))


def _contour(plot: Any, mark: Mark, _: Any) -> None:
    if mark.grid is None:
        return
    x, y, height = mark.grid
    tall = max(float(np.nanmax(height)), mark.levels[-1] + 1.0)
    plot.contour(
        x, y, height, [0.0, *mark.levels, tall], fill_color=list(colors.HEIGHTS),
        line_color=mark.color, line_width=[0.0, *[1.0] * (len(mark.levels) - 1), 2.0, 0.0],
    )  # fmt: skip


_SHAPES = {
    "line": _line, "lines": _lines, "band": _band, "spans": _spans, "bars": _bars,
    "points": _points, "cells": _cells, "contour": _contour,
}  # fmt: skip


def _look(mark: Mark, of: tuple[str, ...] = ("color", "alpha", "legend_label")) -> dict[str, Any]:
    known: Mapping[str, Any] = {
        "color": mark.color,
        "alpha": mark.alpha if mark.alpha < 1.0 else None,
        "legend_label": mark.legend,
    }
    return {name: known[name] for name in of if known[name] not in ("", None)}


def _answers(plot: Any, renderer: Any, mark: Mark, snap: bool = True) -> None:
    """Add the tooltip of a mark; if `mark.pick`, a click marks the experiment in every chart."""
    more = {"point_policy": "snap_to_data"} if snap else {}
    plot.add_tools(models.HoverTool(renderers=[renderer], tooltips=_tooltips(mark), **more))
    if not mark.pick:
        return
    tap = plot.select_one(models.TapTool)
    if tap is None:
        plot.add_tools(models.TapTool(renderers=[renderer]))
    else:
        tap.renderers = [*tap.renderers, renderer]


def _tooltips(mark: Mark) -> list[tuple[str, str]]:
    """The tooltips of a mark in the notation of Bokeh: @ before a column, a format after a share.

    A share is a number that is shown in percent.
    """
    return [
        (title, words.replace("{", "@{").replace(":%}", "}{0.[0000] %}"))
        for title, words in mark.hover
    ]


def _right(plot: Any, mark: Mark, axis: Axis | None) -> None:
    """Add an axis on the right, which begins at zero, as the scale of a mark."""
    plot.y_range.renderers = list(plot.renderers)  # The mark must not extend the left axis.
    top = BOKEH.top * float(np.max(mark.array("high")))
    plot.extra_y_ranges = {"right": models.Range1d(0.0, top)}
    scale = models.LinearAxis(y_range_name="right", axis_label=axis.title if axis else "")
    _style(scale)
    plot.add_layout(scale, "right")
