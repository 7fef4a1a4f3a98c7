"""Pieces of the page: paragraphs, tables that can be copied, sections."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from aleator.report.html.chart import Chart

NUMBER = ' class="n"'


@dataclass(frozen=True)
class Section:
    """A part of the page under a heading; its charts are drawn when the page is opened."""

    name: str
    title: str
    body: str
    charts: tuple[Chart, ...] = ()

    @classmethod
    def of(cls, name: str, title: str, *parts: str | Chart) -> Section:
        """Text and charts in the order in which they are to be read."""
        charts = tuple(part for part in parts if isinstance(part, Chart))
        body = "".join(framed(part) if isinstance(part, Chart) else part for part in parts)
        return cls(name, title, body, charts)


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text; what stands in backticks is code.

    >>> paragraph("a < b, see `aleator box`")
    '<p>a &lt; b, see <code>aleator box</code></p>'
    """
    return f"<p{_kind(kind)}>{prose(text)}</p>"


def missing(what: str, remedy: str) -> str:
    """What a reader would look for here, why it is not there, and what brings it."""
    return f'<p class="missing">{prose(what)} {prose(remedy)}</p>'


def prose(text: str) -> str:
    """Plain text as HTML; what stands in backticks is code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def code(text: str) -> str:
    """Text as it is, to be copied."""
    return f'<pre tabindex="0">{escape(text)}</pre>'


def heading(text: str) -> str:
    """A heading within a section."""
    return f"<h3>{escape(text)}</h3>"


def table(
    name: str,
    title: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    text: int = 1,
    notes: bool = False,
) -> str:
    """A table with a button that copies it; the first `text` columns are text, others numbers.

    With `notes` the last column is text as well.

    >>> '<td class="n">2</td>' in table("t", "Values", ["a", "b"], [["1", "2"]])
    True
    """
    last = len(head) - 1
    kinds = ["" if k < text or (notes and k == last) else NUMBER for k in range(len(head))]
    top = "".join(
        f'<th scope="col"{kind}>{escape(cell)}</th>' for kind, cell in zip(kinds, head, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{kind}>{escape(cell)}</td>" for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="table"><table id="table-{escape(name)}"><caption>{escape(title)} '
        f'<button type="button" data-copy="table-{escape(name)}">Copy</button></caption>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def folded(summary: str, body: str) -> str:
    """What only some readers look for, under a line that opens it."""
    return f"<details><summary>{escape(summary)}</summary>{body}</details>"


def framed(chart: Chart) -> str:
    """The place of a chart, with its title, how to read it, and what can be saved."""
    name = escape(chart.name)
    return (
        f'<figure id="figure-{name}"><h3>{escape(chart.title)}</h3>'
        f'<div class="plot" id="plot-{name}" role="img" aria-label="{escape(chart.spoken)}"></div>'
        f'<div class="print" id="print-{name}" aria-hidden="true"></div>'
        f"<figcaption>{escape(chart.caption)} "
        f'<span class="saved"><button type="button" data-svg="{name}">SVG</button> '
        f'<button type="button" data-csv="{name}">CSV</button></span></figcaption></figure>'
    )


def side_by_side(*charts: Chart) -> tuple[str | Chart, ...]:
    """Charts that stand in a row where there is room."""
    return ('<div class="row">', *charts, "</div>")


def _kind(kind: str) -> str:
    return f' class="{kind}"' if kind else ""
