"""How all figures look, and how they become files: no pyplot, and the same bytes each time.

matplotlib is optional (`pip install matplotlib`); it is imported only where a figure is asked
for, and what the user has set in it stays as it is.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from aleator.errors import AleatorError, short

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 9.0  #: inches
DPI = 160

# Okabe and Ito's palette, told apart in every form of color blindness.
BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#e69f00",
    "#aa5a8c",
    "#56b4e9",
)
BLACK, GRAY = "#262626", "#8c8c8c"
TEXT = "#404040"

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
