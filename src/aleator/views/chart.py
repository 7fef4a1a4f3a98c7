"""A chart as data: marks on axes, drawn from named columns.

Bokeh draws a chart in report.html (`interactive`), matplotlib draws it as a figure (`axes`). The
data of a chart are a `Series`. When a reader marks an experiment in one chart, all charts with the
same series mark it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from aleator.core.types import Array
from aleator.results.printed import PAGE, Depth
from aleator.results.values import REACH

# The colors are grays and the palette of Okabe and Ito, whose colors remain distinct in every form
# of color blindness. Each color has one value for a light page and one for a dark page. All values
# differ, because the page exchanges them to change from light to dark.
BLUE = "#0072b2"
VERMILION = "#d55e00"
PICKED = "#c77700"
GREEN = "#009e73"
INK = "#262626"
TEXT = "#404040"
GRAY = "#767676"
LINE = "#a0a0a0"
GRID = "#e9e9e9"
WIDE = "#cfe3f1"
NARROW = "#7fb8dc"
BAND = "#e4e4e4"
PAPER = "#ffffff"
# These colors fill the areas between the contours of a likelihood, from its maximum outward.
HEIGHTS = ("#9ecae8", "#c6dff0", "#e3eff8", "#f6fafd")
PAIRS = (
    (BLUE, "#56b4e9"), (VERMILION, "#ff8f3f"), (PICKED, "#ffd166"), (GREEN, "#2fd1a2"),
    (INK, "#e6e6e6"), (TEXT, "#c6cdd5"), (GRAY, "#9aa3ad"), (LINE, "#5d6772"),
    (GRID, "#2b333c"), (WIDE, "#1d3d55"), (NARROW, "#2f6f9f"), (BAND, "#303841"),
    (PAPER, "#14181d"),
    *zip(HEIGHTS, ("#2d6b96", "#234f70", "#1b394f", "#162734"), strict=True),
)  # fmt: skip
"""The two values of each color: for a light page and for a dark page."""


@dataclass(frozen=True)
class ChartSettings:
    """Settings of charts: sizes in pixels of a page. The values are chosen by judgement, by eye.

    thin: width of a thin line. over: width of a line on a color map. halo: width of a light line
    under it, against which it is seen. faint: opacity of a line through which others are seen.
    behind: opacity of bands that may lie over each other. dot:
    size of a mark. tick: size of ticks and crosses. low, high: heights of a chart that needs little
    room, and of one that needs much. cell: width of a cell of a color map over the distance to the
    next cell; above 1 so that no gaps are seen. spans: the total width of all bars of predictions,
    then the least and the largest width of one bar. sd: half the width of an interval with 95 % of
    a normal law, in standard deviations.
    """

    thin: float = 1.2
    over: float = 2.5
    halo: float = 5.0
    faint: float = 0.7
    behind: float = 0.2
    dot: float = 6.0
    tick: float = 14.0
    low: int = 250
    high: int = 400
    cell: float = 1.15
    spans: tuple[float, float, float] = (500.0, 1.5, 12.0)
    sd: float = REACH


CHARTS = ChartSettings()


@dataclass(frozen=True, eq=False)
class Series:
    """The data of a chart: named columns of equal length. A cell may be a list that is a curve.

    `each` has further columns for some experiments, by id. They replace the columns when a reader
    marks the experiment.
    """

    name: str
    columns: Mapping[str, Any]
    each: Mapping[str, Mapping[str, Any]] | None = None

    def array(self, key: str) -> Array:
        """The numbers of a column; a missing number is NaN."""
        return numbers(self.columns[key])


@dataclass(frozen=True)
class Axis:
    """An axis of a chart: its title with the unit, and its scale.

    `log` means a logarithmic axis, `share` an axis of percentages. `names` are texts in place of
    numbers, each with its place.
    """

    title: str
    log: bool = False
    share: bool = False
    names: Sequence[tuple[float, str]] = ()


Shape = Literal["line", "lines", "band", "spans", "points", "bars", "cells", "contour"]


@dataclass(frozen=True, eq=False)
class Mark:
    """One layer of a chart: columns of a series, drawn as a shape.

    A "line" goes through (x, y); "lines" are one line for each row; a "band" fills the range from y
    to `high` over x; "spans" are vertical bars from y to `high`; "points" are markers at (x, y);
    "bars" stand on zero; "cells" are rectangles of size `step`, colored by the column "value"; a
    "contour" shows the `grid` (x, y, height) by curves at `levels`. Color, marker, size, width and
    dash are one value for all rows, or the name of a column with a value for each row. `hover`
    lists the lines of a tooltip: a title, and a text with column names in braces. With `pick` a
    click marks the experiment. With `right` the axis on the right is the scale of y.
    """

    shape: Shape
    series: Series
    x: str = "x"
    y: str = "y"
    high: str = ""
    color: str = BLUE
    width: float | str = 1.5
    dash: str = "solid"
    size: float | str = CHARTS.dot
    marker: str = "circle"
    alpha: float = 1.0
    legend: str = ""
    legend_by: str = ""
    hover: Sequence[tuple[str, str]] = ()
    pick: bool = False
    right: bool = False
    step: tuple[float, float] = (1.0, 1.0)
    grid: tuple[Array, Array, Array] | None = None
    levels: Sequence[float] = ()

    def array(self, end: str) -> Array:
        """The numbers of the column that the mark draws as "x", "y" or "high"; NaN if missing."""
        return self.series.array(getattr(self, end))


def looks(mark: Mark) -> dict[tuple[str, str], list[int]]:
    """The indices of a mark's rows, grouped by color and marker."""
    columns, every = mark.series.columns, range(len(mark.series.columns[mark.x]))
    colors = columns.get(mark.color) or [mark.color for _ in every]
    markers = columns.get(mark.marker) or [mark.marker for _ in every]
    found: dict[tuple[str, str], list[int]] = {}
    for k in every:
        found.setdefault((colors[k], markers[k]), []).append(k)
    return found


def meaning(color: str, marker: str) -> str:
    """The text in the legend for measured values with this color and marker."""
    bounds = {"triangle": "at least", "inverted_triangle": "at most", "square": "between bounds"}
    exact = {VERMILION: "outside the 95 %", GRAY: "measured, no density"}
    return bounds.get(marker) or exact.get(color) or "measured"


@dataclass(frozen=True)
class GuideLine:
    """A straight line through the whole chart, at a value `at` of one axis.

    It is horizontal if `across`, else vertical. A gray line is dashed.
    """

    at: float
    across: bool = True
    color: str = GRAY


@dataclass(frozen=True, eq=False)
class Chart:
    """Marks on axes, with a caption that says how to read them.

    `columns` maps the columns that a reader can save as CSV to their headings. With `switched` the
    reader of a page chooses the quantity on the x axis. A `wide` chart fills a row of the page.
    `marked` is the experiment that is shown before a reader marks another one. With `foot` the y
    axis begins at zero.
    """

    name: str
    title: str
    caption: str
    x: Axis
    y: Axis
    marks: Sequence[Mark]
    columns: Mapping[str, str]
    rules: Sequence[GuideLine] = ()
    height: int = 320
    switched: bool = False
    wide: bool = False
    marked: str = ""
    right: Axis | None = None
    foot: bool = False
    depth: Depth = PAGE
    data: Series | None = field(default=None, repr=False)

    @property
    def source(self) -> Series:
        """The data of the chart: `data` if they are stated, else the series of its first mark."""
        return self.data or self.marks[0].series

    @property
    def spoken(self) -> str:
        """The text that a screen reader speaks in place of the chart."""
        return f"{self.title}. {self.caption}"


def numbers(values: Iterable[Any]) -> Array:
    """The values of a list in a document as an array of numbers; null and texts become NaN.

    >>> numbers([1, None, "a"])
    array([ 1., nan, nan])
    """
    if isinstance(values, np.ndarray):
        return values.astype(np.float64)
    return np.array([float(v) if isinstance(v, int | float) else np.nan for v in values])


def evenly(count: int, most: int) -> list[int]:
    """At most `most` evenly spaced indices of a list with `count` entries.

    >>> evenly(5, 3), evenly(2, 3)
    ([0, 2, 4], [0, 1])
    """
    kept = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return [int(place) for place in np.unique(kept)]
