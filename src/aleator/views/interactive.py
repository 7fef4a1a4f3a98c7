"""Charts as models of Bokeh for report.html, with tooltips and with marks that a click selects.

The models are the plain data that Bokeh's script reads. Bokeh's own classes, which would write the
same, take longer than a small identification; they read these data in `tests/views/test_page.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import pairwise
from typing import Any

import bokeh
import numpy as np

from aleator.views import chart as colors
from aleator.views.chart import CHARTS, Axis, Chart, GuideLine, Mark, Series, looks, meaning

Data = dict[str, Any]


@dataclass(frozen=True, eq=False)
class BokehModel:
    """A model of Bokeh: the name of its class, and the attributes that are not the defaults."""

    name: str
    attributes: Data = field(default_factory=dict)


Sources = dict[int, BokehModel]


@dataclass(frozen=True)
class BokehSettings:
    """Settings of charts that Bokeh draws, in pixels. The values are chosen by judgement, by eye.

    row: the width of a row of a legend, on narrow screens. entry: that of an entry without its
    text, and letter that of one letter of it. tall: the height of an entry. border: room on the
    right for half of the last number under the axis. picked: width of the line about a marked
    experiment. scale: width of the scale of colors beside a map. top: the end of an axis on the
    right, over its largest value.
    """

    row: int = 330
    entry: int = 42
    letter: float = 6.5
    tall: int = 14
    border: int = 14
    picked: float = 3.5
    scale: int = 12
    top: float = 1.15


BOKEH = BokehSettings()
TEX = re.compile(r'\[(?:\{start:"[^"]+",end:"[^"]+",inline:![01]\},?)+\]')
"""A pattern for the part of Bokeh's script that lists the delimiters of TeX in labels."""
RENDERER = re.compile(r"https://cdn\.jsdelivr\.net/npm/mathjax[^\"]*")
"""A pattern for the address from which Bokeh would load a renderer of TeX."""
LOG_TICKS = """
const low = Math.min(cb_data.start, cb_data.end), high = Math.max(cb_data.start, cb_data.end);
const decades = Math.log10(high / low), ticks = [];
if (!(low > 0 && decades > 0)) return ticks;
if (decades < 1) {
  const wanted = (high - low) / 6, size = 10 ** Math.floor(Math.log10(wanted));
  const step = size * [1, 2, 5, 10].find((digit) => digit * size >= wanted);
  for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step);
  return ticks;
}
const digits = decades > 4 ? [1] : [1, 2, 5], every = Math.ceil(decades / 12);
for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++)
  for (const digit of k % every ? [] : digits) ticks.push(Number(`${digit}e${k}`));
return ticks.filter((tick) => tick >= low && tick <= high);
"""
"""The ticks of a logarithmic axis: 1-2-5 in each decade, of many decades their ends only.

Within one decade they are evenly spaced. Bokeh's own are evenly spaced below two decades, which
leaves the lower half of the axis without a number.
"""
DASHES = {"solid": [], "dashed": [6], "dotted": [2, 4], "dashdot": [6, 3, 2, 3]}


def drawable(charts: Iterable[Chart]) -> Data:
    """The argument of Bokeh's `embed_items`: one document with all charts, and the place of each.

    The models are numbered from 1, so that the same charts give the same text.
    """
    sources: Sources = {}
    known: dict[BokehModel, str] = {}
    plots = {chart.name: drawn(chart, sources) for chart in charts}
    roots = [encoded(plot, known) for plot in plots.values()]
    document = {
        "version": bokeh.__version__, "title": "Charts",
        "config": encoded(BokehModel("DocumentConfig"), known), "roots": roots,
    }  # fmt: skip
    places = {known[plot]: f"plot-{name}" for name, plot in plots.items()}
    return {"documents": {"report": document}, "places": places}


def encoded(value: Any, known: dict[BokehModel, str]) -> Any:
    """A value as JSON data; a model that is `known` already as a reference to its number."""
    if isinstance(value, BokehModel):
        if value in known:
            return {"id": known[value]}
        known[value] = f"m{len(known) + 1}"
        own = {"type": "object", "name": value.name, "id": known[value]}
        return own | {"attributes": encoded(value.attributes, known)}
    if isinstance(value, dict):
        return {key: encoded(each, known) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(each, known) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return encoded(value.tolist(), known)
    if isinstance(value, float) and not np.isfinite(value):
        return {"type": "number", "value": "nan" if np.isnan(value) else f"{value:+}"}
    return value


def bokeh_script() -> str:
    """Bokeh's JavaScript from its package, changed so that it treats no text as TeX.

    To show TeX, the script would load another script from a public address.
    """
    script = (files("bokeh") / "server/static/js/bokeh.min.js").read_text(encoding="utf-8")
    return RENDERER.sub("data:,", TEX.sub("[]", script))


# ------------------------------------------------------------------------------------ a chart


@dataclass(frozen=True, eq=False)
class Plot:
    """The parts of a plot: its axes, what is drawn, tools, and what lies on the right of the frame.

    `center` has grids and straight lines, `legend` its entries, and `extra` a range for an axis on
    the right.
    """

    x: BokehModel
    y: BokehModel
    y_range: BokehModel = field(default_factory=lambda: BokehModel("DataRange1d"))
    renderers: list[BokehModel] = field(default_factory=list)
    tools: list[BokehModel] = field(default_factory=list)
    right: list[BokehModel] = field(default_factory=list)
    center: list[BokehModel] = field(default_factory=list)
    legend: list[BokehModel] = field(default_factory=list)
    extra: Data = field(default_factory=dict)

    def glyph(self, source: BokehModel, glyph: BokehModel, mark: Mark | None = None) -> BokehModel:
        """Draw a glyph of a source; with the legend and the axis of a mark."""
        # When a reader marks an experiment, all else keeps its look; Bokeh would fade it.
        has: Data = {"data_source": source, "glyph": glyph, "nonselection_glyph": None}
        if mark is not None and mark.right:
            has["y_range_name"] = "right"
        renderer = BokehModel("GlyphRenderer", has)
        self.renderers.append(renderer)
        if mark is not None and mark.legend:
            self.named(mark.legend, renderer)
        return renderer

    def named(self, text: str, renderer: BokehModel) -> None:
        """Add a renderer to the entry of the legend with this text."""
        for item in self.legend:
            if item.attributes["label"] == _value(text):
                item.attributes["renderers"].append(renderer)
                return
        self.legend.append(
            BokehModel("LegendItem", {"label": _value(text), "renderers": [renderer]})
        )


def drawn(chart: Chart, sources: Sources) -> BokehModel:
    """The figure of a chart.

    `sources` collects the data of Bokeh, so that charts with the same series share them.
    """
    plot = Plot(axis(chart.x), axis(chart.y))
    for mark in chart.marks:
        if mark.right:
            _right(plot, mark, chart.right)
        _SHAPES[mark.shape](plot, mark, _source(mark.series, sources))
    for k, own in enumerate((plot.x, plot.y)):
        look: Data = {"dimension": k, "axis": own, "grid_line_color": colors.GRID}
        if own.name == "LogAxis":
            look["ticker"] = own.attributes["ticker"]
        plot.center.insert(k, BokehModel("Grid", look))
    plot.center.extend(map(straight, chart.rules))
    if chart.foot:
        plot.y_range.attributes["start"] = 0.0
    for mark in chart.marks:
        if mark.marker in mark.series.columns:
            for color, marker in looks(mark):
                nowhere = BokehModel(
                    "ColumnDataSource", {"data": _map({"x": [np.nan], "y": [np.nan]})}
                )
                look = {
                    "x": _column("x"), "y": _column("y"), "marker": _value(marker),
                    "line_color": _value(color), "fill_color": _value(color),
                }  # fmt: skip
                renderer = plot.glyph(nowhere, BokehModel("Scatter", look))
                plot.named(meaning(color, marker), renderer)
    return _figure(plot, chart)


def _figure(plot: Plot, chart: Chart) -> BokehModel:
    title = {"text": chart.marked, "text_color": colors.TEXT} if chart.marked else {}
    tools = [
        BokehModel("PanTool"),
        BokehModel("BoxZoomTool", {"dimensions": "both"}),
        BokehModel("WheelZoomTool"),
        BokehModel("ResetTool"),
    ]
    has = {
        "height": chart.height, "sizing_mode": "stretch_width",
        "x_range": BokehModel("DataRange1d"), "y_range": plot.y_range,
        "x_scale": BokehModel("LinearScale"),
        "y_scale": BokehModel("LogScale" if chart.y.log else "LinearScale"),
        "title": BokehModel("Title", title), "renderers": plot.renderers,
        "background_fill_color": colors.PAPER, "border_fill_color": colors.PAPER,
        "outline_line_color": None, "min_border_right": BOKEH.border, "left": [plot.y],
        "right": plot.right, "below": [plot.x, *_legend(plot)], "center": plot.center,
        "toolbar_location": "above",
        "toolbar": BokehModel("Toolbar", {
            "tools": [*tools, *plot.tools], "logo": None, "autohide": True, "active_drag": None,
            "active_scroll": None,
        }),
    }  # fmt: skip
    if plot.extra:
        has["extra_y_ranges"] = _map(plot.extra)
    return BokehModel("Figure", has)


def axis(of: Axis) -> BokehModel:
    """The axis of a plot, with its title and its scale."""
    has = {
        "ticker": BokehModel("CustomJSTicker", {"major_code": LOG_TICKS}) if of.log
        else BokehModel("BasicTicker", {"mantissas": [1, 2, 5]}),
        "formatter": BokehModel("LogTickFormatter" if of.log else "BasicTickFormatter"),
        "axis_label": of.title, "axis_line_color": colors.LINE,
        "major_tick_line_color": colors.LINE, "minor_tick_line_color": None,
        "major_label_text_color": colors.TEXT, "axis_label_text_color": colors.TEXT,
        "axis_label_text_font_style": "normal", "axis_label_text_font_size": "13px",
        "major_label_text_font_size": "12px",
    }  # fmt: skip
    if of.share:
        has["formatter"] = BokehModel("NumeralTickFormatter", {"format": "0.[0000] %"})
    if of.names:
        has["ticker"] = BokehModel("FixedTicker", {"ticks": [at for at, _ in of.names]})
        has["major_label_overrides"] = _map(dict(of.names))
    return BokehModel("LogAxis" if of.log else "LinearAxis", has)


def straight(rule: GuideLine) -> BokehModel:
    """A horizontal or vertical line through the plot."""
    has = {
        "location": rule.at, "dimension": "width" if rule.across else "height",
        "line_color": rule.color,
        "line_dash": DASHES["dashed" if rule.color == colors.GRAY else "solid"],
    }  # fmt: skip
    return BokehModel("Span", has)


def _source(series: Series, sources: Sources) -> BokehModel:
    """The data of a series; all charts with the series share this model."""
    if id(series) not in sources:
        each = series.each
        tags = [] if each is None else [_map({id: _map(own) for id, own in each.items()})]
        columns = {name: list(column) for name, column in series.columns.items()}
        has = {"name": series.name, "tags": tags, "data": _map(columns)}
        sources[id(series)] = BokehModel("ColumnDataSource", has)
    return sources[id(series)]


def _legend(plot: Plot) -> list[BokehModel]:
    """The legend of a plot, which lies under its axes, where it hides no data."""
    if not plot.legend:
        return []
    longest = max(len(str(item.attributes["label"]["value"])) for item in plot.legend)
    width = BOKEH.entry + BOKEH.letter * longest
    has = {
        "items": plot.legend, "orientation": "horizontal",
        "ncols": max(1, int(BOKEH.row / width)), "border_line_color": None,
        "background_fill_color": None, "label_text_color": colors.TEXT,
        "label_text_font_size": "12px", "padding": 2, "margin": 0, "spacing": 10,
        "glyph_height": BOKEH.tall, "label_height": BOKEH.tall,
    }  # fmt: skip
    return [BokehModel("Legend", has)]


def _map(entries: Mapping[Any, Any]) -> Data:
    return {"type": "map", "entries": [[key, each] for key, each in entries.items()]}


def _column(name: str) -> Data:
    return {"type": "field", "field": name}


def _value(each: Any) -> Data:
    return {"type": "value", "value": each}


def _either(name: Any, series: Series) -> Data:
    """A column of a series, if it has one of this name; else the value itself."""
    return _column(name) if name in series.columns else _value(name)


# ------------------------------------------------------------------------------------ shapes


def _line(plot: Plot, mark: Mark, source: BokehModel) -> None:
    has = {
        "x": _column(mark.x), "y": _column(mark.y), "line_color": mark.color,
        "line_width": mark.width, "line_dash": DASHES[mark.dash], "line_alpha": mark.alpha,
    }  # fmt: skip
    plot.glyph(source, BokehModel("Line", has), mark)


def _lines(plot: Plot, mark: Mark, source: BokehModel) -> None:
    has = {
        "xs": _column(mark.x), "ys": _column(mark.y),
        "line_color": _either(mark.color, mark.series),
        "line_width": _either(mark.width, mark.series),
        "line_dash": _either(mark.dash, mark.series), "line_alpha": _value(mark.alpha),
    }  # fmt: skip
    found = plot.glyph(source, BokehModel("MultiLine", has), mark)
    if mark.legend_by:
        words = [str(word) for word in mark.series.columns[mark.legend_by]]
        for word in dict.fromkeys(words):
            label = {"label": _value(word), "renderers": [found], "index": words.index(word)}
            plot.legend.append(BokehModel("LegendItem", label))
    if mark.pick:
        _picked(found, line_color=colors.PICKED, line_width=BOKEH.picked, line_alpha=1.0)
        _answers(plot, found, mark, snap=False)


def _band(plot: Plot, mark: Mark, source: BokehModel) -> None:
    has = {
        "x": _column(mark.x), "y1": _column(mark.y), "y2": _column(mark.high),
        "fill_color": mark.color, "fill_alpha": mark.alpha,
    }  # fmt: skip
    plot.glyph(source, BokehModel("VArea", has), mark)


def _spans(plot: Plot, mark: Mark, source: BokehModel) -> None:
    has = {
        "x0": _column(mark.x), "y0": _column(mark.y), "x1": _column(mark.x),
        "y1": _column(mark.high), "line_color": _either(mark.color, mark.series),
        "line_width": _either(mark.width, mark.series), "line_alpha": _value(mark.alpha),
    }  # fmt: skip
    plot.glyph(source, BokehModel("Segment", has), mark)


def _bars(plot: Plot, mark: Mark, source: BokehModel) -> None:
    color, alpha = _either(mark.color, mark.series), _value(mark.alpha)
    has = {
        "x": _column(mark.x), "width": _either(mark.width, mark.series), "top": _column(mark.y),
        "line_color": color, "fill_color": color, "line_alpha": alpha, "fill_alpha": alpha,
    }  # fmt: skip
    plot.glyph(source, BokehModel("VBar", has), mark)


def _scatter(mark: Mark) -> BokehModel:
    """The markers of a mark at (x, y); those without a face are strokes."""
    series = mark.series
    color, alpha = _either(mark.color, series), _value(mark.alpha)
    upright = {"angle": _value(0.5 * np.pi)} if mark.marker == "tick" else {}
    has = {
        "x": _column(mark.x), "y": _column(mark.y),
        "marker": _either("dash" if mark.marker == "tick" else mark.marker, series),
        "size": _either(mark.size, series), "line_width": _either(mark.width, series), **upright,
        "line_color": color if _stroked(mark) else _value(None), "fill_color": color,
        "line_alpha": alpha, "fill_alpha": alpha,
    }  # fmt: skip
    return BokehModel("Scatter", has)


def _stroked(mark: Mark) -> bool:
    return mark.marker in ("dash", "tick", "cross", "x")


def _points(plot: Plot, mark: Mark, source: BokehModel) -> None:
    found = plot.glyph(source, _scatter(mark), mark)
    if mark.pick:
        line = colors.PICKED if _stroked(mark) else colors.INK
        width = BOKEH.picked if _stroked(mark) else CHARTS.thin
        _picked(found, fill_color=colors.PICKED, fill_alpha=1.0, line_color=line,
                size=CHARTS.tick, line_width=width)  # fmt: skip
    if mark.hover:
        _answers(plot, found, mark)


def _cells(plot: Plot, mark: Mark, source: BokehModel) -> None:
    from bokeh.palettes import Cividis256  # imported where a map is drawn

    mapper = BokehModel(
        "LinearColorMapper", {"palette": Cividis256, "nan_color": "rgba(0, 0, 0, 0)"}
    )
    width, height = mark.step
    has = {
        "x": _column(mark.x), "y": _column(mark.y), "width": _value(width),
        "height": _value(height), "line_color": _value(None),
        "fill_color": _column("value") | {"transform": mapper},
    }  # fmt: skip
    found = plot.glyph(source, BokehModel("Rect", has))
    bar = {
        "color_mapper": mapper, "background_fill_color": None, "width": BOKEH.scale,
        "major_label_text_color": colors.TEXT,
    }  # fmt: skip
    plot.right.append(BokehModel("ColorBar", bar))
    plot.tools.append(BokehModel("HoverTool", {"renderers": [found], "tooltips": _tooltips(mark)}))


def _contour(plot: Plot, mark: Mark, _: BokehModel) -> None:
    if mark.grid is None:
        return
    from contourpy import FillType, LineType, contour_generator  # imported with a contour

    x, y, height = mark.grid
    levels = [0.0, *mark.levels, max(float(np.nanmax(height)), mark.levels[-1] + 1.0)]
    found = contour_generator(
        x, y, np.ma.masked_invalid(height), line_type=LineType.ChunkCombinedNan,
        fill_type=FillType.OuterOffset,
    )  # fmt: skip
    lines = [found.lines(level)[0][0] for level in levels]
    lines = [np.empty((0, 2)) if own is None else own for own in lines]
    areas = [
        [np.split(points, ends[1:-1]) for points, ends in zip(*found.filled(*pair), strict=True)]
        for pair in pairwise(levels)
    ]
    along, over = (
        {"xs": [_part(own, 0) for own in each], "ys": [_part(own, 1) for own in each]}
        for each in (lines, areas)
    )
    along["line_width"] = [0.0, *[1.0] * (len(mark.levels) - 1), 2.0, 0.0]
    over["fill_color"] = list(colors.HEIGHTS)
    corners = {"xs": _column("xs"), "ys": _column("ys")}
    line = {"line_color": _value(mark.color), "line_width": _column("line_width")}
    area = {"fill_color": _column("fill_color"), "line_width": _value(0), "line_alpha": _value(0)}
    parts = {
        f"{name}_renderer": BokehModel("GlyphRenderer", {
            "data_source": BokehModel("ColumnDataSource", {"data": _map(columns)}),
            "glyph": BokehModel(glyph, corners | look),
        })
        for name, columns, glyph, look in (
            ("line", along, "MultiLine", line), ("fill", over, "MultiPolygons", area),
        )
    }  # fmt: skip
    plot.renderers.append(BokehModel("ContourRenderer", parts | {"levels": levels}))


def _part(points: Any, k: int) -> Any:
    """Coordinate k of the points (P, 2), in nested lists of such arrays."""
    if isinstance(points, list):
        return [_part(own, k) for own in points]
    return points[:, k].tolist()


_SHAPES = {
    "line": _line, "lines": _lines, "band": _band, "spans": _spans, "bars": _bars,
    "points": _points, "cells": _cells, "contour": _contour,
}  # fmt: skip


def _picked(renderer: BokehModel, **look: Any) -> None:
    """Give a renderer the look of the marked experiment."""
    glyph = renderer.attributes["glyph"]
    has = glyph.attributes | {name: _value(each) for name, each in look.items()}
    renderer.attributes["selection_glyph"] = BokehModel(glyph.name, has)


def _answers(plot: Plot, renderer: BokehModel, mark: Mark, snap: bool = True) -> None:
    """Add the tooltip of a mark; if `mark.pick`, a click marks the experiment in every chart."""
    hover: Data = {"renderers": [renderer], "tooltips": _tooltips(mark)}
    if snap:
        hover["point_policy"] = "snap_to_data"
    plot.tools.append(BokehModel("HoverTool", hover))
    if not mark.pick:
        return
    for tool in plot.tools:
        if tool.name == "TapTool":
            tool.attributes["renderers"].append(renderer)
            return
    plot.tools.append(BokehModel("TapTool", {"renderers": [renderer]}))


def _tooltips(mark: Mark) -> list[tuple[str, str]]:
    """The tooltips of a mark in the notation of Bokeh: @ before a column, a format after a share.

    A share is a number that is shown in percent.
    """
    return [
        (title, words.replace("{", "@{").replace(":%}", "}{0.[0000] %}"))
        for title, words in mark.hover
    ]


def _right(plot: Plot, mark: Mark, of: Axis | None) -> None:
    """Add an axis on the right, which begins at zero, as the scale of a mark."""
    # The mark must not extend the left axis.
    plot.y_range.attributes["renderers"] = list(plot.renderers)
    top = BOKEH.top * float(np.max(mark.array("high")))
    plot.extra["right"] = BokehModel("Range1d", {"start": 0.0, "end": top})
    scale = axis(of or Axis(""))
    scale.attributes["y_range_name"] = "right"
    plot.right.append(scale)
