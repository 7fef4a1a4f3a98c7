"""An answer as a notebook shows it: the first screen of the report, with pictures as SVG."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import replace
from html import escape
from typing import Any

from aleator.errors import AleatorError, quoted
from aleator.results.answer import answer, estimates, log_likelihood
from aleator.results.printed import Chapter, Sentence, cells, fragment, prose, verdict_head
from aleator.views.axes import draw, empty_figure, styled
from aleator.views.chart import Chart
from aleator.views.measured import measured
from aleator.views.opening import opening_charts
from aleator.views.plots import SIZE

Document = Mapping[str, Any]
COLORS = {"good": "#00704f", "bad": "#b34700", "open": "#8c6700"}
"""The colors of verdicts, which are readable on a white and on a dark page."""


def first_screen(document: Document) -> str:
    """The answer as HTML without scripts: sentences, both verdicts, charts, and the estimates.

    The reasons of the verdicts, warnings and the method are folded. The charts are left out if
    matplotlib is not installed, or if the document lacks their data.
    """
    content = answer(document)
    told = [part for part in content.opening if isinstance(part, Sentence)]
    sentences = "".join(f"<div><b>{prose(s.head)}:</b> {prose(s.text)}</div>" for s in told)
    verdicts = " ".join(
        f'<b style="color:{COLORS[one.kind]}">{prose(verdict_head(one))}</b>'
        for one in content.verdicts
    )
    likelihood = Chapter("likelihood", "Log-likelihood", [log_likelihood(document)])
    rest = fragment(replace(content, title="", opening=(), sections=[likelihood]))
    return (
        f"{sentences}<p>{verdicts}</p>{_pictures(document)}"
        f"<table>{cells(estimates(document))}</table>"
        f"<details><summary>Method, warnings, reasons of the verdicts</summary>{rest}</details>"
    )


def _pictures(document: Document) -> str:
    try:
        drawn = [*_drawings(document)]
    except AleatorError as missing:  # matplotlib is optional
        return f"<p>No charts: {prose(str(missing))}</p>"
    return f'<div style="display:flex;flex-wrap:wrap">{"".join(drawn)}</div>' if drawn else ""


def _drawings(document: Document) -> Iterator[str]:
    seen = [(one, one.thinned().series()) for one in measured(document)]
    for chart in opening_charts(document, seen):
        spoken = escape(quoted(chart.spoken))
        frame = f'<figure style="margin:0 1em 0 0" role="img" aria-label="{spoken}">'
        yield f"{frame}{svg(chart)}</figure>"


def svg(chart: Chart) -> str:
    """A chart with its title as the text of an SVG element; equal charts give equal text.

    Raises AleatorError if matplotlib is not installed.
    """
    with styled():
        from matplotlib import rc_context

        figure = empty_figure(None, *SIZE)
        draw(chart, figure.subplots()).set_title(chart.title)
        text = io.StringIO()
        with rc_context({"svg.hashsalt": chart.name, "svg.fonttype": "none"}):
            figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    whole = text.getvalue()
    return whole[whole.index("<svg") :]
