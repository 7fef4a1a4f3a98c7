"""What the paper's figures draw with, beside the style of the house."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aleator.views.axes import empty_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Canvas

    from reproduction.figure import Reproduction

LIGHT, PALE = "#d4d4d4", "#e8e8e8"
DASHES, DOTS = (0, (5, 2.5)), (0, (1.2, 1.6))


def drawn(result: Reproduction, title: str) -> Canvas:
    """The figure under its title.

    Raises AleatorError where matplotlib is not installed.
    """
    with styled():
        canvas = empty_figure(title, *result.size)
        result.draw(canvas)
    return canvas


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
