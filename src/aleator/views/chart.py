"""A chart: marks on axes, drawn from named columns, whoever draws it.

Bokeh draws it in report.html (`interactive`), matplotlib on axes (`axes`). The data stand in a
`Series`; charts that share one show the same experiment where it is marked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from aleator.core.types import Array
from aleator.results.printed import PAGE, Depth

# Okabe and Ito's palette, told apart in every form of color blindness, and grays; each for light
# and for dark. The page changes one for the other, so that all are distinct.
BLUE, BLUE_DARK = "#0072b2", "#56b4e9"
VERMILION, VERMILION_DARK = "#d55e00", "#ff8f3f"
PICKED, PICKED_DARK = "#c77700", "#ffd166"
GREEN, GREEN_DARK = "#009e73", "#2fd1a2"
INK, INK_DARK = "#262626", "#e6e6e6"
TEXT, TEXT_DARK = "#404040", "#c6cdd5"
GRAY, GRAY_DARK = "#767676", "#9aa3ad"
LINE, LINE_DARK = "#a0a0a0", "#5d6772"
GRID, GRID_DARK = "#e9e9e9", "#2b333c"
WIDE, WIDE_DARK = "#cfe3f1", "#1d3d55"
NARROW, NARROW_DARK = "#7fb8dc", "#2f6f9f"
BAND, BAND_DARK = "#e4e4e4", "#303841"
PAPER, PAPER_DARK = "#ffffff", "#14181d"
# From the maximum of a likelihood outward.
HEIGHTS = ("#9ecae8", "#c6dff0", "#e3eff8", "#f6fafd")
HEIGHTS_DARK = ("#2d6b96", "#234f70", "#1b394f", "#162734")
PAIRS = (
    (BLUE, BLUE_DARK), (VERMILION, VERMILION_DARK), (PICKED, PICKED_DARK), (GREEN, GREEN_DARK),
    (INK, INK_DARK), (TEXT, TEXT_DARK), (GRAY, GRAY_DARK), (LINE, LINE_DARK), (GRID, GRID_DARK),
    (WIDE, WIDE_DARK), (NARROW, NARROW_DARK), (BAND, BAND_DARK), (PAPER, PAPER_DARK),
    *zip(HEIGHTS, HEIGHTS_DARK, strict=True),
)  # fmt: skip
"""(light, dark) of each color."""


@dataclass(frozen=True)
class ChartSettings:
    """Sizes of marks and charts, in pixels of a page; by what the eye sees.

    thin: width of a thin line. over: width of a line over a map, which is seen because the wider
    line `halo` lies under it. faint: opacity of a color that others are seen through. dot: size of
    a mark. tick: size of ticks and crosses. low, high: heights of a chart that needs little room,
    and of one that needs much. cell: width of a cell of a map over the step to the next, so that no
    seams are seen. spans: the width of all bars of predictions together, and the least and the
    largest width of one. sd: standard deviations of a normal law beyond which lie 5 %.
    """

    thin: float = 1.2
    over: float = 2.5
    halo: float = 5.0
    faint: float = 0.7
    dot: float = 6.0
    tick: float = 14.0
    low: int = 250
    high: int = 400
    cell: float = 1.15
    spans: tuple[float, float, float] = (500.0, 1.5, 12.0)
    sd: float = 1.96


CHARTS = ChartSettings()


@dataclass(frozen=True, eq=False)
class Series:
    """Named columns of numbers and texts, a row each; a cell may be a list, of one curve.

    `each` has for some experiments the columns that take their place where one is marked.
    """

    name: str
    columns: Mapping[str, Any]
    each: Mapping[str, Mapping[str, Any]] | None = None

    def array(self, key: str) -> Array:
        """A column of numbers; NaN for none."""
        return numbers(self.columns[key])


@dataclass(frozen=True)
class Axis:
    """What lies along an axis, with its unit; logarithmic where `log`, in percent a `share`."""

    title: str
    log: bool = False
    share: bool = False


Shape = Literal["line", "lines", "band", "spans", "points", "bars", "cells", "contour"]


@dataclass(frozen=True, eq=False)
class Mark:
    """One layer of a chart: columns of its series as a shape.

    A "line" goes through (x, y), "lines" have one in each row; a "band" lies between y and `high`
    over x, "spans" are such ends for each x alone, "bars" stand on zero. "cells" are colored by the
    column "value", and as large as `step`. A "contour" has the `grid` (x, y, height) with
    curves at `levels`. A color, marker, size, width or dash is what all have, or a column.
    `hover` says what is told of a mark: a title, and columns in braces. `right` puts it on the
    scale on the right.
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

    def array(self, end: Literal["x", "y", "high"]) -> Array:
        """The numbers of one of its columns; NaN for none."""
        return self.series.array(getattr(self, end))


def looks(mark: Mark) -> dict[tuple[str, str], list[int]]:
    """The rows of a mark by their color and marker, each the same for all or that of a column."""
    columns, every = mark.series.columns, range(len(mark.series.columns[mark.x]))
    colors = columns.get(mark.color) or [mark.color for _ in every]
    markers = columns.get(mark.marker) or [mark.marker for _ in every]
    found: dict[tuple[str, str], list[int]] = {}
    for k in every:
        found.setdefault((colors[k], markers[k]), []).append(k)
    return found


def meaning(color: str, marker: str) -> str:
    """What a measured value is that has this look."""
    bounds = {"triangle": "at least", "inverted_triangle": "at most", "square": "between bounds"}
    exact = {VERMILION: "measured, outside the 95 %", GRAY: "measured, no density"}
    return bounds.get(marker) or exact.get(color) or "measured"


@dataclass(frozen=True)
class GuideLine:
    """A straight line over the whole chart, across at a y or up at an x: dashed where gray."""

    at: float
    across: bool = True
    color: str = GRAY


@dataclass(frozen=True, eq=False)
class Chart:
    """Marks on axes, with a caption that says how to read them.

    `source` has the data, whose `columns` (column to heading) are saved as CSV. `switched` says
    that the reader of a page chooses what its x is, `wide` that it has a row for itself, `marked`
    is the experiment that it shows before another is marked.
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
    own: Series | None = field(default=None, repr=False)

    @property
    def source(self) -> Series:
        """The data behind it: those of its first mark, unless it says otherwise."""
        return self.own or self.marks[0].series

    @property
    def spoken(self) -> str:
        """What a screen reader says of it."""
        return f"{self.title}. {self.caption}"


def numbers(values: Iterable[Any]) -> Array:
    """Numbers of a document: JSON's null is NaN, and so is a text.

    >>> numbers([1, None, "a"])
    array([ 1., nan, nan])
    """
    if isinstance(values, np.ndarray):
        return values.astype(np.float64)
    return np.array([float(v) if isinstance(v, int | float) else np.nan for v in values])


def evenly(count: int, most: int) -> list[int]:
    """Places of at most so many of `count`, evenly chosen.

    >>> evenly(5, 3), evenly(2, 3)
    ([0, 2, 4], [0, 1])
    """
    kept = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return [int(place) for place in np.unique(kept)]
