"""report.html: a report as one HTML file with interactive charts, which needs no network.

The page begins with the answer and both verdicts; sections follow, with sentences, tables and
charts. A bar selects an experiment, which is then marked in every chart. Equal reports give equal
text.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

from aleator.errors import AleatorError, count, installing, quoted
from aleator.results import documents
from aleator.results.printed import (
    Chapter,
    Content,
    Part,
    Sentence,
    TextTable,
    cells,
    prose,
    verdict_head,
)
from aleator.views.chart import PAIRS, Chart
from aleator.views.identification import identification
from aleator.views.measured import AxisChoice


@dataclass(frozen=True)
class HtmlReport:
    """An HTML page as text, which needs no network; a notebook shows it in a frame.

    `height` is the height of the frame in pixels.

    >>> HtmlReport("<p>Found</p>")
    Report of 12 characters: save it, or show it in a notebook
    """

    text: str
    height: int = 900

    def __repr__(self) -> str:
        return f"Report of {len(self.text):,} characters: save it, or show it in a notebook"

    def save(self, path: str | Path) -> Path:
        """Write the page as an HTML file. Raises AleatorError if the file cannot be written."""
        documents.write_text(self.text, path)
        return Path(path)

    def _repr_html_(self) -> str:
        """The page in an HTML frame, which separates its styles and scripts from the notebook's."""
        return (
            f'<iframe srcdoc="{escape(self.text)}" title="Report" '
            f'style="width:100%;height:{self.height}px;border:1px solid #ccc"></iframe>'
        )


def report_of(document: Mapping[str, Any]) -> HtmlReport:
    """The report of an identification, from the content of identification.json.

    Raises AleatorError if Bokeh is not installed.
    """
    return HtmlReport(page(documents.plain(document)))


def page(
    document: Mapping[str, Any], ceiling: Mapping[str, Any] | None = None, study: str | None = None
) -> str:
    """The text of report.html for an identification; equal documents give equal text.

    `document` is the content of identification.json, `ceiling` the content of ceiling.json, and
    `study` the text of the study file; the last two may be None. Raises AleatorError if Bokeh is
    not installed.
    """
    return written(*identification(document, ceiling, study))


def written(content: Content, choices: Mapping[str, Sequence[AxisChoice]]) -> str:
    """The text of an HTML page with a content.

    `choices` are the quantities that a reader can choose for the x axis, by the name of a series.
    Raises AleatorError if Bokeh is not installed.
    """
    try:
        from aleator.views.interactive import bokeh_script, drawable
    except ModuleNotFoundError as error:
        if error.name != "bokeh":
            raise
        raise AleatorError(
            "a report needs bokeh, which is not installed", installing("report")
        ) from None
    warnings = content.warnings or [Sentence("There are no warnings.")]
    judged = [*content.verdicts, *warnings]
    whole = [Chapter("warnings", "Verdicts, warnings and remedies", judged), *content.sections]
    sections = [section for section in whole if section.parts]
    every = [*content.opening, *(part for section in sections for part in section.parts)]
    charts = [part for part in every if isinstance(part, Chart)]
    facts = {
        **drawable(charts),
        "charts": {
            chart.name: {
                "source": chart.source.name,
                "columns": {k: v for k, v in chart.columns.items() if k in chart.source.columns},
                "switched": chart.switched,
            }
            for chart in charts
        },
        "axes": _choices(choices),
        "colors": PAIRS,
    }
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in sections)
    body = "".join(
        f'<section id="{s.name}"><h2>{escape(s.title)}</h2>{_switch(s)}{_parts(s.parts)}</section>'
        for s in sections
    )
    title = escape(content.title)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_file('page.css')}</style></head><body>"
        f"<header><h1>{title}</h1>{opening(content)}</header>"
        f'<nav aria-label="Sections">{links}</nav>{_bar(charts)}<main>{body}</main>'
        f'<script id="facts" type="application/json">{safe(facts)}</script>'
        f"<script>{bokeh_script()}</script><script>{_file('page.js')}</script></body></html>\n"
    )


def opening(content: Content) -> str:
    """The HTML of the head of a page: the answer, each verdict in a line, charts, what was done."""
    sentences = [part for part in content.opening if isinstance(part, Sentence)]
    charts = [part for part in content.opening if isinstance(part, Chart)]
    told = sum(warning.kind == "warning" for warning in content.warnings)
    more = f'<p><a href="#warnings">{count(told, "warning")}</a></p>' if told else ""
    lines = "".join(
        _verdict(replace(one, text=verdict_head(one), remedy="")) for one in content.verdicts
    )
    return (
        f'<h2 class="spoken">The answer</h2><div class="findings">{_parts(sentences)}</div>'
        f'<div class="verdicts">{lines}{more}</div><div class="charts">{_parts(charts)}</div>'
        f"{_parts(content.lead)}"
    )


def _verdict(part: Sentence) -> str:
    """A verdict in a color, the text up to its reasons in bold."""
    head, colon, rest = part.text.partition(":")
    remedy = f'<span class="remedy">Remedy: {prose(part.remedy)}</span>' if part.remedy else ""
    words = f"<strong>{prose(head)}</strong>{colon}{prose(rest)}{remedy}"
    return f'<p class="verdict {part.kind}">{words}</p>'


def safe(value: Any) -> str:
    """A value as JSON text that can stand within a script element of HTML.

    >>> safe({"a": "</script>"})
    '{"a":"\\\\u003c/script>"}'
    """
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


# ------------------------------------------------------------------------------------ parts


def _parts(parts: Sequence[Part]) -> str:
    """The HTML of sentences, tables and charts; consecutive charts share a row unless wide."""
    text = ""
    for beside, group in groupby(parts, lambda part: isinstance(part, Chart) and not part.wide):
        each = "".join(map(_part, group))
        text += f'<div class="row">{each}</div>' if beside else each
    return text


def _part(part: Part) -> str:
    if isinstance(part, TextTable):
        return _table(part)
    if isinstance(part, Chart):
        return _figure(part)
    return _sentence(part) if isinstance(part, Sentence) else ""


def _sentence(part: Sentence) -> str:
    if part.kind == "heading":
        return f"<h3>{prose(part.text)}</h3>"
    if part.kind in ("good", "bad", "open"):
        return _verdict(part)
    if part.kind == "code":
        return f'<pre tabindex="0">{escape(part.text)}</pre>'
    head = f"<strong>{prose(part.head)}:</strong> " if part.head else ""
    picks = "".join(
        f' <button type="button" data-pick="{escape(id)}">Mark {escape(id)}</button>'
        for id in part.ids
    )
    remedy = f'<span class="remedy">Remedy: {prose(part.remedy)}</span>' if part.remedy else ""
    kind = "" if part.kind == "plain" else f' class="{part.kind}"'
    return f"<p{kind}>{head}{prose(part.text)}{picks}{remedy}</p>"


def _table(part: TextTable) -> str:
    """The HTML of a table with a button that copies it; a click opens a folded table."""
    if not part.rows:
        return ""
    name, title = escape(part.name), escape(part.title)
    made = (
        f'<div class="table"><table id="table-{name}"><caption>{title} '
        f'<button type="button" data-copy="table-{name}">Copy</button></caption>'
        f"{cells(part)}</table></div>"
    )
    return f"<details><summary>{title}</summary>{made}</details>" if part.folded else made


def _figure(chart: Chart) -> str:
    """The HTML of the frame of a chart, with title, caption and the buttons that save it."""
    name, spoken = escape(chart.name), escape(quoted(chart.spoken))
    return (
        f'<figure id="figure-{name}"><h3>{prose(chart.title)}</h3>'
        f'<div class="plot" id="plot-{name}" role="img" aria-label="{spoken}"></div>'
        f'<div class="print" id="print-{name}" aria-hidden="true"></div>'
        f"<figcaption>{prose(chart.caption)} "
        f'<span class="saved"><button type="button" data-svg="{name}">SVG</button> '
        f'<button type="button" data-csv="{name}">CSV</button></span></figcaption></figure>'
    )


# ------------------------------------------------------------------------------------ the frame


def _choices(choices: Mapping[str, Sequence[AxisChoice]]) -> list[dict[str, Any]]:
    """The choices of the x axis: the title of each, and its column in every series that has it."""
    titles: dict[str, dict[str, Any]] = {}
    for series, own in choices.items():
        for choice in own:
            entry = titles.setdefault(choice.title, {"title": choice.title, "of": {}})
            entry["of"][series] = {k: v for k, v in asdict(choice).items() if k != "title"}
    return list(titles.values())


def _switch(section: Chapter) -> str:
    """The HTML of a section's menu for the x axis; the script of the page fills the menu.

    It is empty if no chart of the section has a choice.
    """
    charts = [part for part in section.parts if isinstance(part, Chart) and part.switched]
    if not charts:
        return ""
    series = " ".join(dict.fromkeys(chart.source.name for chart in charts))
    return (
        f'<p class="switch"><label>x axis <select data-axis="{escape(series)}"></select>'
        "</label></p>"
    )


def _ids(charts: Iterable[Chart]) -> Iterator[str]:
    for chart in charts:
        if chart.name.startswith("measured"):
            yield from chart.source.columns["id"]


def _bar(charts: Iterable[Chart]) -> str:
    """The HTML of the bar at the top, where a reader selects the experiment that is marked."""
    listed = "".join(f"<option>{escape(one)}</option>" for one in dict.fromkeys(_ids(charts)))
    return (
        '<div class="bar" role="region" aria-label="Marked experiment"><label>Experiment '
        '<input id="marked" list="ids" autocomplete="off" placeholder="none marked"></label>'
        f'<datalist id="ids">{listed}</datalist>'
        '<button type="button" id="previous" aria-label="previous experiment">◀</button>'
        '<button type="button" id="next" aria-label="next experiment">▶</button>'
        '<button type="button" id="clear">Clear</button>'
        '<button type="button" id="scheme">Light or dark</button>'
        '<span id="status" role="status"></span></div>'
    )


def _file(name: str) -> str:
    return (files("aleator.views") / name).read_text(encoding="utf-8")
