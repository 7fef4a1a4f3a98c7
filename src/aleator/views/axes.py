"""Charts drawn with matplotlib, how all figures look, and how they become files.

No pyplot, and the same bytes each time. matplotlib is optional (`pip install matplotlib`); it is
imported only where a figure is asked for, and what the user has set in it stays as it is.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.core.types import Array
from aleator.errors import AleatorError, short
from aleator.views.chart import BLUE as BLUE
from aleator.views.chart import GRAY as GRAY
from aleator.views.chart import GREEN as GREEN
from aleator.views.chart import INK, TEXT, Chart, Mark, looks, meaning
from aleator.views.chart import VERMILION as VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureSettings:
    """How figures look as files; by what the eye sees.

    width: inches of a figure, with so many dots an inch. pads: inches beside and over panels, and
    between: the share of their width between them. letters: those of a line of the title.
    left: where the title begins, as a share of the width. title, legend: points of their letters.
    hairline, thin: points of lines of axes, and of dashes. line, lines: points of a line, and of
    one of many, over its width on a page. columns, handle, spacing: entries of the legend in a row,
    the length of their lines and the room between them, in letters. ticks: ticks of a logarithmic
    ordinate of less than the ratio `decades`, which has too few powers of ten to be read.
    points: points of a mark over its pixels on a page, and dot: those of a dot whose size is a
    column. dots: marks from which they become smaller, by the share `smaller` for each
    doubling, to the share `smallest`. colored: size of a colored mark over that of a black one.
    bars: bars; more run into each other, and steps then show the same. room: width of a bar at
    most, what it grows by for each bar, and its width without any: no wall where there are few.
    """

    width: float = 9.0
    dots_an_inch: int = 160
    pads: tuple[float, float] = (0.12, 0.1)
    between: float = 0.04
    letters: int = 84
    left: float = 0.012
    title: float = 12.5
    legend: float = 9.0
    hairline: float = 0.8
    thin: float = 1.2
    line: float = 0.7
    lines: float = 0.6
    columns: int = 6
    handle: float = 1.6
    spacing: float = 1.8
    ticks: int = 6
    decades: float = 30.0
    points: float = 0.55
    dot: float = 4.2
    dots: int = 20
    smaller: float = 0.14
    smallest: float = 0.3
    colored: float = 1.25
    bars: int = 300
    room: tuple[float, float, float] = (0.72, 0.02, 0.06)


FIGURES = FigureSettings()
BLACK = INK
# The rest of Okabe and Ito's palette.
ORANGE, PURPLE, SKY = "#e69f00", "#aa5a8c", "#56b4e9"

_STYLE = {
    "font.size": 10.0,
    "text.color": TEXT,
    "text.parse_math": False,
    "axes.labelcolor": TEXT,
    "axes.edgecolor": "#a0a0a0",
    "axes.linewidth": FIGURES.hairline,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 10.0,
    "axes.axisbelow": True,
    "xtick.color": "#a0a0a0",
    "ytick.color": "#a0a0a0",
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "legend.frameon": False,
    "legend.fontsize": FIGURES.legend,
}


@contextmanager
def styled() -> Iterator[None]:
    """matplotlib's own defaults and the style of the house, and after it what was there before.

    Raises AleatorError where matplotlib is not installed.
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
    """A figure of this size in inches with nothing but a title, known to no window."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), FIGURES.dots_an_inch, layout="constrained")
    engine = figure.get_layout_engine()
    if engine is not None:
        side, over = FIGURES.pads
        engine.set(w_pad=side, h_pad=over, wspace=FIGURES.between)  # type: ignore[call-arg]
    if title:
        wrapped = textwrap.fill(title, FIGURES.letters)
        look = {"fontsize": FIGURES.title, "fontweight": "bold"}
        figure.suptitle(wrapped, x=FIGURES.left, ha="left", **look)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as .png or .svg, making its folder; versions and dates are left out.

    Raises AleatorError where the file cannot be written.
    """
    png = path.suffix == ".png"
    metadata = {"Software": None} if png else {"Date": None, "Creator": None}
    with styled():
        from matplotlib import rc_context

        with rc_context({"svg.hashsalt": "aleator", "svg.fonttype": "path"}):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                figure.savefig(path, metadata=metadata)
            except OSError as error:
                raise AleatorError(
                    f"{short(path)}: the figure cannot be written: {error.strerror}",
                    "choose another folder with --output",
                ) from None
    return path


# ------------------------------------------------------------------------------------ charts


LINES = {"solid": "-", "dashed": "--", "dotted": ":"}
MARKERS = {
    "circle": "o", "diamond": "D", "triangle": "^", "inverted_triangle": "v", "square": "s",
    "cross": "+", "x": "x", "tick": "|",
}  # fmt: skip


def draw(chart: Chart, axes: Axes) -> Axes:
    """Draw the marks of a chart on axes, with its labels; the title is left to the figure."""
    for mark in chart.marks:
        if mark.alpha > 0.0 and not mark.right and mark.shape in _SHAPES:
            _SHAPES[mark.shape](axes, mark)
    for rule in chart.rules:
        line = axes.axhline if rule.across else axes.axvline
        dash = "--" if rule.color == GRAY else "-"
        line(rule.at, color=rule.color, lw=FIGURES.hairline, ls=dash, zorder=1)
    axes.set(xlabel=chart.x.title, ylabel=chart.y.title)
    if chart.y.log:
        logarithmic(axes)
    if chart.foot:
        axes.set_ylim(bottom=0.0)
    return axes


def legend(figure: Figure) -> None:
    """What marks mean, once each, under the axes, where it never hides a number."""
    every = (axes.get_legend_handles_labels() for axes in figure.axes)
    pairs = [pair for own in every for pair in zip(*own, strict=True)]
    pairs.sort(key=lambda pair: not isinstance(pair[0], tuple))  # bars are under all others
    handles = {text: handle for handle, text in pairs}
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower left", ncols=FIGURES.columns,
        handlelength=FIGURES.handle, columnspacing=FIGURES.spacing,
    )  # fmt: skip


def logarithmic(axes: Axes) -> None:
    """A logarithmic ordinate whose ticks are plain numbers."""
    from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high < FIGURES.decades * low:
        axes.yaxis.set_major_locator(MaxNLocator(FIGURES.ticks))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _of(mark: Mark, key: str) -> Array:
    return mark.series.array(key)


def _label(mark: Mark) -> Any:
    return mark.legend or None


def _line(axes: Axes, mark: Mark) -> None:
    x, y = _of(mark, mark.x), _of(mark, mark.y)
    axes.plot(x, y, color=mark.color, lw=FIGURES.line * float(mark.width), ls=LINES[mark.dash],
              label=_label(mark), marker="" if x.size > 1 else "_")  # fmt: skip


def _lines(axes: Axes, mark: Mark) -> None:
    columns, words = mark.series.columns, set()
    for k, (x, y) in enumerate(zip(columns[mark.x], columns[mark.y], strict=True)):
        width = columns[mark.width][k] if isinstance(mark.width, str) else mark.width
        dash = columns[mark.dash][k] if mark.dash in columns else mark.dash
        word = columns[mark.legend_by][k] if mark.legend_by else mark.legend
        axes.plot(np.array(x, float), np.array(y, float), LINES[dash], color=mark.color,
                  lw=FIGURES.lines * width,
                  label=None if word in words else word or None)  # fmt: skip
        words.add(word)


def _band(axes: Axes, mark: Mark) -> None:
    axes.fill_between(_of(mark, mark.x), _of(mark, mark.y), _of(mark, mark.high), lw=0.0,
                      color=mark.color, alpha=mark.alpha, label=_label(mark))  # fmt: skip


def _room(size: int) -> float:
    """Most of the room of an experiment, but not a wall where there are few."""
    most, more, least = FIGURES.room
    return min(most, more * size + least)


def _spans(axes: Axes, mark: Mark) -> None:
    x, low, high = (_of(mark, key) for key in (mark.x, mark.y, mark.high))
    known = np.isfinite(low) & np.isfinite(high)
    if x.size > FIGURES.bars:
        order = np.argsort(x, kind="stable")
        axes.fill_between(x[order], low[order], high[order], step="mid", color=mark.color, lw=0.0,
                          label=_label(mark))  # fmt: skip
        return
    axes.use_sticky_edges = False  # else the lowest bar stands on the axis as if cut there
    axes.bar(x[known], (high - low)[known], _room(x.size), low[known], color=mark.color,
             label=_label(mark))  # fmt: skip


def _bars(axes: Axes, mark: Mark) -> None:
    axes.bar(_of(mark, mark.x), _of(mark, mark.y), float(mark.width), color=mark.color,
             label=_label(mark))  # fmt: skip
    axes.locator_params(axis="y", integer=True)


def _points(axes: Axes, mark: Mark) -> None:
    """Dots of one look are one line of matplotlib, in the legend once."""
    x, y = _of(mark, mark.x), _of(mark, mark.y)
    if mark.marker == "dash":
        half = 0.5 * _room(x.size) if x.size <= FIGURES.bars else 0.5
        axes.hlines(y, x - half, x + half, color=mark.color, lw=FIGURES.thin, label=_label(mark))
        return
    size = 1.0 if isinstance(mark.size, str) else mark.size * FIGURES.points
    if x.size > FIGURES.dots:
        less = FIGURES.smaller * np.log2(x.size / FIGURES.dots)
        size *= float(np.clip(1.0 - less, FIGURES.smallest, 1.0))
    of_column = mark.marker in mark.series.columns
    for (color, marker), rows in looks(mark).items():
        own = FIGURES.dot * size if isinstance(mark.size, str) else size
        axes.plot(x[rows], y[rows], color=color, marker=MARKERS[marker], ls="none", zorder=3,
                  ms=own * (FIGURES.colored if color != BLACK else 1.0),
                  mew=1.0 if marker in ("cross", "x", "tick") else 0.0,
                  label=meaning(color, marker) if of_column else _label(mark))  # fmt: skip


def _contour(axes: Axes, mark: Mark) -> None:
    if mark.grid is not None:
        x, y, height = mark.grid
        axes.contour(x, y, np.ma.masked_invalid(height), levels=list(mark.levels),
                     colors=mark.color)  # fmt: skip


_SHAPES: Mapping[str, Any] = {
    "line": _line, "lines": _lines, "band": _band, "spans": _spans, "bars": _bars,
    "points": _points, "contour": _contour,
}  # fmt: skip
