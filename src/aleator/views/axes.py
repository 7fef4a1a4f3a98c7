"""Charts drawn with matplotlib, how all figures look, and how they become files.

No pyplot, and the same bytes each time. matplotlib is optional (`pip install matplotlib`); it is
imported only where a figure is asked for, and what the user has set in it stays as it is.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.errors import AleatorError, short
from aleator.types import Array
from aleator.views.chart import BLUE as BLUE
from aleator.views.chart import GRAY as GRAY
from aleator.views.chart import GREEN as GREEN
from aleator.views.chart import INK, TEXT, Chart, Mark, looks, meaning
from aleator.views.chart import VERMILION as VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 9.0
"""Inches of a figure."""
DPI = 160
BLACK = INK
# The rest of Okabe and Ito's palette.
ORANGE, PURPLE, SKY = "#e69f00", "#aa5a8c", "#56b4e9"

_STYLE = {
    "font.size": 10.0,
    "text.color": TEXT,
    "text.parse_math": False,
    "axes.labelcolor": TEXT,
    "axes.edgecolor": "#a0a0a0",
    "axes.linewidth": 0.8,
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
    "legend.fontsize": 9.0,
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

    figure = Figure((width, height), DPI, layout="constrained")
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(w_pad=0.12, h_pad=0.1, wspace=0.04)  # type: ignore[call-arg]
    if title:
        wrapped = textwrap.fill(title, 84)
        figure.suptitle(wrapped, x=0.012, ha="left", fontsize=12.5, fontweight="bold")
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
POINTS = 0.55
"""Points of a mark in a figure over pixels of it on a page."""
MANY = 300
"""More bars than that run into each other; steps then show the same."""
DECADES = 30.0
"""A logarithmic scale of less than that has too few powers of ten to be read."""


def draw(chart: Chart, axes: Axes) -> Axes:
    """Draw the marks of a chart on axes, with its labels; the title is left to the figure."""
    for mark in chart.marks:
        if mark.alpha > 0.0 and not mark.right and mark.shape in _SHAPES:
            _SHAPES[mark.shape](axes, mark)
    for rule in chart.rules:
        line = axes.axhline if rule.across else axes.axvline
        line(rule.at, color=rule.color, lw=0.8, ls="--" if rule.color == GRAY else "-", zorder=1)
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
        handles.values(), handles.keys(), loc="outside lower left", ncols=6, handlelength=1.6,
        columnspacing=1.8,
    )  # fmt: skip


def logarithmic(axes: Axes) -> None:
    """A logarithmic ordinate whose ticks are plain numbers."""
    from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high < DECADES * low:
        axes.yaxis.set_major_locator(MaxNLocator(6))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _of(mark: Mark, key: str) -> Array:
    return mark.series.array(key)


def _label(mark: Mark) -> Any:
    return mark.legend or None


def _line(axes: Axes, mark: Mark) -> None:
    x, y = _of(mark, mark.x), _of(mark, mark.y)
    axes.plot(x, y, color=mark.color, lw=0.7 * float(mark.width), ls=LINES[mark.dash],
              label=_label(mark), marker="" if x.size > 1 else "_")  # fmt: skip


def _lines(axes: Axes, mark: Mark) -> None:
    columns, words = mark.series.columns, set()
    for k, (x, y) in enumerate(zip(columns[mark.x], columns[mark.y], strict=True)):
        width = columns[mark.width][k] if isinstance(mark.width, str) else mark.width
        dash = columns[mark.dash][k] if mark.dash in columns else mark.dash
        word = columns[mark.legend_by][k] if mark.legend_by else mark.legend
        axes.plot(np.array(x, float), np.array(y, float), LINES[dash], color=mark.color,
                  lw=0.6 * width, label=None if word in words else word or None)  # fmt: skip
        words.add(word)


def _band(axes: Axes, mark: Mark) -> None:
    axes.fill_between(_of(mark, mark.x), _of(mark, mark.y), _of(mark, mark.high), lw=0.0,
                      color=mark.color, alpha=mark.alpha, label=_label(mark))  # fmt: skip


def _room(size: int) -> float:
    """Most of the room of an experiment, but not a wall where there are few."""
    return min(0.72, 0.02 * size + 0.06)


def _spans(axes: Axes, mark: Mark) -> None:
    x, low, high = (_of(mark, key) for key in (mark.x, mark.y, mark.high))
    known = np.isfinite(low) & np.isfinite(high)
    if x.size > MANY:
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
        half = 0.5 * _room(x.size) if x.size <= MANY else 0.5
        axes.hlines(y, x - half, x + half, color=mark.color, lw=1.2, label=_label(mark))
        return
    size = 1.0 if isinstance(mark.size, str) else mark.size * POINTS
    if x.size > 20:
        size *= float(np.clip(1.0 - 0.14 * np.log2(x.size / 20.0), 0.3, 1.0))
    of_column = mark.marker in mark.series.columns
    for (color, marker), rows in looks(mark).items():
        own = 4.2 * size if isinstance(mark.size, str) else size
        axes.plot(x[rows], y[rows], color=color, marker=MARKERS[marker], ls="none", zorder=3,
                  ms=own * (1.25 if color != BLACK else 1.0),
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
