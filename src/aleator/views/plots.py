"""The charts of one answer on matplotlib axes: `found.plot.law()`, `.outcomes()`, `.profiles()`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from aleator.errors import AleatorError, nearest
from aleator.views import law_charts
from aleator.views.axes import draw, empty_figure, styled
from aleator.views.chart import Chart
from aleator.views.measured import measured, varying
from aleator.views.opening import outcome_chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Document = Mapping[str, Any]
SIZE = (4.5, 3.4)
"""Width and height in inches of a chart in a figure of its own."""


@dataclass(frozen=True, eq=False)
class Plots:
    """The charts of an answer, each drawn on matplotlib axes, which are returned.

    `content` returns the content of identification.json. Without `ax` a chart is drawn in a new
    figure, which a notebook shows by `.figure`. All raise AleatorError if matplotlib is not
    installed (pip install matplotlib), and if the answer lacks the data of the chart.

    >>> curve = {"x": [0.0, 1.0], "density": [1.0, 1.0], "lower": [0.5, 0.5], "upper": [2.0, 2.0]}
    >>> Plots(lambda: {"pictures": {"laws": {"wear": curve}}}).law().get_xlabel()
    'wear'
    """

    content: Callable[[], Document]

    @cached_property
    def document(self) -> Document:
        """The content of identification.json with the data of charts, made once."""
        return self.content()

    def law(self, parameter: str | None = None, ax: Axes | None = None) -> Axes:
        """The density of a parameter's law with its 95 % band; by default of the first parameter.

        Dashed lines are the ends of the range with 95 % of the law.
        """
        known = (self.document.get("pictures") or {}).get("laws")
        name = required(known, parameter, "laws")
        return drawn(law_charts.law_chart(self.document, name), ax)

    def outcomes(self, response: str | None = None, ax: Axes | None = None) -> Axes:
        """Measured outcomes in the bands with 95 % and 50 % of new experiments by the law.

        x is the condition that determines the prediction, if there is one. `response` names one of
        several responses; the default is the first.
        """
        of = {seen.response: seen for seen in measured(self.document) if seen.by_law}
        seen = of[required(of, response, "predictions of what was observed")]
        noise = bool(self.document.get("quadrature"))
        series = varying(self.document)
        return drawn(outcome_chart(seen, seen.series(), series, noise=noise), ax)

    def profiles(self, *hyperparameters: str) -> list[Axes]:
        """The profile log-likelihoods of these hyperparameters, or of all, side by side."""
        known = (self.document.get("pictures") or {}).get("profiles")
        first = required(known, None, "profiles")
        names = [required(known, name, "profiles") for name in hyperparameters]
        names = names or [*(known or {first: None})]
        width, height = SIZE
        with styled():
            figure = empty_figure(None, width * len(names), height)
            grid = figure.subplots(1, len(names), squeeze=False).ravel()
            return [
                draw(law_charts.profile_chart(self.document, name), axes)
                for name, axes in zip(names, grid, strict=True)
            ]


def drawn(chart: Chart, ax: Axes | None) -> Axes:
    """The axes `ax`, or those of a new figure if `ax` is None, with the chart drawn on them."""
    if ax is not None:
        return draw(chart, ax)
    with styled():
        return draw(chart, empty_figure(None, *SIZE).subplots())


def required(known: Mapping[str, Any] | None, name: str | None, what: str) -> str:
    """The name if it is `known`, or the first known one if it is None; else raises AleatorError."""
    if not known:
        raise lacking(what)
    if name is not None and name not in known:
        raise AleatorError(
            f"there is no '{name}' among the {what}{nearest(name, [*known])}",
            f"there are {', '.join(known)}",
        )
    return next(iter(known)) if name is None else name


def named(names: Sequence[str], response: str | None) -> str:
    """The name of a response, by default the first one; raises AleatorError for an unknown name."""
    name = names[0] if response is None else response
    if name not in names:
        raise AleatorError(
            f"there is no response '{name}'{nearest(name, names)}",
            f"the responses are {', '.join(names)}",
        )
    return name


def lacking(what: str) -> AleatorError:
    """The error for a chart whose data the answer lacks."""
    return AleatorError(
        f"the document has no {what}",
        "identify again: `aleator identify` writes them, and in Python the fit is at hand",
    )
