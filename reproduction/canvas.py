"""Drawing in the style of the house: colors, empty canvases, files of the same bytes."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from aleator.plot.identification import DPI, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Canvas

    from reproduction.figure import Reproduction


# Okabe and Ito's palette, told apart in every form of color blindness.
BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#e69f00",
    "#aa5a8c",
    "#56b4e9",
)
BLACK, GRAY, LIGHT, PALE = "#262626", "#8c8c8c", "#d4d4d4", "#e8e8e8"
DASHES, DOTS = (0, (5, 2.5)), (0, (1.2, 1.6))


def drawn(result: Reproduction, title: str, form: str) -> bytes:
    """The figure as a file, `form` "png" or "svg"; the same result gives the same bytes.

    Raises AleatorError where matplotlib is not installed.
    """
    with styled():
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        canvas = Figure(result.size, DPI, layout="constrained")
        engine = canvas.get_layout_engine()
        if engine is not None:
            engine.set(w_pad=0.10, h_pad=0.08, wspace=0.05, hspace=0.06)  # type: ignore[call-arg]
        canvas.suptitle(title, x=0.012, ha="left", fontsize=12.0, fontweight="bold")
        result.draw(canvas)
        image = BytesIO()
        metadata = {"Software": None} if form == "png" else {"Date": None, "Creator": None}
        with rc_context({"svg.hashsalt": "aleator", "svg.fonttype": "path"}):
            canvas.savefig(image, format=form, metadata=metadata)
    return image.getvalue()


def powers_of_ten(axis: Axis) -> None:
    """Label a logarithmic axis 0.01, 1, 100, 10⁴: the house draws no formulas."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))


def power_of_ten(value: float) -> str:
    """A tick of a logarithmic axis.

    >>> [power_of_ten(value) for value in (0.01, 1.0, 1000.0, 1e6, 1e-12)]
    ['0.01', '1', '1000', '10⁶', '10⁻¹²']
    """
    if 1e-4 <= value <= 1e4:
        return f"{value:g}"
    exponent = str(round(np.log10(value)))
    return "10" + exponent.translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def explain(canvas: Canvas, axes: Axes, columns: int = 6) -> None:
    """The legend of the labeled things in some axes, under all axes: it never hides a number."""
    handles, labels = axes.get_legend_handles_labels()
    canvas.legend(
        handles, labels, loc="outside lower left", ncols=columns, handlelength=1.8,
        columnspacing=1.6,
    )  # fmt: skip
