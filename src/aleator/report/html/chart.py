"""A chart: axes in the style of the house, and the data behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bokeh.models
import bokeh.plotting
import numpy as np

from aleator.report.html import colors
from aleator.types import Array

# Bokeh's own types know fewer arguments than it takes.
models: Any = bokeh.models
plotting: Any = bokeh.plotting

HEIGHT = 320
DECADES = tuple(float(f"{digit}e{power}") for power in range(-12, 13) for digit in (1, 2, 5))
"""Ticks of a logarithmic axis: Bokeh's own are few within a decade."""
MANY_DECADES = 5
"""Decades that have no room for ticks within each."""
IN_A_ROW = 4
"""Entries of a legend that a narrow screen has room for."""
TOOLS = "pan,box_zoom,wheel_zoom,reset"


@dataclass(frozen=True, eq=False)
class Chart:
    """Axes with their title, and a caption that says how to read them.

    `source` has the data, whose `columns` (column to heading) the page writes as CSV. `switched`
    tells that the reader chooses what its x is.
    """

    name: str
    title: str
    caption: str
    plot: Any
    source: Any
    columns: Mapping[str, str]
    switched: bool = False

    def __post_init__(self) -> None:
        # What is not marked stays as it is: a band is no less true for it.
        for renderer in self.plot.renderers:
            if hasattr(renderer, "nonselection_glyph"):
                renderer.nonselection_glyph = None

    @property
    def spoken(self) -> str:
        """What a screen reader says of it."""
        return f"{self.title}. {self.caption}"


def axes(x: str, y: str, *, height: int = HEIGHT, log_y: bool = False, **more: Any) -> Any:
    """Empty axes with their labels."""
    plot = plotting.figure(
        height=height, sizing_mode="stretch_width", tools=TOOLS, active_drag=None,
        active_scroll=None, toolbar_location="above", x_axis_label=x, y_axis_label=y,
        y_axis_type="log" if log_y else "linear", background_fill_color=colors.PAPER,
        border_fill_color=colors.PAPER, outline_line_color=None, **more,
    )  # fmt: skip
    plot.min_border_right = 14  # half of the last number under the axis
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    for axis in plot.axis:
        axis.axis_line_color = colors.LINE
        axis.major_tick_line_color = colors.LINE
        axis.minor_tick_line_color = None
        axis.major_label_text_color = colors.TEXT
        axis.axis_label_text_color = colors.TEXT
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "13px"
        axis.major_label_text_font_size = "12px"
    for grid in plot.grid:
        grid.grid_line_color = colors.GRID
    plot.yaxis.formatter = models.BasicTickFormatter(precision="auto", use_scientific=not log_y)
    if log_y:
        plot.yaxis.ticker = plot.ygrid.ticker = models.FixedTicker(ticks=list(DECADES))
    return plot


def fewer_ticks(plot: Any, values: Array) -> None:
    """Whole decades, at most ten of them, on a logarithmic axis on which values span many."""
    known = values[np.isfinite(values) & (values > 0.0)]
    if not known.size:
        return
    low, high = (int(end) for end in np.floor(np.log10([known.min(), known.max()])))
    if high - low > MANY_DECADES:
        step = -(-(high - low) // 10)
        ticks = [10.0**power for power in range(low, high + 2, step)]
        plot.yaxis.ticker = plot.ygrid.ticker = models.FixedTicker(ticks=ticks)
        plot.yaxis.formatter = models.LogTickFormatter()


def shared(columns: Mapping[str, Any], name: str, **more: Any) -> Any:
    """The data of charts, under the name by which the page finds them."""
    return models.ColumnDataSource(dict(columns), name=name, **more)


def straight(plot: Any, dimension: str, at: float, color: str = colors.GRAY) -> None:
    """A line across the axes ("width") or up ("height"): dashed where it is gray."""
    dash = "dashed" if color == colors.GRAY else "solid"
    plot.add_layout(models.Span(location=at, dimension=dimension, line_color=color, line_dash=dash))


def legend_below(plot: Any) -> None:
    """The legend under the axes, where it hides no number."""
    legend = plot.legend[0]
    plot.add_layout(legend, "below")
    legend.orientation = "horizontal"
    legend.ncols = "auto" if len(legend.items) <= IN_A_ROW else 3
    legend.border_line_color = None
    legend.background_fill_color = None
    legend.label_text_color = colors.TEXT
    legend.label_text_font_size = "12px"
    legend.padding, legend.margin, legend.spacing = 2, 0, 14


def points(
    plot: Any,
    source: Any,
    x: str,
    y: str,
    told: list[tuple[str, str]],
    *,
    color: str = colors.INK,
    size: float | str = 6.0,
    marker: str = "circle",
    **more: Any,
) -> Any:
    """Marks of experiments: hovering tells about one, and clicking marks it in every chart."""
    drawn = plot.scatter(
        x, y, source=source, marker=marker, size=size, color=color, line_color=None, **more
    )
    ring = {"line_color": colors.INK, "line_width": 1.5, "size": 13.0, "fill_alpha": 1.0}
    if marker == "dash":
        ring = {"line_color": colors.PICKED, "line_width": 4.0, "size": 22.0}
    drawn.selection_glyph = drawn.glyph.clone(fill_color=colors.PICKED, **ring)
    plot.add_tools(models.HoverTool(renderers=[drawn], tooltips=told, point_policy="snap_to_data"))
    tap = plot.select_one(models.TapTool)
    if tap is None:
        plot.add_tools(models.TapTool(renderers=[drawn]))
    else:
        tap.renderers = [*tap.renderers, drawn]
    return drawn
