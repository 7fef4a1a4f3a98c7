"""The frame of a page: its head, the bar that marks an experiment, sections, data and scripts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files
from typing import Any

from aleator.report.html import colors
from aleator.report.html.bundle import bokeh_script, drawable, safe
from aleator.report.html.markup import Section
from aleator.report.html.rows import Axis


def whole_page(
    title: str,
    head: str,
    sections: Sequence[Section],
    axes: Mapping[str, Sequence[Axis]],
    ids: Sequence[str],
) -> str:
    """The text of a file that needs nothing else.

    `head` is what stands above all sections, `axes` say by the name of a source what its x can be,
    and `ids` are the experiments that can be marked.
    """
    charts = [chart for section in sections for chart in section.charts]
    facts = {
        **drawable(charts),
        "charts": {
            chart.name: {
                "source": chart.source.name,
                "columns": dict(chart.columns),
                "switched": chart.switched,
            }
            for chart in charts
        },
        "axes": _choices(axes),
        "colors": colors.PAIRS,
    }
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in sections)
    body = "".join(
        f'<section id="{s.name}"><h2>{escape(s.title)}</h2>{_switch(s)}{s.body}</section>'
        for s in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_part('page.css')}</style></head><body>"
        f"<header><h1>{escape(title)}</h1>{head}</header>"
        f'<nav aria-label="Sections">{links}</nav>{_bar(ids)}<main>{body}</main>'
        f'<script id="facts" type="application/json">{safe(facts)}</script>'
        f"<script>{bokeh_script()}</script><script>{_part('page.js')}</script></body></html>\n"
    )


def _choices(axes: Mapping[str, Sequence[Axis]]) -> list[dict[str, Any]]:
    """What can be chosen for x, by title: in each source the column that has it."""
    found: dict[str, dict[str, Any]] = {}
    for source, own in axes.items():
        for axis in own:
            entry = found.setdefault(axis.title, {"title": axis.title, "of": {}})
            entry["of"][source] = {k: v for k, v in asdict(axis).items() if k != "title"}
    return list(found.values())


def _switch(section: Section) -> str:
    """A choice of x where a chart of the section has one; the page fills it."""
    if not any(chart.switched for chart in section.charts):
        return ""
    sources = " ".join(dict.fromkeys(str(c.source.name) for c in section.charts if c.switched))
    return (
        f'<p class="switch"><label>x axis <select data-axis="{escape(sources)}"></select>'
        "</label></p>"
    )


def _bar(ids: Sequence[str]) -> str:
    """What marks an experiment, by keyboard too."""
    listed = "".join(f"<option>{escape(one)}</option>" for one in ids)
    return (
        '<div class="bar" role="toolbar" aria-label="Marked experiment"><label>Experiment '
        '<input id="marked" list="ids" autocomplete="off" placeholder="none marked"></label>'
        f'<datalist id="ids">{listed}</datalist>'
        '<button type="button" id="previous" aria-label="previous experiment">◀</button>'
        '<button type="button" id="next" aria-label="next experiment">▶</button>'
        '<button type="button" id="clear">Clear</button>'
        '<button type="button" id="scheme">Light or dark</button>'
        '<span id="told" role="status"></span></div>'
    )


def _part(name: str) -> str:
    return (files("aleator.report.html") / name).read_text(encoding="utf-8")
