"""Charts drawn with matplotlib, the look of all figures, and figures as files.

matplotlib is optional: it is imported when a figure is drawn. The settings that a user made in it
are left unchanged, and the same document gives the same bytes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.errors import AleatorError, short
from aleator.results.printed import number
from aleator.views.chart import BLUE as BLUE
from aleator.views.chart import CHARTS, INK, LINE, TEXT, Chart, Mark, looks, meaning
from aleator.views.chart import GRAY as GRAY
from aleator.views.chart import GREEN as GREEN
from aleator.views.chart import VERMILION as VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureSettings:
    """Settings of the look of figures in files. The values are chosen by judgement, by eye.

    width: width of a figure in inches. dots_an_inch: its resolution. letters: the largest number of
    letters in a line of the title. left: where the title begins, as a share of the width. columns:
    the number of entries in a row of the legend. points: typographic points of a line or a mark for
    each pixel that it has on a page. dots: with more marks than these, marks become smaller. bars:
    with more bars than these, steps are drawn, because bars would overlap. room: the width of a bar
    over the distance to the next, as its largest value, what each bar adds, and its least value.
    """

    width: float = 9.0
    dots_an_inch: int = 160
    letters: int = 84
    left: float = 0.012
    columns: int = 6
    points: float = 0.6
    dots: int = 20
    bars: int = 300
    room: tuple[float, float, float] = (0.72, 0.02, 0.06)


FIGURES = FigureSettings()
BLACK = INK
# These are further colors of the palette of Okabe and Ito.
ORANGE, PURPLE, SKY = "#e69f00", "#aa5a8c", "#56b4e9"

_STYLE = {
    "text.color": TEXT,
    "text.parse_math": False,
    "axes.labelcolor": TEXT,
    "axes.edgecolor": LINE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "axes.titlelocation": "left",
    "axes.titlepad": 10.0,
    "axes.axisbelow": True,
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "legend.frameon": False,
    "legend.fontsize": "small",
}


@contextmanager
def styled() -> Iterator[None]:
    """A context in which matplotlib has the style of Aleator's figures, whatever a user has set.

    Raises AleatorError if matplotlib is not installed.
    """
    try:
        from matplotlib import style
    except ImportError:
        raise AleatorError(
            "figures need matplotlib, which is not installed", "pip install matplotlib"
        ) from None
    with style.context(["default", _STYLE]):
        yield


def empty_figure(title: str | None, width: float, height: float) -> Figure:
    """A figure of this size in inches, with a title but no axes."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), FIGURES.dots_an_inch, layout="constrained")
    if title:
        wrapped = textwrap.fill(title, FIGURES.letters)
        figure.suptitle(wrapped, x=FIGURES.left, ha="left", fontweight="bold")
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as .png or .svg, and make its folder if necessary.

    The file states no version and no date, so that equal figures give equal bytes. Raises
    AleatorError if the file cannot be written.
    """
    png = path.suffix == ".png"
    metadata = {"Software": None} if png else {"Date": None, "Creator": None}
    with styled():
        from matplotlib import rc_context

        with rc_context({"svg.hashsalt": "aleator", "svg.fonttype": "path"}):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                # Without a layout to find, matplotlib draws the figure once and not twice.
                if layout := figure.get_layout_engine():
                    layout.execute(figure)
                    figure.set_layout_engine("none")
                figure.savefig(path, metadata=metadata)
            except OSError as error:
                raise AleatorError(
                    f"{short(path)}: the figure cannot be written: {error.strerror}",
                    "choose another folder with --output",
                ) from None
    return path


# ------------------------------------------------------------------------------------ charts


LINES = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}
MARKERS = {
    "circle": "o", "diamond": "D", "triangle": "^", "inverted_triangle": "v", "square": "s",
    "cross": "+", "x": "x", "tick": "|",
}  # fmt: skip


def draw(chart: Chart, axes: Axes) -> Axes:
    """Draw the marks and the labels of a chart on axes. The title is not drawn."""
    for mark in chart.marks:
        if mark.alpha > 0.0 and not mark.right and mark.shape in _SHAPES:
            _SHAPES[mark.shape](axes, mark)
    for rule in chart.rules:
        line = axes.axhline if rule.across else axes.axvline
        dash = "--" if rule.color == GRAY else "-"
        line(rule.at, color=rule.color, lw=1, ls=dash, zorder=1)
    axes.set(xlabel=chart.x.title, ylabel=chart.y.title)
    if chart.x.names:
        axes.set_xticks([at for at, _ in chart.x.names], [name for _, name in chart.x.names])
    if chart.y.log:
        from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    if chart.foot:
        axes.set_ylim(bottom=0.0)
    return axes


def legend(figure: Figure) -> None:
    """Add one legend for all axes of a figure; it lies under the figure, where it hides no data."""
    every = (axes.get_legend_handles_labels() for axes in figure.axes)
    pairs = [pair for own in every for pair in zip(*own, strict=True)]
    pairs.sort(key=lambda pair: not isinstance(pair[0], tuple))  # Bars come first in the legend.
    handles = {text: handle for handle, text in pairs}
    figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=FIGURES.columns)


def _line(axes: Axes, mark: Mark) -> None:
    x, y = mark.array("x"), mark.array("y")
    axes.plot(x, y, color=mark.color, lw=FIGURES.points * float(mark.width), ls=LINES[mark.dash],
              label=mark.legend or None, marker="" if x.size > 1 else "_")  # fmt: skip


def _lines(axes: Axes, mark: Mark) -> None:
    columns, words = mark.series.columns, set()
    for k, (x, y) in enumerate(zip(columns[mark.x], columns[mark.y], strict=True)):
        width = columns[mark.width][k] if isinstance(mark.width, str) else mark.width
        dash = columns[mark.dash][k] if mark.dash in columns else mark.dash
        word = columns[mark.legend_by][k] if mark.legend_by else mark.legend
        axes.plot(np.array(x, float), np.array(y, float), LINES[dash], color=mark.color,
                  lw=FIGURES.points * width,
                  label=None if word in words else word or None)  # fmt: skip
        words.add(word)


def _band(axes: Axes, mark: Mark) -> None:
    axes.fill_between(mark.array("x"), mark.array("y"), mark.array("high"), lw=0.0,
                      color=mark.color, alpha=mark.alpha, label=mark.legend or None)  # fmt: skip


def _room(size: int) -> float:
    """The width of a bar over the distance between two bars; smaller if there are few bars."""
    most, more, least = FIGURES.room
    return min(most, more * size + least)


def _spans(axes: Axes, mark: Mark) -> None:
    x, low, high = (mark.array(end) for end in ("x", "y", "high"))
    known = np.isfinite(low) & np.isfinite(high)
    if x.size > FIGURES.bars:
        order = np.argsort(x, kind="stable")
        axes.fill_between(x[order], low[order], high[order], step="mid", color=mark.color, lw=0.0,
                          label=mark.legend or None)  # fmt: skip
        return
    axes.use_sticky_edges = False  # Otherwise the lowest bar would touch the axis, as if cut.
    axes.bar(x[known], (high - low)[known], _room(x.size), low[known], color=mark.color,
             label=mark.legend or None)  # fmt: skip


def _bars(axes: Axes, mark: Mark) -> None:
    axes.bar(mark.array("x"), mark.array("y"), float(mark.width), color=mark.color,
             label=mark.legend or None)  # fmt: skip
    axes.locator_params(axis="y", integer=True)


def _points(axes: Axes, mark: Mark) -> None:
    """Draw marks; those of the same color and marker are one line and one entry of the legend."""
    x, y = mark.array("x"), mark.array("y")
    if mark.marker == "dash":
        half = 0.5 * _room(x.size) if x.size <= FIGURES.bars else 0.5
        axes.hlines(
            y,
            x - half,
            x + half,
            color=mark.color,
            lw=FIGURES.points * float(mark.width),
            label=mark.legend or "_",
        )
        return
    size = FIGURES.points * (CHARTS.dot if isinstance(mark.size, str) else mark.size)
    size *= min(1.0, float(np.cbrt(FIGURES.dots / max(x.size, 1))))
    of_column = mark.marker in mark.series.columns
    for (color, marker), rows in looks(mark).items():
        stroked = marker in ("cross", "x", "tick")
        axes.plot(x[rows], y[rows], color=color, marker=MARKERS[marker], ls="none", zorder=3,
                  ms=size, mew=1.0 if stroked else 0.0,
                  label=meaning(color, marker) if of_column else mark.legend or None)  # fmt: skip


def _contour(axes: Axes, mark: Mark) -> None:
    if mark.grid is not None:
        x, y, height = mark.grid
        axes.contour(x, y, np.ma.masked_invalid(height), levels=list(mark.levels),
                     colors=mark.color)  # fmt: skip


_SHAPES: Mapping[str, Any] = {
    "line": _line, "lines": _lines, "band": _band, "spans": _spans, "bars": _bars,
    "points": _points, "contour": _contour,
}  # fmt: skip
